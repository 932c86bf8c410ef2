#include "servosense/monitors/vibration_plan.hpp"

#include <algorithm>
#include <cmath>

#include "obstacle.hpp"
#include "servosense/core/plausible.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

// As the torque's: several harmonics of a spindle at 3000 rpm below half the rate.
constexpr double kLeastRate_hz = 500;

/// Amplitude of a line that is heard in so much noise, were it white: of the Hann window, N
/// samples, score = amplitude^2 N / (6 noise^2).
double smallest_line(const SensorChatterConfig& c, double noise) {
  using Lines = HostSensorChatter::Chatter::Lines;
  constexpr double kSamplesAPart = 2.4;
  return noise * std::sqrt(6 * c.chatter.lines.threshold / (Lines::kParts * kSamplesAPart));
}

}  // namespace

Signal usual_column(Channel sensor) noexcept {
  return {sensor, sensor == Channel::microphone ? Quantity::sound_Pa : Quantity::acceleration_m_s2};
}

const char* unit_of_sensor(Channel sensor) noexcept {
  return sensor == Channel::microphone ? "Pa" : "m/s2";
}

SensorKeys sensor_keys(Channel sensor) noexcept {
  return sensor == Channel::microphone
             ? SensorKeys{"Pa_per_unit", "noise_Pa", "chatter_threshold_Pa2"}
             : SensorKeys{"m_s2_per_unit", "noise_m_s2", "chatter_threshold_m2_s4"};
}

SensorChatterConfig sensor_config(const StackPlan& plan, Channel sensor, double sample_period_s) {
  SensorChatterConfig c = sensor_chatter_defaults(sensor, sample_period_s);
  const ChatterConfig& spindle = plan.config.spindle.chatter;
  c.chatter.teeth = spindle.teeth;
  c.chatter.minimum_speed_rad_s = spindle.minimum_speed_rad_s;
  c.chatter.window_revolutions = spindle.window_revolutions;
  c.chatter.harmonics = spindle.harmonics;
  return c;
}

std::optional<std::size_t> sensor_column(const MachineFile& machine, Channel sensor,
                                         const std::vector<Signal>& signals) {
  return column_named(signals, machine.text(monitor_section(MonitorId::chatter, sensor), "column")
                                   .value_or(column_name(usual_column(sensor))));
}

Expected<std::optional<PlannedSensor>> plan_sensor(const MachineFile& machine, Channel sensor,
                                                   const std::vector<Signal>& signals,
                                                   double sample_period_s, StackPlan& plan) {
  const std::string section = monitor_section(MonitorId::chatter, sensor);
  const auto column = sensor_column(machine, sensor, signals);
  if (!column && !machine.has_section(section)) return std::optional<PlannedSensor>();
  const SensorKeys keys = sensor_keys(sensor);
  const double rate = 1 / sample_period_s;
  MonitorAvailability m{MonitorId::chatter, sensor, true, "", ""};
  PlannedSensor planned;
  SensorChatterConfig& c = planned.config;
  const auto noise = machine.number(section, keys.noise);
  const double learned = machine.number(section, "learned_sample_rate_hz").value_or(rate);
  if (!enabled(machine, section)) {
    keep_from(m, switched_off());
  } else if (!column) {
    keep_from(m,
              {"no column",
               "the source has no column " +
                   machine.text(section, "column").value_or(column_name(usual_column(sensor))) +
                   "; record the sensor with the drives, or name its column in [" + section + "]"});
  } else if (!plan.slot_of(plan.tool_spindle)) {
    keep_from(m,
              {"no angle", "needs the angle or speed of the spindle, and its current or torque"});
  } else if (plan.grouped) {
    keep_from(m, {"grouped monitors",
                  "does not hear samples in groups; take out "
                  "grouped_monitors"});
  } else if (rate < kLeastRate_hz) {
    keep_from(m, {"slow signal", "needs at least " + printed(kLeastRate_hz) +
                                     " Hz, the signal has " + printed(rate) + " Hz"});
  } else if (!noise) {
    keep_from(m, {"not learned",
                  "does not know which lines are the machine's own; run 'servosense "
                  "identify idle' on an idling run with this column"});
  } else if (std::abs(learned - rate) > kSameRate * rate) {
    keep_from(m, {"other conditions", "was learned at " + printed(learned) +
                                          " Hz, the signal has " + printed(rate) +
                                          " Hz; run 'servosense identify idle' at this rate"});
  }
  if (m.runs) {
    c = sensor_config(plan, sensor, sample_period_s);
    c.chatter.chatter_threshold_Nm2 = machine.number(section, keys.threshold).value_or(0);
    c.chatter.lines.threshold =
        machine.number(section, "line_threshold").value_or(c.chatter.lines.threshold);
    c.chatter.tolerated_load_share =
        machine.number(section, "tolerated_load_share").value_or(c.chatter.tolerated_load_share);
    const auto own = machine.list(section, "own_lines_hz").value_or(std::vector<double>{});
    std::copy_n(own.begin(), std::min(own.size(), c.own_lines_hz.size()), c.own_lines_hz.begin());
    if (const Status s = HostSensorChatter::validate(c); !s.ok())
      return data_error(machine.where(section) + ": [" + section + "] " + s.parameter() + " " +
                        s.reason());
    planned.column = *column;
    planned.per_unit = machine.number(section, keys.per_unit).value_or(1);
    m.reason = "listens for lines that do not turn with the spindle, up to " + printed(0.2 * rate) +
               " Hz (what is faster is damped and folded), in the air from " +
               printed(smallest_line(c, *noise)) + " " + unit_of_sensor(sensor) + " on";
    if (own.size() > c.own_lines_hz.size())
      m.reason += "; of the machine's own lines the first " +
                  std::to_string(c.own_lines_hz.size()) + " alone are left out";
    if (machine.has(section_of(plan.tool_spindle), "constant_speed_rpm"))
      m.reason +=
          "; the speed is stated and not measured, so multiples of it are left out as well "
          "as it is known";
    if (!(plan.config.cut.torque_Nm > 0))
      m.reason +=
          "; in the air, too, because cutting_torque_Nm of [monitor.collision] is not known";
  }
  const bool runs = m.runs;
  plan.monitors.push_back(std::move(m));
  if (!runs) return std::optional<PlannedSensor>();
  return std::optional<PlannedSensor>(planned);
}

}  // namespace servosense
