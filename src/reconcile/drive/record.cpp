// From trace and machine file to one conditioned drive.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "reconcile/drive/closed_loop.hpp"
#include "reconcile/drive/effort_check.hpp"
#include "reconcile/drive/motor_temperature.hpp"
#include "reconcile/signal_check.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/effort_sign.hpp"
#include "servosense/identify/idle_signs.hpp"
#include "servosense/identify/power_losses.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/sample_period.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/io/travel.hpp"
#include "servosense/io/unit_watch.hpp"
#include "servosense/observer/machine_config.hpp"
#include "servosense/reconcile/drive.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kPreslidingInCounts = 4;  // less would chatter with them
constexpr double kLongestHole_s = 1;  // the machine may have been off, its encoder's zero moved
constexpr std::size_t kLongestFill = 20'000'000;  // samples: a hole longer than that is no record

Quality quality_at(const Trace& trace, std::size_t column, std::size_t row) {
  if (std::isnan(trace.columns[column][row])) return Quality::invalid;
  return trace.updated[column][row] ? Quality::good : Quality::held;
}

/// What the motors of a drive give.
Column effort_of(const Trace& trace, const DriveColumns& columns) {
  Column effort = trace.columns[columns.effort_column];
  if (const auto second = columns.second_effort_column)
    for (std::size_t i = 0; i < effort.size(); ++i) effort[i] += trace.columns[*second][i];
  return effort;
}

/// How far a drive travels in all, as recorded.
double travel_of(const Trace& trace, const DriveColumns& columns) {
  const Column& motion = trace.columns[columns.motion_column];
  double low = 1e300, high = -1e300;
  for (const double x : motion)
    if (std::isfinite(x)) {
      low = std::min(low, x);
      high = std::max(high, x);
    }
  return high > low ? high - low : 0;
}

/// An axis whose trace has the angle of its motor instead of counts, or only its speed, moves by
/// the lead. A position beside the angle is that of a scale, as beside counts: it is given back,
/// per axis, and its place in the trace taken.
std::array<Column, kAxes> angles_to_travel(const MachineFile& machine, Trace& trace) {
  std::array<Column, kAxes> scales;
  for (std::size_t i = 0; i < kAxes; ++i) {
    const Channel channel = axis_channel(i);
    const double lead = machine.number(section_of(channel), "lead_m").value_or(0) /
                        machine.number(section_of(channel), "gear_ratio").value_or(1);
    const auto column_of = [&](Quantity quantity) {
      const auto at = std::ranges::find(trace.signals, Signal{channel, quantity});
      return static_cast<std::size_t>(at - trace.signals.begin());
    };
    const std::size_t none = trace.signals.size(), angle = column_of(Quantity::angle_rad);
    const std::size_t speed = column_of(Quantity::speed_rad_s);
    if (lead > 0 && speed != none && column_of(Quantity::velocity_m_s) == none) {
      trace.signals[speed].quantity = Quantity::velocity_m_s;
      for (double& v : trace.columns[speed]) v *= m_per_rad(lead);
    }
    if (!(lead > 0) || angle == none || column_of(Quantity::angle_counts) != none) continue;
    Column travel = trace.columns[angle];
    for (double& x : travel) x *= m_per_rad(lead);
    const std::size_t scale = column_of(Quantity::position_m);
    if (scale == none) {
      trace.signals[angle].quantity = Quantity::position_m;
      trace.columns[angle] = std::move(travel);
      continue;
    }
    scales[i] = std::move(trace.columns[scale]);
    trace.columns[scale] = std::move(travel);
    trace.updated[scale] = trace.updated[angle];
  }
  return scales;
}

/// An angle that may begin anew with every turn, as one that goes on.
Column through_turns(const Column& angle) {
  Travel travel(servosense::Reading::angle);
  Column out = angle;
  TraceField field;
  for (double& x : out)
    if (field.value = x; std::isfinite(x)) x = travel.add(field);
  return out;
}

/// The columns on an even time base: a hole in time is filled with the last value.
Column evenly(const Column& values, const std::vector<std::size_t>& row_of) {
  Column out;
  out.reserve(row_of.size());
  double last = 0;
  for (const double v : values)
    if (std::isfinite(v)) {
      last = v;
      break;
    }
  for (const std::size_t row : row_of) {
    if (std::isfinite(values[row])) last = values[row];
    out.push_back(last);
  }
  return out;
}

/// A hole too long to be bridged starts the conditioning anew, and its travel would be lost, and
/// with it every place and angle behind it. Both ends of the hole are known here: the travel is
/// spread over it. Speeds alone tell nothing of it.
class TravelThroughHoles {
 public:
  explicit TravelThroughHoles(const DriveInputConfig& input) : input_(input) {}
  void after(const RawDriveSample<double>& raw, std::vector<DriveSample<double>>& samples) {
    if (input_.kind == MotionKind::velocity || has(raw.motion_quality, kUnusable | Quality::held))
      return;
    const std::size_t now = samples.size() - 1;
    const double hole_s = static_cast<double>(now - last_) * input_.sample_period_s;
    if (started_ && has(samples[now].quality, Quality::restarted) && now > last_ + 1 &&
        hole_s <= kLongestHole_s) {
      const double each = since_last(raw) / static_cast<double>(now - last_);
      for (std::size_t i = last_ + 1; i <= now; ++i) samples[i].increment = each;
    }
    last_ = now;
    last_raw_ = raw;
    started_ = true;
  }

 private:
  [[nodiscard]] double since_last(const RawDriveSample<double>& raw) const {
    if (input_.kind == MotionKind::position) return raw.motion - last_raw_.motion;
    // Counters wrap: the nearest way round.
    const unsigned spare = 64 - input_.counter_bits;
    const auto steps =
        static_cast<std::int64_t>(
            (static_cast<std::uint64_t>(raw.counts) - static_cast<std::uint64_t>(last_raw_.counts))
            << spare) >>
        spare;
    return static_cast<double>(steps) * input_.unit_per_count;
  }
  DriveInputConfig input_;
  RawDriveSample<double> last_raw_;
  std::size_t last_ = 0;
  bool started_ = false;
};

/// An effort that repeats its own extreme, again and again, is cut off there.
void mark_clipped(std::vector<DriveSample<double>>& samples) {
  for (const double sign : {1.0, -1.0}) {
    double most = 0;
    for (const auto& s : samples) most = std::max(most, sign * s.effort);
    std::size_t run = 0, runs = 0;
    const auto at_end = [&](const DriveSample<double>& s) {
      return most > 0 && sign * s.effort >= most * (1 - 1e-9);
    };
    for (const auto& s : samples) {
      run = at_end(s) && !has(s.quality, Quality::held) ? run + 1 : 0;
      if (run == 3) ++runs;
    }
    if (runs < 2) continue;
    for (auto& s : samples)
      if (at_end(s)) s.quality |= Quality::saturated;
  }
}

/// Step of a motion that is recorded in whole steps without being called counts; 0 where it is not,
/// or where noise of many steps hides it. A speed is the last difference of a position.
double step_of(const Column& motion, MotionKind kind, double period_s) {
  constexpr std::size_t kFewest = 100;
  constexpr double kRounding = 0.05;    // of the mean change: digits of the text
  constexpr double kOff = 0.1;          // of a step
  constexpr double kMostAtOnce = 20;    // more tells nothing: the step itself is not exact
  constexpr double kMostlyWhole = 0.9;  // faults are not
  if (kind == MotionKind::counts) return 0;
  Column changes;
  double mean = 0;
  for (std::size_t i = 2; i < motion.size(); ++i) {
    const double change = kind == MotionKind::velocity
                              ? motion[i] - motion[i - 1]
                              : motion[i] - 2 * motion[i - 1] + motion[i - 2];
    if (!std::isfinite(change)) continue;
    mean += std::abs(change) / static_cast<double>(motion.size());
    changes.push_back(std::abs(change));
  }
  std::erase_if(changes, [&](double change) { return change <= kRounding * mean; });
  if (changes.size() < kFewest) return 0;
  const auto low = changes.begin() + static_cast<long>(changes.size() / 20);
  std::nth_element(changes.begin(), low, changes.end());
  double sum = 0, count = 0;
  for (const double change : changes)
    if (std::abs(change / *low - 1) < kOff) {
      sum += change;
      ++count;
    }
  const double step = sum / count;
  const auto whole = std::count_if(changes.begin(), changes.end(), [&](double change) {
    const double steps = change / step;
    return steps < kMostAtOnce && std::abs(steps - std::round(steps)) < kOff;
  });
  if (static_cast<double>(whole) < kMostlyWhole * static_cast<double>(changes.size())) return 0;
  return kind == MotionKind::velocity ? step * period_s : step;
}

/// Puts neighbours in the place of samples.
void stand_in(Trace& trace, std::size_t column, const std::vector<std::size_t>& samples) {
  Column& values = trace.columns[column];
  for (const std::size_t i : samples) values[i] = std::nan("");
  std::size_t before = 0;  // the last that stays
  for (std::size_t k = 0; k < samples.size(); ++k) {
    const std::size_t i = samples[k];
    if (k == 0 || samples[k - 1] + 1 != i) before = i > 0 ? i - 1 : i;
    std::size_t behind = i + 1;
    while (behind < values.size() && std::binary_search(samples.begin(), samples.end(), behind))
      ++behind;
    if (behind >= values.size() || !std::isfinite(values[behind] - values[before])) continue;
    values[i] = values[before] + (values[behind] - values[before]) *
                                     static_cast<double>(i - before) /
                                     static_cast<double>(behind - before);
    if (!trace.counts[column].empty()) {
      trace.counts[column][i] = std::llround(values[i]);
      values[i] = static_cast<double>(trace.counts[column][i]);
    }
  }
}

bool is_place(Quantity q) {
  return q == Quantity::position_m || q == Quantity::angle_rad || q == Quantity::angle_counts;
}

struct Strays {
  std::vector<std::size_t> samples;
  std::vector<BadSignal> found;
};
Expected<Strays> strays_of(const Trace& trace, std::size_t column, double size,
                           const Criteria& criteria) {
  // Physical: a velocity loop answers within 5 ms to 10 ms (20 Hz to 50 Hz). Of rows that are
  // further apart one that stands alone may be the whole of a move.
  constexpr double kDense_s = 0.005;
  const double span_s = trace.t_s.back() - trace.t_s.front();
  if (span_s > kDense_s * static_cast<double>(trace.t_s.size() - 1)) return Strays{};
  Strays strays{stray_samples(trace.columns[column], size, criteria), {}};
  auto found = leave_out(column_name(trace.signals[column]), kStray,
                         "the cable, its shield and the order of the rows", trace.t_s,
                         strays.samples, criteria);
  if (!found) return found.error();
  strays.found = std::move(*found);
  return strays;
}

/// Strays of both columns make room for their neighbours, a motion that is stuck for nothing.
Expected<Done> leave_out_bad_samples(Trace& trace, const DriveColumns& columns, DriveData& data,
                                     const Criteria& criteria) {
  const std::size_t motion = columns.motion_column;
  const bool speed = columns.signal.motion == MotionKind::velocity;
  std::vector<std::size_t> looked_at = {motion, columns.effort_column};
  if (const auto second = columns.second_effort_column) looked_at.push_back(*second);
  for (const std::size_t column : looked_at) {
    const Column& values = trace.columns[column];
    const auto strays = strays_of(
        trace, column, column == motion && !speed ? size_of_motion(values) : size_of_effort(values),
        criteria);
    if (!strays) return strays.error();
    stand_in(trace, column, strays->samples);
    data.bad_signals.insert(data.bad_signals.end(), strays->found.begin(), strays->found.end());
  }
  if (speed) return Done{};
  const auto stuck = stuck_samples(trace.columns[motion], criteria);
  const auto found = leave_out(
      column_name(trace.signals[motion]), "repeat the one before while the drive is at speed",
      "the encoder, its cable and whether the recorder keeps up", trace.t_s, stuck, criteria);
  if (!found) return found.error();
  for (const std::size_t i : stuck) trace.columns[motion][i] = std::nan("");
  data.bad_signals.insert(data.bad_signals.end(), found->begin(), found->end());
  return Done{};
}

/// The motion of a row, as a drive gets it.
RawDriveSample<double> raw_motion(const Trace& trace, std::size_t column, std::size_t row) {
  RawDriveSample<double> raw;
  raw.motion_quality = quality_at(trace, column, row);
  raw.motion = trace.columns[column][row];
  if (!trace.counts[column].empty()) raw.counts = trace.counts[column][row];
  return raw;
}

/// Travel from the first row on. Where rows are missing the last one stands for them.
Column travel_along(const Trace& trace, std::size_t column, const DriveInputConfig& input,
                    const std::vector<std::size_t>& row_of) {
  DriveInput<double> conditioner;
  conditioner.configure(input);
  Column travel;
  travel.reserve(row_of.size());
  double at = 0;
  for (const std::size_t row : row_of) {
    at += conditioner.process(raw_motion(trace, column, row)).increment;
    travel.push_back(at);
  }
  return travel;
}

/// What other axes do: it may reach this one.
Expected<Done> read_others(const MachineFile& machine, const Trace& trace,
                           const std::vector<std::size_t>& row_of, DriveData& data) {
  for (std::size_t i = 0; i < kAllAxes; ++i) {
    const Channel channel = axis_channel(i);
    const auto motion = motion_column(trace.signals, channel);
    if (channel == data.channel || !motion) continue;
    const auto config = drive_config(machine, channel);
    if (!config) return config.error();
    DriveData::Other other;
    other.channel = channel;
    DriveSignal signal;
    signal.motion = motion->kind;
    ColumnChoice choice;
    choice.gantry = machine.flag(section_of(channel), "gantry").value_or(false);
    const auto columns = drive_columns(trace.signals, channel, choice);
    if (columns) signal = columns->signal;
    const DriveInputConfig input = config->input(signal, data.sample_period_s);
    if (DriveInput<double>::validate(input).ok())
      other.position = travel_along(trace, motion->column, input, row_of);
    if (columns) {
      other.effort = evenly(effort_of(trace, *columns), row_of);
      for (double& u : other.effort) u *= columns->effort_scale * input.effort_per_unit;
    }
    if (!other.position.empty() || !other.effort.empty()) data.others.push_back(std::move(other));
  }
  return Done{};
}

/// How much of the record is not used, and why.
void remark_on_faults(DriveData& data) {
  struct Fault {
    Quality quality;
    const char* what;
  };
  constexpr double kWorthSaying = 1e-3;  // of the samples
  const auto n = static_cast<double>(data.samples.size());
  for (const Fault& fault :
       {Fault{Quality::saturated, "an effort cut off at its limit"},
        Fault{Quality::invalid | Quality::missing | Quality::stuck, "no value or none that counts"},
        Fault{Quality::jump, "a jump of the motion"}}) {
    const auto count = static_cast<double>(std::ranges::count_if(
        data.samples, [&](const auto& s) { return has(s.quality, fault.quality); }));
    if (count > kWorthSaying * n)
      data.remarks.push_back(printed(100 * count / n, 2) + " % of the samples have " + fault.what +
                             ": they and what is smoothed with them are left out");
  }
}

/// What is not looked at.
void remark_on_columns(const std::vector<Signal>& signals, const DriveColumns& columns,
                       DriveData& data) {
  std::vector<std::size_t> used = {columns.motion_column, columns.effort_column};
  if (const auto second = columns.second_effort_column) used.push_back(*second);
  if (const auto temperature = columns.temperature_column) used.push_back(*temperature);
  for (std::size_t i = 0; i < signals.size(); ++i) {
    const Channel channel = signals[i].channel;
    const Quantity q = signals[i].quantity;
    const bool own = channel == data.channel;
    const bool axis = is_axis(channel);
    const bool command = q == Quantity::command_angle_rad || q == Quantity::command_position_m ||
                         q == Quantity::command_velocity_m_s || q == Quantity::following_error_m ||
                         q == Quantity::following_error_rad;
    const auto other = axis && !own ? drive_columns(signals, channel) : std::nullopt;
    const auto moves = axis && !own ? motion_column(signals, channel) : std::nullopt;
    if ((own && (command || q == Quantity::position_m || q == Quantity::angle_rad)) ||
        (moves && moves->column == i) || (other && other->effort_column == i))
      used.push_back(i);
  }
  // The last sentence names them; those before it are about drives that nobody watches.
  if (const auto unused = unused_columns(signals, used); !unused.empty())
    data.remarks.push_back(unused.back());
}

double lag_of(const MachineFile& machine, const std::string& channel) {
  const std::string section = "controller." + channel;
  double lag = machine.number(section, "delay_s").value_or(0);
  const double bandwidth = machine.number(section, "current_bandwidth_hz").value_or(0);
  if (bandwidth > 0) lag += 1 / (kTwoPi * bandwidth);
  return lag;
}

}  // namespace

double usual_presliding(const DriveModelConfig& model, Channel channel) {
  constexpr double kOfSpindle = 1e-3;      // rad
  constexpr double kOfTurn = 5e-4;         // 5 um at a lead of 10 mm
  constexpr double kOfLinearMotor = 5e-6;  // m
  constexpr double kOfTable = 1e-4;        // rad; that of a linear axis at a radius of 50 mm
  if (is_turning(channel)) return is_spindle(channel) ? kOfSpindle : kOfTable;
  return model.unit_per_turn > 0 ? kOfTurn * model.unit_per_turn : kOfLinearMotor;
}

namespace {

/// The columns of the drive that was asked for, or of the first that moves.
Expected<DriveColumns> drive_in(const Trace& trace, const MachineFile& machine,
                                const ColumnChoices& choices, std::optional<Channel> wanted,
                                const std::string& trace_path, DriveData& data) {
  std::optional<DriveColumns> columns;
  bool any_moves = false;
  for (const Channel channel : {Channel::x, Channel::y, Channel::z, Channel::a, Channel::b,
                                Channel::c, Channel::spindle, Channel::spindle2}) {
    const ColumnChoice& own = choices.drive(channel);
    if (!own.effort.empty() && !column_named(trace.signals, own.effort))
      return data_error(trace_path + ": has no column " + own.effort +
                        ", which the machine file names as effort_column; correct it");
    ColumnChoice choice = own;
    choice.lead_m = choice.constant_motion = 0;  // angles are travel already, motion is recorded
    const auto found = drive_columns(trace.signals, channel, choice);
    if (!found) continue;
    if (wanted ? channel != *wanted : !machine.has_section(section_of(channel))) continue;
    // The first that moves; if none does, the first of all.
    const bool moves = travel_of(trace, *found) > 0;
    if (columns && (!moves || any_moves)) continue;
    columns = found;
    data.channel = channel;
    any_moves = moves;
  }
  const std::string name(name_of(wanted.value_or(data.channel)));
  if (!columns) {
    if (wanted)
      return data_error(trace_path + ": channel " + name + " lacks motion or effort; record " +
                        name + (is_turning(*wanted) ? ".angle_counts" : ".position_m") + " and " +
                        name + ".current_A");
    return data_error(trace_path + ": no drive of " + machine.name() +
                      " has both motion and effort; record for example x.position_m and "
                      "x.current_A");
  }
  const std::string section(section_of(data.channel));
  if (!machine.has_section(section))
    return data_error(machine.name() + ": there is no section [" + section +
                      "]; write it, or let 'servosense identify idle' find its values");
  return *columns;
}

/// What the machine file says about it, and how its columns are read.
Expected<DriveInputConfig> model_of(const MachineFile& machine, const Trace& trace,
                                    const DriveColumns& columns, DriveData& data) {
  const std::string name(name_of(data.channel)), section(section_of(data.channel));
  const bool is_current = columns.signal.effort == EffortKind::current_A;
  DriveInputConfig input;
  if (data.turns()) {
    auto spindle = spindle_config(machine, data.channel);
    if (!spindle) return spindle.error();
    spindle->effort_is_current = is_current;
    input = spindle->input(columns.signal, data.sample_period_s);
    data.observer = spindle->disturbance_observer(data.sample_period_s, spindle->observer);
  } else {
    auto axis = axis_config(machine, data.channel);
    if (!axis) return axis.error();
    axis->effort_is_current = is_current;
    input = axis->input(columns.signal, data.sample_period_s);
    data.observer = axis->disturbance_observer(data.sample_period_s, axis->observer);
    if (columns.signal.effort == EffortKind::current_A && !(axis->force_constant_N_per_A > 0) &&
        !(axis->torque_constant_Nm_per_A > 0))
      return data_error(machine.where(section) + ": [" + section +
                        "] lacks force_constant_N_per_A or torque_constant_Nm_per_A, so the "
                        "current cannot be turned into a force; write one");
  }
  if (std::string said = leave_out_effects_of_current(data.channel, columns.signal.effort,
                                                      data.observer.drive.effects);
      !said.empty())
    data.remarks.push_back(std::move(said));
  data.model = data.observer.drive;
  if (!(data.model.inertia > 0))
    return data_error(machine.where(section) + ": [" + section + "] lacks " +
                      (data.turns() ? "inertia_kg_m2" : "equivalent_mass_kg") +
                      "; write it, or let 'servosense identify idle' find it");
  data.effort_per_unit = input.effort_per_unit;
  data.motor_turn = data.turns() ? kTwoPi / machine.number(section, "gear_ratio").value_or(1)
                                 : data.model.unit_per_turn;
  data.unit_per_count = input.kind == MotionKind::counts ? input.unit_per_count : 0;
  if (!machine.has(section, data.turns() ? "friction_knee_rad" : "friction_knee_m"))
    data.model.friction_knee = std::max(usual_presliding(data.model, data.channel),
                                        kPreslidingInCounts * std::abs(data.unit_per_count));
  data.motion_step =
      step_of(trace.columns[columns.motion_column], input.kind, data.sample_period_s);
  data.expected_lag_s = lag_of(machine, name);
  if (input.kind == MotionKind::counts && !(std::abs(input.unit_per_count) > 0))
    return data_error(machine.where(section) + ": [" + section +
                      "] lacks encoder_counts_per_rev, which the column " + name +
                      ".angle_counts needs");
  if (const Status status = DriveInput<double>::validate(input); !status.ok())
    return data_error(machine.where(section) + ": [" + section + "] " + status.parameter() + " " +
                      status.reason());
  return input;
}

/// Rows on an even time base: where some are missing, their place is kept.
struct EvenTime {
  std::vector<std::size_t> row_of;
  std::vector<bool> recorded;
};
Expected<EvenTime> even_time(const Trace& trace, double period_s, const std::string& trace_path) {
  EvenTime time;
  for (std::size_t i = 0; i < trace.size(); ++i) {
    if (i > 0) {
      const double steps = std::round((trace.t_s[i] - trace.t_s[i - 1]) / period_s);
      if (steps > 1 && (steps > static_cast<double>(kLongestFill) ||
                        time.row_of.size() + static_cast<std::size_t>(steps) > kLongestFill))
        return data_error(trace_path + ": a hole of " + std::to_string(steps * period_s) +
                          " s in the time; cut the trace there");
      for (double k = 1; k < steps; ++k) {
        time.row_of.push_back(i - 1);
        time.recorded.push_back(false);
      }
    }
    time.row_of.push_back(i);
    time.recorded.push_back(true);
  }
  return time;
}

void condition(const Trace& trace, const DriveColumns& columns, const EvenTime& time,
               const DriveInputConfig& input, DriveData& data) {
  DriveInput<double> conditioner;
  conditioner.configure(input);
  TravelThroughHoles travel(input);
  const Column effort = effort_of(trace, columns);
  data.samples.reserve(time.row_of.size());
  for (std::size_t i = 0; i < time.row_of.size(); ++i) {
    const std::size_t row = time.row_of[i];
    RawDriveSample<double> raw;
    if (time.recorded[i]) {
      raw = raw_motion(trace, columns.motion_column, row);
      raw.effort_quality = quality_at(trace, columns.effort_column, row);
      if (const auto second = columns.second_effort_column) {
        const Quality other = quality_at(trace, *second, row);
        raw.effort_quality = has(raw.effort_quality | other, Quality::invalid)
                                 ? Quality::invalid
                                 : std::min(raw.effort_quality, other);  // new where one is
      }
      raw.effort = columns.effort_scale * effort[row];
    } else {
      raw.motion_quality = raw.effort_quality = Quality::missing;
    }
    data.samples.push_back(conditioner.process(raw));
    travel.after(raw, data.samples);
  }
}

/// Signs of a current that is reported as an absolute value. Data error where it seems to be one,
/// and the machine file does not say.
Expected<Done> find_signs(const MachineFile& machine, bool power, DriveData& data) {
  const auto stated = machine.flag(section_of(data.channel), "current_is_unsigned");
  if (!stated && (power || data.model.effort_per_ampere > 0)) {
    DriveRecord record{data.channel, data.sample_period_s, data.samples};
    IdleOptions options;
    options.power = power;
    if (recognise_idle_signs(data.observer, record, data.unit_per_count, options))
      return data_error(signs_wanted(data.channel));
  }
  if (!stated || !*stated) return Done{};
  data.remarks.push_back(signs_found(
      data.channel, resolve_signs(data.samples, effort_sign_config(data.model, data.sample_period_s,
                                                                   data.unit_per_count))));
  return Done{};
}

}  // namespace

Expected<DriveData> read_drive(const MachineFile& machine, const std::string& trace_path,
                               std::optional<Channel> wanted, const Criteria& criteria) {
  auto read = read_trace(trace_path);
  if (!read) return read.error();
  Trace& trace = *read;
  const ColumnChoices choices = column_choices(machine);
  if (auto done = check_units(trace, choices, trace_path); !done) {
    // Rows out of order look like speeds that no machine has.
    for (std::size_t i = 0; i < trace.signals.size(); ++i)
      if (is_place(trace.signals[i].quantity))
        if (auto sound = strays_of(trace, i, size_of_motion(trace.columns[i]), criteria); !sound)
          return sound.error();
    return done.error();
  }
  const std::array<Column, kAxes> scales = angles_to_travel(machine, trace);
  DriveData data;
  data.sample_period_s = sample_period(trace.t_s);
  if (!(data.sample_period_s > 0))
    return data_error(trace_path + ": fewer than two rows; record at least some seconds of motion");

  const auto columns = drive_in(trace, machine, choices, wanted, trace_path, data);
  if (!columns) return columns.error();
  const auto read_model = model_of(machine, trace, *columns, data);
  if (!read_model) return read_model.error();
  const DriveInputConfig& input = *read_model;

  const auto time = even_time(trace, data.sample_period_s, trace_path);
  if (!time) return time.error();
  const std::vector<std::size_t>& row_of = time->row_of;
  data.source = trace_path;
  data.start_s = trace.t_s[0];
  if (input.kind == MotionKind::position)
    for (const double x : trace.columns[columns->motion_column])
      if (std::isfinite(x)) {
        data.start_position = x;
        break;
      }
  const double servo_hz = machine.number("machine", "sample_rate_hz").value_or(0);
  data.servo_period_s =
      servo_hz > 0 ? std::min(data.sample_period_s, 1 / servo_hz) : data.sample_period_s;

  if (auto done = leave_out_bad_samples(trace, *columns, data, criteria); !done)
    return done.error();
  condition(trace, *columns, *time, input, data);
  mark_clipped(data.samples);
  if (columns->power || columns->rated_to_rad_s > 0)
    torque_of_load(data.samples, data.sample_period_s, *columns);
  if (columns->power)
    mark_too_slow(data.samples, data.sample_period_s, columns->power->known_from_rad_s,
                  Quality::invalid);
  read_temperature(trace, *columns, choices.drive(data.channel).constant, row_of, data);
  if (auto done = find_signs(machine, columns->power.has_value(), data); !done) return done.error();
  if (columns->power) {
    take_off_losses(data.samples, data.sample_period_s, *columns->power);
    bridge_too_slow(data.samples, data.sample_period_s, columns->power->known_from_rad_s,
                    Quality::invalid);
  }
  if (auto done = check_effort(column_name(trace.signals[columns->effort_column]), data, criteria);
      !done)
    return done.error();
  remark_on_faults(data);
  if (input.kind == MotionKind::counts)
    if (const auto* load =
            trace.find({data.channel, data.turns() ? Quantity::angle_rad : Quantity::position_m}))
      data.load_position = evenly(data.turns() ? through_turns(*load) : *load, row_of);
  for (std::size_t i = 0; i < kAxes; ++i)
    if (data.channel == axis_channel(i) && !scales[i].empty())
      data.load_position = evenly(scales[i], row_of);
  read_loop(machine, trace, row_of, data);
  if (auto done = read_others(machine, trace, row_of, data); !done) return done.error();
  remark_on_columns(trace.signals, *columns, data);
  if (auto motion = trace.meta("worked out")) data.remarks.push_back(std::move(*motion));
  if (std::string said = effort_share(machine, data.channel).said; !said.empty())
    data.remarks.push_back(std::move(said));
  if (std::string said = commanded_effort(trace.signals, data.channel, *columns); !said.empty())
    data.remarks.push_back(std::move(said));
  return data;
}

}  // namespace servosense::reconcile
