#include "cutting_records.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "servosense/hal/sample_source.hpp"
#include "servosense/hal/wrapped_rows.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/observer/disturbance_observer.hpp"
#include "servosense/observer/machine_config.hpp"
#include "signed_samples.hpp"
#include "stack_signals.hpp"

namespace servosense::cli {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kMostLevels = 20000;  // looked at for a quantum
constexpr double kWholeSteps = 0.02;        // how far from whole a step may be

/// Smallest step of a signal that comes in steps; 0 where there is none.
double quantum_of(const std::vector<double>& values) {
  std::vector<double> levels;
  for (std::size_t i = 0; i < std::min(values.size(), kMostLevels); ++i)
    if (std::isfinite(values[i])) levels.push_back(values[i]);
  std::sort(levels.begin(), levels.end());
  levels.erase(std::unique(levels.begin(), levels.end()), levels.end());
  if (levels.size() < 2) return 0;
  const double tiny = 1e-9 * (levels.back() - levels.front());
  double least = levels.back() - levels.front();
  for (std::size_t i = 1; i < levels.size(); ++i)
    if (levels[i] - levels[i - 1] > tiny) least = std::min(least, levels[i] - levels[i - 1]);
  for (std::size_t i = 1; i < levels.size(); ++i) {
    const double steps = (levels[i] - levels[i - 1]) / least;
    if (std::abs(steps - std::round(steps)) > kWholeSteps * std::max(1.0, steps)) return 0;
  }
  return least;
}

/// Keeps the columns of the rows that pass through, as read_trace() does.
class KeptRows final : public WrappedRows {
 public:
  KeptRows(std::unique_ptr<RowSource> rows, Trace& to) : WrappedRows(std::move(rows)), to_(to) {}
  Expected<bool> next(TraceRow& row) override {
    auto more = rows_->next(row);
    if (!more || !*more) return more;
    to_.t_s.push_back(seconds_from(row.t_ns));
    for (std::size_t c = 0; c < to_.columns.size(); ++c) {
      std::vector<double>& column = to_.columns[c];
      const TraceField& field = row.fields[c];
      const bool held = field.state == TraceField::State::empty;
      column.push_back(!held ? field.value : column.empty() ? kNone : column.back());
    }
    return true;
  }

 private:
  Trace& to_;
};

/// The columns of a trace at instants.
class TraceColumns {
 public:
  TraceColumns(const Trace& trace, const std::vector<double>& instants_s, double period_s)
      : trace_(trace) {
    std::size_t row = 0;
    for (const double t_s : instants_s) {
      while (row + 1 < trace.size() && trace.t_s[row + 1] <= t_s + period_s / 2) ++row;
      rows_.push_back(row);
    }
  }
  [[nodiscard]] std::size_t size() const { return rows_.size(); }
  [[nodiscard]] std::vector<double> at(std::size_t column) const {
    std::vector<double> values;
    for (const std::size_t row : rows_) values.push_back(trace_.columns[column][row]);
    return values;
  }
  [[nodiscard]] std::optional<std::size_t> find(Channel channel, Quantity quantity) const {
    const auto at = std::ranges::find(trace_.signals, Signal{channel, quantity});
    if (at == trace_.signals.end()) return std::nullopt;
    return static_cast<std::size_t>(at - trace_.signals.begin());
  }
  /// Speed of a drive by its own motion column.
  [[nodiscard]] std::vector<double> speed(Channel channel, const ColumnChoice& choice,
                                          double period_s) const {
    const auto motion = motion_column(trace_.signals, channel, choice.lead_m);
    if (!motion) return {};
    std::vector<double> values = at(motion->column);
    double scale = motion->scale;
    if (motion->kind == MotionKind::counts) scale = choice.unit_per_count;
    for (double& v : values) v *= scale;
    if (motion->kind == MotionKind::velocity) return values;
    std::vector<double> speeds(values.size(), kNone);
    for (std::size_t i = 1; i < values.size(); ++i) {
      double step = values[i] - values[i - 1];
      // An angle may begin anew with every turn.
      if (is_turning(channel)) step -= kTwoPi * std::round(step / kTwoPi);
      speeds[i] = step / period_s;
    }
    if (speeds.size() > 1) speeds[0] = speeds[1];
    return speeds;
  }

 private:
  const Trace& trace_;
  std::vector<std::size_t> rows_;
};

/// A drive as its observer sees it.
struct ObservedDrive {
  Channel channel = Channel::spindle;
  DriveInput<double> input;
  DisturbanceObserver<double> observer;
  std::vector<double> estimate, speed;
};

void add_drive(const ObservedDrive& drive, const HostDriveSlotConfig& slot,
               const DriveColumns& columns, const MachineFile& machine, const Trace& trace,
               const TraceColumns& at, CuttingRecord& record) {
  const Quantity effort = trace.signals[columns.effort_column].quantity;
  CuttingSignal s;
  s.name = column_name(trace.signals[columns.effort_column]);
  s.is_drive = true;
  s.viscous = slot.observer.drive.viscous;
  s.coulomb = slot.observer.drive.coulomb;
  s.lag_s = 1 / slot.observer.disturbance_cutoff_rad_s + 1 / slot.observer.velocity_cutoff_rad_s;
  const bool meter = columns.power || effort == Quantity::load_percent;
  const auto filter_hz = machine.number(section_of(drive.channel), "current_filter_hz");
  if (filter_hz || meter) s.filter_s = 1 / (kTwoPi * filter_hz.value_or(kLoadMeter_hz));
  s.lag_s += s.filter_s;
  s.raw = at.at(columns.effort_column);
  s.quantum = quantum_of(s.raw);
  s.unit_per_raw = columns.effort_scale * slot.input.effort_per_unit;
  s.over_speed = columns.power.has_value();
  s.value = drive.estimate;
  if (drive.channel == tool_spindle(machine)) {
    s.kind = CuttingSignal::Kind::torque;
    for (std::size_t i = 0; i < s.value.size(); ++i)
      if (drive.speed[i] < 0) s.value[i] = -s.value[i];
    if (columns.power) record.known_from_rad_s = columns.power->known_from_rad_s;
  } else {
    // The estimate opposes +motion of the tool; the force on the tool is its reverse.
    s.kind = drive.channel == Channel::x ? CuttingSignal::Kind::x : CuttingSignal::Kind::y;
    for (double& v : s.value) v = -v;
  }
  record.signals.push_back(std::move(s));
}

/// What measures beside the drives.
void add_sensors(const TraceColumns& at, CuttingRecord& record, std::vector<std::size_t>& used) {
  const auto add = [&](Channel channel, Quantity quantity, CuttingSignal::Kind kind, double sign) {
    const auto column = at.find(channel, quantity);
    if (!column) return;
    used.push_back(*column);
    CuttingSignal s;
    s.name = column_name({channel, quantity});
    s.kind = kind;
    s.value = s.raw = at.at(*column);
    s.quantum = quantum_of(s.raw);
    for (double& v : s.value) v *= sign;
    record.signals.push_back(std::move(s));
  };
  add(Channel::tool, Quantity::torque_Nm, CuttingSignal::Kind::torque, 1);
  for (const auto& [quantity, kind] : {std::pair{Quantity::force_x_N, CuttingSignal::Kind::x},
                                       std::pair{Quantity::force_y_N, CuttingSignal::Kind::y},
                                       std::pair{Quantity::force_z_N, CuttingSignal::Kind::z}}) {
    // Either of the two: forces on the tool, or on the work.
    const Channel channel = at.find(Channel::tool, quantity) ? Channel::tool : Channel::dyno;
    add(channel, quantity, kind, channel == Channel::tool ? 1 : -1);
  }
}

}  // namespace

Expected<CuttingRecord> read_cutting_record(const std::string& path, const MachineFile& machine,
                                            Progress& progress, std::vector<std::string>& remarks,
                                            std::optional<Signal> beside) {
  auto reader = TraceReader::open(path);
  if (!reader) return reader.error();
  const ColumnChoices choices = column_choices(machine);
  const Channel turning = tool_spindle(machine);
  CuttingRecord record;
  record.name = path;
  Trace trace;
  trace.signals = reader->signals();
  const bool has_drive = std::ranges::any_of(kDriveChannels, [&](Channel channel) {
    return drive_columns(trace.signals, channel, choices.drive(channel)).has_value();
  });
  std::vector<double> instants_s;
  std::vector<std::size_t> used;
  std::vector<ObservedDrive> drives;
  std::optional<SampleSource> source;
  std::optional<StackPlan> plan;
  if (has_drive) {
    trace.columns.resize(trace.signals.size());
    auto opened =
        SampleSource::open(std::make_unique<KeptRows>(trace_rows(std::move(*reader)), trace), path,
                           SampleSource::kMaxFill, choices);
    if (!opened) return opened.error();
    source.emplace(std::move(*opened));
    auto planned = plan_stack(machine, signals_of(*source));
    if (!planned) return planned.error();
    plan.emplace(std::move(*planned));
    remarks.insert(remarks.end(), plan->remarks.begin(), plan->remarks.end());
    record.sample_period_s = source->sample_period_s();
    record.known_to_rad_s = plan->known_to_rad_s(turning);
    for (const Channel channel : {turning, Channel::x, Channel::y, Channel::z}) {
      const HostDriveSlotConfig* slot = plan->slot_of(channel);
      if (slot == nullptr) continue;
      ObservedDrive& drive = drives.emplace_back();
      drive.channel = channel;
      DriveInputConfig input = slot->input;
      input.watch_effort = false;  // a coarse meter may well repeat itself
      drive.input.configure(input);
      drive.observer.configure(slot->observer);
    }
    SignedSamples samples(*source, machine, *plan);
    MachineServoSample sample;
    for (std::size_t n = 1;; ++n) {
      auto more = samples.next(sample);
      if (!more) return more.error();
      if (!*more) break;
      instants_s.push_back(seconds_from(sample.t_ns));
      for (ObservedDrive& drive : drives) {
        const DriveSample<double> in = drive.input.process(sample.drive(drive.channel));
        const double estimate = drive.observer.process(in);
        const bool good = !has(in.quality | drive.observer.state().quality,
                               Quality::gap | Quality::restarted | Quality::settling);
        drive.estimate.push_back(good ? estimate : kNone);
        drive.speed.push_back(in.increment / record.sample_period_s);
      }
      if (n % 4096 == 0) progress.show(source->reader().progress());
    }
    for (std::string& remark : samples.remarks()) remarks.push_back(std::move(remark));
  } else {
    auto all = read_trace(*reader);
    if (!all) return all.error();
    trace = std::move(*all);
    record.sample_period_s = 1 / trace.sample_rate_hz();
    instants_s = trace.t_s;
  }
  if (trace.size() < 2) return data_error(path + ": fewer than two rows; give a record of cuts");
  if (!instants_s.empty()) record.start_s = instants_s.front();
  const TraceColumns at(trace, instants_s, record.sample_period_s);
  const auto observed = [&](Channel channel) -> const ObservedDrive* {
    for (const ObservedDrive& drive : drives)
      if (drive.channel == channel) return &drive;
    return nullptr;
  };
  add_sensors(at, record, used);
  for (const ObservedDrive& drive : drives)
    if (drive.channel != Channel::z)
      add_drive(drive, *plan->slot_of(drive.channel), *source->drive(drive.channel), machine, trace,
                at, record);
  // A torque comes first: by it cuts are found.
  std::stable_partition(record.signals.begin(), record.signals.end(), [](const CuttingSignal& s) {
    return s.kind == CuttingSignal::Kind::torque;
  });

  if (const ObservedDrive* spindle = observed(turning)) {
    record.speed_rad_s = spindle->speed;
  } else {
    record.speed_rad_s = at.speed(turning, choices.drive(turning), record.sample_period_s);
    const double stated =
        choices.drive(turning).constant_motion != 0
            ? choices.drive(turning).constant_motion
            : rad_s_from_rpm(machine.number("cut", "spindle_speed_rpm").value_or(0));
    if (record.speed_rad_s.empty()) record.speed_rad_s.assign(at.size(), stated);
  }
  for (const Channel axis : {Channel::x, Channel::y, Channel::z}) {
    const ObservedDrive* drive = observed(axis);
    record.velocity_m_s[axis_index(axis)] =
        drive != nullptr ? drive->speed
                         : at.speed(axis, choices.drive(axis), record.sample_period_s);
  }
  for (const Channel channel : {Channel::tool, Channel::machine})
    if (const auto feed = at.find(channel, Quantity::feed_per_tooth_m)) {
      record.feed_per_tooth_m = at.at(*feed);
      used.push_back(*feed);
    }
  if (const auto block = at.find(Channel::machine, Quantity::nc_block)) {
    used.push_back(*block);
    for (const double b : at.at(*block))
      record.block.push_back(std::isfinite(b) ? static_cast<std::int32_t>(b) : kNoBlock);
  }
  if (source) {
    source->also_used(used);
    for (std::string& remark : source->column_remarks()) remarks.push_back(std::move(remark));
  }
  if (beside) {
    const auto column = at.find(beside->channel, beside->quantity);
    if (!column) return data_error(path + ": there is no column " + column_name(*beside));
    CuttingSignal s;
    s.name = column_name(*beside);
    s.kind = CuttingSignal::Kind::z;  // none that cuts are found by
    s.value = s.raw = at.at(*column);
    record.signals.push_back(std::move(s));
  }
  if (record.signals.empty())
    return data_error(path +
                      ": no column tells a torque or force of the cut; record the torque, current, "
                      "power or load of the spindle, or the forces of a dynamometer");
  return record;
}

}  // namespace servosense::cli
