#include "reconcile/drive/backlash_response.hpp"

#include <algorithm>
#include <cmath>

namespace servosense::reconcile {

Column loads_of(const DriveSignals& s, const DriveModelConfig& drive) {
  Column loads;
  const EffectSetting* spring = drive.effects.find("spring-load");
  if (drive.constant_load == 0 && spring == nullptr) return loads;
  loads.assign(s.position.size(), drive.constant_load);
  if (spring != nullptr)
    for (std::size_t i = 0; i < loads.size(); ++i)
      loads[i] += spring->scalar(0) * (s.position[i] - spring->scalar(1));
  return loads;
}

Column response_of_backlash(const DriveSignals& s, const DriveModelConfig& drive,
                            const BacklashLoad& backlash, const Column& loads) {
  const std::size_t n = s.position.size();
  const double period = s.work_period_s;
  const double half = 0.5 * backlash.width;
  const double coulomb = backlash.ratio * drive.coulomb, viscous = backlash.ratio * drive.viscous;
  const double per_load = period / (backlash.share * drive.inertia);
  const double stop = coulomb / drive.inertia * period;  // change of speed in a sample
  const double drag = viscous / drive.inertia * period;
  const Column direction = s.direction(drive.friction_knee);
  Column deflection(n, half), friction(n, 0);
  double d = half;
  double load = n > 0 ? s.velocity[0] : 0;
  bool carried = true;
  for (std::size_t i = 1; i < n; ++i) {
    const double before = s.velocity[i - 1], motor = s.velocity[i];
    const double push = loads.empty() ? 0 : per_load * loads[i];
    if (carried) {
      const double pressing = motor - before + drag * motor + stop * direction[i] + push;
      carried = pressing * d >= 0;
      load = carried ? motor : before;
    }
    double sign = direction[i];
    if (!carried) {
      const double was = load;
      load -= drag * load + push;
      const double pulled = load;
      load = load > 0 ? std::max(0.0, load - stop) : std::min(0.0, load + stop);
      sign = stop > 0 ? (pulled - load) / stop : 0;  // at rest friction holds what pulls
      d += 0.5 * period * (before + motor - was - load);
      if (std::abs(d) >= half) {
        d = std::copysign(half, d);
        if ((motor - load) * d > 0) {
          carried = true;
          load = motor;
          sign = direction[i];
        }
      }
    }
    deflection[i] = d;
    friction[i] = coulomb * (sign - direction[i]) + viscous * (load - motor);
  }
  Column out = s.to_rows(deflection, 2);
  const Column missing = s.to_rows(friction);
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = missing[i] - drive.inertia * out[i];
  return out;
}

}  // namespace servosense::reconcile
