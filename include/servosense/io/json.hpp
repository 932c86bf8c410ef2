// JSON as every command writes it (RFC 8259): to a stream, without building a document first.
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <string_view>
#include <vector>

namespace servosense {

/// Writes one JSON value after the other. Commas, colons, line ends and escapes are its business;
/// that keys stand in objects, and that what was begun is ended, is the caller's (asserted).
///
///   JsonWriter json(std::cout);
///   json.begin_object();
///   json.member("channel", "x");
///   json.values("gaps", gaps);
///   json.end_object();
class JsonWriter {
 public:
  /// `indent` blanks a level; 0 puts everything on one line, as JSON Lines need it.
  explicit JsonWriter(std::ostream& out, int indent = 0) : out_(&out), indent_(indent) {}

  void begin_object() { begin('{', '}'); }
  void end_object() { end('}'); }
  void begin_array() { begin('[', ']'); }
  void end_array() { end(']'); }

  void key(std::string_view name);

  /// Shortest spelling that reads back as the same double; null if it is not finite.
  void value(double number);
  void value(std::string_view text);  ///< bytes that are not UTF-8 become U+FFFD
  void value(const char* text) { value(std::string_view(text)); }
  void value(std::nullptr_t);
  template <std::same_as<bool> Flag>
  void value(Flag flag) {
    literal(flag ? "true" : "false");
  }
  template <std::integral Integer>
  requires(!std::same_as<Integer, bool>) void value(Integer number) {
    if constexpr (std::unsigned_integral<Integer>)
      unsigned_integer(number);
    else
      signed_integer(number);
  }

  template <typename T>
  void member(std::string_view name, const T& content) {
    key(name);
    value(content);
  }
  /// A member that is an array of values.
  template <typename Range>
  void values(std::string_view name, const Range& all) {
    key(name);
    begin_array();
    for (const auto& one : all) value(one);
    end_array();
  }
  /// A member that is an array of objects; `write(one)` writes the members of each.
  template <typename Range, typename Write>
  void objects(std::string_view name, const Range& all, Write write) {
    key(name);
    begin_array();
    for (const auto& one : all) {
      begin_object();
      write(one);
      end_object();
    }
    end_array();
  }

 private:
  struct Level {
    char closing;
    bool empty;
  };
  void begin(char opening, char closing);
  void end(char closing);
  void before_value();
  void separate();
  void new_line();
  void literal(std::string_view text);
  void string(std::string_view text);
  void signed_integer(std::int64_t number);
  void unsigned_integer(std::uint64_t number);

  std::ostream* out_;
  int indent_;
  bool after_key_ = false;
  std::vector<Level> levels_;
};

}  // namespace servosense
