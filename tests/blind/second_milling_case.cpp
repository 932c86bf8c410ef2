// Blind cuts of the second generator: draws, truth.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>

#include "analysis.hpp"
#include "case.hpp"
#include "second_milling_machine.hpp"

namespace blind {
namespace {

using namespace second_milling;

constexpr double kPi = std::numbers::pi;

const std::vector<std::string> kEffects{
    "runout",       "missing-tooth", "edge-force",       "size-effect", "process-damping",
    "regeneration", "extra-mode",    "sensor-resonance", "helix-lag",   "pitch-error"};
const std::vector<std::string> kOutside{
    "growing-wear", "time-locked-vibration", "varying-depth", "varying-width", "hard-spots",
    "charge-drift", "speed-ripple",          "built-up-edge", "chip-recutting"};
/// What is wrong in the file of a cut that has nothing hidden.
const std::vector<std::string> kWrong{"modes", "depth", "immersion"};
const std::vector<std::string> kPoor{"edge-force", "size-effect"};

using Parameters = std::vector<std::pair<std::string, double>>;

Needs needs_of(const std::vector<std::string>& effects, bool poor) {
  Needs n;
  for (const std::string& e : effects) {
    n.structure = n.structure || e == "process-damping" || e == "regeneration";
    n.slow = n.slow || e == "process-damping";
    n.helix = n.helix || e == "helix-lag";
    n.several_feeds = n.several_feeds || e == "edge-force" || e == "size-effect";
  }
  if (poor) n.one_feed = true, n.several_feeds = false;
  return n;
}

/// Turns `set` up or down until what it adds is about `share` of the force, within [low, high].
double size_for(const Machine& plain, double share, double start, double low, double high,
                const std::function<void(Machine&, double)>& set) {
  const std::vector<double> before = steady(plain);
  double value = std::clamp(start, low, high);
  for (int pass = 0; pass < 3; ++pass) {
    Machine m = plain;
    set(m, value);
    std::vector<double> after = steady(m);
    for (std::size_t i = 0; i < after.size(); ++i) after[i] -= before[i];
    const double got = rms_of(after) / rms_of(before);
    if (!(got > 1e-9)) break;
    value = std::clamp(value * std::clamp(share / got, 0.05, 20.0), low, high);
  }
  return value;
}

/// The cut of a careful shop does not chatter: what vibrates is made heavier until turns repeat.
bool settle(Machine& m) {
  for (int pass = 0; pass < 14; ++pass) {
    bool periodic = true;
    const std::vector<double> force = steady(m, &periodic);
    if (periodic && std::isfinite(rms_of(force))) return true;
    for (Mode& mode : m.cutter.modes) mode.mass_kg *= 1.5;
  }
  return false;
}

/// Puts the effect into the machine. Magnitude: 1 to 40 % of the force, within what machines have.
Parameters hide(Machine& m, const std::string& name, Draw& draw) {
  const double share = draw.log_uniform(0.01, 0.4);
  Cutter& c = m.cutter;
  const std::size_t n = c.teeth.size();
  double least_feed = 1, largest_feed = 0;
  for (const Level& level : m.levels) {
    least_feed = std::min(least_feed, level.feed);
    largest_feed = std::max(largest_feed, level.feed);
  }
  if (name == "runout") {
    const double angle = draw.uniform(0, 2 * kPi);
    const double rho = size_for(m, share, 1e-5, 2e-6, 60e-6,
                                [&](Machine& o, double v) { eccentric(o.cutter, v, angle); });
    eccentric(c, rho, angle);
    return {{"offset_m", rho}};
  }
  if (name == "missing-tooth") {
    const std::size_t tooth = draw.below(n);
    const double kind = draw.unit();
    if (kind < 0.4) {
      c.teeth[tooth].gone = 1;
      return {{"fraction", 1}};
    }
    if (kind < 0.7) {
      const double shorter =
          size_for(m, share, 1e-5, 2e-6, 0.9 * largest_feed,
                   [&](Machine& o, double v) { o.cutter.teeth[tooth].reach -= v; });
      c.teeth[tooth].reach -= shorter;
      return {{"shorter_m", shorter}};
    }
    const double gone = size_for(m, share, 0.2, 0.02, 0.9,
                                 [&](Machine& o, double v) { o.cutter.teeth[tooth].gone = v; });
    c.teeth[tooth].gone = gone;
    return {{"fraction", gone}};
  }
  if (name == "edge-force") {
    c.kte = c.kre = 0;  // the file knows of none
    const double ratio = draw.uniform(0.5, 2.0);
    const auto set = [ratio](Machine& o, double v) {
      o.cutter.kte = v;
      o.cutter.kre = ratio * v;
    };
    set(m, size_for(m, share, 1e4, 300, 8e4, set));
    return {{"tangential_edge_N_per_m", c.kte}, {"radial_edge_N_per_m", c.kre}};
  }
  if (name == "size-effect") {
    c.exponent = draw.log_uniform(0.05, 0.5);
    c.thickness = 0.5 * largest_feed;
    return {{"exponent", c.exponent}};
  }
  if (name == "process-damping") {
    c.ploughing =
        size_for(m, share, 5e5, 3e4, 3e6, [](Machine& o, double v) { o.cutter.ploughing = v; });
    return {{"coefficient_N_per_m", c.ploughing}};
  }
  if (name == "regeneration") {
    // As stiff as gives the share of memory.
    for (int pass = 0; pass < 3; ++pass) {
      Machine without = m;
      without.cutter.regeneration = false;
      const std::vector<double> before = steady(without);
      std::vector<double> after = steady(m);
      for (std::size_t i = 0; i < after.size(); ++i) after[i] -= before[i];
      const double stiffer = std::clamp(rms_of(after) / rms_of(before) / share, 0.1, 10.0);
      if (!std::isfinite(stiffer)) break;
      for (Mode& mode : c.modes) mode.mass_kg *= stiffer;
    }
    return {};
  }
  if (name == "extra-mode") {
    Mode mode;
    mode.axis = draw.chance(0.5) ? 'x' : 'y';
    mode.hz = draw.log_uniform(150, 1500);
    mode.damping = draw.log_uniform(0.01, 0.06);
    const auto mass = [&](double stiffness) { return stiffness / std::pow(2 * kPi * mode.hz, 2); };
    const double compliance = size_for(m, share, 1, 0.1, 40, [&](Machine& o, double v) {
      Mode added = mode;
      added.mass_kg = mass(1e8 / v);
      o.cutter.modes.push_back(added);
    });
    mode.mass_kg = mass(1e8 / compliance);
    c.modes.push_back(mode);
    return {{"natural_frequency_hz", mode.hz}, {"damping_ratio", mode.damping}};
  }
  if (name == "sensor-resonance") {
    m.sensor.hz_x = draw.log_uniform(350, 3000);
    m.sensor.hz_y = m.sensor.hz_x * draw.uniform(0.85, 1.15);
    m.sensor.damping = draw.log_uniform(0.01, 0.06);
    return {{"natural_frequency_hz", m.sensor.hz_x}, {"natural_frequency_y_hz", m.sensor.hz_y}};
  }
  if (name == "helix-lag") return {{"helix_deg", 180 / kPi * c.helix_rad}};
  if (name == "pitch-error") {
    if (draw.chance(0.3)) {
      // A tool against chatter, taken for an even one.
      const double by = kPi / 180 * draw.uniform(1, 6);
      for (std::size_t j = 0; j < n; ++j) c.teeth[j].angle = j % 2 == 0 ? by / 2 : -by / 2;
    } else {
      std::vector<double> shape(n);
      for (double& s : shape) s = draw.normal();
      const double by = size_for(m, share, 0.01, 0.002, 0.06, [&](Machine& o, double v) {
        for (std::size_t j = 0; j < n; ++j) o.cutter.teeth[j].angle = v * shape[j];
      });
      for (std::size_t j = 0; j < n; ++j) c.teeth[j].angle = by * shape[j];
    }
    return {{"first_angle", c.teeth[0].angle - c.teeth[n - 1].angle}};
  }
  std::fprintf(stderr, "blind: no second milling effect '%s'\n", name.c_str());
  std::exit(2);
}

/// The same machine without the effect, which is what its file describes.
void take_out(Machine& m, const std::string& name, double file_helix) {
  Cutter& c = m.cutter;
  if (name == "runout" || name == "missing-tooth" || name == "pitch-error")
    for (std::size_t j = 0; j < c.teeth.size(); ++j) {
      if (name == "pitch-error")
        c.teeth[j].angle = 0;
      else if (name == "runout")
        c.teeth[j].reach = 0;
      else
        c.teeth[j].gone = c.teeth[j].reach = 0;
    }
  if (name == "edge-force") c.kte = c.kre = 0;
  if (name == "size-effect") c.exponent = 0;
  if (name == "process-damping") c.ploughing = 0;
  if (name == "regeneration") c.regeneration = false;
  if (name == "extra-mode") c.modes.pop_back();
  if (name == "sensor-resonance") m.sensor = {};
  if (name == "helix-lag") c.helix_rad = file_helix;
}

/// What a tool is taken for: plainly another one.
double other_helix(double helix_rad, Draw& draw) {
  constexpr double kHelices_deg[]{0, 0, 15, 30, 38, 45};
  for (;;) {
    const double taken = kPi / 180 * draw.one_of(kHelices_deg);
    if (std::abs(taken - helix_rad) > 0.1) return taken;
  }
}

/// Imperfections of every shop. One that is stronger than the noise is a truth of its own, which
/// the report may name and need not.
struct Background {
  double runout_m = 0, runout_angle = 0;
  Sensor sensor;
};

Background draw_background(const Machine& pure, const std::vector<std::string>& effects,
                           Draw& draw) {
  const auto hidden = [&](const char* name) {
    return std::ranges::find(effects, name) != effects.end();
  };
  Background b;
  const bool runout = draw.chance(0.5), sensor = draw.chance(0.5);
  const double offset = draw.uniform(1e-6, 3e-6), angle = draw.uniform(0, 2 * kPi);
  const double hz = draw.uniform(1500, 3000), size = draw.log_uniform(0.003, 0.03);
  if (runout && !hidden("runout") && !hidden("missing-tooth"))
    b.runout_m = offset, b.runout_angle = angle;
  if (sensor && !hidden("sensor-resonance"))
    b.sensor = {hz, hz * draw.uniform(0.9, 1.1), draw.uniform(0.02, 0.05)};
  if (b.sensor.hz_x > 0) {
    // A shop takes out the ringing of its sensor; this much of the force is left of it.
    Machine rings = pure;
    rings.sensor = b.sensor;
    const std::vector<double> clean = steady(pure);
    std::vector<double> seen = steady(rings);
    for (std::size_t i = 0; i < seen.size(); ++i) seen[i] -= clean[i];
    b.sensor.share = std::min(1.0, size * rms_of(clean) / rms_of(seen));
  }
  return b;
}

void add(Machine& m, const Background& b) {
  if (b.runout_m > 0) eccentric(m.cutter, b.runout_m, b.runout_angle);
  if (b.sensor.hz_x > 0) m.sensor = b.sensor;
}

/// One of the disturbances that no effect of the catalogue describes.
Disturbance disturb(Machine& m, const std::string& kind, double force, Draw& draw, Parameters& p) {
  const double share = draw.log_uniform(0.02, 0.4);
  const double total = m.cutting_s() + m.recorder.air_before_s + m.recorder.air_after_s;
  const double phase = draw.uniform(0, 2 * kPi);
  p = {{"share", share}};
  Disturbance d;
  if (kind == "growing-wear") {
    if (m.cutter.kte == 0) m.cutter.kte = 6e3, m.cutter.kre = 8e3;  // known to the file
    const double t = share * draw.uniform(2, 5) * m.cutter.kte, r = t * draw.uniform(1.2, 2.5);
    const double power = draw.uniform(0.6, 1.5);
    d.moment = [=](double at, Moment& now) {
      const double grown = std::pow(at / total, power);
      now.wear_t = t * grown, now.wear_r = r * grown;
    };
  } else if (kind == "time-locked-vibration") {
    double hz = draw.log_uniform(20, 400);
    // Not a harmonic of the spindle.
    const double order = hz * m.turn_s();
    if (std::abs(order - std::round(order)) < 0.15) hz *= (order + 0.3) / order;
    const double a = share * force, b = a * draw.uniform(0.2, 1);
    p = {{"frequency_hz", hz}, {"amplitude_N", a}};
    d.force = [=](double at, double* f) {
      f[0] += a * std::sin(2 * kPi * hz * at);
      f[1] += b * std::sin(2 * kPi * hz * at + phase);
    };
  } else if (kind == "varying-depth" || kind == "varying-width") {
    const double hz = draw.uniform(0.3, 1.5), slope = share * draw.uniform(-1, 1);
    const bool depth = kind == "varying-depth";
    d.moment = [=](double at, Moment& now) {
      const double times =
          1 + share * std::sin(2 * kPi * hz * at + phase) + slope * (at / total - 0.5);
      (depth ? now.depth : now.immersion) = times;
    };
  } else if (kind == "hard-spots") {
    const double every = draw.uniform(0.2, 0.9), wide = draw.uniform(0.05, 0.3) * every;
    const double harder = 2 * share;
    d.moment = [=](double at, Moment& now) {
      const double in = std::fmod(at + phase, every);
      if (in < wide) now.hardness = 1 + harder * std::sin(kPi * in / wide);
    };
  } else if (kind == "charge-drift") {
    const double to = share * 2 * force * draw.sign(), tau = total * draw.uniform(0.2, 0.8);
    const double other = draw.uniform(-1, 1);
    d.force = [=](double at, double* f) {
      f[0] += to * (1 - std::exp(-at / tau));
      f[1] += other * to * (1 - std::exp(-at / tau));
    };
  } else if (kind == "speed-ripple") {
    const double a = 0.2 * share * m.speed, w = 2 * kPi * draw.uniform(0.5, 5);
    const double speed = m.speed;
    d.moment = [=](double at, Moment& now) {
      const double feed = now.feed * now.speed;  // of the table, which does not know
      now.speed = speed + a * std::cos(w * at);
      now.angle = speed * at + a / w * std::sin(w * at);
      now.feed = feed / now.speed;
    };
  } else if (kind == "built-up-edge") {
    // Grows on a tooth and breaks off, again and again.
    const double turn = m.turn_s(), life = draw.uniform(5, 30) * turn;
    const std::size_t n = m.cutter.teeth.size();
    const std::uint64_t seed = draw.next();
    d.moment = [=](double at, Moment& now) {
      for (std::size_t j = 0; j < n; ++j) {
        const double ages = at / life + 0.37 * static_cast<double>(j);
        Draw of(seed + 977 * j + static_cast<std::uint64_t>(ages));
        now.tooth[j] = 1 - 2 * share * of.unit() * (ages - std::floor(ages));
      }
    };
  } else if (kind == "chip-recutting") {
    const double turn = m.turn_s();
    const std::uint64_t seed = draw.next();
    const std::size_t n = m.cutter.teeth.size();
    const double often = draw.uniform(0.1, 0.4);
    d.moment = [=](double at, Moment& now) {
      Draw of(seed + static_cast<std::uint64_t>(at / turn));
      if (of.chance(often)) now.tooth[of.below(n)] = 1 + 3 * share * of.unit();
    };
  }
  return d;
}

void spoil(Cutter& file, const std::string& kind, Draw& draw) {
  const double factor = draw.chance(0.5) ? 1.3 : 1 / 1.3;
  if (kind == "modes") {
    // Of another machine; this one is stiff.
    file.modes = {draw_mode(draw, draw.chance(0.5) ? 'x' : 'y')};
    file.modes[0].mass_kg *= draw.log_uniform(0.1, 1);
    file.regeneration = draw.chance(0.5);
  }
  if (kind == "depth") file.depth *= factor;
  if (kind == "immersion") file.immersion = std::min(file.immersion * factor, 1.9 * file.radius);
}

void vary(Case& c, Machine& m, const std::string& variant) {
  if (variant == "decimated") {
    for (Column& column : c.columns) {
      std::vector<double> kept;
      double held = kAbsent;
      for (std::size_t i = 0; i < column.values.size(); ++i) {
        if (column.values[i] != kAbsent) held = column.values[i];
        if (i % 2 == 0) kept.push_back(held);
      }
      column.values = std::move(kept);
    }
    m.recorder.rate_hz /= 2;
  }
  if (variant != "units" && variant != "offset") return;
  for (Column& column : c.columns)
    if (column.name.starts_with("dyno."))
      for (double& v : column.values) v = variant == "units" ? 3 * v : v + 50;
  if (variant == "units")
    for (double Cutter::*k : {&Cutter::ktc, &Cutter::krc, &Cutter::kte, &Cutter::kre})
      m.file.*k *= 3;
}

}  // namespace

std::vector<std::string> second_milling_cells() {
  std::vector<std::string> all;
  for (const std::string& e : kEffects) all.push_back("second-milling/single/" + e);
  all.insert(all.end(), {"second-milling/null", "second-milling/null-wrong"});
  for (const std::string& e : kOutside) all.push_back("second-milling/outside/" + e);
  for (const std::string& what : kWrong) all.push_back("second-milling/file/" + what);
  all.push_back("second-milling/pair");
  for (const std::string& e : kPoor) all.push_back("second-milling/poor/" + e);
  return all;
}

Case draw_second_milling_case(const std::string& cell, const std::string& effect,
                              std::uint64_t seed, const std::string& variant) {
  Draw draw(seed, "second-milling/" + cell + "/" + effect);
  const bool outside = cell == "outside", wrong_file = cell == "file",
             null = cell.starts_with("null") || wrong_file;
  std::vector<std::string> effects;
  std::string kind = effect;
  if (outside && kind.empty()) kind = kOutside[draw.below(kOutside.size())];
  if (wrong_file && kind.empty()) kind = kWrong[draw.below(kWrong.size())];
  if (cell == "single") effects = {effect.empty() ? kEffects[draw.below(kEffects.size())] : effect};
  if (cell == "poor") effects = {effect.empty() ? kPoor[draw.below(kPoor.size())] : effect};
  if (cell == "pair") {
    effects = {kEffects[draw.below(kEffects.size())]};
    do {
      effects.resize(1);
      effects.push_back(kEffects[draw.below(kEffects.size())]);
      // What makes the chip remember a mode, beside a mode that it lacks, is one thing; and a tooth
      // has one reach.
    } while (
        effects[0] == effects[1] ||
        needs_of(effects, false).structure + (std::ranges::count(effects, "extra-mode")) > 1 ||
        (std::ranges::count(effects, "runout") + std::ranges::count(effects, "missing-tooth")) > 1);
    std::ranges::sort(effects);
  }

  Case c;
  Machine m, pure;
  std::vector<Parameters> parameters;
  double file_helix = 0;
  Disturbance disturbance;
  Parameters of_kind;
  for (int attempt = 0;; ++attempt) {
    Draw again(draw.next());
    m = draw_machine(again, needs_of(effects, cell == "poor"));
    if (cell == "null-wrong") m.everything_wrong = true;
    if (wrong_file) m.everything_wrong = false;
    if (wrong_file && kind == "modes") m.cutter.modes.clear();
    if (wrong_file && kind == "immersion")
      while (m.cutter.direction == Direction::slot)
        m.cutter.direction = again.chance(0.5) ? Direction::up : Direction::down,
        m.cutter.immersion = 2 * m.cutter.radius * again.log_uniform(0.1, 0.7);
    // The word that a cut does not remember is no sign of regeneration.
    const bool may_forget = std::ranges::none_of(
        effects, [](const std::string& e) { return e == "regeneration" || e == "extra-mode"; });
    if (may_forget && again.chance(m.cutter.modes.empty() ? 0.15 : 0.4))
      m.cutter.regeneration = false;
    file_helix = other_helix(m.cutter.helix_rad, again);
    bool works = settle(m);
    parameters.clear();
    for (const std::string& e : effects) {
      parameters.push_back(hide(m, e, again));
    }
    works = works && settle(m);
    pure = m;
    for (const std::string& e : effects) take_out(pure, e, file_helix);
    works = works && std::isfinite(rms_of(steady(pure)));
    if (works || attempt > 6) break;
  }

  const std::vector<double> clean = steady(pure);
  const double force = rms_of(clean);
  Recorder& r = m.recorder;
  r.noise_N = force * draw.log_uniform(0.005, 0.05);
  for (double& offset : r.offset_N) offset = force * draw.uniform(-0.1, 0.1);
  for (double& drift : r.drift_N) drift = draw.chance(0.5) ? force * draw.uniform(-0.03, 0.03) : 0;
  if (outside) disturbance = disturb(m, kind, force, draw, of_kind);
  if (outside) pure = m;

  Truth& truth = c.truth;
  double seconds = 0;
  for (const Level& level : m.levels)
    seconds += level.seconds / static_cast<double>(m.levels.size());
  truth.noise_floor = r.noise_N / std::sqrt(std::max(1.0, seconds / m.turn_s()));

  // The shop's imperfections, each against the model alone.
  const Background background = draw_background(pure, effects, draw);
  Machine imperfect = pure;
  add(imperfect, background);
  add(m, background);
  const double imperfection = left_over(steady(imperfect), pure);
  const auto note = [&](const char* name, Background only, Parameters p) {
    Machine one = pure;
    add(one, only);
    truth.background.push_back(
        {name, std::move(p), left_over(steady(one), pure) / truth.noise_floor, 0});
  };
  if (background.runout_m > 0)
    note("runout", {background.runout_m, background.runout_angle, {}},
         {{"offset_m", background.runout_m}});
  if (background.sensor.hz_x > 0)
    note("sensor-resonance", {0, 0, background.sensor},
         {{"natural_frequency_hz", background.sensor.hz_x}});

  for (std::size_t i = 0; i < effects.size(); ++i) {
    // Each alone: the others are taken out.
    Machine alone = m;
    alone.sensor = effects[i] == "sensor-resonance" ? m.sensor : Sensor{};
    if (background.runout_m > 0)
      eccentric(alone.cutter, -background.runout_m, background.runout_angle);
    for (const std::string& other : effects)
      if (other != effects[i]) take_out(alone, other, file_helix);
    Machine without = alone;
    take_out(without, effects[i], file_helix);
    double adds = left_over(steady(alone), without);
    if (effects[i] == "regeneration") {
      // Nobody has to believe in the modes of the file: beside a stiff tool it has to show, too.
      without.cutter.modes.clear();
      adds = std::min(adds, left_over(steady(alone), without));
    }
    truth.effects.push_back({effects[i], parameters[i], adds / truth.noise_floor,
                             adds / std::hypot(truth.noise_floor, imperfection)});
  }
  if (outside) truth.effects.push_back({kind, of_kind, 0, 0});
  truth.expect = null             ? "none"
                 : outside        ? (kind == "time-locked-vibration" ? "line" : "outside")
                 : cell == "poor" ? "class"
                                  : "name";
  // In N, over samples, as the report gives it.
  truth.gap_before = std::hypot(left_over(steady(m), pure), r.noise_N);
  truth.gap_oracle = std::hypot(imperfection, r.noise_N);
  truth.held_out_from_s = 2.0 / 3 * (m.cutting_s() + r.air_before_s + r.air_after_s);

  c.name = "second-milling/" + cell;
  if (cell == "single" || cell == "poor") c.name += "/" + effects[0];
  if (outside || wrong_file) c.name += "/" + kind;
  c.seed = seed;
  truth.note = m.maker + (m.everything_wrong ? ", geometry off" : "");
  c.variant = variant;
  c.columns = record(m, disturbance, draw);
  Machine known = pure;
  known.recorder = r;
  write_down(known, draw);
  if (wrong_file) spoil(known.file, kind, draw);
  vary(c, known, variant);
  c.machine = file_text(known);
  return c;
}

}  // namespace blind
