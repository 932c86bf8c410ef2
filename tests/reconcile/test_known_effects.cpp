// Effects that the machine file has, with parameters that are off: recalibrated, and no name. One
// that the machine does not have has nothing to be refitted.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "random_axis.hpp"
#include "servosense/core/units.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

EffectSetting setting(const char* name, const std::vector<double>& values) {
  EffectSetting s;
  s.effect = drive_effect_index(name);
  for (std::size_t p = 0; p < values.size(); ++p) s.parameters[p] = {{values[p]}, 1};
  return s;
}

struct Off {
  const char* effect;
  std::vector<double> is, file;  ///< what the file leaves out is none
  std::size_t parameter;         ///< the one that is off
  double within;                 ///< of it, relative; of a phase in rad
};

/// What is left of the error of a parameter that is off in the file.
void recalibrated(unsigned seed, const Off& off) {
  random_axis::Between between{std::mt19937_64(seed)};
  DriveSimulatorConfig machine = random_axis::draw(between, seed);
  DriveModelConfig file = machine.drive;
  file.inertia *= 1.05;
  machine.drive.effects.settings[machine.drive.effects.count++] = setting(off.effect, off.is);
  file.effects.settings[file.effects.count++] = setting(off.effect, off.file);
  const DriveData data = random_axis::record(machine, file, random_axis::moves());
  const auto out = reconcile_drive(data, {});
  CHECK(out.has_value());
  if (!out) return;
  const Report& r = out->report;
  const std::size_t p = off.parameter;
  const double from = p < off.file.size() ? off.file[p] : 0;
  const EffectSetting* now = out->model.effects.find(off.effect);
  CHECK(now != nullptr);
  if (now == nullptr) return;
  std::printf("  %s: %g, in the file %g, now %g; %s\n", off.effect, off.is[p], from, now->scalar(p),
              r.summary.c_str());
  CHECK(r.effects.empty());
  CHECK(r.verdict == Verdict::agrees);
  const std::string key =
      std::string(off.effect) + " " + kDriveEffects[now->effect].parameters[p].key;
  const auto told = std::ranges::find(r.recalibrated, key, &Recalibrated::parameter);
  CHECK(told != r.recalibrated.end());
  if (told == r.recalibrated.end()) return;
  CHECK(told->from == from);
  CHECK(told->to == now->scalar(p));
  CHECK(told->standard_error > 0);
  const bool phase = kDriveEffectTraits[now->effect].search[p].role == EffectRole::phase;
  CHECK(std::abs(phase ? now->scalar(p) - off.is[p] : now->scalar(p) / off.is[p] - 1) < off.within);
}

/// The file's ripple is not there: its size goes, its order and its phase stay.
void not_there() {
  random_axis::Between between{std::mt19937_64(11)};
  const DriveSimulatorConfig machine = random_axis::draw(between, 11);
  DriveModelConfig file = machine.drive;
  file.effects.settings[file.effects.count++] =
      setting("torque-ripple", {4, 0.2 * file.coulomb, 1});
  const DriveData data = random_axis::record(machine, file, random_axis::moves());
  const auto out = reconcile_drive(data, {});
  CHECK(out.has_value());
  if (!out) return;
  CHECK(out->report.effects.empty());
  for (const Recalibrated& c : out->report.recalibrated)
    CHECK(c.parameter.find("torque-ripple") == std::string::npos);
}

}  // namespace

int main() {
  recalibrated(5, {"torque-ripple", {4, 30, 0.4}, {4, 30, 2.0}, 2, 0.05});
  recalibrated(6, {"flexible-coupling", {45, 0.05, 0.5}, {49, 0.05, 0.5}, 0, 0.02});
  recalibrated(7, {"flexible-coupling", {45, 0.05, 0.5, 0.6}, {45, 0.05, 0.5}, 3, 0.1});
  recalibrated(8, {"stribeck-friction", {40, 0.006}, {40, 0.009}, 1, 0.1});
  not_there();
  return check::done();
}
