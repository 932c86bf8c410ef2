// Spindles beyond base speed, by the program alone: an idling run with run-ups shows how the torque
// constant falls, a step of torque in a cut is then read right; without it, or where the run stayed
// slow, the program says what it does not know.
#include <cmath>
#include <cstdio>
#include <fstream>
#include <optional>
#include <sstream>

#include "oracles/weakened_spindle.hpp"
#include "program.hpp"
#include "spindle_records.hpp"

using namespace program_test;
using oracle::WeakenedSpindle;
using namespace spindle_records;
using servosense::kTwoPi;

namespace {

constexpr double kStep_Nm = 2;

/// Run-ups and run-downs both ways, to `top`.
void write_idle(const WeakenedSpindle& s, double top, unsigned seed) {
  write_trace(
      s, "idle.csv", 40,
      [&](double t) {
        constexpr double kShares[] = {0.3, 1, 0.5, 1, -0.4, -1, -0.2, 0.7, 1, 0};
        return top * kShares[std::min(static_cast<int>(t / 4), 9)];
      },
      [](double) { return 0.0; }, seed);
}

Outcome watch_cut(const WeakenedSpindle& s, double speed, unsigned seed) {
  write_trace(
      s, "cut.csv", kStepAt_s + 3, [&](double) { return speed; },
      [](double t) { return t > kStepAt_s ? kStep_Nm : 0.0; }, seed);
  return run("monitor --machine learned.ini --trace cut.csv --estimates estimates.csv --json");
}

Outcome learn() {
  return run("identify idle --machine machine.ini --trace idle.csv --out learned.ini --json");
}

/// Every parameter and the step at 2.5 times base speed within `tolerance`.
void weakened(const WeakenedSpindle& s, unsigned seed, double tolerance) {
  write_machine(s);
  write_idle(s, s.top_rad_s, seed);
  const Outcome learned = learn();
  that(learned.status == 0, learned, "identifies", __LINE__);
  const auto inertia = value_of("learned.ini", "spindle", "inertia_kg_m2");
  const auto viscous = value_of("learned.ini", "spindle", "viscous_friction_Nm_s_per_rad");
  const auto coulomb = value_of("learned.ini", "spindle", "coulomb_friction_Nm");
  const std::string effect = "effect.spindle.field-weakening";
  const auto base = value_of("learned.ini", effect, "base_speed_rad_s");
  const auto known = value_of("learned.ini", "spindle", "torque_constant_known_to_rpm");
  that(inertia && viscous && coulomb && base && known, learned, "finds field weakening", __LINE__);
  if (!(inertia && viscous && coulomb && base && known)) return;
  CHECK_NEAR(*inertia / s.inertia, 1, tolerance);
  CHECK_NEAR(*viscous / s.viscous, 1, tolerance);
  CHECK_NEAR(*coulomb / s.coulomb, 1, tolerance);
  if (!s.smooth) CHECK_NEAR(*base / s.base_rad_s, 1, tolerance);
  // Beyond base speed it accelerates ever more slowly, and may not reach the top in time.
  CHECK_BETWEEN(*known / servosense::rpm_from_rad_s(s.top_rad_s), 0.75, 1.02);
  const Outcome cut = watch_cut(s, 2.5 * s.base_rad_s, seed + 1000);
  that(cut.status == 0, cut, "monitors", __LINE__);
  const Reading r = read_step("estimates.csv");
  CHECK(r.empty == 0);
  CHECK_NEAR(r.step / kStep_Nm, 1, tolerance);
  std::printf("  seed %u: J %+.2f %%, D %+.2f %%, C %+.2f %%, base %+.2f %%, step %+.2f %%\n", seed,
              100 * (*inertia / s.inertia - 1), 100 * (*viscous / s.viscous - 1),
              100 * (*coulomb / s.coulomb - 1), 100 * (*base / s.base_rad_s - 1),
              100 * (r.step / kStep_Nm - 1));
}

/// A knee that is no corner is no power of the speed: the law fits it as well as it can.
void a_soft_knee(unsigned seed) {
  WeakenedSpindle s = WeakenedSpindle::random(seed);
  s.smooth = true;
  write_machine(s);
  write_idle(s, s.top_rad_s, seed);
  const Outcome learned = learn();
  that(learned.status == 0, learned, "identifies", __LINE__);
  that(watch_cut(s, 2.5 * s.base_rad_s, seed + 1000).status == 0, learned, "monitors", __LINE__);
  const double step = read_step("estimates.csv").step / kStep_Nm;
  std::printf("  soft knee, seed %u: step %+.2f %%\n", seed, 100 * (step - 1));
  CHECK_NEAR(step, 1, 0.01);
}

/// The same at every speed, with windage or without: no weakening is found, and the rest is right.
void constant_torque(unsigned seed, bool windage) {
  WeakenedSpindle s = WeakenedSpindle::random(seed);
  s.base_rad_s = 1e9;
  if (windage) s.drag = s.coulomb / s.top_rad_s / s.top_rad_s;
  write_machine(s);
  write_idle(s, s.top_rad_s, seed);
  const Outcome learned = learn();
  that(learned.status == 0, learned, "identifies", __LINE__);
  that(!contains(content(folder / "learned.ini"), "field-weakening"), learned,
       "finds no field weakening", __LINE__);
  CHECK_NEAR(value_of("learned.ini", "spindle", "inertia_kg_m2").value_or(0) / s.inertia, 1, 0.01);
}

/// A run that stays below base speed shows nothing of what lies beyond: nothing is estimated there,
/// and that is said.
void slow_run(unsigned seed) {
  const WeakenedSpindle s = WeakenedSpindle::random(seed);
  write_machine(s);
  write_idle(s, 0.8 * s.base_rad_s, seed);
  that(learn().status == 0, learn(), "identifies", __LINE__);
  const double known =
      value_of("learned.ini", "spindle", "torque_constant_known_to_rpm").value_or(0);
  CHECK_NEAR(known / servosense::rpm_from_rad_s(0.8 * s.base_rad_s), 1, 0.05);
  const Outcome cut = watch_cut(s, 2.5 * s.base_rad_s, seed + 1000);
  const Reading r = read_step("estimates.csv");
  CHECK(r.empty > r.rows / 2);
  that(contains(cut.out, "\"partly-watched\"") || contains(cut.out, "\"not-watched\""), cut,
       "the verdict says that it did not see all", __LINE__);
  char highest[32];
  std::snprintf(highest, sizeof highest, "known to %.4g rpm", known);
  that(contains(cut.out, highest), cut, "names the highest speed", __LINE__);
  const Outcome slow = watch_cut(s, 0.7 * s.base_rad_s, seed + 2000);
  that(!contains(slow.out, "known to"), slow, "nothing is said of known speeds", __LINE__);
  CHECK(read_step("estimates.csv").empty == 0);
}

/// A drive that reports torque knows its motor: the constant is not asked for.
void reported_torque(unsigned seed) {
  const WeakenedSpindle s = WeakenedSpindle::random(seed);
  write_machine(s);
  write_idle(s, s.top_rad_s, seed);
  that(learn().status == 0, learn(), "identifies", __LINE__);
  std::string text = content(folder / "idle.csv");
  text.replace(text.find("current_A"), 9, "torque_Nm");
  put("torque.csv", text);
  const Outcome o = run("monitor --machine learned.ini --trace torque.csv --json");
  that(contains(o.out, "reports no current"), o, "says that the law is not used", __LINE__);
}

}  // namespace

// `--nightly`: the figures of docs/identify-idle.md.
int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  return in_own_folder("field_weakening", [&] {
    const unsigned from = nightly ? 501 : 1, count = nightly ? 12 : 1;
    for (unsigned seed = from; seed < from + count; ++seed)
      weakened(WeakenedSpindle::random(seed), seed, nightly ? 0.003 : 0.01);
    for (unsigned seed = from; seed < from + (nightly ? count : 1); ++seed) a_soft_knee(seed);
    constant_torque(6, false);
    constant_torque(7, true);
    slow_run(8);
    reported_torque(9);
  });
}
