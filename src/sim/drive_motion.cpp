#include "servosense/sim/drive_motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "servosense/io/drive_columns.hpp"
#include "servosense/io/text.hpp"
#include "servosense/sim/trajectory.hpp"

namespace servosense {
namespace {

/// Straight lines between the rows of a trace.
class Curve {
 public:
  Curve(std::shared_ptr<const std::vector<double>> t_s, std::vector<double> value)
      : t_s_(std::move(t_s)), value_(std::move(value)) {}

  double operator()(double t) const {
    const std::vector<double>& time = *t_s_;
    const auto after = std::upper_bound(time.begin(), time.end(), t);
    if (after == time.begin()) return value_.front();
    if (after == time.end()) return value_.back();
    const auto i = static_cast<std::size_t>(after - time.begin());
    const double share = (t - time[i - 1]) / (time[i] - time[i - 1]);
    return value_[i - 1] + share * (value_[i] - value_[i - 1]);
  }

 private:
  std::shared_ptr<const std::vector<double>> t_s_;
  std::vector<double> value_;
};

struct Choice {
  Signal signal;
  DriveLoop loop;
};

std::vector<Choice> commands_of(Channel channel) {
  using enum Quantity;
  using enum DriveLoop;
  if (is_spindle(channel))
    return {{{channel, command_angle_rad}, position},
            {{channel, speed_rad_s}, velocity},
            {{channel, angle_rad}, position}};
  if (is_rotary_axis(channel))
    return {{{channel, command_angle_rad}, position},
            {{channel, angle_rad}, position},
            {{channel, speed_rad_s}, velocity}};
  return {{{channel, command_position_m}, position},
          {{channel, command_velocity_m_s}, velocity},
          {{channel, position_m}, position},
          {{channel, velocity_m_s}, velocity}};
}

struct LoadChoice {
  Signal signal;
  double sign;
};

std::vector<LoadChoice> loads_of(Channel channel) {
  using enum Quantity;
  if (channel == Channel::spindle)
    return {{{Channel::tool, torque_Nm}, 1}, {{Channel::dyno, torque_Nm}, 1}};
  if (is_turning(channel)) return {};
  const Quantity force = channel == Channel::x   ? force_x_N
                         : channel == Channel::y ? force_y_N
                                                 : force_z_N;
  return {{{Channel::dyno, force}, 1}, {{Channel::tool, force}, -1}};
}

std::size_t index_of(const Trace& trace, Signal signal) {
  return static_cast<std::size_t>(std::find(trace.signals.begin(), trace.signals.end(), signal) -
                                  trace.signals.begin());
}

/// The rows of a column that hold a number, as a curve; nothing when there are none.
std::optional<Curve> curve_of(const Trace& trace, Signal signal, double sign) {
  const std::vector<double>* column = trace.find(signal);
  if (column == nullptr) return std::nullopt;
  auto time = std::make_shared<std::vector<double>>();
  std::vector<double> value;
  const std::vector<bool>& updated = trace.updated[index_of(trace, signal)];
  for (std::size_t i = 0; i < trace.size(); ++i) {
    if (!updated[i] || !std::isfinite((*column)[i])) continue;
    time->push_back(trace.t_s[i] - trace.t_s.front());
    value.push_back(sign * (*column)[i]);
  }
  if (value.empty()) return std::nullopt;
  return Curve(std::move(time), std::move(value));
}

/// One channel of a program while it is read.
struct Programmed {
  Channel channel;
  MotionLimits limits;
  double start = 0;
  Trajectory trajectory;
  struct Load {
    double force, from_s, to_s;
  };
  std::vector<Load> loads;
  std::function<double(double)> temperature_C;
};

class ProgramReader {
 public:
  Expected<Done> line(std::string_view text) {
    std::vector<std::string_view> words;
    for (text = trim(text); !text.empty(); text = trim(text)) {
      const std::size_t end = std::min(text.find_first_of(" \t"), text.size());
      words.push_back(text.substr(0, end));
      text.remove_prefix(end);
    }
    if (words.size() == 1 && words[0] == "sync") return sync();
    const auto channel = words.empty() ? std::nullopt : channel_from(words[0]);
    if (words.size() < 2 || !channel || !is_drive(*channel))
      return data_error("expected 'sync', or spindle, x, y, z, a, b, c or spindle2 and what it " +
                        std::string("does, not ") + in_quotes(words.empty() ? text : words[0]));
    std::vector<double> numbers;
    for (std::size_t i = 2; i < words.size(); ++i) {
      const auto number = parse_number(words[i]);
      if (!number.ok()) return data_error("expected a number, not " + in_quotes(words[i]));
      // Beyond any machine: protects the sums of times from overflow.
      if (std::abs(number.value) > 1e12)
        return data_error("the number " + in_quotes(words[i]) + " is beyond any machine");
      numbers.push_back(number.value);
    }
    return statement(part(*channel), words[1], numbers);
  }

  Expected<Motion> finish() {
    if (parts_.empty()) return data_error("the program moves nothing");
    Motion motion;
    motion.duration_s = duration_s();
    if (!(motion.duration_s > 0)) return data_error("the program moves nothing");
    for (Programmed& p : parts_) {
      DriveMotion drive;
      drive.channel = p.channel;
      // A spindle is told a speed, an axis a place.
      const bool spindle = is_spindle(p.channel);
      drive.loop = spindle ? DriveLoop::velocity : DriveLoop::position;
      drive.initial_position = p.start;
      drive.reference = [spindle, path = std::move(p.trajectory)](double t) {
        const MotionPoint point = path.at(t);
        return spindle ? point.velocity : point.position;
      };
      if (!p.loads.empty())
        drive.load = [loads = std::move(p.loads)](double t) {
          double force = 0;
          for (const auto& load : loads)
            if (t >= load.from_s && t < load.to_s) force += load.force;
          return force;
        };
      drive.temperature_C = std::move(p.temperature_C);
      motion.drives.push_back(std::move(drive));
    }
    return motion;
  }

 private:
  double duration_s() const {
    double longest = 0;
    for (const Programmed& p : parts_) longest = std::max(longest, p.trajectory.duration_s());
    return longest;
  }

  Programmed& part(Channel channel) {
    for (Programmed& p : parts_)
      if (p.channel == channel) return p;
    parts_.push_back({channel, {}, 0, Trajectory{}, {}, {}});
    return parts_.back();
  }

  Expected<Done> sync() {
    const double longest = duration_s();
    for (Programmed& p : parts_)
      if (auto done = p.trajectory.dwell(longest - p.trajectory.duration_s()); !done) return done;
    return Done{};
  }

  static Expected<Done> statement(Programmed& p, std::string_view verb,
                                  const std::vector<double>& n) {
    const std::string name{name_of(p.channel)};
    if (verb == "limits" && n.size() == 3) {
      p.limits = {n[0], n[1], n[2]};
      return JerkLimitedMove::plan(0, p.limits) ? Expected<Done>(Done{})
                                                : data_error("limits must be positive");
    }
    if (verb == "start" && n.size() == 1) {
      if (p.trajectory.duration_s() > 0)
        return data_error("'start' must come before the motions of " + name);
      p.start = n[0];
      p.trajectory = Trajectory(p.start);
      return Done{};
    }
    if (verb == "dwell" && n.size() == 1) return p.trajectory.dwell(n[0]);
    if (verb == "load" && n.size() == 3) {
      if (!(n[1] >= 0 && n[2] > n[1]))
        return data_error("a load needs times FROM and TO with 0 <= FROM < TO");
      p.loads.push_back({n[0], n[1], n[2]});
      return Done{};
    }
    if (verb == "temperature" && n.size() == 3) {
      if (!(n[2] > 0)) return data_error("a temperature needs a positive TIME_CONSTANT");
      p.temperature_C = [from = n[0], to = n[1], time = n[2]](double t) {
        return to + (from - to) * std::exp(-t / time);
      };
      return Done{};
    }
    if (verb == "sine" && n.size() == 3) {
      if (!(n[2] >= 1 && n[2] <= 1e9))
        return data_error("a sine needs a whole number of CYCLES, 1 or more");
      return p.trajectory.sine(n[0], n[1], static_cast<unsigned>(n[2]));
    }
    const bool moves = verb == "move" && (n.size() == 1 || n.size() == 2);
    if (moves || (verb == "cruise" && n.size() == 2)) {
      if (!(p.limits.velocity > 0))
        return data_error("write '" + name + " limits VELOCITY ACCELERATION JERK' before its " +
                          "first motion");
      MotionLimits limits = p.limits;
      if (!moves) return p.trajectory.cruise(n[0], n[1], limits);
      if (n.size() == 2) limits.velocity = std::min(limits.velocity, n[1]);
      return p.trajectory.move_to(n[0], limits);
    }
    return data_error(
        "expected one of: limits VELOCITY ACCELERATION JERK, start POSITION, move TARGET [FEED], "
        "cruise VELOCITY SECONDS, sine AMPLITUDE FREQUENCY CYCLES, dwell SECONDS, load FORCE FROM "
        "TO, temperature FROM TO TIME_CONSTANT; not " +
        in_quotes(verb) + " with " + std::to_string(n.size()) + " numbers");
  }

  std::vector<Programmed> parts_;
};

/// Whether the first line that says anything is the header of a trace.
Expected<bool> is_trace(const std::string& path) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  LineReader lines(std::move(*stream), path);
  for (std::string_view line;;) {
    auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more)
      return data_error(path + ": the file is empty; write a trace or a program of moves");
    line = trim(line);
    if (!line.empty() && line.front() != '#') return line.starts_with("t_s");
  }
}

}  // namespace

Expected<Motion> motion_from_trace(const Trace& trace, const std::string& name) {
  if (trace.size() < 2) return data_error(name + ": a motion needs two rows or more");
  Motion motion;
  motion.duration_s = trace.t_s.back() - trace.t_s.front();
  for (const Channel channel : kDriveChannels) {
    for (const Choice& choice : commands_of(channel)) {
      auto curve = curve_of(trace, choice.signal, 1);
      if (!curve) continue;
      DriveMotion drive;
      drive.channel = channel;
      drive.loop = choice.loop;
      if (choice.loop == DriveLoop::position) drive.initial_position = (*curve)(0);
      drive.reference = std::move(*curve);
      motion.columns.push_back(index_of(trace, choice.signal));
      for (const LoadChoice& load : loads_of(channel))
        if (auto force = curve_of(trace, load.signal, load.sign)) {
          drive.load = std::move(*force);
          motion.columns.push_back(index_of(trace, load.signal));
          break;
        }
      const Signal temperature{channel, Quantity::temperature_C};
      if (auto told = curve_of(trace, temperature, 1)) {
        drive.temperature_C = std::move(*told);
        motion.columns.push_back(index_of(trace, temperature));
      }
      motion.drives.push_back(std::move(drive));
      break;
    }
  }
  if (motion.drives.empty())
    return data_error(name +
                      ": no drive is told to move; a motion needs a column such as "
                      "x.command_position_m, x.position_m or spindle.speed_rad_s, with numbers");
  return motion;
}

Expected<Motion> motion_from_program(LineReader& lines) {
  ProgramReader program;
  for (std::string_view line;;) {
    auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more) break;
    line = trim(line.substr(0, std::min(line.find('#'), line.size())));
    if (line.empty()) continue;
    if (auto done = program.line(line); !done) return lines.error_here(done.error().sentence);
  }
  auto motion = program.finish();
  if (!motion) return data_error(lines.name() + ": " + motion.error().sentence);
  return motion;
}

Expected<Motion> read_motion(const std::string& path, std::vector<std::string>* remarks) {
  auto from_trace = is_trace(path);
  if (!from_trace) return from_trace.error();
  if (*from_trace) {
    auto trace = read_trace(path);
    if (!trace) return trace.error();
    auto motion = motion_from_trace(*trace, path);
    // The last sentence names them all; those before it are about watching.
    if (motion && remarks != nullptr)
      if (auto unused = unused_columns(trace->signals, motion->columns); !unused.empty())
        remarks->push_back(std::move(unused.back()));
    return motion;
  }
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  LineReader lines(std::move(*stream), path);
  return motion_from_program(lines);
}

Expected<Done> run_drives(
    std::span<const RunningDrive> drives, double duration_s,
    const std::function<Expected<Done>(double t_s, std::span<const DriveSimSample>)>& sample) {
  if (drives.empty()) return usage_error("there is no drive to simulate");
  std::vector<DriveSimulator> simulators;
  const double period_s = drives.front().config.sample_period_s;
  for (const RunningDrive& drive : drives) {
    DriveSimulatorConfig config = drive.config;
    if (config.sample_period_s != period_s)
      return usage_error("drives that run together need one servo rate");
    config.loop = drive.motion.loop;
    config.initial_position = drive.motion.initial_position;
    auto simulator = DriveSimulator::create(config);
    if (!simulator)
      return Error{simulator.error().kind,
                   std::string(name_of(drive.motion.channel)) + ": " + simulator.error().sentence};
    simulators.push_back(std::move(*simulator));
  }
  std::vector<DriveSimSample> now(drives.size());
  std::vector<DriveSimSample> before(drives.size());
  std::vector<double> acceleration(drives.size(), 0.0);
  const auto felt = [&](CrossTalkOf of, std::size_t other) {
    switch (of) {
      case CrossTalkOf::velocity:
        return before[other].velocity;
      case CrossTalkOf::position:
        return before[other].position;
      case CrossTalkOf::effort:
        return before[other].effort;
      case CrossTalkOf::acceleration:
        break;
    }
    return acceleration[other];
  };
  const double count = std::floor(duration_s / period_s + 1e-9);
  for (std::size_t n = 0; static_cast<double>(n) <= count; ++n) {
    const double t = static_cast<double>(n) * period_s;
    for (std::size_t d = 0; d < drives.size(); ++d) {
      const DriveMotion& motion = drives[d].motion;
      double load = motion.load ? motion.load(t) : 0.0;
      for (const CrossTalk& talk : drives[d].cross_talk)
        for (std::size_t other = 0; other < drives.size(); ++other)
          if (drives[other].motion.channel == talk.from)
            load += talk.coefficient * felt(talk.of, other);
      if (motion.temperature_C)
        simulators[d].set_constant_ratio(drives[d].constant.ratio(motion.temperature_C(t)));
      now[d] = simulators[d].step(motion.reference(t), load);
    }
    for (std::size_t d = 0; d < drives.size(); ++d)
      acceleration[d] = n > 0 ? (now[d].velocity - before[d].velocity) / period_s : 0;
    before = now;
    if (auto done = sample(t, now); !done) return done;
  }
  return Done{};
}

}  // namespace servosense
