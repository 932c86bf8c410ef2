// Blind cases of cutting forces: a cutter on exact trochoids, slice by slice, with vibration that
// earlier teeth leave behind in the surface. Chip by intersection of the tooth's ray with the paths
// of all earlier teeth, each solved for its own instant.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <sstream>

#include "analysis.hpp"
#include "case.hpp"
#include "draw.hpp"

namespace blind {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kSizeReference_m = 1e-4;
constexpr int kSlices = 24;  // a chipped tooth lacks whole slices

const std::vector<std::string> kEffects{
    "runout",      "missing-tooth",    "edge-force", "size-effect",  "helix-lag",
    "pitch-error", "sensor-resonance", "extra-mode", "regeneration", "process-damping"};
const std::vector<std::string> kOutside{"wear-growth", "time-locked-vibration", "drifting-width",
                                        "hard-spots", "charge-drift"};

struct Mode {
  double hz = 0, damping = 0.03, mass_kg = 1;
};

/// What is wrong in the file of a cut that has nothing hidden.
const std::vector<std::string> kWrong{
    "modes", "modes-without-memory", "other-mode", "edge-force", "immersion", "depth", "diameter"};

/// The cut as it is.
struct Cut {
  double diameter_m = 0.012;
  int teeth = 4;
  double helix_rad = 0.5;
  double tangential = 1e9, ratio = 0.3;
  double edge_tangential = 0, edge_radial = 0;
  double size_exponent = 0;
  double rpm = 5000;
  double depth_m = 0.002;
  double immersion_m = 0.006;
  int direction = 0;            ///< 0 up, 1 down, 2 slot
  std::vector<double> feeds_m;  ///< per tooth, one a pass
  double seconds_a_pass = 0.3;
  std::vector<double> throw_m, gone, pitch_rad;  ///< of each tooth; gone: share of the depth
  std::vector<Mode> modes_x, modes_y;
  bool remembers = true;       ///< the surface keeps the vibration of the teeth before
  double damping_N_per_m = 0;  ///< radial force per width, per ratio of normal to cutting speed
  double rate_hz = 10000;
  double sensor_hz = 0, sensor_damping = 0.02;
  // Not in the catalogue.
  double wear_N_per_m_s = 0;
  double width_drift = 0;  ///< share of the immersion over the record
  double spots = 0;        ///< share of the coefficient
  double line_N = 0, line_hz = 50;
  double drift_N = 0;
};

struct Forces {
  std::vector<double> time_s, angle_rad, feed_m, x_N, y_N;
  std::vector<double> unit_x[2], unit_y[2];  ///< of the tangential and radial coefficient alone
  std::size_t held_out = 0;                  ///< first row of the last pass
};

class Oscillator {
 public:
  Oscillator(const Mode& mode, double step) {
    const double w = 2 * kPi * mode.hz;
    const double wd = w * std::sqrt(1 - mode.damping * mode.damping);
    const double decay = mode.damping * w;
    const double e = std::exp(-decay * step);
    const double c = std::cos(wd * step), s = std::sin(wd * step);
    phi_ = {e * (c + decay / wd * s), e * s / wd, -e * w * w / wd * s, e * (c - decay / wd * s)};
    compliance_ = 1 / (mode.mass_kg * w * w);
  }
  void advance(double force) {
    const double rest = force * compliance_;
    const double d = x - rest;
    x = rest + phi_[0] * d + phi_[1] * v;
    v = phi_[2] * d + phi_[3] * v;
  }
  double x = 0, v = 0;

 private:
  std::array<double, 4> phi_{};
  double compliance_ = 0;
};

Forces cut(const Cut& c, std::uint64_t seed) {
  constexpr int kRevolutionsBack = 1;
  const double omega = 2 * kPi * c.rpm / 60;
  const double radius = c.diameter_m / 2;
  const double period = 2 * kPi / omega;
  // At least 800 steps a turn, in whole steps a sample.
  const int steps = std::max(2, static_cast<int>(std::ceil(800 / (period * c.rate_hz))));
  const double h = 1 / (c.rate_hz * steps);
  const auto teeth = static_cast<std::size_t>(c.teeth);
  const auto per_tooth = [&](const std::vector<double>& list, std::size_t j) {
    return list.empty() ? 0.0 : list[j];
  };
  std::vector<Oscillator> x_modes, y_modes;
  for (const Mode& m : c.modes_x) x_modes.emplace_back(m, h);
  for (const Mode& m : c.modes_y) y_modes.emplace_back(m, h);
  const bool moves = !x_modes.empty() || !y_modes.empty();
  // What the tool did, for the teeth that come later: a ring over the time looked back.
  const auto ring = static_cast<std::size_t>(period / h * (kRevolutionsBack + 0.6)) + 4;
  std::vector<std::array<double, 2>> past(moves ? ring : 0);
  Oscillator sensor_x({c.sensor_hz > 0 ? c.sensor_hz : 1.0, c.sensor_damping, 1}, h);
  Oscillator sensor_y({c.sensor_hz > 0 ? 1.07 * c.sensor_hz : 1.0, c.sensor_damping, 1}, h);
  const double sensor_k = std::pow(2 * kPi * c.sensor_hz, 2);
  const double sensor_ky = std::pow(2 * kPi * 1.07 * c.sensor_hz, 2);

  const double widest = c.throw_m.empty() ? 0.0 : *std::ranges::max_element(c.throw_m);
  Draw spots(seed, "spots");
  double spot_until = 0, spot = 0;
  Forces out;
  const double total = c.seconds_a_pass * static_cast<double>(c.feeds_m.size());
  std::size_t step = 0;
  for (std::size_t pass = 0; pass < c.feeds_m.size(); ++pass) {
    const double feed = c.feeds_m[pass];
    const double speed = feed * c.teeth * omega / (2 * kPi);
    if (pass + 1 == c.feeds_m.size()) out.held_out = out.time_s.size();
    const auto samples = static_cast<std::size_t>(std::lround(c.seconds_a_pass * c.rate_hz));
    double sum_x = 0, sum_y = 0;
    std::array<double, 4> unit{};
    for (std::size_t i = 0; i < samples * static_cast<std::size_t>(steps); ++i, ++step) {
      const double t = static_cast<double>(step) * h;
      double ux = 0, uy = 0, vx = 0, vy = 0;
      for (const Oscillator& m : x_modes) ux += m.x, vx += m.v;
      for (const Oscillator& m : y_modes) uy += m.x, vy += m.v;
      if (moves) past[step % ring] = {ux, uy};
      // A slot can only grow deeper.
      const double growth = 1 + c.width_drift * (t / total - 0.5);
      const double immersion = c.immersion_m * growth;
      const double dz = (c.direction == 2 ? growth : 1.0) * c.depth_m / kSlices;
      const double arc =
          c.direction == 2 ? kPi : std::acos(std::clamp(1 - immersion / radius, -1.0, 1.0));
      const double from = c.direction == 1 ? kPi - arc : 0.0;
      const double to = c.direction == 0 ? arc : kPi;
      if (c.spots > 0 && t > spot_until) {
        spot = c.spots * spots.uniform(-1, 1);
        spot_until = t + spots.uniform(0.02, 0.15);
      }
      double fx = 0, fy = 0;
      for (std::size_t j = 0; j < teeth; ++j)
        for (int s = 0; s < kSlices; ++s) {
          const double z = (s + 0.5) * dz;
          if (z < per_tooth(c.gone, j) * c.depth_m) continue;
          const auto own = [&](std::size_t tooth) {
            return 2 * kPi * static_cast<double>(tooth) / c.teeth + per_tooth(c.pitch_rad, tooth) -
                   z * std::tan(c.helix_rad) / radius;
          };
          const double angle = std::remainder(omega * t + own(j), 2 * kPi);
          const double sine = std::sin(angle);
          const double cosine = std::cos(angle);
          if (angle < 0 ? !(angle + 2 * kPi < to && angle + 2 * kPi > from)
                        : !(angle > from && angle < to))
            continue;
          const double reach = radius + per_tooth(c.throw_m, j) + ux * sine + uy * cosine;
          // How far the surface stands in this direction from the tool's undisturbed centre.
          double surface = -1;
          for (int back = 1; back <= c.teeth * kRevolutionsBack; ++back) {
            const std::size_t k =
                (j + static_cast<std::size_t>(back)) % teeth;  // the teeth ahead came earlier
            if (z < per_tooth(c.gone, k) * c.depth_m) continue;
            const double r = radius + per_tooth(c.throw_m, k);
            double lead = std::remainder(own(k) - own(j), 2 * kPi);
            if (lead <= 1e-9) lead += 2 * kPi;
            // A surface so far behind that it cannot count (a stiff tool only).
            if (!moves && surface > radius + widest - 0.98 * speed * lead / omega * sine) continue;
            // First guess: when that tooth had this angle; then one step of Newton for the ray.
            double ago = lead / omega;
            double wx = 0, wy = 0;
            for (int newton = 0; newton < 2; ++newton) {
              const double then = omega * (t - ago) + own(k);
              wx = -speed * ago + r * std::sin(then);
              wy = r * std::cos(then);
              const double off = wx * cosine - wy * sine;
              const double rate = -speed * cosine - r * omega;  // of `off` by `ago`, near the ray
              if (newton == 0) ago -= off / rate;
            }
            double w = wx * sine + wy * cosine;
            if (moves && c.remembers && t > ago) {
              const double at = static_cast<double>(step) - ago / h;
              const auto low = static_cast<std::size_t>(at);
              const double part = at - static_cast<double>(low);
              const auto& p = past[low % ring];
              const auto& q = past[(low + 1) % ring];
              w += (p[0] + part * (q[0] - p[0])) * sine + (p[1] + part * (q[1] - p[1])) * cosine;
            }
            surface = std::max(surface, w);
          }
          const double chip = surface < 0 ? feed * std::max(0.0, sine) : reach - surface;
          if (!(chip > 0)) continue;
          double area = chip * dz;
          unit[0] += area * cosine, unit[1] += area * sine;
          unit[2] -= area * sine, unit[3] += area * cosine;
          if (c.size_exponent != 0) area *= std::pow(chip / kSizeReference_m, -c.size_exponent);
          const double kt = c.tangential * (1 + spot);
          const double tangential = kt * area + (c.edge_tangential + c.wear_N_per_m_s * t) * dz;
          double radial = kt * c.ratio * area + (c.edge_radial + 1.7 * c.wear_N_per_m_s * t) * dz;
          if (c.damping_N_per_m != 0)
            radial += c.damping_N_per_m * dz * (vx * sine + vy * cosine) / (omega * radius);
          fx += tangential * cosine + radial * sine;
          fy += -tangential * sine + radial * cosine;
        }
      // On the work; the tool feels the opposite.
      for (Oscillator& m : x_modes) m.advance(-fx);
      for (Oscillator& m : y_modes) m.advance(-fy);
      double seen_x = fx, seen_y = fy;
      if (c.sensor_hz > 0) {
        sensor_x.advance(fx);
        sensor_y.advance(fy);
        seen_x = sensor_k * sensor_x.x;
        seen_y = sensor_ky * sensor_y.x;
      }
      sum_x += seen_x, sum_y += seen_y;
      if ((i + 1) % static_cast<std::size_t>(steps) != 0) continue;
      const double line = c.line_N * std::sin(2 * kPi * c.line_hz * t);
      const double drift = c.drift_N * (1 - std::exp(-4 * t / total));
      out.time_s.push_back(t);
      out.angle_rad.push_back(omega * (t - 0.5 * (steps - 1) * h));
      out.feed_m.push_back(feed);
      out.x_N.push_back(sum_x / steps + line + drift);
      out.y_N.push_back(sum_y / steps + 0.6 * line - 0.5 * drift);
      for (std::size_t k = 0; k < 2; ++k) {
        out.unit_x[k].push_back(unit[k] / steps);
        out.unit_y[k].push_back(unit[2 + k] / steps);
      }
      sum_x = sum_y = 0;
      unit = {};
    }
  }
  return out;
}

Signal stacked(const Signal& x, const Signal& y) {
  Signal both = x;
  both.insert(both.end(), y.begin(), y.end());
  return both;
}

/// What is left of the forces when coefficients and the angular zero are refitted to those of the
/// plain cut.
double left_over(const Forces& f, const Forces& plain, double rate_hz) {
  std::vector<Signal> columns;
  for (std::size_t k = 0; k < 2; ++k) {
    columns.push_back(stacked(plain.unit_x[k], plain.unit_y[k]));
    columns.push_back(
        stacked(derivative(plain.unit_x[k], rate_hz), derivative(plain.unit_y[k], rate_hz)));
  }
  const Signal target = stacked(f.x_N, f.y_N);
  return rms(least_squares(columns, target, 0, target.size()).residual, 0, target.size());
}

void put(std::ostringstream& out, const char* key, double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.9g", value);
  out << key << " = " << text << '\n';
}

/// Soft enough to be felt, about the stability limit of a slot, b < 2 k zeta / K, or past it.
Mode add_mode(Cut& c, Draw& draw) {
  Mode mode;
  mode.hz = draw.log_uniform(250, 1200);
  mode.damping = draw.uniform(0.02, 0.06);
  const double stiffness = c.tangential * c.depth_m / (2 * mode.damping) / draw.uniform(0.8, 4);
  mode.mass_kg = stiffness / std::pow(2 * kPi * mode.hz, 2);
  (draw.chance(0.5) ? c.modes_x : c.modes_y).push_back(mode);
  return mode;
}

void stiffen(Cut& c) {
  for (std::vector<Mode>* modes : {&c.modes_x, &c.modes_y})
    for (Mode& m : *modes) m.mass_kg *= 2;
}

/// What a tap test finds of the modes: the frequency best.
void put_modes(std::ostringstream& out, const Cut& c, double strength, Draw& draw) {
  for (const bool in_x : {true, false})
    for (const Mode& m : in_x ? c.modes_x : c.modes_y) {
      char text[160];
      std::snprintf(text, sizeof text, "\n[structure.%c]\nmodes = %.9g %.9g %.9g\n",
                    in_x ? 'x' : 'y', m.hz * draw.uniform(0.995, 1.005),
                    m.damping * draw.uniform(0.9, 1.1),
                    m.mass_kg * strength * draw.uniform(0.97, 1.03));
      out << text;
    }
}

HiddenEffect hide(const std::string& name, double share, Cut& c, Draw& draw) {
  HiddenEffect e;
  e.name = name;
  const double feed = c.feeds_m.front();
  const auto teeth = static_cast<std::size_t>(c.teeth);
  if (name == "runout") {
    const double offset = share * feed;
    const double angle = draw.uniform(-kPi, kPi);
    e.parameters.emplace_back("throw_m", offset);
    for (std::size_t j = 0; j < teeth; ++j)
      c.throw_m.push_back(offset * std::cos(2 * kPi * static_cast<double>(j) / c.teeth - angle));
  } else if (name == "missing-tooth") {
    c.gone.assign(teeth, 0.0);
    const std::size_t tooth = draw.below(teeth);
    c.gone[tooth] =
        draw.chance(0.5) ? 1.0 : std::round(draw.uniform(0.15, 0.9) * kSlices) / kSlices;
    e.parameters.emplace_back("fraction", c.gone[tooth]);
  } else if (name == "edge-force") {
    c.edge_tangential = share * c.tangential * 0.5 * feed;
    c.edge_radial = c.edge_tangential * draw.uniform(0.5, 1.5);
    e.parameters = {{"tangential_edge_N_per_m", c.edge_tangential},
                    {"radial_edge_N_per_m", c.edge_radial}};
  } else if (name == "size-effect") {
    c.size_exponent = std::clamp(share, 0.03, 0.5);
    e.parameters = {{"exponent", c.size_exponent}};
  } else if (name == "helix-lag") {
    const double step = draw.sign() * draw.log_uniform(3, 18) * kPi / 180;
    c.helix_rad += c.helix_rad + step < 0 ? -step : step;
    e.parameters = {{"helix_deg", c.helix_rad * 180 / kPi}};
  } else if (name == "pitch-error") {
    for (std::size_t j = 0; j < teeth; ++j)
      c.pitch_rad.push_back(j == 0 ? 0.0 : draw.uniform(-1, 1) * 0.3 * share);
  } else if (name == "sensor-resonance") {
    c.sensor_hz = draw.log_uniform(400, 2500);
    c.sensor_damping = draw.log_uniform(0.008, 0.05);
    e.parameters = {{"natural_frequency_hz", c.sensor_hz}};
  } else if (name == "extra-mode" || name == "regeneration" || name == "process-damping") {
    const Mode mode = add_mode(c, draw);
    if (name == "process-damping") {
      c.damping_N_per_m = c.tangential * draw.log_uniform(2e-4, 3e-3) * 0.5;
      e.parameters = {{"coefficient", c.damping_N_per_m}};
    }
    if (name == "extra-mode")
      e.parameters = {{"natural_frequency_hz", mode.hz}, {"modal_mass_kg", mode.mass_kg}};
  } else if (name == "wear-growth") {
    c.wear_N_per_m_s = 2 * share * c.tangential * 0.5 * feed /
                       (c.seconds_a_pass * static_cast<double>(c.feeds_m.size()));
  } else if (name == "drifting-width") {
    c.width_drift = draw.sign() * std::min(share, 0.5);
  } else if (name == "hard-spots") {
    c.spots = share;
  } else if (name == "time-locked-vibration") {
    c.line_N = share * c.tangential * c.depth_m * feed;
    c.line_hz = draw.uniform(20, 180);
    e.parameters = {{"frequency_hz", c.line_hz}};
  } else if (name == "charge-drift") {
    c.drift_N = draw.sign() * share * c.tangential * c.depth_m * feed;
  } else {
    std::fprintf(stderr, "blind: there is no effect '%s' of cutting\n", name.c_str());
    std::exit(2);
  }
  return e;
}

}  // namespace

std::vector<std::string> milling_cells() {
  std::vector<std::string> all;
  for (const std::string& e : kEffects) all.push_back("milling/single/" + e);
  for (const char* cell : {"null", "null-wrong", "null-noisy"})
    all.push_back(std::string("milling/") + cell);
  for (const std::string& e : kOutside) all.push_back("milling/outside/" + e);
  for (const std::string& what : kWrong) all.push_back("milling/file/" + what);
  all.emplace_back("milling/pair");
  return all;
}

Case draw_milling_case(const std::string& cell, const std::string& effect, std::uint64_t seed,
                       const std::string& variant) {
  Draw draw(seed, "milling/machine");
  Cut c;
  c.diameter_m = draw.one_of({0.008, 0.01, 0.012, 0.016, 0.02});
  c.teeth = draw.one_of({2, 3, 4, 4, 5});
  c.helix_rad = (draw.chance(0.2) ? 0.0 : draw.uniform(20, 45)) * kPi / 180;
  c.tangential = draw.log_uniform(6e8, 2.2e9);
  c.ratio = draw.uniform(0.2, 0.45);
  c.rpm = draw.uniform(1500, 7000);
  c.depth_m = draw.uniform(0.1, 0.35) * c.diameter_m;
  c.direction = draw.one_of({0, 1, 2});
  c.immersion_m = c.direction == 2 ? c.diameter_m : draw.uniform(0.15, 0.7) * c.diameter_m;
  c.rate_hz = draw.one_of({8000.0, 10000.0, 20000.0});
  const double feed = draw.log_uniform(4e-5, 1.6e-4);
  const std::size_t passes = 3 + draw.below(2);
  for (std::size_t i = 0; i < passes; ++i)
    c.feeds_m.push_back(feed *
                        std::pow(3.0, static_cast<double>(i) / static_cast<double>(passes) - 0.3));
  std::swap(c.feeds_m[0], c.feeds_m[1]);
  c.feeds_m.push_back(feed * draw.uniform(0.9, 1.3));  // held out
  const double turn_s = 60 / c.rpm;
  c.seconds_a_pass = std::round(draw.uniform(14, 24)) * turn_s;

  Draw choice(seed, "milling/" + cell);
  std::vector<std::string> names;
  const auto any = [&](const std::vector<std::string>& list) {
    return list[choice.below(list.size())];
  };
  const bool wrong_file = cell == "file";
  const bool null_case = cell.starts_with("null") || wrong_file;
  const std::string wrong = !wrong_file ? "" : effect.empty() ? any(kWrong) : effect;
  if (!effect.empty() && !wrong_file) {
    names.push_back(effect);
  } else if (cell == "outside") {
    names.push_back(any(kOutside));
  } else if (!null_case) {
    // Pairs of what does not vibrate: those have the structure in common.
    const std::vector<std::string> rigid(kEffects.begin(), kEffects.begin() + 7);
    names.push_back(any(cell == "pair" ? rigid : kEffects));
    if (cell == "pair") {
      std::string second;
      do second = any(rigid);
      while (second == names[0]);
      names.push_back(second);
    }
  }
  const auto is_hidden = [&](const char* name) {
    return std::ranges::find(names, name) != names.end();
  };
  const bool of_memory = is_hidden("regeneration");
  const bool tells_modes = of_memory || is_hidden("process-damping");
  // What the file of regeneration and process damping has, others have as well: a structure that
  // the cut remembers, or does not, and the word that it does not, of a tool that is stiff.
  Draw decoy(seed, "milling/decoys/" + cell);
  const double clue = decoy.unit();
  const bool says_no_memory =
      wrong_file ? wrong == "modes-without-memory" : of_memory || clue < 0.25;
  const bool known_modes =
      wrong_file ? wrong == "other-mode" : !tells_modes && clue > 0.1 && clue < 0.55;
  if (known_modes) add_mode(c, decoy);
  c.remembers = of_memory || !says_no_memory;
  Cut plain = c;
  Draw size(seed, "milling/" + cell + "/size");
  std::vector<HiddenEffect> effects;
  for (const std::string& name : names)
    effects.push_back(hide(name, size.log_uniform(cell == "pair" ? 0.08 : 0.02, 0.4), c, size));

  Forces without = cut(plain, seed);
  const auto largest = [](const Forces& f) {
    double force = 0;
    for (std::size_t i = 0; i < f.x_N.size(); ++i)
      force = std::max(force, std::hypot(f.x_N[i], f.y_N[i]));
    return force;
  };
  Cut stiff = plain;
  stiff.modes_x.clear(), stiff.modes_y.clear();
  const double stiff_peak = largest(known_modes ? cut(stiff, seed) : without);
  Forces with = null_case ? without : cut(c, seed);
  // Chatter is not what is asked for: a structure on which it grows is made stiffer.
  for (int i = 0; i < 4 && !(c.modes_x.empty() && c.modes_y.empty()) &&
                  !(largest(with) < 2.5 * stiff_peak && largest(without) < 2.5 * stiff_peak);
       ++i) {
    stiffen(c);
    stiffen(plain);
    without = cut(plain, seed);
    with = null_case ? without : cut(c, seed);
  }
  // The same tool, vibrating, without what is hidden.
  if (tells_modes) {
    Cut same = c;
    same.remembers = same.remembers && !of_memory;
    same.damping_N_per_m = 0;
    without = cut(same, seed);
  }
  const double peak = largest(without);
  const auto hidden_mode_mass = [&] {
    return c.modes_x.size() > plain.modes_x.size() ? c.modes_x.back().mass_kg
                                                   : c.modes_y.back().mass_kg;
  };
  for (HiddenEffect& e : effects)
    for (auto& [key, value] : e.parameters)
      if (key == "modal_mass_kg") value = hidden_mode_mass();
  double noise = peak * draw.log_uniform(0.005, 0.04);
  if (cell == "null-noisy") noise *= 2;
  // What repeats is seen in the mean over the turns of a pass.
  const double floor = noise / std::sqrt(c.seconds_a_pass / turn_s);
  for (std::size_t i = 0; i < effects.size(); ++i) {
    double alone = left_over(with, without, c.rate_hz);
    if (effects.size() == 2) {
      Cut other = plain;
      Draw again(seed, "milling/" + cell + "/size");
      std::vector<Cut> single(2, plain);
      for (std::size_t k = 0; k < 2; ++k) {
        Cut scratch = plain;
        Cut& target = k == i ? single[k] : scratch;
        hide(names[k], again.log_uniform(0.08, 0.4), target, again);
      }
      other = single[i];
      alone = left_over(cut(other, seed), without, c.rate_hz);
    }
    effects[i].strength = effects[i].visibility = alone / floor;
  }

  Case out;
  out.name = "milling/" + cell + (names.size() == 1 ? "/" + names[0] : "");
  if (wrong_file) out.name += "/" + wrong;
  out.seed = seed;
  out.variant = variant;
  out.truth.effects = effects;
  out.truth.noise_floor = floor;
  out.truth.gap_before = std::hypot(left_over(with, without, c.rate_hz), noise);
  out.truth.gap_oracle = noise;
  out.truth.held_out_from_s = with.time_s[with.held_out];
  out.truth.expect = null_case ? "none"
                     : cell == "outside"
                         ? (names[0] == "time-locked-vibration" ? "line" : "outside")
                         : "name";

  // What the user has. Only the force scale and the angle's zero are left to vary.
  const double strength = variant == "units" ? 0.6 : 1.0;
  const double off = cell == "null-wrong" ? 0.35 : 0.10;
  Draw guess(seed, "milling/nominal");
  const auto nominal = [&](double value) { return value * (1 + guess.uniform(-off, off)); };
  Draw spoil(seed, "milling/wrong file");
  const auto spoilt = [&](const char* what, double value, double by) {
    return wrong == what ? value * (spoil.chance(0.5) ? 1 + by : 1 / (1 + by)) : value;
  };
  std::ostringstream ini;
  ini << "[machine]\nname = blind\n";
  put(ini, "sample_rate_hz", variant == "decimated" ? c.rate_hz / 2 : c.rate_hz);
  ini << "\n[spindle]\nencoder_counts_per_rev = 4096\n\n[tool]\n";
  put(ini, "diameter_m", spoilt("diameter", c.diameter_m, 0.25));
  put(ini, "teeth", c.teeth);
  put(ini, "helix_deg", plain.helix_rad * 180 / kPi);
  const double tangential = nominal(c.tangential) * strength;
  put(ini, "tangential_coefficient_N_per_m2", tangential);
  put(ini, "radial_ratio", nominal(c.ratio));
  if (wrong == "edge-force") {
    const double edge = 0.5 * spoil.log_uniform(0.05, 0.5) * tangential * feed;
    put(ini, "tangential_edge_N_per_m", edge);
    put(ini, "radial_edge_N_per_m", edge * spoil.uniform(0.5, 1.5));
  }
  ini << "\n[cut]\n";
  put(ini, "spindle_speed_rpm", c.rpm);
  put(ini, "feed_per_tooth_m", feed);
  put(ini, "axial_depth_m", spoilt("depth", c.depth_m, 0.3));
  const double immersion = spoilt("immersion", c.immersion_m, 0.3);
  put(ini, "radial_immersion_m",
      c.direction == 2 ? c.immersion_m : std::min(immersion, 0.95 * c.diameter_m));
  ini << "direction = " << (c.direction == 0 ? "up" : c.direction == 1 ? "down" : "slot") << '\n';
  if (says_no_memory) ini << "regeneration = no\n";
  Draw tapped(seed, "milling/tap test");
  if (known_modes || tells_modes) {
    Cut told = tells_modes ? c : plain;
    if (wrong == "other-mode")
      for (std::vector<Mode>* modes : {&told.modes_x, &told.modes_y})
        for (Mode& m : *modes) {
          m.hz = spoilt("other-mode", m.hz, 0.15);
          m.mass_kg = spoilt("other-mode", m.mass_kg, 1.0);
        }
    put_modes(ini, told, strength, tapped);
  } else if (wrong.starts_with("modes")) {
    // Of another tool or machine; this one is stiff.
    Cut other = plain;
    add_mode(other, spoil);
    put_modes(ini, other, strength, tapped);
  }
  out.machine = ini.str();

  const double zero = draw.uniform(0, 2 * kPi) + (variant == "offset" ? 1.234 : 0.0);
  const std::size_t every = variant == "decimated" ? 2 : 1;
  Draw noise_x(seed, "noise x"), noise_y(seed, "noise y");
  Column t{"t_s", {}}, angle{"spindle.angle_rad", {}}, fed{"tool.feed_per_tooth_m", {}},
      x{"dyno.force_x_N", {}}, y{"dyno.force_y_N", {}};
  const double count = 2 * kPi / 4096;
  for (std::size_t i = 0; i < with.time_s.size(); ++i) {
    const double nx = noise * noise_x.normal(), ny = noise * noise_y.normal();
    if (i % every != 0) continue;
    t.values.push_back(static_cast<double>(i) / c.rate_hz);
    angle.values.push_back(std::floor((with.angle_rad[i] + zero) / count) * count);
    fed.values.push_back(with.feed_m[i]);
    x.values.push_back(strength * (with.x_N[i] + nx));
    y.values.push_back(strength * (with.y_N[i] + ny));
  }
  out.columns = {t, angle, fed, x, y};
  return out;
}

}  // namespace blind
