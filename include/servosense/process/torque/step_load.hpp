// Torque, force, power and deflection of a step of the program.
#pragma once

#include <array>
#include <limits>

#include "servosense/io/machine_file.hpp"
#include "servosense/process/engagement/engagement.hpp"
#include "servosense/process/torque/tool_law.hpp"

namespace servosense::process {

/// Standard errors on either side that a band holds (95 % of a normal distribution).
inline constexpr double kBandErrors = 1.96;
inline constexpr std::size_t kToothHarmonics = 3;

/// Static compliance of the tool along x and y of the machine [m/N]: what the modes of
/// [structure.x] and [structure.y] add up to; NaN where there are none.
[[nodiscard]] std::array<double, 2> static_compliance(const MachineFile& machine);

struct StepConditions {
  double feed_per_tooth_m = 0;   ///< of a drill and a tap likewise, by their edges
  double spindle_rpm = 0;        ///< clockwise positive
  double stock_tolerance_m = 0;  ///< by which a surface of the stock may be off
  std::array<double, 2> compliance_m_per_N = {std::numeric_limits<double>::quiet_NaN(),
                                              std::numeric_limits<double>::quiet_NaN()};
};

/// NaN: not known. In air all is 0.
struct StepLoad {
  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  double torque_Nm = kUnknown;  ///< mean of a revolution
  double low_Nm = kUnknown, high_Nm = kUnknown;
  double peak_Nm = kUnknown;  ///< greatest of a revolution
  std::array<double, kToothHarmonics> harmonic_Nm = {kUnknown, kUnknown, kUnknown};
  double runout_Nm = kUnknown;  ///< amplitude once a revolution
  double power_W = kUnknown;
  /// On the tool, along x, y, z of the machine; means of a revolution.
  std::array<double, 3> force_N = {kUnknown, kUnknown, kUnknown};
  std::array<double, 3> least_force_N = {kUnknown, kUnknown, kUnknown};  ///< of a revolution
  std::array<double, 3> greatest_force_N = {kUnknown, kUnknown, kUnknown};
  /// Greatest of a revolution, of the static stiffness.
  std::array<double, 2> deflection_m = {kUnknown, kUnknown};
};

/// What a step removes over its path, and touches [m2].
struct StepAreas {
  double removed_m2 = 0, contact_m2 = 0;
};
[[nodiscard]] StepAreas step_areas(const Engagement& engagement);

/// Mean torque alone: cheap. A tap's is that of its thread (see the source).
[[nodiscard]] double mean_torque_Nm(const StepAreas& areas, const ToolLaw& law,
                                    double feed_per_tooth_m);

[[nodiscard]] StepLoad step_load(const Engagement& engagement, const ToolLaw& law,
                                 const StepConditions& conditions);

}  // namespace servosense::process
