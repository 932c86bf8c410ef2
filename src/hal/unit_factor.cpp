#include "unit_factor.hpp"

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "servosense/core/units.hpp"

namespace servosense::detail {
namespace {

struct Unit {
  std::string_view spelling;  // as plain() leaves it
  std::string_view si;
  double value;
};
constexpr double kDegree = kPi / 180;
constexpr double kPerMinute = kTwoPi / 60;
constexpr auto kUnits = std::to_array<Unit>({
    {"rad", "rad", 1},
    {"deg", "rad", kDegree},
    {"degree", "rad", kDegree},
    {"degrees", "rad", kDegree},
    {"rad/s", "rad/s", 1},
    {"deg/s", "rad/s", kDegree},
    {"rpm", "rad/s", kPerMinute},
    {"RPM", "rad/s", kPerMinute},
    {"1/min", "rad/s", kPerMinute},
    {"min-1", "rad/s", kPerMinute},
    {"r/min", "rad/s", kPerMinute},
    {"rev/min", "rad/s", kPerMinute},
    {"U/min", "rad/s", kPerMinute},
    {"rev/s", "rad/s", kTwoPi},
    {"m", "m", 1},
    {"mm", "m", 1e-3},
    {"um", "m", 1e-6},
    {"nm", "m", 1e-9},
    {"m/s", "m/s", 1},
    {"mm/s", "m/s", 1e-3},
    {"um/s", "m/s", 1e-6},
    {"m/min", "m/s", 1.0 / 60},
    {"mm/min", "m/s", 1e-3 / 60},
    {"m/s2", "m/s2", 1},
    {"mm/s2", "m/s2", 1e-3},
    {"A", "A", 1},
    {"mA", "A", 1e-3},
    {"Nm", "Nm", 1},
    {"mNm", "Nm", 1e-3},
    {"Ncm", "Nm", 1e-2},
    {"kNm", "Nm", 1e3},
    {"N*m", "Nm", 1},
    {"mN*m", "Nm", 1e-3},
    {"N*cm", "Nm", 1e-2},
    {"kN*m", "Nm", 1e3},
    {"N", "N", 1},
    {"kN", "N", 1e3},
    {"W", "W", 1},
    {"kW", "W", 1e3},
    {"V", "V", 1},
    {"mV", "V", 1e-3},
    {"C", "C", 1},
    {"degC", "C", 1},
});

// Without blanks and powers' signs; one sign of multiplication; degree, micro and square spelled
// out.
std::string plain(std::string_view unit) {
  using Sign = std::pair<std::string_view, std::string_view>;
  constexpr auto kSigns = std::to_array<Sign>({{" ", ""},
                                               {"^", ""},
                                               {".", "*"},
                                               {"\xC2\xB7", "*"},
                                               {"\xB7", "*"},
                                               {"\xC2\xB0", "deg"},
                                               {"\xB0", "deg"},
                                               {"\xC2\xB2", "2"},
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

}  // namespace

std::string_view unit_of(Quantity quantity) {
  // The longer ones first: _rad_s ends with _s alone.
  constexpr auto kEndings =
      std::to_array<std::pair<std::string_view, std::string_view>>({{"_rad_s", "rad/s"},
                                                                    {"_m_s2", "m/s2"},
                                                                    {"_m_s", "m/s"},
                                                                    {"_rad", "rad"},
                                                                    {"_m", "m"},
                                                                    {"_A", "A"},
                                                                    {"_Nm", "Nm"},
                                                                    {"_N", "N"},
                                                                    {"_W", "W"},
                                                                    {"_V", "V"},
                                                                    {"_C", "C"}});
  for (const auto& [ending, unit] : kEndings)
    if (name_of(quantity).ends_with(ending)) return unit;
  return "";
}

std::optional<double> value_of_unit(std::string_view unit, Quantity quantity) {
  const std::string spelling = plain(unit);
  const auto known = std::find_if(kUnits.begin(), kUnits.end(), [&](const Unit& u) {
    return u.spelling == spelling && u.si == unit_of(quantity);
  });
  if (known == kUnits.end()) return std::nullopt;
  return known->value;
}

}  // namespace servosense::detail
