#include "servosense/io/unit_expression.hpp"

#include <cmath>
#include <optional>
#include <string>

#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/unit_name.hpp"

namespace servosense {
namespace {

struct Part {
  std::string_view spelling;
  double value;
  UnitPowers powers;
  Amplitude amplitude = Amplitude::unsaid;
};

constexpr double kPound_kg = 0.45359237;  // exact, as the inch: agreement of 1959
constexpr double kInch_m = 0.0254;
constexpr double kFoot_m = 12 * kInch_m;
constexpr double kOunce_kg = kPound_kg / 16;
constexpr double kPoundForce_N = kPound_kg * kGravity_m_s2;
constexpr double kOunceForce_N = kOunce_kg * kGravity_m_s2;
constexpr double kPoundInch2_kg_m2 = kPound_kg * kInch_m * kInch_m;
constexpr double kPoundFoot2_kg_m2 = kPound_kg * kFoot_m * kFoot_m;
constexpr double kOunceInch2_kg_m2 = kOunce_kg * kInch_m * kInch_m;
constexpr double kInchPound_Nm = kPoundForce_N * kInch_m;
constexpr double kFootPound_Nm = 12 * kInchPound_Nm;
constexpr double kInchOunce_Nm = kInchPound_Nm / 16;
constexpr double kHorsepower_W = 550 * kFootPound_Nm;
constexpr double kMetricHorsepower_W = 75 * kGravity_m_s2;

constexpr UnitPowers kNoPowers{};
constexpr UnitPowers kLength{1};
constexpr UnitPowers kMass{0, 1};
constexpr UnitPowers kPerSecond{0, 0, -1};
constexpr UnitPowers kCurrent{0, 0, 0, 1};
constexpr UnitPowers kForce{1, 1, -2};
constexpr UnitPowers kTorque{2, 1, -2};
constexpr UnitPowers kInertia{2, 1};
constexpr UnitPowers kPower{2, 1, -3};
constexpr UnitPowers kVoltage{2, 1, -3, -1};
constexpr UnitPowers kAngle{0, 0, 0, 0, 0, 1};
constexpr UnitPowers kSpeed{0, 0, -1, 0, 0, 1};
constexpr UnitPowers kCounts{0, 0, 0, 0, 0, 0, 1};
constexpr UnitPowers kCountsAnAngle{0, 0, 0, 0, 0, -1, 1};
constexpr UnitPowers kBits{0, 0, 0, 0, 0, 0, 0, 1};
constexpr UnitPowers kLines{0, 0, 0, 0, 0, 0, 0, 0, 1};

using enum Amplitude;
// What unit_name.hpp does not have. Upper and lower case matter.
constexpr Part kParts[] = {
    {"kg", 1, kMass},
    {"g", 1e-3, kMass},
    {"lb", kPound_kg, kMass},
    {"lbs", kPound_kg, kMass},
    {"oz", kOunce_kg, kMass},
    {"lbf", kPoundForce_N, kForce},
    {"ozf", kOunceForce_N, kForce},
    {"kgf", kGravity_m_s2, kForce},
    {"in", kInch_m, kLength},
    {"inch", kInch_m, kLength},
    {"ft", kFoot_m, kLength},
    {"lb-in", kInchPound_Nm, kTorque},
    {"in-lb", kInchPound_Nm, kTorque},
    {"lbf-in", kInchPound_Nm, kTorque},
    {"lb-ft", kFootPound_Nm, kTorque},
    {"ft-lb", kFootPound_Nm, kTorque},
    {"lbf-ft", kFootPound_Nm, kTorque},
    {"oz-in", kInchOunce_Nm, kTorque},
    {"kgm2", 1, kInertia},
    {"kgcm2", 1e-4, kInertia},
    {"kgmm2", 1e-6, kInertia},
    {"gcm2", 1e-7, kInertia},
    {"lb-in2", kPoundInch2_kg_m2, kInertia},
    {"lb-ft2", kPoundFoot2_kg_m2, kInertia},
    {"oz-in2", kOunceInch2_kg_m2, kInertia},
    {"lb-in-s2", kInchPound_Nm, kInertia},
    {"lb-ft-s2", kFootPound_Nm, kInertia},
    {"oz-in-s2", kInchOunce_Nm, kInertia},
    {"hp", kHorsepower_W, kPower},
    {"HP", kHorsepower_W, kPower},
    {"PS", kMetricHorsepower_W, kPower},
    {"Hz", 1, kPerSecond},
    {"kHz", 1e3, kPerSecond},
    {"MHz", 1e6, kPerSecond},
    {"krpm", 1e3 * kTwoPi / 60, kSpeed},
    {"turn", kTwoPi, kAngle},
    {"r", kTwoPi, kAngle},
    {"arcmin", kPi / 10800, kAngle},
    {"arcsec", kPi / 648000, kAngle},
    {"bit", 1, kBits},
    {"bits", 1, kBits},
    {"line", 1, kLines},
    {"lines", 1, kLines},
    {"cpr", 1 / kTwoPi, kCountsAnAngle},
    {"Arms", 1, kCurrent, effective},
    {"Aeff", 1, kCurrent, effective},
    {"Apk", 1, kCurrent, peak},
    {"Apeak", 1, kCurrent, peak},
    {"Vrms", 1, kVoltage, effective},
    {"Veff", 1, kVoltage, effective},
    {"Vpk", 1, kVoltage, peak},
    {"Vpeak", 1, kVoltage, peak},
    {"rms", 1, kNoPowers, effective},
    {"RMS", 1, kNoPowers, effective},
    {"eff", 1, kNoPowers, effective},
    {"pk", 1, kNoPowers, peak},
    {"peak", 1, kNoPowers, peak},
};

/// A unit of unit_name.hpp in the units of UnitPowers.
UnitExpression from(const UnitName& unit) {
  switch (unit.dimension) {
    case Dimension::none:
      return {unit.value, kNoPowers};
    case Dimension::time:
      return {unit.value, {0, 0, 1}};
    case Dimension::angle:
      return {unit.value, kAngle};
    case Dimension::angular_speed:
      return {unit.value, kSpeed};
    case Dimension::length:
      return {unit.value, kLength};
    case Dimension::velocity:
      return {unit.value, {1, 0, -1}};
    case Dimension::acceleration:
      return {unit.value, {1, 0, -2}};
    case Dimension::current:
      return {unit.value, kCurrent};
    case Dimension::torque:
      return {unit.value, kTorque};
    case Dimension::force:
      return {unit.value, kForce};
    case Dimension::power:
      return {unit.value, kPower};
    case Dimension::voltage:
      return {unit.value, kVoltage};
    case Dimension::pressure:
      return {unit.value, {-1, 1, -2}};
    case Dimension::temperature:
      return {unit.value, {0, 0, 0, 0, 1}};
    case Dimension::share:  // there a per cent is 1
      return {unit.value / 100, kNoPowers};
    case Dimension::counts:
      return {unit.value, kCounts};
  }
  return {};
}

bool is_unit_digit(char c) { return c >= '0' && c <= '9'; }
/// Of a unit's name; bytes beyond ASCII are part of no unit.
bool is_unit_name(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '%'; }

class UnitParser {
 public:
  explicit UnitParser(std::string text) : text_(std::move(text)) {}

  std::optional<UnitExpression> whole() {
    auto all = product();
    return at_ == text_.size() ? all : std::nullopt;
  }

 private:
  [[nodiscard]] char now() {
    while (at_ < text_.size() && text_[at_] == ' ') ++at_;
    return at_ < text_.size() ? text_[at_] : '\0';
  }

  /// Up to the end or a closing bracket.
  std::optional<UnitExpression> product() {
    UnitExpression all;
    bool open = true, divides = false;  // a part has to follow; it stands below the stroke
    if (now() == '\0') return std::nullopt;
    for (bool first = true; now() != '\0' && now() != ')'; first = false) {
      if (now() == '*' || now() == '/' || per()) {
        if (open && !(first && now() == '/')) return std::nullopt;
        divides = text_[at_++] != '*';
        open = true;
        continue;
      }
      const auto one = factor(divides);
      if (!one || !multiply(all, *one, divides ? -1 : 1)) return std::nullopt;
      open = divides = false;
    }
    if (open) return std::nullopt;
    return all;
  }

  /// The word; then at the blank behind it.
  bool per() {
    if (text_.compare(at_, 4, "per ") != 0) return false;
    at_ += 3;
    return true;
  }

  std::optional<UnitExpression> factor(bool divides) {
    UnitExpression scale;
    if (is_unit_digit(now())) {
      std::string digits(1, text_[at_++]);
      while (at_ < text_.size() && is_unit_digit(text_[at_])) digits += text_[at_++];
      // "1/s", "V/1000 rpm"; anything else would be a number with gaps.
      if (digits[0] != '1' || digits.find_first_not_of('0', 1) != std::string::npos ||
          digits.size() > 7)
        return std::nullopt;
      scale.value = parse_number(digits).value;
      if (!divides) return digits == "1" && now() == '/' ? std::optional(scale) : std::nullopt;
      if (!is_unit_name(now()) && now() != '(') return std::nullopt;
    }
    if (now() == '(') {
      ++at_;
      auto inner = product();
      if (!inner || now() != ')') return std::nullopt;
      ++at_;
      return scaled(scale, raised(*inner, power()));
    }
    std::string name;
    while (at_ < text_.size() && (is_unit_name(text_[at_]) || joins_names())) name += text_[at_++];
    const std::size_t behind_name = at_;
    const std::optional<int> exponent = power();
    // "min-1" and "kgcm2" are names of their own.
    if (const auto unit = named(name + text_.substr(behind_name, at_ - behind_name)))
      return scaled(scale, unit);
    if (const auto unit = named(name)) return scaled(scale, raised(*unit, exponent));
    return std::nullopt;
  }

  /// A hyphen or a digit before one, within "oz-in-s2".
  [[nodiscard]] bool joins_names() const {
    return text_[at_] == '-' && at_ + 1 < text_.size() && is_unit_name(text_[at_ + 1]);
  }

  /// 1 where none stands; nothing beyond 4.
  std::optional<int> power() {
    const std::size_t begin = at_;
    if (at_ + 1 < text_.size() && text_[at_] == '-' && is_unit_digit(text_[at_ + 1])) ++at_;
    while (at_ < text_.size() && is_unit_digit(text_[at_])) ++at_;
    if (at_ == begin) return 1;
    const auto number = parse_number(std::string_view(text_).substr(begin, at_ - begin));
    if (!number.ok() || std::abs(number.value) > 4 || number.value == 0) return std::nullopt;
    return static_cast<int>(number.value);
  }

  static std::optional<UnitExpression> named(const std::string& name) {
    for (const Part& part : kParts)
      if (part.spelling == name) return UnitExpression{part.value, part.powers, part.amplitude};
    const auto unit = unit_named(name);
    if (!unit || unit->spelling != name) return std::nullopt;
    return from(*unit);
  }

  static std::optional<UnitExpression> raised(UnitExpression unit, std::optional<int> exponent) {
    if (!exponent) return std::nullopt;
    unit.value = std::pow(unit.value, *exponent);
    for (int& power : unit.powers) power *= *exponent;
    return unit;
  }

  static std::optional<UnitExpression> scaled(const UnitExpression& scale,
                                              std::optional<UnitExpression> unit) {
    if (unit) unit->value *= scale.value;
    return unit;
  }

  static bool multiply(UnitExpression& all, const UnitExpression& one, int sign) {
    all.value *= sign > 0 ? one.value : 1 / one.value;
    for (std::size_t i = 0; i < all.powers.size(); ++i) all.powers[i] += sign * one.powers[i];
    if (one.amplitude == unsaid) return true;
    if (all.amplitude != unsaid && all.amplitude != one.amplitude) return false;
    all.amplitude = one.amplitude;
    return true;
  }

  std::string text_;
  std::size_t at_ = 0;
};

}  // namespace

std::vector<UnitExpression> unit_expressions(std::string_view text) {
  constexpr std::size_t kLongest = 40;  // far beyond any unit
  std::vector<UnitExpression> all;
  if (trim(text).empty()) return {UnitExpression{}};
  const std::string plain = plain_unit_signs(trim(text));
  if (plain.size() > kLongest) return all;
  if (const auto unit = unit_named(text)) all.push_back(from(*unit));
  if (const auto made = UnitParser(plain).whole())
    if (std::isfinite(made->value) && made->value > 0) all.push_back(*made);
  return all;
}

}  // namespace servosense
