// Torque per ampere over speed and current, against the laws written out with the standard library.
#include <cmath>
#include <vector>

#include "check.hpp"
#include "effects_by_hand.hpp"

using namespace servosense;
using namespace effect_test;

namespace {

constexpr double kPeriod = 125e-6;

DriveFacts facts() {
  DriveFacts f;
  f.sample_period_s = kPeriod;
  f.effort_per_ampere = 0.5;
  return f;
}

/// What acts of 10 Nm at a steady speed.
template <typename Real>
double at_speed(FieldWeakening<Real>& effect, double speed) {
  MotionState<Real> m;
  m.increment = static_cast<Real>(speed * kPeriod);
  double acting = 0;
  for (int i = 0; i < 400; ++i) acting = static_cast<double>(effect.acting_effort(Real(10), m));
  return acting;
}

/// Of 1/1024 in the exponent, at eight times base speed: 1e-3 of the torque.
template <typename Real>
void laws() {
  for (const double n : {0.0, 0.37, 1.0, 1.5, 2.0, 3.0}) {
    auto effect = made<FieldWeakening<Real>>({{200}, {n}, {}}, facts());
    for (const double speed : {-1600.0, -300.0, 0.0, 150.0, 199.0, 201.0, 400.0, 1000.0, 1600.0}) {
      const double law = 10 * std::pow(std::fmin(1, 200 / std::fmax(std::abs(speed), 1e-9)), n);
      effect.reset();
      CHECK_NEAR(at_speed(effect, speed), law, 1.5e-3 * law);
    }
  }
  auto untold = made<FieldWeakening<Real>>({{200}, {}, {}}, facts());
  CHECK_NEAR(at_speed(untold, 500), 4, 1e-5);
}

template <typename Real>
void tables() {
  auto effect = made<FieldWeakening<Real>>({{}, {}, {100, 1, 200, 1.5, 500, 4}}, facts());
  const double expected[][2] = {{50, 1},     {100, 1}, {150, 1.25}, {200, 1.5},
                                {350, 2.75}, {500, 4}, {620, 5},    {-150, 1.25}};
  for (const auto& [speed, ratio] : expected) {
    effect.reset();
    CHECK_NEAR(at_speed(effect, speed), 10 / ratio, 1e-4);
  }
}

/// A speed that grows steadily is followed without a lag: an error would look like friction.
void no_lag() {
  auto effect = made<FieldWeakening<double>>({{100}, {1}, {}}, facts());
  double speed = 300;
  constexpr double kAcceleration = 2000;
  MotionState<double> m;
  for (int i = 0; i < 2000; ++i) {
    m.increment = speed * kPeriod;
    (void)effect.acting_effort(10, m);
    speed += kAcceleration * kPeriod;
  }
  CHECK_NEAR(effect.state().speed, speed - kAcceleration * kPeriod, 1e-6);
}

void saturation() {
  auto effect = made<TorqueSaturation<double>>({{8}, {0.25}}, facts());  // from 4 Nm on
  const MotionState<double> m;
  CHECK_NEAR(effect.acting_effort(3, m), 3, 1e-15);
  CHECK_NEAR(effect.acting_effort(-4, m), -4, 1e-15);
  CHECK_NEAR(effect.acting_effort(8, m), 7, 1e-15);
  CHECK_NEAR(effect.acting_effort(-6, m), -5.5, 1e-15);
}

/// What is no law is refused, with its key.
void refusals() {
  const auto refused = [](const char* name, Lists lists, const DriveFacts& drive = facts()) {
    const DriveEffectsConfig c = config(name, lists, kPeriod);
    return !DriveEffects<double>::validate(c, drive).ok();
  };
  CHECK(refused("field-weakening", {{}, {}, {}}));
  CHECK(refused("field-weakening", {{200}, {}, {100, 1, 200, 2}}));
  CHECK(refused("field-weakening", {{}, {}, {100, 1}}));
  CHECK(refused("field-weakening", {{}, {}, {100, 1, 200}}));
  CHECK(refused("field-weakening", {{}, {}, {100, 2, 200, 3}}));
  CHECK(refused("field-weakening", {{}, {}, {200, 1, 100, 3}}));
  CHECK(!refused("field-weakening", {{}, {}, {100, 1, 200, 3}}));
  CHECK(!refused("field-weakening", {{200}, {1}, {}}));
  DriveFacts torque = facts();
  torque.effort_per_ampere = 0;
  CHECK(refused("torque-saturation", {{5}, {0.2}}, torque));
  CHECK(!refused("torque-saturation", {{5}, {0.2}}));
}

/// Taken out where no current is reported; the rest stays, in its order.
void taken_out() {
  DriveEffectsConfig c;
  for (const char* name :
       {"constant-load", "field-weakening", "quadratic-drag", "torque-saturation"})
    c.settings[c.count++].effect = drive_effect_index(name);
  CHECK(take_out_effects_of_current(c) == 2);
  CHECK(c.count == 2 && c.find("constant-load") == &c.settings[0] &&
        c.find("quadratic-drag") == &c.settings[1]);
}

}  // namespace

int main() {
  laws<double>();
  laws<float>();
  tables<double>();
  tables<float>();
  no_lag();
  saturation();
  refusals();
  taken_out();
  return check::done();
}
