// Deflection of a stable cut against its modes integrated in time under the forces of slices of
// the tool; the force law of the test is its own.
#include <cmath>
#include <utility>
#include <vector>

#include "check.hpp"
#include "servosense/model/forced_deflection.hpp"

using namespace servosense;

namespace {

constexpr double kTangential_N_per_m2 = 8e8, kRadialRatio = 0.3;
constexpr double kTangentialEdge_N_per_m = 1e4, kRadialEdge_N_per_m = 6e3;
constexpr double kRadius_m = 0.008, kDepth_m = 0.002;
constexpr int kSlices = 40;

struct Force {
  double x_N = 0, y_N = 0;
};

/// Of all slices of all teeth, tooth 1 at `turned_rad`.
Force force_at(double turned_rad, double feed_m, int teeth, double helix_rad, double from_rad,
               double to_rad) {
  Force f;
  const double slice_m = kDepth_m / kSlices;
  for (int slice = 0; slice < kSlices; ++slice) {
    const double lag = (slice + 0.5) * slice_m * std::tan(helix_rad) / kRadius_m;
    for (int tooth = 0; tooth < teeth; ++tooth) {
      const double phi = std::fmod(turned_rad + kTwoPi * tooth / teeth - lag + kTwoPi, kTwoPi);
      if (phi < from_rad || phi > to_rad) continue;
      const double chip = feed_m * std::sin(phi);
      const double t = slice_m * (kTangential_N_per_m2 * chip + kTangentialEdge_N_per_m);
      const double r = slice_m * (kRadialRatio * kTangential_N_per_m2 * chip + kRadialEdge_N_per_m);
      f.x_N += -t * std::cos(phi) - r * std::sin(phi);
      f.y_N += t * std::sin(phi) - r * std::cos(phi);
    }
  }
  return f;
}

/// Semi-implicit steps until what the start has rung is gone; the farthest of the last tenth.
double farthest_in_time(const Structure& structure, double turn_rad_s, double feed_m, int teeth,
                        double helix_rad, double from_rad, double to_rad) {
  constexpr int kSteps = 4000, kTurns = 60;  // a turn
  const double h = kTwoPi / turn_rad_s / kSteps;
  std::vector<Force> turn;
  for (int i = 0; i < kSteps; ++i)
    turn.push_back(
        force_at(kTwoPi * (i + 0.5) / kSteps, feed_m, teeth, helix_rad, from_rad, to_rad));
  std::vector<std::pair<double, double>> x(structure.x.size()), y(structure.y.size());
  const auto step = [h](const std::vector<StructuralMode>& modes, double force_N, auto& states) {
    double sum = 0;
    for (std::size_t m = 0; m < modes.size(); ++m) {
      auto& [at, speed] = states[m];
      const double w = kTwoPi * modes[m].natural_frequency_hz;
      speed += h * (force_N / modes[m].modal_mass_kg - 2 * modes[m].damping_ratio * w * speed -
                    w * w * at);
      sum += at += h * speed;
    }
    return sum;
  };
  double farthest = 0;
  for (int i = 0; i < kTurns * kSteps; ++i) {
    const Force& f = turn[static_cast<std::size_t>(i % kSteps)];
    const double ux = step(structure.x, f.x_N, x), uy = step(structure.y, f.y_N, y);
    if (i > kTurns * kSteps * 9 / 10) farthest = std::max(farthest, std::hypot(ux, uy));
  }
  return farthest;
}

}  // namespace

int main() {
  Structure structure;
  structure.x = {{900, 0.03, 0.4}};
  structure.y = {{950, 0.035, 0.4}, {1700, 0.05, 0.2}};
  MillingTool tool;
  tool.diameter_m = 2 * kRadius_m;
  tool.force.tangential_coefficient_N_per_m2 = kTangential_N_per_m2;
  tool.force.radial_ratio = kRadialRatio;
  tool.force.tangential_edge_N_per_m = kTangentialEdge_N_per_m;
  tool.force.radial_edge_N_per_m = kRadialEdge_N_per_m;
  MillingCut cut;
  cut.axial_depth_m = kDepth_m;
  struct Given {
    MillingDirection direction;
    double width_m, from_rad, to_rad;  // of the arc
  };
  const double third = std::acos(0.5);  // of half the radius
  double least = 1, most = 0;
  for (const Given& g :
       {Given{MillingDirection::down, 0.008, kPi / 2, kPi},
        Given{MillingDirection::up, 0.004, 0, third}, Given{MillingDirection::slot, 0.016, 0, kPi}})
    for (const int teeth : {2, 3, 4})
      for (const double helix_deg : {0.0, 35.0})
        for (const double rpm : {6100.0, 12800.0}) {  // 12800 rpm: four teeth near the modes
          cut.direction = g.direction;
          cut.radial_immersion_m = g.width_m;
          cut.spindle_speed_rpm = rpm;
          tool.teeth = teeth;
          tool.helix_deg = helix_deg;
          const double feed_m = 8e-5;
          const double expected = farthest_in_time(structure, kTwoPi * rpm / 60, feed_m, teeth,
                                                   kTwoPi * helix_deg / 360, g.from_rad, g.to_rad);
          const double found = ForcedDeflection(structure, tool, cut).farthest_m(feed_m);
          least = std::min(least, found / expected);
          most = std::max(most, found / expected);
        }
  check::figure("deflection over that in time, least", least);
  check::figure("deflection over that in time, most", most);
  CHECK(least > 0.98 && most < 1.02);
  return check::done();
}
