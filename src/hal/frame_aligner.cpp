#include "servosense/hal/frame_aligner.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace servosense {
namespace {

// Frames that come as regularly as ever, but late by as much: then some before them are lost. After
// a stall they come faster than that.
constexpr unsigned kRegular = 4;
// Frames in a row that fit nowhere: the sender began anew.
constexpr unsigned kRefused = 4;
// Delays are never negative, so an early frame says more about the clock than a late one.
constexpr double kEarlyGain = 1.0 / 8;
constexpr double kLateGain = 1.0 / 64;

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
  longest_delay_ = wait_ + longest;  // a block may bring that many rows at once
  const std::size_t rows = std::bit_ceil(static_cast<std::size_t>(2 * longest_delay_));
  mask_ = rows - 1;
  rows_.resize(rows);
  for (Row& row : rows_) row.has.resize(streams_.size());
  fields_.resize(rows * columns_);
  parked_.fields.resize(largest);
}

double FrameAligner::late_ns(const Stream& s, std::int64_t row, Nanoseconds t_ns) const noexcept {
  return static_cast<double>(t_ns - start_ns_ - row * config_.period_ns) - s.offset_ns;
}

std::int64_t FrameAligner::frames_since(const Stream& s, Nanoseconds t_ns) const noexcept {
  const double frame_ns = static_cast<double>(config_.period_ns) * s.config.every;
  return std::llround(late_ns(s, s.last, t_ns) / frame_ns);
}

void FrameAligner::sync(Nanoseconds t_ns) noexcept {
  if (!started_) {
    started_ = true;
    start_ns_ = t_ns;
  }
  const auto late = [&](std::int64_t row) {
    return static_cast<double>(t_ns - start_ns_ - row * config_.period_ns) - sync_offset_ns_;
  };
  ++sync_row_;
  const auto period = static_cast<double>(config_.period_ns);
  // A stall delays the frames behind it as well; only a long silence is a hole.
  if (late(sync_row_) > period * static_cast<double>(wait_))
    sync_row_ += std::llround(late(sync_row_) / period);
  const double e = late(sync_row_);
  sync_offset_ns_ += (e < 0 ? kEarlyGain : kLateGain) * e;
}

void FrameAligner::begin(std::size_t stream, Nanoseconds t_ns) noexcept {
  Stream& s = streams_[stream];
  if (!started_) {
    started_ = true;
    start_ns_ = t_ns - static_cast<Nanoseconds>(s.config.samples - 1) * config_.period_ns;
  }
  std::int64_t row = sync_row_;
  if (!config_.sync) {
    double clock = 0;  // of a stream that runs already
    for (const Stream& other : streams_)
      if (other.started) clock = other.offset_ns;
    row = std::llround((static_cast<double>(t_ns - start_ns_) - clock) /
                       static_cast<double>(config_.period_ns));
  }
  s.started = true;
  s.refused = 0;
  s.held = 0;
  s.last = row;
  s.offset_ns = 0;
  s.offset_ns = late_ns(s, row, t_ns);
}

void FrameAligner::accept(std::size_t stream, std::int64_t row, Nanoseconds t_ns,
                          std::span<const TraceField> fields) noexcept {
  Stream& s = streams_[stream];
  s.last = row;
  s.refused = 0;
  const double e = late_ns(s, row, t_ns);
  if (std::abs(e) < 0.5 * s.config.every * static_cast<double>(config_.period_ns))
    s.offset_ns += (e < 0 ? kEarlyGain : kLateGain) * e;
  if (!place(stream, row, fields)) ++health_.late;
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
    std::copy_n(fields.begin() + static_cast<std::ptrdiff_t>(k * c.columns), c.columns,
                fields_.begin() +
                    static_cast<std::ptrdiff_t>(
                        (static_cast<std::size_t>(index) & mask_) * columns_ + c.first_column));
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
    if (sync_row_ - s.last < s.config.every)
      ++health_.duplicates;
    else
      accept(stream, sync_row_, t_ns, fields);
  } else {
    by_time(stream, t_ns, fields);
  }
}

void FrameAligner::by_sequence(std::size_t stream, Nanoseconds t_ns,
                               std::span<const TraceField> fields,
                               std::uint32_t sequence) noexcept {
  Stream& s = streams_[stream];
  const std::int64_t turn = std::int64_t{1} << s.config.sequence_bits;
  std::int64_t frames = (static_cast<std::int64_t>(sequence) - s.sequence) & (turn - 1);
  if (frames > turn / 2) frames -= turn;
  const std::int64_t elapsed = frames_since(s, t_ns);
  if (elapsed >= turn / 2)  // the counter may have come round unseen
    frames +=
        turn * std::llround(static_cast<double>(elapsed - frames) / static_cast<double>(turn));
  const std::int64_t row = s.last + frames * s.config.every;
  if (frames > 0 && frames <= elapsed + wait_) {
    s.sequence = sequence;
    accept(stream, row, t_ns, fields);
    return;
  }
  const Row& r = row_at(row);
  const bool known = r.index == row && r.has[stream];
  if (frames <= 0 && row >= next_ && !known) {
    ++health_.reordered;
    place(stream, row, fields);
    return;
  }
  if (++s.refused >= kRefused && elapsed > 0) {  // it counts from somewhere else now
    s.sequence = sequence;
    accept(stream, s.last + elapsed * s.config.every, t_ns, fields);
    ++health_.restarts;
    return;
  }
  ++(known || frames == 0 ? health_.duplicates : health_.late);
}

void FrameAligner::by_time(std::size_t stream, Nanoseconds t_ns,
                           std::span<const TraceField> fields) noexcept {
  Stream& s = streams_[stream];
  const auto every = static_cast<std::int64_t>(s.config.every);
  const double frame_ns = static_cast<double>(config_.period_ns) * s.config.every;
  const std::int64_t row = s.last + (s.held + 1) * every;
  const double late = late_ns(s, row, t_ns);
  if (late <= -0.5 * frame_ns) {
    if (++s.refused < kRefused) {
      ++health_.duplicates;
      return;
    }
    s.offset_ns += late;  // not twice the same: its clock has jumped
    ++health_.restarts;
  }
  if (late < 0.5 * frame_ns) {
    settle(stream, false);
    accept(stream, row, t_ns, fields);
    return;
  }
  if (late > static_cast<double>(wait_) * static_cast<double>(config_.period_ns)) {
    settle(stream, false);
    accept(stream, row + every * std::llround(late / frame_ns), t_ns, fields);
    return;
  }
  // Hold it back.
  if (s.held == 0) s.first_late_ns = late;
  s.held_t_ns[s.held] = t_ns;
  std::copy(fields.begin(), fields.end(),
            s.held_fields.begin() + static_cast<std::ptrdiff_t>(s.held * fields.size()));
  ++s.held;
  const bool regular = s.held >= kRegular && late > s.first_late_ns - 0.5 * frame_ns;
  if (regular || s.held == s.held_t_ns.size()) settle(stream, true);
}

void FrameAligner::settle(std::size_t stream, bool lost) noexcept {
  Stream& s = streams_[stream];
  const std::size_t size = std::size_t{s.config.samples} * s.config.columns;
  const unsigned held = s.held;
  s.held = 0;
  for (unsigned i = 0; i < held; ++i) {
    // None lost: one after the other. Else each tells by its time how many are missing before it.
    const std::int64_t frames =
        lost ? std::max<std::int64_t>(1, frames_since(s, s.held_t_ns[i])) : 1;
    accept(stream, s.last + frames * s.config.every, s.held_t_ns[i],
           std::span<const TraceField>(s.held_fields).subspan(i * size, size));
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
  row.t_ns = start_ns_ + next_ * config_.period_ns;
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
