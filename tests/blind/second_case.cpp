// Cases of the second generator: domains `second-drive` and `second-spindle`, and of the machines
// of text books, `book-drive` and `book-spindle`.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>

#include "case.hpp"
#include "second_machine.hpp"
#include "second_truth.hpp"
#include "wrong_file.hpp"

namespace blind {
namespace {

using namespace second;

constexpr double kTurn = 2 * std::numbers::pi;

/// How the record and the machine file are written.
struct Manner {
  std::string position;  ///< position_m, angle_rad, angle_counts
  std::string effort;    ///< force_N, torque_Nm, current_A
  double constant = 1;   ///< effort per ampere
  bool constant_at_motor = false;
  bool scale = false, command = false, controller = false, second_axis = false;
  bool tells_loop = false, knee = false, other_effort = false;
};

std::string number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

/// All digits of a count.
std::string whole(double value) { return std::to_string(std::llround(value)); }

Manner draw_manner(Draw& draw, const Drawn& d, const std::string& effect) {
  Manner m;
  const double kind = draw.unit();
  if (d.turns)
    m.position = kind < 0.5 ? "angle_counts" : "angle_rad";
  else
    m.position = kind < 0.5 ? "position_m" : kind < 0.8 ? "angle_counts" : "angle_rad";
  const double effort = draw.unit();
  m.effort = effort < 0.4 ? (d.turns ? "torque_Nm" : "force_N") : "current_A";
  m.constant_at_motor = d.turns || effort > 0.7;
  m.constant = d.turns ? draw.log_uniform(0.3, 3) : draw.log_uniform(20, 300);
  m.scale = !d.turns && (effect == "lead-error" || draw.chance(0.12));
  // A scale takes the column in metres.
  if (m.scale && m.position == "position_m") m.position = "angle_counts";
  m.second_axis = !d.turns && (effect == "cross-talk" || draw.chance(0.4));
  m.command = draw.chance(0.6);
  m.controller = d.plant.feed_forward == 0 && draw.chance(0.6);
  m.tells_loop = draw.chance(0.5) && d.kind == Kind::any;  // or in a section of its own
  m.knee = draw.chance(0.25);
  return m;
}

bool reports_command(const Plant& p) {
  return p.reports == Reports::command || p.reports == Reports::command_before;
}

Kind kind_of(const std::string& domain) {
  return domain.starts_with("book-") ? Kind::text_book : Kind::any;
}

std::string machine_text(const Drawn& d, const Plant& p, const Manner& m, const Scenario& s,
                         Draw& draw, double wrong) {
  const auto off = [&](double value) { return number(value * draw.uniform(1 - wrong, 1 + wrong)); };
  const std::string unit = d.turns ? "Nm" : "N", per_speed = d.turns ? "_s_per_rad" : "_s_per_m";
  std::string text = "[machine]\nname = test machine\nsample_rate_hz = " + number(p.servo_hz);
  text += d.turns ? "\n\n[spindle]\n" : "\n\n[axis.x]\nlead_m = " + number(p.turn) + "\n";
  text += (d.turns ? "inertia_kg_m2 = " : "equivalent_mass_kg = ") + off(p.inertia) + "\n";
  const std::string viscous = off(p.viscous), coulomb = off(p.coulomb);
  if (!s.without_viscous) text += "viscous_friction_" + unit + per_speed + " = " + viscous + "\n";
  if (!s.without_coulomb) text += "coulomb_friction_" + unit + " = " + coulomb + "\n";
  // Friction that follows the speed has no such travel.
  if (m.knee && p.law != Law::tanh && p.law != Law::arctan)
    text +=
        "friction_knee_" + std::string(d.turns ? "rad" : "m") + " = " + off(p.presliding) + "\n";
  if (m.effort == "current_A" || m.controller) {
    if (d.turns)
      text += "torque_constant_Nm_per_A = " + number(m.constant) + "\n";
    else if (m.constant_at_motor)
      text += "torque_constant_Nm_per_A = " + number(m.constant * p.turn / kTurn) + "\n";
    else
      text += "force_constant_N_per_A = " + number(m.constant) + "\n";
  }
  if (m.position == "angle_counts") text += "encoder_counts_per_rev = " + whole(d.counts) + "\n";
  if (m.second_axis)
    text += "\n[axis.y]\nlead_m = 0.01\nequivalent_mass_kg = " + number(0.8 * p.inertia) +
            "\nviscous_friction_N_s_per_m = " + number(p.viscous) +
            "\ncoulomb_friction_N = " + number(p.coulomb) + "\n";
  if (m.controller) {
    text += d.turns ? "\n[controller.spindle]\n" : "\n[controller.x]\n";
    text += "position_gain_per_s = " + number(p.position_gain) + "\nvelocity_gain_A" + per_speed +
            " = " + number(p.velocity_gain / m.constant) +
            "\nvelocity_integral_per_s = " + number(p.integral_per_s) +
            "\ncurrent_limit_A = " + number(p.limit / m.constant) + "\n";
    if (m.tells_loop && p.current_loop_hz > 0)
      text += "current_bandwidth_hz = " + number(p.current_loop_hz) + "\n";
    if (m.tells_loop && p.dead_time_s > 0) text += "delay_s = " + number(p.dead_time_s) + "\n";
  }
  if (d.kind == Kind::text_book) {
    const std::string on = d.turns ? "spindle." : "x.";
    text += "\n[effect." + on + "flexible-coupling]\nresonance_hz = " + off(p.mode_hz) +
            "\ndamping_ratio = " + off(p.mode_damping) +
            (d.turns ? "\ninertia_share = " : "\nmass_share = ") + off(p.load_share) + "\n";
    if (reports_command(p))
      text +=
          "\n[effect." + on + "current-loop-lag]\nbandwidth_hz = " + off(p.current_loop_hz) + "\n";
  }
  return text;
}

std::vector<Column> columns_of(const Drawn& d, const Plant& p, const Manner& m, const Record& r,
                               const Signal& reference, const Signal& other, std::uint64_t seed) {
  const std::string channel = d.turns ? "spindle." : "x.";
  const std::size_t n = r.position.size();
  std::vector<Column> all(1);
  all[0].name = "t_s";
  for (std::size_t k = 0; k < n; ++k) all[0].values.push_back(static_cast<double>(k) / p.servo_hz);
  const auto add = [&](const std::string& name, const Signal& from, double factor, bool whole) {
    Column c{name, {}};
    for (const double value : from)
      c.values.push_back(whole ? std::round(value * factor) : value * factor);
    all.push_back(std::move(c));
  };
  if (m.position == "position_m")
    add("x.position_m", r.position, 1, false);
  else if (m.position == "angle_rad")
    add(channel + "angle_rad", r.position, kTurn / p.turn, false);
  else
    add(channel + "angle_counts", r.position, d.counts / p.turn, true);
  if (m.scale) add("x.position_m", r.scale, 1, false);
  if (m.command)
    add(channel + (d.turns ? "command_angle_rad" : "command_position_m"), reference, 1, false);
  add(channel + m.effort, r.effort, m.effort == "current_A" ? 1 / m.constant : 1, false);
  if (m.second_axis) add("y.position_m", other, 1, false);
  // Most records of two axes have both efforts; a mass with friction will do.
  if (m.second_axis && m.other_effort) {
    const Signal v = derivative(other, p.servo_hz), a = derivative(v, p.servo_hz);
    Draw hiss(seed, "other effort");
    Signal effort;
    for (std::size_t k = 0; k < n; ++k)
      effort.push_back(0.8 * p.inertia * a[k] + p.viscous * v[k] +
                       p.coulomb * std::tanh(v[k] / p.creep_speed) +
                       0.01 * p.coulomb * hiss.normal());
    add("y.force_N", effort, 1, false);
  }
  return all;
}

double excess(double with, double without) {
  return std::sqrt(std::max(with * with - without * without, 0.0));
}

[[noreturn]] void fail(const std::string& sentence) {
  std::fprintf(stderr, "blind: %s\n", sentence.c_str());
  std::exit(2);
}

/// Whether the loop swings by itself: more effort above the motion than a drive at work has.
bool howls(const Plant& p, const Record& r) {
  if (!r.stable) return true;
  const Signal slow = low_pass(r.effort, p.servo_hz, 80);
  double fast = 0, all = 0;
  for (std::size_t k = 0; k < slow.size(); ++k) {
    fast += (r.effort[k] - slow[k]) * (r.effort[k] - slow[k]);
    all += slow[k] * slow[k];
  }
  return fast > 0.04 * all;
}

/// What the other axis does: a program of its own, followed well.
Signal other_path(Draw draw, const Drawn& d, std::size_t rows) {
  Limits l = d.limits;
  l.stroke *= 0.8;
  Signal q = program(draw, l, d.plant.servo_hz, d.seconds).reference;
  q.resize(rows, q.back());
  return low_pass(q, d.plant.servo_hz, 12);
}

/// Of one effect alone, for its strength, and of all.
struct Plan {
  Scenario all, none;
  std::vector<Scenario> alone;
};

}  // namespace

std::vector<std::string> second_cells(const std::string& domain) {
  std::vector<std::string> all;
  for (const std::string& effect : effects_of(domain.ends_with("spindle"), kind_of(domain)))
    all.push_back(domain + "/single/" + effect);
  all.push_back(domain + "/null");
  all.push_back(domain + "/null-wrong");
  for (const std::string& kind : outside_kinds()) all.push_back(domain + "/outside/" + kind);
  for (const std::string& what : foreign_effects()) all.push_back(domain + "/file/" + what);
  all.push_back(domain + "/pair");
  return all;
}

Case draw_second_case(const std::string& domain, const std::string& cell, const std::string& chosen,
                      std::uint64_t seed, const std::string& variant) {
  if (variant != "plain") fail("the second generator draws plain cases only");
  const bool turns = domain.ends_with("spindle");
  const Kind kind = kind_of(domain);
  // A machine for every cell and seed.
  Draw draw(seed, domain + "/" + cell + "/" + chosen);
  std::vector<std::string> names;
  const bool wrong_file = cell == "file";
  const std::string wrong = !wrong_file ? ""
                            : !chosen.empty()
                                ? chosen
                                : foreign_effects()[draw.below(foreign_effects().size())];
  if (cell == "single" || cell == "outside") {
    std::vector<std::string> list = cell == "single" ? effects_of(turns, kind) : outside_kinds();
    if (!chosen.empty() && std::ranges::find(list, chosen) == list.end())
      fail("there is no '" + chosen + "' in " + domain + "/" + cell);
    names.push_back(chosen.empty() ? list[draw.below(list.size())] : chosen);
  } else if (cell == "pair") {
    std::vector<std::string> list = effects_of(turns, kind);
    std::erase_if(list, [](const std::string& e) {
      return e == "viscous-friction" || e == "coulomb-friction" || e == "lead-error" ||
             e == "cross-talk";
    });
    const std::size_t a = draw.below(list.size());
    std::size_t b = draw.below(list.size());
    // A lag and a delay are one thing at low frequencies.
    const auto timing = [&](std::size_t i) {
      return list[i] == "transport-delay" || list[i] == "current-loop-lag";
    };
    // And a load on a spring is that spring, at rest elsewhere.
    const auto pull = [&](std::size_t i) {
      return list[i] == "constant-load" || list[i] == "spring-load";
    };
    while (b == a || (timing(a) && timing(b)) || (pull(a) && pull(b))) b = draw.below(list.size());
    names = {list[a], list[b]};
  }

  Drawn d = draw_machine(draw, turns, kind);
  for (const std::string& name : names) make_room(d, name);
  Draw of_motion(draw.next(), "motion"), of_other(draw.next(), "other"),
      of_gains(draw.next(), "gains"), of_file(draw.next(), "file");
  const Program motion = program(of_motion, d.limits, d.plant.servo_hz, d.seconds);
  Manner manner = draw_manner(of_file, d, names.empty() ? "" : names.front());
  manner.other_effort = Draw(seed, "efforts of both").chance(0.6);
  // Steps that would shake the drive by their size are of an encoder that nobody would have.
  const double finest = 0.1 * d.plant.coulomb / (d.plant.servo_hz * kTurn * 30 * d.plant.inertia);
  while (d.plant.turn / d.counts > std::max(finest, 1e-9)) d.counts *= 2;
  d.plant.encoder_step = d.plant.turn / d.counts;

  Signal other, other_rate;
  double other_most = 1;
  if (manner.second_axis) {
    other = other_path(of_other, d, motion.reference.size());
    other_rate = derivative(derivative(other, d.plant.servo_hz), d.plant.servo_hz);
    other_most = 1e-9;
    for (const double a : other_rate) other_most = std::max(other_most, std::abs(a));
  }

  Plan plan;
  // A file without friction is no sign of friction: here of a drive that has next to none.
  Draw decoy(seed, domain + "/decoys/" + cell);
  if (names.empty() && decoy.chance(0.1)) {
    d.plant.viscous *= 1e-6;
    plan.all.without_viscous = plan.none.without_viscous = true;
  }
  plan.all.plant = plan.none.plant = d.plant;
  const std::uint64_t hiding = draw.next();
  for (const std::string& name : names) {
    Draw same(hiding, name), again(hiding, name);
    hide(plan.all, d, name, same, other_most);
    plan.alone.emplace_back();
    plan.alone.back().plant = d.plant;
    hide(plan.alone.back(), d, name, again, other_most);
  }
  const std::uint64_t noise = draw.next();
  const Signal empty;
  const auto run = [&](const Scenario& s) {
    return simulate(s.plant, s.hidden, motion.reference,
                    s.hidden.cross_coefficient != 0 ? other_rate : empty, noise);
  };
  // One tuning for all, so that they differ by the effect alone; turned down while one of them
  // howls.
  double down = 1;
  const auto tune_all = [&] {
    for (Scenario* s : {&plan.all, &plan.none}) tune(of_gains, s->plant, plan.all.hidden, down);
    for (Scenario& s : plan.alone) tune(of_gains, s.plant, plan.all.hidden, down);
  };
  const auto first_bit = [&](const Scenario& s) {
    Signal start = motion.reference;
    start.resize(
        std::min(start.size(), start.size() / 8 + static_cast<std::size_t>(2 * s.plant.servo_hz)));
    return howls(s.plant, simulate(s.plant, s.hidden, start,
                                   s.hidden.cross_coefficient != 0 ? other_rate : empty, noise));
  };
  tune_all();
  for (int i = 0; i < 8 && (first_bit(plan.all) || first_bit(plan.none)); ++i) {
    down *= 0.6;
    tune_all();
  }
  const Record r = run(plan.all);
  if (!r.stable) fail(domain + "/" + cell + " " + std::to_string(seed) + " is unstable");

  Case c;
  c.name = domain + "/" + cell + (cell == "single" || cell == "outside" ? "/" + names.front() : "");
  if (wrong_file) c.name += "/" + wrong;
  c.seed = seed;
  c.machine =
      machine_text(d, plan.all.plant, manner, plan.all, of_file, cell == "null-wrong" ? 0.4 : 0.1);
  if (wrong_file)
    c.machine += foreign_section(
        wrong, {turns, d.plant.coulomb, d.limits.speed, d.plant.turn, turns ? 5e-5 : 1e-6}, decoy);
  c.columns = columns_of(d, d.plant, manner, r, motion.reference, other, seed);

  Baseline base;
  base.rate_hz = d.plant.servo_hz;
  base.held_out = static_cast<std::size_t>(motion.held_out_from_s * base.rate_hz);
  base.small = turns ? 5e-5 : 1e-6;
  base.inertia = d.plant.inertia;
  base.viscous = !plan.all.without_viscous;
  base.coulomb = !plan.all.without_coulomb;
  Truth& t = c.truth;
  t.expect = names.empty()                         ? "none"
             : cell != "outside"                   ? "name"
             : names[0] == "time-locked-vibration" ? "line"
                                                   : "outside";
  t.noise_floor = noise_floor(r, base);
  t.held_out_from_s = motion.held_out_from_s;
  const Gaps with = refitted(r, base);
  t.gap_before = t.gap_oracle = with.held_out;
  t.effects = plan.all.effects;
  if (!names.empty()) {
    // The same machine without what is hidden. Friction that the file lacks is there nevertheless:
    // its twin is the machine whose file has it.
    Baseline whole = base;
    whole.viscous = whole.coulomb = true;
    const Gaps without = refitted(run(plan.none), whole);
    t.gap_oracle = without.held_out;
    for (std::size_t i = 0; i < names.size(); ++i) {
      const Gaps one = names.size() == 1 ? with : refitted(run(plan.alone[i]), base);
      const double adds = excess(one.learnt, without.learnt);
      t.effects[i].strength = adds / t.noise_floor;
      t.effects[i].visibility = adds / without.learnt;
      if (names[i] != "lead-error") continue;
      // Seen between scale and motor, against the steps of both.
      const double floor = std::hypot(d.plant.scale_step, d.plant.encoder_step) / std::sqrt(12.0);
      t.effects[i].strength = t.effects[i].visibility =
          std::abs(plan.all.hidden.lead_amplitude) / std::sqrt(2.0) / floor;
    }
  }
  const Plant& p = d.plant;
  t.circumstances = {{"law", static_cast<double>(p.law)},
                     {"presliding", p.presliding},
                     {"rigid", p.rigid ? 1.0 : 0.0},
                     {"mode_hz", p.mode_hz},
                     {"load_share", p.load_share},
                     {"load_friction", p.load_friction},
                     {"creep_speed", p.creep_speed},
                     {"current_loop_hz", p.current_loop_hz},
                     {"dead_time_s", p.dead_time_s},
                     {"reports", static_cast<double>(p.reports)},
                     {"coulomb", p.coulomb}};
  return c;
}

}  // namespace blind
