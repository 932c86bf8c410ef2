// Detection against false alarms of the monitors that are taught: torque band on repeated milling
// programs, drill fracture on holes, both through drives, counters and observers, for machines
// drawn at random (random_cuts.hpp). `--nightly` or `--cases N [--from SEED]`. Figures:
// docs/detection.md.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "check.hpp"
#include "detection/random_cuts.hpp"
#include "detection/scores.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/identify/torque_band_reference.hpp"
#include "servosense/monitors/drill_fracture.hpp"
#include "servosense/monitors/idle_statistics.hpp"
#include "servosense/monitors/torque_band.hpp"
#include "servosense/monitors/wear.hpp"

using namespace servosense;
using namespace detection;
using detection::Event;

namespace {

constexpr std::uint64_t kFirstSeed = 300000;

// ---- Torque band.

struct Heard {
  std::vector<double> torque_Nm, increment_rad, advance_s;
  std::vector<Quality> quality;
};

// What the spindle's observer makes of a record, without the time in which it settles.
Heard hear(const Cut& c, const Record& r, std::uint64_t seed, const HostStackConfig& config) {
  Heard h;
  Reporter<double> reporter(c, r, seed);
  DriveInput<double> input;
  DisturbanceObserver<double> observer;
  input.configure(config.spindle.input);
  observer.configure(config.spindle.observer);
  for (std::size_t i = 0; i < r.size(); ++i) {
    const DriveSample<double> sample = input.process(reporter.at(i).spindle);
    h.torque_Nm.push_back(observer.process(sample));
    h.increment_rad.push_back(sample.increment);
    h.quality.push_back(observer.state().quality);
    h.advance_s.push_back(kPeriod_s);
  }
  return h;
}

constexpr double kSpacing_s = 0.02;

TorqueRun run_of(const Heard& h) {
  TorqueRunRecorder recorder({.spacing = kSpacing_s, .step = 2 * kSpacing_s});
  for (std::size_t i = 0; i < h.torque_Nm.size(); ++i)
    recorder.add(h.torque_Nm[i], h.increment_rad[i], h.advance_s[i], 1, h.quality[i]);
  return good(recorder.finish(), "run");
}

// The workpiece of the day: other stock, elsewhere on the table.
Cut changed(const Cut& c, double hardness, double depth, double late_s) {
  Cut out = c;
  MillingSimulation& m = out.simulation.milling;
  m.tool.force.tangential_coefficient_N_per_m2 *= hardness;
  m.tool.force.tangential_edge_N_per_m *= hardness;
  m.tool.force.radial_edge_N_per_m *= hardness;
  m.cut.axial_depth_m *= depth;
  const double feed = m.cut.feed_per_tooth_m * m.tool.teeth / c.turn_s();
  // All events move along with the first contact, which comes late_s later.
  m.clearance_m += late_s * feed;
  return out;
}

struct BandStudy {
  Scores band, limit;
  std::size_t cases = 0;
};

void torque_band(BandStudy& s, std::uint64_t seed) {
  const Cut c = draw(seed, Event::none);
  const HostStackConfig config = learned_stack(c);
  detection::detail::Draw d(seed * 8 + 7);
  ++s.cases;
  const double tolerance_s = 0.1;
  const Record r = simulate(c);
  // Three good parts are taught, each from stock within +-4 %.
  std::vector<TorqueRun> taught;
  for (std::uint64_t k = 0; k < 3; ++k)
    taught.push_back(
        run_of(hear(c, simulate(changed(c, d.between(0.96, 1.04), 1, 0)), 10 * seed + k, config)));
  const std::vector<double>& first = taught[0].torque_Nm;
  const double highest = *std::max_element(first.begin(), first.end());
  TorqueBandOptions options;
  options.above_share = options.below_share = 0.15;
  options.above_Nm = options.below_Nm = 0.1 * highest;
  options.lead = options.lag = 2 * kSpacing_s;
  options.max_shift = tolerance_s;
  const auto band = make_torque_band(taught, options);
  if (!band) {
    check::fail(__FILE__, __LINE__) << band.error().sentence << '\n';
    return;
  }
  TorqueBandConfig t;
  t.spacing = band->spacing;
  t.step = 2 * kSpacing_s;
  t.max_shift = tolerance_s;
  t.shift_step = kSpacing_s;
  const auto points = band->as<double>();
  TorqueBandMonitor<double> monitor;
  CHECK_TEXT(TorqueBandMonitor<double>::validate(t).reason(), "");
  const auto score = [&](const Cut& cut, std::uint64_t noise, bool fault) {
    const Heard h = hear(cut, simulate(cut), noise, config);
    monitor.configure(t);
    monitor.set_reference(TorqueBandView<double>{points, band->sections});
    monitor.start();
    double most = 0;
    for (std::size_t i = 0; i < h.torque_Nm.size(); ++i) {
      monitor.process(h.torque_Nm[i], h.increment_rad[i], kPeriod_s, 1, h.quality[i]);
      most = std::max(most, monitor.core().value / t.alarm_steps);
    }
    const TorqueRun run = run_of(h);
    const double top = *std::max_element(run.torque_Nm.begin(), run.torque_Nm.end());
    (fault ? s.band.with : s.band.without).push_back(most);
    (fault ? s.limit.with : s.limit.without).push_back(std::abs(top / highest - 1) / 0.25);
  };
  const auto stock = [&] { return d.between(0.92, 1.08); };
  const auto late = [&] { return d.between(-0.5, 1) * 0.8 * tolerance_s; };
  for (std::uint64_t k = 0; k < 2; ++k)
    score(changed(c, stock(), 1, late()), 10 * seed + 4 + k, false);
  // Depth half as large again or twice, or half of it; or the work is too far away.
  score(changed(c, stock(), d.between(1.5, 2), late()), 10 * seed + 6, true);
  score(changed(c, stock(), d.between(0.4, 0.6), late()), 10 * seed + 7, true);
  score(changed(c, stock(), 1, d.between(4, 6) * tolerance_s), 10 * seed + 8, true);
}

// ---- Drill fracture.

struct DrillStudy {
  Scores drill, plain;
  std::size_t holes_missed = 0, tools = 0;
};

// A drill in a machine whose x and y stand while the spindle turns.
struct Drilling {
  Cut machine;
  HostStackConfig config;
  double speed_rad_s, thrust_N, chips_N, balance_N;
};

struct Hole {
  double value_N = 0;    // of the monitor
  double lateral_N = 0;  // rms of both axes: what a plain limit sees
};

// One hole of 1 s, with a lateral force that turns with the tool.
Hole drill(const Drilling& of, double turning_N, std::uint64_t seed) {
  GaussianNoise noise(seed * 32 + 9);
  Record r;
  auto spindle = good(DriveSimulator::create(*of.machine.simulation.spindle), "spindle");
  auto x = good(DriveSimulator::create(*of.machine.simulation.x), "x");
  auto y = good(DriveSimulator::create(*of.machine.simulation.y), "y");
  const double up_s = of.speed_rad_s / 2000, from_s = up_s + 0.3, to_s = from_s + 1;
  const auto count = static_cast<std::size_t>((to_s + 0.1) / kPeriod_s);
  const double phase = kTwoPi * noise.uniform();
  const double scatter = std::exp(0.3 * noise.next());  // of a hole (test_drill_fracture.cpp)
  double chip_x = 0, chip_y = 0, angle = 0;
  std::vector<double> thrust;
  for (std::size_t i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) * kPeriod_s;
    const bool in = t >= from_s && t < to_s;
    // Chips: white noise behind a low-pass of 500 Hz, of rms chips_N.
    const double pole = 0.325, gain = std::sqrt((2 - pole) / pole);
    chip_x += pole * (noise.next() - chip_x);
    chip_y += pole * (noise.next() - chip_y);
    const double turning = in ? turning_N * scatter : 0;
    const double chips = in ? of.chips_N * scatter * gain : 0;
    r.drive[0].add(spindle.step(std::min(of.speed_rad_s, 2000 * t), in ? 0.002 * of.thrust_N : 0));
    angle = r.drive[0].position.back();
    r.drive[1].add(x.step(0, turning * std::sin(angle + phase) + chips * chip_x));
    r.drive[2].add(y.step(0, turning * std::cos(angle + phase) + chips * chip_y));
    thrust.push_back((in ? of.thrust_N : 0) + 10 * noise.next());
  }
  using Monitor = DrillFractureMonitor<double, 500, 1400>;
  static auto monitor = std::make_unique<Monitor>();
  DrillFractureConfig c;
  c.threshold_N = 1;
  c.drilling_thrust_N = of.thrust_N / 3;
  CHECK_TEXT(Monitor::validate(c).reason(), "");
  monitor->configure(c);
  std::array<DriveInput<double>, 3> input;
  std::array<DisturbanceObserver<double>, 2> observer;
  for (std::size_t i = 0; i < 3; ++i)
    input[i].configure(i == 0 ? of.config.spindle.input : of.config.axis[i - 1].input);
  for (std::size_t i = 0; i < 2; ++i) observer[i].configure(of.config.axis[i].tool_observer);
  Reporter<double> reporter(of.machine, r, seed);
  Hole h;
  double square = 0, n = 0;
  for (std::size_t i = 0; i < r.size(); ++i) {
    const ServoSample<double> raw = reporter.at(i);
    const DriveSample<double> turn = input[0].process(raw.spindle);
    const double fx = observer[0].process(input[1].process(raw.axis[0]));
    const double fy = observer[1].process(input[2].process(raw.axis[1]));
    monitor->process(fx, fy, thrust[i], turn.turn_angle_rad, turn.increment,
                     observer[0].state().quality | observer[1].state().quality);
    if (static_cast<double>(i) * kPeriod_s > from_s && static_cast<double>(i) * kPeriod_s < to_s)
      square += fx * fx + fy * fy, n += 1;
  }
  h.value_N = monitor->state().hole_N;
  h.lateral_N = std::sqrt(square / n);
  return h;
}

void drill_fracture(DrillStudy& s, std::uint64_t seed) {
  Drilling of{draw(seed, Event::none, Feature::none), {}, 0, 0, 0, 0};
  of.config = learned_stack(of.machine);
  detection::detail::Draw d(seed * 8 + 3);
  of.speed_rad_s = rad_s_from_rpm(d.scale(3000, 12000));
  of.thrust_N = d.scale(100, 600);
  of.chips_N = of.thrust_N * d.scale(0.01, 0.04);
  of.balance_N = of.thrust_N * d.between(0.002, 0.01);
  ++s.tools;
  IdleStatistics taught;
  double lateral = 0, highest = 0;
  std::uint64_t noise = 100 * seed;
  for (int hole = 0; hole < 6; ++hole) {
    const Hole h = drill(of, of.balance_N, ++noise);
    taught.add(h.value_N);
    highest = std::max(highest, h.value_N);
    lateral = std::max(lateral, h.lateral_N);
  }
  const double threshold = std::max(1.5 * highest, taught.mean() + 6 * taught.sigma());
  const auto add = [&](const Hole& h, bool broken) {
    if (h.value_N == 0) ++s.holes_missed;
    (broken ? s.drill.with : s.drill.without).push_back(h.value_N / threshold);
    (broken ? s.plain.with : s.plain.without).push_back(h.lateral_N / (1.5 * lateral));
  };
  for (int hole = 0; hole < 3; ++hole) add(drill(of, of.balance_N, ++noise), false);
  const double fracture = of.thrust_N * d.scale(0.03, 0.3);
  add(drill(of, fracture, ++noise), true);
}

// ---- Wear.

struct WearStudy {
  Scores wear, motor;
  std::size_t alarms_on_worn = 0, alarms_on_sharp = 0, holes_lost = 0;
};

// Twenty holes with one drill. The axis (that of x, upright) and the spindle turn and feed as
// commanded; thrust grows to `growth` of what it was, friction by `warmer_N` meanwhile.
void wear_of_a_drill(WearStudy& s, std::uint64_t seed, double growth) {
  const Cut machine = draw(seed, Event::none, Feature::none);
  const HostStackConfig config = learned_stack(machine);
  detection::detail::Draw d(seed * 8 + 5 + (growth > 1.3 ? 1 : 0));
  GaussianNoise chips(seed * 64 + 3);
  const double speed = rad_s_from_rpm(d.scale(2000, 9000)), thrust = d.scale(100, 600);
  const double feed = d.between(0.02, 0.04), warmer_N = d.between(-55, 55);
  constexpr int kHoles = 20, kTaught = 5;
  constexpr double kRatio = 1.5, kDepth_m = 0.015, kPoint_m = 1.8e-3, kClear_m = 4e-3;
  auto spindle = good(DriveSimulator::create(*machine.simulation.spindle), "spindle");
  auto axis = good(DriveSimulator::create(*machine.simulation.x), "axis");
  Trajectory way(0);
  for (int hole = 0; hole < kHoles; ++hole) {
    const auto move = [&](double to, double v) {
      (void)good(way.move_to(to, {v, 5, 500}), "move");
    };
    move(-0.02 + kClear_m, 0.4);  // the work begins at -20 mm
    move(-0.02 - kDepth_m, feed);
    move(0, 0.4);
    (void)good(way.dwell(0.1), "dwell");
  }
  const double up_s = speed / 2000 + 0.2;
  const auto count = static_cast<std::size_t>((up_s + way.duration_s()) / kPeriod_s);
  Record r;
  double slow = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) * kPeriod_s - up_s;
    const MotionPoint at = way.at(t);
    const double done = std::clamp(t / way.duration_s(), 0.0, 1.0);
    const double in = std::clamp((-0.02 - at.position) / kPoint_m, 0.0, 1.0);
    const bool cuts = in > 0 && at.velocity < 0;
    slow += 0.01 * (chips.next() - slow);  // chips of some milliseconds, rms a fourteenth
    const double share = cuts ? in * (1 + (growth - 1) * done) * (1 + 0.7 * slow) : 0;
    const double sign = at.velocity > 0 ? 1 : at.velocity < 0 ? -1 : 0;
    r.drive[0].add(spindle.step(std::min(speed, 2000 * (t + up_s)), 0.002 * thrust * share));
    // The work pushes back, toward +: that is a load below zero.
    r.drive[1].add(axis.step(at.position, sign * warmer_N * done - thrust * share));
    r.drive[2].add(DriveSimSample{});
  }
  WearConfig c;
  c.cutting_thrust_N = thrust / 3;
  c.thrust_ratio = kRatio;
  c.teach_holes = kTaught;
  c.equivalent_mass_kg = config.axis[0].observer.drive.inertia;
  c.inertia_kg_m2 = config.spindle.observer.drive.inertia;
  static auto monitor = std::make_unique<WearMonitor<double>>();
  CHECK_TEXT(WearMonitor<double>::validate(c).reason(), "");
  monitor->configure(c);
  DriveInput<double> turn, way_in;
  DisturbanceObserver<double> torque, force;
  turn.configure(config.spindle.input);
  way_in.configure(config.axis[0].input);
  DisturbanceObserverConfig slower = config.spindle.observer;
  slower.disturbance_cutoff_rad_s = slower.velocity_cutoff_rad_s = 500;
  torque.configure(slower);
  slower = config.axis[0].observer;
  slower.disturbance_cutoff_rad_s = slower.velocity_cutoff_rad_s = 500;
  force.configure(slower);
  Reporter<double> reporter(machine, r, seed);
  std::vector<double> levels, motor;  // of holes
  double effort = 0, samples = 0;
  for (std::size_t i = 0; i < r.size(); ++i) {
    const ServoSample<double> raw = reporter.at(i);
    const DriveSample<double> t = turn.process(raw.spindle), z = way_in.process(raw.axis[0]);
    const double torque_Nm = torque.process(t), force_N = force.process(z);
    // The estimate is positive against +motion; the monitor feeds toward -.
    monitor->process(force_N, z.increment, torque_Nm, t.increment,
                     torque.state().quality | force.state().quality);
    // The rival: mean motor force at feed.
    const double v = std::abs(way.at(static_cast<double>(i) * kPeriod_s - up_s).velocity);
    if (v > 0.9 * feed && v < 1.1 * feed) effort += std::abs(z.effort), samples += 1;
    if (monitor->tool().holes > levels.size()) {
      levels.push_back(std::abs(monitor->hole().thrust_N));
      motor.push_back(samples > 0 ? effort / samples : 0);
      effort = samples = 0;
    }
  }
  s.holes_lost += static_cast<std::size_t>(kHoles) - std::min<std::size_t>(kHoles, levels.size());
  const auto ratio = [&](const std::vector<double>& v) {
    double first = 0, most = 0;
    for (std::size_t i = 0; i < v.size(); ++i) {
      if (i < kTaught) first += v[i] / kTaught;
      if (i >= kTaught) most = std::max(most, (v[i] + v[i - 1] + v[i - 2]) / 3);
    }
    return first > 0 ? most / first / kRatio : 0;
  };
  const bool worn = growth > 1.3;
  (worn ? s.wear.with : s.wear.without).push_back(ratio(levels));
  (worn ? s.motor.with : s.motor.without).push_back(ratio(motor));
  if (monitor->tool().condition == MonitorState::alarm)
    ++(worn ? s.alarms_on_worn : s.alarms_on_sharp);
}

}  // namespace

int main(int argc, char** argv) {
  std::size_t cases = 3;
  std::uint64_t from = kFirstSeed;
  for (int i = 1; i < argc; ++i) {
    const std::string option = argv[i];
    if (option == "--nightly") cases = 300;
    if (option == "--cases" && i + 1 < argc) cases = std::strtoul(argv[++i], nullptr, 10);
    if (option == "--from" && i + 1 < argc) from = std::strtoul(argv[++i], nullptr, 10);
  }
  BandStudy band;
  DrillStudy drills;
  WearStudy wear;
  for (std::size_t i = 0; i < cases; ++i) {
    torque_band(band, from + i);
    drill_fracture(drills, from + i);
    detection::detail::Draw d((from + i) * 8 + 1);
    wear_of_a_drill(wear, from + i, d.between(0.95, 1.2));
    wear_of_a_drill(wear, from + i, d.between(2, 2.5));
  }
  std::printf("  seeds %llu to %llu\n", static_cast<unsigned long long>(from),
              static_cast<unsigned long long>(from + cases - 1));
  band.band.print("torque-band");
  band.limit.print("  highest torque +-25 %");
  drills.drill.print("drill-fracture");
  drills.plain.print("  lateral force, rms");
  std::printf("  holes without a verdict: %zu\n", drills.holes_missed);
  wear.wear.print("wear");
  wear.motor.print("  motor force at feed");
  std::printf("  wear: %zu alarms on worn, %zu on sharp drills; holes not counted: %zu\n",
              wear.alarms_on_worn, wear.alarms_on_sharp, wear.holes_lost);
  // What 150 machines gave, less three standard errors (docs/detection.md).
  CHECK(band.band.auc() > 0.995 && band.band.auc() > band.limit.auc());
  CHECK(drills.drill.auc() > 0.98 && drills.drill.auc() >= drills.plain.auc());
  CHECK(wear.wear.auc() > 0.99 && wear.alarms_on_sharp == 0);
  CHECK(wear.alarms_on_worn == wear.wear.with.size());
  return check::done();
}
