// One speed both ways: what that motion cannot show is said, with the motion that would; and of a
// load and a spring, of which the one contains the other, the simpler gives the name.
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "check.hpp"
#include "drive_under_control.hpp"
#include "servosense/core/units.hpp"
#include "servosense/reconcile/drive.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

DriveData at_speeds(double least_level) {
  DriveUnderControl axis = axis_under_control();
  axis.least_level = least_level;
  axis.seed = 11;
  return record_of(axis, 1e-3);
}

Report of(const DriveData& d) {
  auto out = reconcile_drive(d, {});
  CHECK(out.has_value());
  return out ? std::move(out->report) : Report{};
}

bool says_what_to_record(const Report& r, const std::string& effect) {
  return std::any_of(r.not_testable.begin(), r.not_testable.end(), [&](const NotTestable& n) {
    return n.name == effect && !n.would_need.empty();
  });
}

/// Drag that grows with the square of the speed is, at one speed, Coulomb friction.
double one_speed_and_several() {
  const Report one = of(at_speeds(1));
  CHECK(one.verdict == Verdict::agrees);
  CHECK(says_what_to_record(one, "quadratic-drag"));
  const Report several = of(at_speeds(0.05));
  CHECK(several.verdict == Verdict::agrees);
  CHECK(!says_what_to_record(several, "quadratic-drag"));
  return one.floors.used;
}

/// The motor bears a load that hardly changes along the way: by `slope` floors rms.
Report under_load(double floor, double load, double slope) {
  DriveData d = at_speeds(1);
  double mean = 0, square = 0;
  const auto n = static_cast<double>(d.samples.size());
  for (const auto& s : d.samples) mean += s.position / n;
  for (const auto& s : d.samples) square += std::pow(s.position - mean, 2) / n;
  const double stiffness = slope * floor / std::sqrt(square);
  for (auto& s : d.samples) s.effort += load * floor + stiffness * (s.position - mean);
  return of(d);
}

/// A ripple that is faster than the band at this speed is not there to be seen.
void a_ripple_beyond_the_band() {
  const auto shaken = [](double least_level) {
    DriveData d = at_speeds(least_level);
    for (auto& s : d.samples)
      s.effort += 4 * std::sin(48 * kTwoPi / d.model.unit_per_turn * s.position);
    return of(d);
  };
  const Report one = shaken(0.8);
  CHECK(says_what_to_record(one, "torque-ripple"));
  CHECK(one.effects.empty());
}

void the_simpler_gives_the_name(double floor) {
  const Report load = under_load(floor, 10, 0.4);
  CHECK(load.effects.size() == 1);
  if (load.effects.size() != 1) return;
  CHECK(load.effects[0].name == "constant-load");
  const auto& others = load.effects[0].class_members;
  CHECK(std::find(others.begin(), others.end(), "spring-load") != others.end());
  const Report spring = under_load(floor, 10, 3);
  CHECK(spring.effects.size() == 1 && spring.effects[0].name == "spring-load");
}

}  // namespace

int main() {
  a_ripple_beyond_the_band();
  the_simpler_gives_the_name(one_speed_and_several());
  return check::done();
}
