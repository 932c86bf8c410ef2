#include "servosense/identify/learn_reference.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "cutting_level.hpp"
#include "reference_limits.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/quantile.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/text.hpp"
#include "servosense/observer/machine_config.hpp"

namespace servosense {
namespace {

// Conventions.
constexpr double kWindowsPerCut = 48;
constexpr double kWindowsPerRun = 10;  // between air and air
constexpr double kUsualTurns = 8, kLeastSamples = 32, kMostSeconds = 5;
constexpr double kEnoughWindows = 24;
constexpr double kStretches = 128;          // of a record, to tell a cut from air
constexpr double kLeastStretchSamples = 8;  // likewise
constexpr std::size_t kBorder = 5;          // stretches at either end of a record
constexpr double kSameSpeed = 0.1;
constexpr double kLeastTravel_m = 1e-4;  // of an axis whose position tells the place

bool tells_of_cut(Quantity q) {
  switch (q) {
    case Quantity::angle_rad:
    case Quantity::angle_counts:
    case Quantity::position_m:
    case Quantity::command_angle_rad:
    case Quantity::command_position_m:
    case Quantity::command_velocity_m_s:
    case Quantity::voltage_V:
    case Quantity::temperature_C:
    case Quantity::feed_override:
    case Quantity::feed_per_tooth_m:
    case Quantity::nc_block:
      return false;
    default:
      return true;
  }
}

bool is_effort(Quantity q) {
  switch (q) {
    case Quantity::current_A:
    case Quantity::torque_Nm:
    case Quantity::force_N:
    case Quantity::power_W:
    case Quantity::load_V:
    case Quantity::load_percent:
    case Quantity::torque_percent:
    case Quantity::current_percent:
    case Quantity::force_x_N:
    case Quantity::force_y_N:
    case Quantity::force_z_N:
      return true;
    default:
      return false;
  }
}

/// The earlier, the better a cut is told by it: the tool's spindle, tool and dynamometer, other
/// drives; nothing else.
int rank(Signal s, Channel spindle) {
  if (!is_effort(s.quantity)) return 1000;
  // Of an induction motor much current magnetises: power tells more.
  const int kind = s.quantity == Quantity::torque_Nm   ? 0
                   : s.quantity == Quantity::power_W   ? 1
                   : s.quantity == Quantity::current_A ? 2
                                                       : 3;
  if (s.channel == spindle) return kind;
  if (s.channel == Channel::tool || s.channel == Channel::dyno) return 10 + kind;
  return 20 + 4 * static_cast<int>(s.channel) + kind;
}

/// Of a short part of a record.
struct Stretch {
  double seconds = 0, count = 0, turned_rad = 0;
  [[nodiscard]] double speed() const { return seconds > 0 ? std::abs(turned_rad) / seconds : 0; }
  double load = 0;             // sum of the magnitudes of the effort
  std::vector<double> square;  // sum, of each column
  std::vector<double> low, high;
};

struct Survey {
  double rate_hz = 0;
  std::vector<Signal> columns;
  std::vector<Stretch> stretches;
};

Expected<double> rate_of(const std::string& path) {
  auto reader = TraceReader::open(path);
  if (!reader) return reader.error();
  std::vector<double> steps;
  TraceRow row;
  std::optional<Nanoseconds> last;
  for (std::size_t i = 0; i < 4096; ++i) {
    auto more = reader->next(row);
    if (!more) return more.error();
    if (!*more) break;
    if (last) steps.push_back(seconds_from(row.t_ns - *last));
    last = row.t_ns;
  }
  if (steps.size() < 2) return data_error(path + ": has fewer than three rows; record a whole cut");
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return 1 / *middle;
}

Expected<Survey> survey(const MachineFile& machine, const std::string& path, Signal effort,
                        double length_s) {
  auto reader = TraceReader::open(path);
  if (!reader) return reader.error();
  Survey s;
  s.columns = reader->signals();
  auto turn = turn_column(machine, s.columns);
  if (!turn) return turn.error();
  // The cutter's own way of following an angle, through a layout without signals.
  const std::size_t at = *reader->column(effort);
  std::vector<double> held(s.columns.size(), std::numeric_limits<double>::quiet_NaN());
  TurnCounter turns(*turn);
  TraceRow row;
  std::optional<Nanoseconds> first;
  Nanoseconds last = 0;
  for (;;) {
    auto more = reader->next(row);
    if (!more) return more.error();
    if (!*more) break;
    if (!first) first = last = row.t_ns;
    const double t_s = seconds_from(row.t_ns - *first);
    const double passed_s = seconds_from(row.t_ns - last);
    last = row.t_ns;
    for (std::size_t i = 0; i < held.size(); ++i)
      if (row.fields[i].state == TraceField::State::value) held[i] = row.fields[i].value;
    if (s.stretches.empty() || t_s >= static_cast<double>(s.stretches.size()) * length_s) {
      while (t_s >= static_cast<double>(s.stretches.size() + 1) * length_s)
        s.stretches.emplace_back();  // a hole
      s.stretches.emplace_back();
    }
    Stretch& now = s.stretches.back();
    if (now.square.empty()) {
      now.square.assign(held.size(), 0);
      now.low.assign(held.size(), std::numeric_limits<double>::infinity());
      now.high.assign(held.size(), -std::numeric_limits<double>::infinity());
    }
    now.turned_rad += turns.add(row, held, passed_s);
    now.seconds += passed_s;
    if (!std::isfinite(held[at])) continue;
    now.count += 1;
    now.load += std::abs(held[at]);
    for (std::size_t i = 0; i < held.size(); ++i) {
      if (!std::isfinite(held[i])) continue;
      now.square[i] += held[i] * held[i];
      now.low[i] = std::min(now.low[i], held[i]);
      now.high[i] = std::max(now.high[i], held[i]);
    }
  }
  std::erase_if(s.stretches, [](const Stretch& one) { return one.count < 1; });
  return s;
}

}  // namespace

double least_window_s(const ReferenceLayout& layout) {
  const double turns_s =
      layout.speed_rad_s > 0 && layout.speed_rad_s < kPi / 2 * layout.sample_rate_hz
          ? kLeastTurns * kTwoPi / layout.speed_rad_s
          : 0;
  return std::max(kLeastSamples / layout.sample_rate_hz, turns_s);
}

Expected<TurnColumn> turn_column(const MachineFile& machine, const std::vector<Signal>& columns) {
  TurnColumn turn;
  const Channel spindle = tool_spindle(machine);
  const auto found = motion_column(columns, spindle);
  if (!found) {
    turn.constant_rad_s =
        rad_s_from_rpm(machine.number(name_of(spindle), "constant_speed_rpm").value_or(0));
    return turn;
  }
  turn.column = found->column;
  turn.is_speed = found->kind == MotionKind::velocity;
  turn.is_counts = found->kind == MotionKind::counts;
  turn.rad_per_unit = found->scale;
  if (!turn.is_counts) return turn;
  const auto counts = machine.number(name_of(spindle), "encoder_counts_per_rev");
  if (!counts)
    return data_error(machine.name() +
                      ": the trace has the spindle's angle in counts; write encoder_counts_per_rev "
                      "in [spindle]");
  turn.rad_per_unit = kTwoPi / *counts;
  return turn;
}

Expected<LearnedReference> learn_reference(const MachineFile& machine,
                                           const std::vector<std::string>& traces,
                                           const LearnReferenceOptions& options) {
  LearnedReference out;
  Reference& reference = out.reference;
  ReferenceLayout& layout = reference.layout;
  std::vector<Signal> common;
  std::vector<std::string> missing;
  for (const std::string& path : traces) {
    auto reader = TraceReader::open(path);
    if (!reader) return reader.error();
    const auto& here = reader->signals();
    if (&path == &traces.front()) common = here;
    const auto note_missing = [&](Signal s) {
      const std::string name = column_name(s);
      if (std::find(missing.begin(), missing.end(), name) == missing.end()) missing.push_back(name);
    };
    for (const Signal s : here)
      if (std::find(common.begin(), common.end(), s) == common.end()) note_missing(s);
    std::erase_if(common, [&](Signal s) {
      const bool gone = std::find(here.begin(), here.end(), s) == here.end();
      if (gone) note_missing(s);
      return gone;
    });
    auto rate = rate_of(path);
    if (!rate) return rate.error();
    if (layout.sample_rate_hz > 0 &&
        std::abs(*rate - layout.sample_rate_hz) > kSameRate * layout.sample_rate_hz)
      return data_error(path + ": has " + number_text(*rate) + " Hz, " + traces.front() + " " +
                        number_text(layout.sample_rate_hz) + " Hz; give traces of one sample rate");
    if (!(layout.sample_rate_hz > 0)) layout.sample_rate_hz = *rate;
  }
  for (const std::string& name : missing)
    out.remarks.push_back(name + " is not in all traces: left out");
  const Channel spindle = tool_spindle(machine);
  const auto effort = std::min_element(common.begin(), common.end(), [&](Signal a, Signal b) {
    return rank(a, spindle) < rank(b, spindle);
  });
  if (effort == common.end() || rank(*effort, spindle) >= 1000)
    return data_error(traces.front() +
                      ": no current, torque, force, power or load is in all traces; give traces "
                      "with one");
  const Signal by = *effort;

  // First reading.
  std::vector<Survey> surveys;
  double length_s = 0;
  for (const std::string& path : traces) {
    if (!(length_s > 0)) {
      // Of the first record, so that all are divided alike.
      auto reader = TraceReader::open(path);
      if (!reader) return reader.error();
      TraceRow row;
      std::optional<Nanoseconds> first;
      for (;;) {
        auto more = reader->next(row);
        if (!more) return more.error();
        if (!*more) break;
        if (!first) first = row.t_ns;
      }
      length_s = std::max(kLeastStretchSamples / layout.sample_rate_hz,
                          seconds_from(row.t_ns - first.value_or(row.t_ns)) / kStretches);
    }
    auto one = survey(machine, path, by, length_s);
    if (!one) return one.error();
    surveys.push_back(std::move(*one));
    options.progress(0.5 * static_cast<double>(surveys.size()) /
                     static_cast<double>(traces.size()));
  }
  // While the spindle runs up and down nothing is cut.
  std::vector<double> speeds;
  for (const Survey& s : surveys)
    for (const Stretch& one : s.stretches)
      if (one.speed() > 0) speeds.push_back(one.speed());
  const double fastest = speeds.empty() ? 0 : *std::max_element(speeds.begin(), speeds.end());
  std::erase_if(speeds, [&](double v) { return v < kTurning * fastest; });
  layout.speed_rad_s = median(speeds);
  std::vector<double> loads, border;
  for (Survey& s : surveys) {
    std::vector<double> speed;
    for (const Stretch& one : s.stretches) speed.push_back(one.speed());
    const auto steady = [&](std::size_t i) {
      if (!(layout.speed_rad_s > 0)) return true;
      if (speed[i] < kTurning * layout.speed_rad_s) return false;
      const auto like = [&](std::size_t j) {
        return j >= speed.size() || std::abs(speed[j] - speed[i]) <= kSameSpeed * speed[i];
      };
      return like(i - 1) && like(i + 1);  // before the first is beyond the last, too
    };
    std::vector<Stretch> kept;
    for (std::size_t i = 0; i < speed.size(); ++i)
      if (steady(i)) kept.push_back(std::move(s.stretches[i]));
    s.stretches = std::move(kept);
    if (s.stretches.empty()) continue;
    for (const Stretch& one : s.stretches) loads.push_back(one.load / one.count);
    // The lighter of its two ends.
    std::vector<double> begin, end;
    for (std::size_t i = 0; i < std::min(kBorder, s.stretches.size()); ++i) {
      const Stretch& last = s.stretches[s.stretches.size() - 1 - i];
      begin.push_back(s.stretches[i].load / s.stretches[i].count);
      end.push_back(last.load / last.count);
    }
    border.push_back(std::min(median(begin), median(end)));
  }
  layout.cutting_level = cutting_level_of(loads, border);
  std::vector<double> cut_s, run_s;  // run_s: of every cutting stretch, its whole cut
  for (const Survey& s : surveys) {
    double cutting_s = 0;
    std::size_t run = 0;
    const auto end_run = [&] {
      run_s.insert(run_s.end(), run, static_cast<double>(run) * length_s);
      run = 0;
    };
    for (const Stretch& one : s.stretches) {
      out.total_s += one.seconds;
      if (one.load / one.count < layout.cutting_level) {
        end_run();
        continue;
      }
      ++run;
      cutting_s += one.seconds;
    }
    end_run();
    out.cutting_s += cutting_s;
    cut_s.push_back(cutting_s);
  }
  for (const Survey& s : surveys) {
    auto turn = turn_column(machine, s.columns);
    if (!turn) return turn.error();
    layout.speed_measured = layout.speed_measured && turn->column;
  }
  layout.teeth = static_cast<unsigned>(machine.number("tool", "teeth").value_or(0));
  for (const Signal s : common) {
    double square = 0, count = 0;
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (const Survey& one : surveys) {
      const auto at = static_cast<std::size_t>(
          std::find(one.columns.begin(), one.columns.end(), s) - one.columns.begin());
      for (const Stretch& stretch : one.stretches) {
        if (stretch.load / stretch.count < layout.cutting_level) continue;
        square += stretch.square[at];
        count += stretch.count;
        low = std::min(low, stretch.low[at]);
        high = std::max(high, stretch.high[at]);
      }
    }
    if (s == Signal{Channel::machine, Quantity::nc_block}) layout.blocks = true;
    const bool place = s.quantity == Quantity::position_m ||
                       (s.quantity == Quantity::command_position_m &&
                        std::find(common.begin(), common.end(),
                                  Signal{s.channel, Quantity::position_m}) == common.end());
    if (place && high - low > kLeastTravel_m) layout.place.push_back(s);
    if (!tells_of_cut(s.quantity) || s.channel == Channel::machine) continue;
    if (!(high > low)) {
      out.remarks.push_back(column_name(s) + " does not change in the cuts: left out");
      continue;
    }
    if (s == by) layout.effort = layout.signals.size();
    layout.signals.push_back({s, std::sqrt(square / count)});
  }
  if (std::none_of(layout.signals.begin(), layout.signals.end(),
                   [&](const ReferenceSignal& s) { return s.signal == by; }))
    return data_error(column_name(by) + " does not change in the traces: there is no cut");
  if (layout.cutting_level == 0)
    out.remarks.push_back("nothing tells cuts from air in " + column_name(by) +
                          ": all of the traces is taken for cuts");

  // Second reading.
  layout.window_s = options.window_s;
  if (!(layout.window_s > 0)) {
    // Fewer turns where the cuts are short.
    const double turn_s =
        layout.speed_rad_s > 0 && layout.speed_rad_s < kPi / 2 * layout.sample_rate_hz
            ? kTwoPi / layout.speed_rad_s
            : 0;
    const double turns_s =
        std::clamp(out.cutting_s / kEnoughWindows, kLeastTurns * turn_s, kUsualTurns * turn_s);
    layout.window_s = std::max(
        {std::min({median(cut_s) / kWindowsPerCut, median(run_s) / kWindowsPerRun, kMostSeconds}),
         kLeastSamples / layout.sample_rate_hz, turns_s});
  }
  layout.window_s = std::round(layout.window_s * layout.sample_rate_hz) / layout.sample_rate_hz;
  if (!(layout.window_s > 0)) return data_error("a window is shorter than a sample");
  reference.machine = machine.text("machine", "name").value_or(machine.name());
  reference.tool_diameter_m = machine.number("tool", "diameter_m").value_or(0);
  reference.false_alarms = options.false_alarms;
  reference.traces = traces;
  for (std::size_t t = 0; t < traces.size(); ++t) {
    auto reader = TraceReader::open(traces[t]);
    if (!reader) return reader.error();
    auto turn = turn_column(machine, reader->signals());
    if (!turn) return turn.error();
    ReferenceCutter cutter(layout, reader->signals(), *turn);
    out.windows.push_back(0);
    const auto keep = [&](std::vector<ReferenceWindow> done) {
      for (ReferenceWindow& w : done) {
        const auto finite = [](double v) { return std::isfinite(v); };
        if (w.why != NotCompared::no || !std::all_of(w.values.begin(), w.values.end(), finite) ||
            !std::all_of(w.place.begin(), w.place.end(), finite))
          continue;
        reference.sound.push_back({t, std::move(w)});
        ++out.windows.back();
      }
    };
    TraceRow row;
    for (;;) {
      auto more = reader->next(row);
      if (!more) return more.error();
      if (!*more) break;
      keep(cutter.add(row));
    }
    keep(cutter.finish());
    options.progress(0.5 + 0.5 * static_cast<double>(t + 1) / static_cast<double>(traces.size()));
  }
  return out;
}

}  // namespace servosense
