// Friction that follows the speed, as simulators regularise it, over few reversals: what stands in
// for it there must not be carried to the reversals of another programme.
#include <cmath>
#include <cstdio>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/reconcile/drive.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kPeriod = 1e-3;

struct Move {
  double distance = 0, seconds = 1, rest_s = 0;
};

/// 540 kg and 630 N s/m; friction of `friction(v)`, 1 N of noise. The share of a move that is done
/// at u of its time: 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7, at rest with no acceleration at both ends.
template <typename Friction>
DriveData record(const std::vector<Move>& moves, Friction friction) {
  DriveData d;
  d.sample_period_s = d.servo_period_s = kPeriod;
  d.model.inertia = 580;
  d.model.viscous = 590;
  d.model.coulomb = 190;
  d.model.unit_per_turn = 0.02;
  d.model.friction_knee = 1e-5;
  d.observer.drive = d.model;
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise;
  double from = 0, last = 0;
  for (const Move& m : moves) {
    for (double t = 0; t < m.seconds + m.rest_s; t += kPeriod) {
      const double u = std::min(t / m.seconds, 1.0), w = 1 - u;
      const double x =
          from + m.distance * u * u * u * u * (35 - 84 * u + 70 * u * u - 20 * u * u * u);
      const double v = m.distance / m.seconds * 140 * u * u * u * w * w * w;
      const double a = m.distance / (m.seconds * m.seconds) * 420 * u * u * w * w * (1 - 2 * u);
      const double seen = 2e-8 * std::round(x / 2e-8);
      DriveSample<double> s;
      s.increment = d.samples.empty() ? 0 : seen - last;
      last = seen;
      s.effort = 540 * a + 630 * v + friction(v) + noise(random);
      d.samples.push_back(s);
    }
    from += m.distance;
  }
  return d;
}

}  // namespace

int main() {
  std::vector<Move> moves;
  for (int lap = 0; lap < 2; ++lap)
    for (const Move& m :
         {Move{0.3, 1.4, 0.1}, Move{-0.1, 2.5}, Move{-0.002, 2.5}, Move{-0.198, 1.2, 0.1}})
      moves.push_back(m);
  for (const Move& m : {Move{0.02, 0.8}, Move{-0.001, 3}, Move{-0.019, 1.1, 0.2}, Move{0.25, 1.9},
                        Move{-0.004, 0.7}, Move{0.0005, 2}})
    moves.push_back(m);
  const auto outcome =
      reconcile_drive(record(moves, [](double v) { return 178 * std::tanh(v / 1e-4); }), {});
  CHECK(outcome.has_value());
  if (outcome) {
    const Report& r = outcome->report;
    std::printf("gap %.3g N, floor %.3g N, %zu effects\n", r.gap_before, r.floors.used,
                r.effects.size());
    CHECK(r.effects.empty());
    CHECK(r.gap_before < 3 * r.floors.used);
  }
  return check::done();
}
