// Text of the report: escaping, numbers and units as people write them.
#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cstdint>

#include "report_internal.hpp"

namespace servosense::report {

Cell::Cell(double value, int significant)
    : text(detail::number(value, significant)), is_number(true) {}

namespace detail {

namespace {

constexpr std::string_view kReplacement = "\xEF\xBF\xBD";
constexpr std::string_view kMinus = "\xE2\x88\x92";
constexpr std::string_view kThinSpace = "\xE2\x80\xAF";  // narrow, does not break

/// Bytes of the well-formed UTF-8 sequence at the start of `text`, 0 when there is none
/// (Unicode 15, table 3-7: no overlong forms, no surrogates, nothing above U+10FFFF).
std::size_t sequence_length(std::string_view text) {
  const auto byte = [&](std::size_t i) {
    return i < text.size() ? static_cast<unsigned char>(text[i]) : 0U;
  };
  const auto trails = [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i <= last; ++i)
      if (byte(i) < 0x80 || byte(i) > 0xBF) return false;
    return true;
  };
  const unsigned lead = byte(0), second = byte(1);
  if (lead < 0x80) return 1;
  if (lead >= 0xC2 && lead <= 0xDF) return trails(1, 1) ? 2 : 0;
  if (lead >= 0xE0 && lead <= 0xEF) {
    const unsigned low = lead == 0xE0 ? 0xA0 : 0x80, high = lead == 0xED ? 0x9F : 0xBF;
    return second >= low && second <= high && trails(2, 2) ? 3 : 0;
  }
  if (lead >= 0xF0 && lead <= 0xF4) {
    const unsigned low = lead == 0xF0 ? 0x90 : 0x80, high = lead == 0xF4 ? 0x8F : 0xBF;
    return second >= low && second <= high && trails(2, 3) ? 4 : 0;
  }
  return 0;
}

std::string superscript(int value) {
  static constexpr std::array<const char*, 10> kDigits = {"⁰", "¹", "²", "³", "⁴",
                                                          "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string out;
  for (const char c : std::to_string(value))
    out += c == '-' ? "⁻" : kDigits[static_cast<std::size_t>(c - '0')];
  return out;
}

std::string chars(double value, std::chars_format format, int precision) {
  std::array<char, 400> buffer{};
  const auto end =
      std::to_chars(buffer.data(), buffer.data() + buffer.size(), value, format, precision);
  return {buffer.data(), end.ptr};
}

void strip_zeros(std::string& digits) {
  if (digits.find('.') == std::string::npos) return;
  digits.erase(digits.find_last_not_of('0') + 1);
  if (digits.back() == '.') digits.pop_back();
}

/// True minus sign and thousands in groups, from five digits on.
std::string typeset(std::string digits) {
  const bool negative = digits[0] == '-';
  if (negative) digits.erase(0, 1);
  const std::size_t whole = std::min(digits.find('.'), digits.size());
  if (whole > 4)
    for (std::size_t at = whole; at > 3;) digits.insert(at -= 3, kThinSpace);
  const bool zero = digits.find_first_of("123456789") == std::string::npos;
  return negative && !zero ? std::string(kMinus) + digits : digits;
}

}  // namespace

std::string escaped(std::string_view text) {
  std::string out;
  out.reserve(text.size() + 8);
  while (!text.empty()) {
    const std::size_t length = sequence_length(text);
    const char c = text[0];
    if (length == 0) {
      out += kReplacement;
    } else if (length > 1) {
      // C1 controls (U+0080..9F) are not allowed in HTML either.
      const bool control = length == 2 && c == '\xC2' && static_cast<unsigned char>(text[1]) < 0xA0;
      out += control ? kReplacement : text.substr(0, length);
    } else if (c == '&') {
      out += "&amp;";
    } else if (c == '<') {
      out += "&lt;";
    } else if (c == '>') {
      out += "&gt;";
    } else if (c == '"') {
      out += "&quot;";
    } else if (c == '\'') {
      out += "&#39;";
    } else if ((c >= 0 && c < ' ' && c != '\n' && c != '\t') || c == '\x7F') {
      out += kReplacement;
    } else {
      out += c;
    }
    text.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return out;
}

std::string power_of_ten(int exponent) { return "10" + superscript(exponent); }

std::string number(double value, int significant) {
  if (std::isnan(value)) return "—";
  if (std::isinf(value)) return value > 0 ? "∞" : std::string(kMinus) + "∞";
  if (value == 0) return "0";
  const int digits = std::clamp(significant, 1, 17);
  std::string scientific = chars(value, std::chars_format::scientific, digits - 1);
  const std::size_t e = scientific.find('e');
  int exponent = 0;
  const char* first = scientific.data() + e + 1;
  if (*first == '+') ++first;
  std::from_chars(first, scientific.data() + scientific.size(), exponent);
  if (exponent < -4 || exponent >= std::max(7, digits)) {
    std::string mantissa = scientific.substr(0, e);
    strip_zeros(mantissa);
    if (mantissa == "1") return power_of_ten(exponent);
    return typeset(mantissa) + "×" + power_of_ten(exponent);
  }
  // Digits beyond the significant ones left of the point are kept: 12 345 is not 12 350.
  std::string out = chars(value, std::chars_format::fixed, std::max(0, digits - 1 - exponent));
  strip_zeros(out);
  return typeset(out);
}

std::string fixed(double value, int decimals) {
  return typeset(chars(value, std::chars_format::fixed, std::clamp(decimals, 0, 20)));
}

std::string plain(double value, int decimals) {
  std::string out = chars(value, std::chars_format::fixed, decimals);
  strip_zeros(out);
  return out == "-0" ? "0" : out;
}

std::string exact(double value) {
  if (!std::isfinite(value)) return "null";
  std::array<char, 32> buffer{};
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  return {buffer.data(), end.ptr};
}

std::string pretty_unit(std::string_view unit) {
  std::string out;
  for (std::size_t i = 0; i < unit.size(); ++i) {
    const char c = unit[i];
    const bool power =
        i > 0 && (c == '2' || c == '3') && std::isalpha(static_cast<unsigned char>(unit[i - 1]));
    if (power)
      out += superscript(c - '0');
    else
      out += c;
  }
  return out;
}

std::string unit_after(std::string_view unit) {
  if (unit.empty()) return {};
  return "\xC2\xA0" + escaped(pretty_unit(unit));
}

std::string count_text(std::size_t count) { return fixed(static_cast<double>(count), 0); }

double text_width_px(std::string_view text) {
  double width = 0;
  for (const char c : text) {
    if ((static_cast<unsigned char>(c) & 0xC0U) == 0x80U) continue;  // not the first byte
    width += c == '.' || c == ',' || c == 'i' || c == 'l' || c == ' ' ? 4 : 7;
  }
  return width;
}

std::string shortened(std::string_view text, std::size_t most) {
  std::size_t seen = 0, cut = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if ((static_cast<unsigned char>(text[i]) & 0xC0U) == 0x80U) continue;
    if (++seen == most) cut = i;
  }
  return seen <= most ? std::string(text) : std::string(text.substr(0, cut)) + "…";
}

std::string base64(const std::vector<float>& values) {
  static constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve(values.size() * 6);
  std::uint32_t bits = 0;
  int held = 0;
  const auto push = [&](std::uint32_t byte) {
    bits = bits << 8U | byte;
    if (++held < 3) return;
    for (const unsigned shift : {18U, 12U, 6U, 0U}) out += kDigits[bits >> shift & 63U];
    bits = 0;
    held = 0;
  };
  for (const float value : values) {
    const auto word = std::bit_cast<std::uint32_t>(value);
    for (const unsigned shift : {0U, 8U, 16U, 24U}) push(word >> shift & 255U);
  }
  const int missing = held == 0 ? 0 : 3 - held;
  for (int i = 0; i < missing; ++i) push(0);
  for (int i = 0; i < missing; ++i) out[out.size() - 1 - static_cast<std::size_t>(i)] = '=';
  return out;
}

const char* level_class(Level level) {
  switch (level) {
    case Level::none:
      return "none";
    case Level::info:
      return "info";
    case Level::warning:
      return "warning";
    case Level::alarm:
      return "alarm";
  }
  return "none";
}

const char* level_word(Level level) {
  switch (level) {
    case Level::none:
    case Level::info:
      return "";
    case Level::warning:
      return "Warning";
    case Level::alarm:
      return "Alarm";
  }
  return "";
}

}  // namespace detail
}  // namespace servosense::report
