// Run times of the stability charts on this machine: wall time and processor time, best of three.
#include <chrono>
#include <cstdio>
#include <ctime>
#include <vector>

#include "servosense/identify/growth_ratio.hpp"
#include "servosense/identify/semi_discretization.hpp"
#include "servosense/identify/stability_lobes.hpp"

using namespace servosense;

namespace {

template <typename Work>
void timed(const char* name, const Work& work, int repeats = 3) {
  double wall = 1e300;
  double processor = 1e300;
  for (int i = 0; i < repeats; ++i) {
    const auto from = std::chrono::steady_clock::now();
    const std::clock_t ticks = std::clock();
    work();
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - from;
    wall = took.count() < wall ? took.count() : wall;
    const double spent = static_cast<double>(std::clock() - ticks) / CLOCKS_PER_SEC;
    processor = spent < processor ? spent : processor;
  }
  std::printf("%-62s %10.4f s wall %10.4f s processor\n", name, wall, processor);
}

std::vector<double> spread(double from, double to, int count) {
  std::vector<double> values;
  for (int i = 0; i < count; ++i) values.push_back(from + (to - from) * i / (count - 1));
  return values;
}

}  // namespace

int main() {
  MillingTool tool;
  tool.teeth = 2;
  tool.diameter_m = 0.010;
  tool.force = {.tangential_coefficient_N_per_m2 = 6e8, .radial_ratio = 1.0 / 3};
  MillingCut cut;
  cut.direction = MillingDirection::down;
  Structure structure;  // Insperger & Stepan 2004, in both directions
  structure.x = structure.y = {{922, 0.011, 0.03993}};
  const auto speeds = spread(5000, 25000, 400);
  const auto depths = spread(0.02e-3, 4e-3, 200);

  cut.radial_immersion_m = 0.005;
  timed("zeroth order: build and envelope of 400 speeds",
        [&] { (void)StabilityLobes::from_modes(structure, tool, cut)->envelope(speeds); });
  timed("zeroth order: pockets within 5000..25000 rpm",
        [&] { (void)StabilityLobes::from_modes(structure, tool, cut)->pockets(5000, 25000); });
  timed("radial ratio 0.2..0.5: band over 400 speeds, 33 ratios",
        [&] { (void)limit_depth_band(structure, tool, cut, 0.2, 0.5, speeds); });
  timed(
      "growth ratio: map of 400 speeds x 200 depths",
      [&] { (void)growth_map(structure, tool, cut, speeds, depths); }, 1);
  for (const double immersion : {0.05, 0.1, 0.5, 1.0}) {
    cut.radial_immersion_m = immersion * tool.diameter_m;
    char name[80];
    std::snprintf(name, sizeof name, "semi-discretisation: map of 400 x 200, a/D %.2f", immersion);
    timed(
        name,
        [&] { (void)SemiDiscretization::create(structure, tool, cut)->chart(speeds, depths); }, 1);
  }
}
