#include "table_text.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "servosense/io/text.hpp"

namespace servosense::detail {
namespace {

constexpr std::size_t kTextBlock = std::size_t{1} << 16U;

void append_utf8(std::string& out, unsigned code) {
  const auto byte = [&](unsigned value) { out += static_cast<char>(value); };
  if (code < 0x80) {
    byte(code);
  } else if (code < 0x800) {
    byte(0xC0U | (code >> 6U));
    byte(0x80U | (code & 0x3FU));
  } else if (code < 0x10000) {
    byte(0xE0U | (code >> 12U));
    byte(0x80U | ((code >> 6U) & 0x3FU));
    byte(0x80U | (code & 0x3FU));
  } else {
    byte(0xF0U | (code >> 18U));
    byte(0x80U | ((code >> 12U) & 0x3FU));
    byte(0x80U | ((code >> 6U) & 0x3FU));
    byte(0x80U | (code & 0x3FU));
  }
}

bool is_ascii(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return (c & 0x80) == 0; });
}

bool is_utf8(std::string_view text) {
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    if (length == 0) return false;
    text.remove_prefix(length);
  }
  return true;
}

/// Latin-1 as Windows writes it, where dashes and quotation marks stand below 0xA0.
std::string from_latin1(std::string_view text) {
  std::string out;
  for (const char c : text) {
    unsigned code = static_cast<unsigned char>(c);
    if (code >= 0x91 && code <= 0x94) code = code < 0x93 ? 0x27 : 0x22;
    if (code == 0x96 || code == 0x97) code = 0x2013;
    if (code == 0x80) code = 0x20AC;
    append_utf8(out, code);
  }
  return out;
}

bool is_binary(std::string_view line) {
  return std::any_of(line.begin(), line.end(), [](char c) {
    const auto code = static_cast<unsigned char>(c);
    return code < 0x20 && c != '\t' && c != '\f' && c != '\v' && c != 0x1A;
  });
}

constexpr const char* kBinary =
    "the line holds bytes that are no text; give the export as a text file (CSV), not the "
    "recording of the tool itself";

}  // namespace

TableText::TableText(std::unique_ptr<std::istream> stream, std::string name)
    : stream_(std::move(stream)), name_(printable(name, 400)) {
  find_encoding();
}

std::string TableText::encoding() const {
  if (encoding_ == Encoding::utf16_le) return "UTF-16 LE";
  if (encoding_ == Encoding::utf16_be) return "UTF-16 BE";
  return latin1_ ? "Latin-1" : "UTF-8";
}

Error TableText::error_at(std::size_t line, std::string_view what) const {
  return data_error(name_ + ":" + std::to_string(line) + ": " + std::string(what));
}

bool TableText::refill() {
  if (buffer_.size() < kTextBlock) buffer_.resize(kTextBlock);
  const std::size_t left = end_ - at_;
  if (left > 0) std::memmove(buffer_.data(), buffer_.data() + at_, left);
  at_ = 0;
  end_ = left;
  if (buffer_.size() < end_ + kTextBlock) buffer_.resize(end_ + kTextBlock);
  stream_->read(buffer_.data() + end_, static_cast<std::streamsize>(kTextBlock));
  const auto got = static_cast<std::size_t>(stream_->gcount());
  end_ += got;
  return got > 0;
}

void TableText::find_encoding() {
  refill();
  const std::string_view start(buffer_.data(), end_);
  std::size_t mark = 0;
  if (start.starts_with("\xEF\xBB\xBF")) {
    mark = 3;
  } else if (start.starts_with("\xFF\xFE")) {
    encoding_ = Encoding::utf16_le;
    mark = 2;
  } else if (start.starts_with("\xFE\xFF")) {
    encoding_ = Encoding::utf16_be;
    mark = 2;
  } else if (start.size() >= 8) {
    // Without a mark: text of ASCII characters has a zero in every other byte.
    const std::size_t pairs = std::min<std::size_t>(start.size(), 256) / 2;
    std::size_t even = 0, odd = 0;
    for (std::size_t i = 0; i < pairs; ++i) {
      if (start[2 * i] == '\0') ++even;
      if (start[2 * i + 1] == '\0') ++odd;
    }
    if (10 * even < odd && odd > pairs * 6 / 10) encoding_ = Encoding::utf16_le;
    if (10 * odd < even && even > pairs * 6 / 10) encoding_ = Encoding::utf16_be;
  }
  at_ = mark;
  bytes_ = mark;
}

Expected<Done> TableText::rewind() {
  stream_->clear();
  stream_->seekg(0);
  if (!*stream_)
    return device_error(name_ + ": cannot be read a second time; give a file, no pipe");
  at_ = end_ = 0;
  line_ = record_line_ = 0;
  after_cr_ = false;
  find_encoding();
  return Done{};
}

bool TableText::unit(unsigned& code) {
  if (end_ - at_ < 2 && (!refill() || end_ - at_ < 2)) return false;
  const unsigned first = static_cast<unsigned char>(buffer_[at_]);
  const unsigned second = static_cast<unsigned char>(buffer_[at_ + 1]);
  at_ += 2;
  bytes_ += 2;
  code = encoding_ == Encoding::utf16_le ? first | (second << 8U) : (first << 8U) | second;
  return true;
}

Expected<bool> TableText::wide_line(std::string& line) {
  line.clear();
  unsigned code = 0;
  bool any = false;
  while (unit(code)) {
    if (code == '\n' && after_cr_) {
      after_cr_ = false;
      continue;
    }
    any = true;
    after_cr_ = code == '\r';
    if (code == '\n' || code == '\r') break;
    if (code >= 0xD800 && code < 0xDC00) {
      unsigned low = 0;
      const bool paired = unit(low) && low >= 0xDC00 && low < 0xE000;
      code = paired ? 0x10000U + ((code - 0xD800U) << 10U) + (low - 0xDC00U) : 0xFFFDU;
    } else if (code >= 0xDC00 && code < 0xE000) {
      code = 0xFFFD;
    }
    append_utf8(line, code);
    if (line.size() > kLongestRecord) break;
  }
  if (any) ++line_;
  return any;
}

Expected<bool> TableText::physical_line(std::string& line) {
  if (encoding_ != Encoding::bytes) return wide_line(line);
  line.clear();
  bool any = false, ended = false;
  while (!ended) {
    if (at_ == end_ && !refill()) {
      if (stream_->bad())
        return device_error(name_ + ": reading failed after line " + std::to_string(line_) +
                            "; check the disk or the connection");
      break;
    }
    if (after_cr_ && buffer_[at_] == '\n') {
      ++at_;
      ++bytes_;
      after_cr_ = false;
      continue;
    }
    after_cr_ = false;
    any = true;
    const char* const begin = buffer_.data() + at_;
    const char* const stop = buffer_.data() + end_;
    const char* const found =
        std::find_if(begin, stop, [](char c) { return c == '\n' || c == '\r'; });
    line.append(begin, found);
    ended = found != stop;
    after_cr_ = ended && *found == '\r';
    const auto taken = static_cast<std::size_t>(found - begin) + (ended ? 1U : 0U);
    at_ += taken;
    bytes_ += taken;
    if (line.size() > kLongestRecord) break;
  }
  if (!any) return false;
  ++line_;
  if (!is_ascii(line) && !is_utf8(line)) {
    latin1_ = true;
    line = from_latin1(line);
  }
  return true;
}

Expected<bool> TableText::next(std::string& record) {
  constexpr std::size_t kMostLines = 50;  // of a field in quotation marks
  auto more = physical_line(record);
  if (!more || !*more) return more;
  record_line_ = line_;
  std::string rest;
  while (record.find('"') != std::string::npos && quotation_is_open(record)) {
    more = line_ - record_line_ < kMostLines ? physical_line(rest) : Expected<bool>(false);
    if (!more) return more;
    if (!*more)
      return error_at(record_line_,
                      "a quotation mark opens a field here and is not closed in the " +
                          std::to_string(kMostLines) + " lines behind it; close it or remove it");
    record += '\n' + rest;
  }
  if (record.size() > kLongestRecord)
    return error_at(record_line_,
                    "the line is longer than 1 MiB; give a text file with one row a line");
  for (std::string_view left = record; !left.empty();) {
    const std::size_t line_end = left.find('\n');
    if (is_binary(left.substr(0, line_end))) return error_at(record_line_, kBinary);
    if (line_end == std::string_view::npos) break;
    left.remove_prefix(line_end + 1);
  }
  return true;
}

bool quotation_is_open(std::string_view text) {
  bool open = false, field_begins = true;
  for (const char c : text) {
    if (open) {
      // A doubled mark closes and opens again.
      if (c == '"') {
        open = false;
        field_begins = true;
      }
      continue;
    }
    if (c == '"' && field_begins) {
      open = true;
      continue;
    }
    if (c == ';' || c == ',' || c == '\t' || c == '|')
      field_begins = true;
    else if (c != ' ')
      field_begins = false;
  }
  return open;
}

namespace {

/// The field in quotation marks at the front of `record`, which it is taken from.
std::string_view quoted_field(std::string_view& record, std::vector<std::string>& unquoted) {
  std::size_t close = 1;
  bool doubled = false;
  for (; close < record.size(); ++close) {
    if (record[close] != '"') continue;
    if (close + 1 == record.size() || record[close + 1] != '"') break;
    doubled = true;
    ++close;
  }
  std::string_view field = record.substr(1, std::min(close, record.size()) - 1);
  record.remove_prefix(std::min(close + 1, record.size()));
  if (!doubled) return trim(field);
  std::string plain;
  for (std::size_t i = 0; i < field.size(); ++i) {
    plain += field[i];
    if (field[i] == '"') ++i;
  }
  unquoted.push_back(std::move(plain));
  return trim(unquoted.back());
}

}  // namespace

void split_record(std::string_view record, char separator, std::vector<std::string_view>& fields,
                  std::vector<std::string>& unquoted) {
  fields.clear();
  unquoted.clear();
  unquoted.reserve(static_cast<std::size_t>(std::count(record.begin(), record.end(), '"')));
  const bool blanks = separator == ' ';
  const auto is_end = [&](char c) { return blanks ? c == ' ' || c == '\t' : c == separator; };
  const auto skip_blanks = [&] {
    while (!record.empty() &&
           (record.front() == ' ' || (record.front() == '\t' && separator != '\t')))
      record.remove_prefix(1);
  };
  if (separator == '\0') {
    const std::string_view whole = trim(record);
    record = whole;
    fields.push_back(whole.starts_with('"') ? quoted_field(record, unquoted) : whole);
    return;
  }
  for (;;) {
    skip_blanks();
    if (blanks && record.empty() && !fields.empty()) return;
    std::string_view quoted;
    const bool in_quotes = record.starts_with('"');
    if (in_quotes) quoted = quoted_field(record, unquoted);
    std::size_t stop = 0;
    while (stop < record.size() && !is_end(record[stop])) ++stop;
    fields.push_back(in_quotes ? quoted : trim(record.substr(0, stop)));
    if (stop == record.size()) return;
    record.remove_prefix(stop + 1);
  }
}

}  // namespace servosense::detail
