// Torque or force per ampere over the motor's temperature: magnets weaken as they warm.
//   kt(T) = kt (1 + per_K (T - at_C))
// per_K is -0.0009 to -0.0012 1/K of NdFeB magnets, -0.0003 to -0.0005 of SmCo, -0.002 of ferrite
// (magnet makers' data sheets, temperature coefficient of the remanence).
#pragma once

#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "servosense/core/channel.hpp"

namespace servosense {

struct ConstantOverTemperature {
  double per_K = 0;  ///< 1/K, of the constant at `at_C`; 0: the same at every temperature
  double at_C = 20;  ///< where the constant is as stated
  /// The constant over the stated one.
  [[nodiscard]] constexpr double ratio(double temperature_C) const {
    return 1 + per_K * (temperature_C - at_C);
  }
};

/// The temperature of a motor as its column tells it: held until there is another value.
class MotorTemperature {
 public:
  /// A new value, or none, at a time.
  void hear(std::optional<double> temperature_C, double t_s) {
    if (first_row_s_ > t_s) first_row_s_ = t_s;
    if (temperature_C) {
      if (!known()) first_s_ = t_s;
      if (known() && t_s - last_s_ > longest_s_) longest_s_ = t_s - last_s_;
      temperature_C_ = *temperature_C;
      last_s_ = t_s;
    }
    now_s_ = t_s;
  }
  [[nodiscard]] bool known() const { return std::isfinite(temperature_C_); }
  /// The last value; NaN before the first.
  [[nodiscard]] double last_C() const { return temperature_C_; }
  /// What was missing of it, a sentence for a reader; empty where nothing was.
  [[nodiscard]] std::string missing(Channel drive, double at_C) const;

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();
  double temperature_C_ = std::numeric_limits<double>::quiet_NaN();
  double first_row_s_ = kNever, first_s_ = kNever, last_s_ = 0, now_s_ = 0, longest_s_ = 0;
};

}  // namespace servosense
