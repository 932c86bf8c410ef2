// Motion and effort of a drive, smoothed, thinned out and differentiated, and the response of any
// effect to that motion.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "reconcile/numerics/smoother.hpp"
#include "servosense/model/drive_model.hpp"
#include "servosense/reconcile/drive.hpp"

namespace servosense::reconcile {

/// How finely an effect is driven by the motion, where there is a choice.
enum class Rate { working, path };

/// Signals at two rates: the working rate, at which effects are driven by the motion, and the rate
/// of the rows, at which columns are compared.
class DriveSignals {
 public:
  DriveSignals(const DriveData& data, double corner_hz);

  [[nodiscard]] std::size_t rows() const { return (position.size() + stride_ - 1) / stride_; }
  [[nodiscard]] double row_period_s() const { return work_period_s * static_cast<double>(stride_); }
  /// Filtered and thinned out to rows.
  [[nodiscard]] Column to_rows(const Column& work, int derivative = 0) const {
    return rows_.apply(work, derivative, stride_);
  }
  /// The same for what is no linear function of signals at the working rate: those have been
  /// through a filter on their way there already.
  [[nodiscard]] Column driven_to_rows(const Column& work, int derivative = 0) const {
    return driven_.apply(work, derivative, stride_);
  }
  /// Any signal of the record's rate, brought to the working rate.
  [[nodiscard]] Column to_work(const Column& samples) const {
    return first_.apply(samples, 0, first_stride_);
  }
  /// Takes an eccentric encoder's error A sin(theta + phase) of the true angle out of the motion,
  /// so that whatever the true motion drives is driven by it. What the drive reports of its
  /// acceleration and velocity (`reported_...`) stays. `amplitude`: m or rad of the position;
  /// steeper than a turn can be inverted is refused. From the motion as recorded, however often.
  bool correct_angle(double amplitude, double phase_rad, double unit_per_turn);
  /// Sign of motion with a given presliding distance, working rate.
  [[nodiscard]] Column direction(double presliding) const;
  /// The same in rows, driven along the record itself: within the presliding distance friction is
  /// no linear function of the motion, and a drive stops or swings there faster than the working
  /// rate shows.
  [[nodiscard]] Column direction_rows(double presliding) const;
  /// The same for a bristle (Dahl 1968, exponent 1) that takes so much travel.
  [[nodiscard]] Column bristle_rows(double travel) const;
  /// Sign of motion of a friction that swings over with the speed, tanh(v / `speed`), in rows.
  [[nodiscard]] Column speed_direction_rows(double speed) const;
  /// `law(increment, seconds, place)` along the path of the record, between samples too, in rows;
  /// places are those of the working rate.
  /// `settled(way, cell)`: what a law keeps on answering while the path goes one way, 1 or -1,
  /// between two samples of the working rate, and has nothing to learn from; none while it is on
  /// the move.
  template <typename Law, typename Settled>
  [[nodiscard]] Column along_path(Law law, Settled settled) const;
  /// The steps of that.
  [[nodiscard]] double path_step_s() const;
  /// Damping of the bristles of friction while they bend, of unit size, in rows.
  [[nodiscard]] Column bristle_damping(const DriveModelConfig& drive) const;
  /// The three of a presliding distance, as often as they are asked for: the last few are kept.
  const Column& kept_direction_rows(double presliding) {
    return kept({0, presliding}, [&] { return direction_rows(presliding); });
  }
  const Column& kept_bristle_rows(double travel) {
    return kept({1, travel}, [&] { return bristle_rows(travel); });
  }
  const Column& kept_bristle_damping(const DriveModelConfig& drive) {
    return kept({2, drive.friction_knee, drive.inertia, drive.coulomb},
                [&] { return bristle_damping(drive); });
  }
  /// What an effect adds to the required effort, in rows. `drive` gives inertia and friction.
  /// `coupling`: the spring that backlash is in series with; without it, its own. At the working
  /// rate a load that rubs is some per cent off, and ten times as fast.
  [[nodiscard]] Column response(const EffectSetting& setting, const DriveModelConfig& drive,
                                const EffectSetting* coupling = nullptr,
                                Rate rate = Rate::path) const;
  /// Share of the usable rows at places that are passed twice or more: where nothing is, a function
  /// of position cannot be told from one of time.
  [[nodiscard]] double share_passed_again() const;
  /// Effort that acted `delay_s` earlier than it was reported late, in rows.
  [[nodiscard]] Column effort_rows(double delay_s) const;

  double corner_hz;
  double presliding_speed =
      0;  ///< of a friction that swings over with the speed; 0: with the travel
  double work_period_s = 0;
  Column time_s, position, velocity, increment, effort, turn_angle;  ///< working rate
  Column smooth_velocity, smooth_acceleration;                       ///< working rate, row filter
  std::vector<bool> faulty, resting;                                 ///< working rate
  std::vector<bool> usable;                                          ///< rows
  Column acceleration_rows, velocity_rows, position_rows;
  Column reported_acceleration, reported_velocity;  ///< rows; with an eccentric encoder's error

 private:
  void differentiate();
  void find_ways();
  void mark_faulty(const DriveData& data);
  void mark_resting(double presliding);
  void mark_usable();
  struct Kept {
    std::array<double, 4> of;  // which column, and all that it is made of beside the path
    Column column;
  };
  template <typename Make>
  const Column& kept(std::array<double, 4> of, Make make) {
    constexpr std::size_t kMost = 5;  // of one presliding distance
    auto found =
        std::find_if(kept_.begin(), kept_.end(), [&](const Kept& k) { return k.of == of; });
    if (found == kept_.end()) {
      if (kept_.size() == kMost) kept_.erase(kept_.begin());
      found = kept_.insert(kept_.end(), {of, make()});
    }
    return found->column;
  }

  std::size_t first_stride_ = 1, stride_ = 1;
  Smoother first_, rows_, driven_;
  double sample_period_s_ = 0;
  Column path_;  // positions of the record, its steps smoothed
  std::vector<Kept> kept_;
  std::vector<signed char> ways_;  // of all steps up to each sample: 1 or -1; 0: some of both
  // Before any correction: of the record, and at the working rate.
  Column recorded_path_, recorded_position_, recorded_angle_;
};

}  // namespace servosense::reconcile
