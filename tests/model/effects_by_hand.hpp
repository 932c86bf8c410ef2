// What the tests of effects share: settings by name, motions, one effect driven by hand.
#pragma once

#include <cmath>
#include <initializer_list>
#include <vector>

#include "servosense/core/units.hpp"
#include "servosense/model/drive_effects.hpp"

namespace effect_test {

using namespace servosense;

using Lists = std::initializer_list<std::initializer_list<double>>;

inline EffectSetting setting(const char* name, Lists parameters) {
  EffectSetting s;
  s.effect = drive_effect_index(name);
  std::size_t p = 0;
  for (const auto& values : parameters) {
    for (const double v : values) s.parameters[p].value[s.parameters[p].count++] = v;
    ++p;
  }
  return s;
}

inline DriveEffectsConfig config(const char* name, Lists parameters, double period_s = 125e-6) {
  DriveEffectsConfig c;
  c.sample_period_s = period_s;
  c.settings[0] = setting(name, parameters);
  c.count = 1;
  return c;
}

template <typename Effect>
Effect made(Lists parameters, const DriveFacts& facts = {}) {
  Effect e;
  e.configure(setting(Effect::info.name, parameters), facts);
  e.reset();
  return e;
}

/// Feeds positions one by one and fills the rest of the motion from them.
template <typename Real>
struct Path {
  double period_s = 125e-6;
  double knee = 1e-9;  // the sign follows at once
  double unit_per_turn = 0.016;
  MotionState<Real> m{};
  double last = 0;
  double sign = 0;

  const MotionState<Real>& to(double x) {
    const double moved = x - last;
    last = x;
    sign = std::fmin(1, std::fmax(-1, sign + moved / knee));
    const double turns = x / unit_per_turn;
    m.position = static_cast<Real>(x);
    m.increment = static_cast<Real>(moved);
    m.velocity = static_cast<Real>(moved / period_s);
    m.direction = static_cast<Real>(sign);
    m.turn_angle_rad = static_cast<Real>(kTwoPi * (turns - std::floor(turns)));
    return m;
  }
};

}  // namespace effect_test
