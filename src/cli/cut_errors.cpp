#include "cut_errors.hpp"

#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "servosense/io/text.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense::cli {
namespace {

/// Of a tool whose radial ratio nobody has measured (Dunwoody 2010, section 6.3).
constexpr double kUsualRadialRatio = 0.3;
std::string share_text(double share) { return printed(100 * share, 3) + " %"; }

Expected<std::vector<std::array<double, 3>>> mode_errors(const MachineFile& machine,
                                                         const char* section, std::size_t modes,
                                                         CutErrorsKnown& known) {
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
      known.sources.push_back(
          {std::string(kOf[k]) + " of mode " + std::to_string(m + 1) + " of " + section,
           errors[m][k], stated.has_value(),
           stated ? "modes_relative_error"
                  : "typical: a hand-held hammer, tool taken out and put back"});
  if (!stated)
    known.remarks.push_back("[" + std::string(section) +
                            "] states no modes_relative_error: frequency is taken as known to " +
                            share_text(typical_error::kMode[0]) + ", damping to " +
                            share_text(typical_error::kMode[1]) + ", mass to " +
                            share_text(typical_error::kMode[2]) +
                            "; 'servosense identify modes' writes what hits tell");
  return errors;
}

}  // namespace

CutErrorsKnown tool_errors(const MachineFile& machine, const std::string& section,
                           MillingTool& tool) {
  CutErrorsKnown known;
  if (tool.force.radial_ratio == 0) {
    tool.force.radial_ratio = kUsualRadialRatio;
    known.remarks.push_back("the radial ratio is not known: " + printed(kUsualRadialRatio) +
                            " is taken, as is usual");
  }
  CutErrors& errors = known.errors;
  const auto tangential = machine.number(section, "tangential_coefficient_relative_error");
  if (tangential)
    errors.tangential = std::abs(*tangential);
  else
    known.remarks.push_back("[" + section +
                            "] states no tangential_coefficient_relative_error: it is taken "
                            "as known to " +
                            share_text(typical_error::kTangential) +
                            "; 'servosense identify cutting' writes what cuts tell");
  known.sources.push_back({"tangential coefficient", errors.tangential, tangential.has_value(),
                           tangential ? "tangential_coefficient_relative_error"
                                      : "typical: Dunwoody 2010, eq. 3.20 and 3.22"});
  known.sources.push_back({"radial ratio (absolute)", errors.radial_ratio, false,
                           "typical: Dunwoody 2010, section 6.3, 0.25 to 0.5"});
  return known;
}

Expected<Done> add_mode_errors(const MachineFile& machine, const Structure& structure,
                               CutErrorsKnown& known) {
  for (const bool along_x : {true, false}) {
    const auto& modes = along_x ? structure.x : structure.y;
    const char* section = along_x ? "structure.x" : "structure.y";
    auto of = mode_errors(machine, section, modes.size(), known);
    if (!of) return of.error();
    (along_x ? known.errors.x : known.errors.y) = std::move(*of);
    if (modes.empty())
      known.remarks.push_back("[" + std::string(section) +
                              "] has no modes: the tool is taken as rigid there");
  }
  return Done{};
}

Expected<Structure> structure_with_errors(const MachineFile& machine) {
  for (const char* section : {"structure.x", "structure.y"})
    if (machine.has(section, "frf"))
      return data_error(machine.where(section, "frf") +
                        ": a receptance does not say how well modes are known; fit them by "
                        "'servosense identify modes' and give modes");
  return structure_modes(machine);
}

}  // namespace servosense::cli
