// The time of the rows of a foreign table.
#pragma once

#include <optional>
#include <string>

#include "servosense/io/import_plan.hpp"
#include "servosense/io/time_stamp.hpp"

namespace servosense::detail {

/// Reads times row by row. A clock that runs over midnight goes on.
class ImportClock {
 public:
  ImportClock(const ImportTime& time, DecimalMark mark) : time_(time), mark_(mark) {}
  /// Nanoseconds since whatever the column counts from; nothing when no time stands there.
  std::optional<Nanoseconds> read(const TableRow& row);
  [[nodiscard]] std::size_t midnights() const { return midnights_; }

 private:
  std::optional<Nanoseconds> stamp(const TableRow& row);

  ImportTime time_;
  DecimalMark mark_;
  std::size_t rows_ = 0, midnights_ = 0;
  std::optional<Nanoseconds> last_clock_;
};

/// What the times of a whole table are like.
struct TimeSurvey {
  std::size_t read = 0;
  std::size_t unread_line = 0;  ///< first row without a time; 0: none
  std::string unread;
  std::size_t not_later = 0, not_later_line = 0;
  std::size_t midnights = 0;
  Nanoseconds first_ns = 0, last_ns = 0;
  double median_step_s = 0, longest_step_s = 0;
};

/// Power of ten by which a unit of time is in seconds, and what is left: 60 of minutes.
void set_time_unit(ImportTime& time, double seconds);

}  // namespace servosense::detail
