// The axial force of the cut against a quadrature of its own: slices of helical teeth on circular
// paths, dFa = (Ka h + Kae) dz, at the middle of each step.
#include <algorithm>
#include <cmath>
#include <vector>

#include "check.hpp"
#include "servosense/sim/milling_simulator.hpp"

namespace {

using namespace servosense;

constexpr double kAxial = 1.3e8, kEdge = -1700;  // of either sign

MillingSimulation config(double helix_deg, MillingDirection direction) {
  MillingSimulation s;
  s.tool.diameter_m = 20e-3;
  s.tool.teeth = 3;
  s.tool.helix_deg = helix_deg;
  s.tool.force.tangential_coefficient_N_per_m2 = 700e6;
  s.tool.force.radial_ratio = 0.3;
  s.tool.force.axial_coefficient_N_per_m2 = kAxial;
  s.tool.force.axial_edge_N_per_m = kEdge;
  s.cut = {3000, 60e-6, 5e-3, direction == MillingDirection::slot ? 0 : 8e-3, direction};
  s.step_s = 0.02 / 3600;
  return s;
}

double by_quadrature(const MillingSimulation& s, double angle) {
  constexpr int kSlices = 4000;
  const double radius = s.tool.diameter_m / 2, dz = s.cut.axial_depth_m / kSlices;
  const double swept = s.cut.direction == MillingDirection::slot
                           ? kTwoPi / 2
                           : std::acos(1 - s.cut.radial_immersion_m / radius);
  const double from = s.cut.direction == MillingDirection::down ? kTwoPi / 2 - swept : 0;
  double force = 0;
  for (int tooth = 0; tooth < s.tool.teeth; ++tooth)
    for (int i = 0; i < kSlices; ++i) {
      const double lag = (i + 0.5) * dz * std::tan(s.tool.helix_deg * kTwoPi / 360) / radius;
      double phi = std::fmod(angle + tooth * kTwoPi / s.tool.teeth - lag, kTwoPi);
      if (phi < 0) phi += kTwoPi;
      if (phi < from || phi > from + swept) continue;
      force += (kAxial * s.cut.feed_per_tooth_m * std::sin(phi) + kEdge) * dz;
    }
  return force;
}

void against_quadrature(double helix_deg, MillingDirection direction) {
  const MillingSimulation s = config(helix_deg, direction);
  auto simulator = MillingSimulator::create(s);
  CHECK(simulator);
  if (!simulator) return;
  double worst = 0, largest = 0, mean = 0, expected = 0;
  for (int i = 0; i < 3600; ++i) {
    const double before = simulator->now().angle_rad;
    const MillingStep& now = simulator->step();
    const double force = by_quadrature(s, (before + now.angle_rad) / 2);
    worst = std::max(worst, std::abs(now.fz_N - force));
    largest = std::max(largest, std::abs(force));
    mean += now.fz_N / 3600;
    expected += force / 3600;
  }
  check::figure("axial force: worst step", 100 * worst / largest, "% of the largest");
  CHECK(largest > 10);
  CHECK_NEAR(mean / expected, 1, 2e-3);
  // Of 64 layers each enters whole: 0.3 % were found.
  CHECK(worst < 0.01 * largest);
}

void nothing_without() {
  MillingSimulation s = config(30, MillingDirection::down);
  s.tool.force.axial_coefficient_N_per_m2 = s.tool.force.axial_edge_N_per_m = 0;
  auto simulator = MillingSimulator::create(s);
  CHECK(simulator && !s.tool.force.has_axial());
  double largest = 0;
  for (int i = 0; simulator && i < 3600; ++i)
    largest = std::max(largest, std::abs(simulator->step().fz_N));
  CHECK(largest == 0);
}

}  // namespace

int main() {
  against_quadrature(30, MillingDirection::down);
  against_quadrature(40, MillingDirection::up);
  against_quadrature(20, MillingDirection::slot);
  nothing_without();
  return check::done();
}
