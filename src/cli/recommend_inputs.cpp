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

/// Of a tool whose radial ratio nobody has measured (Dunwoody 2010, section 6.3).
constexpr double kUsualRadialRatio = 0.3;
/// Deepest cut where the file knows no limit, in diameters (chosen: side milling goes no deeper).
constexpr double kDeepest_diameters = 2;

std::string share_text(double share) { return printed(100 * share, 3) + " %"; }

Expected<std::vector<std::array<double, 3>>> mode_errors(const MachineFile& machine,
                                                         const char* section, std::size_t modes,
                                                         RecommendInputs& inputs) {
  std::vector<std::array<double, 3>> errors(modes, typical_error::kMode);
  if (modes == 0) return errors;
  const auto stated = machine.triples(section, "modes_relative_error");
  if (stated && stated->size() != modes)
    return data_error(machine.where(section, "modes_relative_error") + ": [" + section + "] has " +
                      std::to_string(modes) + " modes and " + std::to_string(stated->size()) +
                      " triples of their errors; give one triple a mode");
  if (stated) errors = *stated;
  constexpr std::array<const char*, 3> kOf = {"frequency", "damping ratio", "mass"};
  for (std::size_t m = 0; m < modes; ++m)
    for (std::size_t k = 0; k < 3; ++k)
      inputs.errors.push_back(
          {std::string(kOf[k]) + " of mode " + std::to_string(m + 1) + " of " + section,
           errors[m][k], stated.has_value(),
           stated ? "modes_relative_error"
                  : "typical: a hand-held hammer, tool taken out and put back"});
  if (!stated)
    inputs.remarks.push_back("[" + std::string(section) +
                             "] states no modes_relative_error: frequency is taken as known to " +
                             share_text(typical_error::kMode[0]) + ", damping to " +
                             share_text(typical_error::kMode[1]) + ", mass to " +
                             share_text(typical_error::kMode[2]) +
                             "; 'servosense identify modes' writes what hits tell");
  return errors;
}

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
  if (tool->force.radial_ratio == 0) {
    tool->force.radial_ratio = kUsualRadialRatio;
    inputs.remarks.push_back("the radial ratio is not known: " + printed(kUsualRadialRatio) +
                             " is taken, as is usual");
  }
  CutErrors errors;
  const auto tangential = machine.number("tool", "tangential_coefficient_relative_error");
  if (tangential)
    errors.tangential = std::abs(*tangential);
  else
    inputs.remarks.push_back(
        "[tool] states no tangential_coefficient_relative_error: it is taken "
        "as known to " +
        share_text(typical_error::kTangential) +
        "; 'servosense identify cutting' writes what cuts tell");
  inputs.errors.push_back({"tangential coefficient", errors.tangential, tangential.has_value(),
                           tangential ? "tangential_coefficient_relative_error"
                                      : "typical: Dunwoody 2010, eq. 3.20 and 3.22"});
  inputs.errors.push_back({"radial ratio (absolute)", errors.radial_ratio, false,
                           "typical: Dunwoody 2010, section 6.3, 0.25 to 0.5"});
  if (machine.has("tool", "runout_m") || machine.has("tool", "throw_m")) {
    errors.offset_m = 0;
  } else {
    inputs.remarks.push_back("[tool] states no run-out: an offset of " +
                             printed(1e6 * errors.offset_m, 2) +
                             " um in each direction is reckoned with");
    inputs.errors.push_back({"offset of the tool axis [m]", errors.offset_m, false,
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
      inputs.remarks.push_back(
          "there are no modes: one in each direction is believed in, its frequency, damping and "
          "stiffness nearly unknown; cuts (--cuts) or a hammer test ('servosense identify impact') "
          "tell more");
      return UncertainCut::without_structure(*tool, *cut, errors);
    }
    for (const char* section : {"structure.x", "structure.y"})
      if (machine.has(section, "frf"))
        return data_error(machine.where(section, "frf") +
                          ": a receptance does not say how well modes are known; fit them by "
                          "'servosense identify modes' and give modes");
    auto structure = structure_modes(machine);
    if (!structure) return structure.error();
    for (const bool along_x : {true, false}) {
      const auto& modes = along_x ? structure->x : structure->y;
      const char* section = along_x ? "structure.x" : "structure.y";
      auto of = mode_errors(machine, section, modes.size(), inputs);
      if (!of) return of.error();
      (along_x ? errors.x : errors.y) = std::move(*of);
      if (modes.empty())
        inputs.remarks.push_back("[" + std::string(section) +
                                 "] has no modes: the tool is taken as rigid there");
    }
    return UncertainCut::create(*structure, *tool, *cut, errors);
  }();
  if (!uncertain) return uncertain.error();
  inputs.cut = std::move(*uncertain);
  auto limits = limits_of(machine, *tool, *cut, inputs.remarks);
  if (!limits) return limits.error();
  inputs.limits = *limits;
  return inputs;
}

}  // namespace servosense::cli
