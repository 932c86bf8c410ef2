#include "recommend_inputs.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "chart_tool.hpp"
#include "servosense/io/text.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense::cli {
namespace {

/// Deepest cut where the file knows no limit, in diameters (chosen: side milling goes no deeper).
constexpr double kDeepest_diameters = 2;

Expected<CutLimits> limits_of(const MachineFile& machine, const MillingTool& tool,
                              const MillingCut& cut, std::vector<std::string>& remarks) {
  CutLimits limits;
  const auto number = [&](const char* key) { return machine.number("limits", key); };
  if (const auto pair = machine.pairs("limits", "spindle_speed_rpm")) {
    limits.least_rpm = (*pair)[0][0];
    limits.greatest_rpm = (*pair)[0][1];
    if (!(limits.greatest_rpm >= limits.least_rpm) || !(limits.greatest_rpm > 0))
      return data_error(machine.where("limits", "spindle_speed_rpm") +
                        ": [limits] spindle_speed_rpm takes the least and the greatest speed, in "
                        "this order");
    // What turns slower cuts no lobes.
    limits.least_rpm = std::max(limits.least_rpm, 0.05 * limits.greatest_rpm);
  } else {
    limits.least_rpm = 0.5 * cut.spindle_speed_rpm;
    limits.greatest_rpm = 1.5 * cut.spindle_speed_rpm;
    remarks.push_back(
        "no [limits] spindle_speed_rpm: speeds from half to one and a half times "
        "that of [cut] are looked at");
  }
  if (const auto speed = machine.pairs("tool", "cutting_speed_m_s")) {
    const double rpm = 60 / (kTwoPi * tool.radius_m());
    limits.least_rpm = std::max(limits.least_rpm, speed->front()[0] * rpm);
    limits.greatest_rpm = std::min(limits.greatest_rpm, speed->front()[1] * rpm);
    if (!(limits.greatest_rpm >= limits.least_rpm))
      return data_error(machine.where("tool", "cutting_speed_m_s") +
                        ": [tool] cutting_speed_m_s leaves no speed within " +
                        (machine.has("limits", "spindle_speed_rpm")
                             ? "[limits] spindle_speed_rpm"
                             : "half to one and a half times that of [cut]"));
  }
  limits.feed_per_tooth_m = number("feed_per_tooth_m").value_or(cut.feed_per_tooth_m);
  if (!number("feed_per_tooth_m"))
    remarks.push_back("no [limits] feed_per_tooth_m: that of [cut] is the greatest");
  if (const auto depth = number("axial_depth_m")) {
    limits.axial_depth_m = *depth;
  } else if (const auto flute = machine.number("tool", "flute_length_m")) {
    limits.axial_depth_m = *flute;
  } else {
    limits.axial_depth_m = kDeepest_diameters * tool.diameter_m;
    remarks.push_back(
        "neither [limits] axial_depth_m nor [tool] flute_length_m: cuts of up to two "
        "diameters are looked at");
  }
  limits.torque_Nm = number("torque_Nm").value_or(CutLimits::kNone);
  limits.power_W = number("power_W").value_or(CutLimits::kNone);
  limits.deflection_m = number("deflection_m").value_or(CutLimits::kNone);
  if (!number("power_W"))
    if (const auto rated = machine.number("spindle", "rated_power_W")) {
      limits.power_W = *rated;
      remarks.push_back("no [limits] power_W: [spindle] rated_power_W is the limit");
    }
  if (!std::isfinite(std::min(limits.torque_Nm, limits.power_W)))
    remarks.push_back("neither torque nor power is limited: give [limits] torque_Nm and power_W");
  return limits;
}

}  // namespace

Expected<RecommendInputs> recommend_inputs(const MachineFile& machine) {
  RecommendInputs inputs;
  auto tool = milling_tool(machine);
  if (!tool) return tool.error();
  auto cut = milling_cut(machine);
  if (!cut) return cut.error();
  if (auto known = chart_knows(*tool, *cut, inputs.remarks); !known) return known.error();
  CutErrorsKnown known = tool_errors(machine, "tool", *tool);
  if (machine.has("tool", "runout_m") || machine.has("tool", "throw_m")) {
    known.errors.offset_m = 0;
  } else {
    known.remarks.push_back("[tool] states no run-out: an offset of " +
                            printed(1e6 * known.errors.offset_m, 2) +
                            " um in each direction is reckoned with");
    known.sources.push_back({"offset of the tool axis [m]", known.errors.offset_m, false,
                             "typical: collets of the common class"});
  }
  const bool any = [&] {
    for (const char* section : {"structure.x", "structure.y"})
      for (const char* key : {"modes", "frf"})
        if (machine.has(section, key)) return true;
    return false;
  }();
  Expected<UncertainCut> uncertain = [&]() -> Expected<UncertainCut> {
    if (!any) {
      known.remarks.push_back(
          "there are no modes: one in each direction is believed in, its frequency, damping and "
          "stiffness nearly unknown; cuts (--cuts) or a hammer test ('servosense identify impact') "
          "tell more");
      return UncertainCut::without_structure(*tool, *cut, known.errors);
    }
    auto structure = structure_with_errors(machine);
    if (!structure) return structure.error();
    if (auto done = add_mode_errors(machine, *structure, known); !done) return done.error();
    return UncertainCut::create(*structure, *tool, *cut, known.errors);
  }();
  if (!uncertain) return uncertain.error();
  inputs.cut = std::move(*uncertain);
  inputs.errors = std::move(known.sources);
  inputs.remarks.insert(inputs.remarks.end(), known.remarks.begin(), known.remarks.end());
  auto limits = limits_of(machine, *tool, *cut, inputs.remarks);
  if (!limits) return limits.error();
  inputs.limits = *limits;
  return inputs;
}

}  // namespace servosense::cli
