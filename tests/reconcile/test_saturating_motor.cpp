// A motor that gives no more than it can while the effort that is asked of it is reported: what is
// missing looks like friction that grows with the load. But from nothing up to the limit it is
// none, and the force that friction follows is the one that has all of it.
#include "check.hpp"
#include "drive_under_control.hpp"

using namespace servosense;
using namespace servosense::reconcile;

int main() {
  DriveUnderControl axis = axis_under_control();
  axis.quantum = 1e-8;
  axis.noise = 0.3;
  axis.length_s = 10;
  axis.change_s = 0.5;
  for (const double limit : {0.0, 310.0}) {
    axis.limit = limit;  // N; 250 accelerate, 40 are friction
    const auto outcome = reconcile_drive(record_of(axis, 1e-3), {});
    CHECK(outcome.has_value());
    if (!outcome) continue;
    CHECK(outcome->report.effects.empty());
    CHECK_TEXT(name_of(outcome->report.verdict), limit > 0 ? "unexplained" : "agrees");
  }
  return check::done();
}
