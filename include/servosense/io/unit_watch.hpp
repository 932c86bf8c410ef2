// Whether a drive's columns can be in the units that their names say.
//
// Looks at stretches of 8 rows and 20 ms at least, so that a value that stands for several rows is
// no burst of speed, and at the effort that eight values in a row have reached, so that spoilt rows
// do not count. A drive is refused when its speed, travel,
// acceleration or effort is beyond what machines do (core/plausible.hpp, or what the machine file
// says of this one) in at least three stretches and two in a hundred; for accelerations, which are
// brief, five stretches and one in two hundred. These shares are conventions: faults of single rows
// are the business of signal health.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/trace.hpp"

namespace servosense {

class UnitWatch {
 public:
  UnitWatch(Channel channel, const std::vector<Signal>& signals, const DriveColumns& columns,
            const ColumnChoice& choice);
  /// A row: its time, the motion in the units of the drive (for counts, the counts), the effort as
  /// recorded (a power in W); nothing where there is none.
  void add(double t_s, std::optional<double> motion, std::optional<double> effort);
  /// Sentence parts on what cannot be, with the likely unit; empty when all can be.
  [[nodiscard]] std::string finding() const;
  [[nodiscard]] std::size_t stretches() const { return stretches_; }

 private:
  /// How often a limit was passed, and by how much in the mean.
  struct Beyond {
    std::size_t count = 0;
    double sum = 0;
    void take(double value, double limit) {
      if (!(value > limit)) return;
      ++count;
      sum += value;
    }
    [[nodiscard]] double mean() const { return count > 0 ? sum / static_cast<double>(count) : 0; }
    [[nodiscard]] bool is_many(std::size_t of, std::size_t least, double share) const {
      return count >= least && static_cast<double>(count) >= share * static_cast<double>(of);
    }
  };
  void end_stretch(double t_s, double motion);
  [[nodiscard]] std::string unit_of_motion() const;

  bool turns_;
  std::string section_;  // of the machine file
  MotionKind kind_;
  std::string motion_, effort_;  // names of the columns; motion empty: not measured
  double scale_;                 // rad or m per unit of add()
  double max_speed_, max_travel_, max_acceleration_, max_effort_;
  bool own_effort_limit_ = false;
  Quantity quantity_ = Quantity::angle_counts;
  EffortKind effort_kind_;
  bool is_power_;

  bool started_ = false, has_speed_ = false;
  std::size_t rows_ = 0, stretches_ = 0;
  double from_s_ = 0, from_ = 0, speed_ = 0, lasting_ = 0, last_stretch_s_ = 0;
  double low_ = 0, high_ = 0;
  // Of eight values in a row the least, and the largest of those.
  std::size_t efforts_heard_ = 0;
  double least_effort_ = 0, largest_effort_ = 0;
  Beyond speeds_, accelerations_, efforts_, travels_;
};

/// Data error when a drive of the trace does what none can, or its rows are too far apart.
[[nodiscard]] Expected<Done> check_units(const Trace& trace, const ColumnChoices& choices,
                                         const std::string& name);

/// Whether the rate of a trace can be and is that of the machine file; a sentence with the remedy,
/// or empty. `stated_hz` 0: not stated. `seconds`: what one unit of its time is in truth.
struct RateFinding {
  std::string sentence;
  double seconds = 1;
};
[[nodiscard]] RateFinding check_rate(double period_s, double stated_hz, const std::string& machine);

}  // namespace servosense
