// What is known of the drives of a data sheet while it is worked out, and the keys that follow from
// figures of motors, screws and encoders.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/io/machine_keys.hpp"
#include "servosense/io/unit_expression.hpp"

namespace servosense {

struct GivenFigure {
  const MachineKey* key = nullptr;
  double value = 0;     // of one number, in the unit of the key
  std::string written;  // as in a machine file
  std::string said;     // as it was given
  std::string remark;   // what was made of it
  Amplitude amplitude = Amplitude::unsaid;
};

/// Of one section, by the names of keys and figures.
using GivenFigures = std::map<std::string, GivenFigure, std::less<>>;

struct DerivedKey {
  std::string key;
  double value = 0;
  std::string from;
};

/// What follows for one drive.
struct DerivedDrive {
  std::vector<DerivedKey> keys;
  std::vector<std::string> remarks;
  std::vector<std::string> faults;
};

/// Part by which figures of one drive may differ. Convention: rated figures carry losses, heat and
/// tolerances of some 5 to 15 per cent.
inline constexpr double kSheetAgreement = 0.2;

/// Works out what is missing from what is given in `section`, and holds against each other what is
/// there twice.
[[nodiscard]] DerivedDrive derive_drive(const std::string& section, const GivenFigures& given);

/// The factor for a quantity that holds (ampere)^`power`, told by `given`, where traces tell the
/// current by `reported`. 1 where either is unsaid.
[[nodiscard]] double amplitude_factor(Amplitude given, Amplitude reported, int power);
/// What [section] reported_current says.
[[nodiscard]] Amplitude reported_amplitude(const GivenFigures& given);
/// "axis.x.torque_constant_Nm_per_A holds for currents as effective values...", where nothing says
/// what a trace tells.
[[nodiscard]] std::string amplitude_remark(const std::string& section, std::string_view key,
                                           Amplitude amplitude);

}  // namespace servosense
