#include "servosense/io/sheet_value.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr std::size_t kRadian = 5, kCount = 6, kBit = 7, kLine = 8;  // places in UnitPowers

/// The number at the start of `text`, as long as it can be.
std::string_view number_at_start(std::string_view text) {
  const auto digits = [&](std::size_t at) {
    while (at < text.size() && text[at] >= '0' && text[at] <= '9') ++at;
    return at;
  };
  const auto sign = [&](std::size_t at) {
    return at < text.size() && (text[at] == '-' || text[at] == '+') ? at + 1 : at;
  };
  std::size_t end = digits(sign(0));
  if (end < text.size() && text[end] == '.') end = digits(end + 1);
  if (end < text.size() && (text[end] == 'e' || text[end] == 'E')) {
    const std::size_t from = sign(end + 1);
    if (digits(from) > from) end = digits(from);
  }
  return text.substr(0, end);
}

/// Powers with one more (or less) radian.
UnitPowers with_angle(UnitPowers powers, int more) {
  powers[kRadian] += more;
  return powers;
}

/// "20 bit" and "5000 lines" as counts; false where the unit is neither.
Expected<bool> encoder_counts(const UnitExpression& given, double number, SheetValue& out) {
  UnitPowers bits{}, lines{};
  bits[kBit] = lines[kLine] = 1;
  if (given.powers == bits) {
    if (number < 1 || number > 52 || number != std::floor(number))
      return data_error("an encoder has 1 to 52 bits, a whole number");
    out.value = std::exp2(number);
    out.remark = "2 to the power of " + number_text(number);
    return true;
  }
  if (given.powers != lines && given.powers != with_angle(lines, -1)) return false;
  // Both flanks of both tracks.
  out.value = 4 * number * given.value * (given.powers == lines ? 1 : kTwoPi);
  out.remark = "4 counts a line";
  return true;
}

}  // namespace

double to_15_digits(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.15g", value);
  return std::strtod(text, nullptr);
}

Expected<SheetValue> sheet_value_from(std::string_view text, std::string_view unit, bool per_turn) {
  text = trim(text);
  const std::string_view digits = number_at_start(text);
  const auto number = parse_number(digits);
  if (number.fault == NumberFault::out_of_range) return data_error("no number is that large");
  if (!number.ok())
    return data_error("no number stands at its start; write one with a decimal point");
  const std::string_view given_unit = trim(text.substr(digits.size()));
  if (given_unit.starts_with(',') || given_unit.starts_with('.') || given_unit.starts_with('\''))
    return data_error("write one number with a decimal point and no other signs in it");
  SheetValue out;
  if (given_unit.empty()) {
    out.value = number.value;
    return out;
  }
  const auto readings = unit_expressions(given_unit);
  if (readings.empty()) return data_error(in_quotes(given_unit) + " is no unit known here");
  const auto wanted = unit_expressions(unit);
  if (wanted.empty()) return data_error("it is written without a unit");
  for (const UnitExpression& given : readings) {
    for (const UnitExpression& want : wanted) {
      out.amplitude = given.amplitude;
      if (per_turn && given.powers == with_angle(want.powers, -1))
        out.value = to_15_digits(number.value * given.value * kTwoPi / want.value);
      else if (given.powers == want.powers)
        out.value = to_15_digits(number.value * given.value / want.value);
      else if (want.powers[kCount] == 1 && per_turn) {
        const auto counted = encoder_counts(given, number.value, out);
        if (!counted) return counted.error();
        if (!*counted) continue;
        out.value = to_15_digits(out.value);
      } else {
        continue;
      }
      if (!std::isfinite(out.value)) return data_error("the number is too large");
      return out;
    }
  }
  return data_error(in_quotes(given_unit) + " measures something else");
}

}  // namespace servosense
