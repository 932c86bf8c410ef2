// A soft coupling whose load rubs, as on guideways: friction winds the spring up at each reversal,
// which looks like backlash or a long bristle. It is to be named for what it is, wherever friction
// acts.
#include <cmath>
#include <string>

#include "check.hpp"
#include "drive_under_control.hpp"
#include "servosense/reconcile/drive.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

void named(double resonance_hz, double share, double rubbing, unsigned seed) {
  DriveUnderControl axis = axis_under_control();
  axis.noise = 1;
  axis.length_s = 20;
  axis.seed = seed;
  axis.resonance_hz = resonance_hz;
  axis.damping_ratio = 0.03;
  axis.load_share = share;
  axis.rubbing_share = rubbing;
  const auto out = reconcile_drive(record_of(axis, 5e-4), Options{});
  CHECK(out.has_value());
  if (!out) return;
  CHECK(out->report.effects.size() == 1);
  for (const FoundEffect& e : out->report.effects) {
    CHECK(e.name == "flexible-coupling");
    if (e.name != "flexible-coupling") continue;
    const std::string what = "friction at the load " + std::to_string(rubbing);
    for (const NamedValue& p : e.parameters) {
      check::figure(what + ": " + p.key, p.values[0]);
      if (p.key == "resonance_hz") CHECK_NEAR(p.values[0], resonance_hz, 0.15 * resonance_hz);
      if (p.key == "mass_share") CHECK_NEAR(p.values[0], share, 0.15 * share);
      if (p.key == "friction_share") CHECK_NEAR(p.values[0], rubbing, 0.2);
    }
    check::figure(what + ": gap before", out->report.gap_before);
    check::figure(what + ": gap after", out->report.gap_after);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const unsigned seeds = check::nightly(argc, argv) ? 2 : 1;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    named(40, 0.45, 0.9, seed);
    named(45, 0.4, 0.5, seed);
    named(40, 0.45, 0, seed);
  }
  return check::done();
}
