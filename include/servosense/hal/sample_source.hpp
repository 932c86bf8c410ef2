// Rows of signals, recorded or from a bus, as a drive source: one ServoSample per servo period.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/hal/load_torque.hpp"
#include "servosense/hal/row_source.hpp"
#include "servosense/hal/sample_clock.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/io/travel.hpp"
#include "servosense/io/unit_watch.hpp"

namespace servosense {

/// Counts of what the source found wrong with the recording.
struct SourceHealth {
  std::uint64_t rows = 0;
  std::uint64_t gaps = 0;             ///< places where at least one row is missing
  std::uint64_t missing_samples = 0;  ///< rows that should have been there
  std::uint64_t early = 0;            ///< rows that came before a period had passed: left out
  std::uint64_t untimed = 0;  ///< of which it is not sure which period they belong to: invalid
  double worst_jitter_s = 0;  ///< greatest deviation of a row from the clock of the record
};

/// A trace file as rows.
std::unique_ptr<RowSource> trace_rows(TraceReader reader);

/// Replays rows at their own rate, which period each belongs to by the recovered clock of their
/// stamps (hal/sample_clock.hpp). A hole in time is filled with samples marked `missing`, up to
/// `max_fill` of them and one more, so that blocks bridge short holes and restart after long ones.
/// A row too many is left out, the sample behind it marked `duplicate`; while the clock is not
/// locked, samples are marked `late` and invalid.
class SampleSource {
 public:
  static constexpr unsigned kMaxFill = 8;
  /// Looks at the first rows to find the rate. Data error when there are fewer than two rows or no
  /// drive has both motion and effort.
  /// Data error, too, when a column that was chosen is not there, or when the rate cannot be or is
  /// not the stated one; next() answers one when the columns cannot be in the units of their names.
  static Expected<SampleSource> open(std::unique_ptr<RowSource> rows, std::string name,
                                     unsigned max_fill = kMaxFill,
                                     const ColumnChoices& choices = {});
  /// The same of a trace file.
  static Expected<SampleSource> open(TraceReader reader, std::string name,
                                     unsigned max_fill = kMaxFill,
                                     const ColumnChoices& choices = {});

  [[nodiscard]] double sample_period_s() const { return period_s_; }
  /// Columns of a drive, where it has both motion and effort.
  [[nodiscard]] const std::optional<DriveColumns>& drive(Channel channel) const {
    const auto at = std::ranges::find(kDriveChannels, channel) - kDriveChannels.begin();
    return drives_[static_cast<std::size_t>(at)].columns;
  }
  [[nodiscard]] const std::optional<DriveColumns>& spindle() const {
    return drive(Channel::spindle);
  }
  [[nodiscard]] const std::optional<DriveColumns>& axis(std::size_t i) const {
    return drive(axis_channel(i));
  }
  /// Whether the controller reports its block, and its feed override.
  [[nodiscard]] bool has_blocks() const { return block_column_.has_value(); }
  [[nodiscard]] bool has_override() const { return override_column_.has_value(); }
  [[nodiscard]] const RowSource& reader() const { return *rows_; }
  [[nodiscard]] const SourceHealth& health() const { return health_; }

  /// Columns that something else uses, so that column_remarks() does not name them.
  void also_used(const std::vector<std::size_t>& columns) {
    also_used_.insert(also_used_.end(), columns.begin(), columns.end());
  }
  /// Something asks where the program is, and at what override: their columns are used.
  void program_used() {
    for (const auto& column : {block_column_, override_column_})
      if (column) also_used_.push_back(*column);
  }
  /// Of the columns that nothing uses: sentences for a reader.
  [[nodiscard]] std::vector<std::string> column_remarks() const;

  /// Of the columns that have told less than was needed, once the rows have been read: likewise.
  [[nodiscard]] std::vector<std::string> late_remarks() const;
  /// Last value of a motor's temperature [degC]; NaN where none is known.
  [[nodiscard]] double temperature_C(Channel channel) const;

  /// Next sample; false at the end.
  Expected<bool> next(MachineServoSample& sample);
  /// The same of spindle, x, y and z alone.
  Expected<bool> next(ServoSample<double>& sample);
  /// True when the last sample came from a row of the trace, false when it fills a hole.
  [[nodiscard]] bool recorded() const { return recorded_; }

 private:
  struct Drive;
  explicit SampleSource(std::unique_ptr<RowSource> rows) : rows_(std::move(rows)) {}
  Expected<bool> next_row(TraceRow& row);
  void fill(const TraceRow& row, MachineServoSample& sample);
  void hear_controller(const TraceRow& row);
  void fill_drive(const TraceRow& row, std::size_t drive, RawDriveSample<double>& to);
  /// Looks at the first rows for their rate and the phase of their clock.
  Expected<Done> find_rate();
  /// Data error when what the drives do cannot be; `seconds` that one of t_s is.
  [[nodiscard]] Expected<Done> check_units() const;
  [[nodiscard]] Expected<Done> check_clock();
  [[nodiscard]] std::uint64_t samples_of_hole(double missing) const;

  std::unique_ptr<RowSource> rows_;
  std::deque<TraceRow> ahead_;
  struct Drive {
    std::optional<DriveColumns> columns;
    std::optional<UnitWatch> units;
    Travel travel;
    std::array<double, 2> efforts{};  ///< of the motors of a gantry, the last of each
    LoadTorque load;                  ///< where a power or a load makes the effort
    MotorTemperature temperature;
  };
  /// What both motors of a gantry give.
  static TraceField joined(const TraceField& first, const TraceField& second, Drive& drive);
  std::array<Drive, kDriveChannels.size()> drives_;  ///< in that order
  MachineServoSample whole_;                         ///< of which a part was asked for
  ColumnChoices choices_;
  std::vector<std::size_t> also_used_;
  std::string name_;
  std::uint64_t to_check_ = kFirstCheck;  // row after which units are looked at
  static constexpr std::uint64_t kFirstCheck = 4096;
  std::optional<std::size_t> block_column_;
  std::optional<std::size_t> override_column_;
  std::int32_t block_ = kNoBlock;  // held while no new value arrives
  double override_ = 1;
  double period_s_ = 0;
  unsigned max_fill_ = 8;
  SourceHealth health_;
  TraceRow row_;
  bool waiting_ = false;       // row_ stands behind a hole that is being filled
  std::uint64_t to_fill_ = 0;  // samples of the hole, from the row before it...
  std::uint64_t filled_ = 0;   // ...and those given out
  Nanoseconds last_t_ns_ = 0;  // of the last row
  SampleClock clock_;
  bool heard_ = false;    // the clock has a phase already
  bool skipped_ = false;  // a row was left out behind the last one
  bool started_ = false;
  bool recorded_ = true;
};

}  // namespace servosense
