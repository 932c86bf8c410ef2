// What may stand in a machine file: one table of every section and key, with kind, range, unit and
// meaning. A new key is one line in src/io/machine_key_table.cpp, one of an effect in
// core/effect_keys.hpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/monitor_id.hpp"

namespace servosense {

enum class KeyKind : std::uint8_t {
  number,
  integer,
  flag,     ///< yes or no
  word,     ///< one of `choices`
  text,     ///< anything up to the end of the line or a '#'
  list,     ///< numbers between commas
  pairs,    ///< two numbers between blanks, a comma between pairs
  triples,  ///< three numbers between blanks, a comma between triples
};

/// Plausible values, in the unit of the key. Wide: it is there to catch a wrong sign or unit.
struct KeyRange {
  double low = -std::numeric_limits<double>::max();
  double high = std::numeric_limits<double>::max();
  bool low_excluded = false;

  [[nodiscard]] constexpr bool holds(double value) const {
    return (low_excluded ? value > low : value >= low) && value <= high;
  }
};

/// How many numbers a list may have.
struct KeyCount {
  std::size_t fewest = 1;
  std::size_t most = std::numeric_limits<std::size_t>::max();
};

struct MachineKey {
  std::string_view family;  ///< sections that have it, see section_families()
  std::string_view name;
  KeyKind kind = KeyKind::number;
  KeyRange range;                 ///< number, integer, list; first number of pairs and triples
  std::string_view unit;          ///< "" for none
  std::string_view meaning;       ///< a few words, for messages
  std::string_view choices = {};  ///< of a word, between blanks
  KeyRange second = {};           ///< pairs, triples
  KeyRange third = {};            ///< triples
  KeyCount count = {};            ///< list
};

/// Every key.
[[nodiscard]] std::span<const MachineKey> machine_keys();

/// Names of the families whose keys `section` may hold, most special first: {"axis"} for "axis.x",
/// {"monitor.collision", "monitor", ...} for "monitor.collision". Empty for an unknown section.
[[nodiscard]] std::vector<std::string> section_families(std::string_view section);

/// The entry for `key` in `section`; nullptr if there is none.
[[nodiscard]] const MachineKey* find_machine_key(std::string_view section, std::string_view key);

/// Known section nearest to an unknown one.
[[nodiscard]] std::string nearest_section(std::string_view section);
/// Key nearest to `key` among those of a known section.
[[nodiscard]] std::string nearest_key(std::string_view section, std::string_view key);

/// "a number greater than 0 and at most 0.5 [m]", for sentences that begin with "expected".
[[nodiscard]] std::string expectation(const MachineKey& key);

/// "expected a number [m], found '10 mm'; check the unit"; "" where the value is what the key
/// takes.
[[nodiscard]] std::string value_fault(const MachineKey& key, std::string_view value);

/// Two keys of which a section may hold one.
struct KeyAlternatives {
  std::string_view prefix;  ///< of the sections concerned
  std::string_view first;
  std::string_view second;
};
[[nodiscard]] std::span<const KeyAlternatives> key_alternatives();

/// Section of what a monitor knows of a drive: [monitor.<name>], and for collision on an axis that
/// turns and chatter on the second spindle or of a sensor one of their own, [monitor.collision.a].
[[nodiscard]] std::string monitor_section(MonitorId monitor, Channel channel);

/// Names of the effects, as they stand in `[effect.<channel>.<name>]`.
[[nodiscard]] std::span<const std::string_view> effect_names();
/// Names of the monitors, as they stand in `[monitor.<name>]` and in the event stream.
[[nodiscard]] std::span<const std::string_view> monitor_names();

}  // namespace servosense
