// What the noise is that chatter lines stand in (chatter_lines.hpp), from the drive of the spindle.
#pragma once

#include "servosense/core/drive_input.hpp"
#include "servosense/core/units.hpp"
#include "servosense/monitors/chatter_config.hpp"

namespace servosense {

/// Fills what `lines` wants to know besides its threshold. Nothing is filled, and none is heard,
/// where the noise is not known, because the motion does not come from a counter, or where it is
/// not known what a cut is: in the air a counter at constant speed has lines.
template <typename SpindleSlotConfig>
void tell_noise(SpindleSlotConfig& slot) noexcept {
  ChatterLinesConfig& lines = slot.chatter.lines;
  const double count =
      slot.input.unit_per_count < 0 ? -slot.input.unit_per_count : slot.input.unit_per_count;
  if (slot.input.kind != MotionKind::counts || !(count > 0) ||
      !(slot.chatter.cutting_torque_Nm > 0)) {
    lines.inertia_kg_m2 = lines.counts_per_turn = 0;
    return;
  }
  lines.inertia_kg_m2 = slot.monitor_observer.drive.inertia;
  lines.counts_per_turn = kTwoPi / count;
  lines.disturbance_cutoff_rad_s = slot.monitor_observer.disturbance_cutoff_rad_s;
  lines.velocity_cutoff_rad_s = slot.monitor_observer.velocity_cutoff_rad_s;
}

}  // namespace servosense
