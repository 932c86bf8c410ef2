// The temperature of a motor in a trace, and what was missing of it.
#pragma once

#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "servosense/core/channel.hpp"
#include "servosense/core/constant_over_temperature.hpp"

namespace servosense {

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
