#include "servosense/hal/frame_aligner.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace servosense {
namespace {

// Frames that come as regularly as ever, but late by as much: then some before them are lost. After
// a stall they come faster than that.
constexpr unsigned kRegular = 4;
// Without a counter, frames lost in a row from which on they may as well be a clock set ahead.
constexpr std::int64_t kDoubtful = 2;
// Frames: nothing comes before it is sent. Jitter of 60 us makes it 0.13, a stall 0.13 more.
constexpr double kTooEarly = -3.0 / 8;
// A hole is no longer than this, whatever the stamps say: 4 years at 8 kHz.
constexpr std::int64_t kLongestHole = std::int64_t{1} << 40;

SampleClockConfig clock_config(Nanoseconds period_ns, double longest) {
  SampleClockConfig c;
  c.period_ns = static_cast<double>(period_ns);
  // Delays are never negative, so an early frame says more about the clock than a late one.
  c.early_gain = 1.0 / 8;
  c.late_gain = 1.0 / 64;
  c.rate_gain = 0;
  c.longest = longest;
  return c;
}

std::int64_t whole_frames(double frames) {
  constexpr auto kMost = static_cast<double>(kLongestHole);
  return std::llround(std::clamp(frames, -kMost, kMost));
}

}  // namespace

Status FrameAligner::validate(const AlignerConfig& config) {
  if (config.period_ns < 1000) return Status::invalid("period_ns", "must be at least 1000");
  if (config.streams.empty() || config.streams.size() > 4096)
    return Status::invalid("streams", "must be 1 to 4096");
  if (config.wait_rows < 1 || config.wait_rows > 65536)
    return Status::invalid("wait_rows", "must be within 1 and 65536");
  for (const AlignerStream& s : config.streams) {
    if (s.samples < 1 || s.samples > 4096)
      return Status::invalid("samples", "must be within 1 and 4096");
    if (s.every < s.samples || s.every > 65536)
      return Status::invalid("every", "must be at least the samples of a frame, at most 65536");
    if (s.sequence_bits > 32) return Status::invalid("sequence_bits", "must be at most 32");
  }
  return {};
}

FrameAligner::FrameAligner(const AlignerConfig& config) : config_(config) {
  unsigned longest = 1, longest_uncounted = 0;
  std::size_t largest = 1;
  for (const AlignerStream& s : config.streams) {
    Stream stream;
    stream.config = s;
    stream.clock = SampleClock(clock_config(config.period_ns * s.every, kLongestHole));
    const std::size_t held = std::max(kRegular, config.wait_rows / s.every + 1);
    stream.held_t_ns.resize(held);
    stream.held_fields.resize(held * s.samples * s.columns);
    streams_.push_back(std::move(stream));
    longest = std::max(longest, s.every);
    if (s.sequence_bits == 0 && !config.sync)
      longest_uncounted = std::max(longest_uncounted, s.every);
    largest = std::max(largest, std::size_t{s.samples} * s.columns);
    columns_ = std::max(columns_, s.first_column + s.columns);
  }
  // A stream without a counter settles once kRegular frames have come late.
  wait_ = static_cast<std::int64_t>(std::max(config.wait_rows, kRegular * longest_uncounted)) +
          longest + 1;
  sync_clock_ = SampleClock(clock_config(config.period_ns, static_cast<double>(wait_)));
  longest_delay_ = wait_ + longest;  // a block may bring that many rows at once
  const std::size_t rows = std::bit_ceil(static_cast<std::size_t>(2 * longest_delay_));
  mask_ = rows - 1;
  rows_.resize(rows);
  for (Row& row : rows_) row.has.resize(streams_.size());
  fields_.resize(rows * columns_);
  parked_.fields.resize(largest);
}

void FrameAligner::sync(Nanoseconds t_ns) noexcept {
  if (sync_row_ < 0) {
    if (!started_) start_ns_ = t_ns;
    started_ = true;
    sync_clock_.start(t_ns);
    sync_row_ = 0;
    return;
  }
  // A stall delays the frames behind it as well: the next is the next, however late, unless all are
  // that late from now on. Frames behind a SYNC that fits nowhere belong to no new period.
  const double late = sync_clock_.elapsed(t_ns) - 1;
  if (late < 0.5 || late > static_cast<double>(wait_)) {
    sync_row_ += sync_clock_.take(t_ns);
    sync_late_ = 0;
    return;
  }
  // As long as it catches up, nothing is lost.
  if (sync_late_ == 0 || late < sync_first_late_ - 0.5) {
    sync_first_late_ = late;
    sync_late_ = 0;
  }
  ++sync_row_;
  sync_clock_.pass();
  if (++sync_late_ < kRegular) return;
  sync_row_ += whole_frames(late);
  sync_clock_.jump(t_ns);
  sync_late_ = 0;
}

void FrameAligner::begin(std::size_t stream, Nanoseconds t_ns) noexcept {
  Stream& s = streams_[stream];
  std::int64_t row = config_.sync ? sync_row_ : std::int64_t{s.config.samples} - 1;
  if (!started_) {
    started_ = true;
    start_ns_ = saturated_difference(t_ns, row * config_.period_ns);
  } else if (!config_.sync) {  // as the clock of a stream says that runs already
    for (const Stream& other : streams_)
      if (other.started)
        row = other.last + whole_frames(other.clock.elapsed(t_ns) * other.config.every);
  }
  s.started = true;
  s.last = row;
  s.clock.start(t_ns);
}

Nanoseconds FrameAligner::row_time(Nanoseconds t_ns) const noexcept {
  const Stream* newest = nullptr;
  for (const Stream& s : streams_)
    if (s.started && (newest == nullptr || s.last > newest->last)) newest = &s;
  if (newest == nullptr) return t_ns;
  const std::int64_t row =
      newest->last + whole_frames(newest->clock.elapsed(t_ns) * newest->config.every);
  return saturated_sum(start_ns_, saturated_product(row, config_.period_ns));
}

// Whether the clock tells the row of a frame beyond doubt.
bool FrameAligner::knows_clock(const Stream& s) const noexcept {
  return config_.sync ? sync_late_ == 0 && sync_clock_.locked() : s.clock.locked();
}

// The frame that is `frames` behind the last.
void FrameAligner::accept(std::size_t stream, std::int64_t frames, Nanoseconds t_ns,
                          std::span<const TraceField> fields) noexcept {
  Stream& s = streams_[stream];
  const bool early = frames == 1 && s.clock.elapsed(t_ns) - 1 < kTooEarly;
  s.clock.follow(frames, t_ns);
  const bool counted = s.config.sequence_bits > 0;
  if (counted ? early : !knows_clock(s))
    s.distrust = std::max(s.distrust, s.last + frames * s.config.every + 1);
  advance(stream, frames, fields);
}

// The same of one that has come by another clock, or counter.
void FrameAligner::restart(std::size_t stream, std::int64_t frames, Nanoseconds t_ns,
                           std::span<const TraceField> fields) noexcept {
  Stream& s = streams_[stream];
  ++health_.restarts;
  s.clock.jump(t_ns);
  s.distrust = s.last + frames * s.config.every + kDistrusted;
  advance(stream, frames, fields);
}

void FrameAligner::advance(std::size_t stream, std::int64_t frames,
                           std::span<const TraceField> fields) noexcept {
  Stream& s = streams_[stream];
  s.last += frames * s.config.every;
  if (place(stream, s.last, fields)) {
    s.behind = 0;
    return;
  }
  ++health_.late;
  if (++s.behind < SampleClock::kBelieved) return;
  // The others have gone on without it: it goes on with them.
  s.behind = 0;
  s.last = std::max(newest_, next_);
  s.distrust = s.last + s.config.every + kDistrusted;
  ++health_.restarts;
}

bool FrameAligner::place(std::size_t stream, std::int64_t row,
                         std::span<const TraceField> fields) noexcept {
  const AlignerStream& c = streams_[stream].config;
  if (row < next_) return false;
  if (row > next_ + static_cast<std::int64_t>(mask_)) {
    if (parked_.full) return false;
    parked_.full = true;
    parked_.stream = stream;
    parked_.row = row;
    std::copy(fields.begin(), fields.end(), parked_.fields.begin());
    return true;
  }
  for (unsigned k = 0; k < c.samples; ++k) {
    const std::int64_t index = row - c.samples + 1 + k;
    if (index < next_) continue;
    Row& r = row_at(index);
    if (r.index != index) {
      r.index = index;
      std::fill(r.has.begin(), r.has.end(), false);
    }
    r.has[stream] = true;
    const auto to = fields_.begin() +
                    static_cast<std::ptrdiff_t>(
                        (static_cast<std::size_t>(index) & mask_) * columns_ + c.first_column);
    if (index < streams_[stream].distrust)
      std::fill_n(to, c.columns, TraceField::invalid());
    else
      std::copy_n(fields.begin() + static_cast<std::ptrdiff_t>(k * c.columns), c.columns, to);
  }
  newest_ = std::max(newest_, row);
  return true;
}

void FrameAligner::push(std::size_t stream, Nanoseconds t_ns, std::span<const TraceField> fields,
                        std::optional<std::uint32_t> sequence) noexcept {
  Stream& s = streams_[stream];
  ++health_.frames;
  if (config_.sync && sync_row_ < 0) return;  // belongs to no period yet
  if (!s.started) {
    begin(stream, t_ns);
    s.sequence = sequence.value_or(0);
    if (!place(stream, s.last, fields)) ++health_.late;
  } else if (s.config.sequence_bits > 0 && sequence) {
    by_sequence(stream, t_ns, fields, *sequence);
  } else if (config_.sync) {
    const std::int64_t rows = sync_row_ - s.last;
    if (rows < s.config.every) {
      ++health_.duplicates;
    } else {
      s.last += rows % s.config.every;
      accept(stream, rows / s.config.every, t_ns, fields);
    }
  } else {
    by_time(stream, t_ns, fields);
  }
}

void FrameAligner::by_sequence(std::size_t stream, Nanoseconds t_ns,
                               std::span<const TraceField> fields,
                               std::uint32_t sequence) noexcept {
  Stream& s = streams_[stream];
  const std::int64_t turn = std::int64_t{1} << s.config.sequence_bits;
  std::int64_t counted = (static_cast<std::int64_t>(sequence) - s.sequence) & (turn - 1);
  if (counted > turn / 2) counted -= turn;
  const double since = s.clock.elapsed(t_ns);
  const std::int64_t elapsed = whole_frames(since);
  std::int64_t frames = counted;
  if (elapsed >= turn / 2)  // the counter may have come round unseen
    frames +=
        turn * std::llround(static_cast<double>(elapsed - counted) / static_cast<double>(turn));
  const bool near = elapsed <= std::max(turn / 2, wait_);  // else it would bear out any time
  if (near && frames > 0 && frames <= elapsed + wait_) {
    s.sequence = sequence;
    accept(stream, frames, t_ns, fields);
    return;
  }
  const std::int64_t row = s.last + counted * s.config.every;
  const Row& r = row_at(row);
  const bool known = r.index == row && r.has[stream];
  if (counted <= 0 && row >= next_ && !known) {
    ++health_.reordered;
    place(stream, row, fields);
    return;
  }
  const bool same = counted == 0 && elapsed == 0;
  if (s.clock.refuse(since) && !same) {
    s.sequence = sequence;
    // A counter that has gone on tells how many there were; else the time does.
    const bool went_on = counted > 0 && counted <= wait_;
    const bool agrees = std::abs(frames - elapsed) <= wait_;
    restart(stream,
            went_on  ? counted
            : agrees ? frames
                     : std::max<std::int64_t>(elapsed, 1),
            t_ns, fields);
    return;
  }
  ++(known || counted == 0 ? health_.duplicates : health_.late);
}

void FrameAligner::by_time(std::size_t stream, Nanoseconds t_ns,
                           std::span<const TraceField> fields) noexcept {
  Stream& s = streams_[stream];
  const double since = s.clock.elapsed(t_ns);
  const double late = since - (s.held + 1);
  if (late > -0.5 && late < 0.5) {
    settle(stream, false);
    accept(stream, 1, t_ns, fields);
    return;
  }
  const bool far = late * s.config.every > static_cast<double>(wait_);
  if (late <= -0.5 || far) {
    if (s.clock.refuse(since)) {
      settle(stream, true);
      // Stamps that went back tell nothing: there are as many as have come.
      const auto came = static_cast<std::int64_t>(SampleClock::kBelieved);
      restart(stream, far ? std::max(whole_frames(s.clock.elapsed(t_ns)), came) : came, t_ns,
              fields);
    } else {
      ++(far ? health_.late : health_.duplicates);
    }
    return;
  }
  // Hold it back.
  if (s.held == 0) s.first_late = late;
  s.held_t_ns[s.held] = t_ns;
  std::copy(fields.begin(), fields.end(),
            s.held_fields.begin() + static_cast<std::ptrdiff_t>(s.held * fields.size()));
  ++s.held;
  const bool regular = s.held >= kRegular && late > s.first_late - 0.5;
  if (regular || s.held == s.held_t_ns.size()) settle(stream, true);
}

void FrameAligner::settle(std::size_t stream, bool lost) noexcept {
  Stream& s = streams_[stream];
  const std::size_t size = std::size_t{s.config.samples} * s.config.columns;
  const unsigned held = s.held;
  s.held = 0;
  for (unsigned i = 0; i < held; ++i) {
    const auto fields = std::span<const TraceField>(s.held_fields).subspan(i * size, size);
    if (!lost) {  // one after the other
      s.clock.pass();
      advance(stream, 1, fields);
      continue;
    }
    // Each tells by its time how many are missing before it.
    const Nanoseconds t_ns = s.held_t_ns[i];
    const std::int64_t frames = std::max<std::int64_t>(1, whole_frames(s.clock.elapsed(t_ns)));
    if (frames > kDoubtful)
      s.distrust = std::max(s.distrust, s.last + frames * s.config.every + kDistrusted);
    accept(stream, frames, t_ns, fields);
  }
}

void FrameAligner::finish() noexcept {
  for (std::size_t i = 0; i < streams_.size(); ++i) settle(i, true);
  finished_ = true;
}

bool FrameAligner::pop(TraceRow& row) noexcept {
  for (;;) {
    if (next_ > newest_) {
      if (!parked_.full) return false;
      // Everything before the hole is out.
      const AlignerStream& c = streams_[parked_.stream].config;
      parked_.full = false;
      next_ = parked_.row - c.samples + 1;
      ++health_.restarts;
      place(parked_.stream, parked_.row,
            std::span<const TraceField>(parked_.fields).first(std::size_t{c.samples} * c.columns));
    }
    const Row& r = row_at(next_);
    const bool anything = r.index == next_;
    bool complete = true;
    std::uint64_t lost = 0;
    for (std::size_t i = 0; i < streams_.size(); ++i) {
      const Stream& s = streams_[i];
      if (!s.started) {
        complete = false;
        continue;
      }
      const auto every = static_cast<std::int64_t>(s.config.every);
      const std::int64_t ahead = ((s.last - next_) % every + every) % every;
      if (ahead >= s.config.samples || (anything && r.has[i])) continue;
      complete = false;
      if (ahead == 0) ++lost;
    }
    if (!complete && !finished_ && !parked_.full && newest_ < next_ + wait_) return false;
    health_.lost += lost;
    if (anything) give(row);
    ++next_;
    if (anything) return true;
  }
}

void FrameAligner::give(TraceRow& row) noexcept {
  const Row& r = row_at(next_);
  row.t_ns = saturated_sum(start_ns_, saturated_product(next_, config_.period_ns));
  row.line = 0;
  row.fields.resize(columns_);
  const std::size_t first = (static_cast<std::size_t>(next_) & mask_) * columns_;
  for (std::size_t i = 0; i < streams_.size(); ++i) {
    const Stream& s = streams_[i];
    const auto every = static_cast<std::int64_t>(s.config.every);
    const std::int64_t ahead = ((s.last - next_) % every + every) % every;
    const bool due = s.started && ahead < s.config.samples;
    for (std::size_t c = s.config.first_column; c < s.config.first_column + s.config.columns; ++c)
      row.fields[c] = r.has[i] ? fields_[first + c]
                      : due    ? TraceField::invalid()
                               : TraceField::none();
  }
  ++health_.rows;
}

}  // namespace servosense
