// Two signals of a drive that say the same thing: their difference, and when it is more than the
// machine makes of it.
//
// Purpose: sees what no single signal shows: an encoder that slips, a belt or coupling that has
// gone, a gantry that racks, a drive that does not follow what it is told.
//   pair          difference                                  band
//   load          scale - motor                               how far it wanders
//   skew          first - second motor of a gantry            how far it wanders
//   skew-effort   effort of the first - of the second         how large it is
//   following     commanded - actual position                 how large it is
//   command       effort - commanded effort                   how large it is
// All signals pass one low-pass of two poles (kCutoff_rad_s); with x, v, a of the filtered motion,
// S its direction, u the effort and w' the rate of the commanded effort, the expected difference is
//   zero + k0 x + k1 v + k2 a + k3 S + k4 u + k5 w' + sum c_n P_n(x)      P_n: Legendre, n = 2..5
// whose terms identify/learn_pairs.hpp finds in an idling run. What is left over that is judged:
// how far it wanders, because a zero is of one power-up, the ends of the wandering forgotten over
// kForget_s; or how large it is. A cut is allowed what it may do: F is the effort beyond that of
// the idling run, C the Coulomb friction there.
//   load         k4 F wound up more       skew, following    band |F| / 2C
//   skew-effort  F, unless in the air: a cut beside one guide is carried by one motor
// Delay: kHold_s beyond the band, and the filter's 2 / kCutoff_rad_s.
// Faults: rows without a sound value, or behind a hole, start the filters anew; nothing is judged
// for kSettle_s.
// Bad at: what comes slowly (a screw that warms up, 1e-4 of the travel, is allowed); a slip of less
// than the band.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/io/paired_columns.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/io/travel.hpp"
#include "servosense/model/elastoplastic_sign.hpp"

namespace servosense {

enum class PairKind : std::uint8_t { load, skew, skew_effort, following, command };
inline constexpr auto kPairNames =
    std::to_array<std::string_view>({"load", "skew", "skew-effort", "following", "command"});
inline constexpr std::size_t kPairKinds = kPairNames.size();
[[nodiscard]] constexpr std::string_view name_of(PairKind kind) noexcept {
  return kPairNames[static_cast<std::size_t>(kind)];
}
/// In m or rad; else in N or Nm.
[[nodiscard]] constexpr bool is_distance(PairKind kind) noexcept {
  return kind == PairKind::load || kind == PairKind::skew || kind == PairKind::following;
}

/// What units of the trace are of the drive, in m and N or rad and Nm.
struct PairScaling {
  double unit_per_count = 0;
  unsigned counter_bits = 32;
  double unit_per_turn = 0;     ///< travel of a turn of the motor; 0: not known
  double effort_per_unit = 1;   ///< of the effort's column, its scale included
  double command_per_unit = 1;  ///< of the commanded effort's, likewise
  double knee = 5e-6;           ///< of the friction
};

/// Signals of a row behind the filter, in the units of the drive.
struct PairSample {
  double t_s = 0;
  bool settled = false;
  double position = 0, velocity = 0, acceleration = 0;
  double direction = 0;  ///< S, -1..1
  double effort = 0;     ///< of all motors
  double command_rate = 0, command_curvature = 0;
  std::array<double, 4> turn{};  ///< sine and cosine of the motor's turn, then of twice it
  double raw_effort = 0;         ///< of the first motor, not filtered
  std::array<double, kPairKinds> difference;  ///< NaN where there is none, or not yet
};

/// Low-pass of two poles that knows its slope and curvature (Zavalishin 2012, section 4.4),
/// critically damped: exact at rest and at even speed, stable at any step.
class FilteredSignal {
 public:
  void reset(double value) {
    low_ = integral_ = value;
    rate_ = curvature_ = 0;
    integral_of_rate_ = 0;
  }
  /// `half_step`: cutoff dt / 2.
  void process(double value, double half_step, double cutoff_rad_s) {
    const double high = (value - (2 + half_step) * integral_of_rate_ - integral_) /
                        (1 + half_step * (2 + half_step));
    const double band = integral_of_rate_ + half_step * high;
    low_ = integral_ + half_step * band;
    integral_of_rate_ = band + half_step * high;
    integral_ = low_ + half_step * band;
    rate_ = cutoff_rad_s * band;
    curvature_ = cutoff_rad_s * cutoff_rad_s * high;
  }
  [[nodiscard]] double low() const { return low_; }
  [[nodiscard]] double rate() const { return rate_; }
  [[nodiscard]] double curvature() const { return curvature_; }

 private:
  double low_ = 0, rate_ = 0, curvature_ = 0, integral_ = 0, integral_of_rate_ = 0;
};

/// From rows to samples of one drive.
class PairReader {
 public:
  static constexpr double kCutoff_rad_s = 200;
  static constexpr double kSettle_s = 0.25;

  PairReader(const PairedColumns& columns, const PairScaling& scaling);
  /// False for a row that brings nothing.
  bool hear(const TraceRow& row);
  [[nodiscard]] const PairSample& sample() const { return sample_; }
  [[nodiscard]] const PairedColumns& columns() const { return columns_; }

 private:
  enum Input : std::size_t {
    motion,
    effort,
    load,
    second_motion,
    second_effort,
    following,
    command
  };
  static constexpr std::size_t kInputs = 7;
  void restart(double t_s);
  [[nodiscard]] double turn_wave(std::size_t n) const;
  [[nodiscard]] double difference(PairKind kind) const;
  void find_zero(double t_s);

  PairedColumns columns_;
  std::array<std::optional<std::size_t>, kInputs> column_;
  std::array<double, kInputs> scale_{};
  std::array<Travel, kInputs> travel_;
  std::array<double, kInputs> value_{}, base_{};
  std::array<bool, kInputs> is_count_{};
  std::array<bool, kInputs> known_{};
  std::array<FilteredSignal, kInputs> filtered_;
  FilteredSignal direction_;
  double unit_per_turn_ = 0;
  std::array<FilteredSignal, 4> turn_;
  ElastoplasticSign<double> sign_;
  PairSample sample_;
  bool started_ = false;
  double typical_s_ = 0, from_s_ = 0, last_motion_ = 0;
  // A command and a counter have zeros of their own: they are alike where the drive rests.
  std::optional<double> zero_;
  double resting_from_s_ = 0, resting_at_ = 0, resting_command_ = 0;
};

/// The expected difference, or the effort of the idling run.
struct PairTerms {
  double zero = 0, position = 0, velocity = 0, acceleration = 0, direction = 0, effort = 0,
         command_rate = 0;
  double low = 0, high = 0;  ///< range of positions; 0 and 0: no curve
  std::array<double, 4> curve{};

  static constexpr std::size_t kPlain = 7, kCurved = 13;
  [[nodiscard]] double at(const PairSample& sample) const;
  /// P_2 to P_5 at a position, that of the nearer end outside the range.
  [[nodiscard]] std::array<double, 4> polynomials(double at) const;
  /// As the machine file lists them: 7 numbers, 13 with a curve.
  [[nodiscard]] std::vector<double> list() const;
  /// Nothing for another count.
  static std::optional<PairTerms> from(const std::vector<double>& list);
};

struct PairWatchConfig {
  PairKind kind = PairKind::load;
  PairTerms terms;
  PairTerms idle_effort;
  double band = 0;          ///< m, rad, N or Nm
  double effort_limit = 0;  ///< of the first motor; 0: not known
};

class PairWatch {
 public:
  static constexpr double kHold_s = 0.05, kRelease_s = 1, kForget_s = 600;

  explicit PairWatch(const PairWatchConfig& config) : config_(config) {}

  enum class Change : std::uint8_t { none, beyond, within };
  /// `in_air`: nothing is cut for sure.
  Change process(const PairSample& sample, bool in_air);

  [[nodiscard]] const PairWatchConfig& config() const { return config_; }
  /// That was judged last, and what was allowed [m, rad, N or Nm].
  [[nodiscard]] double value() const { return value_; }
  [[nodiscard]] double allowed() const { return allowed_; }
  [[nodiscard]] double largest() const { return largest_; }
  [[nodiscard]] double watched_s() const { return watched_s_; }
  /// What is left of the difference, with its sign.
  [[nodiscard]] double residual() const { return residual_; }
  /// The effort beyond that of the idling run.
  [[nodiscard]] double disturbance() const { return disturbance_; }
  /// The effort was at its limit in the last kSaturated_s.
  [[nodiscard]] bool saturated() const { return last_t_s_ - saturated_s_ < kSaturated_s; }

 private:
  static constexpr double kSaturated_s = 0.1;
  [[nodiscard]] bool wanders() const {
    return config_.kind == PairKind::load || config_.kind == PairKind::skew;
  }
  void judge(double dt, bool in_air);

  PairWatchConfig config_;
  double value_ = 0, allowed_ = 0, residual_ = 0, disturbance_ = 0, largest_ = 0, watched_s_ = 0;
  double low_ = 0, high_ = 0;  // ends of the wandering
  double last_t_s_ = 0, saturated_s_ = -std::numeric_limits<double>::infinity();
  double beyond_s_ = 0, within_s_ = 0;
  bool started_ = false, is_beyond_ = false;
};

}  // namespace servosense
