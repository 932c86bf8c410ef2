// The wall a cut leaves, against the geometry of feed marks; roughness against closed forms.
#include <algorithm>
#include <cmath>
#include <limits>

#include "check.hpp"
#include "servosense/sim/milling_simulator.hpp"

using namespace servosense;

namespace {

WallProfile drawn(double length, double spacing, double (*shape)(double)) {
  WallProfile p;
  p.spacing_m = spacing;
  for (int i = 0; i * spacing < length; ++i) p.height_m.push_back(shape(i * spacing));
  return p;
}

void roughness_of_known_shapes() {
  // Sine of amplitude A, 20 waves: Ra = 2A/pi, Rz = 2A; tilt does not count.
  const auto sine = roughness(drawn(4e-3, 1e-7, [](double x) {
    return 1e-6 * std::sin(kTwoPi * x / 0.2e-3 + 0.3) + 0.01 * x - 2e-6;
  }));
  CHECK(sine.has_value());
  // The line fitted to 20 whole waves is tilted by up to 12 A / (2 pi 20) over the length, a fifth
  // of that over a sampling length; the mean feels it in the second order only.
  CHECK_NEAR(sine->ra_m, 2e-6 / kPi, 2e-9);
  CHECK_NEAR(sine->rz_m, 2e-6, 12e-6 / (kTwoPi * 20) / 5);
  WallProfile gap = drawn(1e-3, 1e-6, [](double) { return 0.0; });
  gap.height_m[500] = std::numeric_limits<double>::quiet_NaN();
  CHECK(!roughness(gap));
  CHECK(!roughness(drawn(30e-6, 1e-6, [](double) { return 0.0; })));
}

struct Wall {
  WallProfile profile;
  double ra, rz, highest, lowest;
};

Wall wall_of(const MillingSimulation& s, MillingDirection side, double revolutions) {
  auto simulator = MillingSimulator::create(s);
  if (!simulator) {
    check::fail(__FILE__, __LINE__) << simulator.error().sentence << '\n';
    return {};
  }
  const double rev = s.cut.feed_per_tooth_m * s.tool.teeth;
  while (simulator->now().feed_m < (revolutions + 6) * rev) simulator->step();
  const WallProfile part =
      simulator->surface().wall(0, side).between(3 * rev, (revolutions + 3) * rev);
  const auto r = roughness(part);
  if (!r) {
    check::fail(__FILE__, __LINE__) << r.error().sentence << '\n';
    return {};
  }
  const auto [low, high] = std::minmax_element(part.height_m.begin(), part.height_m.end());
  return {part, r->ra_m, r->rz_m, *high, *low};
}

// Rigid tool: cusps of s^2 / 8R at the feed per tooth; Ra of a row of parabolas is 4/(9 sqrt 3) H.
void feed_marks() {
  MillingSimulation s;
  s.tool.diameter_m = 10e-3;
  s.tool.teeth = 2;
  s.tool.helix_deg = 30;
  s.tool.force.tangential_coefficient_N_per_m2 = 1500e6;
  s.tool.force.radial_ratio = 1.0 / 3;
  s.layers = 8;
  for (const double feed : {87.5e-6, 175e-6}) {
    for (const auto direction :
         {MillingDirection::up, MillingDirection::down, MillingDirection::slot}) {
      s.cut = {8000, feed, 0.010, 0.0005, direction};
      for (const auto side : {MillingDirection::up, MillingDirection::down}) {
        if (direction != MillingDirection::slot && side != direction) continue;
        const Wall w = wall_of(s, side, 20);
        const double cusp = feed * feed / 8 / 5e-3;
        // Against the feed (down milling) the arcs are shorter, with it longer, by m s / (2 pi R):
        // 1.1 % here; grid of s/40 misses the peak by up to 2 x 1/40 of the height.
        CHECK_NEAR(w.highest - w.lowest, cusp, 0.06 * cusp);
        CHECK_NEAR(w.lowest, 0, 0.01 * cusp);
        CHECK_NEAR(w.ra, 4 / (9 * std::sqrt(3.0)) * cusp, 0.03 * cusp);
        CHECK_NEAR(w.rz, cusp, 0.06 * cusp);
      }
    }
  }
  // One tooth stands out by more than the marks: the pitch becomes the feed per revolution.
  s.cut = {8000, 87.5e-6, 0.010, 0.0005, MillingDirection::down};
  s.tool.throw_m = {10e-6, 0};
  const Wall w = wall_of(s, MillingDirection::down, 20);
  const double cusp = 4 * 87.5e-6 * 87.5e-6 / 8 / 5e-3;
  CHECK_NEAR(w.highest - w.lowest, cusp, 0.06 * cusp);
  CHECK_NEAR(w.lowest, -10e-6, 0.01 * cusp);
}

// A tool that gives way leaves material: the wall is off by the deflection while the tooth passes
// it.
void deflected_wall() {
  MillingSimulation s;
  s.tool.diameter_m = 10e-3;
  s.tool.teeth = 4;
  s.tool.force.tangential_coefficient_N_per_m2 = 800e6;
  s.tool.force.radial_ratio = 0.3;
  s.structure.y = {{600, 0.05, 1}};
  s.cut = {3000, 50e-6, 1e-3, 0, MillingDirection::slot};
  auto simulator = MillingSimulator::create(s);
  CHECK(simulator.has_value());
  if (!simulator) return;
  while (simulator->now().t_s < 0.3) simulator->step();
  // A slot with four straight teeth loads the tool with a constant force: m Kt a s / 8 (-c, 1).
  const double force = 4 * 800e6 * 1e-3 * 50e-6 / 4;
  const double y = force / s.structure.y[0].stiffness_N_per_m();
  const double end = simulator->now().feed_m;
  for (const auto side : {MillingDirection::up, MillingDirection::down}) {
    const WallProfile part = simulator->surface().wall(0, side).between(end - 2e-3, end - 1e-3);
    const double lowest = *std::min_element(part.height_m.begin(), part.height_m.end());
    CHECK_NEAR(lowest, side == MillingDirection::up ? -y : y, 0.02 * y);
  }
  CHECK_NEAR(simulator->now().y_m, y, 0.01 * y);
}

// Turns already counted at the start change nothing.
void whole_turns() {
  MillingSimulation s;
  s.tool.diameter_m = 10e-3;
  s.tool.teeth = 3;
  s.tool.helix_deg = 30;
  s.tool.force.tangential_coefficient_N_per_m2 = 1500e6;
  s.layers = 4;
  s.cut = {8000, 87.5e-6, 0.010, 0, MillingDirection::slot};
  s.wall_heights_m = {1e-3, 9e-3};
  std::vector<WallProfile> walls[3];
  for (int turns = -1; turns <= 1; ++turns) {
    s.start_angle_rad = 1.1 + 5 * turns * kTwoPi;
    auto simulator = MillingSimulator::create(s);
    CHECK(simulator.has_value());
    if (!simulator) return;
    while (simulator->now().t_s < 0.015) simulator->step();
    for (const auto side : {MillingDirection::up, MillingDirection::down})
      for (const std::size_t i : {0u, 1u})
        walls[turns + 1].push_back(simulator->surface().wall(i, side));
  }
  for (std::size_t i = 0; i < 4; ++i) {
    for (const int turns : {0, 2}) {
      const std::vector<double>&a = walls[1][i].height_m, &b = walls[turns][i].height_m;
      CHECK(a.size() > 100 && a.size() == b.size());
      double worst = 0;
      int one_sided = 0;
      for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k) {
        if (std::isnan(a[k]) != std::isnan(b[k])) ++one_sided;
        if (!std::isnan(a[k]) && !std::isnan(b[k])) worst = std::max(worst, std::abs(a[k] - b[k]));
      }
      CHECK(one_sided == 0);
      CHECK_NEAR(worst, 0, 1e-13);  // 5 turns are rounded to 4e-15 rad, of which R/4 counts
    }
  }
}

}  // namespace

int main() {
  roughness_of_known_shapes();
  feed_marks();
  deflected_wall();
  whole_turns();
  return check::done();
}
