// From the figures of data sheets to a machine file: units, what has to be worked out, typical
// values where nothing is known, what is still missing and what that costs. Every fault is told,
// not only the first one.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"

namespace servosense {

/// One figure as somebody gives it: key of the machine file or figure of sheet_figures.hpp.
struct SheetEntry {
  std::string section;  ///< "axis.x"
  std::string name;     ///< "lead_m"
  std::string text;     ///< "10 mm"
};
/// From "axis.x.lead_m=10 mm". Usage error where it is not of that form.
[[nodiscard]] Expected<SheetEntry> sheet_entry_from(std::string_view text);
/// What is wrong with an entry by itself (section, key, unit, range), a sentence; "" for nothing.
[[nodiscard]] std::string sheet_fault(const SheetEntry& entry);

struct SheetReport {
  struct Value {
    std::string section;
    std::string name;
    std::string value;     ///< as in a machine file
    std::string unit;      ///< of it, "" for none
    bool numeric = false;  ///< one number
    std::string from;      ///< as it was given, worked out from what, or the source of a guess
  };
  struct Missing {
    std::string section;
    std::string key;
    std::string costs;  ///< a clause
  };
  std::vector<Value> given;      ///< keys and figures, in the order of the file
  std::vector<Value> derived;    ///< keys that are worked out
  std::vector<Value> guessed;    ///< typical of the class
  std::vector<Missing> missing;  ///< keys that somebody needs
  std::vector<std::string> remarks;
  std::vector<std::string> faults;  ///< sentences; with one the file is not to be written
  MachineFile machine;              ///< that every other command reads; empty with a fault
};

/// Works out what the entries say. `machine_class`: a name of machine_classes.hpp, or "" to guess
/// nothing. `machine` names the file in sentences.
[[nodiscard]] SheetReport work_out(std::span<const SheetEntry> entries,
                                   std::string_view machine_class, const std::string& machine);

}  // namespace servosense
