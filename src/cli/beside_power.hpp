// A power or a load beside the current of a spindle, as the torque that it means.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servosense/hal/load_torque.hpp"
#include "servosense/io/travel.hpp"

namespace servosense::cli {

/// Which columns: those that would be the effort if there were no current. Nothing where they are
/// no power and no load, or what they are of is not known.
[[nodiscard]] std::optional<DriveColumns> columns_beside(const std::vector<Signal>& signals,
                                                         std::size_t current, Channel channel,
                                                         const ColumnChoice& choice);

/// Reads them from rows.
class BesidePower {
 public:
  /// `period_s` 0: that of the first rows, which are not heard then.
  BesidePower(const DriveColumns& columns, const ColumnChoice& choice, double period_s);

  struct Reading {
    double torque_Nm = 0, power_W = 0, speed_rad_s = 0;
    bool known = false;  ///< fast enough
  };
  /// Nothing where the row has no new value.
  std::optional<Reading> hear(const TraceRow& row);
  [[nodiscard]] const DriveColumns& columns() const { return columns_; }
  /// Noise of the torque [Nm] at a torque and a speed, of that of the column [W or Nm].
  [[nodiscard]] double noise_Nm(double noise, double torque_Nm, double speed_rad_s) const;

 private:
  DriveColumns columns_;
  double unit_per_count_;
  double period_s_;
  double first_s_ = 0;
  std::vector<double> times_s_;  // since the first, until they tell the period
  Travel travel_;
  LoadTorque load_;
};

}  // namespace servosense::cli
