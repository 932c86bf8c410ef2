#include "servosense/sim/machining_simulator.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "servosense/core/units.hpp"

namespace servosense {
namespace {

/// Means of the steps of one servo period.
class PeriodMean {
 public:
  void add(const MillingStep& s) {
    mean_.spindle_speed_rad_s += s.spindle_speed_rad_s;
    mean_.fx_N += s.fx_N;
    mean_.fy_N += s.fy_N;
    mean_.torque_Nm += s.torque_Nm;
    mean_.x_m += s.x_m;
    mean_.y_m += s.y_m;
    mean_.vx_m_s += s.vx_m_s;
    mean_.vy_m_s += s.vy_m_s;
    mean_.teeth_in_cut = std::max(mean_.teeth_in_cut, s.teeth_in_cut);
    mean_.t_s = s.t_s;
    mean_.angle_rad = s.angle_rad;
    mean_.feed_m = s.feed_m;
    ++count_;
  }
  [[nodiscard]] MillingStep mean() const {
    MillingStep m = mean_;
    for (double* value : {&m.spindle_speed_rad_s, &m.fx_N, &m.fy_N, &m.torque_Nm, &m.x_m, &m.y_m,
                          &m.vx_m_s, &m.vy_m_s})
      *value /= count_;
    return m;
  }

 private:
  MillingStep mean_;
  int count_ = 0;
};

/// A drive, or the reference itself where there is none.
class Drive {
 public:
  static Expected<Drive> create(const std::optional<DriveSimulatorConfig>& config, DriveLoop loop,
                                double period_s) {
    Drive drive(period_s, loop);
    if (!config) return drive;
    DriveSimulatorConfig c = *config;
    c.sample_period_s = period_s;
    c.loop = loop;
    auto simulator = DriveSimulator::create(c);
    if (!simulator) return simulator.error();
    drive.simulator_ = std::move(*simulator);
    return drive;
  }

  DriveSimSample step(double t_s, double reference, double load) {
    if (simulator_) return simulator_->step(reference, load);
    DriveSimSample s;
    s.t_s = t_s;
    s.reference = reference;
    s.cutting = load;
    s.velocity = loop_ == DriveLoop::velocity ? reference : (reference - position_) / period_s_;
    position_ = loop_ == DriveLoop::velocity ? position_ : reference;
    s.position = position_;
    if (loop_ == DriveLoop::velocity) position_ += reference * period_s_;
    return s;
  }

 private:
  Drive(double period_s, DriveLoop loop) : period_s_(period_s), loop_(loop) {}
  std::optional<DriveSimulator> simulator_;
  double period_s_;
  DriveLoop loop_;
  double position_ = 0;
};

/// Force of an obstacle on its axis.
class Contact {
 public:
  explicit Contact(const Obstacle& obstacle) : obstacle_(obstacle) {}
  double load(double since_cut_s, double position) {
    if (since_cut_s < obstacle_.at_s || broken_) return 0;
    if (!met_) from_ = position;
    met_ = true;
    const double force = std::max(0.0, obstacle_.stiffness_N_per_m * (position - from_));
    broken_ = force > obstacle_.strength_N;
    return broken_ ? 0 : force;
  }
  [[nodiscard]] Channel axis() const { return obstacle_.axis; }

 private:
  Obstacle obstacle_;
  double from_ = 0;
  bool met_ = false, broken_ = false;
};

}  // namespace

Expected<MachiningSimulator> MachiningSimulator::create(const MachiningSimulation& simulation) {
  const auto wrong = [](const std::string& what) {
    return usage_error("machining simulator: " + what);
  };
  MachiningSimulation s = simulation;
  for (const auto& [name, value] :
       {std::pair{"servo_period_s", s.servo_period_s}, std::pair{"cut_s", s.cut_s},
        std::pair{"spindle_acceleration_rad_s2", s.spindle_acceleration_rad_s2},
        std::pair{"feed_acceleration_m_s2", s.feed_acceleration_m_s2}})
    if (!(value > 0 && std::isfinite(value))) return wrong(std::string(name) + " must be positive");
  if (!(s.settle_s >= 0 && std::isfinite(s.settle_s)))
    return wrong("settle_s must not be negative");
  for (const FeedHold& hold : s.feed_holds)
    if (!(hold.at_s >= 0 && hold.duration_s >= 0)) return wrong("a feed hold needs positive times");
  for (const Obstacle& o : s.obstacles)
    if (!(o.stiffness_N_per_m > 0 && o.strength_N > 0) ||
        (o.axis != Channel::x && o.axis != Channel::y && o.axis != Channel::z))
      return wrong("an obstacle needs stiffness and strength above zero, on x, y or z");
  if (s.milling.step_s > 0)
    s.milling.step_s = s.servo_period_s / std::ceil(s.servo_period_s / s.milling.step_s - 1e-9);
  // Refuse at once what run() would meet later.
  auto cut = MillingSimulator::create(s.milling);
  if (!cut) return cut.error();
  for (const auto* drive : {&s.spindle, &s.x, &s.y, &s.z}) {
    auto made = Drive::create(
        *drive, drive == &s.spindle ? DriveLoop::velocity : DriveLoop::position, s.servo_period_s);
    if (!made) return made.error();
  }
  return MachiningSimulator(std::move(s));
}

MachiningSimulator::MachiningSimulator(MachiningSimulation simulation)
    : simulation_(std::move(simulation)) {
  const MachiningSimulation& s = simulation_;
  const double speed = spindle_reference(0);
  const double feed = speed / kTwoPi * s.milling.tool.teeth * s.milling.cut.feed_per_tooth_m;
  run_up_s_ = speed / s.spindle_acceleration_rad_s2;
  feed_ramp_s_ = feed / s.feed_acceleration_m_s2;
  const auto whole = [&](double t) { return std::ceil(t / s.servo_period_s) * s.servo_period_s; };
  feed_from_s_ = whole(run_up_s_ + s.settle_s / 2);
  cut_from_s_ = whole(feed_from_s_ + feed_ramp_s_ + s.settle_s / 2);
  const double last = spindle_reference(s.cut_s);
  end_s_ = whole(cut_from_s_ + s.cut_s + feed_ramp_s_ + last / s.spindle_acceleration_rad_s2 +
                 s.settle_s);
}

// Within the cut, `t_s` after its start.
double MachiningSimulator::spindle_reference(double t_s) const {
  const SpindleSpeedProfile& profile = simulation_.milling.speed;
  return rad_s_from_rpm(profile.points.empty() ? simulation_.milling.cut.spindle_speed_rpm
                                               : profile.speed_rpm(t_s));
}

// 1 = the programmed feed; ramps last as long as that at the beginning.
double MachiningSimulator::feed_override(double t_s) const {
  const double ramp = std::max(feed_ramp_s_, simulation_.servo_period_s);
  const double rising = std::clamp((t_s - feed_from_s_) / ramp, 0.0, 1.0);
  double share = rising * std::clamp((cut_to_s() - t_s) / ramp + 1, 0.0, 1.0);
  for (const FeedHold& hold : simulation_.feed_holds) {
    const double at = cut_from_s_ + hold.at_s;
    share *= std::max(std::clamp((at - t_s) / ramp + 1, 0.0, 1.0),
                      std::clamp((t_s - at - hold.duration_s) / ramp, 0.0, 1.0));
  }
  return share;
}

Expected<Done> MachiningSimulator::run(
    const std::function<Expected<Done>(const MachiningSample&)>& sample) {
  const MachiningSimulation& s = simulation_;
  const double period = s.servo_period_s;
  // All were made once already.
  Drive spindle = *Drive::create(s.spindle, DriveLoop::velocity, period);
  Drive x = *Drive::create(s.x, DriveLoop::position, period);
  Drive y = *Drive::create(s.y, DriveLoop::position, period);
  Drive z = *Drive::create(s.z, DriveLoop::position, period);
  std::vector<Contact> contacts(s.obstacles.begin(), s.obstacles.end());
  cut_.reset();
  const auto steps = static_cast<int>(std::llround(period / s.milling.step_s));
  const double feed_per_rad = s.milling.tool.teeth * s.milling.cut.feed_per_tooth_m / kTwoPi;

  MachiningSample now, before;
  double x_reference = 0;
  const auto count = static_cast<std::size_t>(std::llround(end_s_ / period));
  for (std::size_t n = 0; n <= count; ++n) {
    const double t = static_cast<double>(n) * period;
    const double since_cut = t - cut_from_s_;
    const double speed = spindle_reference(std::clamp(since_cut, 0.0, s.cut_s)) *
                         std::clamp(run_up_s_ > 0 ? t / run_up_s_ : 1.0, 0.0, 1.0) *
                         std::clamp((end_s_ - s.settle_s / 2 - t) * s.spindle_acceleration_rad_s2 /
                                        spindle_reference(s.cut_s),
                                    0.0, 1.0);
    now = {};
    now.t_s = t;
    now.cutting = since_cut >= -period / 2 && since_cut <= s.cut_s - period / 2;

    // The cut over the period that ends here, with the motion of the one before.
    if (before.cutting && cut_) {
      const double turning = std::max(0.0, before.spindle.velocity);
      const double feeding = std::max(0.0, before.x.velocity);
      PeriodMean mean;
      for (int i = 0; i < steps; ++i) mean.add(cut_->step(turning, feeding));
      now.cut = mean.mean();
      if (cut_->lost())
        return data_error("after " + std::to_string(since_cut) +
                          " s of cutting the tool vibrates by more than a quarter of its radius: "
                          "the cut is far beyond its stability limit, take a smaller depth");
    }
    double load[3] = {-now.cut.fx_N, -now.cut.fy_N, 0};
    const double place[3] = {before.x.position, before.y.position, before.z.position};
    for (Contact& contact : contacts) {
      const auto axis =
          static_cast<std::size_t>(contact.axis()) - static_cast<std::size_t>(Channel::x);
      load[axis] += contact.load(since_cut, place[axis]);
    }
    x_reference += feed_per_rad * speed * feed_override(t) * period;
    now.spindle = spindle.step(t, speed, now.cut.torque_Nm);
    now.x = x.step(t, x_reference, load[0]);
    now.y = y.step(t, 0, load[1]);
    now.z = z.step(t, 0, load[2]);
    // What moved is what the encoders would say, not the speed of an instant.
    if (n > 0) {
      now.spindle.velocity = (now.spindle.position - before.spindle.position) / period;
      now.x.velocity = (now.x.position - before.x.position) / period;
    }
    if (now.cutting && !cut_) {
      MillingSimulation milling = s.milling;
      milling.start_angle_rad = std::fmod(now.spindle.position, kTwoPi);
      cut_ = std::move(*MillingSimulator::create(milling));
    }
    if (auto done = sample(now); !done) return done;
    before = now;
  }
  return Done{};
}

Expected<std::vector<MachiningSample>> MachiningSimulator::run() {
  std::vector<MachiningSample> samples;
  auto done = run([&](const MachiningSample& s) -> Expected<Done> {
    samples.push_back(s);
    return Done{};
  });
  if (!done) return done.error();
  return samples;
}

std::vector<Signal> MachiningSimulator::trace_signals() const {
  using enum Quantity;
  std::vector<Signal> signals;
  const auto drive = [&](Channel channel, const std::optional<DriveSimulatorConfig>& config,
                         Quantity motion) {
    if (!config) return;
    signals.push_back({channel, config->encoder.counts_per_turn > 0 ? angle_counts : motion});
    signals.push_back({channel, current_A});
  };
  drive(Channel::spindle, simulation_.spindle, angle_rad);
  if (!simulation_.spindle) {
    signals.push_back({Channel::spindle, angle_rad});
    signals.push_back({Channel::spindle, speed_rad_s});
    signals.push_back({Channel::spindle, torque_Nm});
  }
  drive(Channel::x, simulation_.x, position_m);
  if (simulation_.x) signals.push_back({Channel::x, command_position_m});
  drive(Channel::y, simulation_.y, position_m);
  drive(Channel::z, simulation_.z, position_m);
  for (const Quantity quantity :
       {torque_Nm, force_x_N, force_y_N, displacement_x_m, displacement_y_m, feed_per_tooth_m})
    signals.push_back({Channel::tool, quantity});
  return signals;
}

void MachiningSimulator::trace_fields(const MachiningSample& sample,
                                      std::vector<TraceField>& row) const {
  row.clear();
  const auto drive = [&](const std::optional<DriveSimulatorConfig>& config,
                         const DriveSimSample& s) {
    if (!config) return;
    row.push_back(config->encoder.counts_per_turn > 0 ? TraceField::of_counts(s.angle_counts)
                                                      : TraceField::of(s.position));
    row.push_back(s.current_is_new ? TraceField::of(s.current_A) : TraceField::none());
  };
  drive(simulation_.spindle, sample.spindle);
  if (!simulation_.spindle)
    for (const double value :
         {sample.spindle.position, sample.spindle.velocity, sample.cut.torque_Nm})
      row.push_back(TraceField::of(value));
  drive(simulation_.x, sample.x);
  if (simulation_.x) row.push_back(TraceField::of(sample.x.reference));
  drive(simulation_.y, sample.y);
  drive(simulation_.z, sample.z);
  const double tooth_rad_s = sample.spindle.velocity * simulation_.milling.tool.teeth;
  for (const double value :
       {sample.cut.torque_Nm, sample.cut.fx_N, sample.cut.fy_N, sample.cut.x_m, sample.cut.y_m,
        tooth_rad_s > 1e-3 ? sample.x.velocity * kTwoPi / tooth_rad_s : 0.0})
    row.push_back(TraceField::of(value));
}

}  // namespace servosense
