// Simulator, observer and effects together. Two questions for every effect:
//   Is what the simulator's motor has to carry in addition what the effect's equation says, written
//   out here once more along the simulated path?
//   Does an observer whose model contains the effect see nothing where the other sees the effect,
//   and both the cutting force?
#include <algorithm>
#include <functional>
#include <string>

#include "check.hpp"
#include "effects_by_hand.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/observer/disturbance_observer.hpp"
#include "servosense/sim/drive_simulator.hpp"
#include "servosense/sim/trajectory.hpp"

using namespace effect_test;

namespace {

constexpr double kPeriod = 125e-6;
constexpr double kLead = 0.016;
constexpr int kFirstCount = 700001;  // so that the turn does not begin where the record does

DriveSimulatorConfig axis() {
  DriveSimulatorConfig c;
  c.drive.inertia = 227;  // Koike 2016, table 3-4, X
  c.drive.viscous = 732;
  c.drive.coulomb = 94;
  c.drive.unit_per_turn = kLead;
  c.effort_per_A = 200;
  c.controller = {30, 285, 40, 1e9, 500, 0};
  c.encoder.counts_per_turn = 1 << 20;
  c.encoder.initial_counts = kFirstCount;
  return c;
}

Trajectory motion() {
  Trajectory t;
  (void)t.move_to(0.10, {0.2, 4, 200});
  (void)t.move_to(0.02, {0.05, 2, 100});
  (void)t.move_to(0.06, {0.4, 6, 400});
  (void)t.dwell(0.1);
  (void)t.move_to(0.00, {0.1, 3, 200});
  return t;
}

std::vector<DriveSimSample> simulate(const DriveSimulatorConfig& c, double cutting_N) {
  const Trajectory t = motion();
  auto s = DriveSimulator::create(c);
  if (!s) {
    std::cout << s.error().sentence << '\n';
    std::exit(1);
  }
  return s->run(
      t.duration_s(), [&](double time) { return t.at(time).position; },
      [&](double time) { return time > 2.0 ? cutting_N : 0; });
}

DriveSimulatorConfig with(const EffectSetting& effect) {
  DriveSimulatorConfig c = axis();
  c.drive.effects.settings[0] = effect;
  c.drive.effects.count = 1;
  return c;
}

// Path of one motor, as the oracle sees it in the middle of a period.
struct Middle {
  double x, v, sign, u, t;
};

// The force that mass, viscous and Coulomb friction leave over, against `expected`. Away from
// kinks, where the force is smooth within a period, the mean over it is its value in the middle to
// (T^2/24) F'', which is what `tolerance` [N] stands for.
void simulated_force(const EffectSetting& effect, double tolerance,
                     const std::function<double(const Middle&)>& expected) {
  const DriveSimulatorConfig c = with(effect);
  const auto run = simulate(c, 60);
  double worst = 0, most = 0, sign = 0;
  int sliding = 0;  // periods since the friction was last winding up
  for (std::size_t n = 0; n + 1 < run.size(); ++n) {
    const DriveSimSample& a = run[n];
    const DriveSimSample& b = run[n + 1];
    const double before = sign;
    sign = std::clamp(sign + (b.position - a.position) / c.drive.friction_knee, -1.0, 1.0);
    const bool slides = sign == before && std::abs(sign) == 1 && a.velocity * b.velocity > 0;
    sliding = slides ? sliding + 1 : 0;
    if (sliding < 2) continue;
    const Middle m{(a.position + b.position) / 2, (a.velocity + b.velocity) / 2, sign, a.effort,
                   a.t_s + kPeriod / 2};
    const double residual = a.effort - a.cutting -
                            c.drive.inertia * (b.velocity - a.velocity) / kPeriod -
                            c.drive.viscous * m.v - c.drive.coulomb * sign;
    worst = std::max(worst, std::abs(residual - expected(m)));
    most = std::max(most, std::abs(residual));
  }
  check::figure(std::string(kDriveEffects[effect.effect].name) + ": simulated force, error", worst,
                "N");
  CHECK_NEAR(worst, 0, tolerance);
  CHECK(most > 100 * tolerance);  // there was something to see
}

void forces() {
  const auto abs = [](double x) { return std::abs(x); };
  simulated_force(setting("viscous-friction", {{300}}), 1e-3,
                  [](const Middle& m) { return 300 * m.v; });
  simulated_force(setting("coulomb-friction", {{50}}), 1e-3,
                  [](const Middle& m) { return 50 * m.sign; });
  simulated_force(setting("stribeck-friction", {{60}, {0.02}}), 5e-3,
                  [](const Middle& m) { return 60 * std::exp(-std::pow(m.v / 0.02, 2)) * m.sign; });
  simulated_force(setting("asymmetric-friction", {{200}, {30}}), 1e-3,
                  [&](const Middle& m) { return 100 * abs(m.v) + 15 * abs(m.sign); });
  simulated_force(setting("quadratic-drag", {{900}}), 1e-2,
                  [&](const Middle& m) { return 900 * m.v * abs(m.v); });
  simulated_force(setting("position-dependent-friction", {{-1, -20, 1, 180}}), 1e-3,
                  [](const Middle& m) { return (80 + 100 * m.x) * m.sign; });
  simulated_force(setting("thermal-friction-drift", {{55}, {2}}), 0.06,
                  [](const Middle& m) { return 55 * (1 - std::exp(-m.t / 2)) * m.sign; });
  // Warmth comes in steps of 0.1 %: of 120 N here.
  simulated_force(setting("thermal-viscous-drift", {{300}, {2}}), 0.12,
                  [](const Middle& m) { return 300 * (1 - std::exp(-m.t / 2)) * m.v; });
  simulated_force(setting("constant-load", {{40}}), 1e-3, [](const Middle&) { return 40; });
  simulated_force(setting("spring-load", {{2000}, {0.03}}), 1e-3,
                  [](const Middle& m) { return 2000 * (m.x - 0.03); });
  // 5 N at 7 periods a turn and 0.4 m/s, 1100 rad/s: (w T)^2/24 of it.
  simulated_force(setting("torque-ripple", {{7}, {5}, {0.3}}), 5e-3, [](const Middle& m) {
    return 5 * std::sin(7 * kTwoPi * (m.x / kLead + kFirstCount / 1048576.0) + 0.3);
  });
  simulated_force(setting("load-dependent-friction", {{0.05}}), 0.05,
                  [&](const Middle& m) { return 0.05 * abs(m.u) * m.sign; });
}

struct Seen {
  double rms = 0;      // while nothing is cut
  double cutting = 0;  // mean over the end
};

Seen observe(const std::vector<DriveSimSample>& run, const DriveModelConfig& model) {
  DisturbanceObserverConfig c;
  c.drive = model;
  c.drive.effort_per_ampere = 200;
  DriveInputConfig in;
  in.unit_per_count = kLead / (1 << 20);
  in.unit_per_turn = kLead;
  in.effort_per_unit = 200;
  CHECK(DisturbanceObserver<double>::validate(c).ok());
  DisturbanceObserver<double> observer;
  observer.configure(c);
  DriveInput<double> input;
  input.configure(in);
  Seen seen;
  int idle = 0, cut = 0;
  for (const DriveSimSample& s : run) {
    RawDriveSample<double> raw;
    raw.counts = s.angle_counts;
    raw.effort = s.current_A;
    const double force = observer.process(input.process(raw));
    if (s.t_s > 0.1 && s.t_s < 2.0) seen.rms += force * force, ++idle;
    if (s.t_s > 2.3 && s.t_s < 2.9) seen.cutting += force, ++cut;
  }
  seen.rms = std::sqrt(seen.rms / idle);
  seen.cutting /= cut;
  return seen;
}

// `left`: share of the plain observer's residual that may be left; `cutting`: tolerance of 60 N.
void observed(const EffectSetting& effect, double left, double cutting_tolerance) {
  const DriveSimulatorConfig c = with(effect);
  const auto run = simulate(c, 60);
  const double floor = observe(simulate(axis(), 60), axis().drive).rms;
  const Seen plain = observe(run, axis().drive);
  const Seen knows = observe(run, c.drive);
  const double above = std::sqrt(std::max(0.0, knows.rms * knows.rms - floor * floor));
  check::figure(std::string(kDriveEffects[effect.effect].name) + ": residual without, N",
                plain.rms);
  check::figure("  with it in the model", knows.rms, "N");
  check::figure("  cutting force, 60 N", knows.cutting, "N");
  CHECK(plain.rms > 3 * floor);  // it matters
  CHECK(above <= left * plain.rms);
  CHECK_NEAR(knows.cutting, 60, cutting_tolerance);
}

void observers() {
  const double floor = observe(simulate(axis(), 60), axis().drive).rms;
  check::figure("observer's floor: quantisation and half a sample of timing", floor, "N");
  // Functions of position pass both sides through the same filter; viscous friction joins the
  // model's own. What is left is below the floor, so 2 % is its uncertainty.
  observed(setting("viscous-friction", {{300}}), 0.02, 0.2);
  observed(setting("coulomb-friction", {{50}}), 0.02, 0.2);
  observed(setting("presliding-hysteresis", {{5e5}, {90}}), 0.02, 0.2);
  observed(setting("position-dependent-friction", {{-1, -20, 1, 180}}), 0.02, 0.2);
  observed(setting("thermal-friction-drift", {{55}, {2}}), 0.02, 0.2);
  observed(setting("constant-load", {{40}}), 0.02, 0.2);
  observed(setting("spring-load", {{2000}, {0.03}}), 0.02, 0.2);
  observed(setting("torque-ripple", {{7, 2.5}, {20, 10}, {0.3, 1}}), 0.02, 0.2);
  observed(setting("load-dependent-friction", {{0.05}}), 0.02, 0.2);
  // Functions of velocity see it 2 ms late (velocity_cutoff 500 rad/s): at 4 m/s2 that is 8 mm/s,
  // and 40 % of the Stribeck velocity here.
  observed(setting("stribeck-friction", {{60}, {0.02}}), 0.2, 0.5);
  observed(setting("asymmetric-friction", {{200}, {30}}), 0.02, 0.2);
  observed(setting("quadratic-drag", {{900}}), 0.02, 0.4);
  observed(setting("thermal-viscous-drift", {{300}, {2}}), 0.02, 0.4);
  // Hidden loads: the sub-model is driven by what the encoder shows. Of the cutting force it knows
  // nothing, so the flank's give and the load's friction while the force builds up are missed.
  observed(setting("flexible-coupling", {{40}, {0.03}, {0.5}}), 0.02, 0.3);
  observed(setting("backlash", {{60e-6}}), 0.02, 1.5);
  // Timing and angle.
  observed(setting("transport-delay", {{3.3e-3}}), 0.02, 0.2);
  observed(setting("current-loop-lag", {{50}}), 0.02, 0.2);
  // Torque per ampere.
  observed(setting("torque-saturation", {{2}, {0.3}}), 0.02, 0.2);
  observed(setting("field-weakening", {{0.1}, {1}, {}}), 0.02, 0.2);
  observed(setting("field-weakening", {{}, {}, {0.1, 1, 0.5, 5}}), 0.02, 0.2);
  observed(setting("encoder-eccentricity", {{4e-3}, {1}}), 0.02, 0.2);
  observed(setting("lead-error", {{8e-6}, {1}, {2e-5}, {0.5}}), 0.02, 0.2);
}

// Names and keys are those of the machine file, on an axis and on a spindle.
void catalogue() {
  for (const EffectInfo& info : kDriveEffects) {
    const std::string name = info.name;
    for (std::size_t p = 0; p < info.parameter_count(); ++p) {
      const EffectParameter& parameter = info.parameters[p];
      if (parameter.optional) continue;
      if (find_machine_key("effect.x." + name, parameter.key_for(false)) == nullptr ||
          find_machine_key("effect.spindle." + name, parameter.key_for(true)) == nullptr)
        std::cout << name << ": " << parameter.key << '\n';
      CHECK(find_machine_key("effect.x." + name, parameter.key_for(false)) != nullptr);
      CHECK(find_machine_key("effect.spindle." + name, parameter.key_for(true)) != nullptr);
    }
  }
}

}  // namespace

int main() {
  catalogue();
  forces();
  observers();
  return check::done();
}
