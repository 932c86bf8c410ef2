#include "drive.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <numbers>

#include "draw.hpp"

namespace blind {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kStep_s = 20e-6;  // longest step of the mechanics

/// Two masses whose centre moves as one and whose distance swings: both are solved exactly over a
/// step of constant force, so that the stiff spring costs no accuracy.
class Pair {
 public:
  Pair(double inertia, double motor_share, double hz, double damping, double play, double step)
      : motor_(inertia * motor_share), stage_(inertia - motor_), play_(play), step_(step) {
    const double reduced = motor_ * stage_ / inertia;
    const double w = 2 * kPi * hz;
    stiffness_ = reduced * w * w;
    damping_ = 2 * damping * reduced * w;
    reduced_ = reduced;
    const double decay = damping * w;
    const double wd = w * std::sqrt(1 - damping * damping);
    const double e = std::exp(-decay * step);
    const double c = std::cos(wd * step);
    const double s = std::sin(wd * step);
    phi_ = {e * (c + decay / wd * s), e * s / wd, -e * w * w / wd * s, e * (c - decay / wd * s)};
  }

  void place(double x) { centre_ = x, speed_ = 0, gap_ = play_ / 2, gap_speed_ = 0; }

  void advance(double on_motor, double on_stage) {
    const double inertia = motor_ + stage_;
    const double a = (on_motor + on_stage) / inertia;
    centre_ += step_ * (speed_ + a * step_ / 2);
    speed_ += a * step_;
    const double b = on_motor / motor_ - on_stage / stage_;  // of the distance, spring apart
    const double side = gap_ >= play_ / 2 ? 1.0 : (gap_ <= -play_ / 2 ? -1.0 : 0.0);
    if (play_ > 0 && side == 0) {
      gap_ += step_ * (gap_speed_ + b * step_ / 2);
      gap_speed_ += b * step_;
      return;
    }
    const double rest = side * play_ / 2 + b * reduced_ / stiffness_;
    const double d = gap_ - rest;
    gap_ = rest + phi_[0] * d + phi_[1] * gap_speed_;
    gap_speed_ = phi_[2] * d + phi_[3] * gap_speed_;
  }

  [[nodiscard]] double motor() const { return centre_ + stage_ / (motor_ + stage_) * gap_; }
  [[nodiscard]] double stage() const { return centre_ - motor_ / (motor_ + stage_) * gap_; }
  [[nodiscard]] double motor_speed() const {
    return speed_ + stage_ / (motor_ + stage_) * gap_speed_;
  }
  [[nodiscard]] double stage_speed() const {
    return speed_ - motor_ / (motor_ + stage_) * gap_speed_;
  }
  [[nodiscard]] double energy() const {
    return 0.5 * (motor_ + stage_) * speed_ * speed_ + 0.5 * reduced_ * gap_speed_ * gap_speed_ +
           0.5 * stiffness_ * gap_ * gap_;
  }
  void push(double gap, double speed) { gap_ = gap, speed_ = speed; }

 private:
  double motor_, stage_, play_, step_;
  double stiffness_ = 0, damping_ = 0, reduced_ = 0;
  std::array<double, 4> phi_{};
  double centre_ = 0, speed_ = 0, gap_ = 0, gap_speed_ = 0;
};

/// LuGre bristle (Canudas de Wit et al. 1995), its state advanced exactly over a step of constant
/// velocity.
class Bristle {
 public:
  Bristle(double stiffness, double inertia, double creep)
      : stiffness_(stiffness), damping_(0.8 * std::sqrt(stiffness * inertia)), creep_(creep) {}

  double force(double v, double level, double h) {
    if (level <= 0) return z_ = 0, 0;
    const double a = stiffness_ * std::abs(v) / level;
    const double old = z_;
    const double e = std::exp(-a * h);
    z_ = a * h > 1e-9 ? z_ * e + v / a * (1 - e) : z_ + v * h;
    // Damping only while it creeps, else the model gives energy back (Olsson 1996).
    const double slow = v / creep_;
    return stiffness_ * z_ + damping_ * (z_ - old) / h * std::exp(-slow * slow);
  }

 private:
  double stiffness_, damping_, creep_, z_ = 0;
};

/// Elements that stick, stretch and slip (Al-Bender, Lampaert and Swevers 2005, without lag).
class Slip {
 public:
  Slip(double level, double knee, double inertia, double creep)
      : damping_(0.4 * std::sqrt(level / knee * inertia)), creep_(creep) {
    constexpr std::array<double, 4> kTravel{0.3, 0.7, 1.3, 2.4};
    for (std::size_t i = 0; i < 4; ++i) slope_[i] = 0.25 / (kTravel[i] * knee);
  }

  double force(double v, double level, double h) {
    double sum = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      share_[i] = std::clamp(share_[i] + slope_[i] * v * h, -0.25, 0.25);
      sum += share_[i];
    }
    const double slow = v / creep_;
    return level * sum + damping_ * v * std::exp(-slow * slow);
  }

 private:
  double damping_, creep_;
  std::array<double, 4> slope_{}, share_{};
};

struct Friction {
  bool slip;
  Bristle bristle;
  Slip elements;
  Friction(const Plant& p, double share, double inertia, double creep)
      : slip(p.maxwell_slip),
        bristle(std::max(p.coulomb, 1e-9) / p.knee, inertia, creep),
        elements(std::max(p.coulomb, 1e-9) * share, p.knee, inertia, creep) {}
  double force(double v, double level, double h) {
    return slip ? elements.force(v, level, h) : bristle.force(v, level, h);
  }
};

/// Instants at random, each with a duration.
class Episodes {
 public:
  Episodes(std::uint64_t seed, const char* stream, double rate_hz, double shortest, double longest)
      : draw_(seed, stream), rate_hz_(rate_hz), shortest_(shortest), longest_(longest) {
    from_ = draw_.uniform(0.3, 1.7) / rate_hz_;
    to_ = from_ + draw_.uniform(shortest_, longest_);
  }
  bool on(double t) {
    if (t > to_) {
      from_ = to_ + draw_.uniform(0.3, 1.7) / rate_hz_;
      to_ = from_ + draw_.uniform(shortest_, longest_);
    }
    return t >= from_;
  }

 private:
  Draw draw_;
  double rate_hz_, shortest_, longest_, from_ = 0, to_ = 0;
};

double sine_sum(const std::vector<Line>& lines, double angle) {
  double sum = 0;
  for (const Line& line : lines) sum += line.amplitude * std::sin(line.order * angle + line.phase);
  return sum;
}

}  // namespace

Recording run(const Plant& p, const Hidden& hidden, const std::vector<double>& command,
              const std::vector<double>& other_effort, std::size_t thin, std::uint64_t seed) {
  const double period = 1 / p.servo_hz;
  const auto substeps = static_cast<std::size_t>(std::ceil(period / kStep_s - 1e-9));
  const double h = period / static_cast<double>(substeps);
  const bool flexible = hidden.flexible_hz > 0;
  const double motor_share = flexible ? 1 - hidden.flexible_share : p.motor_share;
  Pair pair(p.inertia, motor_share, flexible ? hidden.flexible_hz : p.mode_hz,
            flexible ? hidden.flexible_damping : p.mode_damping, hidden.backlash, h);
  const double friction_share = flexible ? 1 - hidden.flexible_friction : p.friction_motor_share;
  const double creep = 200 * p.knee;
  Friction at_motor(p, friction_share, p.inertia * motor_share, creep);
  Friction at_stage(p, 1 - friction_share, p.inertia * (1 - motor_share), creep);
  Bristle soft(hidden.presliding_stiffness, 0.02 * p.inertia, creep);
  Draw noise(seed, "noise");
  Draw burst_noise(seed, "bursts");
  Episodes sticks(seed, "stick", hidden.stick_rate_hz, 0.03, 0.15);
  Draw toggles(seed, "load steps");
  double toggle_s = 0, step_load = -0.5 * hidden.load_step;
  Episodes bursts(seed, "burst", hidden.burst_rate_hz, 0.01, 0.05);

  const double loop_lag = 1 - std::exp(-2 * kPi * p.current_loop_hz * h);
  const double hidden_lag = hidden.lag_hz > 0 ? 1 - std::exp(-2 * kPi * hidden.lag_hz * h) : 1;
  const double speed_lag = 1 - std::exp(-2 * kPi * 120 * period);
  std::deque<double> late(static_cast<std::size_t>(std::lround(hidden.delay_s / h)) + 1, 0.0);

  pair.place(command.front());
  const double first_count = std::round(command.front() / p.lsb);
  double reference_A = 0, next_reference_A = 0, current_A = 0, acting_A = 0;
  double integral = 0, speed = 0, last_position = command.front(), screw = 0;
  Recording out;
  out.rate_hz = p.servo_hz / static_cast<double>(thin);

  for (std::size_t k = 0; k < command.size(); ++k) {
    const double t = static_cast<double>(k) * period;
    const double angle = 2 * kPi * pair.motor() / p.turn;
    const double eccentric =
        hidden.eccentricity == 0
            ? 0.0
            : hidden.eccentricity * std::sin(angle + hidden.eccentricity_phase);
    const double seen = pair.motor() + eccentric;
    const double count = std::floor(seen / p.lsb + 0.5);
    const double position = count * p.lsb;

    // What is reported at this instant, before the servo answers to it.
    const double white = noise.normal();
    if (k % thin == 0) {
      double reported = current_A + p.current_noise_A * white;
      if (hidden.bursts_A > 0 && bursts.on(t)) reported += hidden.bursts_A * burst_noise.normal();
      out.time_s.push_back(t);
      out.command.push_back(command[k]);
      out.motor.push_back(position);
      out.counts.push_back(static_cast<std::int64_t>(count - first_count));
      // Scale on the table, five times finer than the encoder seen at the stage.
      const double scale =
          pair.stage() + hidden.lead_slope * pair.motor() + sine_sum(hidden.lead, angle);
      out.scale.push_back(std::floor(scale / (0.2 * p.lsb) + 0.5) * 0.2 * p.lsb);
      out.current_A.push_back(reported);
      out.clean_motor.push_back(seen);
      out.clean_current_A.push_back(current_A);
    }

    // P-PI cascade; its answer reaches the current loop one period later.
    const double raw = (position - last_position) / period;
    last_position = position;
    speed += speed_lag * (raw - speed);
    const double error = p.position_gain * (command[k] - position) - speed;
    const double wanted = p.velocity_gain * (error + integral);
    if (std::abs(wanted) < p.current_limit_A) integral += p.integral_rate * period * error;
    reference_A = next_reference_A;
    next_reference_A = std::clamp(wanted, -p.current_limit_A, p.current_limit_A);

    const bool stuck = hidden.stick > 0 && sticks.on(t);
    if (hidden.load_step != 0 && t >= toggle_s) {
      toggle_s = t + hidden.load_step_s * toggles.uniform(0.3, 1.7);
      step_load = -step_load;
    }
    for (std::size_t i = 0; i < substeps; ++i) {
      const double now = t + static_cast<double>(i) * h;
      current_A += loop_lag * (reference_A - current_A);
      late.push_back(current_A);
      acting_A += hidden_lag * (late.front() - acting_A);
      late.pop_front();

      const double xm = pair.motor();
      const double xs = pair.stage();
      const double vm = pair.motor_speed();
      const double vs = pair.stage_speed();
      // Friction levels that depend on velocity do so on that of their own side.
      const auto level = [&](double v) {
        double c = p.coulomb - hidden.presliding_breakaway;
        if (hidden.stribeck_extra != 0) {
          const double s = v / hidden.stribeck_speed;
          c += hidden.stribeck_extra * std::exp(-s * s);
        }
        if (hidden.bump != 0) {
          const double s = std::log(std::max(std::abs(v), 1e-9) / hidden.bump_speed) / 0.35;
          c += hidden.bump * std::exp(-s * s);
        }
        if (hidden.tight_spot != 0) {
          const double s = (xs - hidden.tight_place) / hidden.tight_width;
          c += hidden.tight_spot * std::exp(-s * s / 2);
        }
        c += hidden.friction_slope * (xs - hidden.friction_centre);
        c += hidden.load_friction * std::abs(screw);
        if (hidden.drift_change != 0)
          c += hidden.drift_change * -std::expm1(-now / hidden.drift_time_s);
        if (stuck) c += hidden.stick;
        // The asymmetric part of sliding friction grows and fades with the presliding state too.
        return std::max(c + (v > 0 ? 0.5 : -0.5) * hidden.coulomb_difference, 0.02 * p.coulomb);
      };
      double on_motor = p.effort_per_A * acting_A - sine_sum(hidden.ripple, 2 * kPi * xm / p.turn);
      screw = on_motor;
      on_motor -= friction_share * (p.viscous * vm + at_motor.force(vm, level(vm), h) +
                                    0.5 * hidden.viscous_difference * std::abs(vm) +
                                    hidden.drag * vm * std::abs(vm));
      double on_stage = -(1 - friction_share) * (p.viscous * vs + at_stage.force(vs, level(vs), h) +
                                                 0.5 * hidden.viscous_difference * std::abs(vs) +
                                                 hidden.drag * vs * std::abs(vs));
      if (hidden.presliding_breakaway > 0)
        on_stage -= soft.force(vs, hidden.presliding_breakaway, h);
      on_stage -= hidden.constant_load + hidden.spring * (xs - hidden.spring_rest);
      if (!other_effort.empty())
        on_stage -= (hidden.cross_talk + hidden.unseen_axis) * other_effort[k];
      if (hidden.load_step != 0) on_stage -= step_load + hidden.load_step_mean;
      if (hidden.leak != 0)
        on_stage -= hidden.leak * (-std::expm1(-now / hidden.leak_time_s) - hidden.leak_zero);
      if (hidden.vibration != 0)
        on_stage -= hidden.vibration *
                    std::sin(2 * kPi * hidden.vibration_hz * now + hidden.vibration_phase);
      pair.advance(on_motor, on_stage);
    }
    if (!(std::abs(pair.motor() - command[k]) < 1e3 * p.turn)) {
      out.stable = false;
      break;
    }
  }
  return out;
}

double free_energy_ratio(const Plant& p, double seconds) {
  Pair pair(p.inertia, p.motor_share, p.mode_hz, 0.0, 0.0, kStep_s);
  pair.place(0);
  pair.push(1e-5, 0.1);
  const double before = pair.energy();
  for (double t = 0; t < seconds; t += kStep_s) pair.advance(0, 0);
  return pair.energy() / before;
}

}  // namespace blind
