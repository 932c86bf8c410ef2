#include "servosense/io/candump.hpp"

#include <charconv>
#include <cstdio>
#include <limits>
#include <utility>

#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr std::uint32_t kErrorFlag = 0x20000000;
constexpr std::uint32_t kExtendedMask = 0x1FFFFFFF;
constexpr std::uint32_t kStandardMask = 0x7FF;

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::string_view next_word(std::string_view& rest) {
  rest = trim(rest);
  const std::size_t end = rest.find_first_of(" \t");
  const std::string_view word = rest.substr(0, end);
  rest.remove_prefix(word.size());
  return word;
}

Expected<Nanoseconds> parse_log_time(std::string_view word) {
  const auto wrong = [&] {
    return data_error("expected a time like (1436509052.249713), found " + in_quotes(word));
  };
  if (word.size() < 3 || word.front() != '(' || word.back() != ')') return wrong();
  const std::string_view number = word.substr(1, word.size() - 2);
  const std::size_t dot = number.find('.');
  const std::string_view whole = number.substr(0, dot);
  const std::string_view part = dot == std::string_view::npos ? "" : number.substr(dot + 1);
  std::int64_t seconds = 0;
  const auto [end, fault] = std::from_chars(whole.data(), whole.data() + whole.size(), seconds);
  if (fault != std::errc{} || end != whole.data() + whole.size() || seconds < 0 ||
      seconds >= std::numeric_limits<Nanoseconds>::max() / kNanosecondsPerSecond)
    return wrong();
  if (part.size() > 9 || (dot != std::string_view::npos && part.empty())) return wrong();
  Nanoseconds t_ns = seconds * kNanosecondsPerSecond;
  Nanoseconds place = kNanosecondsPerSecond;
  for (const char c : part) {
    if (c < '0' || c > '9') return wrong();
    place /= 10;
    t_ns += (c - '0') * place;
  }
  return t_ns;
}

// Pairs of digits, dots allowed between them.
Expected<Done> parse_bytes(std::string_view text, CanFrame& frame) {
  std::size_t n = 0;
  while (!text.empty()) {
    if (n > 0 && text.front() == '.') text.remove_prefix(1);
    const int high = text.empty() ? -1 : hex_digit(text[0]);
    const int low = text.size() < 2 ? -1 : hex_digit(text[1]);
    if (high < 0 || low < 0)
      return data_error("expected pairs of hexadecimal digits, found " + in_quotes(text));
    if (n == (frame.fd ? CanFrame::kMaxBytes : 8))
      return data_error(frame.fd ? "more than the 64 bytes of an FD frame"
                                 : "more than the 8 bytes of a classic frame; FD has '##'");
    frame.data[n++] = static_cast<std::uint8_t>(high * 16 + low);
    text.remove_prefix(2);
  }
  if (frame.fd && !is_fd_length(n))
    return data_error(std::to_string(n) +
                      " bytes, which no FD frame has (0 to 8, 12, 16, 20, 24, 32, 48 or 64)");
  frame.length = static_cast<std::uint8_t>(n);
  return Done{};
}

Expected<Done> parse_frame(std::string_view text, CanFrame& frame) {
  const std::size_t hash = text.find('#');
  if (hash != 3 && hash != 8)
    return data_error("expected an identifier of 3 or 8 digits and '#', found " + in_quotes(text));
  std::uint32_t id = 0;
  for (const char c : text.substr(0, hash)) {
    const int digit = hex_digit(c);
    if (digit < 0)
      return data_error("expected a hexadecimal identifier, found " +
                        in_quotes(text.substr(0, hash)));
    id = id * 16 + static_cast<std::uint32_t>(digit);
  }
  frame.error = hash == 8 && (id & kErrorFlag) != 0;
  frame.extended = hash == 8 && !frame.error;
  frame.id = id & (hash == 8 ? kExtendedMask : kStandardMask);
  if (id != (frame.id | (frame.error ? kErrorFlag : 0U)))
    return data_error("identifier " + in_quotes(text.substr(0, hash)) +
                      (hash == 8 ? " has more than 29 bits" : " has more than 11 bits"));
  std::string_view data = text.substr(hash + 1);
  if (!data.empty() && data.front() == '#') {
    data.remove_prefix(1);
    if (!data.empty() && data.front() == '#') return data_error("a CAN XL frame, not understood");
    const int flags = data.empty() ? -1 : hex_digit(data.front());
    if (flags < 0) return data_error("expected one digit of flags behind '##'");
    frame.fd = true;
    frame.bit_rate_switch = (flags & 1) != 0;
    frame.error_state_indicator = (flags & 2) != 0;
    return parse_bytes(data.substr(1), frame);
  }
  const std::size_t code = data.find('_');
  if (code != std::string_view::npos) {  // raw length code above 8: eight bytes all the same
    const std::string_view digit = data.substr(code + 1);
    if (digit.size() != 1 || hex_digit(digit[0]) < 9)
      return data_error("expected a length code _9 to _F, found " + in_quotes(data.substr(code)));
    data = data.substr(0, code);
  }
  if (!data.empty() && (data.front() == 'R' || data.front() == 'r')) {
    data.remove_prefix(1);
    if (data.size() > 1 || (data.size() == 1 && (data[0] < '0' || data[0] > '8')))
      return data_error("expected R or R0 to R8, found " + in_quotes(text.substr(hash + 1)));
    frame.remote = true;
    frame.length = data.empty() ? std::uint8_t{0} : static_cast<std::uint8_t>(data[0] - '0');
    return Done{};
  }
  return parse_bytes(data, frame);
}

}  // namespace

Expected<CandumpLine> parse_candump_line(std::string_view line) {
  CandumpLine result;
  std::string_view rest = line;
  const auto time = parse_log_time(next_word(rest));
  if (!time) return time.error();
  const std::string_view interface = next_word(rest);
  const std::string_view text = next_word(rest);
  if (text.empty())
    return data_error(
        "expected time, interface and frame, as 'candump -L' writes them: "
        "(1436509052.249713) can0 244#2A366C2BBA");
  result.frame.t_ns = *time;
  result.interface = interface;
  if (auto done = parse_frame(text, result.frame); !done) return done.error();
  const std::string_view direction = next_word(rest);
  if (!(direction.empty() || direction == "T" || direction == "R") || !trim(rest).empty())
    return data_error("expected nothing behind the frame but T or R, found " +
                      in_quotes(direction));
  return result;
}

std::string candump_line(const CanFrame& frame, std::string_view interface) {
  char text[64];
  const auto seconds = static_cast<long long>(frame.t_ns / kNanosecondsPerSecond);
  const auto rest = static_cast<long long>(frame.t_ns % kNanosecondsPerSecond);
  if (rest % 1000 == 0)
    std::snprintf(text, sizeof text, "(%010lld.%06lld) ", seconds, rest / 1000);
  else
    std::snprintf(text, sizeof text, "(%010lld.%09lld) ", seconds, rest);
  std::string out = text;
  out += interface;
  const bool wide = frame.extended || frame.error;
  std::snprintf(text, sizeof text, wide ? " %08X#" : " %03X#",
                static_cast<unsigned>(frame.id | (frame.error ? kErrorFlag : 0U)));
  out += text;
  if (frame.remote) {
    out += 'R';
    if (frame.length > 0) out += static_cast<char>('0' + frame.length);
    return out;
  }
  if (frame.fd) {
    out += '#';
    out += static_cast<char>('0' + (frame.bit_rate_switch ? 1 : 0) +
                             (frame.error_state_indicator ? 2 : 0));
  }
  constexpr std::string_view digits = "0123456789ABCDEF";
  for (const std::uint8_t byte : frame.bytes()) {
    out += digits[byte >> 4U];
    out += digits[byte & 15U];
  }
  return out;
}

Expected<CandumpReader> CandumpReader::open(const std::string& path, std::string interface) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  return from_stream(std::move(*stream), path, std::move(interface));
}

CandumpReader CandumpReader::from_stream(std::unique_ptr<std::istream> stream, std::string name,
                                         std::string interface) {
  return {LineReader(std::move(stream), std::move(name)), std::move(interface)};
}

Expected<bool> CandumpReader::next(CanFrame& frame) {
  std::string_view line;
  for (;;) {
    auto more = lines_.next(line);
    if (!more) return more.error();
    if (!*more) return false;
    const std::string_view content = trim(line);
    if (content.empty() || content.front() == '#') continue;
    auto parsed = parse_candump_line(content);
    if (!parsed) return lines_.error_here(parsed.error().sentence);
    if (!interface_.empty() && parsed->interface != interface_) continue;
    frame = parsed->frame;
    return true;
  }
}

}  // namespace servosense
