#include "servosense/io/json.hpp"

#include <cassert>
#include <cmath>
#include <ostream>
#include <string>

#include "servosense/io/text.hpp"

namespace servosense {

void JsonWriter::new_line() {
  if (indent_ <= 0) return;
  *out_ << '\n' << std::string(levels_.size() * static_cast<std::size_t>(indent_), ' ');
}

void JsonWriter::before_value() {
  if (after_key_ || levels_.empty()) {
    after_key_ = false;
    return;
  }
  assert(levels_.back().closing == ']' && "a value in an object needs a key");
  separate();
}

void JsonWriter::separate() {
  if (!levels_.back().empty) *out_ << (indent_ > 0 ? "," : ", ");
  levels_.back().empty = false;
  new_line();
}

void JsonWriter::begin(char opening, char closing) {
  before_value();
  *out_ << opening;
  levels_.push_back({closing, true});
}

void JsonWriter::end(char closing) {
  assert(!levels_.empty() && levels_.back().closing == closing && !after_key_);
  const bool empty = levels_.back().empty;
  levels_.pop_back();
  if (!empty) new_line();
  *out_ << closing;
  if (levels_.empty() && indent_ > 0) *out_ << '\n';
}

void JsonWriter::key(std::string_view name) {
  assert(!levels_.empty() && levels_.back().closing == '}' && !after_key_);
  separate();
  string(name);
  *out_ << ": ";
  after_key_ = true;
}

void JsonWriter::literal(std::string_view text) {
  before_value();
  *out_ << text;
}

void JsonWriter::value(double number) {
  literal(std::isfinite(number) ? number_text(number) : "null");
}

void JsonWriter::value(std::nullptr_t) { literal("null"); }

void JsonWriter::value(std::string_view text) {
  before_value();
  string(text);
}

void JsonWriter::signed_integer(std::int64_t number) { literal(std::to_string(number)); }
void JsonWriter::unsigned_integer(std::uint64_t number) { literal(std::to_string(number)); }

void JsonWriter::string(std::string_view text) {
  constexpr std::string_view kHex = "0123456789abcdef";
  std::ostream& out = *out_;
  out << '"';
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    const auto first = static_cast<unsigned char>(text.front());
    if (length == 0)
      out << "\xEF\xBF\xBD";  // U+FFFD
    else if (first == '"' || first == '\\')
      out << '\\' << text.front();
    else if (first == '\n')
      out << "\\n";
    else if (first == '\r')
      out << "\\r";
    else if (first == '\t')
      out << "\\t";
    else if (first < 0x20)
      out << "\\u00" << kHex[first >> 4U] << kHex[first & 15U];
    else
      out << text.substr(0, length);
    text.remove_prefix(length == 0 ? 1 : length);
  }
  out << '"';
}

}  // namespace servosense
