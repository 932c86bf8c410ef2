// An eccentric encoder that the machine file has already: what it leaves at the angle measured, of
// the second order, gets no name, nor does its phase after another power-up.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>

#include "check.hpp"
#include "random_axis.hpp"
#include "servosense/core/units.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kAmplitude_rad = 0.15, kPhase_rad = 0.7;

void add_eccentricity(DriveModelConfig& drive, double phase_rad) {
  EffectSetting& s = drive.effects.settings[drive.effects.count++];
  s.effect = drive_effect_index("encoder-eccentricity");
  s.parameters[0] = {{kAmplitude_rad}, 1};
  s.parameters[1] = {{phase_rad}, 1};
}

/// The machine file has the phase of a power-up that was `turned_rad` away.
void nothing_is_missing(unsigned seed, double turned_rad) {
  random_axis::Between between{std::mt19937_64(seed)};
  DriveSimulatorConfig machine = random_axis::draw(between, seed);
  DriveModelConfig file = machine.drive;
  file.inertia *= 1.05;
  file.coulomb *= 0.95;
  add_eccentricity(machine.drive, kPhase_rad);
  add_eccentricity(file, kPhase_rad - turned_rad);
  const DriveData data = random_axis::record(machine, file, random_axis::moves());
  const auto out = reconcile_drive(data, {});
  CHECK(out.has_value());
  if (!out) return;
  const Report& r = out->report;
  std::printf("  seed %u, turned by %.2f rad: %s\n", seed, turned_rad, r.summary.c_str());
  CHECK(r.verdict == Verdict::agrees);
  CHECK(r.effects.empty());
  const auto phase = std::find_if(r.recalibrated.begin(), r.recalibrated.end(), [](const auto& c) {
    return c.parameter == "encoder-eccentricity phase_rad";
  });
  CHECK((phase != r.recalibrated.end()) == (turned_rad != 0));
  const EffectSetting* now = out->model.effects.find("encoder-eccentricity");
  CHECK(now != nullptr);
  // A hundredth of the amplitude is left of the first order.
  if (now != nullptr) CHECK_NEAR(std::remainder(now->scalar(1) - kPhase_rad, kTwoPi), 0, 0.01);
}

}  // namespace

int main() {
  nothing_is_missing(3, 0);
  nothing_is_missing(4, 2);
  return check::done();
}
