// Effects on effort and angle: delay, lag, ripple, cyclic errors, against closed forms.
#include <algorithm>

#include "check.hpp"
#include "effects_by_hand.hpp"

using namespace effect_test;

namespace {

constexpr double kPeriod = 125e-6;

template <typename Real>
void delay() {
  for (const double samples : {0.0, 0.4, 1.0, 7.0, 20.25, 253.5}) {
    auto effect = made<TransportDelay<Real>>({{samples * kPeriod}});
    // Exact for a ramp, at any fraction. Before history begins, its first value.
    double worst = 0;
    for (int n = 0; n < 1000; ++n) {
      const double out = static_cast<double>(effect.acting_effort(static_cast<Real>(3 + n), {}));
      if (n >= 254) worst = std::max(worst, std::abs(out - (3 + n - samples)));
      if (n <= samples) CHECK_NEAR(out, 3, 0.5 * n + 1e-6);
    }
    CHECK_NEAR(worst, 0, 1e-4);
  }
  // A sine at a thirtieth of the sample rate keeps its amplitude within half a percent.
  auto effect = made<TransportDelay<Real>>({{10.5 * kPeriod}});
  const double w = kTwoPi / 30;
  double worst = 0;
  for (int n = 0; n < 600; ++n) {
    const double out =
        static_cast<double>(effect.acting_effort(static_cast<Real>(std::sin(w * n)), {}));
    if (n > 60) worst = std::max(worst, std::abs(out - std::sin(w * (n - 10.5))));
  }
  CHECK_BETWEEN(worst, 1e-3, 0.0055);
  DriveFacts facts;
  CHECK(TransportDelay<float>::validate(setting("transport-delay", {{254 * kPeriod}}), facts).ok());
  CHECK(
      !TransportDelay<float>::validate(setting("transport-delay", {{256 * kPeriod}}), facts).ok());
}

// Response of du/dt = w (r - u) to a step that is linear over one sample, and to a ramp.
template <typename Real>
void lag(double bandwidth_hz, double tolerance) {
  const double w = kTwoPi * bandwidth_hz;
  auto step = made<CurrentLoopLag<Real>>({{bandwidth_hz}});
  auto ramp = made<CurrentLoopLag<Real>>({{bandwidth_hz}});
  const auto ramp_response = [&](double t) { return t + std::expm1(-w * t) / w; };
  for (int n = 0; n < 400; ++n) {
    const double t = n * kPeriod;
    const double s = static_cast<double>(step.acting_effort(n > 0 ? Real(1) : Real(0), {}));
    const double r = static_cast<double>(ramp.acting_effort(static_cast<Real>(t), {}));
    if (n == 0) continue;
    CHECK_NEAR(s, (ramp_response(t) - ramp_response(t - kPeriod)) / kPeriod, tolerance);
    CHECK_NEAR(r, ramp_response(t), tolerance * 0.05);
  }
}

template <typename Real>
void ripple(double tolerance) {
  auto effect = made<TorqueRipple<Real>>({{1, 7, 2.5, 41.37}, {3, 1, 0.5, 0.25}, {0.3, -2, 9, 1}});
  const auto expected = [](double turns) {
    const double a = kTwoPi * turns;
    return 3 * std::sin(a + 0.3) + std::sin(7 * a - 2) + 0.5 * std::sin(2.5 * a + 9) +
           0.25 * std::sin(41.37 * a + 1);
  };
  Path<Real> path;
  double worst = 0;
  // A thousand turns out and back: broken orders keep their place.
  for (int n = 0; n <= 200000; ++n) {
    const double turns = 1000 * std::sin(kPi * n / 200000.0) + 0.01 * std::sin(0.37 * n);
    const double y = static_cast<double>(effect.force(path.to(turns * path.unit_per_turn)));
    worst = std::max(worst, std::abs(y - expected(turns)));
  }
  CHECK_NEAR(worst, 0, tolerance);
  using Effects = DriveEffects<double>;
  CHECK(!Effects::validate(config("torque-ripple", {{1, 2}, {3}, {0, 0}})).ok());
  CHECK(!Effects::validate(config("torque-ripple", {{1, 2}, {3, 3}, {0}})).ok());
  CHECK(!Effects::validate(config("torque-ripple", {{1}, {-3}, {0}})).ok());
}

template <typename Real>
void cyclic_errors(double tolerance) {
  DriveFacts facts;
  facts.unit_per_turn = 0.016;
  auto disc = made<EncoderEccentricity<Real>>({{1e-3}, {-7.1}}, facts);
  auto screw = made<LeadError<Real>>({{4e-6, 1e-6}, {1, 2}, {-3e-5}, {0.4, 2}}, facts);
  auto sines = made<LeadError<Real>>({{4e-6}, {1}, {0}}, facts);  // without phases
  Path<Real> path;
  for (int n = 0; n < 3000; ++n) {
    const double x = 1.1e-4 * n - 0.1;
    const double a = kTwoPi * x / 0.016;
    const MotionState<Real>& m = path.to(x);
    CHECK_NEAR(static_cast<double>(disc.position_error(m)),
               1e-3 * 0.016 / kTwoPi * std::sin(a - 7.1), 2.5e-6 * tolerance);
    CHECK_NEAR(static_cast<double>(screw.position_error(m)),
               -3e-5 * x + 4e-6 * std::sin(a + 0.4) + 1e-6 * std::sin(2 * a + 2), 1e-5 * tolerance);
    CHECK_NEAR(static_cast<double>(sines.position_error(m)), 4e-6 * std::sin(a), 4e-6 * tolerance);
  }
  // An encoder on a drive whose turn is not known cannot be eccentric.
  CHECK(DriveEffects<Real>::validate(config("encoder-eccentricity", {{1e-3}, {0}})).ok());
  CHECK(!DriveEffects<Real>::validate(config("encoder-eccentricity", {{1e-3}, {0}}), {}).ok());
}

}  // namespace

int main() {
  delay<float>();
  delay<double>();
  for (const double hz : {0.01, 20.0, 600.0, 20000.0}) {
    lag<double>(hz, 1e-12);
    lag<float>(hz, 2e-6);
  }
  // Errors of the turn angle: 1e-16 (1e-7 in float) of a turn times the highest order; of broken
  // orders one rounding a turn for 2000 turns.
  ripple<double>(2e-9);
  ripple<float>(2e-3);
  cyclic_errors<double>(1e-9);
  cyclic_errors<float>(3e-6);
  return check::done();
}
