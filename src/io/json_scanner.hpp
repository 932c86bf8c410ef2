// One JSON object (RFC 8259), read strictly: what the readers of JSON Lines share.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "servosense/io/text.hpp"

namespace servosense {

/// Every function returns false at the first fault and leaves the sentence in `fault`.
class JsonScanner {
 public:
  explicit JsonScanner(std::string_view text) : rest_(text), size_(text.size()) {}

  std::string fault;

  /// The whole text as one object; `value(key)` reads the value of each key, each once.
  template <typename Value>
  bool object(Value value) {
    skip_blanks();
    if (!expect('{')) return false;
    skip_blanks();
    if (!take('}')) {
      do {
        skip_blanks();
        std::string key;
        if (!string(key) || !expect(':')) return false;
        if (seen(key)) return fail("the key " + in_quotes(key) + " stands twice");
        if (seen_.size() == kMostKeys) return fail("the object has more than 256 keys");
        seen_.push_back(key);
        skip_blanks();
        if (!value(std::move(key))) return false;
      } while (take(','));
      if (!expect('}')) return false;
    }
    skip_blanks();
    if (!rest_.empty())
      return fail("expected nothing behind the object, found " + in_quotes(rest_));
    return true;
  }

  bool fail(std::string what) {
    fault = std::move(what);
    return false;
  }
  bool fail_here(const std::string& expected) {
    return fail("expected " + expected + " at byte " + std::to_string(size_ - rest_.size() + 1) +
                ", found " +
                (rest_.empty() ? "the end of the line" : in_quotes(rest_.substr(0, 20))));
  }
  [[nodiscard]] bool seen(std::string_view key) const {
    return std::find(seen_.begin(), seen_.end(), key) != seen_.end();
  }
  /// Whether a number comes next.
  [[nodiscard]] bool at_number() const {
    return !rest_.empty() && (rest_[0] == '-' || is_digit(rest_[0]));
  }

  /// -?(0|[1-9][0-9]*)(.[0-9]+)?([eE][+-]?[0-9]+)?
  bool number(double& value) {
    std::size_t i = 0;
    const auto at = [&] { return i < rest_.size() ? rest_[i] : '\0'; };
    const auto digits = [&] {
      const std::size_t first = i;
      while (is_digit(at())) ++i;
      return i > first;
    };
    if (at() == '-') ++i;
    bool well_formed = at() == '0' ? (++i, true) : digits();
    if (well_formed && at() == '.') well_formed = (++i, digits());
    if (well_formed && (at() == 'e' || at() == 'E')) {
      ++i;
      if (at() == '+' || at() == '-') ++i;
      well_formed = digits();
    }
    if (!well_formed || is_digit(at())) return fail_here("a JSON number");
    const ParsedNumber<double> parsed = parse_number(rest_.substr(0, i));
    if (!parsed.ok()) return fail_here("a number that a double can hold");
    value = parsed.value;
    rest_.remove_prefix(i);
    return true;
  }

  bool number_or_null(double& value) {
    if (!rest_.starts_with("null")) return number(value);
    rest_.remove_prefix(4);
    value = std::numeric_limits<double>::quiet_NaN();
    return true;
  }

  bool boolean(bool& value) {
    for (const bool is : {true, false}) {
      const std::string_view word = is ? "true" : "false";
      if (!rest_.starts_with(word)) continue;
      rest_.remove_prefix(word.size());
      value = is;
      return true;
    }
    return fail_here("true or false");
  }

  bool string(std::string& out) {
    if (!rest_.starts_with('"')) return fail_here("a string");
    rest_.remove_prefix(1);
    for (;;) {
      const std::size_t length = utf8_length(rest_);
      if (length == 0 || static_cast<unsigned char>(rest_[0]) < 0x20)
        return fail_here("UTF-8 text and a closing quotation mark");
      if (take_exactly('"')) return true;
      if (take_exactly('\\')) {
        if (!escape(out)) return false;
        continue;
      }
      out += rest_.substr(0, length);
      rest_.remove_prefix(length);
    }
  }

  bool skip_value(int depth = 0) {
    if (depth > kDeepest) return fail("objects and arrays are nested deeper than 32");
    skip_blanks();
    std::string ignored_text;
    double ignored_number = 0;
    if (rest_.starts_with('"')) return string(ignored_text);
    for (const std::string_view word : {"true", "false", "null"})
      if (rest_.starts_with(word)) {
        rest_.remove_prefix(word.size());
        return true;
      }
    const bool object = rest_.starts_with('{');
    if (!object && !rest_.starts_with('[')) return number(ignored_number);
    const char closing = object ? '}' : ']';
    rest_.remove_prefix(1);
    if (take(closing)) return true;
    do {
      skip_blanks();
      if (object && (!string(ignored_text) || !expect(':'))) return false;
      if (!skip_value(depth + 1)) return false;
    } while (take(','));
    return expect(closing);
  }

 private:
  static constexpr int kDeepest = 32;
  static constexpr std::size_t kMostKeys = 256;  // each is compared with all before it

  static bool is_digit(char c) { return c >= '0' && c <= '9'; }
  void skip_blanks() {
    while (!rest_.empty() && (rest_[0] == ' ' || rest_[0] == '\t' || rest_[0] == '\r'))
      rest_.remove_prefix(1);
  }
  bool take(char c) {
    skip_blanks();
    if (!rest_.starts_with(c)) return false;
    rest_.remove_prefix(1);
    return true;
  }
  bool expect(char c) { return take(c) || fail_here(std::string("'") + c + "'"); }

  bool hex4(std::uint32_t& code) {
    code = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      const char c = i < rest_.size() ? rest_[i] : '\0';
      std::uint32_t digit = 0;
      if (is_digit(c))
        digit = static_cast<std::uint32_t>(c - '0');
      else if (c >= 'a' && c <= 'f')
        digit = static_cast<std::uint32_t>(c - 'a') + 10;
      else if (c >= 'A' && c <= 'F')
        digit = static_cast<std::uint32_t>(c - 'A') + 10;
      else
        return fail_here("four hexadecimal digits");
      code = code * 16 + digit;
    }
    rest_.remove_prefix(4);
    return true;
  }

  bool escape(std::string& out) {
    constexpr std::string_view kLetters = "\"\\/bfnrt";
    constexpr std::string_view kMeanings = "\"\\/\b\f\n\r\t";
    const char letter = rest_.empty() ? '\0' : rest_[0];
    if (const std::size_t i = kLetters.find(letter); letter != '\0' && i != kLetters.npos) {
      out += kMeanings[i];
      rest_.remove_prefix(1);
      return true;
    }
    if (letter != 'u') return fail_here("an escape of JSON");
    rest_.remove_prefix(1);
    std::uint32_t code = 0;
    if (!hex4(code)) return false;
    if (code >= 0xD800 && code < 0xDC00) {  // first half of a surrogate pair
      std::uint32_t low = 0;
      if (!rest_.starts_with("\\u")) return fail_here("the second half of a surrogate pair");
      rest_.remove_prefix(2);
      if (!hex4(low)) return false;
      if (low < 0xDC00 || low > 0xDFFF) return fail_here("the second half of a surrogate pair");
      code = 0x10000 + ((code - 0xD800) << 10U) + (low - 0xDC00);
    } else if (code >= 0xDC00 && code < 0xE000) {
      return fail_here("the first half of a surrogate pair");
    }
    append_utf8(out, code);
    return true;
  }

  static void append_utf8(std::string& out, std::uint32_t code) {
    const auto tail = [&](unsigned shift) {
      out += static_cast<char>(0x80U | ((code >> shift) & 0x3FU));
    };
    if (code < 0x80) {
      out += static_cast<char>(code);
    } else if (code < 0x800) {
      out += static_cast<char>(0xC0U | (code >> 6U));
      tail(0);
    } else if (code < 0x10000) {
      out += static_cast<char>(0xE0U | (code >> 12U));
      tail(6);
      tail(0);
    } else {
      out += static_cast<char>(0xF0U | (code >> 18U));
      tail(12);
      tail(6);
      tail(0);
    }
  }

  bool take_exactly(char c) {
    if (!rest_.starts_with(c)) return false;
    rest_.remove_prefix(1);
    return true;
  }

  std::string_view rest_;
  std::size_t size_;
  std::vector<std::string> seen_;
};

}  // namespace servosense
