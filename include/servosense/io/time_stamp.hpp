// Dates and clock times as logs write them, to the nanosecond.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "servosense/core/units.hpp"

namespace servosense {

struct TimeStamp {
  enum class Kind : std::uint8_t {
    date_and_clock,  ///< nanoseconds since 1970-01-01 00:00 (UTC where a zone is given)
    date,            ///< the same, of midnight
    clock            ///< nanoseconds since midnight
  };
  Kind kind = Kind::clock;
  Nanoseconds t_ns = 0;
  bool has_zone = false;
  bool day_or_month = false;  ///< 03/04/2024: nothing in it says which is which
};

/// 2024-05-01T12:30:00.125+02:00, 2024/05/01 12:30, 01.05.2024 12:30:00,125, 05/01/2024, 12:30:00,
/// 12:30:00:125 (milliseconds), 1:30:00 PM. Nothing for any other text.
[[nodiscard]] std::optional<TimeStamp> time_stamp_from(std::string_view text);

/// "2024-05-01T10:30:00.125", for nanoseconds since 1970-01-01.
[[nodiscard]] std::string date_text(Nanoseconds t_ns);

}  // namespace servosense
