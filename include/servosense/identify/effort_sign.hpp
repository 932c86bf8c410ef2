// The sign of an effort that a drive reports as an absolute value.
//
// What the drive takes without a cut, t = J a + D v + C sgn v + L, is known from its motion. While
// it drives (t along the motion) the effort is along the motion, since a cut only adds to it. While
// it brakes, either sign may be: the cut that each would mean,
//   +|u| - t   or   -|u| - t   (along the motion),
// is compared with the cut so far, and the nearer is taken. A sign changes where the motion sample
// by sample agrees best, as far as counts tell, and there at the least |u|: it never flickers.
// Where inertia and friction are not known, only driving tells a sign.
//
// Speed and acceleration are taken from three positions `reach` apart, on both sides of a sample,
// so answers come two reaches late. Host code: allocates.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/drive_sample.hpp"
#include "servosense/model/drive_model.hpp"

namespace servosense {

struct EffortSignConfig {
  double sample_period_s = 125e-6;
  double inertia = 0;  ///< kg or kg m2; 0: not known, and nothing below is used
  double viscous = 0, coulomb = 0, constant_load = 0;
  double grain = 0;  ///< m or rad of a count; 0: none
  /// m/s2 or rad/s2 of braking from which a sign is not sure when the inertia is not known.
  double braking = 0;
};

[[nodiscard]] EffortSignConfig effort_sign_config(const DriveModelConfig& drive,
                                                  double sample_period_s, double grain);

class EffortSign {
 public:
  struct Answer {
    int sign = 1;      ///< of the effort: 1 or -1
    bool sure = true;  ///< false where both would do
  };

  explicit EffortSign(const EffortSignConfig& config);
  /// Motion since the sample before [m or rad] and |effort| [N or Nm].
  void push(double increment, double magnitude);
  /// Of the oldest sample that has not been answered; nothing while it is not decided.
  std::optional<Answer> pop();
  /// No more samples: the last ones keep the sign before.
  void finish();
  /// Samples that were given back, and how many of them were sure.
  [[nodiscard]] std::uint64_t answered() const { return answered_; }
  [[nodiscard]] double sure_share() const;

 private:
  struct Item {
    double position = 0, magnitude = 0;
    Answer answer;
  };
  void decide(std::size_t i);
  [[nodiscard]] Answer judge(double v, double a, double magnitude);
  /// Taken without a cut, along the axis.
  [[nodiscard]] double taken(double v, double a) const;
  [[nodiscard]] std::size_t place_of_change(std::size_t i) const;

  EffortSignConfig config_;
  std::size_t reach_ = 1;
  std::deque<Item> items_;     // from two reaches before the newest decided one
  std::size_t final_ = 0;      // of them need no further look
  std::size_t decided_ = 0;    // of them have an answer
  std::size_t given_ = 0;      // of them were answered to the caller
  std::size_t change_in_ = 0;  // items until the sign that was decided holds
  int sign_ = 0;
  double cut_ = 0;  // along the motion, smoothed
  bool ended_ = false;
  std::uint64_t answered_ = 0, sure_ = 0;
};

/// Puts the sign into the efforts of a whole record. Samples that are not sure are marked
/// `unsure` (none where that is Quality::good). The share that is sure.
double resolve_signs(std::vector<DriveSample<double>>& samples, const EffortSignConfig& config,
                     Quality unsure = Quality::good);

/// What a reader is told of a drive whose signs were found; of a current that seems to want one,
/// what the machine file lacks.
[[nodiscard]] std::string signs_found(Channel drive, double sure_share);
[[nodiscard]] std::string signs_wanted(Channel drive);

}  // namespace servosense
