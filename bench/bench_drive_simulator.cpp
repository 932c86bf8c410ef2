// How much faster than the machine the drive simulator is: 60 s of a feed axis at 8 kHz, one core
// (processor time, so that other work on the host does not count).
#include <cstdio>
#include <ctime>
#include <initializer_list>
#include <string>

#include "servosense/sim/drive_simulator.hpp"
#include "servosense/sim/trajectory.hpp"

using namespace servosense;

namespace {

DriveSimulatorConfig axis() {
  DriveSimulatorConfig c;
  c.drive.inertia = 227;  // Koike 2016, table 3-4, X
  c.drive.viscous = 732;
  c.drive.coulomb = 94;
  c.drive.unit_per_turn = 0.016;
  c.effort_per_A = 200;
  c.controller = {30, 285, 40, 100, 500, 2e-4};
  c.encoder.counts_per_turn = 1 << 20;
  c.current_update_hz = 2000;
  c.current_noise_A = 0.05;
  return c;
}

void add(DriveSimulatorConfig& c, const char* name, std::initializer_list<double> values) {
  EffectSetting& s = c.drive.effects.settings[c.drive.effects.count++];
  s.effect = drive_effect_index(name);
  std::size_t p = 0;
  for (const double value : values) {
    s.parameters[p].value[0] = value;
    s.parameters[p++].count = 1;
  }
}

void measure(const char* name, const DriveSimulatorConfig& config, const Trajectory& motion) {
  auto simulator = DriveSimulator::create(config);
  if (!simulator) {
    std::printf("%s: %s\n", name, simulator.error().sentence.c_str());
    return;
  }
  const int samples = 480000;
  double sum = 0;
  const std::clock_t start = std::clock();
  for (int n = 0; n < samples; ++n) {
    const double t = n * config.sample_period_s;
    sum += simulator->step(motion.at(t).position, t > 5 ? 100 : 0).current_A;
  }
  const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  std::printf("%-44s %8u %10.1f %10.0f   (sum %.6g)\n", name, simulator->substeps(),
              seconds / samples * 1e9, samples * config.sample_period_s / seconds, sum);
}

}  // namespace

int main() {
  Trajectory motion;
  while (motion.duration_s() < 60) {
    (void)motion.move_to(0.3, {0.5, 5, 200});
    (void)motion.dwell(0.1);
    (void)motion.move_to(0, {0.1, 2, 100});
  }
  std::printf("%-44s %8s %10s %10s\n", "drive simulator, 60 s at 8 kHz", "substeps", "ns/sample",
              "x real");
  measure("one mass", axis(), motion);
  DriveSimulatorConfig rough = axis();
  add(rough, "stribeck-friction", {40, 0.01});
  add(rough, "presliding-hysteresis", {2e6, 60});
  add(rough, "quadratic-drag", {50});
  add(rough, "torque-ripple", {7, 5, 0.3});
  measure("one mass, four effects", rough, motion);
  DriveSimulatorConfig soft = axis();
  add(soft, "flexible-coupling", {90, 0.05, 0.4});
  measure("two masses", soft, motion);
  add(soft, "backlash", {20e-6});
  measure("two masses, play", soft, motion);
  return 0;
}
