// The drive model against its equation, written out by hand.
#include <limits>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/model/drive_model.hpp"

namespace {

using namespace servosense;

// Koike's Z axis (2016, tables 3-5, 3-6).
DriveModelConfig z_axis() {
  DriveModelConfig c;
  c.inertia = 380;
  c.viscous = 1968;
  c.coulomb = 240;
  c.constant_load = 175 * kGravity_m_s2;
  return c;
}

template <typename Real>
void resistance() {
  const double tolerance = 2000 * static_cast<double>(std::numeric_limits<Real>::epsilon());
  DriveModel<Real> model;
  CHECK(DriveModel<Real>::validate(z_axis()).ok());
  model.configure(z_axis());
  CHECK(model.inertia() == Real(380) && model.viscous() == Real(1968) && !model.has_load());
  MotionState<Real> m;
  const double load = 175 * kGravity_m_s2;
  CHECK_NEAR(static_cast<double>(model.resistance(m)), load, tolerance);  // at rest
  m.increment = Real(1e-6);
  CHECK_NEAR(static_cast<double>(model.resistance(m)), load + 240 * 0.2, tolerance);  // knee 5 um
  for (int n = 0; n < 10; ++n) model.resistance(m);
  CHECK(m.direction == Real(1));
  CHECK_NEAR(static_cast<double>(model.resistance(m)), load + 240, tolerance);
  m.increment = Real(-1e-6);
  for (int n = 0; n < 10; ++n) model.resistance(m);
  CHECK_NEAR(static_cast<double>(model.resistance(m)), load - 240, tolerance);
  CHECK(model.acting_effort(Real(12), m) == Real(12));
  model.reset();
  CHECK(model.resistance(m) > Real(load - 100));  // the friction is unwound
}

// correct() takes an error of the position reading out of position and increments alike.
void correction() {
  DriveModelConfig c = z_axis();
  c.unit_per_turn = 0.016;
  c.effects.count = 1;
  c.effects.settings[0].effect = drive_effect_index("lead-error");
  const double amplitude = 1e-5, order = 2, slope = 0.01;
  for (std::size_t p = 0; p < 3; ++p) c.effects.settings[0].parameters[p].count = 1;
  c.effects.settings[0].parameters[0].value[0] = amplitude;
  c.effects.settings[0].parameters[1].value[0] = order;
  c.effects.settings[0].parameters[2].value[0] = slope;
  CHECK(DriveModel<double>::validate(c).ok());
  DriveModel<double> model;
  model.configure(c);
  MotionState<double> m;
  model.restart(m);
  double last_true = -model.position_error(m);
  for (int n = 1; n < 200; ++n) {
    const double measured = 1e-4 * n;
    m.position = measured;
    m.increment = 1e-4;
    m.turn_angle_rad = std::fmod(kTwoPi * measured / 0.016, kTwoPi);
    MotionState<double> there = m;
    const double truth = measured - model.position_error(there);
    model.correct(m);
    CHECK_NEAR(m.position, truth, 1e-15);
    CHECK_NEAR(m.increment, truth - last_true, 1e-15);
    last_true = truth;
  }
  CHECK(std::abs(last_true - 1e-4 * 199) > 1e-5);  // there was something to correct
}

void refusals() {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  auto refused = [](auto change, const char* parameter) {
    DriveModelConfig c = z_axis();
    change(c);
    const Status s = DriveModel<float>::validate(c);
    CHECK(!s.ok());
    CHECK_TEXT(s.parameter(), parameter);
  };
  refused([&](auto& c) { c.inertia = nan; }, "inertia");
  refused([&](auto& c) { c.inertia = -1; }, "inertia");
  refused([&](auto& c) { c.viscous = -1; }, "viscous");
  refused([&](auto& c) { c.coulomb = nan; }, "coulomb");
  refused([&](auto& c) { c.constant_load = 1 / (c.viscous - c.viscous); }, "constant_load");
  refused([&](auto& c) { c.friction_knee = 0; }, "friction_knee");
  refused([&](auto& c) { c.load_inertia_share = 1; }, "load_inertia_share");
  refused([&](auto& c) { c.load_friction_share = -0.1; }, "load_friction_share");
}

}  // namespace

int main() {
  resistance<float>();
  resistance<double>();
  correction();
  refusals();
  return check::done();
}
