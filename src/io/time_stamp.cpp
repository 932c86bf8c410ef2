#include "servosense/io/time_stamp.hpp"

#include <array>
#include <chrono>

#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr Nanoseconds kSecond = kNanosecondsPerSecond;

/// Reads from the front of a text.
class StampReader {
 public:
  explicit StampReader(std::string_view text) : text_(text) {}

  [[nodiscard]] bool at_end() const { return text_.empty(); }
  [[nodiscard]] char peek() const { return text_.empty() ? '\0' : text_.front(); }
  bool take(char c) {
    if (peek() != c) return false;
    text_.remove_prefix(1);
    return true;
  }
  /// A whole number of `least` to `most` digits.
  std::optional<int> number(std::size_t least, std::size_t most) {
    std::size_t n = 0;
    int value = 0;
    while (n < text_.size() && n < most && is_digit(text_[n]))
      value = 10 * value + (text_[n++] - '0');
    if (n < least || (n < text_.size() && n == most && is_digit(text_[n]))) return std::nullopt;
    text_.remove_prefix(n);
    return value;
  }
  /// Digits behind a decimal mark, as nanoseconds; what is beyond the ninth is left away.
  std::optional<Nanoseconds> fraction() {
    std::size_t n = 0;
    Nanoseconds value = 0, weight = kSecond / 10;
    while (n < text_.size() && is_digit(text_[n])) {
      value += weight * (text_[n++] - '0');
      weight /= 10;
    }
    if (n == 0) return std::nullopt;
    text_.remove_prefix(n);
    return value;
  }
  bool word(std::string_view upper) {
    if (text_.size() < upper.size()) return false;
    for (std::size_t i = 0; i < upper.size(); ++i)
      if ((text_[i] & ~0x20) != upper[i]) return false;
    text_.remove_prefix(upper.size());
    return true;
  }
  void blanks() {
    while (take(' ')) {
    }
  }

 private:
  static bool is_digit(char c) { return c >= '0' && c <= '9'; }
  std::string_view text_;
};

std::optional<Nanoseconds> days_ns(int year, int month, int day) {
  const std::chrono::year_month_day date{std::chrono::year(year),
                                         std::chrono::month(static_cast<unsigned>(month)),
                                         std::chrono::day(static_cast<unsigned>(day))};
  // Nanoseconds reach from 1678 to 2262.
  if (!date.ok() || year < 1900 || year > 2200) return std::nullopt;
  return std::chrono::sys_days(date).time_since_epoch().count() * Nanoseconds{86400} * kSecond;
}

/// Date at the front; nothing if there is none.
std::optional<TimeStamp> date_of(StampReader& in) {
  TimeStamp stamp;
  stamp.kind = TimeStamp::Kind::date;
  const auto first = in.number(1, 4);
  const char mark = in.peek();
  if (!first || (mark != '-' && mark != '/' && mark != '.')) return std::nullopt;
  in.take(mark);
  const auto second = in.number(1, 2);
  if (!second || !in.take(mark)) return std::nullopt;
  const auto third = in.number(1, 4);
  if (!third) return std::nullopt;
  std::optional<Nanoseconds> midnight;
  if (*first > 31) {
    midnight = days_ns(*first, *second, *third);
  } else if (mark == '/') {
    const bool month_first = *second > 12;
    stamp.day_or_month = *first <= 12 && *second <= 12 && *first != *second;
    midnight = month_first ? days_ns(*third, *first, *second) : days_ns(*third, *second, *first);
  } else {
    midnight = days_ns(*third, *second, *first);
  }
  if (!midnight) return std::nullopt;
  stamp.t_ns = *midnight;
  return stamp;
}

/// Clock time to the end of the text; with `zone`, one may follow.
std::optional<Nanoseconds> clock_of(StampReader& in, bool zone, bool& has_zone) {
  const auto hour = in.number(1, 2);
  if (!hour || !in.take(':')) return std::nullopt;
  const auto minute = in.number(2, 2);
  if (!minute) return std::nullopt;
  std::optional<int> second = 0;
  Nanoseconds rest = 0;
  const bool has_seconds = in.take(':');
  if (has_seconds) {
    second = in.number(2, 2);
    if (!second) return std::nullopt;
    if (in.take('.') || in.take(',')) {
      const auto digits = in.fraction();
      if (!digits) return std::nullopt;
      rest = *digits;
    } else if (in.take(':')) {
      const auto milliseconds = in.number(3, 3);
      if (!milliseconds) return std::nullopt;
      rest = *milliseconds * (kSecond / 1000);
    }
  } else if (!zone) {
    return std::nullopt;  // 12:30 alone may be minutes and seconds
  }
  int hours = *hour;
  in.blanks();
  if (in.peek() == 'A' || in.peek() == 'a' || in.peek() == 'P' || in.peek() == 'p') {
    const bool evening = in.word("PM");
    if ((!evening && !in.word("AM")) || hours < 1 || hours > 12) return std::nullopt;
    hours = hours % 12 + (evening ? 12 : 0);
  }
  if (hours > 23 || *minute > 59 || *second > 60) return std::nullopt;
  Nanoseconds t = ((hours * Nanoseconds{60} + *minute) * 60 + *second) * kSecond + rest;
  if (!zone || in.at_end()) return in.at_end() ? std::optional(t) : std::nullopt;
  has_zone = true;
  if (in.word("Z") || in.word("UTC")) return in.at_end() ? std::optional(t) : std::nullopt;
  const bool west = in.peek() == '-';
  if (!in.take('-') && !in.take('+')) return std::nullopt;
  const auto zone_hours = in.number(2, 2);
  in.take(':');
  const auto zone_minutes = in.at_end() ? std::optional<int>(0) : in.number(2, 2);
  if (!zone_hours || !zone_minutes || !in.at_end() || *zone_hours > 14 || *zone_minutes > 59)
    return std::nullopt;
  const Nanoseconds ahead = (*zone_hours * Nanoseconds{60} + *zone_minutes) * 60 * kSecond;
  return west ? t + ahead : t - ahead;
}

}  // namespace

std::optional<TimeStamp> time_stamp_from(std::string_view text) {
  text = trim(text);
  constexpr std::size_t kLongest = 48;
  if (text.size() < 5 || text.size() > kLongest || text[0] < '0' || text[0] > '9')
    return std::nullopt;
  StampReader in(text);
  if (auto stamp = date_of(in)) {
    if (in.at_end()) return stamp;
    if (!in.take('T') && !in.take('t') && in.peek() != ' ' && in.peek() != '_' && in.peek() != '-')
      return std::nullopt;
    in.take('_') || in.take('-');
    in.blanks();
    const auto clock = clock_of(in, true, stamp->has_zone);
    if (!clock) return std::nullopt;
    stamp->kind = TimeStamp::Kind::date_and_clock;
    stamp->t_ns += *clock;
    return stamp;
  }
  StampReader again(text);
  bool no_zone = false;
  const auto clock = clock_of(again, false, no_zone);
  if (!clock) return std::nullopt;
  return TimeStamp{TimeStamp::Kind::clock, *clock, false, false};
}

std::string date_text(Nanoseconds t_ns) {
  constexpr Nanoseconds kDay = 86400 * kSecond;
  const Nanoseconds day = t_ns >= 0 ? t_ns / kDay : -((-t_ns + kDay - 1) / kDay);
  Nanoseconds rest = t_ns - day * kDay;
  const std::chrono::year_month_day date{
      std::chrono::sys_days(std::chrono::days(static_cast<int>(day)))};
  const Nanoseconds second = rest / kSecond;
  const auto part = [](long long value, int width) {
    std::string digits = std::to_string(value);
    while (static_cast<int>(digits.size()) < width) digits.insert(0, 1, '0');
    return digits;
  };
  std::string text = part(static_cast<int>(date.year()), 4) + "-" +
                     part(static_cast<unsigned>(date.month()), 2) + "-" +
                     part(static_cast<unsigned>(date.day()), 2) + "T" + part(second / 3600, 2) +
                     ":" + part(second / 60 % 60, 2) + ":" + part(second % 60, 2);
  rest %= kSecond;
  if (rest != 0) {
    std::string digits = part(rest, 9);
    while (digits.back() == '0') digits.pop_back();
    text += "." + digits;
  }
  return text;
}

}  // namespace servosense
