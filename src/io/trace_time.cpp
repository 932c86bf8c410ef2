#include "trace_time.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <limits>

namespace servosense::detail {

ParsedNumber<Nanoseconds> parse_time(std::string_view text) noexcept {
  constexpr NumberFault kBad = NumberFault::not_a_number;
  const bool negative = text.starts_with('-');
  if (negative || text.starts_with('+')) text.remove_prefix(1);

  // Shape: digits [. digits] [e exponent].
  std::string_view mantissa = text;
  std::int64_t exponent = 0;
  if (const std::size_t e = text.find_first_of("eE"); e != std::string_view::npos) {
    mantissa = text.substr(0, e);
    const ParsedNumber<std::int64_t> parsed = parse_counts(text.substr(e + 1));
    if (parsed.fault == kBad) return {0, kBad};
    constexpr std::int64_t kFar = 10'000'000;  // beyond the longest line either way
    exponent =
        parsed.ok() ? std::clamp(parsed.value, -kFar, kFar) : (text[e + 1] == '-' ? -kFar : kFar);
  }
  const std::size_t point = std::min(mantissa.find('.'), mantissa.size());
  std::size_t digits = 0;
  for (std::size_t i = 0; i < mantissa.size(); ++i) {
    if (i == point) continue;
    if (mantissa[i] < '0' || mantissa[i] > '9') return {0, kBad};
    ++digits;
  }
  if (digits == 0) return {0, kBad};

  // The first `whole` digits, decimal point left out, are the nanoseconds.
  const std::int64_t whole = static_cast<std::int64_t>(point) + exponent + 9;
  constexpr std::uint64_t kMax = std::numeric_limits<Nanoseconds>::max();
  std::uint64_t ns = 0;
  std::int64_t taken = 0;
  for (std::size_t i = 0; i < mantissa.size() && taken <= whole; ++i) {
    if (i == point) continue;
    const auto digit = static_cast<std::uint64_t>(mantissa[i] - '0');
    if (taken == whole) {
      if (digit >= 5) ++ns;
    } else {
      if (ns > (kMax - digit) / 10) return {0, NumberFault::out_of_range};
      ns = ns * 10 + digit;
    }
    ++taken;
  }
  for (; taken < whole && ns > 0; ++taken) {
    if (ns > kMax / 10) return {0, NumberFault::out_of_range};
    ns *= 10;
  }
  if (ns > kMax) return {0, NumberFault::out_of_range};
  const auto value = static_cast<Nanoseconds>(ns);
  return {negative ? -value : value, NumberFault::none};
}

void append_time(std::string& out, Nanoseconds t_ns) {
  auto magnitude = static_cast<std::uint64_t>(t_ns);
  if (t_ns < 0) {
    out += '-';
    magnitude = 0 - magnitude;
  }
  std::array<char, 24> digits;
  char* const end =
      std::to_chars(digits.data(), digits.data() + digits.size(), magnitude / 1'000'000'000U).ptr;
  out.append(digits.data(), end);
  std::uint64_t fraction = magnitude % 1'000'000'000U;
  if (fraction == 0) return;
  std::array<char, 10> decimals;
  decimals[0] = '.';
  for (std::size_t i = 9; i > 0; --i, fraction /= 10)
    decimals[i] = static_cast<char>('0' + fraction % 10);
  std::size_t length = decimals.size();
  while (decimals[length - 1] == '0') --length;
  out.append(decimals.data(), length);
}

}  // namespace servosense::detail
