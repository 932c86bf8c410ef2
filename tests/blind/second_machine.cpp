#include "second_machine.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace blind::second {
namespace {

constexpr double kPi = std::numbers::pi;

/// A micrometre, or the angle that is as small on a spindle.
double small(bool turns) { return turns ? 5e-5 : 1e-6; }

/// Laws without a bristle are steep at rest: steps that carry the slope, or less of a slope.
void settle(Plant& p) {
  if (p.law != Law::tanh && p.law != Law::arctan) return;
  const double mass = p.inertia * (p.rigid ? 1.0 : std::min(p.load_share, 1 - p.load_share));
  p.step_s = std::clamp(p.creep_speed * mass / p.coulomb, 5e-6, 25e-6);
  p.creep_speed = std::max(p.creep_speed, p.coulomb * p.step_s / mass);
}

}  // namespace

Drawn draw_machine(Draw& draw, bool turns, Kind kind) {
  Drawn d;
  d.kind = kind;
  d.turns = d.limits.turns = turns;
  Plant& p = d.plant;
  constexpr double kServo[] = {1000, 2000, 4000, 5000, 8000};
  p.servo_hz = draw.one_of(kServo);
  p.runge_kutta = draw.chance(0.5);
  p.step_s = p.runge_kutta ? 25e-6 : 20e-6;
  d.seconds = std::min(draw.log_uniform(12, 60), 150000 / p.servo_hz);
  if (turns) {
    p.inertia = draw.log_uniform(5e-4, 0.3);
    d.limits.speed = draw.log_uniform(30, 400);
    d.limits.acceleration = d.limits.speed / draw.log_uniform(0.1, 0.8);
    d.limits.stroke = 2 * kPi;
    p.coulomb = p.inertia * d.limits.acceleration * draw.log_uniform(0.03, 0.4);
    p.turn = 2 * kPi;
    constexpr double kCounts[] = {4096, 10000, 65536, 1048576};
    d.counts = draw.one_of(kCounts);
  } else {
    constexpr double kLeads[] = {0.005, 0.01, 0.012, 0.016, 0.02, 0.04};
    p.inertia = draw.log_uniform(10, 400);
    d.limits.speed = draw.log_uniform(0.05, 0.8);
    // From end to end in a second or two, or less.
    d.limits.stroke = draw.log_uniform(0.05, 1.5 * std::max(d.limits.speed, 0.07));
    d.limits.acceleration = draw.log_uniform(0.8, 8);
    p.coulomb = p.inertia * draw.log_uniform(0.15, 1.5);
    p.turn = draw.one_of(kLeads);
    constexpr double kCounts[] = {10000, 50000, 131072, 1048576, 8388608};
    d.counts = draw.one_of(kCounts);
  }
  p.viscous = p.coulomb * draw.log_uniform(0.1, 1.2) / d.limits.speed;
  p.rigid = draw.chance(0.3);
  p.load_share = draw.uniform(0.2, 0.8);
  p.mode_hz = draw.uniform(250, 600);
  p.mode_damping = draw.log_uniform(0.01, 0.06);
  const double where = draw.unit();
  p.load_friction = where < 0.25 ? 0.05 : where < 0.5 ? 0.95 : draw.uniform(0.2, 0.8);
  constexpr Law kLaws[] = {Law::lugre,        Law::lugre, Law::dahl,
                           Law::maxwell_slip, Law::tanh,  Law::arctan};
  p.law = draw.one_of(kLaws);
  p.presliding = small(turns) * draw.log_uniform(0.3, 5);
  p.bristle_damping = draw.log_uniform(0.05, 1);
  p.creep_speed = d.limits.speed * draw.log_uniform(1e-4, 1e-3);
  settle(p);
  p.current_loop_hz = draw.chance(0.2) ? 0 : draw.log_uniform(300, 1500);
  constexpr double kDead[] = {0, 0.5, 1};
  p.dead_time_s = draw.one_of(kDead) / p.servo_hz;
  constexpr Reports kReports[] = {Reports::command, Reports::command_before, Reports::measured,
                                  Reports::measured_mean};
  p.reports = draw.one_of(kReports);
  const bool measured = p.reports == Reports::measured || p.reports == Reports::measured_mean;
  p.effort_noise = measured ? p.coulomb * draw.log_uniform(0.003, 0.04) : 0;
  p.force_noise = p.coulomb * draw.log_uniform(0.003, 0.02);
  p.limit = 2.5 * (p.inertia * d.limits.acceleration + p.coulomb + p.viscous * d.limits.speed);
  p.effort_step = 2 * p.limit / (draw.chance(0.5) ? 8192 : 65536);
  p.feed_forward = draw.chance(0.4) ? draw.uniform(0.85, 1) : 0;
  p.scale_step = draw.chance(0.5) ? 1e-7 : 5e-7;
  if (kind == Kind::text_book) {
    p.rigid = false;
    p.mode_hz = draw.log_uniform(30, 80);
    p.mode_damping = draw.log_uniform(0.02, 0.1);
    p.law = Law::wide_slip;
    p.presliding = small(turns) * draw.log_uniform(2, 20);
    p.current_loop_hz = draw.log_uniform(60, 300);
  }
  return d;
}

void tune(Draw draw, Plant& p, const Hidden& h, double down) {
  const double late = (p.current_loop_hz > 0 ? 1 / (2 * kPi * p.current_loop_hz) : 0) +
                      p.dead_time_s + 1 / p.servo_hz + (h.late_reading ? 0 : h.late_s) +
                      (h.lag_hz > 0 ? 1 / (2 * kPi * h.lag_hz) : 0);
  const double hz = down * std::min({draw.log_uniform(8, 40), 0.07 / late, p.servo_hz / 50});
  p.velocity_gain = 2 * kPi * hz * p.inertia;
  p.integral_per_s = 2 * kPi * hz / draw.uniform(4, 10);
  p.position_gain = 2 * kPi * hz / draw.uniform(3.5, 7);
}

std::vector<std::string> effects_of(bool turns, Kind kind) {
  std::vector<std::string> all{"viscous-friction",       "coulomb-friction",
                               "stribeck-friction",      "asymmetric-friction",
                               "presliding-hysteresis",  "quadratic-drag",
                               "thermal-friction-drift", "constant-load",
                               "torque-ripple",          "backlash",
                               "flexible-coupling",      "transport-delay",
                               "current-loop-lag",       "encoder-eccentricity",
                               "load-dependent-friction"};
  // Of what turns without end, the place means nothing.
  if (!turns)
    all.insert(all.end(),
               {"position-dependent-friction", "spring-load", "lead-error", "cross-talk"});
  // What every machine of a text book has is in its file.
  if (kind == Kind::text_book)
    std::erase_if(all, [](const std::string& e) {
      return e == "flexible-coupling" || e == "current-loop-lag";
    });
  return all;
}

std::vector<std::string> outside_kinds() {
  return {"friction-bump",         "intermittent-stick", "wandering-load",
          "interference-bursts",   "load-pulses",        "load-steps",
          "narrow-band-vibration", "effort-dead-band",   "effort-saturation",
          "time-locked-vibration"};
}

void make_room(Drawn& d, std::string_view effect) {
  Plant& p = d.plant;
  if (effect == "backlash" && p.rigid) p.rigid = false;
  // What acts between command and motor is not seen by who measures at the motor.
  if (effect == "current-loop-lag" || effect == "effort-dead-band" ||
      effect == "effort-saturation") {
    if (p.reports == Reports::measured) p.reports = Reports::command;
    if (p.reports == Reports::measured_mean) p.reports = Reports::command_before;
    p.effort_noise = 0;
  }
  if (effect == "thermal-friction-drift")
    d.seconds = std::max(d.seconds, std::min(25.0, 200000 / p.servo_hz));
  settle(p);
}

void hide(Scenario& s, const Drawn& d, std::string_view effect, Draw& draw,
          double other_acceleration) {
  Plant& p = s.plant;
  Hidden& h = s.hidden;
  const bool turns = d.turns;
  const double size = p.coulomb * draw.log_uniform(0.01, 0.7);
  const double speed = d.limits.speed;
  const std::string unit = turns ? "Nm" : "N", way = turns ? "rad" : "m";
  const std::string per_speed = "_" + unit + (turns ? "_s_per_rad" : "_s_per_m");
  HiddenEffect told{std::string(effect), {}, 0, 0};
  const auto tell = [&](const std::string& key, double value) {
    told.parameters.emplace_back(key, value);
  };
  const std::string force = turns ? "torque_Nm" : "force_N";
  if (effect == "viscous-friction") {
    s.without_viscous = true;
    tell("coefficient" + per_speed, p.viscous);
  } else if (effect == "coulomb-friction") {
    s.without_coulomb = true;
    tell(force, p.coulomb);
  } else if (effect == "stribeck-friction") {
    h.extra_static = size;
    h.stribeck_speed = turns ? speed * draw.log_uniform(0.01, 0.1)
                             : std::min(draw.log_uniform(1e-3, 2e-2), 0.2 * speed);
    tell("extra_static_" + unit, h.extra_static);
    tell("stribeck_velocity_" + way + "_per_s", h.stribeck_speed);
  } else if (effect == "asymmetric-friction") {
    h.viscous_difference = draw.sign() * std::min(2 * size / speed, 1.2 * p.viscous);
    if (draw.chance(0.5)) h.coulomb_difference = draw.sign() * size * draw.uniform(0.2, 1);
    tell("viscous_difference" + per_speed, h.viscous_difference);
    if (h.coulomb_difference != 0) tell("coulomb_difference_" + unit, h.coulomb_difference);
  } else if (effect == "presliding-hysteresis") {
    const double um = small(turns);
    if (draw.chance(0.35)) {
      // All friction comes late.
      p.presliding = um * draw.log_uniform(10, 60);
      if (p.law == Law::tanh || p.law == Law::arctan) p.law = Law::dahl;
      tell("stiffness_" + unit + "_per_" + way, p.coulomb / p.presliding);
      tell("breakaway_" + unit, p.coulomb);
    } else {
      h.slow_breakaway = std::max(size, 0.05 * p.coulomb);
      h.slow_travel = um * draw.log_uniform(10, 200);
      tell("stiffness_" + unit + "_per_" + way, h.slow_breakaway / h.slow_travel);
      tell("breakaway_" + unit, h.slow_breakaway);
    }
  } else if (effect == "quadratic-drag") {
    h.quadratic = size / (speed * speed);
    tell("coefficient_" + unit + (turns ? "_s2_per_rad2" : "_s2_per_m2"), h.quadratic);
  } else if (effect == "position-dependent-friction") {
    if (draw.chance(0.6)) {
      h.tight_force = size;
      h.tight_at = d.limits.stroke * draw.uniform(0.1, 0.4);
      h.tight_width = d.limits.stroke * draw.uniform(0.03, 0.12);
    } else {
      h.friction_slope = draw.sign() * size / d.limits.stroke;
    }
  } else if (effect == "thermal-friction-drift") {
    h.thermal_change = size * (draw.chance(0.7) ? -1 : 1);
    h.thermal_s = d.seconds * draw.log_uniform(0.15, 1);
    tell("change_" + unit, h.thermal_change);
    tell("time_constant_s", h.thermal_s);
  } else if (effect == "constant-load") {
    h.load = draw.sign() * size;
    tell(force, h.load);
  } else if (effect == "spring-load") {
    h.spring = 2 * size / d.limits.stroke;
    h.spring_rest = d.limits.stroke * draw.uniform(0, 0.5);
    tell("stiffness_" + unit + "_per_" + way, h.spring);
  } else if (effect == "torque-ripple") {
    constexpr double kOrders[] = {1, 2, 3, 4, 5, 6, 8, 10, 12, 18, 24, 30};
    h.ripple = size;
    h.ripple_order = draw.one_of(kOrders);
    h.ripple_phase = draw.uniform(0, 2 * kPi);
    tell("order", h.ripple_order);
    tell("amplitude_" + unit, h.ripple);
  } else if (effect == "backlash") {
    h.play = small(turns) * draw.log_uniform(4, 100);
    tell("width_" + way, h.play);
  } else if (effect == "flexible-coupling") {
    p.rigid = false;
    p.mode_hz = draw.log_uniform(20, 120);
    p.mode_damping = draw.log_uniform(0.02, 0.1);
    settle(p);
    tell("resonance_hz", p.mode_hz);
    tell(turns ? "inertia_share" : "mass_share", p.load_share);
  } else if (effect == "transport-delay") {
    h.late_s = draw.log_uniform(5e-4, 5e-3);
    h.late_reading = p.reports == Reports::measured || p.reports == Reports::measured_mean;
    tell("delay_s", h.late_s);
  } else if (effect == "current-loop-lag") {
    h.lag_hz = draw.log_uniform(20, 150);
    tell("bandwidth_hz", h.lag_hz);
  } else if (effect == "encoder-eccentricity") {
    // As large as seems to be a part of the friction's force at speed.
    const double radius = p.turn / (2 * kPi);
    h.eccentricity = std::clamp(3 * size * radius / (p.inertia * speed * speed), 0.001, 0.05);
    h.eccentricity_phase = draw.uniform(0, 2 * kPi);
    tell("amplitude_rad", h.eccentricity);
  } else if (effect == "load-dependent-friction") {
    h.load_coefficient =
        std::clamp(size / (p.load_share * p.inertia * d.limits.acceleration), 0.01, 0.3);
    // Of the force that the nut carries; others count all that the motor exerts: not to be
    // compared.
  } else if (effect == "lead-error") {
    h.lead_amplitude = draw.log_uniform(1e-6, 2e-5);
    h.lead_phase = draw.uniform(0, 2 * kPi);
    if (draw.chance(0.5)) h.lead_slope = draw.sign() * draw.log_uniform(1e-5, 1e-4);
    tell("order", 1);
    tell("amplitude_m", h.lead_amplitude);
    if (h.lead_slope != 0) tell("slope", h.lead_slope);
  } else if (effect == "cross-talk") {
    h.cross_coefficient = draw.sign() * size / other_acceleration;
    // In kilograms of this axis's own making.
  } else {
    const double strong = p.coulomb * draw.log_uniform(0.05, 0.7);
    h.outside_size = strong;
    const auto is = [&](const char* name, Outside kind, double a, double b) {
      if (effect != name) return;
      h.outside = kind, h.outside_a = a, h.outside_b = b;
    };
    const double at = speed * draw.uniform(0.15, 0.5);
    is("friction-bump", Outside::friction_bump, at, at * draw.uniform(0.1, 0.3));
    is("intermittent-stick", Outside::intermittent_stick, draw.uniform(0.4, 2),
       draw.uniform(0.03, 0.2));
    is("wandering-load", Outside::wandering_load, draw.uniform(2, 8), 0);
    is("interference-bursts", Outside::interference_bursts, draw.uniform(0.4, 2),
       draw.uniform(0.02, 0.1));
    is("load-pulses", Outside::load_pulses, draw.uniform(0.4, 2), draw.uniform(0.05, 0.4));
    is("load-steps", Outside::load_steps, draw.log_uniform(0.5, 5), draw.uniform(-1, 0.6));
    is("narrow-band-vibration", Outside::narrow_band, draw.log_uniform(8, 60),
       draw.log_uniform(0.01, 0.05));
    is("effort-dead-band", Outside::effort_dead_band, 0, 0);
    is("effort-saturation", Outside::effort_saturation, p.limit / 2.5, 0);
    is("time-locked-vibration", Outside::vibration, draw.log_uniform(6, 60),
       draw.uniform(0, 2 * kPi));
    if (h.outside == Outside::vibration) {
      h.outside_size *= 0.5;
      tell("frequency_hz", h.outside_a);
      tell("amplitude_" + unit, h.outside_size);
    } else {
      tell("size", h.outside_size);
      tell("a", h.outside_a);
      tell("b", h.outside_b);
    }
  }
  s.effects.push_back(std::move(told));
}

}  // namespace blind::second
