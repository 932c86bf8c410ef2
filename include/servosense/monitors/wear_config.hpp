// What the wear monitor (wear.hpp) is set to.
#pragma once

#include <cstddef>

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"

namespace servosense {

/// Holes of a tool that are remembered.
inline constexpr std::size_t kWearHolesKept = 16;

struct WearConfig {
  double sample_period_s = 125e-6;
  double part_s = 0.01;     ///< signals are averaged over so long
  int feed_direction = -1;  ///< of the axis, into the workpiece: -1 or +1; 0 = passes both ways
  // What a cut is.
  double cutting_thrust_N = 0;      ///< 0 = thrust does not say whether there is a cut
  double cutting_torque_Nm = 0;     ///< 0 = torque does not
  double release_fraction = 0.5;    ///< a cut ends below this fraction of both
  double maximum_feed_m_s = 0.1;    ///< faster moves are rapids and never cut
  double minimum_speed_rad_s = 10;  ///< slower than this the spindle does not cut
  double steady_fraction = 0.02;    ///< of the speed, between parts, that counts as steady
  /// Of the feed axis and of the spindle; 0 = not known. With them a speed is steady, too, while
  /// its change takes less than half of the cutting thrust or torque.
  double equivalent_mass_kg = 0;
  double inertia_kg_m2 = 0;
  double entry_m = 3e-3;      ///< of a cut, not counted: drill point, chamfer of a tap
  double exit_m = 3e-3;       ///< of a cut, not counted: break-through
  double shortest_m = 3e-3;   ///< that has to remain
  double clearance_m = 2e-3;  ///< of a stroke at feed, at least, lies before the workpiece
  double peck_window_s = 0;   ///< cuts that go on at the bottom within this are one hole
  // The rules. 0 = none.
  double thrust_limit_N = 0;
  double thrust_step_N = 0;
  double thrust_ratio = 0;  ///< of the taught thrust
  double torque_limit_Nm = 0;
  double torque_step_Nm = 0;
  double torque_ratio = 0;          ///< of the taught torque
  double specific_force_ratio = 0;  ///< of the taught specific cutting force (hear_cutting())
  /// Of a limit, and of the way from 1, a sound tool, to a ratio; a step has no warning.
  double warning_fraction = 0.75;
  unsigned teach_holes = 10;   ///< 2 or more
  unsigned average_holes = 3;  ///< that make the level; the source takes ten without wear
  unsigned confirm_holes = 2;  ///< that have to agree on a step
  // How far friction may be off; random walk, constant + direction + speed.
  double friction_error_N = 100;  ///< at the start, each of the three (at rapid)
  double friction_drift_N = 3.2;  ///< in 1 s: 55 N in 300 s
  double friction_noise_N = 10;   ///< of a part in the air, at feed
  double rapid_m_s = 0.83;
  double spindle_error_Nm = 0.1;
  double spindle_drift_Nm = 0.003;
  double spindle_noise_Nm = 0.02;
  double top_speed_rad_s = 1000;
  double tolerated_stand_ins = 0.25;  ///< of a part

  // The source's tools (Koike 2016, section 4.3). Cutting levels and lengths are not the source's:
  // a third of what a new tool takes, half to one diameter.
  static WearConfig drill_6mm() noexcept {
    WearConfig c;
    c.cutting_thrust_N = 120;
    c.thrust_limit_N = 800;
    c.thrust_step_N = 100;
    return c;
  }
  static WearConfig drill_3mm() noexcept {
    WearConfig c;
    c.cutting_thrust_N = 50;
    c.thrust_limit_N = 330;
    c.thrust_step_N = 40;
    c.entry_m = c.exit_m = c.shortest_m = 2e-3;
    return c;
  }
  static WearConfig tap_m6() noexcept {
    WearConfig c;
    c.cutting_torque_Nm = 0.25;
    c.torque_limit_Nm = 2.5;
    c.torque_ratio = 3;
    return c;
  }
  static WearConfig tap_m3() noexcept {
    WearConfig c;
    c.cutting_torque_Nm = 0.06;
    c.torque_ratio = 3;
    c.entry_m = c.exit_m = c.shortest_m = 1.5e-3;
    return c;
  }
};

/// Whether a rule of holes is on.
[[nodiscard]] inline bool judges_holes(const WearConfig& c) noexcept {
  return c.thrust_limit_N > 0 || c.thrust_step_N > 0 || c.thrust_ratio > 0 ||
         c.torque_limit_Nm > 0 || c.torque_step_Nm > 0 || c.torque_ratio > 0;
}

/// Names the setting that is out of range, and the range.
[[nodiscard]] inline Status validate(const WearConfig& c) noexcept {
  if (!(c.sample_period_s > 0 && c.sample_period_s <= 0.1))
    return Status::invalid("sample_period_s", "must be positive, 0.1 s at most");
  if (!(c.part_s >= 7.5 * c.sample_period_s && c.part_s <= 10))
    return Status::invalid("part_s", "must be within 8 samples and 10 s");
  if (c.feed_direction < -1 || c.feed_direction > 1)
    return Status::invalid("feed_direction", "must be -1, 0 or 1");
  struct Number {
    const char* name;
    double value;
    bool positive;
  };
  const Number numbers[] = {{"cutting_thrust_N", c.cutting_thrust_N, false},
                            {"cutting_torque_Nm", c.cutting_torque_Nm, false},
                            {"maximum_feed_m_s", c.maximum_feed_m_s, true},
                            {"minimum_speed_rad_s", c.minimum_speed_rad_s, true},
                            {"steady_fraction", c.steady_fraction, true},
                            {"equivalent_mass_kg", c.equivalent_mass_kg, false},
                            {"inertia_kg_m2", c.inertia_kg_m2, false},
                            {"entry_m", c.entry_m, false},
                            {"exit_m", c.exit_m, false},
                            {"shortest_m", c.shortest_m, false},
                            {"clearance_m", c.clearance_m, false},
                            {"peck_window_s", c.peck_window_s, false},
                            {"thrust_limit_N", c.thrust_limit_N, false},
                            {"thrust_step_N", c.thrust_step_N, false},
                            {"torque_limit_Nm", c.torque_limit_Nm, false},
                            {"torque_step_Nm", c.torque_step_Nm, false},
                            {"friction_error_N", c.friction_error_N, false},
                            {"friction_drift_N", c.friction_drift_N, false},
                            {"friction_noise_N", c.friction_noise_N, true},
                            {"rapid_m_s", c.rapid_m_s, true},
                            {"spindle_error_Nm", c.spindle_error_Nm, false},
                            {"spindle_drift_Nm", c.spindle_drift_Nm, false},
                            {"spindle_noise_Nm", c.spindle_noise_Nm, true},
                            {"top_speed_rad_s", c.top_speed_rad_s, true}};
  for (const Number& n : numbers) {
    if (n.positive && !(n.value > 0 && n.value < 1e9))
      return Status::invalid(n.name, "must be positive, below 1e9");
    if (!(n.value >= 0 && n.value < 1e9))
      return Status::invalid(n.name, "must be zero or positive, below 1e9");
  }
  const bool milling = c.specific_force_ratio > 0 && !judges_holes(c);
  if (!(milling || c.cutting_thrust_N > 0 || c.cutting_torque_Nm > 0))
    return Status::invalid("cutting_thrust_N",
                           "must be set, or cutting_torque_Nm, to know when the tool cuts");
  if (!(c.release_fraction > 0 && c.release_fraction <= 1))
    return Status::invalid("release_fraction", "must be within 0 and 1");
  if (!(c.thrust_ratio == 0 || (c.thrust_ratio > 1 && is_finite(c.thrust_ratio))))
    return Status::invalid("thrust_ratio", "must be zero (none) or more than 1");
  if (!(c.torque_ratio == 0 || (c.torque_ratio > 1 && is_finite(c.torque_ratio))))
    return Status::invalid("torque_ratio", "must be zero (none) or more than 1");
  if (!(c.specific_force_ratio == 0 ||
        (c.specific_force_ratio > 1 && is_finite(c.specific_force_ratio))))
    return Status::invalid("specific_force_ratio", "must be zero (none) or more than 1");
  if (!(c.warning_fraction > 0 && c.warning_fraction <= 1))
    return Status::invalid("warning_fraction", "must be within 0 and 1");
  if (c.teach_holes < 2 || c.teach_holes > 10000)
    return Status::invalid("teach_holes", "must be within 2 and 10000");
  if (c.average_holes < 1 || c.average_holes > kWearHolesKept)
    return Status::invalid("average_holes", "must be within 1 and 16");
  if (c.confirm_holes < 1 || c.confirm_holes > kWearHolesKept - 3)
    return Status::invalid("confirm_holes", "must be within 1 and 13");
  if (!(c.tolerated_stand_ins >= 0 && c.tolerated_stand_ins < 1))
    return Status::invalid("tolerated_stand_ins", "must be at least 0 and below 1");
  return {};
}

}  // namespace servosense
