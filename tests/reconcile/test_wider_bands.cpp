// A coarse encoder keeps the comparison below the mode of a soft coupling. The record shows the
// mode all the same, in a wider band, and shows none where there is none.
#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "check.hpp"
#include "drive_under_control.hpp"
#include "reconcile/drive/candidates/candidates.hpp"
#include "reconcile/drive/comparison_band.hpp"
#include "reconcile/drive/signals.hpp"
#include "servosense/core/units.hpp"
#include "servosense/reconcile/drive.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kPeriod = 5e-4;
constexpr double kShare = 0.35;

/// `resonance_hz`: of the free pair; 0: one mass.
DriveData under_control(double resonance_hz, double quantum, unsigned seed) {
  DriveUnderControl axis = axis_under_control();
  axis.quantum = quantum;
  axis.noise = 0.5;
  axis.seed = seed;
  axis.resonance_hz = resonance_hz;
  axis.damping_ratio = 0.04;
  axis.load_share = resonance_hz > 0 ? kShare : 0;
  return record_of(axis, kPeriod);
}

void a_mode_beyond_the_band() {
  constexpr double kResonance = 85, kQuantum = 4e-7;
  const DriveData d = under_control(kResonance, kQuantum, 3);
  const double held = kResonance * std::sqrt(1 - kShare);
  check::figure("corner", comparison_corner(d), "Hz");
  check::figure("motor held, the load swings at", held, "Hz");
  CHECK(1.3 * comparison_corner(d) < held);
  DriveData second = under_control(kResonance, kQuantum, 8);
  second.source = "other.csv";
  const auto out = reconcile_drive(d, {}, &second);
  CHECK(out.has_value());
  if (!out) return;
  const Report& r = out->report;
  CHECK(r.effects.size() == 1);
  if (r.effects.size() != 1) return;
  const FoundEffect& e = r.effects[0];
  CHECK(e.name == "flexible-coupling");
  // A tenth: the encoder's noise is as large as the motion there.
  CHECK_NEAR(e.parameters[0].values[0] / kResonance, 1.0, 0.1);
  CHECK_NEAR(e.parameters[2].values[0] / kShare, 1.0, 0.15);
  // Nothing else is missing: the report is that of the band, and the gap shrinks in it.
  CHECK(e.gap_after < 0.5 * e.gap_before);
  CHECK(r.gap_before == e.gap_before && r.gap_after == e.gap_after);
  CHECK(r.summary.find("the gap shrinks from") != std::string::npos);
  // On the second record, too: the same drive, the same band, about the same gaps.
  CHECK(r.second.refuted.empty());
  CHECK_NEAR(r.second.gap_before / r.gap_before, 1.0, 0.3);
  CHECK_NEAR(r.second.gap_after / r.gap_after, 1.0, 0.3);
  CHECK(r.summary.find("on the second record it shrinks from") != std::string::npos);
  CHECK(!r.proof.free_run.horizons.empty());
  for (const FreeRun::Horizon& h : r.proof.free_run.horizons) {
    check::figure("free run, before", 1e6 * h.position.before, "um");
    check::figure("free run, after", 1e6 * h.position.after, "um");
    check::figure("free run, noise alone", 1e6 * h.position.floor, "um");
  }
  CHECK(out->model.effects.find("flexible-coupling") != nullptr);
  CHECK(std::any_of(r.remarks.begin(), r.remarks.end(), [](const std::string& s) {
    return s.find("beyond the") != std::string::npos;
  }));
}

/// A ripple is free in amplitude and phase there, and the mode still shows.
void a_mode_beside_a_ripple() {
  DriveData d = under_control(85, 4e-7, 3);
  for (auto& s : d.samples)
    s.effort += 20 * std::sin(12 * kTwoPi / d.model.unit_per_turn * s.position);
  const auto out = reconcile_drive(d, {});
  CHECK(out.has_value());
  if (!out) return;
  const Report& r = out->report;
  CHECK(r.effects.size() == 2);
  if (r.effects.size() != 2) return;
  CHECK(r.effects[0].name == "torque-ripple");
  CHECK(r.effects[1].name == "flexible-coupling" && r.effects[1].gap_band_hz > 0);
}

/// A mode beside another effect: each with the gap of its own band, on the second record as well.
void each_in_its_band() {
  Report r;
  r.gap_unit = "N";
  r.second.trace = "other.csv";
  r.second.gap_before = 7;
  r.second.gap_after = 3;
  FoundEffect load, mode;
  load.name = "constant-load";
  mode.name = "flexible-coupling";
  mode.gap_band_hz = 90;
  r.effects = {load, mode};
  r.second.effects = {{"constant-load", 7, 3}, {"flexible-coupling", 11, 5, true, 90}};
  const std::string both = summary_of(r, "x");
  CHECK(both.find("second record it shrinks from 7 to 3 N, up to 90 Hz from 11 to 5 N") !=
        std::string::npos);
}

void no_mode() {
  const auto out = reconcile_drive(under_control(0, 4e-7, 4), {});
  CHECK(out.has_value());
  if (out) CHECK(out->report.effects.empty());
}

/// Noise that a loop answers looks like a load on a spring without a swing. Couplings have damping
/// ratios of some hundredths.
void what_does_not_swing_is_no_mode() {
  const DriveData d = under_control(0, 4e-7, 5);
  const DriveSignals signals(d, 40);
  DriveSituation situation;
  situation.data = &d;
  situation.signals = std::make_shared<DriveSignals>(signals);
  situation.model = situation.acting = d.model;
  situation.top_speed = 0.15;
  const auto all = drive_candidates(situation);
  const auto c = std::find_if(all.begin(), all.end(),
                              [](const Candidate& e) { return e.name == "flexible-coupling"; });
  CHECK(c != all.end());
  if (c == all.end()) return;
  const double share[] = {0.4}, presliding = d.model.friction_knee;
  for (const double damping : {0.02, 0.1, 0.2})
    CHECK(c->meaning(std::vector<double>{50, damping, 0, presliding}, share).violation.empty());
  CHECK(!c->meaning(std::vector<double>{50, 0.3, 0, presliding}, share).violation.empty());
}

}  // namespace

int main() {
  what_does_not_swing_is_no_mode();
  each_in_its_band();
  a_mode_beyond_the_band();
  a_mode_beside_a_ripple();
  no_mode();
  return check::done();
}
