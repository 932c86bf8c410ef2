#include "second_plant.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "draw.hpp"

namespace blind::second {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr std::size_t kSlips = 5;

double sign(double x) { return x > 0 ? 1.0 : x < 0 ? -1.0 : 0.0; }

/// Friction of one body. What has a memory is a function of the way since the last step, so that
/// stages of a step may ask for it and no stiffness limits the step.
class Contact {
 public:
  Contact(Law law, double presliding, double damping, double creep_speed)
      : law_(law), presliding_(presliding), damping_(damping), creep_(creep_speed) {}

  /// Force against the motion after `way` more, at speed v; `level` is of fully developed friction
  /// now, `nominal` that of which the stiffness is.
  [[nodiscard]] double force(double way, double v, double level, double nominal) const {
    if (level <= 0 || nominal <= 0) return 0;
    switch (law_) {
      case Law::tanh:
        return level * std::tanh(v / creep_);
      case Law::arctan:
        return level * std::atan(v / creep_) * 2 / std::numbers::pi;
      case Law::maxwell_slip:
      case Law::wide_slip: {
        double sum = 0;
        for (std::size_t i = 0; i < kSlips; ++i) sum += slip(i, way, level, nominal);
        return sum;
      }
      default: {
        const double stiffness = nominal / presliding_, most = level / stiffness;
        const double z = bent(way, v, most);
        const double rate = v - std::abs(v) * z / most;
        return stiffness * z + (law_ == Law::lugre ? damping_ * rate : 0.0);
      }
    }
  }

  void go(double way, double v, double level, double nominal) {
    if (level <= 0 || nominal <= 0) return;
    if (law_ == Law::maxwell_slip || law_ == Law::wide_slip) {
      for (std::size_t i = 0; i < kSlips; ++i) slips_[i] = slip(i, way, level, nominal);
    } else if (law_ == Law::lugre || law_ == Law::dahl) {
      z_ = bent(way, v, level * presliding_ / nominal);
    }
  }

 private:
  /// dz/dx = 1 - sgn(v) z / most, solved.
  [[nodiscard]] double bent(double way, double v, double most) const {
    const double s = way != 0 ? sign(way) : sign(v);
    const double end = s * most;
    return end + (z_ - end) * std::exp(-std::abs(way) / most);
  }
  /// Springs that slip one after the other: the last at twice the presliding travel, the first at a
  /// fifth of that, or at a tenth.
  [[nodiscard]] double slip(std::size_t i, double way, double level, double nominal) const {
    const double share = 1.0 / kSlips;
    const double part = law_ == Law::wide_slip
                            ? std::pow(10.0, static_cast<double>(i) / (kSlips - 1.0) - 1)
                            : static_cast<double>(i + 1) / kSlips;
    const double travel = 2 * presliding_ * part;
    return std::clamp(slips_[i] + share * nominal / travel * way, -share * level, share * level);
  }

  Law law_;
  double presliding_, damping_, creep_;
  double z_ = 0;
  std::array<double, kSlips> slips_{};
};

/// The last values of a signal, for what comes late.
class Late {
 public:
  Late(double delay_s, double step_s)
      : values_(static_cast<std::size_t>(std::lround(delay_s / step_s)) + 1, 0.0) {}
  double through(double value) {
    values_[at_] = value;
    at_ = (at_ + 1) % values_.size();
    return values_[at_];
  }

 private:
  std::vector<double> values_;
  std::size_t at_ = 0;
};

/// What comes and goes at random, drawn once a sample.
struct Chance {
  double load = 0, wander = 0, until_s = -1, push = 0, x = 0, dx = 0;
};

struct Body {
  double q1 = 0, v1 = 0, q2 = 0, v2 = 0;
};

struct Rates {
  double v1 = 0, a1 = 0, v2 = 0, a2 = 0;
};

class Machine {
 public:
  Machine(const Plant& p, const Hidden& h)
      : p_(p),
        h_(h),
        m2_(p.load_share * p.inertia),
        m1_(p.inertia - m2_),
        stiffness_(coupling_stiffness(p)),
        damping_(2 * p.mode_damping * std::sqrt(stiffness_ * m1_ * m2_ / p.inertia)),
        at_motor_(p.law, p.presliding, bristle_damping(p.rigid ? p.inertia : m1_), p.creep_speed),
        at_load_(p.law, p.presliding, bristle_damping(m2_), p.creep_speed),
        slow_(Law::dahl, h.slow_travel, 0, 0) {}

  void start(double q) { s_.q1 = s_.q2 = q; }
  [[nodiscard]] const Body& body() const { return s_; }

  /// One step under a motor effort and a load.
  void step(double effort, double load, double extra_level, double t, double dt) {
    effort_ = effort, load_ = load, extra_ = extra_level, t_ = t;
    const Body from = s_;
    if (p_.runge_kutta) {
      const Rates a = rates(from, from);
      const Rates b = rates(after(from, a, dt / 2), from);
      const Rates c = rates(after(from, b, dt / 2), from);
      const Rates d = rates(after(from, c, dt), from);
      s_.q1 += dt / 6 * (a.v1 + 2 * b.v1 + 2 * c.v1 + d.v1);
      s_.v1 += dt / 6 * (a.a1 + 2 * b.a1 + 2 * c.a1 + d.a1);
      s_.q2 += dt / 6 * (a.v2 + 2 * b.v2 + 2 * c.v2 + d.v2);
      s_.v2 += dt / 6 * (a.a2 + 2 * b.a2 + 2 * c.a2 + d.a2);
      transmitted_ = carried(a);
    } else {
      const Rates a = rates(from, from);
      s_.v1 += dt * a.a1;
      s_.v2 += dt * a.a2;
      s_.q1 += dt * s_.v1;
      s_.q2 += dt * s_.v2;
      transmitted_ = carried(a);
    }
    if (p_.rigid) s_.q2 = s_.q1, s_.v2 = s_.v1;
    const double way1 = s_.q1 - from.q1, way2 = s_.q2 - from.q2;
    at_motor_.go(way1, s_.v1, level(s_.q1, s_.v1, true), nominal(true));
    at_load_.go(way2, s_.v2, level(s_.q2, s_.v2, false), nominal(false));
    if (h_.slow_breakaway > 0) {
      const bool motor = slow_at_motor();
      slow_.go(motor ? way1 : way2, motor ? s_.v1 : s_.v2, h_.slow_breakaway, h_.slow_breakaway);
    }
  }

 private:
  [[nodiscard]] double bristle_damping(double mass) const {
    return 2 * p_.bristle_damping * std::sqrt(p_.coulomb / p_.presliding * mass);
  }
  [[nodiscard]] bool slow_at_motor() const { return p_.rigid || p_.load_friction < 0.5; }
  [[nodiscard]] double share(bool motor) const {
    if (p_.rigid) return motor ? 1 : 0;
    return motor ? 1 - p_.load_friction : p_.load_friction;
  }
  [[nodiscard]] double nominal(bool motor) const { return share(motor) * p_.coulomb; }

  /// Fully developed friction of one body.
  [[nodiscard]] double level(double q, double v, bool motor) const {
    double all = p_.coulomb + extra_;
    if (h_.extra_static != 0) {
      const double ratio = v / h_.stribeck_speed;
      all += h_.extra_static * std::exp(-ratio * ratio);
    }
    all += 0.5 * h_.coulomb_difference * sign(v);
    if (h_.tight_force != 0) {
      const double off = (q - h_.tight_at) / h_.tight_width;
      all += h_.tight_force * std::exp(-0.5 * off * off);
    }
    all += h_.friction_slope * (q - h_.slope_from);
    if (h_.thermal_change != 0) all += h_.thermal_change * -std::expm1(-t_ / h_.thermal_s);
    if (h_.outside == Outside::friction_bump) {
      const double off = (std::abs(v) - h_.outside_a) / h_.outside_b;
      all += h_.outside_size * std::exp(-off * off);
    }
    double here = share(motor) * std::max(all, 0.0);
    // The nut rubs with what it carries.
    if (motor) here += h_.load_coefficient * std::abs(transmitted_);
    return here;
  }

  [[nodiscard]] double smooth(double v, bool motor) const {
    const double d = p_.viscous + 0.5 * h_.viscous_difference * sign(v);
    return share(motor) * (d * v + h_.quadratic * v * std::abs(v));
  }

  static Body after(const Body& s, const Rates& r, double dt) {
    return {s.q1 + dt * r.v1, s.v1 + dt * r.a1, s.q2 + dt * r.v2, s.v2 + dt * r.a2};
  }

  [[nodiscard]] double coupling(const Body& s) const {
    const double apart = s.q1 - s.q2, gap = h_.play / 2;
    if (gap == 0) return stiffness_ * apart + damping_ * (s.v1 - s.v2);
    if (std::abs(apart) <= gap) return 0;
    const double force = stiffness_ * (apart - sign(apart) * gap) + damping_ * (s.v1 - s.v2);
    return force * apart > 0 ? force : 0.0;  // flanks push, they do not pull
  }

  [[nodiscard]] double carried(const Rates& r) const {
    return p_.rigid ? m2_ * r.a2 + load_ : coupling(s_);
  }

  /// `from` is where the step began, where the contacts' memory stands.
  [[nodiscard]] Rates rates(const Body& s, const Body& from) const {
    double at1 = effort_ - smooth(s.v1, true) -
                 at_motor_.force(s.q1 - from.q1, s.v1, level(s.q1, s.v1, true), nominal(true));
    if (h_.ripple != 0)
      at1 += h_.ripple * std::sin(h_.ripple_order * kTurn * s.q1 / p_.turn + h_.ripple_phase);
    double at2 = -load_ - h_.spring * (s.q2 - h_.spring_rest);
    if (!p_.rigid)
      at2 -= smooth(s.v2, false) +
             at_load_.force(s.q2 - from.q2, s.v2, level(s.q2, s.v2, false), nominal(false));
    if (h_.slow_breakaway > 0) {
      if (slow_at_motor())
        at1 -= slow_.force(s.q1 - from.q1, s.v1, h_.slow_breakaway, h_.slow_breakaway);
      else
        at2 -= slow_.force(s.q2 - from.q2, s.v2, h_.slow_breakaway, h_.slow_breakaway);
    }
    if (p_.rigid) {
      const double a = (at1 + at2) / p_.inertia;
      return {s.v1, a, s.v1, a};
    }
    const double between = coupling(s);
    return {s.v1, (at1 - between) / m1_, s.v2, (at2 + between) / m2_};
  }

  const Plant& p_;
  const Hidden& h_;
  double m2_, m1_, stiffness_, damping_;
  Contact at_motor_, at_load_, slow_;
  Body s_;
  double effort_ = 0, load_ = 0, extra_ = 0, t_ = 0, transmitted_ = 0;
};

/// Loads and friction that follow no rule of the catalogue.
void disturb(const Hidden& h, Chance& c, Draw& draw, double t, double dt) {
  const double size = h.outside_size;
  switch (h.outside) {
    case Outside::wandering_load:
      c.wander +=
          (-c.wander * dt + size * std::sqrt(2 * dt * h.outside_a) * draw.normal()) / h.outside_a;
      c.load = c.wander;
      return;
    case Outside::intermittent_stick:
    case Outside::interference_bursts:
    case Outside::load_pulses:
      if (t > c.until_s) {
        c.push = 0;
        if (draw.chance(h.outside_a * dt)) {
          c.until_s = t + h.outside_b * draw.uniform(0.6, 1.4);
          c.push = size * draw.uniform(0.7, 1.3);
          if (h.outside == Outside::load_pulses) c.push *= draw.sign();
        }
      }
      c.load = h.outside == Outside::load_pulses ? c.push : 0;
      return;
    case Outside::load_steps:
      if (t >= c.until_s) {
        c.until_s = t + h.outside_a * draw.uniform(0.3, 1.7);
        c.load = c.load == size ? h.outside_b * size : size;
      }
      return;
    case Outside::narrow_band: {
      const double w = kTurn * h.outside_a, z = h.outside_b;
      // Rms `size` under white noise: w / (4 z) of its density.
      c.dx += dt * (-w * w * c.x - 2 * z * w * c.dx) +
              size * 2 * w * std::sqrt(z * w * dt) * draw.normal();
      c.x += dt * c.dx;
      c.load = c.x;
      return;
    }
    default:
      return;
  }
}

double given(const Hidden& h, double asked) {
  if (h.outside == Outside::effort_dead_band)
    return asked - std::clamp(asked, -h.outside_size, h.outside_size);
  if (h.outside == Outside::effort_saturation) {
    const double part = asked / h.outside_a;
    return asked - h.outside_size * part * std::abs(part);
  }
  return asked;
}

double stepped(double value, double step) {
  return step > 0 ? step * std::round(value / step) : value;
}

}  // namespace

double coupling_stiffness(const Plant& p) {
  const double w = kTurn * p.mode_hz;
  return w * w * p.load_share * (1 - p.load_share) * p.inertia;
}

Record simulate(const Plant& p, const Hidden& h, const Signal& reference, const Signal& other,
                std::uint64_t seed) {
  const double sample = 1 / p.servo_hz;
  const auto steps = static_cast<std::size_t>(std::ceil(sample / p.step_s - 1e-9));
  const double dt = sample / static_cast<double>(steps);
  Draw noise(seed, "second noise"), chance(seed, "second chance");
  Machine machine(p, h);
  machine.start(reference.front());
  Late acting(p.dead_time_s + (h.late_reading ? 0 : h.late_s), dt);
  Late reading(h.late_reading ? h.late_s : 0, dt);
  const auto follow = [&](double hz) { return hz > 0 ? -std::expm1(-kTurn * hz * dt) : 1.0; };
  const double loop = follow(p.current_loop_hz), lag = follow(h.lag_hz);
  Chance random;
  Record r;
  double integral = 0, before = 0, command = 0, slow = 0, actual = 0, mean = 0, read = 0;
  double last_reference = reference.front(), last_speed = 0;
  bool first = true;
  for (std::size_t k = 0; k < reference.size(); ++k) {
    const double t = static_cast<double>(k) * sample;
    const Body s = machine.body();
    // Sensors.
    const double turned = kTurn * s.q1 / p.turn;
    const double seen =
        s.q1 + h.eccentricity * p.turn / kTurn * std::sin(turned + h.eccentricity_phase);
    const double position = stepped(seen, p.encoder_step);
    const double stage =
        s.q2 + h.lead_amplitude * std::sin(turned + h.lead_phase) + h.lead_slope * s.q1;
    // P-PI cascade with what is fed forward.
    if (first) before = position, first = false;
    const double speed = (position - before) / sample;
    before = position;
    const double wanted = (reference[k] - last_reference) / sample;
    const double wanted_rate = (wanted - last_speed) / sample;
    last_reference = reference[k], last_speed = wanted;
    const double asked_speed =
        p.position_gain * (reference[k] - position) + p.feed_forward * wanted;
    const double error = asked_speed - speed;
    const double last_command = command;
    const double free =
        p.velocity_gain * (error + integral) + p.feed_forward * p.inertia * wanted_rate;
    command = stepped(std::clamp(free, -p.limit, p.limit), p.effort_step);
    if (std::abs(free) < p.limit) integral += p.integral_per_s * error * sample;
    // The record: what is known at this instant.
    const double hiss = p.effort_noise * noise.normal();
    double report = p.reports == Reports::command          ? command
                    : p.reports == Reports::command_before ? last_command
                    : p.reports == Reports::measured       ? read
                                                           : mean;
    report = stepped(report + hiss, p.effort_step);
    disturb(h, random, chance, t, sample);
    if (h.outside == Outside::interference_bursts && random.push != 0)
      report += random.push * chance.normal();
    const double shove = p.force_noise * noise.normal();
    r.position.push_back(position);
    r.scale.push_back(stepped(stage, p.scale_step));
    r.effort.push_back(report);
    r.motor.push_back(s.q1);
    r.load.push_back(s.q2);
    r.actual.push_back(actual);
    r.position_error.push_back(position - seen);
    r.effort_error.push_back(hiss + shove);
    // Until the next sample.
    const double stick =
        h.outside == Outside::intermittent_stick && random.push != 0 ? random.push : 0.0;
    const double cross = other.empty() ? 0.0 : h.cross_coefficient * other[k];
    double sum = 0;
    for (std::size_t i = 0; i < steps; ++i) {
      const double now = t + static_cast<double>(i) * dt;
      slow += lag * (acting.through(command) - slow);
      actual += loop * (slow - actual);
      read = reading.through(actual);
      sum += read;
      double load = h.load + random.load + shove + cross;
      if (h.outside == Outside::vibration)
        load += h.outside_size * std::sin(kTurn * h.outside_a * now + h.outside_b);
      machine.step(given(h, actual), load, stick, now, dt);
    }
    mean = sum / static_cast<double>(steps);
    if (!(std::abs(machine.body().v1) < 1e6)) {
      r.stable = false;
      return r;
    }
  }
  return r;
}

}  // namespace blind::second
