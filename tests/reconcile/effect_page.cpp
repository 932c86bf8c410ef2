// Built by effect_page.sh with the effect that docs/effects.md adds: the simulator exerts it, the
// workflow's candidates know it, and the decision names it.
#include <cstdio>
#include <memory>

#include "catalogue_cases.hpp"
#include "check.hpp"
#include "reconcile/drive/candidates/candidates.hpp"
#include "reconcile/drive/comparison_band.hpp"
#include "servosense/reconcile/decide.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

/// The comparison of forces in its plainest form: inertia, friction, timing, and all candidates.
Decision decision_on(const DriveData& data) {
  const DriveSignals signals(data, comparison_corner(data));
  Problem p;
  p.unit = "N";
  p.row_period_s = signals.row_period_s();
  p.noise_bandwidth_hz = signals.corner_hz;
  p.usable = signals.usable;
  p.target = signals.effort_rows(0);
  Column timing = signals.effort_rows(-5e-4);
  const Column later = signals.effort_rows(5e-4);
  for (std::size_t i = 0; i < p.rows(); ++i) {
    timing[i] = (timing[i] - later[i]) * 1e3;
    p.time_s.push_back(static_cast<double>(i) * p.row_period_s);
    p.held_out.push_back(3 * i > 2 * p.rows());
  }
  const DriveModelConfig& m = data.model;
  p.known = {{"inertia", signals.acceleration_rows, m.inertia},
             {"viscous", signals.velocity_rows, m.viscous},
             {"coulomb", signals.to_rows(signals.direction(m.friction_knee)), m.coulomb},
             {"timing", timing, 0, false}};
  p.coordinates = {{"velocity", "m/s", signals.velocity_rows, {}, 0, 24},
                   {"position", "m", signals.position_rows, {}, 0, 24}};
  DriveSituation s;
  s.data = &data;
  s.signals = std::make_shared<DriveSignals>(signals);
  s.model = s.acting = m;
  s.top_speed = 0.4;
  s.duration_s = p.time_s.back();
  s.travel = s.high = 0.25;
  Options options;
  options.null_records = 4;
  return decide(p, drive_candidates(s), options);
}

}  // namespace

int main() {
  catalogue::Machine m = catalogue::axis(1);
  CHECK(decision_on(catalogue::record(m, catalogue::axis_motion())).report.effects.empty());
  const double hidden = 300;  // N/m2
  catalogue::hide(m, catalogue::setting("chain-load", {{hidden}}));
  const Decision d = decision_on(catalogue::record(m, catalogue::axis_motion()));
  CHECK(d.report.effects.size() == 1);
  for (const FoundEffect& e : d.report.effects) {
    std::printf("  %s, %s = %.4g, confidence %.2f\n", e.name.c_str(), e.parameters[0].key.c_str(),
                e.parameters[0].values[0], e.confidence);
    CHECK_TEXT(e.name, "chain-load");
    CHECK_TEXT(e.parameters[0].key, "coefficient_N_per_m2");
    CHECK_NEAR(e.parameters[0].values[0], hidden, 0.05 * hidden);
  }
  return check::done();
}
