#include "servosense/io/quantity_range.hpp"

#include "servosense/core/plausible.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

QuantityRange range_of(Quantity quantity) {
  const auto both = [](double greatest, const char* kind, const char* source) {
    return QuantityRange{-greatest, greatest, kind, source};
  };
  constexpr const char* kConvention = "convention";
  constexpr const char* kMakers = "stated by makers";
  constexpr const char* kPlausible = "core/plausible.hpp";
  switch (quantity) {
    case Quantity::speed_rad_s:
      return both(kImpossibleSpeed_rad_s, kConvention, kPlausible);
    case Quantity::position_m:
    case Quantity::command_position_m:
      return both(kImpossibleTravel_m, kConvention, kPlausible);
    case Quantity::velocity_m_s:
    case Quantity::command_velocity_m_s:
      return both(kImpossibleVelocity_m_s, kConvention, kPlausible);
    case Quantity::acceleration_m_s2:
    case Quantity::acceleration_x_m_s2:
    case Quantity::acceleration_y_m_s2:
      // Accelerometers on tools and housings read beyond what axes do: 5000 g sensors.
      return both(5e4, kMakers, "range of shock accelerometers");
    case Quantity::sound_Pa:
      return both(1e4, kMakers, "range of pressure microphones, 170 dB");
    case Quantity::displacement_m:
    case Quantity::displacement_x_m:
    case Quantity::displacement_y_m:
      return both(0.1, kMakers, "range of displacement sensors at tools");
    case Quantity::following_error_m:
      return both(1, kConvention, "drives stop at a following error of some millimetres");
    case Quantity::following_error_rad:
      return both(kTwoPi, kConvention, "drives stop at a following error of some degrees");
    case Quantity::current_A:
    case Quantity::command_current_A:
      return both(kImpossibleCurrent_A, kConvention, kPlausible);
    case Quantity::torque_Nm:
    case Quantity::torque_band_Nm:
    case Quantity::command_torque_Nm:
      return both(kImpossibleTorque_Nm, kConvention, kPlausible);
    case Quantity::force_N:
    case Quantity::force_x_N:
    case Quantity::force_y_N:
    case Quantity::force_z_N:
    case Quantity::force_band_N:
      return both(kImpossibleForce_N, kConvention, kPlausible);
    case Quantity::power_W:
      return both(1e6, kMakers, "main drives of the largest lathes and mills, 300 kW, and braking");
    case Quantity::load_V:
      return both(20, kMakers, "load meter outputs, 0 to 10 V");
    case Quantity::load_percent:
    case Quantity::torque_percent:
    case Quantity::command_torque_percent:
    case Quantity::current_percent:
      return both(1000, kMakers, "servo motors, peak of five times the rated torque, with reserve");
    case Quantity::voltage_V:
      return both(2000, kMakers, "DC links of 690 V drives, 1100 V");
    case Quantity::temperature_C:
      return {-60, 400, kMakers, "winding sensors, up to 250 degrees"};
    case Quantity::feed_override:
      return {0, 5, kMakers, "override switches, 0 to 200 %"};
    case Quantity::feed_per_tooth_m:
      return {0, 0.01, kConvention, "no insert cuts 10 mm a tooth"};
    case Quantity::nc_block:
      return {-1, 1e9, kConvention, "line numbers of NC programs"};
    case Quantity::angle_rad:
    case Quantity::command_angle_rad:
      return both(1e9, kConvention, "60 000 rpm for two days");
    case Quantity::angle_counts:
      return both(0x1p63, kConvention, "a counter of 64 bits");
  }
  return both(0, "", "");
}

}  // namespace servosense
