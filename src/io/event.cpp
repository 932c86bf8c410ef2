#include "servosense/io/event.hpp"

#include <algorithm>
#include <cstdint>
#include <istream>
#include <limits>
#include <span>
#include <sstream>

#include "servosense/io/json.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

/// Reads the JSON (RFC 8259) of one event. Every function returns false at the first fault and
/// leaves the sentence in `fault`.
class EventParser {
 public:
  explicit EventParser(std::string_view text) : rest_(text), size_(text.size()) {}

  std::string fault;

  bool parse(Event& event) {
    skip_blanks();
    if (!expect('{')) return false;
    skip_blanks();
    if (!take('}')) {
      do {
        if (!member(event)) return false;
      } while (take(','));
      if (!expect('}')) return false;
    }
    skip_blanks();
    if (!rest_.empty())
      return fail("expected nothing behind the object, found " + in_quotes(rest_));
    for (const std::string_view key : kKeys)
      if (!seen(key)) return fail("the key '" + std::string(key) + "' is missing");
    const auto monitor = monitor_from(monitor_);
    if (!monitor) return unknown("monitor", monitor_, kMonitorNames);
    const auto state = monitor_state_from(state_);
    if (!state) return unknown("state", state_, kMonitorStateNames);
    event.monitor = *monitor;
    event.state = *state;
    return true;
  }

 private:
  static constexpr std::array<std::string_view, 8> kKeys = {
      "t_s", "monitor", "channel", "state", "value", "threshold", "unit", "reason"};
  static constexpr int kDeepest = 32;
  static constexpr std::size_t kMostKeys = 256;  // each is compared with all before it

  bool fail(std::string what) {
    fault = std::move(what);
    return false;
  }
  bool fail_here(const std::string& expected) {
    return fail("expected " + expected + " at byte " + std::to_string(size_ - rest_.size() + 1) +
                ", found " +
                (rest_.empty() ? "the end of the line" : in_quotes(rest_.substr(0, 20))));
  }
  bool unknown(const char* what, std::string_view name, std::span<const std::string_view> names) {
    return fail(std::string("unknown ") + what + " " + in_quotes(name) +
                ", the nearest known one is '" + std::string(nearest_name(name, names)) + "'");
  }
  [[nodiscard]] bool seen(std::string_view key) const {
    return std::find(seen_.begin(), seen_.end(), key) != seen_.end();
  }

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

  bool member(Event& event) {
    skip_blanks();
    std::string key;
    if (!string(key) || !expect(':')) return false;
    if (seen(key)) return fail("the key " + in_quotes(key) + " stands twice");
    if (seen_.size() == kMostKeys) return fail("the object has more than 256 keys");
    seen_.push_back(key);
    skip_blanks();
    if (key == "t_s") return number_or_null(event.t_s);
    if (key == "value") return number_or_null(event.value);
    if (key == "threshold") return number_or_null(event.threshold);
    if (key == "monitor") return string(monitor_);
    if (key == "channel") return string(event.channel);
    if (key == "state") return string(state_);
    if (key == "unit") return string(event.unit);
    if (key == "reason") return string(event.reason);
    if (!rest_.empty() && (rest_[0] == '-' || is_digit(rest_[0]))) {
      double value = 0;
      if (!number(value)) return false;
      event.extra.emplace_back(std::move(key), value);
      return true;
    }
    return skip_value(0);
  }

  static bool is_digit(char c) { return c >= '0' && c <= '9'; }

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
  bool take_exactly(char c) {
    if (!rest_.starts_with(c)) return false;
    rest_.remove_prefix(1);
    return true;
  }

  bool skip_value(int depth) {
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

  std::string_view rest_;
  std::size_t size_;
  std::vector<std::string> seen_;
  std::string monitor_, state_;  // as they are spelled
};

}  // namespace

void write_event(JsonWriter& json, const Event& event, const std::function<void()>& more) {
  json.begin_object();
  json.member("t_s", event.t_s);
  json.member("monitor", name_of(event.monitor));
  json.member("channel", event.channel);
  json.member("state", name_of(event.state));
  json.member("value", event.value);
  json.member("threshold", event.threshold);
  json.member("unit", event.unit);
  json.member("reason", event.reason);
  for (const auto& [name, number] : event.extra) json.member(name, number);
  if (more) more();
  json.end_object();
}

std::string to_json_line(const Event& event) {
  std::ostringstream out;
  JsonWriter json(out);
  write_event(json, event);
  return std::move(out).str();
}

Expected<Event> event_from_json(std::string_view line, const std::string& where) {
  Event event;
  EventParser parser(line);
  if (parser.parse(event)) return event;
  return data_error(where + ": " + parser.fault +
                    "; give one JSON object a line, as servosense monitor writes it");
}

Expected<std::vector<Event>> read_events(const std::string& path) {
  Expected<std::unique_ptr<std::istream>> file = open_for_reading(path);
  if (!file) return file.error();
  return read_events(std::move(*file), path);
}

Expected<std::vector<Event>> read_events(std::unique_ptr<std::istream> stream, std::string name) {
  LineReader lines(std::move(stream), std::move(name));
  std::vector<Event> events;
  for (;;) {
    std::string_view line;
    const Expected<bool> more = lines.next(line);
    if (!more) return more.error();
    if (!*more) return events;
    if (trim(line).empty()) continue;
    Expected<Event> event =
        event_from_json(line, lines.name() + ":" + std::to_string(lines.line_number()));
    if (!event) return event.error();
    events.push_back(std::move(*event));
  }
}

}  // namespace servosense
