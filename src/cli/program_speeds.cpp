#include "program_speeds.hpp"

#include <algorithm>
#include <utility>

#include "cut_errors.hpp"
#include "servosense/identify/stable_cuts.hpp"
#include "servosense/process/tool/machine_tools.hpp"

namespace servosense::cli {
namespace {

/// Errors of a range that is one of speeds.
Expected<Done> in_order(const MachineFile& machine, const std::string& section, const char* key,
                        const std::array<double, 2>& range) {
  if (range[1] >= range[0] && range[1] > 0) return Done{};
  return data_error(machine.where(section, key) + ": [" + section + "] " + key +
                    " takes the least and the greatest speed, in this order");
}

}  // namespace

Expected<ProgramSpeeds> ProgramSpeeds::of(const MachineFile& machine, const std::vector<int>& tools,
                                          const ProgramLoads& loads) {
  ProgramSpeeds speeds;
  for (const int tool : tools) {
    const std::string section = process::tool_section(machine, tool);
    const auto range = machine.pairs(section, "cutting_speed_m_s");
    if (!range) continue;
    if (const auto fine = in_order(machine, section, "cutting_speed_m_s", range->front()); !fine)
      return fine.error();
    speeds.cutting_speed_[tool] = range->front();
  }
  if (!speeds.asked()) return speeds;
  if (const auto range = machine.pairs("limits", "spindle_speed_rpm")) {
    if (const auto fine = in_order(machine, "limits", "spindle_speed_rpm", range->front()); !fine)
      return fine.error();
    speeds.spindle_rpm_ = range->front();
  } else {
    speeds.remarks_.push_back(
        "no [limits] spindle_speed_rpm: cutting_speed_m_s alone bounds the spindle");
  }
  auto structure = structure_with_errors(machine);
  if (!structure) return structure.error();
  for (const auto& [tool, range] : speeds.cutting_speed_) {
    const process::ToolLaw& law = loads.law(tool);
    const std::string section = process::tool_section(machine, tool);
    const auto tangential = machine.number(section, "tangential_coefficient_N_per_m2");
    if (law.kind != process::CutterKind::flat) {
      speeds.unstudied_[tool] = "stability is known of end mills with a straight side (flat) alone";
    } else if (structure->x.empty() && structure->y.empty()) {
      speeds.unstudied_[tool] =
          "its stability is not known: give modes in [structure.x] and [structure.y]";
    } else if (!tangential || law.teeth == 0) {
      speeds.unstudied_[tool] = "its stability is not known: give [" + section +
                                "] teeth and tangential_coefficient_N_per_m2";
    } else {
      MillingTool model;
      model.diameter_m = 2 * law.radius_m, model.teeth = law.teeth, model.helix_deg = law.helix_deg;
      model.force.tangential_coefficient_N_per_m2 = *tangential;
      model.force.radial_ratio = machine.number(section, "radial_ratio").value_or(0);
      CutErrorsKnown known = tool_errors(machine, section, model);
      if (const auto done = add_mode_errors(machine, *structure, known); !done) return done.error();
      MillingCut slot;
      slot.direction = MillingDirection::slot;
      auto cut = UncertainCut::create(*structure, model, slot, known.errors);
      if (!cut) return cut.error();
      CutBelief belief = prior_belief(*cut, kSamples);
      speeds.studied_[tool] = {std::move(*cut), std::move(belief)};
      for (const std::string& remark : known.remarks)
        if (std::ranges::find(speeds.remarks_, remark) == speeds.remarks_.end())
          speeds.remarks_.push_back(remark);
    }
  }
  return speeds;
}

process::SpeedPlan ProgramSpeeds::plan(std::vector<std::string> lines,
                                       const process::CutLimits& limits,
                                       const process::MotionLimits& motion,
                                       const std::array<double, 2>& compliance) const {
  process::SpeedPlan plan(std::move(lines), limits, motion, compliance, spindle_rpm_);
  for (const auto& [tool, range] : cutting_speed_) plan.set_cutting_speed(tool, range[0], range[1]);
  for (const auto& [tool, why] : unstudied_) plan.set_unstudied(tool, why);
  return plan;
}

double ProgramSpeeds::probability(int tool, const std::vector<process::SideCut>& cuts, double rpm,
                                  double least) const {
  std::vector<StableCuts::Cut> list;
  for (const process::SideCut& c : cuts) list.push_back({c.engagement, c.axial_depth_m});
  const Studied& studied = studied_.at(tool);
  return StableCuts(studied.cut, studied.belief, std::move(list)).probability(rpm, least);
}

}  // namespace servosense::cli
