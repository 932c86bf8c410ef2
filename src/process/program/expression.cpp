#include "servosense/process/program/expression.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <numbers>

#include "servosense/io/text.hpp"
#include "servosense/process/program/limits.hpp"

namespace servosense::process {

bool Cursor::take(std::string_view text) {
  if (line.substr(std::min(at, line.size())).substr(0, text.size()) != text) return false;
  at += text.size();
  return true;
}

namespace {

enum class Operator {
  power,
  times,
  divide,
  modulo,
  plus,
  minus,
  eq,
  ne,
  gt,
  ge,
  lt,
  le,
  both,
  either,
  one
};

struct OperatorSign {
  std::string_view text;
  Operator what;
  int binds;  // the higher, the tighter
};
constexpr std::array<OperatorSign, 15> kOperators = {{{"**", Operator::power, 5},
                                                      {"*", Operator::times, 4},
                                                      {"/", Operator::divide, 4},
                                                      {"mod", Operator::modulo, 4},
                                                      {"+", Operator::plus, 3},
                                                      {"-", Operator::minus, 3},
                                                      {"eq", Operator::eq, 2},
                                                      {"ne", Operator::ne, 2},
                                                      {"gt", Operator::gt, 2},
                                                      {"ge", Operator::ge, 2},
                                                      {"lt", Operator::lt, 2},
                                                      {"le", Operator::le, 2},
                                                      {"and", Operator::both, 1},
                                                      {"or", Operator::either, 1},
                                                      {"xor", Operator::one, 1}}};

bool equal(double a, double b) { return std::abs(a - b) < kEqualNumbers; }
double truth(bool value) { return value ? 1.0 : 0.0; }

Expected<double> apply(double a, Operator what, double b) {
  switch (what) {
    case Operator::power:
      if (a < 0 && std::floor(b) != b)
        return data_error("a negative number has no power that is not whole");
      return std::pow(a, b);
    case Operator::times:
      return a * b;
    case Operator::divide:
      if (b == 0) return data_error("division by zero");
      return a / b;
    case Operator::modulo: {
      const double rest = std::fmod(a, b);
      return rest < 0 ? rest + std::abs(b) : rest;
    }
    case Operator::plus:
      return a + b;
    case Operator::minus:
      return a - b;
    case Operator::eq:
      return truth(equal(a, b));
    case Operator::ne:
      return truth(!equal(a, b));
    case Operator::gt:
      return truth(a > b);
    case Operator::ge:
      return truth(a >= b);
    case Operator::lt:
      return truth(a < b);
    case Operator::le:
      return truth(a <= b);
    case Operator::both:
      return truth(a != 0 && b != 0);
    case Operator::either:
      return truth(a != 0 || b != 0);
    case Operator::one:
      return truth((a != 0) != (b != 0));
  }
  return 0.0;
}

const OperatorSign* operator_here(const Cursor& cursor) {
  for (const OperatorSign& sign : kOperators)
    if (Cursor(cursor).take(sign.text)) return &sign;
  return nullptr;
}

/// A value and all that binds tighter than `loosest`.
Expected<double> read_chain(Cursor& cursor, const ParameterValues& values, int loosest) {
  auto left = read_value(cursor, values);
  if (!left) return left;
  for (;;) {
    const OperatorSign* sign = operator_here(cursor);
    if (sign == nullptr || sign->binds < loosest) return left;
    cursor.take(sign->text);
    const auto right = read_chain(cursor, values, sign->binds + 1);
    if (!right) return right;
    left = apply(*left, sign->what, *right);
    if (!left) return left;
  }
}

Expected<double> read_number(Cursor& cursor) {
  const std::size_t begin = cursor.at;
  if (cursor.next() == '+' || cursor.next() == '-') ++cursor.at;
  const std::size_t digits = cursor.at;
  while ((cursor.next() >= '0' && cursor.next() <= '9') || cursor.next() == '.') ++cursor.at;
  const std::string_view text = cursor.line.substr(digits, cursor.at - digits);
  double value = 0;
  const auto [end, fault] =
      std::from_chars(text.data(), text.data() + text.size(), value, std::chars_format::fixed);
  if (fault != std::errc() || end != text.data() + text.size())
    return data_error("a number is expected where " + in_quotes(cursor.line.substr(begin, 12)) +
                      " stands");
  return cursor.line[begin] == '-' ? -value : value;
}

Expected<double> read_parameter(Cursor& cursor, const ParameterValues& values) {
  cursor.take("#");
  if (cursor.next() == '<') {
    const auto name = read_name(cursor);
    if (!name) return name.error();
    return values.named(*name);
  }
  const auto index = read_whole(cursor, values);
  if (!index) return index.error();
  return values.numbered(*index);
}

enum class Function {
  abs,
  acos,
  asin,
  atan,
  cos,
  exists,
  exp,
  fix,
  fup,
  ln,
  round,
  sin,
  sqrt,
  tan
};
constexpr std::array<std::pair<std::string_view, Function>, 14> kFunctions = {
    {{"abs", Function::abs},
     {"acos", Function::acos},
     {"asin", Function::asin},
     {"atan", Function::atan},
     {"cos", Function::cos},
     {"exists", Function::exists},
     {"exp", Function::exp},
     {"fix", Function::fix},
     {"fup", Function::fup},
     {"ln", Function::ln},
     {"round", Function::round},
     {"sin", Function::sin},
     {"sqrt", Function::sqrt},
     {"tan", Function::tan}}};

Expected<double> evaluate(Function function, double x) {
  // In extended precision, as LinuxCNC does: whether SIN[180] is above or below 0 decides what MOD
  // makes of it.
  constexpr long double pi = std::numbers::pi_v<long double>;
  const auto degrees = [](double rad) {
    return static_cast<double>(static_cast<long double>(rad) * 180.0L / pi);
  };
  const auto rad = [](double deg) { return static_cast<long double>(deg) * pi / 180.0L; };
  switch (function) {
    case Function::abs:
      return std::abs(x);
    case Function::acos:
    case Function::asin:
      if (std::abs(x) > 1) return data_error("ACOS and ASIN take numbers from -1 to 1");
      return degrees(function == Function::acos ? std::acos(x) : std::asin(x));
    case Function::cos:
      return static_cast<double>(std::cos(rad(x)));
    case Function::sin:
      return static_cast<double>(std::sin(rad(x)));
    case Function::tan:
      return static_cast<double>(std::tan(rad(x)));
    case Function::exp:
      return std::exp(x);
    case Function::fix:
      return std::floor(x);
    case Function::fup:
      return std::ceil(x);
    case Function::ln:
      if (x <= 0) return data_error("LN takes numbers above 0");
      return std::log(x);
    case Function::round:
      return std::trunc(x + (x < 0 ? -0.5 : 0.5));
    case Function::sqrt:
      if (x < 0) return data_error("SQRT takes numbers from 0 on");
      return std::sqrt(x);
    case Function::atan:
    case Function::exists:
      break;
  }
  return x;
}

Expected<double> read_function(Cursor& cursor, const ParameterValues& values) {
  for (const auto& [name, function] : kFunctions) {
    if (!cursor.take(name)) continue;
    if (cursor.next() != '[')
      return data_error("the argument of a function stands in brackets; write it as " +
                        std::string(name) + "[...]");
    if (function == Function::exists) {
      if (!cursor.take("[#")) return data_error("EXISTS asks for a parameter, as EXISTS[#<name>]");
      double found = 0;
      if (cursor.next() == '<') {
        const auto parameter = read_name(cursor);
        if (!parameter) return parameter.error();
        found = truth(values.exists(*parameter));
      } else {
        const auto index = read_whole(cursor, values);
        if (!index) return index.error();
        found = truth(*index >= 1 && *index <= kLastParameter);
      }
      if (!cursor.take("]")) return data_error("EXISTS[#...] is not closed");
      return found;
    }
    const auto argument = read_bracket(cursor, values);
    if (!argument) return argument;
    if (function != Function::atan) return evaluate(function, *argument);
    if (!cursor.take("/") || cursor.next() != '[')
      return data_error("ATAN takes two arguments; write it as ATAN[y]/[x]");
    const auto second = read_bracket(cursor, values);
    if (!second) return second;
    return static_cast<double>(static_cast<long double>(std::atan2(*argument, *second)) * 180.0L /
                               std::numbers::pi_v<long double>);
  }
  return data_error("a number is expected where " +
                    in_quotes(cursor.line.substr(std::min(cursor.at, cursor.line.size()), 12)) +
                    " stands");
}

}  // namespace

Expected<double> read_bracket(Cursor& cursor, const ParameterValues& values) {
  if (!cursor.take("[")) return data_error("an expression begins with '['");
  auto value = read_chain(cursor, values, 1);
  if (!value) return value;
  if (cursor.at_end()) return data_error("an expression is not closed; a ']' is missing");
  if (!cursor.take("]"))
    return data_error("an operator is expected where " +
                      in_quotes(cursor.line.substr(cursor.at, 12)) + " stands");
  return value;
}

Expected<double> read_value(Cursor& cursor, const ParameterValues& values) {
  Expected<double> value = 0.0;
  const char c = cursor.next();
  const char after = cursor.at + 1 < cursor.line.size() ? cursor.line[cursor.at + 1] : '\0';
  const bool sign_of_value = (c == '+' || c == '-') && after != '.' && (after < '0' || after > '9');
  if (c == '[') {
    value = read_bracket(cursor, values);
  } else if (c == '#') {
    value = read_parameter(cursor, values);
  } else if (sign_of_value) {
    ++cursor.at;
    value = read_value(cursor, values);
    if (value && c == '-') value = -*value;
  } else if (c >= 'a' && c <= 'z') {
    value = read_function(cursor, values);
  } else {
    value = read_number(cursor);
  }
  if (value && !std::isfinite(*value))
    return data_error("a calculation ends in no finite number; look at what it divides by");
  return value;
}

Expected<long> read_whole(Cursor& cursor, const ParameterValues& values) {
  const auto value = read_value(cursor, values);
  if (!value) return value.error();
  const double nearest = std::round(*value);
  if (std::abs(*value - nearest) > kEqualNumbers || std::abs(nearest) > 1e9)
    return data_error("a whole number is expected, not " + number_text(*value));
  return static_cast<long>(nearest);
}

Expected<std::string> read_name(Cursor& cursor) {
  const std::size_t end = cursor.line.find('>', cursor.at);
  if (!cursor.take("<") || end == std::string_view::npos)
    return data_error("a name is not closed; write it as <name>");
  std::string name(cursor.line.substr(cursor.at, end - cursor.at));
  cursor.at = end + 1;
  return name;
}

}  // namespace servosense::process
