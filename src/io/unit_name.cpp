#include "servosense/io/unit_name.hpp"

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr double kDegree = kPi / 180;
constexpr double kPerMinute = kTwoPi / 60;
using enum Dimension;
// Spellings as plain_unit() leaves them.
constexpr auto kUnitNames = std::to_array<UnitName>({
    {"s", time, 1},
    {"sec", time, 1},
    {"second", time, 1},
    {"seconds", time, 1},
    {"Sek", time, 1},
    {"Sekunden", time, 1},
    {"ms", time, 1e-3},
    {"msec", time, 1e-3},
    {"millis", time, 1e-3},
    {"us", time, 1e-6},
    {"usec", time, 1e-6},
    {"ns", time, 1e-9},
    {"nsec", time, 1e-9},
    {"min", time, 60},
    {"h", time, 3600},
    {"rad", angle, 1},
    {"deg", angle, kDegree},
    {"degree", angle, kDegree},
    {"degrees", angle, kDegree},
    {"Grad", angle, kDegree},
    {"mrad", angle, 1e-3},
    {"rev", angle, kTwoPi},
    {"turns", angle, kTwoPi},
    {"Umdr", angle, kTwoPi},
    {"rad/s", angular_speed, 1},
    {"deg/s", angular_speed, kDegree},
    {"Grad/s", angular_speed, kDegree},
    {"deg/min", angular_speed, kDegree / 60},
    {"rpm", angular_speed, kPerMinute},
    {"upm", angular_speed, kPerMinute},
    {"1/min", angular_speed, kPerMinute},
    {"/min", angular_speed, kPerMinute},
    {"min-1", angular_speed, kPerMinute},
    {"r/min", angular_speed, kPerMinute},
    {"rev/min", angular_speed, kPerMinute},
    {"revs/min", angular_speed, kPerMinute},
    {"U/min", angular_speed, kPerMinute},
    {"Umdr/min", angular_speed, kPerMinute},
    {"rev/s", angular_speed, kTwoPi},
    {"U/s", angular_speed, kTwoPi},
    {"m", length, 1},
    {"cm", length, 1e-2},
    {"mm", length, 1e-3},
    {"um", length, 1e-6},
    {"nm", length, 1e-9},
    {"m/s", velocity, 1},
    {"cm/s", velocity, 1e-2},
    {"mm/s", velocity, 1e-3},
    {"um/s", velocity, 1e-6},
    {"m/min", velocity, 1.0 / 60},
    {"mm/min", velocity, 1e-3 / 60},
    {"m/s2", acceleration, 1},
    {"mm/s2", acceleration, 1e-3},
    {"g", acceleration, kGravity_m_s2},
    {"A", current, 1},
    {"Amp", current, 1},
    {"Amps", current, 1},
    {"Ampere", current, 1},
    {"mA", current, 1e-3},
    {"Nm", torque, 1},
    {"mNm", torque, 1e-3},
    {"Ncm", torque, 1e-2},
    {"kNm", torque, 1e3},
    {"N*m", torque, 1},
    {"mN*m", torque, 1e-3},
    {"N*cm", torque, 1e-2},
    {"kN*m", torque, 1e3},
    {"N", force, 1},
    {"daN", force, 10},
    {"kN", force, 1e3},
    {"W", power, 1},
    {"Watt", power, 1},
    {"kW", power, 1e3},
    {"V", voltage, 1},
    {"Volt", voltage, 1},
    {"mV", voltage, 1e-3},
    {"Pa", pressure, 1},
    {"C", temperature, 1},
    {"degC", temperature, 1},
    {"%", share, 1},
    {"pct", share, 1},
    {"percent", share, 1},
    {"Prozent", share, 1},
    {"counts", counts, 1},
    {"count", counts, 1},
    {"cts", counts, 1},
    {"inc", counts, 1},
    {"incr", counts, 1},
    {"Ink", counts, 1},
    {"Inkr", counts, 1},
    {"Inkremente", counts, 1},
});

// As the table has them: without blanks.
std::string plain_unit(std::string_view unit) {
  std::string out = plain_unit_signs(unit);
  std::erase(out, ' ');
  return out;
}

std::string without_case(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return out;
}

std::optional<UnitName> unit_among(std::string_view text, const Dimension* dimension) {
  const std::string spelling = plain_unit(text);
  const auto fits = [&](const UnitName& u) { return !dimension || u.dimension == *dimension; };
  for (const UnitName& u : kUnitNames)
    if (u.spelling == spelling && fits(u)) return u;
  std::optional<UnitName> found;
  for (const UnitName& u : kUnitNames) {
    // Milli and mega: "MM" is no megametre, "MA" may be a megaampere.
    if (spelling.starts_with('M') && u.spelling.starts_with('m') && u.value == 1e-3 &&
        (u.dimension == current || u.dimension == torque || u.dimension == voltage))
      continue;
    if (without_case(u.spelling) != without_case(spelling) || !fits(u)) continue;
    if (found) return std::nullopt;
    found = u;
  }
  return found;
}

}  // namespace

std::string plain_unit_signs(std::string_view unit) {
  using Sign = std::pair<std::string_view, std::string_view>;
  constexpr auto kSigns = std::to_array<Sign>({{"^", ""},
                                               {".", "*"},
                                               {"\xC2\xA0", " "},
                                               {"\xC2\xB7", "*"},
                                               {"\xE2\x8B\x85", "*"},
                                               {"\xB7", "*"},
                                               {"\xC2\xB0", "deg"},
                                               {"\xB0", "deg"},
                                               {"\xC2\xB2", "2"},
                                               {"\xC2\xB9", "1"},
                                               {"\xE2\x81\xBB", "-"},
                                               {"\xE2\x88\x92", "-"},
                                               {"\xB2", "2"},
                                               {"\xC2\xB5", "u"},
                                               {"\xCE\xBC", "u"},
                                               {"\xB5", "u"}});
  std::string out;
  while (!unit.empty()) {
    const auto sign = std::find_if(kSigns.begin(), kSigns.end(),
                                   [&](const Sign& s) { return unit.starts_with(s.first); });
    out += sign == kSigns.end() ? unit.substr(0, 1) : sign->second;
    unit.remove_prefix(sign == kSigns.end() ? 1 : sign->first.size());
  }
  return out;
}

std::optional<UnitName> unit_named(std::string_view text) { return unit_among(text, nullptr); }
std::optional<UnitName> unit_named(std::string_view text, Dimension dimension) {
  return unit_among(text, &dimension);
}

std::string_view nearest_unit(std::string_view text) {
  std::vector<std::string_view> all;
  for (const UnitName& u : kUnitNames) all.push_back(u.spelling);
  return nearest_name(plain_unit(text), all);
}

std::string_view unit_of(Quantity quantity) {
  // The longer ones first: _rad_s ends with _s alone.
  constexpr auto kEndings =
      std::to_array<std::pair<std::string_view, std::string_view>>({{"_rad_s", "rad/s"},
                                                                    {"_m_s2", "m/s2"},
                                                                    {"_m_s", "m/s"},
                                                                    {"_counts", "counts"},
                                                                    {"_percent", "%"},
                                                                    {"_rad", "rad"},
                                                                    {"_Nm", "Nm"},
                                                                    {"_m", "m"},
                                                                    {"_A", "A"},
                                                                    {"_N", "N"},
                                                                    {"_W", "W"},
                                                                    {"_V", "V"},
                                                                    {"_Pa", "Pa"},
                                                                    {"_C", "C"}});
  for (const auto& [ending, unit] : kEndings)
    if (name_of(quantity).ends_with(ending)) return unit;
  return "";
}

Dimension dimension_of(Quantity quantity) {
  if (quantity == Quantity::feed_override) return share;
  const auto unit = unit_named(unit_of(quantity));
  return unit ? unit->dimension : none;
}

std::optional<double> value_of_unit(std::string_view unit, Quantity quantity) {
  if (quantity == Quantity::feed_override && unit == "1") return 1.0;
  const auto known = unit_named(unit, dimension_of(quantity));
  if (!known || known->spelling != plain_unit(unit)) return std::nullopt;
  return quantity == Quantity::feed_override ? known->value / 100 : known->value;
}

}  // namespace servosense
