#include "servosense/sim/machine_simulator.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "in_range.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr double kLongestCut_s = 1e4;
constexpr double kWithoutEnd_m = 1e6;
// w T of the obstacle's spring with the axis; its force is taken half a period ahead.
constexpr double kResolvedContact = 0.3;

Error wrong(const std::string& what) { return usage_error("machine simulator: " + what); }

Expected<Done> check(const MachineSimulation& s) {
  if (!positive(s.sample_period_s)) return wrong("sample_period_s must be positive");
  if (s.milling.step_s > s.sample_period_s)
    return wrong("the step of the cut must not be longer than a servo period");
  const CutProgram& p = s.program;
  if (!not_negative(p.spindle_acceleration_rad_s2) || !not_negative(p.dwell_s) ||
      !not_negative(p.feed_acceleration_m_s2) || !not_negative(p.feed_jerk_m_s3) ||
      !not_negative(p.cut_s))
    return wrong("accelerations, jerk, dwell_s and cut_s of the program must not be negative");
  if ((p.feed_acceleration_m_s2 > 0) != (p.feed_jerk_m_s3 > 0))
    return wrong("feed_acceleration_m_s2 and feed_jerk_m_s3 must both be given, or neither");
  if (s.spindle && !(p.spindle_acceleration_rad_s2 > 0))
    return wrong("the spindle drive starts at rest and needs spindle_acceleration_rad_s2");
  if (s.x && !(p.feed_acceleration_m_s2 > 0))
    return wrong("the x drive starts at rest and needs feed_acceleration_m_s2 and feed_jerk_m_s3");
  if (p.cut_s == 0 && !std::isfinite(s.milling.workpiece.length_m))
    return wrong("the cut does not end: give cut_s, or a workpiece with a length");
  if (!s.milling.speed.points.empty() && s.milling.speed.points.front().time_s < 0)
    return wrong("times of the speed profile count from the first contact, and none is before it");
  for (const auto* drive : {&s.spindle, &s.x, &s.y, &s.z})
    if (*drive && (*drive)->sample_period_s != s.sample_period_s)
      return wrong("all drives need the sample_period_s of the machine");
  if (s.obstacle) {
    const FeedObstacle& o = *s.obstacle;
    if (!std::isfinite(o.position_m) || !positive(o.stiffness_N_per_m) || !(o.strength_N > 0))
      return wrong("an obstacle needs a position, and stiffness and strength above zero");
    if (!s.x) return wrong("an obstacle needs a drive of x, which feels it");
    const double stiffest = std::pow(kResolvedContact / s.sample_period_s, 2) * s.x->drive.inertia;
    if (o.stiffness_N_per_m > stiffest)
      return wrong("the obstacle is too stiff for the servo rate: at most " +
                   number_text(stiffest) + " N/m with this axis");
  }
  return Done{};
}

}  // namespace

Expected<MachineSimulator> MachineSimulator::create(const MachineSimulation& simulation) {
  if (auto ok = check(simulation); !ok) return ok.error();
  MachineSimulation s = simulation;
  // The milling simulator keeps the tool engaged in an endless block, which has no front face.
  if (s.milling.start == MillingStart::entry && s.milling.workpiece.is_endless())
    s.milling.workpiece.length_m = kWithoutEnd_m;
  auto milling = MillingSimulator::create(s.milling);
  if (!milling) return milling.error();
  MachineSimulator m(s, *std::move(milling));
  if (auto ok = m.plan(); !ok) return ok.error();
  if (auto ok = m.add_drives(); !ok) return ok.error();
  if (!s.milling.breaks.empty() && m.schedule_.contact_s > 0) {
    MillingSimulation shifted = s.milling;
    for (ToothBreak& b : shifted.breaks) b.time_s += m.schedule_.contact_s;
    auto again = MillingSimulator::create(shifted);
    if (!again) return again.error();
    m.milling_ = *std::move(again);
  }
  return m;
}

MachineSimulator::MachineSimulator(const MachineSimulation& simulation, MillingSimulator milling)
    : simulation_(simulation), milling_(std::move(milling)) {
  MillingSimulation& s = simulation_.milling;
  if (s.speed.points.empty()) s.speed = SpindleSpeedProfile::constant(s.cut.spindle_speed_rpm);
  feed_per_rad_m_ = s.cut.feed_per_tooth_m * s.tool.teeth / kTwoPi;
  start_angle_rad_ = milling_.now().angle_rad;
  start_feed_m_ = feed_m_ = milling_.now().feed_m;
}

// ---- Program.

Expected<Done> MachineSimulator::plan() {
  const CutProgram& p = simulation_.program;
  const double contact_speed = rad_s_from_rpm(simulation_.milling.speed.speed_rpm(0));
  contact_feed_m_s_ = feed_per_rad_m_ * contact_speed;
  if (p.spindle_acceleration_rad_s2 > 0) run_up_s_ = contact_speed / p.spindle_acceleration_rad_s2;
  schedule_.feed_s = schedule_.contact_s = run_up_s_ + p.dwell_s;
  if (p.feed_acceleration_m_s2 > 0) {
    const double v = contact_feed_m_s_, a = p.feed_acceleration_m_s2, j = p.feed_jerk_m_s3;
    // Any move that is long enough comes up to the feed.
    auto move = JerkLimitedMove::plan(2 * v * (v / a + 2 * std::sqrt(v / j) + a / j), {v, a, j});
    if (!move) return move.error();
    feed_start_ = *move;
    ramp_s_ = move->ramp_s();
  }
  if (simulation_.milling.start == MillingStart::entry) {
    const double clearance = simulation_.milling.clearance_m;
    const double needed = contact_feed_m_s_ * ramp_s_ / 2;
    if (clearance < needed)
      return wrong("the feed is not yet up when the tool meets the work: give a clearance of " +
                   number_text(needed) + " m or more");
    schedule_.contact_s += ramp_s_ / 2 + clearance / contact_feed_m_s_;
  }
  schedule_.stop_s = schedule_.run_down_s = std::numeric_limits<double>::infinity();
  if (auto ok = plan_holds(); !ok) return ok;
  if (auto ok = plan_stop(); !ok) return ok;

  schedule_.run_down_s = schedule_.end_s = schedule_.stop_s + ramp_s_ + p.dwell_s;
  if (p.spindle_acceleration_rad_s2 > 0) {
    last_speed_rad_s_ = rad_s_from_rpm(
        simulation_.milling.speed.speed_rpm(schedule_.run_down_s - schedule_.contact_s));
    schedule_.end_s += last_speed_rad_s_ / p.spindle_acceleration_rad_s2 + p.dwell_s;
  } else {
    schedule_.run_down_s = std::numeric_limits<double>::infinity();
  }
  return Done{};
}

Expected<Done> MachineSimulator::plan_holds() {
  double up_again = schedule_.feed_s + ramp_s_ - schedule_.contact_s;
  for (const FeedHold& hold : simulation_.program.holds) {
    if (!positive(hold.time_s) || !not_negative(hold.duration_s) || hold.time_s < up_again)
      return wrong(
          "a feed hold needs a time after the first contact at which the feed is up, and a "
          "duration "
          "that is not negative");
    up_again = hold.time_s + hold.duration_s + 2 * ramp_s_;
  }
  if (const double cut = simulation_.program.cut_s; cut > 0 && cut < up_again)
    return wrong("cut_s ends before the feed is up (again): at least " + number_text(up_again) +
                 " s");
  return Done{};
}

Expected<Done> MachineSimulator::plan_stop() {
  const MillingSimulation& s = simulation_.milling;
  if (simulation_.program.cut_s > 0) {
    schedule_.stop_s = schedule_.contact_s + simulation_.program.cut_s;
    return Done{};
  }
  const double end_m = s.workpiece.length_m + s.tool.radius_m() + s.clearance_m;
  double feed = start_feed_m_;
  const double first = std::floor(schedule_.feed_s / simulation_.sample_period_s);
  for (double n = first;; ++n) {
    const double t = n * simulation_.sample_period_s;
    if (t > schedule_.contact_s + kLongestCut_s)
      return wrong("the tool is still in the work after " + number_text(kLongestCut_s) +
                   " s; give cut_s");
    if (feed_share(t) == 1 && feed + feed_reference(t) * ramp_s_ / 2 >= end_m) {
      schedule_.stop_s = t;
      return Done{};
    }
    feed += command_step(t);
  }
}

double MachineSimulator::spindle_reference(double t_s) const {
  const double rate = simulation_.program.spindle_acceleration_rad_s2;
  if (t_s < run_up_s_) return std::max(0.0, rate * t_s);
  if (t_s > schedule_.run_down_s)
    return std::max(0.0, last_speed_rad_s_ - rate * (t_s - schedule_.run_down_s));
  return rad_s_from_rpm(simulation_.milling.speed.speed_rpm(t_s - schedule_.contact_s));
}

double MachineSimulator::feed_reference(double t_s) const {
  return feed_per_rad_m_ * spindle_reference(t_s) * feed_share(t_s);
}

// Of the full feed, 0 to 1.
double MachineSimulator::feed_share(double t_s) const {
  const auto risen = [this](double since_s) {
    if (since_s >= ramp_s_) return 1.0;
    return since_s <= 0 ? 0.0 : feed_start_.at(since_s).velocity / contact_feed_m_s_;
  };
  double share = risen(t_s - schedule_.feed_s) - risen(t_s - schedule_.stop_s);
  for (const FeedHold& hold : simulation_.program.holds) {
    const double since = t_s - schedule_.contact_s - hold.time_s;
    share -= risen(since) - risen(since - ramp_s_ - hold.duration_s);
  }
  return share;
}

// Way commanded in the period from t (Simpson: exact under constant jerk and spindle ramps).
double MachineSimulator::command_step(double t_s) const {
  const double period = simulation_.sample_period_s;
  return period / 6 *
         (feed_reference(t_s) + 4 * feed_reference(t_s + period / 2) +
          feed_reference(t_s + period));
}

// ---- Motion.

Expected<Done> MachineSimulator::add_drives() {
  const auto add = [](std::optional<DriveSimulatorConfig>& config, DriveLoop loop, const char* name,
                      std::optional<DriveSimulator>& drive) -> Expected<Done> {
    if (!config) return Done{};
    config->loop = loop;
    auto made = DriveSimulator::create(*config);
    if (!made) return Error{made.error().kind, std::string(name) + ": " + made.error().sentence};
    drive.emplace(*std::move(made));
    return Done{};
  };
  MachineSimulation& s = simulation_;
  if (auto ok = add(s.spindle, DriveLoop::velocity, "spindle", spindle_); !ok) return ok;
  if (auto ok = add(s.x, DriveLoop::position, "x", x_); !ok) return ok;
  if (auto ok = add(s.y, DriveLoop::position, "y", y_); !ok) return ok;
  if (auto ok = add(s.z, DriveLoop::position, "z", z_); !ok) return ok;
  const auto standing_at = [](double position) { return Way{position, position, position}; };
  if (s.spindle) turn_ = standing_at(s.spindle->initial_position);
  if (s.x) feed_ = standing_at(s.x->initial_position);
  cut_ = milling_.now();
  cut_.spindle_speed_rad_s = spindle_reference(0);
  return Done{};
}

// The feed override as the axes follow it. Run-up and run-down know none.
void MachineSimulator::keep_pace() {
  const double t = program_s();
  const bool feeding = t >= schedule_.feed_s && t < schedule_.run_down_s;
  const double wanted = !feeding ? 1 : override_.hold ? 0 : override_.feed;
  const double acceleration = simulation_.program.feed_acceleration_m_s2;
  const double most = acceleration > 0 && feeding
                          ? acceleration / contact_feed_m_s_ * simulation_.sample_period_s
                          : std::numeric_limits<double>::infinity();
  pace_ = std::clamp(wanted, pace_ - most, pace_ + most);
}

void MachineSimulator::cut_period() {
  const double h = simulation_.milling.step_s;
  const double period = simulation_.sample_period_s;
  const auto whole_periods = [&](std::uint64_t steps) {
    // Rounding must not move a step that ends with the period.
    return std::floor(static_cast<double>(steps) * std::min(h / period, 1.0) + 1e-9);
  };
  std::uint64_t count = 1;
  while (whole_periods(milling_steps_ + count) <= static_cast<double>(sample_)) ++count;
  milling_steps_ += count;
  const auto steps = static_cast<double>(count);

  const MillingStep& now = milling_.now();
  // Drives were seen one period ago.
  const double ahead =
      static_cast<double>(milling_steps_) * h / period - static_cast<double>(sample_) + 1;
  const auto pace = [&](double from, double to) {
    return std::max(0.0, (to - from) / (steps * h));
  };
  double speed = spindle_ ? pace(now.angle_rad, start_angle_rad_ + turn_.ahead(ahead)) : 0;
  double feed = x_ ? pace(now.feed_m, start_feed_m_ + feed_.ahead(ahead)) : 0;

  MillingStep mean;
  for (std::uint64_t i = 0; i < count; ++i) {
    const double middle_s = now.t_s + h / 2;
    const bool ideal = !spindle_ || !x_;
    const double programmed = ideal ? spindle_reference(middle_s - behind_s_) : 0;
    if (!spindle_) speed = override_.speed * programmed;
    if (!x_) feed = pace_ * feed_per_rad_m_ * programmed * feed_share(middle_s - behind_s_);
    const MillingStep& s = milling_.step(speed, feed);
    mean.spindle_speed_rad_s += s.spindle_speed_rad_s;
    mean.fx_N += s.fx_N;
    mean.fy_N += s.fy_N;
    mean.fz_N += s.fz_N;
    mean.torque_Nm += s.torque_Nm;
    mean.x_m += s.x_m;
    mean.y_m += s.y_m;
    mean.vx_m_s += s.vx_m_s;
    mean.vy_m_s += s.vy_m_s;
    mean.teeth_in_cut = std::max(mean.teeth_in_cut, s.teeth_in_cut);
  }
  for (double* value : {&mean.spindle_speed_rad_s, &mean.fx_N, &mean.fy_N, &mean.fz_N,
                        &mean.torque_Nm, &mean.x_m, &mean.y_m, &mean.vx_m_s, &mean.vy_m_s})
    *value /= steps;
  mean.t_s = now.t_s;
  mean.angle_rad = now.angle_rad;
  mean.feed_m = now.feed_m;
  cut_ = mean;
}

void MachineSimulator::meet_obstacle() {
  if (!simulation_.obstacle || obstacle_broken_) return;
  const FeedObstacle& o = *simulation_.obstacle;
  constexpr double kToMiddle = 1.5;  // of the period that begins now
  const double depth = start_feed_m_ + feed_.ahead(kToMiddle) - o.position_m;
  obstacle_N_ = std::max(0.0, o.stiffness_N_per_m * depth);
  obstacle_broken_ = obstacle_N_ > o.strength_N;
  if (obstacle_broken_) obstacle_N_ = 0;
}

MachineSample MachineSimulator::step() {
  MachineSample s;
  s.t_s = static_cast<double>(sample_) * simulation_.sample_period_s;
  const double program_time_s = program_s();
  keep_pace();
  s.spindle_reference_rad_s = override_.speed * spindle_reference(program_time_s);
  s.feed_reference_m = feed_m_;
  s.cut = cut_;
  s.obstacle_N = obstacle_N_;
  cut_period();
  meet_obstacle();
  if (spindle_) {
    s.spindle = spindle_->step(s.spindle_reference_rad_s, cut_.torque_Nm);
    turn_.to(s.spindle->load_position);
  }
  if (x_) {
    const double reference = simulation_.x->initial_position + (feed_m_ - start_feed_m_);
    s.x = x_->step(reference, obstacle_N_ - cut_.fx_N);
    feed_.to(s.x->load_position);
  }
  if (y_) s.y = y_->step(simulation_.y->initial_position, -cut_.fy_N);
  if (z_) s.z = z_->step(simulation_.z->initial_position, -cut_.fz_N);
  feed_m_ += pace_ * command_step(program_time_s);
  behind_s_ += (1 - pace_) * simulation_.sample_period_s;
  ++sample_;
  return s;
}

Expected<Done> MachineSimulator::run(
    const std::function<Expected<Done>(const MachineSample&)>& sample) {
  const auto last = [this] {
    return std::floor((schedule_.end_s + behind_s_) / simulation_.sample_period_s + 1e-9);
  };
  while (static_cast<double>(sample_) <= last()) {
    const MachineSample now = step();
    if (auto done = sample(now); !done) return done;
    if (milling_.lost())
      return data_error("after " + number_text(milling_.now().t_s) +
                        " s the tool vibrates by more than a quarter of its radius: the cut is far "
                        "beyond its stability limit, take a smaller depth");
  }
  return Done{};
}

Expected<std::vector<MachineSample>> MachineSimulator::run() {
  std::vector<MachineSample> samples;
  auto done = run([&](const MachineSample& s) {
    samples.push_back(s);
    return Expected<Done>(Done{});
  });
  if (!done) return done.error();
  return samples;
}

// ---- Record.

namespace {

/// Calls `column` with every signal of a record and its field, in their order.
template <typename Column>
void for_each_column(const MachineSimulation& simulation, const MachineSample& sample, bool truth,
                     Column&& column) {
  using enum Quantity;
  const auto number = [&](Channel channel, Quantity quantity, double value) {
    column(Signal{channel, quantity}, TraceField::of(value));
  };
  const auto drive = [&](Channel channel, const DriveSimulatorConfig& config,
                         const std::optional<DriveSimSample>& state, Quantity uncounted) {
    const DriveSimSample s = state.value_or(DriveSimSample{});
    if (config.encoder.counts_per_turn > 0)
      column(Signal{channel, angle_counts}, TraceField::of_counts(s.angle_counts));
    else
      number(channel, uncounted, s.position);
    column(Signal{channel, current_A},
           s.current_is_new ? TraceField::of(s.current_A) : TraceField::none());
    return s;
  };

  const MillingStep& cut = sample.cut;
  double speed = cut.spindle_speed_rad_s;
  if (simulation.spindle)
    speed = drive(Channel::spindle, *simulation.spindle, sample.spindle, angle_rad).velocity;
  else
    number(Channel::spindle, angle_rad, cut.angle_rad);
  if (truth) {
    number(Channel::spindle, speed_rad_s, speed);
    number(Channel::tool, torque_Nm, cut.torque_Nm);
  }
  const auto axis = [&](Channel channel, const std::optional<DriveSimulatorConfig>& config,
                        const std::optional<DriveSimSample>& state) {
    if (!config) return;
    number(channel, command_position_m, state ? state->reference : 0);
    const DriveSimSample s = drive(channel, *config, state, position_m);
    if (!truth || channel != Channel::x) return;
    if (config->encoder.counts_per_turn > 0) number(channel, position_m, s.position);
    number(channel, velocity_m_s, s.velocity);
  };
  axis(Channel::x, simulation.x, sample.x);
  if (!simulation.x) number(Channel::x, position_m, cut.feed_m);
  axis(Channel::y, simulation.y, sample.y);
  axis(Channel::z, simulation.z, sample.z);
  if (truth) {
    number(Channel::tool, force_x_N, cut.fx_N);
    number(Channel::tool, force_y_N, cut.fy_N);
    if (simulation.milling.tool.force.has_axial()) number(Channel::tool, force_z_N, cut.fz_N);
    number(Channel::tool, displacement_x_m, cut.x_m);
    number(Channel::tool, displacement_y_m, cut.y_m);
  }
}

}  // namespace

std::vector<Signal> record_signals(const MachineSimulation& simulation, bool truth) {
  std::vector<Signal> signals;
  for_each_column(simulation, MachineSample{}, truth,
                  [&](Signal signal, const TraceField&) { signals.push_back(signal); });
  return signals;
}

void record_row(const MachineSimulation& simulation, const MachineSample& sample, bool truth,
                std::vector<TraceField>& row) {
  row.clear();
  for_each_column(simulation, sample, truth,
                  [&](Signal, const TraceField& field) { row.push_back(field); });
}

TraceMetadata record_metadata(const MachineSimulator& simulator) {
  const CutSchedule& s = simulator.schedule();
  return {{"source", "servosense machine simulator"},
          {"feed_s", number_text(s.feed_s)},
          {"contact_s", number_text(s.contact_s)},
          {"stop_s", number_text(s.stop_s)},
          {"end_s", number_text(s.end_s)}};
}

Expected<Done> write_record(MachineSimulator& simulator, TraceWriter& writer, bool truth) {
  std::vector<TraceField> row;
  return simulator.run([&](const MachineSample& sample) {
    record_row(simulator.simulation(), sample, truth, row);
    return writer.write(std::llround(sample.t_s * 1e9), row);
  });
}

}  // namespace servosense
