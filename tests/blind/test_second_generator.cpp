// The second blind generator: is its physics right, and is it the same twice? Every oracle is a
// closed form or a balance.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "case.hpp"
#include "check.hpp"
#include "second_machine.hpp"
#include "second_motion.hpp"
#include "second_plant.hpp"
#include "second_truth.hpp"

namespace {

using namespace blind::second;
using blind::Signal;

constexpr double kTurn = 2 * std::numbers::pi;
constexpr Law kLaws[] = {Law::lugre, Law::dahl, Law::maxwell_slip, Law::tanh, Law::arctan};

/// Without noise and steps of sensors.
Plant quiet() {
  Plant p;
  p.servo_hz = 4000;
  p.encoder_step = p.scale_step = p.effort_step = p.effort_noise = p.force_noise = 0;
  p.velocity_gain = kTurn * 15 * p.inertia;
  p.limit = 1e6;
  return p;
}

Path there(double way, double speed) {
  Path path(4000, 0, Profile::sine_square);
  path.dwell(0.1);
  path.run(std::copysign(speed, way), 1, std::abs(way) / speed);
  path.run(0, 1, 0);
  return path;
}

double mean(const Signal& x, std::size_t from, std::size_t to) {
  double sum = 0;
  for (std::size_t i = from; i < to; ++i) sum += x[i];
  return sum / static_cast<double>(to - from);
}

/// At constant speed the effort is the sum of the friction laws, whatever law and integrator.
void constant_speed() {
  Hidden h;
  h.extra_static = 20, h.stribeck_speed = 0.02;
  h.viscous_difference = 60, h.coulomb_difference = 8, h.quadratic = 300, h.load = 3;
  for (const Law law : kLaws)
    for (const bool rigid : {true, false})
      for (const bool runge_kutta : {true, false})
        for (const double speed : {0.01, 0.1, -0.03}) {
          Plant p = quiet();
          p.law = law, p.rigid = rigid, p.runge_kutta = runge_kutta;
          p.step_s = 10e-6;
          p.creep_speed = 1e-4;
          const Signal path = there(0.8 * speed, std::abs(speed)).positions();
          const Record r = simulate(p, h, path, {}, 1);
          const double v = speed, s = std::copysign(1.0, speed);
          double level = p.coulomb + 20 * std::exp(-v * v / 4e-4) + 4 * s;
          if (law == Law::arctan) level *= std::atan(std::abs(v) / 1e-4) * 2 / std::numbers::pi;
          const double expected = s * level + (p.viscous + 30 * s) * v + 300 * v * std::abs(v) + 3;
          CHECK(r.stable);
          // The loop has settled in the last part of the stretch: 1e-3 of the friction.
          CHECK_NEAR(mean(r.effort, 2400, 3200), expected, 0.05);
        }
}

/// From rest to rest the motor's work is what friction took.
void energy() {
  for (const Law law : kLaws) {
    Plant p = quiet();
    p.law = law;
    p.creep_speed = 5e-4;
    p.load_friction = 0.5;
    Path path(4000, 0, Profile::sine_square);
    path.dwell(0.1);
    for (const double way : {0.1, -0.2, 0.15}) path.move(way, 0.3, 3);
    path.dwell(0.5);
    const Record r = simulate(p, Hidden{}, path.positions(), {}, 1);
    double work = 0, lost = 0;
    for (std::size_t k = 1; k < r.motor.size(); ++k) {
      const double way = r.motor[k] - r.motor[k - 1], load = r.load[k] - r.load[k - 1];
      work += r.actual[k] * way;  // what acted since the sample before
      lost += 0.5 * p.coulomb * (std::abs(way) + std::abs(load));
      lost += 0.5 * p.viscous * (way * way + load * load) * p.servo_hz;
    }
    // Laws without a bristle take less at creeping speeds, bristles store a little.
    CHECK_NEAR(work / lost, 1, 0.01);
  }
}

/// Shaken at random and free, the pair twists at its resonance: counted by zero crossings.
void resonance() {
  for (const double hz : {30.0, 90.0}) {
    Plant p = quiet();
    p.mode_hz = hz, p.mode_damping = 0.003, p.load_share = 0.3;
    p.coulomb = p.viscous = 0, p.velocity_gain = 0, p.force_noise = 20;
    const Record r = simulate(p, Hidden{}, Signal(80000, 0.0), {}, 3);
    int crossings = 0;
    for (std::size_t k = 1; k < r.motor.size(); ++k)
      crossings += (r.motor[k] - r.load[k] > 0) != (r.motor[k - 1] - r.load[k - 1] > 0);
    // In 20 s a damping of 0.003 leaves the mean frequency open by a part of a percent.
    CHECK_NEAR(crossings / 40.0 / hz, 1, 0.02);
  }
}

/// Between the flanks there is the width of the play and what the coupling gives.
void play() {
  Plant p = quiet();
  p.mode_hz = 500;
  Hidden h;
  h.play = 40e-6;
  Path path(4000, 0, Profile::trapezoid);
  path.dwell(0.2);
  for (int i = 0; i < 3; ++i) {
    path.move(0.002, 0.002, 0.1);
    path.dwell(0.2);
    path.move(-0.002, 0.002, 0.1);
    path.dwell(0.2);
  }
  const Record r = simulate(p, h, path.positions(), {}, 1);
  double low = 0, high = 0;
  for (std::size_t k = 0; k < r.motor.size(); ++k) {
    low = std::min(low, r.motor[k] - r.load[k]);
    high = std::max(high, r.motor[k] - r.load[k]);
  }
  // On either side the spring gives by the largest effort, and by the impact at 2 mm/s.
  double most = 0;
  for (const double effort : r.actual) most = std::max(most, std::abs(effort));
  const double give = most / coupling_stiffness(p) + 0.002 / (kTurn * p.mode_hz);
  CHECK_BETWEEN(high - low, h.play, h.play + 2 * give);
}

/// How late the motor follows what was asked for, where the two are most alike.
void lateness() {
  for (const bool reading : {false, true}) {
    Plant p = quiet();
    p.reports = reading ? Reports::measured : Reports::command;
    p.velocity_gain = kTurn * 8 * p.inertia;
    Hidden h;
    h.late_s = 3e-3, h.late_reading = reading;
    Path path(4000, 0, Profile::trapezoid);
    for (int i = 0; i < 5; ++i) path.move(0.03, 0.2, 4), path.move(-0.03, 0.2, 4);
    const Record r = simulate(p, h, path.positions(), {}, 1);
    double best = 0;
    int found = 0;
    for (int lag = -40; lag <= 40; ++lag) {
      double sum = 0;
      for (std::size_t k = 50; k + 50 < r.effort.size(); ++k)
        sum += r.effort[k] * r.actual[static_cast<std::size_t>(static_cast<int>(k) + lag)];
      if (sum > best) best = sum, found = lag;
    }
    // 3 ms are 12 samples; what is asked at a sample acts until the next. A reading is as late as
    // that behind what acted.
    CHECK_NEAR(found, reading ? -12 : 13, 1);
  }
  // A lag of first order has passed on 1 - 1/e of a step after its time constant.
  Plant p = quiet();
  p.law = Law::dahl, p.coulomb = 1e6, p.load_friction = 0, p.velocity_gain = 0;
  p.position_gain = 1, p.velocity_gain = 1, p.integral_per_s = 0;
  Hidden h;
  h.lag_hz = 40;
  Signal step(400, 0.0);
  for (std::size_t k = 100; k < step.size(); ++k) step[k] = 1;
  const Record r = simulate(p, h, step, {}, 1);
  const auto constant = static_cast<std::size_t>(std::lround(4000 / (kTurn * 40)));
  CHECK_NEAR(r.actual[100 + constant] / r.effort[300], 1 - std::exp(-1.0), 0.02);
}

/// Half the step changes nothing that a sensor would see, and both integrators agree.
void convergence() {
  for (const Law law : kLaws) {
    Plant p = quiet();
    p.law = law, p.runge_kutta = true, p.creep_speed = 5e-4;
    Hidden h;
    h.ripple = 5, h.ripple_order = 6, h.slow_breakaway = 10, h.slow_travel = 5e-5;
    Path path(4000, 0, Profile::sine_square);
    path.dwell(0.05);
    path.move(0.01, 0.1, 2), path.move(-0.01, 0.1, 2), path.dwell(0.2);
    const auto run = [&](bool runge_kutta, double step_s) {
      p.runge_kutta = runge_kutta, p.step_s = step_s;
      return simulate(p, h, path.positions(), {}, 1);
    };
    const Record fine = run(true, 2e-6);
    const auto apart = [&](const Record& r) {
      Signal off = r.effort;
      for (std::size_t k = 0; k < off.size(); ++k) off[k] -= fine.effort[k];
      return blind::rms(off, 0, off.size());
    };
    // Of 50 N of friction: far less than the noise of any of the machines.
    CHECK(apart(run(true, 25e-6)) < 1e-4);
    const double coarse = apart(run(false, 20e-6)), halved = apart(run(false, 10e-6));
    check::figure("effort with Euler steps of 20 us off by", coarse, "N");
    CHECK(coarse < 0.05);
    // Of first order; fine is not infinitely fine.
    CHECK_BETWEEN(halved / coarse, 0.4, 0.6);
  }
}

/// Sensors that err: by the eccentricity once a turn, by the screw on the scale.
void sensors() {
  Plant p = quiet();
  p.rigid = true;
  Hidden h;
  h.eccentricity = 0.02, h.lead_amplitude = 5e-6, h.lead_slope = 1e-4;
  const Record r = simulate(p, h, there(0.05, 0.05).positions(), {}, 1);
  double read = 0, scale = 0;
  for (std::size_t k = 0; k < r.motor.size(); ++k) {
    read = std::max(read, std::abs(r.position[k] - r.motor[k]));
    scale = std::max(scale, std::abs(r.scale[k] - r.motor[k] - 1e-4 * r.motor[k]));
  }
  CHECK_NEAR(read, 0.02 * p.turn / kTurn, 1e-3 * 0.02 * p.turn / kTurn);
  CHECK_NEAR(scale, 5e-6, 1e-8);
}

/// Loads that follow no rule have the rms they are drawn with. The drive stands and carries them.
void wandering() {
  for (const Outside kind : {Outside::narrow_band, Outside::wandering_load}) {
    Plant p = quiet();
    p.rigid = true, p.coulomb = 1e-6, p.viscous = 0;
    p.servo_hz = 2000, p.inertia = 1e-3, p.velocity_gain = 1, p.position_gain = 0.1;
    p.integral_per_s = 1;
    Hidden h;
    h.outside = kind, h.outside_size = 10;
    h.outside_a = kind == Outside::narrow_band ? 8 : 0.3, h.outside_b = 0.05;
    const Record r = simulate(p, h, Signal(400000, 0.0), {}, 5);
    // 200 s with some hundred independent swings: their rms within a tenth.
    CHECK_NEAR(blind::rms(r.effort, 2000, r.effort.size()), 10, 1.2);
  }
}

/// What the refit leaves of a machine that is its model is the noise; of a load, the load.
void strength() {
  Plant p = quiet();
  p.rigid = true, p.law = Law::dahl, p.presliding = 1.5e-6;
  p.force_noise = 0.4;
  Path path(4000, 0, Profile::sine_square);
  path.dwell(0.2);
  for (const double speed : {0.02, 0.1, 0.3, 0.05})
    for (const double way : {0.05, -0.05}) path.move(way, speed, 2);
  Baseline b;
  b.rate_hz = p.servo_hz, b.held_out = 3 * path.positions().size() / 4, b.inertia = p.inertia;
  const Record plain = simulate(p, Hidden{}, path.positions(), {}, 1);
  const double floor = noise_floor(plain, b);
  // White noise of 0.4 N up to 2000 Hz, through 80 Hz there and back (0.81 of it in power).
  CHECK_NEAR(floor, 0.4 * std::sqrt(0.81 * 80 / 2000), 0.15 * floor);
  CHECK_BETWEEN(refitted(plain, b).learnt, 0.5 * floor, 4 * floor);
  Hidden h;
  h.load = 10;
  const Gaps loaded = refitted(simulate(p, h, path.positions(), {}, 1), b);
  CHECK_NEAR(loaded.learnt, 10, 0.5);
  CHECK_NEAR(loaded.held_out, 10, 0.5);
}

/// Every cell can be drawn (otherwise than at night, every twelfth of them); what is drawn twice is
/// the same, and another seed is another machine.
void same_twice(bool nightly) {
  std::size_t at = 0;
  for (const std::string domain :
       {"second-drive", "second-spindle", "book-drive", "book-spindle"}) {
    for (const std::string& cell : blind::second_cells(domain)) {
      if (cell.find("outside") == std::string::npos && cell.find("backlash") == std::string::npos)
        continue;
      if (!nightly && at++ % 12 != 0) continue;
      const blind::Case c = blind::draw_case(cell, 5, "plain");
      CHECK_TEXT(c.name, cell);
      bool finite = true;
      for (const blind::Column& column : c.columns)
        for (const double value : column.values) finite = finite && std::isfinite(value);
      CHECK(finite);
      CHECK(c.truth.noise_floor > 0);
      CHECK(c.truth.held_out_from_s > 0.5 * c.columns[0].values.back());
    }
    const std::string pair = domain + "/pair";
    const blind::Case a = blind::draw_case(pair, 8, "plain"),
                      b = blind::draw_case(pair, 8, "plain"),
                      other = blind::draw_case(pair, 9, "plain");
    CHECK_TEXT(truth_json(a), truth_json(b));
    CHECK_TEXT(a.machine, b.machine);
    CHECK(a.columns.size() == b.columns.size());
    for (std::size_t i = 0; i < a.columns.size(); ++i)
      CHECK(a.columns[i].values == b.columns[i].values);
    CHECK(a.machine != other.machine);
    CHECK(a.truth.effects.size() == 2);
    // The file of a text book's machine has its mode, and no other file has one unasked.
    CHECK((a.machine.find("flexible-coupling]") != std::string::npos) ==
          domain.starts_with("book"));
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  constant_speed();
  energy();
  resonance();
  play();
  lateness();
  convergence();
  sensors();
  wandering();
  strength();
  same_twice(nightly);
  return check::done();
}
