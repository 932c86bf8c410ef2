// The regressors of an idling run: what the disturbance observer answers to each parameter, over
// the samples in motion.
#pragma once

#include "idle_regression.hpp"
#include "servosense/identify/idle.hpp"

namespace servosense::idle_fit {

/// Response of an observer to the record, with the motor's effort left out if `motion_only`.
Column response(const DisturbanceObserverConfig& config, const DriveRecord& record,
                bool motion_only);

/// What an observer reads while the drive moves and nothing is cut, and the least step that it
/// would tell from that.
DetectabilityFloor floor_of(const DisturbanceObserverConfig& observer, const DriveRecord& record,
                            double false_alarm_rate_per_hour);

/// At the cutoffs of `config`, which holds no inertia, friction and load. Rows are means over
/// blocks of a quarter of the filters' time constant.
class IdleDesign {
 public:
  /// Of a power over the speed rows weigh as the speed, which makes their errors those of the
  /// power, and `losses` has what is lost of it: a constant, and in the square of the torque.
  IdleDesign(const DisturbanceObserverConfig& config, const DriveRecord& record,
             const IdleOptions& options);

  Column output, inertia, viscous, load;
  std::vector<Column> losses;
  Column speed;  ///< of the rows, without weight
  [[nodiscard]] Column coulomb(double knee) const;
  /// What the effort is made of, with a Coulomb friction and the losses.
  [[nodiscard]] Columns columns(const Column& coulomb, bool with_load) const;
  /// What the observer reads of another effort, a value a sample, under the delays and the field
  /// weakening of `config` and no other effect.
  [[nodiscard]] Column reading(const Column& effort) const;
  /// Of the samples, as recorded.
  [[nodiscard]] Column efforts() const;
  /// Rate of change of the effort that `inertia` and `viscous` friction ask for: what an effort
  /// that acts a second after it is reported would add.
  [[nodiscard]] Column delay(double inertia, double viscous) const;

  /// Of the rows, of a value a sample.
  [[nodiscard]] Column mean_of(const Column& samples) const { return in_motion(samples); }

  [[nodiscard]] double motion_s() const;
  /// Rows over which residuals may be correlated.
  [[nodiscard]] std::size_t lag() const;
  /// Share of the rows that move forward.
  [[nodiscard]] double forward_share() const;

 private:
  void add_losses();
  [[nodiscard]] Column in_motion(const Column& all) const;
  [[nodiscard]] Column unit_response(double DriveModelConfig::*parameter, double knee) const;

  const DisturbanceObserverConfig config_;
  const DriveRecord& record_;
  std::size_t block_ = 1;
  std::vector<std::size_t> rows_;
  Column weights_;  // of the rows; empty: all alike
};

}  // namespace servosense::idle_fit
