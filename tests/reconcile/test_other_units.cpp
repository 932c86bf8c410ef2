// A record in other units is the same record: the same names, the same gaps in their unit.
#include <cmath>
#include <cstdio>
#include <string>

#include "check.hpp"
#include "drive_under_control.hpp"
#include "servosense/reconcile/drive.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

/// A mode within the band and a load that grows along the stroke.
DriveData recorded() {
  DriveUnderControl axis = axis_under_control();
  axis.noise = 2;
  axis.seed = 5;
  DriveData d = record_of(axis, 1e-3);
  double low = 1e300, high = -1e300;
  for (const auto& s : d.samples) {
    low = std::min(low, s.position);
    high = std::max(high, s.position);
  }
  for (auto& s : d.samples) s.effort += 12 * (s.position - low) / (high - low);
  return d;
}

DriveData scaled(DriveData d, double length, double force) {
  for (auto& s : d.samples) {
    s.increment *= length;
    s.position *= length;
    s.effort *= force;
  }
  d.start_position *= length;
  d.unit_per_count *= length;
  d.effort_per_unit *= force;
  d.model.inertia *= force / length;
  d.model.viscous *= force / length;
  d.model.coulomb *= force;
  d.model.unit_per_turn *= length;
  d.model.friction_knee *= length;
  d.observer.drive = d.model;
  return d;
}

}  // namespace

int main() {
  const DriveData metres = recorded();
  const auto here = reconcile_drive(metres, {});
  CHECK(here.has_value());
  if (!here) return check::done();
  CHECK(!here->report.effects.empty());
  constexpr double kTolerance = 1e-6;  // of rounding, through some hundred searches
  constexpr double kScales[][2] = {{1000, 0.6}, {1.7e-2, 40}};
  for (const auto& [length, force] : kScales) {
    const auto there = reconcile_drive(scaled(metres, length, force), {});
    CHECK(there.has_value());
    if (!there) continue;
    const Report &a = here->report, &b = there->report;
    std::printf("  %g, %g: %s | %s\n", length, force, a.summary.c_str(), b.summary.c_str());
    CHECK_NEAR(b.gap_nominal / force / a.gap_nominal, 1, kTolerance);
    CHECK_NEAR(b.gap_before / force / a.gap_before, 1, kTolerance);
    CHECK_NEAR(b.gap_after / force / a.gap_after, 1, kTolerance);
    CHECK_NEAR(there->model.friction_knee / length / here->model.friction_knee, 1, kTolerance);
    CHECK(a.effects.size() == b.effects.size());
    for (std::size_t k = 0; k < std::min(a.effects.size(), b.effects.size()); ++k)
      CHECK(a.effects[k].name == b.effects[k].name);
  }
  return check::done();
}
