// A sensor that rings, beside another effect: what rings down after a change of the feed is no part
// of the steady cut, and its frequency shows only in what the other effect leaves.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "check.hpp"
#include "cutting_record.hpp"
#include "servosense/reconcile/cutting.hpp"

namespace {

namespace reconcile = servosense::reconcile;
using cutting_generator::Cut;
using cutting_generator::kTau;
using cutting_generator::Program;

/// With a machine file that has all of it but the effects.
reconcile::Report report_of(const Cut& made, const Program& program) {
  const bool down = made.start_rad > 0;
  const double swept_rad = made.exit_rad - made.start_rad;
  servosense::MillingTool tool;
  tool.diameter_m = 2 * made.radius_m;
  tool.teeth = made.teeth;
  tool.helix_deg = made.helix_deg;
  tool.force.tangential_coefficient_N_per_m2 = made.kt;
  tool.force.radial_ratio = made.kr / made.kt;
  servosense::MillingCut given;
  given.spindle_speed_rpm = program.speed_rad_s * 60 / kTau;
  given.feed_per_tooth_m = program.feeds_m.front();
  given.axial_depth_m = made.depth_m;
  given.radial_immersion_m = made.radius_m * (1 - std::cos(swept_rad));
  given.direction = down ? servosense::MillingDirection::down : servosense::MillingDirection::up;
  const auto outcome = reconcile::reconcile_cutting(
      data_of(cutting_generator::generate(made, program), tool, given), {});
  CHECK(outcome.has_value());
  if (!outcome) return {};
  for (const reconcile::FoundEffect& e : outcome->report.effects)
    std::printf("%s, first parameter %g\n", e.name.c_str(), e.parameters[0].values[0]);
  return outcome->report;
}

const reconcile::FoundEffect* named(const reconcile::Report& r, const std::string& name) {
  const auto at = std::ranges::find(r.effects, name, &reconcile::FoundEffect::name);
  CHECK(at != r.effects.end());
  return at == r.effects.end() ? nullptr : &*at;
}

/// Thirteen waves a revolution, which 24 means do not show, and half a sample off from one to the
/// next: the first revolutions of each pass counted, so that the noise came out a seventh too large
/// and hundredths of the force were left that nothing explains.
void edge_force_behind_it() {
  Cut made;
  made.teeth = 2;
  made.helix_deg = 24.5;
  made.depth_m = 3.1e-3;
  made.exit_rad = 1.116;
  made.kt = 9e8;
  made.kr = 3.1e8;
  made.kte = 3370;
  made.kre = 2490;
  made.sensor_hz = 1385;
  made.sensor_damping = 0.01;
  const Program program{.feeds_m = {4.8e-5, 3.3e-5, 7e-5, 4.9e-5},
                        .speed_rad_s = 657.4,
                        .each_s = 0.22,
                        .noise_N = 1.7};
  const reconcile::Report r = report_of(made, program);
  CHECK(r.effects.size() == 2);
  if (const auto* sensor = named(r, "sensor-resonance"))
    CHECK_NEAR(sensor->parameters[0].values[0], made.sensor_hz, 0.01 * made.sensor_hz);
  if (const auto* edge = named(r, "edge-force"))
    CHECK_NEAR(edge->parameters[0].values[0], made.kte, 0.1 * made.kte);
  CHECK_BETWEEN(r.floors.lap, 0.95 * program.noise_N, 1.1 * program.noise_N);
  CHECK_BETWEEN(r.gap_after, 0.95 * program.noise_N, 1.2 * program.noise_N);
}

/// Forty waves a revolution of a tool with uneven teeth: scanned for before these were known, the
/// sensor rang at other frequencies, one of them beyond the samples.
void behind_uneven_teeth() {
  Cut made;
  made.radius_m = 0.01;
  made.helix_deg = 35.5;
  made.depth_m = 4.6e-3;
  made.start_rad = kTau / 2 - 1.634;
  made.exit_rad = kTau / 2;
  made.kt = 1.48e9;
  made.kr = 5.7e8;
  made.sensor_hz = 1098;
  made.sensor_damping = 0.015;
  made.angle_rad = {0, kTau / 4 - 0.047, kTau / 2 + 0.081, 3 * kTau / 4 + 0.088};
  const Program program{.feeds_m = {8e-5, 6e-5, 1.1e-4, 8e-5},
                        .speed_rad_s = 158.8,
                        .rate_hz = 20000,
                        .each_s = 0.6,
                        .noise_N = 11};
  const reconcile::Report r = report_of(made, program);
  CHECK(r.effects.size() == 2);
  named(r, "pitch-error");
  if (const auto* sensor = named(r, "sensor-resonance"))
    CHECK_NEAR(sensor->parameters[0].values[0], made.sensor_hz, 0.01 * made.sensor_hz);
  CHECK_BETWEEN(r.gap_after, 0.95 * program.noise_N, 1.1 * program.noise_N);
}

}  // namespace

int main() {
  edge_force_behind_it();
  behind_uneven_teeth();
  return check::done();
}
