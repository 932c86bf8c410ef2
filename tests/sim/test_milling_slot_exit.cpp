// A slot cutter leaves the work: largest difference of successive tooth averages (Tarng 1988, eq.
// 4-1 to 4-4, nine samples a tooth period) against the same sum worked out sample by sample.
//
// A sample at phi and its mirror image at pi - phi reach the far face at almost the same feed. They
// drop out of the sum in one tooth period or in two, as the face falls against the feed marks, so
// the figure depends on the length of the work modulo the feed per tooth: 110.5, 115.8, 119.4,
// 120.3 or 121.3 N for the reference cut. The reference of 120.3 N is one of them; a block of
// exactly 100 mm, first touched at the start of a tooth period, gives 110.5 N. Each is met for
// itself, to the accuracy of the force.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <set>

#include "check.hpp"
#include "servosense/sim/milling_simulator.hpp"

using namespace servosense;

namespace {

// Table 4.1 as a full slot; angle 0 of tooth 1 at the first touch.
constexpr int kTeeth = 8, kSamples = 9, kStepsPerSample = 99;
constexpr double kRadius = 50.8e-3, kFeed = 0.254e-3, kDepth = 1.27e-3, kKt = 1500e6, kC = 0.5263;

struct Peaks {
  double entry = 0, exit = 0;
};

/// `average(j)` of tooth period j = 0, 1, 2... until the cutter is past the work.
template <typename Average>
Peaks peaks_of(double length_m, const Average& average) {
  Peaks peaks;
  double before = 0;
  const int periods = static_cast<int>((length_m + 2.2 * kRadius) / kFeed);
  for (int j = 0; j < periods; ++j) {
    const double now = average(j);
    double& side = (j + 1) * kFeed < (length_m + kRadius) / 2 ? peaks.entry : peaks.exit;
    side = std::max(side, std::abs(now - before));
    before = now;
  }
  CHECK_NEAR(before, 0, 1e-9);  // out of the work again
  return peaks;
}

Peaks point_by_point(double length_m) {
  return peaks_of(length_m, [&](int j) {
    double fx = 0, fy = 0;
    for (int i = 0; i < kSamples; ++i) {
      const double turned = j + (i + 0.5) / kSamples;  // tooth periods, to the middle of the bin
      for (int tooth = 0; tooth < kTeeth; ++tooth) {
        const double theta = std::fmod((turned + tooth) / kTeeth, 1.0) * kTwoPi;
        const double tip = turned * kFeed - kRadius + kRadius * std::sin(theta);
        if (theta > kPi || tip < 0 || tip > length_m) continue;
        const double ft = kKt * kDepth * kFeed * std::sin(theta) / kSamples;
        fx += ft * std::cos(theta) + kC * ft * std::sin(theta);
        fy += -ft * std::sin(theta) + kC * ft * std::cos(theta);
      }
    }
    return std::hypot(fx, fy);
  });
}

Peaks simulated(double length_m) {
  MillingSimulation s;
  s.tool.diameter_m = 2 * kRadius;
  s.tool.teeth = kTeeth;
  s.tool.force.tangential_coefficient_N_per_m2 = kKt;
  s.tool.force.radial_ratio = kC;
  s.cut = {600, kFeed, kDepth, 2 * kRadius, MillingDirection::slot};
  s.workpiece.length_m = length_m;
  s.start = MillingStart::entry;
  s.step_s = 60.0 / 600 / kTeeth / (kSamples * kStepsPerSample);
  auto simulator = MillingSimulator::create(s);
  if (!simulator) {
    check::fail(__FILE__, __LINE__) << simulator.error().sentence << '\n';
    std::exit(check::done());
  }
  return peaks_of(length_m, [&](int) {
    double fx = 0, fy = 0;
    for (int i = 0; i < kSamples * kStepsPerSample; ++i) {
      const MillingStep& n = simulator->step();
      if (i % kStepsPerSample != kStepsPerSample / 2) continue;
      fx += n.fx_N / kSamples;
      fy += n.fy_N / kSamples;
    }
    return std::hypot(fx, fy);
  });
}

}  // namespace

int main() {
  std::set<int> tenths;
  double worst = 0;
  for (int i = 0; i < 20; ++i) {
    const double length = 0.1 + i / 20.0 * kFeed;
    const Peaks slow = point_by_point(length), found = simulated(length);
    // The simulator's engagement follows the feed in steps of 1/128 of a feed per tooth, and a
    // tooth crosses the edge of it during a step, in which the face moves by as much against the
    // feed marks: together less than a fiftieth. A length so near to a change may show either
    // figure.
    double off = 1e9;
    for (const double shift : {-0.02, 0.0, 0.02})
      off = std::min(off, std::abs(found.exit - point_by_point(length + shift * kFeed).exit));
    worst = std::max({worst, off, std::abs(found.entry - slow.entry)});
    CHECK_NEAR(found.entry, slow.entry, 1e-4 * slow.entry);
    CHECK_NEAR(off, 0, 1e-4 * slow.exit);
    tenths.insert(static_cast<int>(std::lround(10 * found.exit)));
  }
  check::figure("worst difference to the sum sample by sample", worst, "N");
  for (const int exit : tenths) check::figure("exit, by the length of the work", exit / 10.0, "N");
  CHECK((tenths == std::set{1105, 1158, 1194, 1203, 1213}));
  // The reference values of Tarng's cut, and a block of 100 mm to the dot.
  const Peaks block = simulated(0.1), reference = simulated(0.1 + 0.4 * kFeed);
  check::figure("exit, 100 mm", block.exit, "N");
  CHECK_NEAR(block.entry, 120.5, 0.1);
  CHECK_NEAR(block.exit, 110.5, 0.1);
  CHECK_NEAR(reference.exit, 120.3, 0.1);
  return check::done();
}
