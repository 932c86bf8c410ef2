// Torque or force per ampere over the motor's temperature: magnets weaken as they warm.
//   kt(T) = kt (1 + per_K (T - at_C))
// per_K is -0.0009 to -0.0012 1/K of NdFeB magnets, -0.0003 to -0.0005 of SmCo, -0.002 of ferrite
// (magnet makers' data sheets, temperature coefficient of the remanence).
#pragma once

namespace servosense {

struct ConstantOverTemperature {
  double per_K = 0;  ///< 1/K, of the constant at `at_C`; 0: the same at every temperature
  double at_C = 20;  ///< where the constant is as stated
  /// The constant over the stated one.
  [[nodiscard]] constexpr double ratio(double temperature_C) const {
    return 1 + per_K * (temperature_C - at_C);
  }
};

}  // namespace servosense
