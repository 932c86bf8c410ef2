// Columns of a drive that say the same thing twice: motor and scale, one motor of a gantry and the
// other, what the drive is told and what it does.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "servosense/core/servo_sample.hpp"
#include "servosense/io/drive_columns.hpp"

namespace servosense {

struct PairedColumns {
  struct Scaled {
    std::size_t column = 0;
    EffortKind kind = EffortKind::current_A;
    double scale = 1;  ///< A, Nm or N per unit of the column
  };
  Channel channel = Channel::x;
  DriveColumns drive;  ///< motion and effort; of a gantry the effort of the first motor
  std::optional<std::size_t> load;  ///< position [m] or angle [rad] behind the transmission
  std::optional<std::size_t> second_motion;  ///< of a gantry, in the unit of the first
  std::optional<std::size_t> second_effort;  ///< likewise
  std::optional<std::size_t> following;      ///< the following error; or, where that is false...
  bool following_is_error = false;           ///< ...the command, and the error is its distance
  std::optional<Scaled> command;             ///< of the effort

  /// Beside those of the drive.
  [[nodiscard]] std::vector<std::size_t> columns() const;
};

/// Of a drive with motion and effort in the trace; nothing where no column of it says anything
/// twice. A spindle has no following error: its loop is one of speed.
[[nodiscard]] std::optional<PairedColumns> paired_columns(const std::vector<Signal>& signals,
                                                          Channel channel,
                                                          const ColumnChoice& choice);

}  // namespace servosense
