// What data sheets of motors, screws and encoders give and machine files do not hold: figures from
// which keys are worked out (data_sheet.hpp). And what is asked for, with what a missing key costs.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/io/machine_keys.hpp"

namespace servosense {

/// Of a section that holds a drive.
enum class DriveKind : std::uint8_t {
  none,    ///< no drive
  linear,  ///< a screw moves it: [axis.x]
  turning  ///< [spindle]
};
/// By the keys that the table of machine_keys.hpp has for the section.
[[nodiscard]] DriveKind drive_kind(std::string_view section);

/// A figure as an entry of the table of keys; its family is "linear", "turning" or "drive" (both).
[[nodiscard]] std::span<const MachineKey> sheet_figures();
/// The figure `name` of a section; nullptr if there is none.
[[nodiscard]] const MachineKey* find_sheet_figure(std::string_view section, std::string_view name);
/// The key or figure of a section; nullptr if there is neither.
[[nodiscard]] const MachineKey* find_sheet_key(std::string_view section, std::string_view name);
/// Key or figure nearest to `name`, of a known section.
[[nodiscard]] std::string nearest_sheet_key(std::string_view section, std::string_view name);
/// Whether a value is meant per turn, so that "10 mm/rev" may be written.
[[nodiscard]] bool is_per_turn(const MachineKey& key);

/// A key that somebody needs, and the truth about its absence; of two for one key the first counts.
struct NeededKey {
  std::string_view section;  ///< "linear" and "turning" stand for every drive of that kind
  std::string_view key;
  std::string_view costs;  ///< a clause; {drive} stands for the name of the channel
};
[[nodiscard]] std::span<const NeededKey> needed_keys();

/// A question, in the unit that data sheets use.
struct SheetQuestion {
  std::string_view section;  ///< as of NeededKey
  std::string_view name;     ///< key or figure
  std::string_view unit;     ///< of an answer that names none
  std::string_view words;
  std::string_view unless = {};  ///< not asked where this key is known by then
  std::string_view after = {};   ///< asked only where this key or figure was given
};
[[nodiscard]] std::span<const SheetQuestion> sheet_questions();

/// Whether `stated`, as in NeededKey and SheetQuestion, means `section`.
[[nodiscard]] bool means_section(std::string_view stated, std::string_view section);
/// "x" of "axis.x"; a section without a dot is its own name.
[[nodiscard]] std::string_view drive_of(std::string_view section);

}  // namespace servosense
