#include "sensor_watches.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "console.hpp"
#include "idle_found.hpp"
#include "servosense/hal/wrapped_rows.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/io/text.hpp"
#include "servosense/monitors/event_text.hpp"
#include "spindle_angle.hpp"

namespace servosense::cli {
namespace {

constexpr double kMostMissing = 0.01;  // as the monitor tolerates stand-ins

class SensorRows final : public WrappedRows {
 public:
  SensorRows(std::unique_ptr<RowSource> rows, std::function<void(const TraceRow&)> heard)
      : WrappedRows(std::move(rows)), heard_(std::move(heard)) {}
  Expected<bool> next(TraceRow& row) override {
    auto more = rows_->next(row);
    if (more && *more && !row.fields.empty()) heard_(row);
    return more;
  }

 private:
  std::function<void(const TraceRow&)> heard_;
};

/// Power of an idling sensor, once a revolution.
IdleStatistics power_in_air(SensorChatterConfig config, const std::vector<double>& values,
                            const std::vector<double>& angle_rad) {
  config.chatter.lines.threshold = 0;
  auto ear = std::make_unique<HostSensorChatter>();
  ear->configure(config);
  IdleStatistics power(config.chatter.consecutive_revolutions);
  std::uint64_t verdicts = 0;
  for (std::size_t i = 1; i < values.size(); ++i) {
    const double turn = angle_rad[i] - kTwoPi * std::floor(angle_rad[i] / kTwoPi);
    ear->hear(values[i], turn, angle_rad[i] - angle_rad[i - 1], Quality::good);
    const auto& s = ear->chatter().state();
    if (s.verdicts == verdicts) continue;
    verdicts = s.verdicts;
    if (s.signal == SignalState::good) power.add(ear->chatter().measures().beyond_change);
  }
  return power;
}

}  // namespace

std::unique_ptr<RowSource> SensorWatches::tap(std::unique_ptr<RowSource> rows) {
  signals_ = rows->signals();
  for (const Channel channel : kSensorChannels)
    if (const auto column = sensor_column(machine_, channel, signals_)) {
      Sensor& sensor = sensors_.emplace_back();
      sensor.channel = channel;
      sensor.column = *column;
    }
  if (sensors_.empty()) return rows;
  return std::make_unique<SensorRows>(std::move(rows), [this](const TraceRow& row) {
    for (Sensor& sensor : sensors_) sensor.waiting.push_back({row.t_ns, row.fields[sensor.column]});
  });
}

std::vector<std::size_t> SensorWatches::columns() const {
  std::vector<std::size_t> all;
  for (const Sensor& sensor : sensors_) all.push_back(sensor.column);
  return all;
}

Expected<Done> SensorWatches::plan(double sample_period_s, StackPlan& plan) {
  for (const Channel channel : kSensorChannels) {
    auto planned = plan_sensor(machine_, channel, signals_, sample_period_s, plan);
    if (!planned) return planned.error();
    for (Sensor& sensor : sensors_) {
      if (!*planned || sensor.channel != channel) continue;
      sensor.per_unit = (*planned)->per_unit;
      sensor.ear = std::make_unique<HostSensorChatter>();
      sensor.ear->configure((*planned)->config);
    }
  }
  return Done{};
}

std::vector<SensorWatches::Change> SensorWatches::sample(Nanoseconds t_ns, bool recorded,
                                                         const MachineStack& stack) {
  std::vector<Change> out;
  for (Sensor& s : sensors_) {
    Quality quality = Quality::missing;
    while (!s.waiting.empty() && s.waiting.front().t_ns <= t_ns) {
      const TraceField& field = s.waiting.front().field;
      if (recorded && field.state == TraceField::State::value) {
        s.last = s.per_unit * field.value;
        quality = Quality::good;
      }
      s.waiting.pop_front();
    }
    if (!s.ear) continue;
    ++s.samples;
    s.missing += quality == Quality::good ? 0 : 1;
    StateChange<double> change;
    if (s.ear->process(stack.first(), s.last, quality, change))
      out.push_back({change, event_from(change, t_ns)});
  }
  return out;
}

void SensorWatches::tell(StackPlan& plan) const {
  for (const Sensor& s : sensors_)
    for (MonitorAvailability& m : plan.monitors) {
      if (m.monitor != MonitorId::chatter || m.channel != s.channel || !s.ear) continue;
      const double share =
          static_cast<double>(s.missing) / static_cast<double>(std::max(s.samples, std::size_t{1}));
      if (share > kMostMissing)
        m.reason = "has no value in " + printed(100 * share) +
                   " % of the samples: it has to be sampled with the drives; " + m.reason;
    }
}

Expected<std::vector<SensorFound>> learn_sensors(const MachineFile& machine, const StackPlan& plan,
                                                 const std::string& trace, double sample_period_s,
                                                 std::vector<std::string>& remarks) {
  std::vector<SensorFound> all;
  auto reader = TraceReader::open(trace);
  if (!reader) return reader.error();
  const std::vector<Signal> signals = reader->signals();
  if (std::ranges::none_of(kSensorChannels, [&](Channel channel) {
        return sensor_column(machine, channel, signals).has_value();
      }))
    return all;
  std::vector<TraceRow> rows;
  for (TraceRow row;;) {
    auto more = reader->next(row);
    if (!more) return more.error();
    if (!*more) break;
    rows.push_back(row);
  }
  auto angle = spindle_angle(signals, rows, machine, trace);
  if (!angle) return angle.error();
  for (const Channel channel : kSensorChannels) {
    const auto column = sensor_column(machine, channel, signals);
    if (!column) continue;
    const double per_unit =
        machine.number(monitor_section(MonitorId::chatter, channel), sensor_keys(channel).per_unit)
            .value_or(1);
    std::vector<double> values;
    for (const TraceRow& row : rows) {
      const TraceField& field = row.fields[*column];
      values.push_back(field.state == TraceField::State::value
                           ? per_unit * field.value
                           : std::numeric_limits<double>::quiet_NaN());
    }
    auto learned = learn_sensor(values, angle->angle_rad, sample_period_s);
    if (learned)
      all.push_back(
          {channel, std::move(*learned),
           power_in_air(sensor_config(plan, channel, sample_period_s), values, angle->angle_rad)});
    else
      remarks.push_back(std::string(name_of(channel)) + ": " + learned.error().sentence);
  }
  return all;
}

void write_sensor(MachineFile& machine, const SensorFound& found, double sample_period_s,
                  double false_alarms_per_hour, std::vector<std::string>& remarks) {
  const std::string section = monitor_section(MonitorId::chatter, found.channel);
  constexpr std::size_t kMost = HostSensorChatter::Chatter::Lines::kOwnLines;
  machine.set(section, sensor_keys(found.channel).noise, found.idle.noise,
              "rms in the air, off the lines and multiples of the rotation");
  machine.remove(section, "own_lines_hz");
  if (const auto own = found.idle.own_lines_hz(kMost); !own.empty())
    machine.set(section, "own_lines_hz", own);
  machine.set(section, "line_threshold",
              usual_sensor_line_threshold(sample_period_s, false_alarms_per_hour));
  if (found.power.count() > 0)
    machine.set(section, sensor_keys(found.channel).threshold, found.power.threshold());
  else
    remarks.push_back(
        std::string(name_of(found.channel)) +
        ": the spindle never turns fast and steadily enough to learn the power of the "
        "air; lines alone are heard");
  machine.set(section, "learned_sample_rate_hz", 1 / sample_period_s);
  machine.set(section, "provenance", kIdleProvenance);
  if (found.idle.own_lines.size() > kMost)
    remarks.push_back(std::string(name_of(found.channel)) + ": the machine has " +
                      std::to_string(found.idle.own_lines.size()) +
                      " lines of its own, of which the strongest " + std::to_string(kMost) +
                      " are left out; the others may be taken for chatter");
}

void print_sensor(const SensorFound& found) {
  const char* unit = unit_of_sensor(found.channel);
  say("%s: noise %s %s rms", std::string(name_of(found.channel)).c_str(),
      printed(found.idle.noise).c_str(), unit);
  for (const SensorIdle::Line& line : found.idle.own_lines)
    say("%s %s Hz (%s %s)", &line == found.idle.own_lines.data() ? "; lines of its own:" : ",",
        printed(line.frequency_hz).c_str(), printed(line.amplitude).c_str(), unit);
  say("\n");
}

void write_sensors_json(JsonWriter& json, const std::vector<SensorFound>& found) {
  json.objects("sensors", found, [&](const SensorFound& f) {
    json.member("channel", std::string_view(name_of(f.channel)));
    json.member("unit", unit_of_sensor(f.channel));
    json.member("noise", f.idle.noise);
    json.member("chatter_threshold", f.power.threshold());
    json.objects("own_lines", f.idle.own_lines, [&](const SensorIdle::Line& line) {
      json.member("frequency_hz", line.frequency_hz);
      json.member("amplitude", line.amplitude);
    });
  });
}

}  // namespace servosense::cli
