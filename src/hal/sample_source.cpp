#include "servosense/hal/sample_source.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "servosense/core/plausible.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/sample_period.hpp"

namespace servosense {
namespace {

constexpr std::size_t kRowsForRate = 512;

Quality quality_of(const TraceField& field) {
  switch (field.state) {
    case TraceField::State::value:
      return Quality::good;
    case TraceField::State::empty:
      return Quality::held;
    case TraceField::State::invalid:
      return Quality::invalid;
  }
  return Quality::invalid;
}

std::optional<std::size_t> machine_column(const std::vector<Signal>& signals, Quantity quantity) {
  const auto found = std::find(signals.begin(), signals.end(), Signal{Channel::machine, quantity});
  if (found == signals.end()) return std::nullopt;
  return static_cast<std::size_t>(found - signals.begin());
}

void mark(RawDriveSample<double>& drive, Quality quality) {
  drive.motion_quality = quality;
  drive.effort_quality = quality;
}

void add(RawDriveSample<double>& drive, Quality quality) {
  drive.motion_quality |= quality;
  drive.effort_quality |= quality;
}

class TraceFileRows final : public RowSource {
 public:
  explicit TraceFileRows(TraceReader reader) : reader_(std::move(reader)) {}
  [[nodiscard]] const std::vector<Signal>& signals() const override { return reader_.signals(); }
  Expected<bool> next(TraceRow& row) override { return reader_.next(row); }
  [[nodiscard]] std::optional<std::string> meta(std::string_view key) const override {
    return reader_.meta(key);
  }
  [[nodiscard]] double progress() const override { return reader_.progress(); }

 private:
  TraceReader reader_;
};

}  // namespace

std::unique_ptr<RowSource> trace_rows(TraceReader reader) {
  return std::make_unique<TraceFileRows>(std::move(reader));
}

Expected<SampleSource> SampleSource::open(TraceReader reader, std::string name, unsigned max_fill,
                                          const ColumnChoices& choices) {
  return open(trace_rows(std::move(reader)), std::move(name), max_fill, choices);
}

Expected<SampleSource> SampleSource::open(std::unique_ptr<RowSource> rows, std::string name,
                                          unsigned max_fill, const ColumnChoices& choices) {
  SampleSource source(std::move(rows));
  source.max_fill_ = max_fill;
  const std::vector<Signal>& signals = source.rows_->signals();
  const auto missing = [&](const ColumnChoice& choice) {
    return !choice.effort.empty() && !column_named(signals, choice.effort);
  };
  for (const Channel channel : kDriveChannels)
    if (const ColumnChoice& choice = choices.drive(channel); missing(choice))
      return data_error(name + ": has no column " + choice.effort +
                        ", which the machine file names as effort_column; correct it");
  source.name_ = name;
  source.choices_ = choices;
  bool any = false;
  for (std::size_t i = 0; i < source.drives_.size(); ++i) {
    const Channel channel = kDriveChannels[i];
    const ColumnChoice& choice = choices.drive(channel);
    Drive& drive = source.drives_[i];
    drive.columns = drive_columns(signals, channel, choice);
    if (!drive.columns) continue;
    drive.travel = Travel(drive.columns->is_angle                              ? Reading::angle
                          : drive.columns->signal.motion == MotionKind::counts ? Reading::counts
                                                                               : Reading::plain,
                          choice.counter_bits);
    drive.units.emplace(channel, signals, *drive.columns, choice);
    any = true;
  }
  if (!any) {
    // The last remark lists columns.
    std::vector<std::string> lacking = source.column_remarks();
    if (!lacking.empty()) lacking.pop_back();
    std::string all;
    for (const std::string& one : lacking) all += (all.empty() ? "" : ", and ") + one;
    return data_error(
        name + ": no drive has both motion and effort" +
        (all.empty() ? std::string() : " (" + all + ")") +
        "; a monitor needs for example the columns spindle.angle_counts and spindle.current_A, or "
        "x.position_m and x.current_A");
  }

  source.block_column_ = machine_column(signals, Quantity::nc_block);
  source.override_column_ = machine_column(signals, Quantity::feed_override);
  source.period_s_ = source.rows_->period_s();
  if (source.period_s_ > 0)
    source.clock_ = SampleClock({.period_ns = source.period_s_ * 1e9});
  else if (auto done = source.find_rate(); !done)
    return done.error();
  if (auto done = source.check_clock(); !done) return done.error();
  return source;
}

Expected<Done> SampleSource::find_rate() {
  std::vector<Nanoseconds> times;
  std::vector<double> since_first;  // so that no digit of a clock's time is lost
  TraceRow row;
  while (ahead_.size() < kRowsForRate) {
    auto more = rows_->next(row);
    if (!more) return more.error();
    if (!*more) break;
    times.push_back(row.t_ns);
    since_first.push_back(static_cast<double>(saturated_difference(row.t_ns, times.front())));
    ahead_.push_back(row);
  }
  if (times.size() < 2)
    return data_error(name_ + ": only " + std::to_string(times.size()) +
                      " row(s); a trace needs at least two to have a sample rate");
  const double period_ns = sample_period(since_first);
  period_s_ = period_ns / 1e9;
  clock_ = SampleClock({.period_ns = period_ns});
  // Heard once, and begun again from the first.
  clock_.start(times.front());
  std::int64_t ticks = 0;
  for (std::size_t i = 1; i < times.size(); ++i) ticks += clock_.take(times[i]);
  clock_.rewind(ticks);
  heard_ = std::abs(clock_.elapsed(times.front())) < 0.5;
  return Done{};
}

Expected<Done> SampleSource::check_clock() {
  const RateFinding rate = check_rate(period_s_, choices_.sample_rate_hz, choices_.machine);
  if (rate.sentence.empty()) return Done{};
  // What the first rows tell of the other columns is said as well.
  std::string sentence = name_ + ": " + rate.sentence;
  MachineServoSample sample;
  for (TraceRow row : ahead_) {
    row.t_ns = saturated_from(rate.seconds * seconds_from(row.t_ns));
    fill(row, sample);
  }
  for (const Drive& drive : drives_)
    if (drive.units)
      if (const std::string finding = drive.units->finding(); !finding.empty())
        sentence += "; " + finding;
  return data_error(sentence + (rate.seconds < 1 ? "; convert it to seconds" : ""));
}

Expected<Done> SampleSource::check_units() const {
  std::string sentence;
  for (const Drive& drive : drives_)
    if (drive.units)
      if (const std::string finding = drive.units->finding(); !finding.empty())
        sentence += (sentence.empty() ? "" : "; ") + finding;
  if (sentence.empty()) return Done{};
  return data_error(name_ + ": " + sentence + "; convert to the unit in the column's name");
}

std::vector<std::string> SampleSource::column_remarks() const {
  std::vector<std::size_t> used = also_used_;
  for (const Drive& drive : drives_) {
    if (!drive.columns) continue;
    used.push_back(drive.columns->effort_column);
    if (const auto second = drive.columns->second_effort_column) used.push_back(*second);
    if (drive.columns->constant_motion == 0) used.push_back(drive.columns->motion_column);
    const Channel channel = kDriveChannels[static_cast<std::size_t>(&drive - drives_.data())];
    if (const auto column = drive.columns->temperature_column;
        column && choices_.drive(channel).constant.per_K != 0)
      used.push_back(*column);
  }
  std::vector<std::string> said = unused_columns(rows_->signals(), used, choices_);
  for (std::size_t i = 0; i < drives_.size(); ++i)
    if (drives_[i].columns)
      if (const std::string stands =
              commanded_effort(rows_->signals(), kDriveChannels[i], *drives_[i].columns);
          !stands.empty())
        said.push_back(stands);
  for (std::size_t i = 0; i < drives_.size(); ++i)
    if (const auto& columns = drives_[i].columns)
      if (std::string lacks = no_temperature(kDriveChannels[i], *columns,
                                             choices_.drive(kDriveChannels[i]).constant);
          !lacks.empty())
        said.push_back(std::move(lacks));
  if (auto motion = rows_->meta("worked out")) said.push_back(std::move(*motion));
  return said;
}

std::vector<std::string> SampleSource::late_remarks() const {
  std::vector<std::string> said;
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    const ConstantOverTemperature& constant = choices_.drive(kDriveChannels[i]).constant;
    if (!drives_[i].columns || !drives_[i].columns->temperature_column || constant.per_K == 0)
      continue;
    if (std::string lacks = drives_[i].temperature.missing(kDriveChannels[i], constant.at_C);
        !lacks.empty())
      said.push_back(std::move(lacks));
  }
  return said;
}

double SampleSource::temperature_C(Channel channel) const {
  const auto at = std::ranges::find(kDriveChannels, channel) - kDriveChannels.begin();
  return drives_[static_cast<std::size_t>(at)].temperature.last_C();
}

Expected<bool> SampleSource::next_row(TraceRow& row) {
  if (!ahead_.empty()) {
    row = std::move(ahead_.front());
    ahead_.pop_front();
    return true;
  }
  return rows_->next(row);
}

TraceField SampleSource::joined(const TraceField& first, const TraceField& second, Drive& drive) {
  using enum TraceField::State;
  if (first.state == value) drive.efforts[0] = first.value;
  if (second.state == value) drive.efforts[1] = second.value;
  TraceField sum = first;
  sum.value = drive.efforts[0] + drive.efforts[1];
  sum.state = first.state == invalid || second.state == invalid ? invalid
              : first.state == value || second.state == value   ? value
                                                                : empty;
  return sum;
}

void SampleSource::fill_drive(const TraceRow& row, std::size_t i, RawDriveSample<double>& to) {
  Drive& drive = drives_[i];
  if (!drive.columns) return;
  const DriveColumns& columns = *drive.columns;
  const TraceField& effort = row.fields[columns.effort_column];
  const TraceField whole = columns.second_effort_column
                               ? joined(effort, row.fields[*columns.second_effort_column], drive)
                               : effort;
  to.effort_quality = quality_of(whole);
  to.effort = columns.effort_scale * whole.value;
  std::optional<double> moved;
  if (columns.constant_motion != 0) {
    to.motion_quality = Quality::good;
    to.motion = columns.constant_motion;
  } else {
    const TraceField& motion = row.fields[columns.motion_column];
    to.motion_quality = quality_of(motion);
    to.counts = motion.counts;
    double value = motion.value;
    if (motion.state == TraceField::State::value) {
      const double way = drive.travel.add(motion);
      if (columns.is_angle) value = way;
      moved = columns.signal.motion == MotionKind::counts ? way : columns.motion_scale * way;
    }
    to.motion = columns.motion_scale * value;
  }
  drive.units->add(
      seconds_from(row.t_ns), moved,
      effort.state == TraceField::State::value ? std::optional(to.effort) : std::nullopt);
  if (columns.temperature_column) {
    const TraceField& told = row.fields[*columns.temperature_column];
    drive.temperature.hear(
        told.state == TraceField::State::value ? std::optional(told.value) : std::nullopt,
        seconds_from(row.t_ns));
    const ConstantOverTemperature& constant = choices_.drive(kDriveChannels[i]).constant;
    if (constant.per_K != 0 && drive.temperature.known())
      to.effort *= constant.ratio(drive.temperature.last_C());
  }
  if (columns.power || columns.rated_to_rad_s > 0) {
    const bool counts = columns.signal.motion == MotionKind::counts;
    if (moved && counts) *moved *= choices_.drive(kDriveChannels[i]).unit_per_count;
    to.effort = LoadTorque::torque_Nm(
        columns, to.effort,
        drive.load.speed_rad_s(columns, period_s_, seconds_from(row.t_ns), moved));
  }
}

void SampleSource::fill(const TraceRow& row, MachineServoSample& sample) {
  sample.t_ns = row.t_ns;
  for (std::size_t i = 0; i < drives_.size(); ++i)
    fill_drive(row, i, sample.drive(kDriveChannels[i]));
  hear_controller(row);
  sample.nc_block = block_;
  sample.feed_override = override_;
  const Quality time = (clock_.locked() ? Quality::good : Quality::late | Quality::invalid) |
                       (std::exchange(skipped_, false) ? Quality::duplicate : Quality::good);
  if (time != Quality::good) {
    if (!clock_.locked()) ++health_.untimed;
    for (const Channel channel : kDriveChannels) add(sample.drive(channel), time);
  }
  last_t_ns_ = row.t_ns;
  to_fill_ = filled_ = 0;
  started_ = true;
  recorded_ = true;
}

void SampleSource::hear_controller(const TraceRow& row) {
  if (block_column_) {
    const TraceField& block = row.fields[*block_column_];
    const bool known = block.state == TraceField::State::value && block.value >= 0 &&
                       block.value <= std::numeric_limits<std::int32_t>::max();
    if (block.state != TraceField::State::empty)
      block_ = known ? static_cast<std::int32_t>(std::lround(block.value)) : kNoBlock;
  }
  if (override_column_) {
    const TraceField& feed = row.fields[*override_column_];
    const bool known = feed.state == TraceField::State::value && feed.value >= 0;
    if (feed.state != TraceField::State::empty) override_ = known ? feed.value : 1;
  }
}

Expected<bool> SampleSource::next(ServoSample<double>& sample) {
  auto more = next(whole_);
  if (!more || !*more) return more;
  sample.t_ns = whole_.t_ns;
  sample.spindle = whole_.spindle;
  std::copy_n(whole_.axis.begin(), kAxes, sample.axis.begin());
  sample.nc_block = whole_.nc_block;
  sample.feed_override = whole_.feed_override;
  return more;
}

Expected<bool> SampleSource::next(MachineServoSample& sample) {
  while (!waiting_ && filled_ >= to_fill_) {
    TraceRow& row = row_;  // keeps its memory: a live run must not allocate
    auto more = next_row(row);
    if (!more) return more.error();
    if (!*more || health_.rows == to_check_) {
      to_check_ *= 2;
      if (auto done = check_units(); !done) return done.error();
      if (!*more) return false;
    }
    if (row.fields.empty()) {  // still silent
      if (!started_) {
        // Silence from the beginning is a fault, too: counted from where it was noticed.
        clock_.start(row.t_ns);
        last_t_ns_ = row.t_ns;
        started_ = true;
        to_fill_ = samples_of_hole(1);
        continue;
      }
      const double passed = clock_.elapsed(row.t_ns);
      if (passed >= 1) to_fill_ = samples_of_hole(std::floor(passed));
      continue;
    }
    ++health_.rows;
    std::int64_t ticks = 1;
    if (!started_ && !heard_) {
      clock_.start(row.t_ns);
    } else if (started_) {
      const bool early = clock_.elapsed(row.t_ns) < 0.5;
      ticks = clock_.take(row.t_ns);
      if (ticks == 0) {  // of no new period
        ++health_.early;
        skipped_ = true;
        hear_controller(row);
        continue;
      }
      if (early) ticks = 1;  // believed at last
    }
    if (clock_.locked())
      health_.worst_jitter_s =
          std::max(health_.worst_jitter_s, std::abs(clock_.elapsed(row.t_ns)) * period_s_);
    if (ticks < 2) {
      fill(row, sample);
      return true;
    }
    ++health_.gaps;
    health_.missing_samples += static_cast<std::uint64_t>(ticks - 1);
    to_fill_ = samples_of_hole(static_cast<double>(ticks - 1));
    waiting_ = true;
  }
  if (filled_ < to_fill_) {
    ++filled_;
    sample.t_ns =
        saturated_sum(last_t_ns_, saturated_from(static_cast<double>(filled_) * period_s_));
    if (waiting_) sample.t_ns = std::min(sample.t_ns, row_.t_ns - 1);
    const Quality quality =
        filled_ > max_fill_ ? Quality::missing | Quality::dead_bus : Quality::missing;
    for (const Channel channel : kDriveChannels) mark(sample.drive(channel), quality);
    recorded_ = false;
    return true;
  }
  fill(row_, sample);
  waiting_ = false;
  return true;
}

std::uint64_t SampleSource::samples_of_hole(double missing) const {
  return static_cast<std::uint64_t>(std::min(missing, max_fill_ + 1.0));
}

}  // namespace servosense
