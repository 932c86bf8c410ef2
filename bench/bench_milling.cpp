// Speed of the milling simulator against real time, one core (processor time). Prints a table;
// asserts nothing.
#include <algorithm>
#include <cstdio>
#include <ctime>

#include "servosense/sim/milling_simulator.hpp"

namespace {

using namespace servosense;

MillingSimulation base() {
  MillingSimulation s;
  s.tool.diameter_m = 0.010;
  s.tool.teeth = 2;
  s.tool.helix_deg = 30;
  s.tool.force.tangential_coefficient_N_per_m2 = 1500e6;
  s.tool.force.radial_ratio = 1.0 / 3;
  s.cut = {8000, 87.5e-6, 0.015, 0.0005, MillingDirection::down};
  // Four modes an axis; the first is that of Koike 2016, tables 8-10 and 8-11.
  const StructuralMode modes[] = {
      {2082, 0.018, 0.043}, {818, 0.03, 2.0}, {1653, 0.02, 0.6}, {1715, 0.02, 0.8}};
  for (const StructuralMode& mode : modes) {
    s.structure.x.push_back(mode);
    s.structure.y.push_back(mode);
  }
  return s;
}

void report(const char* name, const MillingSimulation& simulation) {
  auto simulator = MillingSimulator::create(simulation);
  if (!simulator) {
    std::printf("%-46s %s\n", name, simulator.error().sentence.c_str());
    return;
  }
  double checksum = 0;
  double best = 1e9;
  constexpr int kSteps = 50000, kRepeats = 20;  // whatever disturbs a measurement only adds to it
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    const std::clock_t start = std::clock();
    for (int i = 0; i < kSteps; ++i) checksum += simulator->step().torque_Nm;
    best = std::min(best, static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
  }
  std::printf("%-46s %8.1f %10.1f   (mean torque %.4g Nm)\n", name, best / kSteps * 1e9,
              kSteps * simulation.step_s / best, checksum / (1.0 * kRepeats * kSteps));
}

}  // namespace

int main() {
  std::printf("%-46s %8s %10s\n", "2 teeth, 10 mm, helix 30, 8 modes, 2 us", "ns/step",
              "x real time");
  MillingSimulation s = base();
  report("down 0.5 mm, 15 mm deep, 64 layers", s);
  s.surface_points = 32768;
  report("  32768 surface points asked for", s);
  s = base();
  s.tool.force.tangential_edge_N_per_m = s.tool.force.radial_edge_N_per_m = 1e4;
  report("  with edge forces", s);
  s = base();
  s.tool.force.process_damping_N_per_m = 1e3;
  report("  with process damping", s);
  s = base();
  s.tool.force.size_effect_exponent = 0.2;
  report("  with size effect", s);
  s = base();
  s.trochoidal_path = true;
  report("  trochoidal path", s);
  s = base();
  s.tool.helix_deg = 0;
  report("  straight teeth", s);
  s = base();
  s.workpiece.length_m = 0.1;
  s.workpiece.front_depth_m = 0.005;
  s.workpiece.far_depth_m = 0.025;
  report("  wedge 5 to 25 mm", s);
  for (const int layers : {16, 64, 256}) {
    s = base();
    s.layers = layers;
    s.cut.direction = MillingDirection::slot;
    s.tool.force.tangential_coefficient_N_per_m2 = 10e6;  // wax: 15 mm deep would not be stable
    char name[64];
    std::snprintf(name, sizeof name, "full slot, 15 mm deep, %d layers", layers);
    report(name, s);
  }
  return 0;
}
