#include "servosense/io/text.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <system_error>

namespace servosense {
namespace {

constexpr char lower(char c) noexcept {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

bool same_ignoring_case(std::string_view text, std::string_view lower_case) noexcept {
  return std::equal(text.begin(), text.end(), lower_case.begin(), lower_case.end(),
                    [](char a, char b) { return lower(a) == b; });
}

std::string_view without_sign(std::string_view text) noexcept {
  if (!text.empty() && (text.front() == '-' || text.front() == '+')) text.remove_prefix(1);
  return text;
}

/// std::from_chars knows no plus sign; a second sign behind it stays an error.
std::string_view without_plus(std::string_view text) noexcept {
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
  return text;
}

/// Of the character of `length` bytes that `text` begins with. U+0080..U+009F are some, too.
bool is_control(std::string_view text, std::size_t length) noexcept {
  const auto first = static_cast<unsigned char>(text.front());
  return first < 0x20 || first == 0x7F ||
         (length == 2 && first == 0xC2 && static_cast<unsigned char>(text[1]) < 0xA0);
}

}  // namespace

std::string_view trim(std::string_view text) noexcept {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

ParsedNumber<double> parse_number(std::string_view text) noexcept {
  const std::string_view digits = without_plus(text);
  ParsedNumber<double> result;
  const char* const end = digits.data() + digits.size();
  const auto [stop, status] = std::from_chars(digits.data(), end, result.value);
  if (status == std::errc::result_out_of_range && stop == end)
    return {0, NumberFault::out_of_range};
  if (status != std::errc() || stop != end) return {0, NumberFault::not_a_number};
  if (std::isnan(result.value)) return {0, NumberFault::not_a_number};
  if (std::isinf(result.value)) return {0, NumberFault::infinite};
  return result;
}

ParsedNumber<std::int64_t> parse_counts(std::string_view text) noexcept {
  const std::string_view digits = without_plus(text);
  const std::string_view word = without_sign(text);
  if (same_ignoring_case(word, "inf") || same_ignoring_case(word, "infinity"))
    return {0, NumberFault::infinite};
  const char* const end = digits.data() + digits.size();
  std::int64_t value = 0;
  const auto [stop, status] = std::from_chars(digits.data(), end, value);
  if (stop != end || status == std::errc::invalid_argument) return {0, NumberFault::not_a_number};
  if (status == std::errc()) return {value, NumberFault::none};
  std::uint64_t wide = 0;
  if (std::from_chars(digits.data(), end, wide).ec != std::errc())
    return {0, NumberFault::out_of_range};
  return {static_cast<std::int64_t>(wide), NumberFault::none};
}

bool spells_nan(std::string_view text) noexcept {
  return same_ignoring_case(without_sign(text), "nan");
}

void append_number(std::string& out, double value) {
  if (std::isnan(value)) {
    out += "nan";  // to_chars would keep the sign of a NaN
    return;
  }
  std::array<char, 32> digits;
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
  out.append(digits.data(), end);
}

void append_integer(std::string& out, std::int64_t value) {
  std::array<char, 24> digits;
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
  out.append(digits.data(), end);
}

std::string number_text(double value) {
  std::string out;
  append_number(out, value);
  return out;
}

std::string printed(double value, int digits) {
  char text[32];  // 17 digits, sign, point and exponent
  const auto [end, fault] =
      std::to_chars(text, text + sizeof text, value, std::chars_format::general, digits);
  return fault == std::errc() ? std::string(text, end) : number_text(value);
}

std::size_t utf8_length(std::string_view text) noexcept {
  if (text.empty()) return 0;
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned first = byte(0);
  if (first < 0x80) return 1;
  const std::size_t length = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first > 0xF4 || text.size() < length) return 0;
  for (std::size_t i = 1; i < length; ++i)
    if ((byte(i) & 0xC0U) != 0x80U) return 0;
  // Overlong spellings, surrogates, and what lies beyond U+10FFFF.
  const unsigned second = byte(1);
  if ((first == 0xE0 && second < 0xA0) || (first == 0xED && second > 0x9F) ||
      (first == 0xF0 && second < 0x90) || (first == 0xF4 && second > 0x8F))
    return 0;
  return length;
}

std::string printable(std::string_view text, std::size_t longest) {
  constexpr std::string_view kHex = "0123456789abcdef";
  std::string out;
  while (!text.empty()) {
    if (out.size() >= longest) return out + "...";
    const std::size_t length = utf8_length(text);
    const auto first = static_cast<unsigned char>(text.front());
    if (length == 0 || is_control(text, length)) {
      out += {'\\', 'x', kHex[first >> 4U], kHex[first & 15U]};
      text.remove_prefix(1);
    } else {
      out += text.substr(0, length);
      text.remove_prefix(length);
    }
  }
  return out;
}

bool is_shown_as_written(std::string_view text) noexcept {
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    if (length == 0 || is_control(text, length)) return false;
    text.remove_prefix(length);
  }
  return true;
}

std::string in_quotes(std::string_view text) { return "'" + printable(text) + "'"; }

std::size_t edit_distance(std::string_view a, std::string_view b) {
  constexpr std::size_t kLongest = 64;
  a = a.substr(0, kLongest);
  b = b.substr(0, kLongest);
  std::array<std::size_t, kLongest + 1> row{};
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = 2 * j;
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = 2 * (i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t exchange = a[i] == b[j] ? 0U : lower(a[i]) == lower(b[j]) ? 1U : 2U;
      const std::size_t cost = std::min({diagonal + exchange, row[j] + 2, row[j + 1] + 2});
      diagonal = row[j + 1];
      row[j + 1] = cost;
    }
  }
  return row[b.size()];
}

std::string_view nearest_name(std::string_view name, std::span<const std::string_view> candidates) {
  std::string_view best;
  std::size_t best_distance = SIZE_MAX;
  for (const std::string_view candidate : candidates) {
    const std::size_t distance = edit_distance(name, candidate);
    if (distance >= best_distance) continue;
    best_distance = distance;
    best = candidate;
  }
  return best;
}

}  // namespace servosense
