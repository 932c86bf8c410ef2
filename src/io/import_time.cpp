#include "import_time.hpp"

#include <cmath>
#include <limits>

#include "trace_time.hpp"

namespace servosense::detail {

void set_time_unit(ImportTime& time, double seconds) {
  time.multiple = seconds > 1 ? static_cast<int>(std::lround(seconds)) : 1;
  time.exponent = seconds > 1 ? 0 : static_cast<int>(std::lround(std::log10(seconds)));
}

std::optional<Nanoseconds> ImportClock::stamp(const TableRow& row) {
  constexpr Nanoseconds kHalfDay = 43200 * kNanosecondsPerSecond;
  const auto stamp = time_stamp_from(row.fields[time_.column]);
  if (!stamp) return std::nullopt;
  if (stamp->kind != TimeStamp::Kind::clock) return stamp->t_ns;
  if (time_.date_column) {
    const auto date = time_stamp_from(row.fields[*time_.date_column]);
    if (!date || date->kind == TimeStamp::Kind::clock) return std::nullopt;
    return date->t_ns + stamp->t_ns;
  }
  if (last_clock_ && *last_clock_ - stamp->t_ns > kHalfDay) ++midnights_;
  last_clock_ = stamp->t_ns;
  return stamp->t_ns + static_cast<Nanoseconds>(midnights_) * 2 * kHalfDay;
}

std::optional<Nanoseconds> ImportClock::read(const TableRow& row) {
  switch (time_.source) {
    case ImportTime::Source::none:
      return std::nullopt;
    case ImportTime::Source::rate:
      return std::llround(static_cast<double>(rows_++) * 1e9 / time_.rate_hz);
    case ImportTime::Source::stamp:
      return stamp(row);
    case ImportTime::Source::number:
      break;
  }
  std::string digits = plain_number(row.fields[time_.column], mark_);
  if (digits.empty()) return std::nullopt;
  int exponent = time_.exponent;
  if (const std::size_t e = digits.find('e'); e != std::string::npos) {
    const auto written = parse_counts(std::string_view(digits).substr(e + 1));
    if (!written.ok() || std::abs(written.value) > 400) return std::nullopt;
    exponent += static_cast<int>(written.value);
    digits.resize(e);
  }
  if (exponent != 0) digits += "e" + std::to_string(exponent);
  const auto t = parse_time(digits);
  constexpr Nanoseconds kMost = std::numeric_limits<Nanoseconds>::max();
  if (!t.ok() || std::abs(t.value) > kMost / time_.multiple) return std::nullopt;
  return t.value * time_.multiple;
}

}  // namespace servosense::detail
