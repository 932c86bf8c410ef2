// Where a drive rests, and friction may hold any force, the workflow does not compare. A short stop
// between moves is a rest, too; turning round is none, though the drive comes back to where it was.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "check.hpp"
#include "counted_motion.hpp"
#include "reconcile/drive/signals.hpp"
#include "servosense/core/units.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kMove_s = 0.2, kStop_s = 0.08, kWay_m = 2e-3;
constexpr double kPhase_s = kMove_s + kStop_s;

/// To and fro with a stop at each end.
double with_stops(double t) {
  const double at = std::fmod(t, 2 * kPhase_s);
  const double moved = std::clamp(std::fmod(at, kPhase_s) / kMove_s, 0.0, 1.0);
  const double way = 0.5 * (1 - std::cos(0.5 * kTwoPi * moved));
  return kWay_m * (at < kPhase_s ? way : 1 - way);
}
double without_stops(double t) { return 0.5 * kWay_m * (1 - std::cos(0.5 * kTwoPi * t / kMove_s)); }

/// Share of `resting` among the working steps in which `chosen(t)`.
template <typename Position, typename Chosen>
double share_at_rest(Position position, Chosen chosen) {
  const DriveSignals signals(counted_motion(position, 6, 5e-4, 5e-8), 80);
  double all = 0, rests = 0;
  for (std::size_t i = 0; i < signals.time_s.size(); ++i) {
    const double t = signals.time_s[i];
    if (t < 1 || t > 5 || !chosen(t)) continue;
    all += 1;
    rests += signals.resting[i] ? 1 : 0;
  }
  CHECK(all > 0);
  return rests / std::max(1.0, all);
}

}  // namespace

int main() {
  // 80 ms of a stop, 50 ms looked at: its middle.
  const double stop = share_at_rest(with_stops, [](double t) {
    const double at = std::fmod(t, kPhase_s) - kMove_s;
    return at > 0.03 && at < kStop_s - 0.03;
  });
  const double moving = share_at_rest(with_stops, [](double t) {
    const double at = std::fmod(t, kPhase_s);
    return at > 0.05 && at < kMove_s - 0.05;
  });
  const double turning = share_at_rest(without_stops, [](double /*t*/) { return true; });
  std::printf("at rest: %.2f of the stops, %.2f of the moves, %.2f of turning round\n", stop,
              moving, turning);
  CHECK(stop > 0.99);
  CHECK(moving == 0);
  CHECK(turning == 0);
  return check::done();
}
