#include "program_loads.hpp"

#include <cmath>

#include "console.hpp"
#include "servosense/io/coefficient_file.hpp"
#include "servosense/io/text.hpp"

namespace servosense::cli {

Expected<MachineFile> machine_with_coefficients(const Arguments& arguments) {
  const auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return machine.error();
  return with_coefficients(*machine);
}

Expected<Done> ProgramLoads::look_up(const std::vector<int>& tools) {
  for (const int tool : tools) {
    const auto law = laws_.of(tool);
    if (!law) return law.error();
    known_[tool] = *law;
  }
  return Done{};
}

process::StepConditions ProgramLoads::conditions(const process::Engagement& e,
                                                 const MoveTechnology& t) const {
  const int teeth = law(e.tool).teeth;
  return {teeth > 0 ? t.feed_per_turn_m / teeth : process::kNoAngle, t.spindle_rpm,
          stock_tolerance_m_, compliance_};
}

process::StepLoad ProgramLoads::of(const process::Engagement& e,
                                   const process::StepConditions& conditions) const {
  return step_load(e, law(e.tool), conditions);
}

double ProgramLoads::mean_torque_Nm(const process::Engagement& e, const MoveTechnology& t) const {
  return e.cuts() ? process::mean_torque_Nm(process::step_areas(e), law(e.tool),
                                            conditions(e, t).feed_per_tooth_m)
                  : 0;
}

std::vector<UnknownTorque> ProgramLoads::lacks() const {
  std::vector<UnknownTorque> all;
  for (const auto& [tool, law] : known_)
    if (!law->torque) all.push_back({tool, law->lacks});
  return all;
}

std::vector<std::string> ProgramLoads::remarks(const MachineFile& machine) const {
  std::vector<std::string> all;
  std::string no_force, no_error;
  const auto add = [](std::string& list, int tool) {
    list += (list.empty() ? "" : ", ") + std::to_string(tool);
  };
  for (const auto& [tool, law] : known_) {
    if (!law->torque) {
      all.push_back("torque of tool " + std::to_string(tool) + " is not predicted: give " +
                    law->lacks);
      continue;
    }
    if (!law->force) add(no_force, tool);
    if (!law->relative_error) add(no_error, tool);
  }
  if (!no_force.empty())
    all.push_back("forces of tool " + no_force +
                  " are not predicted: give tangential_coefficient_N_per_m2 and radial_ratio");
  else if (std::isnan(compliance_[0]) || std::isnan(compliance_[1]))
    all.push_back("deflection is not predicted: give modes in [structure.x] and [structure.y]");
  if (!no_error.empty())
    all.push_back("how well the torque of tool " + no_error +
                  " is known is not given (tangential_coefficient_relative_error or "
                  "torque_equation_relative_error): low_Nm and high_Nm hold the stock alone");
  for (const std::string& section : machine.sections())
    if (section.starts_with("effect.tool."))
      all.push_back("[" + section + "] is not part of the prediction");
  return all;
}

void LoadSummary::add(const process::Engagement& e, const process::StepLoad& load) {
  if (!e.cuts()) return;
  if (std::isnan(load.torque_Nm)) {
    ++unknown;
    return;
  }
  ++predicted;
  torque.add(load.torque_Nm, e.line);
  peak.add(load.peak_Nm, e.line);
  power.add(load.power_W, e.line);
  deflection.add(std::hypot(load.deflection_m[0], load.deflection_m[1]), e.line);
}

void LoadSummary::say_greatest() const {
  if (predicted == 0) return;
  say("  at most %.4g Nm (line %zu), %.4g Nm at its peak (line %zu), %.4g W (line %zu)\n",
      torque.value, torque.line, peak.value, peak.line, power.value, power.line);
  if (deflection.value > 0)
    say("  the tool bends by %.3g um at most (line %zu)\n", deflection.value * 1e6,
        deflection.line);
  if (unknown > 0) say("  in %zu steps that cut, torque is not known\n", unknown);
}

void LoadSummary::write(JsonWriter& json) const {
  json.member("torque_predicted", predicted > 0 && unknown == 0);
  json.member("steps_without_torque", unknown);
  json.objects("torque_unknown", lacks, [&](const UnknownTorque& u) {
    json.member("tool", u.tool);
    json.member("give", u.lacks);
  });
  const auto greatest = [&](const char* name, const Greatest& g) {
    json.key(name);
    json.begin_object();
    json.member("value", g.value);
    json.member("line", g.line);
    json.end_object();
  };
  if (predicted == 0) return;
  greatest("greatest_torque_Nm", torque);
  greatest("greatest_peak_Nm", peak);
  greatest("greatest_power_W", power);
  if (deflection.value > 0) greatest("greatest_deflection_m", deflection);
}

}  // namespace servosense::cli
