// Blind cases of feed drives and spindles: machine, program, hidden effect and nominal model drawn
// from one seed.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <sstream>

#include "analysis.hpp"
#include "case.hpp"
#include "draw.hpp"
#include "drive.hpp"
#include "motion.hpp"
#include "wrong_file.hpp"

namespace blind {
namespace {

constexpr double kPi = std::numbers::pi;

const std::vector<std::string> kAxisEffects{"viscous-friction",
                                            "coulomb-friction",
                                            "stribeck-friction",
                                            "asymmetric-friction",
                                            "presliding-hysteresis",
                                            "quadratic-drag",
                                            "position-dependent-friction",
                                            "thermal-friction-drift",
                                            "constant-load",
                                            "spring-load",
                                            "torque-ripple",
                                            "backlash",
                                            "flexible-coupling",
                                            "transport-delay",
                                            "current-loop-lag",
                                            "encoder-eccentricity",
                                            "lead-error",
                                            "load-dependent-friction",
                                            "cross-talk"};
const std::vector<std::string> kSpindleEffects{
    "viscous-friction",       "coulomb-friction",    "stribeck-friction", "quadratic-drag",
    "thermal-friction-drift", "torque-ripple",       "flexible-coupling", "transport-delay",
    "current-loop-lag",       "encoder-eccentricity"};
const std::vector<std::string> kOutside{
    "friction-bump",     "time-locked-vibration", "intermittent-stick", "offset-leak",
    "electrical-bursts", "unseen-axis",           "load-steps"};
const std::vector<std::string> kOutsideSpindle{"friction-bump", "time-locked-vibration",
                                               "intermittent-stick", "electrical-bursts",
                                               "load-steps"};
// With one speed, or in one direction, these look like one another.
const std::vector<std::string> kPoorEffects{"stribeck-friction", "quadratic-drag",
                                            "constant-load",     "asymmetric-friction",
                                            "torque-ripple",     "encoder-eccentricity"};

bool contains(const std::vector<std::string>& list, const std::string& item) {
  return std::ranges::find(list, item) != list.end();
}

/// The drive, the ranges of its motion, and how it is written down.
struct Setting {
  bool turns = false;
  Plant plant;
  double top_speed = 0.3;
  double acceleration = 2;
  double stroke = 0.3;
  double start = 0;
  std::size_t thin = 1;  ///< servo periods a row
  std::size_t laps = 2;
  bool scale = false;   ///< a second sensor at the stage
  bool counts = false;  ///< encoder counts instead of a position
};

Setting draw_setting(bool turns, Draw& draw) {
  Setting s;
  s.turns = turns;
  Plant& p = s.plant;
  double bandwidth = draw.uniform(20, 35);
  p.mode_hz = draw.uniform(250, 600);
  p.mode_damping = draw.log_uniform(0.02, 0.08);
  p.motor_share = draw.uniform(0.25, 0.7);
  p.friction_motor_share = draw.uniform(0.3, 0.9);
  p.maxwell_slip = draw.chance(1.0 / 3);
  p.servo_hz =
      p.mode_hz > 400 ? draw.one_of({2000.0, 4000.0, 8000.0}) : draw.one_of({4000.0, 8000.0});
  p.current_loop_hz = draw.uniform(700, 1500);
  double noise = 0;
  double counts_a_turn = 0;
  if (turns) {
    p.turn = 2 * kPi;
    s.top_speed = draw.log_uniform(80, 500);
    s.acceleration = draw.uniform(0.8, 2.5) * s.top_speed;
    p.inertia = draw.log_uniform(0.003, 0.05);
    p.coulomb = draw.log_uniform(0.15, 1.5);
    p.viscous = p.coulomb / s.top_speed * draw.log_uniform(0.3, 2);
    p.knee = draw.log_uniform(1e-4, 1e-3);
    p.effort_per_A = draw.uniform(0.3, 1.2);
    counts_a_turn = draw.one_of({16384.0, 65536.0, 262144.0, 1048576.0});
    noise = p.coulomb * draw.log_uniform(0.004, 0.02);
    bandwidth = draw.uniform(12, 25);
  } else {
    p.turn = draw.one_of({0.005, 0.01, 0.016, 0.02});
    s.top_speed = draw.uniform(0.15, 0.5);
    s.acceleration = draw.uniform(1, 4);
    s.stroke = std::min(draw.uniform(0.25, 0.6), 2 * s.top_speed);
    s.start = draw.uniform(-0.1, 0.2);
    p.inertia = draw.uniform(90, 240);
    p.coulomb = draw.log_uniform(30, 200);
    p.viscous = p.coulomb / s.top_speed * draw.log_uniform(0.3, 2);
    p.knee = draw.uniform(0.4e-6, 1.6e-6);
    p.effort_per_A = draw.uniform(100, 600);
    counts_a_turn = std::round(p.turn / draw.log_uniform(0.05e-6, 0.2e-6));
    noise = draw.log_uniform(0.3, 2);
  }
  p.lsb = p.turn / counts_a_turn;
  p.current_noise_A = noise / p.effort_per_A;
  const double w = 2 * kPi * bandwidth;
  p.velocity_gain = w * p.inertia / p.effort_per_A;
  p.position_gain = w / draw.uniform(4, 6);
  p.integral_rate = w / draw.uniform(3.5, 6);
  p.current_limit_A = 6 * (p.inertia * s.acceleration + 3 * p.coulomb) / p.effort_per_A;
  // Rows at 1 or 2 kHz, some at the servo rate.
  const double written = draw.chance(0.1) ? p.servo_hz : draw.one_of({1000.0, 2000.0});
  s.thin = static_cast<std::size_t>(std::lround(p.servo_hz / written));
  s.laps = draw.chance(0.3) ? 3 : 2;
  s.counts = draw.chance(0.5);
  s.scale = !turns && draw.chance(0.2);
  return s;
}

/// One lap from the start and back: plateaus of several speeds both ways, dwells, small
/// reversals and a sine. `held_out` gives other speeds, places and reversals.
void add_lap(Program& program, const Setting& s, Draw& draw) {
  const double room = s.turns ? 1e9 : s.stroke;
  const double home = program.position();
  const std::size_t plateaus = 4 + draw.below(2);
  program.dwell(draw.uniform(0.2, 0.5));
  double first = 1;
  for (std::size_t i = 0; i < plateaus; ++i) {
    // From the top speed down to less than a hundredth of it.
    const double depth = static_cast<double>(i) / static_cast<double>(plateaus - 1);
    const double speed = s.top_speed * std::pow(0.006, depth) * draw.uniform(0.7, 1.0);
    const double seconds = draw.uniform(0.7, 1.2);
    // The first plateau runs along the whole stroke.
    const double distance =
        i == 0 && !s.turns ? room : std::min(speed * (seconds + speed / s.acceleration), room);
    const double acceleration = s.acceleration * draw.uniform(0.5, 1.0);
    program.move(home + first * distance, speed, acceleration);
    if (draw.chance(0.5)) program.dwell(draw.uniform(0.05, 0.2));
    program.move(home, speed, acceleration);
    if (s.turns) first = -first;  // a spindle turns both ways
  }
  program.dwell(draw.uniform(0.1, 0.2));
  // Small reversals of two lengths: tenths of a millimetre and about one (or parts of a turn).
  const double small = s.turns ? 0.05 * s.plant.turn : 2e-4;
  for (const double factor : {draw.uniform(1, 2.5), draw.uniform(3, 8)}) {
    const double length = small * factor;
    program.to_and_fro(length, length / draw.uniform(0.08, 0.2), s.acceleration * 0.5, 1);
  }
  const double frequency = draw.uniform(1.5, 5);
  const double w = 2 * kPi * frequency;
  program.sine(std::min(0.3 * s.acceleration / (w * w), 0.2 * s.top_speed / w), frequency, 4);
  program.dwell(draw.uniform(0.1, 0.2));
}

/// The same speed all the time, or one direction only.
void add_poor_lap(Program& program, const Setting& s, bool one_way, double speed, double length) {
  for (int i = 0; i < 4; ++i) {
    program.move(program.position() + length, speed, s.acceleration);
    program.dwell(0.3);
    if (!one_way) {
      program.move(program.position() - length, speed, s.acceleration);
      program.dwell(0.3);
    }
  }
}

std::string key_of(bool turns, const char* axis, const char* spindle) {
  return turns ? spindle : axis;
}

/// Hides the effect; `share` is its size as a part of the Coulomb friction where that has a
/// meaning. Changes the plant only where a term of the model itself is what is missing.
HiddenEffect hide(const std::string& name, double share, Setting& s, Hidden& h, Draw& draw) {
  Plant& p = s.plant;
  const bool turns = s.turns;
  const double force = share * p.coulomb;
  HiddenEffect e;
  e.name = name;
  const auto note = [&](const char* axis, const char* spindle, double value) {
    e.parameters.emplace_back(key_of(turns, axis, spindle), value);
  };
  if (name == "viscous-friction") {
    p.viscous = force / s.top_speed;
    note("coefficient_N_s_per_m", "coefficient_Nm_s_per_rad", p.viscous);
  } else if (name == "coulomb-friction") {
    p.coulomb = force;
    note("force_N", "torque_Nm", force);
  } else if (name == "stribeck-friction") {
    h.stribeck_extra = force;
    h.stribeck_speed = s.top_speed * draw.log_uniform(0.01, 0.06);
    note("extra_static_N", "extra_static_Nm", force);
    note("stribeck_velocity_m_per_s", "stribeck_velocity_rad_per_s", h.stribeck_speed);
  } else if (name == "asymmetric-friction") {
    h.viscous_difference = 2 * draw.sign() * force / s.top_speed;
    h.coulomb_difference = draw.chance(0.5) ? 0.0 : draw.uniform(-1, 1) * force;
    note("viscous_difference_N_s_per_m", "viscous_difference_Nm_s_per_rad", h.viscous_difference);
    note("coulomb_difference_N", "coulomb_difference_Nm", h.coulomb_difference);
  } else if (name == "presliding-hysteresis") {
    h.presliding_breakaway = force;
    h.presliding_stiffness = force / (p.knee * draw.log_uniform(8, 50));
    note("breakaway_N", "breakaway_Nm", force);
    note("stiffness_N_per_m", "stiffness_Nm_per_rad", h.presliding_stiffness);
  } else if (name == "quadratic-drag") {
    // Friction that grows less than linearly must still grow.
    h.drag = force / (s.top_speed * s.top_speed);
    if (draw.chance(0.25)) h.drag = -std::min(h.drag, 0.35 * p.viscous / s.top_speed);
    note("coefficient_N_s2_per_m2", "coefficient_Nm_s2_per_rad2", h.drag);
  } else if (name == "position-dependent-friction") {
    if (draw.chance(0.5)) {
      h.friction_slope = draw.sign() * 2 * force / s.stroke;
      h.friction_centre = s.start + s.stroke * draw.uniform(0.3, 0.7);
    } else {
      h.tight_spot = force;
      h.tight_place = s.start + s.stroke * draw.uniform(0.2, 0.8);
      h.tight_width = draw.uniform(0.05, 0.15) * s.stroke;
    }
  } else if (name == "thermal-friction-drift") {
    h.drift_change = draw.chance(0.3) ? force : -force;
    h.drift_time_s = draw.log_uniform(5, 40);
    note("change_N", "change_Nm", h.drift_change);
    note("time_constant_s", "time_constant_s", h.drift_time_s);
  } else if (name == "constant-load") {
    h.constant_load = draw.sign() * force;
    note("force_N", "torque_Nm", h.constant_load);
  } else if (name == "spring-load") {
    h.spring = 2 * force / s.stroke;
    h.spring_rest = s.start + s.stroke * draw.uniform(0.3, 0.7);
    note("stiffness_N_per_m", "stiffness_Nm_per_rad", h.spring);
  } else if (name == "torque-ripple") {
    const std::size_t lines = 1 + draw.below(2);
    for (std::size_t i = 0; i < lines; ++i)
      h.ripple.push_back({draw.one_of({1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0}),
                          force * (i == 0 ? 1.0 : draw.uniform(0.4, 0.9)),
                          draw.uniform(-kPi, kPi)});
    if (lines == 2 && h.ripple[1].order == h.ripple[0].order) h.ripple.pop_back();
    note("order", "order", h.ripple[0].order);
    note("amplitude_N", "amplitude_Nm", h.ripple[0].amplitude);
  } else if (name == "backlash") {
    h.backlash = turns ? draw.log_uniform(5e-4, 1e-2) : draw.log_uniform(3e-6, 60e-6);
    note("width_m", "width_rad", h.backlash);
  } else if (name == "flexible-coupling") {
    h.flexible_hz = draw.log_uniform(40, 200);
    h.flexible_damping = draw.log_uniform(0.01, 0.1);
    h.flexible_share = draw.uniform(0.2, 0.7);
    note("resonance_hz", "resonance_hz", h.flexible_hz);
    note("mass_share", "inertia_share", h.flexible_share);
    // Guideways rub at the stage, screws and seals at the motor.
    if (draw.chance(0.75)) {
      h.flexible_friction = draw.uniform(0.2, 1);
      note("friction_share", "friction_share", h.flexible_friction);
    }
  } else if (name == "transport-delay") {
    h.delay_s = draw.log_uniform(0.5e-3, 4e-3);
    note("delay_s", "delay_s", h.delay_s);
  } else if (name == "current-loop-lag") {
    h.lag_hz = draw.log_uniform(40, 300);
    note("bandwidth_hz", "bandwidth_hz", h.lag_hz);
  } else if (name == "encoder-eccentricity") {
    const double w = 2 * kPi * 0.5 * s.top_speed / p.turn;
    h.eccentricity = std::min(force / (p.inertia * w * w), 0.05 * p.turn);
    h.eccentricity_phase = draw.uniform(-kPi, kPi);
    note("amplitude_rad", "amplitude_rad", h.eccentricity * 2 * kPi / p.turn);
  } else if (name == "lead-error") {
    s.scale = s.counts = true;
    const bool periodic = draw.chance(0.7);
    if (periodic) h.lead.push_back({1, draw.log_uniform(1e-6, 20e-6), draw.uniform(-kPi, kPi)});
    if (!periodic || draw.chance(0.3)) h.lead_slope = draw.sign() * draw.log_uniform(1e-5, 2e-4);
    if (periodic) note("amplitude_m", "amplitude_m", h.lead[0].amplitude);
    if (h.lead_slope != 0) note("slope", "slope", h.lead_slope);
  } else if (name == "load-dependent-friction") {
    h.load_friction = force / (p.inertia * s.acceleration);
    note("coefficient", "coefficient", h.load_friction);
  } else if (name == "cross-talk") {
    h.cross_talk = draw.sign() * force / (120 * s.acceleration);
    note("coefficient", "coefficient", h.cross_talk);
  } else if (name == "friction-bump") {
    h.bump = force;
    h.bump_speed = s.top_speed * draw.uniform(0.15, 0.5);
  } else if (name == "time-locked-vibration") {
    h.vibration = force;
    h.vibration_hz = draw.uniform(8, 55);
    h.vibration_phase = draw.uniform(-kPi, kPi);
    note("frequency_hz", "frequency_hz", h.vibration_hz);
  } else if (name == "intermittent-stick") {
    h.stick = force;
    h.stick_rate_hz = draw.uniform(0.3, 1.5);
  } else if (name == "offset-leak") {
    h.leak = draw.sign() * force;
    h.leak_time_s = draw.uniform(8, 25);
    h.leak_zero = draw.uniform(0.5, 0.8);  // so that it is not a constant load as well
  } else if (name == "electrical-bursts") {
    h.bursts_A = force / p.effort_per_A;
    h.burst_rate_hz = draw.uniform(0.5, 3);
  } else if (name == "load-steps") {
    h.load_step = draw.sign() * force;
    h.load_step_mean = force * draw.uniform(-1, 1);
    h.load_step_s = draw.log_uniform(0.5, 5);
  } else if (name == "unseen-axis") {
    h.unseen_axis = draw.sign() * force / (120 * s.acceleration);
  } else {
    std::fprintf(stderr, "blind: there is no effect '%s'\n", name.c_str());
    std::exit(2);
  }
  return e;
}

/// Takes the effect away again: what the machine would do without it.
void reveal(const std::string& name, Plant& p, Hidden& h) {
  const Hidden none;
  if (name == "viscous-friction") p.viscous = 1e-9 * p.viscous;
  if (name == "coulomb-friction") p.coulomb = 1e-3 * p.coulomb;
  if (name == "stribeck-friction") h.stribeck_extra = 0;
  if (name == "asymmetric-friction") h.viscous_difference = h.coulomb_difference = 0;
  if (name == "presliding-hysteresis") h.presliding_breakaway = 0;
  if (name == "quadratic-drag") h.drag = 0;
  if (name == "position-dependent-friction") h.friction_slope = h.tight_spot = 0;
  if (name == "thermal-friction-drift") h.drift_change = 0;
  if (name == "constant-load") h.constant_load = 0;
  if (name == "spring-load") h.spring = 0;
  if (name == "torque-ripple") h.ripple.clear();
  if (name == "backlash") h.backlash = 0;
  if (name == "flexible-coupling") h.flexible_hz = 0;
  if (name == "transport-delay") h.delay_s = 0;
  if (name == "current-loop-lag") h.lag_hz = 0;
  if (name == "encoder-eccentricity") h.eccentricity = 0;
  if (name == "lead-error") h.lead.clear(), h.lead_slope = 0;
  if (name == "load-dependent-friction") h.load_friction = 0;
  if (name == "cross-talk") h.cross_talk = 0;
  if (name == "friction-bump") h.bump = 0;
  if (name == "time-locked-vibration") h.vibration = 0;
  if (name == "intermittent-stick") h.stick = 0;
  if (name == "offset-leak") h.leak = 0;
  if (name == "electrical-bursts") h.bursts_A = 0;
  if (name == "unseen-axis") h.unseen_axis = 0;
  if (name == "load-steps") h.load_step = 0;
}

/// Gaps of a recording after mass, viscous and Coulomb friction with its knee, between a clamp and
/// an exponential, were refitted on its first part.
struct Gaps {
  double clean = 0;     ///< fitted part, no noise
  double noise = 0;     ///< what noise and rounding add there
  double held_out = 0;  ///< as measured
};

Gaps gaps_of(const Recording& r, const Plant& p, std::size_t split, bool viscous, bool coulomb) {
  constexpr double kCutoff_Hz = 80;
  const auto skip = static_cast<std::size_t>(0.5 * r.rate_hz);
  const auto smooth = [&](const Signal& x) { return low_pass(x, r.rate_hz, kCutoff_Hz); };
  const auto effort = [&](const Signal& current) {
    Signal u = smooth(current);
    for (double& value : u) value *= p.effort_per_A;
    return u;
  };
  const auto terms = [&](const Signal& position, double knee) {
    const Signal v = derivative(smooth(position), r.rate_hz);
    std::vector<Signal> columns{derivative(v, r.rate_hz)};
    if (viscous) columns.push_back(v);
    if (coulomb) {
      columns.push_back(smooth(soft_sign(position, knee)));
      columns.push_back(smooth(fading_sign(position, knee)));
    }
    return columns;
  };
  const Signal clean_effort = effort(r.clean_current_A);
  const Signal measured_effort = effort(r.current_A);
  const std::size_t end = r.time_s.size() - skip / 4;
  Gaps g;
  g.clean = 1e300;
  std::vector<Signal> clean;
  double best_knee = p.knee;
  for (const double factor : {0.7, 1.0, 1.4, 2.0, 2.8}) {
    std::vector<Signal> columns = terms(r.clean_motor, factor * p.knee);
    const double gap = rms(least_squares(columns, clean_effort, skip, split).residual, skip, split);
    if (gap >= g.clean) continue;
    g.clean = gap;
    best_knee = factor * p.knee;
    clean = std::move(columns);
  }
  const std::vector<Signal> measured = terms(r.motor, best_knee);
  g.held_out = rms(least_squares(measured, measured_effort, skip, split).residual, split, end);
  Signal noise(r.time_s.size());
  for (std::size_t i = 0; i < noise.size(); ++i)
    noise[i] = measured_effort[i] - clean_effort[i] - p.inertia * (measured[0][i] - clean[0][i]);
  g.noise = rms(noise, skip, split);
  return g;
}

void put(std::ostringstream& out, const char* key, double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.9g", value);
  out << key << " = " << text << '\n';
}

}  // namespace

std::vector<std::string> drive_cells(const std::string& domain) {
  const bool spindle = domain == "spindle";
  std::vector<std::string> all;
  for (const std::string& e : spindle ? kSpindleEffects : kAxisEffects)
    all.push_back(domain + "/single/" + e);
  for (const char* cell : {"null", "null-wrong", "null-noisy"}) all.push_back(domain + "/" + cell);
  for (const std::string& e : spindle ? kOutsideSpindle : kOutside)
    all.push_back(domain + "/outside/" + e);
  for (const auto& list : {foreign_effects(), wrong_numbers()})
    for (const std::string& what : list) all.push_back(domain + "/file/" + what);
  if (!spindle) {
    for (const char* cell : {"pair", "scale", "clipped", "dropouts", "zero-shift", "one-lap"})
      all.push_back(domain + "/" + cell);
    for (const std::string& e : kPoorEffects) all.push_back(domain + "/poor/" + e);
  }
  return all;
}

Case draw_drive_case(const std::string& domain, const std::string& cell, const std::string& effect,
                     std::uint64_t seed, const std::string& variant) {
  const bool turns = domain == "spindle";
  Draw draw(seed, domain + "/machine");
  Setting s = draw_setting(turns, draw);
  // Most files tell the current loop, which may then be slow: without that nobody can say of half a
  // millisecond whether it is the loop's own.
  Draw loop(seed, domain + "/current loop");
  const bool tells_loop = loop.chance(0.7);
  if (tells_loop) s.plant.current_loop_hz = loop.log_uniform(300, 1500);
  const bool wrong_file = cell == "file";
  const bool null_case = cell.starts_with("null") || wrong_file;
  if (cell == "null-noisy") s.plant.current_noise_A *= 2;
  if (cell == "scale") s.scale = s.counts = true;
  if (cell == "one-lap") s.laps = 1;
  if (cell == "file" && effect == "encoder-counts") s.counts = true;
  if (s.scale) s.counts = true;

  // Which effect, and how much of it: a stream of its own, so that the same seed gives the same
  // machine in every cell.
  Draw choice(seed, domain + "/" + cell);
  const std::vector<std::string>& catalogue = turns ? kSpindleEffects : kAxisEffects;
  const std::vector<std::string>& outside = turns ? kOutsideSpindle : kOutside;
  std::vector<std::string> names;
  const auto any = [&](const std::vector<std::string>& list) {
    return list[choice.below(list.size())];
  };
  std::string wrong;
  if (wrong_file)
    wrong =
        !effect.empty() ? effect : any(choice.chance(0.5) ? foreign_effects() : wrong_numbers());
  if (!effect.empty() && !wrong_file) {
    names.push_back(effect);
  } else if (cell == "outside") {
    names.push_back(any(outside));
  } else if (cell == "poor") {
    names.push_back(any(kPoorEffects));
  } else if (cell == "pair") {
    names.push_back(any(catalogue));
  } else if (cell == "zero-shift") {
    names.push_back(choice.chance(0.5) ? "torque-ripple" : "encoder-eccentricity");
  } else if (!null_case) {
    names.push_back(any(catalogue));
  }
  if (cell == "pair") {
    std::string second;
    // Two names of one and the same term, or two hidden states in one place, are not a pair.
    const auto group = [](const std::string& n) -> std::string {
      if (n == "backlash" || n == "flexible-coupling") return "load";
      if (n == "transport-delay" || n == "current-loop-lag") return "timing";
      if (n == "constant-load" || n == "asymmetric-friction") return "offset";
      return n;
    };
    do second = any(catalogue);
    while (group(second) == group(names[0]));
    names.push_back(second);
  }

  Hidden hidden;
  Draw size(seed, domain + "/" + cell + "/size");
  std::vector<HiddenEffect> effects;
  for (const std::string& name : names) {
    double share = size.log_uniform(0.01, 0.7);
    if (cell == "pair") share = size.log_uniform(0.15, 0.6);
    if (cell == "poor") share = size.log_uniform(0.1, 0.7);
    effects.push_back(hide(name, share, s, hidden, size));
  }
  bool no_viscous = contains(names, "viscous-friction");
  bool no_coulomb = contains(names, "coulomb-friction");
  // What tells an effect tells it of drives without as well: a file without friction, here of a
  // drive that has next to none; the columns of another axis; a record that is damaged.
  Draw decoy(seed, domain + "/decoys/" + cell);
  const double friction_clue = decoy.unit(), damage_clue = decoy.unit();
  const bool other_axis_clue = decoy.chance(0.4);
  if (null_case && friction_clue < 0.1) {
    no_viscous = true;
    s.plant.viscous *= 1e-6;
  } else if (null_case && friction_clue < 0.2) {
    no_coulomb = true;
    s.plant.coulomb *= 1e-3;
  }
  const std::string damaged = null_case && damage_clue < 0.24
                                  ? (damage_clue < 0.08   ? "clipped"
                                     : damage_clue < 0.16 ? "dropouts"
                                                          : "zero-shift")
                                  : cell;

  // Fit part in laps, another program held out.
  Program program(s.plant.servo_hz, s.start);
  program.dwell(0.5);
  const Draw lap_draw(seed, domain + "/lap");
  const bool one_way = cell == "poor" && choice.chance(0.5);
  const double poor_speed = s.top_speed * choice.uniform(0.2, 0.8);
  const double poor_length = (turns ? 2.0 : 0.8) * (turns ? s.top_speed : s.stroke) / 4;
  for (std::size_t lap = 0; lap < s.laps; ++lap) {
    Draw again = lap_draw;  // every lap is the same
    if (cell == "poor")
      add_poor_lap(program, s, one_way, poor_speed, poor_length);
    else
      add_lap(program, s, again);
  }
  const double held_out_from_s = program.seconds();
  Draw other_lap(seed, domain + "/held out");
  if (cell == "poor")
    add_poor_lap(program, s, one_way, poor_speed, 0.8 * poor_length);
  else
    add_lap(program, s, other_lap);
  const std::vector<double> command = program.smoothed(draw.uniform(0.01, 0.04));

  // A second axis that moves on its own; only its motion and current are in the trace.
  const bool cross_talk = contains(names, "cross-talk");
  const bool second_axis = cross_talk || (!turns && other_axis_clue);
  std::vector<double> other_command, other_effort, felt;
  constexpr double kOtherMass = 120;
  const auto run_other = [&](const char* stream, std::vector<double>& effort) {
    Draw d(seed, stream);
    Program other(s.plant.servo_hz, 0.0);
    while (other.seconds() < program.seconds()) {
      other.dwell(d.uniform(0.1, 0.8));
      other.move(d.uniform(0, 0.3), d.uniform(0.05, 0.4), s.acceleration);
    }
    std::vector<double> path = other.smoothed(0.02);
    path.resize(command.size());
    const Signal v = derivative(path, s.plant.servo_hz);
    const Signal a = derivative(v, s.plant.servo_hz);
    effort.resize(command.size());
    for (std::size_t i = 0; i < a.size(); ++i)
      effort[i] = kOtherMass * a[i] + 300 * v[i] + 40 * std::tanh(v[i] / 1e-3);
    return std::pair{std::move(path), a};
  };
  if (second_axis) {
    auto [path, a] = run_other("second axis", other_effort);
    other_command = std::move(path);
    if (cross_talk) felt = other_effort;
    // Through a bed that gives, its acceleration is felt, and none of its friction.
    if (cross_talk && Draw(seed, "cross-talk").chance(0.5)) {
      for (std::size_t i = 0; i < a.size(); ++i) felt[i] = kOtherMass * a[i];
      for (HiddenEffect& e : effects)
        if (e.name == "cross-talk") e.parameters[0].second *= kOtherMass;
    }
  }
  if (hidden.unseen_axis != 0) run_other("unseen axis", felt);

  // A loop that an effect has made restless is tuned down, as a commissioning engineer would.
  Recording r;
  Gaps gaps, without;
  for (int attempt = 0;; ++attempt) {
    r = run(s.plant, hidden, command, felt, s.thin, seed);
    double worst = 0;
    for (std::size_t i = 0; i < r.motor.size(); ++i)
      worst = std::max(worst, std::abs(r.command[i] - r.clean_motor[i]));
    const double lag = s.top_speed / s.plant.position_gain;
    // Swinging above the motion's own frequencies that costs more than the axis' acceleration.
    const Signal slow = low_pass(r.scale, r.rate_hz, 80);
    Signal swing(slow.size());
    for (std::size_t i = 0; i < slow.size(); ++i) swing[i] = r.scale[i] - slow[i];
    const double allowed = s.acceleration / std::pow(2 * kPi * 150, 2) + hidden.backlash;
    if ((r.stable && worst < 2.5 * lag && rms(swing, 0, swing.size()) < allowed) || attempt == 5)
      break;
    s.plant.velocity_gain *= 0.7;
    s.plant.position_gain *= 0.7;
    s.plant.integral_rate *= 0.7;
  }
  const double rate = r.rate_hz;
  const auto split = static_cast<std::size_t>(held_out_from_s * rate);
  gaps = gaps_of(r, s.plant, split, !no_viscous, !no_coulomb);
  without = gaps;
  if (effects.size() == 2) {
    Hidden none = hidden;
    Plant plant = s.plant;
    reveal(effects[0].name, plant, none);
    reveal(effects[1].name, plant, none);
    without = gaps_of(run(plant, none, command, felt, s.thin, seed), s.plant, split, !no_viscous,
                      !no_coulomb);
  }
  double out_noise = gaps.noise;
  for (HiddenEffect& e : effects) {
    Plant plant = s.plant;
    Hidden rest = hidden;
    reveal(e.name, plant, rest);
    const Gaps g = gaps_of(run(plant, rest, command, felt, s.thin, seed), s.plant, split,
                           !no_viscous, !no_coulomb);
    const double more = gaps.clean * gaps.clean - g.clean * g.clean;
    double visible = std::sqrt(std::max(more, 0.0));
    double floor = gaps.noise;
    if (e.name == "electrical-bursts") {
      // It is noise itself: the floor is that of the run without.
      floor = g.noise;
      visible = std::sqrt(std::max(gaps.noise * gaps.noise - floor * floor, 0.0));
      out_noise = floor;
    }
    e.strength = visible / floor;
    if (effects.size() == 1) without = g;
    e.visibility = visible / std::hypot(floor, without.clean);
    if (e.name == "lead-error") {
      // Seen between the two sensors, not in the force.
      Signal error(r.time_s.size());
      for (std::size_t i = 0; i < error.size(); ++i)
        for (const Line& line : hidden.lead)
          error[i] += line.amplitude *
                      std::sin(line.order * 2 * kPi * r.clean_motor[i] / s.plant.turn + line.phase);
      for (std::size_t i = 0; i < error.size(); ++i)
        error[i] += hidden.lead_slope * (r.clean_motor[i] - s.start - s.stroke / 2);
      e.strength = rms(error, 0, error.size()) / (s.plant.lsb * std::sqrt(1.04 / 12));
      e.visibility = e.strength;
    }
  }

  Case out;
  out.name = domain + "/" + cell;
  if (!names.empty() && cell != "pair") out.name += "/" + names[0];
  if (wrong_file) out.name += "/" + wrong;
  out.seed = seed;
  out.variant = variant;
  out.truth.effects = effects;
  out.truth.noise_floor = out_noise;
  out.truth.gap_before = gaps.held_out;
  out.truth.gap_oracle = without.held_out;
  out.truth.held_out_from_s = held_out_from_s;
  out.truth.expect = null_case ? "none"
                     : cell == "outside"
                         ? (contains(names, "time-locked-vibration") ? "line" : "outside")
                     : cell == "poor" ? "class"
                                      : "name";

  // What the user has: parameters off, the effect absent, and one of several sensors.
  const double length = variant == "units" && !turns ? 1.7 : 1.0;  // an angle is an angle
  const double strength = variant == "units" ? 0.6 : 1.0;
  const double facing = variant == "reversed" ? -1.0 : 1.0;
  const double offset = variant == "offset" ? 0.0637 * (turns ? 10.0 : 1.0) : 0.0;
  const double off = cell == "null-wrong" ? 0.35 : 0.10;
  Draw guess(seed, domain + "/nominal");
  const auto nominal = [&](double value) { return value * (1 + guess.uniform(-off, off)); };
  const std::string channel = turns ? "spindle" : "x";
  const Plant& p = s.plant;
  std::ostringstream ini;
  ini << "[machine]\nname = blind\n";
  put(ini, "sample_rate_hz", s.plant.servo_hz);  // of the servo; the rows are thinned out
  ini << (turns ? "\n[spindle]\n" : "\n[axis.x]\n");
  const double per_speed = strength / length;
  if (!turns) put(ini, "lead_m", p.turn * length);
  put(ini, turns ? "inertia_kg_m2" : "equivalent_mass_kg", nominal(p.inertia) * per_speed);
  const char* viscous_key = turns ? "viscous_friction_Nm_s_per_rad" : "viscous_friction_N_s_per_m";
  const char* coulomb_key = turns ? "coulomb_friction_Nm" : "coulomb_friction_N";
  const bool say_zero = guess.chance(0.5);
  const double viscous = nominal(p.viscous) * per_speed;
  const double coulomb = nominal(p.coulomb) * strength;
  if (!no_viscous) put(ini, viscous_key, viscous);
  if (!no_coulomb) put(ini, coulomb_key, coulomb);
  if (no_viscous && say_zero) put(ini, viscous_key, 0);
  if (no_coulomb && say_zero) put(ini, coulomb_key, 0);
  Draw spoil(seed, domain + "/wrong file");
  const auto spoilt = [&](const char* what, double value, double by) {
    return wrong == what ? value * (spoil.chance(0.5) ? by : 1 / by) : value;
  };
  const double gain = spoilt(
      "effort-constant",
      cell == "null-wrong" ? p.effort_per_A * (1 + guess.uniform(-0.1, 0.1)) : p.effort_per_A, 1.4);
  put(ini, turns ? "torque_constant_Nm_per_A" : "force_constant_N_per_A", gain * strength);
  if (const bool told = guess.chance(0.5); told || wrong == "knee")
    put(ini, turns ? "friction_knee_rad" : "friction_knee_m",
        spoilt("knee", p.knee * length * guess.log_uniform(0.6, 1.6), 10));
  if (s.counts)
    put(ini, "encoder_counts_per_rev", std::round(spoilt("encoder-counts", p.turn / p.lsb, 1.25)));
  if (second_axis) {
    ini << "\n[axis.y]\nlead_m = 0.01\n";
    put(ini, "equivalent_mass_kg", kOtherMass * strength / length);
    put(ini, "force_constant_N_per_A", 200 * strength);
  }
  ini << (turns ? "\n[controller.spindle]\n" : "\n[controller.x]\n");
  put(ini, "position_gain_per_s", spoilt("controller", p.position_gain, 1.5));
  put(ini, turns ? "velocity_gain_A_s_per_rad" : "velocity_gain_A_s_per_m",
      p.velocity_gain / length);
  put(ini, "velocity_integral_per_s", p.integral_rate);
  put(ini, "current_limit_A", p.current_limit_A);
  if (tells_loop)
    put(ini, "current_bandwidth_hz", p.current_loop_hz * (1 + loop.uniform(-0.1, 0.1)));
  if (std::ranges::find(foreign_effects(), wrong) != foreign_effects().end())
    ini << foreign_section(wrong,
                           {turns, p.coulomb * strength, s.top_speed * length, p.turn * length,
                            turns ? 5e-5 : 1e-6 * length},
                           spoil);
  out.machine = ini.str();

  // Columns. The encoder may have lost its place when the machine was switched off in between.
  const std::size_t rows = r.time_s.size();
  std::vector<std::size_t> kept;
  const std::size_t every = variant == "decimated" ? 2 : 1;
  Draw damage(seed, domain + "/damage");
  std::vector<bool> bad_row(rows, false), bad_value(rows, false);
  if (damaged == "dropouts") {
    for (std::size_t i = 0; i < rows;
         i += static_cast<std::size_t>(damage.uniform(0.5, 4) * rate)) {
      const auto n = static_cast<std::size_t>(damage.uniform(0.002, 0.03) * rate) + 1;
      std::vector<bool>& kind = damage.chance(0.5) ? bad_row : bad_value;
      for (std::size_t j = i + 1; j < std::min(rows, i + 1 + n); ++j) kind[j] = true;
    }
  }
  for (std::size_t i = 0; i < rows; i += every)
    if (!bad_row[i]) kept.push_back(i);
  const bool shifted = damaged == "zero-shift";
  const double zero = shifted ? damage.uniform(0.15, 0.85) * p.turn : 0.0;
  const double pause_s = shifted ? 5.0 : 0.0;
  double clip = 1e300;
  if (damaged == "clipped") {
    double peak = 0;
    for (const double i : r.current_A) peak = std::max(peak, std::abs(i));
    clip = damage.uniform(0.7, 0.9) * peak;
  }
  const auto column = [&](const std::string& name, auto&& value) {
    Column c{name, {}};
    c.values.reserve(kept.size());
    for (const std::size_t i : kept) c.values.push_back(value(i));
    out.columns.push_back(std::move(c));
  };
  const auto late = [&](std::size_t i) { return shifted && i >= split; };
  const auto place = [&](std::size_t i, double x) {
    return facing * length * (x + (late(i) ? zero : 0.0)) + offset;
  };
  const std::string motion = turns ? "angle_rad" : "position_m";
  column("t_s", [&](std::size_t i) { return r.time_s[i] + (late(i) ? pause_s : 0.0); });
  column(channel + ".command_" + motion, [&](std::size_t i) { return place(i, r.command[i]); });
  const auto counts_off = static_cast<double>(std::lround(zero / p.lsb));
  if (s.counts)
    column(channel + ".angle_counts", [&](std::size_t i) {
      const double shift = (late(i) ? counts_off : 0.0) + std::round(offset / (length * p.lsb));
      return facing * static_cast<double>(r.counts[i]) + shift;
    });
  else
    column(channel + "." + motion, [&](std::size_t i) { return place(i, r.motor[i]); });
  if (s.scale) column(channel + ".position_m", [&](std::size_t i) { return place(i, r.scale[i]); });
  column(channel + ".current_A", [&](std::size_t i) {
    if (bad_value[i]) return i % 3 == 0 ? kAbsent : std::nan("");
    return facing * std::clamp(r.current_A[i], -clip, clip);
  });
  if (second_axis) {
    column("y.position_m", [&](std::size_t i) {
      return length * std::round(other_command[i * s.thin] / 1e-7) * 1e-7;
    });
    Draw noise(seed, "second axis current");
    column("y.current_A",
           [&](std::size_t i) { return other_effort[i * s.thin] / 200 + 0.004 * noise.normal(); });
  }
  return out;
}

}  // namespace blind
