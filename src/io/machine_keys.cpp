#include "servosense/io/machine_keys.hpp"

#include <algorithm>
#include <array>
#include <optional>

#include "servosense/core/channel.hpp"
#include "servosense/core/effect_keys.hpp"
#include "servosense/core/monitor_id.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

// Keys of some monitors and not of the others.
constexpr auto kLearned = std::to_array<MonitorId>(
    {MonitorId::chatter, MonitorId::collision, MonitorId::ar_breakage, MonitorId::tooth_breakage});
constexpr auto kTurning = std::to_array<MonitorId>(
    {MonitorId::chatter, MonitorId::ar_breakage, MonitorId::tooth_breakage});
constexpr auto kOwnCutoff = std::to_array<MonitorId>({MonitorId::chatter, MonitorId::collision});
constexpr auto kLevels = std::to_array<MonitorId>(
    {MonitorId::chatter, MonitorId::collision, MonitorId::drill_fracture, MonitorId::ar_breakage,
     MonitorId::tooth_breakage, MonitorId::wear, MonitorId::torque_band});
struct SharedKeys {
  std::string_view family;
  std::span<const MonitorId> monitors;
};
constexpr auto kSharedKeys = std::to_array<SharedKeys>({{"monitor.levels", kLevels},
                                                        {"monitor.own-cutoff", kOwnCutoff},
                                                        {"monitor.learned", kLearned},
                                                        {"monitor.learned-turning", kTurning}});

// Sections with a fixed name and the families of their keys.
struct PlainSection {
  std::string_view name;
  std::string_view family;
  std::string_view special;  // "" for none
};
constexpr auto kPlainSections = std::to_array<PlainSection>({
    {"machine", "machine", ""},
    {"spindle", "spindle", "spindle.power"},
    {"spindle2", "spindle", "spindle.power"},
    {"axis.x", "axis", ""},
    {"axis.y", "axis", ""},
    {"axis.z", "axis", ""},
    {"axis.a", "spindle", ""},
    {"axis.b", "spindle", ""},
    {"axis.c", "spindle", ""},
    {"controller.x", "controller", "controller.axis"},
    {"controller.y", "controller", "controller.axis"},
    {"controller.z", "controller", "controller.axis"},
    {"controller.a", "controller", "controller.spindle"},
    {"controller.b", "controller", "controller.spindle"},
    {"controller.c", "controller", "controller.spindle"},
    {"controller.spindle", "controller", "controller.spindle"},
    {"controller.spindle2", "controller", "controller.spindle"},
    {"observer.x", "observer", ""},
    {"observer.y", "observer", ""},
    {"observer.z", "observer", ""},
    {"observer.a", "observer", ""},
    {"observer.b", "observer", ""},
    {"observer.c", "observer", ""},
    {"observer.spindle", "observer", "observer.spindle"},
    {"observer.spindle2", "observer", ""},
    {"monitor.signal.x", "pair", "pair.axis"},
    {"monitor.signal.y", "pair", "pair.axis"},
    {"monitor.signal.z", "pair", "pair.axis"},
    {"monitor.signal.a", "pair", "pair.turning"},
    {"monitor.signal.b", "pair", "pair.turning"},
    {"monitor.signal.c", "pair", "pair.turning"},
    {"monitor.signal.spindle", "pair", "pair.turning"},
    {"monitor.signal.spindle2", "pair", "pair.turning"},
    {"monitor.chatter.accelerometer", "sensor", "sensor.accelerometer"},
    {"monitor.chatter.microphone", "sensor", "sensor.microphone"},
    {"tool", "tool", ""},
    {"cut", "cut", ""},
    {"simulation", "simulation", ""},
    {"limits", "limits", ""},
    {"override", "override", ""},
    {"structure.x", "structure", ""},
    {"structure.y", "structure", ""},
    {"dynamometer", "dynamometer", ""},
    {"dynamometer.x", "dynamometer.direction", ""},
    {"dynamometer.y", "dynamometer.direction", ""},
    {"dynamometer.z", "dynamometer.direction", ""},
    {"detectability.x", "detectability", "detectability.axis"},
    {"detectability.y", "detectability", "detectability.axis"},
    {"detectability.z", "detectability", "detectability.axis"},
    {"detectability.a", "detectability", "detectability.spindle"},
    {"detectability.b", "detectability", "detectability.spindle"},
    {"detectability.c", "detectability", "detectability.spindle"},
    {"detectability.spindle", "detectability", "detectability.spindle"},
    {"detectability.spindle2", "detectability", "detectability.spindle"},
});

/// [tool.7], the tool of that number.
bool is_numbered_tool(std::string_view section) {
  constexpr std::string_view kPrefix = "tool.";
  if (!section.starts_with(kPrefix)) return false;
  section.remove_prefix(kPrefix.size());
  return !section.empty() && section.size() <= 6 && section[0] != '0' &&
         section.find_first_not_of("0123456789") == std::string_view::npos;
}

bool contains(std::span<const std::string_view> names, std::string_view name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// Drives whose monitor has a section of its own, behind that of the monitor.
constexpr std::array kOwnMonitors = {Channel::a, Channel::b, Channel::c, Channel::spindle2};

std::optional<MonitorId> monitor_of(std::string_view section) {
  constexpr std::string_view kPrefix = "monitor.";
  if (!section.starts_with(kPrefix)) return std::nullopt;
  return monitor_from(section.substr(kPrefix.size()));
}

/// {"monitor.collision.turning", "monitor.collision"} of [monitor.collision.a].
struct OwnMonitor {
  std::string_view family, monitor;
};
std::optional<OwnMonitor> own_monitor(std::string_view section) {
  for (const Channel channel : kOwnMonitors) {
    const MonitorId id = is_spindle(channel) ? MonitorId::chatter : MonitorId::collision;
    if (section != monitor_section(id, channel)) continue;
    return is_spindle(channel) ? OwnMonitor{"monitor.chatter", "monitor.chatter"}
                               : OwnMonitor{"monitor.collision.turning", "monitor.collision"};
  }
  return std::nullopt;
}

/// {"x", "backlash"} from "effect.x.backlash".
struct EffectSection {
  std::string_view channel;
  std::string_view name;
};
std::optional<EffectSection> effect_section(std::string_view section) {
  constexpr std::string_view kPrefix = "effect.";
  if (!section.starts_with(kPrefix)) return std::nullopt;
  section.remove_prefix(kPrefix.size());
  const std::size_t dot = section.find('.');
  if (dot == std::string_view::npos) return EffectSection{section, {}};
  return EffectSection{section.substr(0, dot), section.substr(dot + 1)};
}

std::string range_text(const KeyRange& range) {
  const bool from = range.low > KeyRange{}.low;
  const bool to = range.high < KeyRange{}.high;
  const std::string low =
      (range.low_excluded ? " greater than " : " of at least ") + number_text(range.low);
  if (from && to) return low + " and at most " + number_text(range.high);
  if (from) return low;
  return to ? " of at most " + number_text(range.high) : "";
}

/// "1 to 2 " before "numbers"; nothing where any count will do.
std::string count_text(const KeyCount& count) {
  if (count.most == KeyCount{}.most) return "";
  const std::string most = std::to_string(count.most) + " ";
  return count.fewest == count.most ? most : std::to_string(count.fewest) + " to " + most;
}

}  // namespace

std::string monitor_section(MonitorId monitor, Channel channel) {
  std::string section = "monitor." + std::string(name_of(monitor));
  const bool own = monitor == MonitorId::chatter || monitor == MonitorId::collision;
  if ((own && std::ranges::find(kOwnMonitors, channel) != kOwnMonitors.end()) || is_sensor(channel))
    section += "." + std::string(name_of(channel));
  return section;
}

std::span<const std::string_view> effect_names() { return kEffectNames; }
std::span<const std::string_view> monitor_names() { return kMonitorNames; }

std::vector<std::string> section_families(std::string_view section) {
  for (const PlainSection& plain : kPlainSections) {
    if (plain.name != section) continue;
    if (plain.special.empty()) return {std::string(plain.family)};
    return {std::string(plain.special), std::string(plain.family)};
  }
  if (is_numbered_tool(section)) return {"tool"};
  const auto own = own_monitor(section);
  if (const auto monitor = monitor_of(own ? own->monitor : section)) {
    std::vector<std::string> families = {std::string(own ? own->family : section), "monitor"};
    if (*monitor == MonitorId::collision) families.emplace_back("monitor.collision-any");
    for (const SharedKeys& shared : kSharedKeys)
      if (std::find(shared.monitors.begin(), shared.monitors.end(), *monitor) !=
          shared.monitors.end())
        families.emplace_back(shared.family);
    return families;
  }
  if (const auto effect = effect_section(section)) {
    const auto channel = channel_from(effect->channel);
    if (!channel || !contains(kEffectNames, effect->name)) return {};
    const std::string family = "effect." + std::string(effect->name);
    if (is_turning(*channel)) return {family + ".turning", family, "effect"};
    return {family, "effect"};
  }
  return {};
}

const MachineKey* find_machine_key(std::string_view section, std::string_view key) {
  for (const std::string& family : section_families(section))
    for (const MachineKey& known : machine_keys())
      if (known.family == family && known.name == key) return &known;
  return nullptr;
}

std::string nearest_section(std::string_view section) {
  if (const auto effect = effect_section(section)) {
    // Channel and name are corrected apart: the whole would be too far from every known one.
    const std::string_view channel = nearest_name(effect->channel, kChannelNames);
    return "effect." + std::string(channel) + "." +
           std::string(nearest_name(effect->name, kEffectNames));
  }
  std::vector<std::string> names;
  for (const PlainSection& plain : kPlainSections) names.emplace_back(plain.name);
  for (const std::string_view monitor : kMonitorNames)
    names.push_back("monitor." + std::string(monitor));
  for (const Channel channel : kOwnMonitors)
    names.push_back(
        monitor_section(is_spindle(channel) ? MonitorId::chatter : MonitorId::collision, channel));
  const std::vector<std::string_view> views(names.begin(), names.end());
  return std::string(nearest_name(section, views));
}

std::string nearest_key(std::string_view section, std::string_view key) {
  std::vector<std::string_view> names;
  for (const std::string& family : section_families(section))
    for (const MachineKey& known : machine_keys())
      if (known.family == family) names.push_back(known.name);
  return std::string(nearest_name(key, names));
}

std::string expectation(const MachineKey& key) {
  const std::string unit = key.unit.empty() ? "" : " [" + std::string(key.unit) + "]";
  switch (key.kind) {
    case KeyKind::number:
      return "a number" + range_text(key.range) + unit;
    case KeyKind::integer:
      return "a whole number" + range_text(key.range) + unit;
    case KeyKind::flag:
      return "yes or no";
    case KeyKind::word:
      return "one of: " + std::string(key.choices);
    case KeyKind::text:
      return "text";
    case KeyKind::list:
      return count_text(key.count) + "numbers" + range_text(key.range) + " between commas" + unit;
    case KeyKind::pairs:
      return "pairs '" + std::string(key.meaning) + "' with a comma between them" + unit;
    case KeyKind::triples:
      return "triples '" + std::string(key.meaning) + "' with a comma between them" + unit;
  }
  return {};
}

}  // namespace servosense
