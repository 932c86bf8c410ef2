// What agrees where it was fitted need not agree elsewhere: friction that is another one in the
// part kept for the proof is no agreement, however well the rest fits.
#include <cstdio>

#include "check.hpp"
#include "servosense/reconcile/drive.hpp"
#include "sine_motion.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

/// 60 N of friction, and another one in the last third.
Report report_of(double later_N) {
  const auto outcome = reconcile_drive(sine_axis([&](double t, double, double direction) {
                                         return (t < 12.6 ? 60 : later_N) * direction;
                                       }),
                                       {});
  CHECK(outcome);
  return outcome ? outcome->report : Report{};
}

}  // namespace

int main() {
  const Report same = report_of(60);
  CHECK(same.effects.empty());
  CHECK(same.verdict == Verdict::agrees && same.residual_white);
  const Report other = report_of(75);
  std::printf("gap %.3g N, floor %.3g N\n", other.gap_before, other.floors.used);
  CHECK(other.effects.empty());
  CHECK(other.gap_before > 5 * other.floors.used);
  CHECK(other.verdict == Verdict::unexplained && !other.residual_white);
  CHECK(other.residual_detail.find("something has changed") != std::string::npos);
  return check::done();
}
