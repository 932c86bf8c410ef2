// How torque per ampere goes with the motor's temperature, seen in an idling run.
//
// The torque of inertia is the reference, whatever the temperature:
//   u (1 + a (T - T_ref)) = J dv/dt + (D + D' (T - T_ref)) v + (C + C' (T - T_ref)) sgn v + load
// u the current times its constant at T_ref. Friction may go with the temperature as it likes
// (D', C'), which leaves the change of the torque that accelerates to tell a. The noise of the
// current is kept out of it: u stands on the right as the fitted motion says it (instrumental
// variables, Reiersol 1945).
// Bad at: an inertia that changes between the temperatures (another tool).
#pragma once

#include <optional>
#include <string>

#include "servosense/identify/idle.hpp"
#include "servosense/io/motor_temperature.hpp"

namespace servosense {

struct SeenConstantOverTemperature {
  /// 1/K of the constant at the temperature where it is as stated; nothing where the record does
  /// not tell it, or tells that there is none.
  std::optional<Estimate> per_K;
  double lowest_C = 0, highest_C = 0;  ///< of the motor where it accelerates
  std::string refusal;                 ///< a sentence on what the record lacks; empty: it tells
};

/// `drive`: as identified, with what the machine file and the record say of its torque constant;
/// its inertia and friction are fitted anew. `record`: with temperatures, its effort as at `at_C`
/// throughout. Samples before the first temperature are left out.
[[nodiscard]] SeenConstantOverTemperature find_constant_over_temperature(
    const DisturbanceObserverConfig& drive, const DriveRecord& record,
    const IdleIdentification& found, double at_C, const IdleOptions& options = {});

/// identify_idle() of a drive whose constant goes with temperature: `constant`, as stated, gets
/// what the record tells of it, and the effort of `record`, as at its `at_C` throughout, is scaled
/// by it.
[[nodiscard]] Expected<IdleIdentification> identify_idle_over_temperature(
    const DisturbanceObserverConfig& base, DriveRecord& record, ConstantOverTemperature& constant,
    SeenConstantOverTemperature& seen, const IdleOptions& options = {}, IdleRefusal* why = nullptr);

/// The effort of every sample as it acts at the temperature of the motor.
void scale_by_temperature(DriveRecord& record, const ConstantOverTemperature& constant);

}  // namespace servosense
