// Teeth counted in a torque, against cutters followed tooth by tooth: every number of teeth cut in
// place of every other, with run-out, noise and helix, in side cuts and slots. What the lines are
// expected to be is integrated here, slice by slice.
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdio>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/monitors/tooth_count.hpp"

namespace {

using namespace servosense;

struct Cutter {
  unsigned teeth = 0;
  double from = 0, to = 0;  // angles of the cut
  double lag = 0;           // of the edge over the depth
  std::vector<double> load;
};

/// Torque with the first tooth's tip at an angle.
double torque(const Cutter& c, double angle) {
  constexpr int kSlices = 24;
  double sum = 0;
  for (unsigned j = 0; j < c.teeth; ++j)
    for (int i = 0; i < kSlices; ++i) {
      const double at =
          std::remainder(angle + kTwoPi * j / c.teeth - c.lag * (i + 0.5) / kSlices - kPi, kTwoPi) +
          kPi;
      if (at > c.from && at < c.to) sum += c.load[j] * std::sin(at) / kSlices;
    }
  return sum;
}

ToothLines<double> lines_of(Cutter c) {
  ToothLines<double> lines;
  c.teeth = 1;
  c.load = {1};
  constexpr int kSteps = 3600;
  for (std::size_t k = 1; k <= kToothLines; ++k) {
    std::complex<double> line;
    double mean = 0;
    for (int i = 0; i < kSteps; ++i) {
      const double angle = kTwoPi * i / kSteps, m = torque(c, angle);
      mean += m;
      line += m * std::polar(1.0, -static_cast<double>(k) * angle);
    }
    const double share = std::abs(line) / mean;
    if (share > 0.05) lines.share[k - 1] = share;
  }
  return lines;
}

struct Found {
  int runs = 0, right = 0, silent = 0, wrong = 0;
};

}  // namespace

int main() {
  std::mt19937 random(5);
  const auto within = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  // As told to be one of another number; as its own, never said to be another.
  Found other, own, slots;
  for (int n = 0; n < 600; ++n) {
    Cutter c;
    const auto any = [&] { return static_cast<unsigned>(within(1, 7)); };
    const unsigned told = any();
    const bool same = n % 2 == 0, slot = n % 10 >= 8;
    c.teeth = told;
    while (!same && c.teeth == told) c.teeth = any();
    const double width = within(0.2, 1.2);
    c.from = slot ? 0 : within(0, 1) < 0.5 ? 0 : kPi - width;
    c.to = slot ? kPi : c.from + width;
    c.lag = within(0, 0.4);
    const double runout = within(0, 0.5);
    for (unsigned j = 0; j < c.teeth; ++j) c.load.push_back(1 + within(-runout, runout));
    const ToothLines<double> lines = lines_of(c);
    ToothCountConfig config;
    config.teeth = told;
    ToothCount<double> count;
    count.configure(config);
    count.begin(&lines);
    std::normal_distribution<double> noise(0, within(0.02, 0.3));
    const double step = kTwoPi / within(150, 400);
    double angle = within(0, kTwoPi);
    for (int i = 0; i < 40000; ++i) {
      angle = std::fmod(angle + step, kTwoPi);
      count.add(torque(c, angle) + noise(random), step);
      if (i % 400 == 0) count.judge();
    }
    Found& found = slot ? slots : same ? own : other;
    ++found.runs;
    found.silent += count.told() == 0;
    found.right += count.told() == c.teeth;
    found.wrong += count.other() && count.told() != c.teeth;
  }
  for (const auto& [name, f] : {std::pair{"side cuts, another number", other},
                                std::pair{"side cuts, its own", own}, std::pair{"slots", slots}})
    std::printf("  %-28s of %3d: right %3d, not told %3d, wrong %d\n", name, f.runs, f.right,
                f.silent, f.wrong);
  CHECK(own.wrong == 0 && other.wrong == 0 && slots.wrong == 0);
  CHECK(10 * other.right >= 9 * other.runs);
  return check::done();
}
