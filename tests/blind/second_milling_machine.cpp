#include "second_milling_machine.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace blind::second_milling {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr std::size_t kBins = 360;  // of a turn in a steady waveform
constexpr double kMostRows = 120000;

double highest_hz(const Machine& m) {
  double hz = std::max(m.sensor.hz_x, m.sensor.hz_y) / 2;  // driven by it, so half as fine
  for (const Mode& mode : m.cutter.modes) hz = std::max(hz, mode.hz);
  return hz;
}

/// Materials as in the tables of the text books: N/mm^2 of the chip, N/mm of the edge.
void draw_material(Cutter& c, Draw& draw) {
  struct Material {
    double ktc, ratio, edge;
  };
  constexpr Material kMaterials[]{{650, 0.25, 8},   {800, 0.4, 12},  {1500, 0.3, 15},
                                  {1900, 0.45, 20}, {2300, 0.5, 25}, {3200, 0.6, 30}};
  const Material material = draw.one_of(kMaterials);
  c.ktc = 1e6 * material.ktc * draw.uniform(0.85, 1.15);
  c.krc = c.ktc * material.ratio * draw.uniform(0.8, 1.2);
  c.kac = c.ktc * draw.uniform(0.1, 0.3) * std::tan(c.helix_rad + 0.1);
  if (!draw.chance(0.3)) return;
  // An edge that the file knows of.
  c.kte = 1e3 * material.edge * draw.uniform(0.2, 0.6);
  c.kre = c.kte * draw.uniform(0.8, 1.5);
}

void draw_levels(Machine& m, Draw& draw, const Needs& needs) {
  const double largest =
      std::clamp(0.004 * 2 * m.cutter.radius * draw.log_uniform(0.8, 4.0), 0.02e-3, 0.3e-3);
  const bool one = needs.one_feed || (!needs.several_feeds && draw.chance(0.15));
  if (one) {
    m.levels = {{largest, draw.uniform(2, 5)}};
    m.recorder.feed_column = draw.chance(0.5);
    return;
  }
  const std::size_t n = 2 + draw.below(4);
  const double span = draw.uniform(needs.several_feeds ? 2.0 : 1.6, 5.0);
  const double seconds = draw.uniform(1, 3);
  for (std::size_t i = 0; i < n; ++i) {
    const double share = static_cast<double>(i) / static_cast<double>(n - 1);
    m.levels.push_back({std::max(0.01e-3, largest * std::pow(span, share - 1)), seconds});
  }
  switch (draw.below(3)) {
    case 0:
      break;
    case 1:
      std::ranges::reverse(m.levels);
      break;
    default:
      for (std::size_t i = n - 1; i > 0; --i) std::swap(m.levels[i], m.levels[draw.below(i + 1)]);
  }
  if (seconds * static_cast<double>(n) < 6 && draw.chance(0.5)) {
    const std::vector<Level> once = m.levels;
    m.levels.insert(m.levels.end(), once.begin(), once.end());
  }
}

void draw_recorder(Machine& m, Draw& draw) {
  Recorder& r = m.recorder;
  r.counts = draw.chance(0.4);
  constexpr int kCounts[]{1024, 2048, 3600, 4096, 10000};
  r.counts_per_rev = draw.one_of(kCounts);
  r.has_z = draw.chance(0.4);
  r.mean = draw.chance(0.5);
  r.zero = draw.uniform(0, 2 * kPi);
  r.sparse_feed = draw.chance(0.2);
  r.ramp_s = draw.uniform(0.01, 0.08);
  if (draw.chance(0.35)) r.air_before_s = draw.uniform(0.2, 0.8);
  if (draw.chance(0.35)) r.air_after_s = draw.uniform(0.2, 0.8);
  const double turns_per_s = 1 / m.turn_s();
  constexpr double kRates[]{2000, 5000, 10000, 12800, 20000, 25600, 51200};
  const double most = kMostRows / (m.cutting_s() + r.air_before_s + r.air_after_s);
  std::vector<double> fit;
  for (const double rate : kRates)
    if (rate >= 40 * turns_per_s && rate <= 1000 * turns_per_s && rate <= most) fit.push_back(rate);
  r.rate_hz = fit.empty() ? 10000 : fit[draw.below(fit.size())];
}

/// Of the feed as it is commanded, and of the time since it changed and what it was before.
struct Commanded {
  double feed, before, since_s;
};

Commanded commanded(const Machine& m, double t) {
  double begin = m.recorder.air_before_s, before = m.levels.front().feed;
  for (std::size_t i = 0; i < m.levels.size(); ++i) {
    const Level& level = m.levels[i];
    if (t < begin + level.seconds || i + 1 == m.levels.size())
      return {level.feed, before, t - begin};
    begin += level.seconds;
    before = level.feed;
  }
  return {before, before, 0};
}

std::string key(const char* name, double value) {
  char text[80];
  std::snprintf(text, sizeof text, "%s = %.6g\n", name, value);
  return text;
}

/// Means over so many steps, centred: a recorder that averages does not show what is faster.
void smooth(std::vector<double>& v, std::size_t steps) {
  const std::size_t half = steps / 2;
  if (half == 0) return;
  std::vector<double> sums(v.size() + 1, 0.0);
  for (std::size_t i = 0; i < v.size(); ++i) sums[i + 1] = sums[i] + v[i];
  for (std::size_t i = 0; i < v.size(); ++i) {
    const std::size_t from = i < half ? 0 : i - half, to = std::min(i + half + 1, v.size());
    v[i] = (sums[to] - sums[from]) / static_cast<double>(to - from);
  }
}

}  // namespace

Mode draw_mode(Draw& draw, char axis) {
  const double hz = draw.log_uniform(150, 1200);
  const double stiffness = draw.log_uniform(5e6, 8e7);
  return {axis, hz, draw.log_uniform(0.01, 0.06), stiffness / std::pow(2 * kPi * hz, 2)};
}

double Machine::turn_s() const { return 2 * kPi / speed; }

double Machine::cutting_s() const {
  double seconds = 0;
  for (const Level& level : levels) seconds += level.seconds;
  return seconds;
}

Machine draw_machine(Draw& draw, const Needs& needs) {
  Machine m;
  Cutter& c = m.cutter;
  constexpr double kDiameters_mm[]{6, 8, 10, 12, 16, 20, 25, 32, 40, 50};
  const double diameter = 1e-3 * draw.one_of(kDiameters_mm);
  c.radius = diameter / 2;
  const std::size_t teeth = diameter < 0.012 ? 2 + draw.below(3) : 2 + draw.below(5);
  c.teeth.resize(teeth);
  constexpr double kHelices_deg[]{0, 0, 15, 20, 30, 30, 35, 38, 40, 45};
  do c.helix_rad = kPi / 180 * draw.one_of(kHelices_deg);
  while (needs.helix && c.helix_rad == 0);
  c.depth = std::clamp(diameter * draw.log_uniform(needs.helix ? 0.2 : 0.03, 0.6), 0.5e-3, 10e-3);
  switch (draw.below(3)) {
    case 0:
      c.direction = Direction::slot;
      break;
    case 1:
      c.direction = Direction::up;
      break;
    default:
      c.direction = Direction::down;
  }
  c.immersion = c.direction == Direction::slot ? diameter : diameter * draw.log_uniform(0.1, 0.85);
  const double vc = needs.slow ? draw.uniform(0.4, 1.2) : draw.log_uniform(0.7, 6);
  const double rpm = std::clamp(60 * vc / (kPi * diameter), 800.0, 12000.0);
  m.speed = 2 * kPi / 60 * 10 * std::round(rpm / 10);
  draw_material(c, draw);
  c.trochoid = draw.chance(0.5);
  c.closed_form = !c.trochoid && draw.chance(0.6);
  const double lag_deg = 180 / kPi * c.depth * std::tan(c.helix_rad) / c.radius;
  c.slices = c.helix_rad == 0 ? 1 : static_cast<int>(std::clamp(lag_deg / 1.25, 8.0, 48.0));
  m.maker = std::string(c.trochoid ? "trochoid" : "circles") +
            (c.closed_form ? ", integral" : ", slices");
  if (needs.structure || draw.chance(0.45)) {
    c.modes.push_back(draw_mode(draw, draw.chance(0.5) ? 'x' : 'y'));
    if (draw.chance(0.6)) c.modes.push_back(draw_mode(draw, c.modes[0].axis == 'x' ? 'y' : 'x'));
  }
  draw_levels(m, draw, needs);
  draw_recorder(m, draw);
  // Run into the work and out of it where that takes less than a part of the record.
  const double table = m.levels.front().feed * static_cast<double>(teeth) / m.turn_s();
  if (c.radius / table < 0.25 * m.levels.front().seconds && draw.chance(0.3)) {
    const double air = m.recorder.air_before_s * table;
    c.face = air + 1.05 * c.radius;
  }
  m.everything_wrong = draw.chance(0.3);
  return m;
}

void write_down(Machine& m, Draw& draw) {
  m.file = m.cutter;
  Cutter& f = m.file;
  const auto wrong = [&](double by) { return draw.uniform(1 - by, 1 + by); };
  f.ktc *= wrong(0.1);
  f.krc *= wrong(0.1) * f.ktc / m.cutter.ktc;
  f.kte *= wrong(0.1);
  f.kre *= wrong(0.1);
  const double depth = wrong(0.1), immersion = wrong(0.1);
  for (Mode& mode : f.modes) {
    // A tap test: the frequency is known best.
    mode.hz *= wrong(m.everything_wrong ? 0.03 : 0.005);
    mode.damping *= wrong(0.1);
    mode.mass_kg *= wrong(m.everything_wrong ? 0.1 : 0.03);
  }
  if (!m.everything_wrong) return;
  f.depth *= depth;
  if (f.direction != Direction::slot)
    f.immersion = std::min(f.immersion * immersion, 1.98 * f.radius);
}

std::string file_text(const Machine& m) {
  const Cutter& f = m.file;
  std::string text = "[machine]\nname = " + std::string("mill\n");
  text += key("sample_rate_hz", m.recorder.rate_hz);
  if (m.recorder.counts)
    text += "\n[spindle]\n" + key("encoder_counts_per_rev", m.recorder.counts_per_rev);
  text += "\n[tool]\n" + key("diameter_m", 2 * f.radius) +
          key("teeth", static_cast<double>(f.teeth.size())) +
          key("helix_deg", 180 / kPi * f.helix_rad) +
          key("tangential_coefficient_N_per_m2", f.ktc) + key("radial_ratio", f.krc / f.ktc);
  if (f.kte > 0) text += key("tangential_edge_N_per_m", f.kte) + key("radial_edge_N_per_m", f.kre);
  text += "\n[cut]\n" + key("spindle_speed_rpm", 60 / m.turn_s()) +
          key("feed_per_tooth_m", m.levels.front().feed) + key("axial_depth_m", f.depth) +
          key("radial_immersion_m", f.immersion) + "direction = " +
          (f.direction == Direction::slot ? "slot"
           : f.direction == Direction::up ? "up"
                                          : "down") +
          '\n';
  if (!f.regeneration) text += "regeneration = no\n";
  for (const char axis : {'x', 'y'}) {
    std::string modes;
    for (const Mode& mode : f.modes) {
      if (mode.axis != axis) continue;
      char one[100];
      std::snprintf(one, sizeof one, "%s%.6g %.4g %.6g", modes.empty() ? "" : ", ", mode.hz,
                    mode.damping, mode.mass_kg);
      modes += one;
    }
    if (!modes.empty()) text += std::string("\n[structure.") + axis + "]\nmodes = " + modes + '\n';
  }
  return text;
}

std::vector<double> steady(const Machine& m, bool* periodic) {
  const double turn = m.turn_s();
  double decay_s = 0;
  for (const Mode& mode : m.cutter.modes)
    decay_s = std::max(decay_s, 5 / (mode.damping * 2 * kPi * mode.hz));
  if (m.sensor.hz_x > 0)
    decay_s = std::max(decay_s,
                       5 / (m.sensor.damping * 2 * kPi * std::min(m.sensor.hz_x, m.sensor.hz_y)));
  const auto warm = std::min<std::size_t>(2 + static_cast<std::size_t>(decay_s / turn), 30);
  const double finest = std::max(2.0 * kBins / turn, 25 * highest_hz(m));
  const auto per_bin = static_cast<std::size_t>(std::ceil(finest * turn / kBins));
  const double step = turn / static_cast<double>(per_bin * kBins);
  Cutter inside = m.cutter;
  inside.face = -1e9;
  std::vector<double> all, change, tried;
  for (const Level& level : m.levels) {
    if (std::ranges::find(tried, level.feed) != tried.end()) continue;
    tried.push_back(level.feed);
    Forces f = cut(inside, step, (warm + 2) * per_bin * kBins, [&](double t) {
      Moment now;
      now.angle = m.speed * t, now.speed = m.speed, now.feed = level.feed;
      return now;
    });
    if (m.sensor.hz_x > 0) {
      ring(f.x, step, m.sensor.hz_x, m.sensor.damping, m.sensor.share);
      ring(f.y, step, m.sensor.hz_y, m.sensor.damping, m.sensor.share);
    }
    if (m.recorder.mean)
      for (std::vector<double>* force : {&f.x, &f.y})
        smooth(*force, static_cast<std::size_t>(1 / (m.recorder.rate_hz * step)));
    for (const std::vector<double>* force : {&f.x, &f.y})
      for (std::size_t bin = 0; bin < kBins; ++bin) {
        double sum = 0, before = 0;
        for (std::size_t i = 0; i < per_bin; ++i) {
          const std::size_t at = (warm + 1) * per_bin * kBins + bin * per_bin + i;
          sum += (*force)[at];
          before += (*force)[at - per_bin * kBins];
        }
        all.push_back(sum / static_cast<double>(per_bin));
        change.push_back(all.back() - before / static_cast<double>(per_bin));
      }
  }
  if (periodic != nullptr) *periodic = rms_of(change) < 0.02 * rms_of(all);
  return all;
}

double left_over(const std::vector<double>& measured, const Machine& model) {
  const std::vector<double> base = steady(model);
  std::vector<Signal> columns{base};
  const auto change = [&](double Cutter::*what) {
    if (model.cutter.*what <= 0) return;
    Machine other = model;
    other.cutter.*what *= 1.05;
    Signal column = steady(other);
    for (std::size_t i = 0; i < column.size(); ++i) column[i] -= base[i];
    columns.push_back(std::move(column));
  };
  change(&Cutter::krc);
  change(&Cutter::kte);
  change(&Cutter::kre);
  for (const std::size_t axis : {0u, 1u}) {
    Signal zero(base.size(), 0.0);
    for (std::size_t i = 0; i < zero.size(); ++i) zero[i] = i / kBins % 2 == axis ? 1.0 : 0.0;
    columns.push_back(std::move(zero));
  }
  const auto left = [&](int shift) {
    Signal moved(measured.size());
    for (std::size_t i = 0; i < moved.size(); ++i) {
      const std::size_t block = i / kBins * kBins;
      moved[i] =
          measured[block + (i - block + kBins + static_cast<std::size_t>(shift + 360)) % kBins];
    }
    return rms_of(least_squares(columns, moved, 0, moved.size()).residual);
  };
  double best = left(0);
  for (int shift = -15; shift <= 15; ++shift) best = std::min(best, left(shift));
  return best;
}

std::vector<Column> record(const Machine& m, const Disturbance& disturbance, Draw& draw) {
  const Recorder& r = m.recorder;
  const double total = m.cutting_s() + r.air_before_s + r.air_after_s;
  const auto rows = static_cast<std::size_t>(total * r.rate_hz);
  // A straight tooth enters at once: a mean over a sample has to know when.
  const double in_sample = r.mean && m.cutter.helix_rad == 0 ? 24 : 2;
  const double fine = std::max({in_sample * r.rate_hz, 360 / m.turn_s(), 25 * highest_hz(m)});
  const auto finer = static_cast<std::size_t>(std::ceil(fine / r.rate_hz));
  const double step = 1 / (r.rate_hz * static_cast<double>(finer));
  // No spindle holds its speed to the last digit.
  const double wander = 3e-4 * m.speed, wander_w = 2 * kPi * draw.uniform(0.2, 1.0);
  const auto at = [&](double t) {
    Moment now;
    now.angle = m.speed * t + wander / wander_w * std::sin(wander_w * t);
    now.speed = m.speed + wander * std::cos(wander_w * t);
    const Commanded c = commanded(m, t);
    const double part = std::clamp(c.since_s / r.ramp_s, 0.0, 1.0);
    now.feed = c.before + (c.feed - c.before) * part;
    now.cutting = t >= r.air_before_s && t < total - r.air_after_s;
    if (disturbance.moment) disturbance.moment(t, now);
    return now;
  };
  Forces f = cut(m.cutter, step, rows * finer, at);
  if (m.sensor.hz_x > 0) {
    ring(f.x, step, m.sensor.hz_x, m.sensor.damping, m.sensor.share);
    ring(f.y, step, m.sensor.hz_y, m.sensor.damping, m.sensor.share);
  }
  std::vector<Column> columns;
  columns.push_back({"t_s", {}});
  columns.push_back({r.counts ? "spindle.angle_counts" : "spindle.angle_rad", {}});
  const std::size_t feed_at = columns.size();
  if (r.feed_column) columns.push_back({"tool.feed_per_tooth_m", {}});
  const std::size_t force_at = columns.size();
  columns.push_back({"dyno.force_x_N", {}});
  columns.push_back({"dyno.force_y_N", {}});
  if (r.has_z) columns.push_back({"dyno.force_z_N", {}});
  double last_feed = -1;
  for (std::size_t row = 0; row < rows; ++row) {
    const double t = static_cast<double>(row) / r.rate_hz;
    columns[0].values.push_back(t);
    const double angle = at(t).angle + r.zero;
    columns[1].values.push_back(r.counts ? std::floor(angle / (2 * kPi) * r.counts_per_rev)
                                         : angle);
    const double feed = commanded(m, t).feed;
    if (r.feed_column)
      columns[feed_at].values.push_back(r.sparse_feed && feed == last_feed ? kAbsent : feed);
    last_feed = feed;
    double force[3]{};
    const std::vector<double>* parts[]{&f.x, &f.y, &f.z};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::vector<double>& of = *parts[axis];
      const std::size_t i = row * finer;
      if (r.mean) {
        // Centred on the sample's instant, as a converter with a flat delay gives it.
        const std::size_t from = i < finer / 2 ? 0 : i - finer / 2;
        for (std::size_t k = from; k < from + finer; ++k)
          force[axis] += of[std::min(k, of.size() - 1)];
        force[axis] /= static_cast<double>(finer);
      } else {
        force[axis] = of[i];
      }
      force[axis] += r.offset_N[axis] + r.drift_N[axis] * t / total + r.noise_N * draw.normal();
    }
    if (disturbance.force) disturbance.force(t, force);
    for (std::size_t axis = 0; axis < (r.has_z ? 3u : 2u); ++axis)
      columns[force_at + axis].values.push_back(force[axis]);
  }
  return columns;
}

}  // namespace blind::second_milling
