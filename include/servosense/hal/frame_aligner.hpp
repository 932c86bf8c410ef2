// From frames of several drives to one row per servo period.
//
// Purpose: frames arrive late, early, twice, out of order, not at all, and by clocks that drift.
// The aligner finds the servo period each belongs to, and gives out rows in order, each with what
// came. Which period a frame belongs to is known, the better the further up:
//   sequence  the frame carries a counter: exact, whatever the timing
//   sync      a SYNC frame opens every period: the frame belongs to the last one
//   time      neither: frames are counted, and compared with the clock of their stream, which is
//             recovered (hal/sample_clock.hpp; drift up to 0.2 %). A frame that is late may be
//             late, or follow lost ones. It is held back until the stream has caught up (late:
//             nothing was lost) or `wait` rows have passed (so many were lost).
// Stamps that jump (a clock that is set, a frame stamped far away) fit no period: such frames are
// left out until SampleClock::kBelieved of one stream have come in a row; a counter that has gone
// on is then believed, else the time. What was left out is lost, and the values of the next
// kDistrusted rows are invalid, so that nobody bridges from one clock to the other. Without a
// counter they are invalid, too, while the clock (of the stream, or of SYNC) is not locked, and
// while SYNC is late: one may be lost; with a counter, when a frame comes before its time.
// A row is given out when every stream has delivered, or when a frame `wait` rows younger has come.
// Repairs, all counted: lost (a due value is marked invalid), duplicate and late frames (dropped),
// reordered ones (put in their place).
// Delay: none when all is well, else up to longest_delay_rows(). Memory: fixed after construction;
// push() and pop() take none. Frames that stand still longer than the ring are a new start: a hole
// in time.
// Bad at: a frame that comes twice right behind a lost one, without a counter (hides the loss);
// bursts longer than `wait` rows in streams without a counter; streams whose frames come at no
// fixed rate; without counters, a clock that is set ahead by one period (looks like one lost
// frame).
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/hal/sample_clock.hpp"
#include "servosense/io/trace.hpp"

namespace servosense {

struct AlignerStream {
  std::size_t first_column = 0;  ///< its values are the columns from here on
  std::size_t columns = 0;
  unsigned samples = 1;        ///< rows in a frame, the oldest first
  unsigned every = 1;          ///< rows from frame to frame, at least `samples`
  unsigned sequence_bits = 0;  ///< width of the frame counter; 0: none
};

struct AlignerConfig {
  Nanoseconds period_ns = 125000;
  std::vector<AlignerStream> streams;
  bool sync = false;        ///< sync() is called for every period
  unsigned wait_rows = 20;  ///< longest lateness that is waited for (2.5 ms at 8 kHz)
};

struct AlignerHealth {
  std::uint64_t frames = 0;
  std::uint64_t rows = 0;
  std::uint64_t lost = 0;        ///< frames that never came
  std::uint64_t duplicates = 0;  ///< dropped
  std::uint64_t late = 0;        ///< came after their row had gone: dropped
  std::uint64_t reordered = 0;   ///< came after younger ones, put in their place
  std::uint64_t restarts = 0;    ///< begun anew: long holes, counters or clocks that jumped
};

class FrameAligner {
 public:
  /// More than the stack bridges (DriveInputConfig::max_hold_samples): it begins anew.
  static constexpr std::int64_t kDistrusted = 9;

  static Status validate(const AlignerConfig& config);
  /// Requires validate(config).ok().
  explicit FrameAligner(const AlignerConfig& config);

  /// A SYNC frame.
  void sync(Nanoseconds t_ns) noexcept;
  /// A frame of `stream`. `fields`: samples x columns, the oldest sample first.
  void push(std::size_t stream, Nanoseconds t_ns, std::span<const TraceField> fields,
            std::optional<std::uint32_t> sequence = {}) noexcept;
  /// No more frames will come: everything that is held back may go.
  void finish() noexcept;

  /// The next row, if it is ready; call it until it is false after every push(). Columns of a slow
  /// stream are empty between its frames; values that never came are invalid. `row.fields` keeps
  /// its memory. A period in which nothing came at all gives no row.
  bool pop(TraceRow& row) noexcept;

  /// The time of the row that is due at `t_ns` by the clock of the streams: rows count periods, and
  /// part from the clock of the stamps by drift and jumps.
  [[nodiscard]] Nanoseconds row_time(Nanoseconds t_ns) const noexcept;
  /// Rows that may have to be held before one is given out.
  [[nodiscard]] std::int64_t longest_delay_rows() const noexcept { return longest_delay_; }
  [[nodiscard]] const AlignerHealth& health() const noexcept { return health_; }

 private:
  struct Stream {
    AlignerStream config;
    bool started = false;
    std::int64_t last = 0;  // row of the newest sample of the newest frame
    SampleClock clock;      // of its frames
    std::uint32_t sequence = 0;
    unsigned behind = 0;        // frames in a row whose row had gone
    std::int64_t distrust = 0;  // rows before this one are invalid
    unsigned held = 0;          // frames that are late, or follow lost ones
    double first_late = 0;      // in frames
    std::vector<Nanoseconds> held_t_ns;
    std::vector<TraceField> held_fields;
  };
  struct Row {
    std::int64_t index = -1;
    std::vector<bool> has;  // by stream
  };
  struct Parked {  // a frame beyond the ring: it waits until the ring is empty
    std::size_t stream = 0;
    std::int64_t row = 0;
    std::vector<TraceField> fields;
    bool full = false;
  };

  void begin(std::size_t stream, Nanoseconds t_ns) noexcept;
  void by_time(std::size_t stream, Nanoseconds t_ns, std::span<const TraceField> fields) noexcept;
  void by_sequence(std::size_t stream, Nanoseconds t_ns, std::span<const TraceField> fields,
                   std::uint32_t sequence) noexcept;
  void settle(std::size_t stream, bool lost) noexcept;
  [[nodiscard]] bool knows_clock(const Stream& s) const noexcept;
  bool place(std::size_t stream, std::int64_t row, std::span<const TraceField> fields) noexcept;
  void accept(std::size_t stream, std::int64_t frames, Nanoseconds t_ns,
              std::span<const TraceField> fields) noexcept;
  void restart(std::size_t stream, std::int64_t frames, Nanoseconds t_ns,
               std::span<const TraceField> fields) noexcept;
  void advance(std::size_t stream, std::int64_t frames,
               std::span<const TraceField> fields) noexcept;
  void give(TraceRow& row) noexcept;
  Row& row_at(std::int64_t i) noexcept { return rows_[static_cast<std::size_t>(i) & mask_]; }

  AlignerConfig config_;
  std::vector<Stream> streams_;
  std::vector<Row> rows_;
  std::vector<TraceField> fields_;  // rows x columns
  std::size_t columns_ = 0;
  std::size_t mask_ = 0;
  std::int64_t wait_ = 0;
  std::int64_t longest_delay_ = 0;
  Parked parked_;
  std::int64_t next_ = 0;     // row to be given out
  std::int64_t newest_ = -1;  // youngest row that something has come for
  Nanoseconds start_ns_ = 0;  // time of row 0
  bool started_ = false;
  bool finished_ = false;
  std::int64_t sync_row_ = -1;
  SampleClock sync_clock_;
  unsigned sync_late_ = 0;  // SYNC frames in a row that were late
  double sync_first_late_ = 0;
  AlignerHealth health_;
};

}  // namespace servosense
