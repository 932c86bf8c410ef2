// Sound cuts, and contacts in them, from a second generator that shares nothing with
// random_cuts.hpp but its purpose: Kienzle forces with edges that push more than they cut, uneven
// pitch, work with gaps, a path with an arc on which both axes move and turn round, feed holds,
// drives with Stribeck friction, stiff loops, coarse currents. The collision monitor has seen an
// idling run and no cut.
//
//   test_sound_cuts                 a small fixed set
//   test_sound_cuts --nightly       300 of each
//   test_sound_cuts --cases N [--from SEED]
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "check.hpp"
#include "detection/scores.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/learn_thresholds.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/sim/gaussian_noise.hpp"

using namespace servosense;

namespace {

constexpr double kPeriod_s = 125e-6;
constexpr int kSteps = 4;  // of the simulation in a servo period
constexpr double kStep_s = kPeriod_s / kSteps;
constexpr double kNever = 1e9;

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : noise_(seed * 0x9e3779b97f4a7c15U + 77) {}
  double between(double low, double high) { return low + (high - low) * noise_.uniform(); }
  double scale(double low, double high) { return low * std::pow(high / low, noise_.uniform()); }
  int whole(int low, int high) {
    return std::min(high, low + int(noise_.uniform() * (high - low + 1)));
  }
  bool chance(double p) { return noise_.uniform() < p; }

 private:
  GaussianNoise noise_;
};

/// Motor, load and cascade of a drive; rad and Nm, or m and N.
struct Drive {
  double inertia = 0, viscous = 0, coulomb = 0, knee = 0;
  double loop_rad_s = 0, position_per_s = 0;  // 0: a speed is commanded
  double per_ampere = 0, noise_A = 0, resolution_A = 0, unit_per_turn = 0;
  int bits = 20, hold = 1;

  double x = 0, v = 0, integral = 0, effort = 0, last_command = 0, heard_A = 0;

  void control(double command) {
    double wanted = command;
    if (position_per_s > 0) {
      wanted = position_per_s * (command - x) + (command - last_command) / kPeriod_s;
      last_command = command;
    }
    integral += (wanted - v) * loop_rad_s / 6 * kPeriod_s;
    effort = inertia * loop_rad_s * (wanted - v + integral) + viscous * v;
  }
  void advance(double load) {
    const double slip = v / knee;
    const double friction = coulomb * (1 + 0.3 * std::exp(-slip * slip / 400)) * std::tanh(slip);
    v += kStep_s * (effort - load - viscous * v - friction) / inertia;
    x += kStep_s * v;
  }
  RawDriveSample<double> report(int n, GaussianNoise& noise) {
    RawDriveSample<double> raw;
    raw.counts =
        static_cast<std::int64_t>(std::floor(x / unit_per_turn * std::ldexp(1, bits))) & 0xffffffff;
    if (n % hold == 0)
      heard_A =
          resolution_A * std::round((effort / per_ampere + noise_A * noise.next()) / resolution_A);
    else
      raw.effort_quality = Quality::held;
    raw.effort = heard_A;
    return raw;
  }
};

struct Gap {
  double from_m, to_m;
};

struct Case {
  std::uint64_t seed = 0;
  // Tool and cut.
  double radius_m = 0, helix = 0, depth_m = 0, speed_rad_s = 0, feed_m = 0;
  double from_m = 0, to_m = 0;  // width of the cut, across the feed
  std::vector<double> pitch, runout_m;
  double kc = 0, mc = 0, radial = 0, edge_t = 0, edge_r = 0;  // N, mm
  // Path: straight, arc, straight; the work along it.
  double heading = 0, straight_m = 0, arc_radius_m = 0, arc = 0, length_m = 0, begins_m = 0;
  std::vector<Gap> gaps;
  double hold_at_m = kNever, hold_s = 0;
  // Contact.
  double touch_m = kNever, stiffness = 0, gives_way_N = 0;
  std::array<Drive, 3> drive;
  std::array<double, 3> told{};  // parameters in the machine file over the true ones

  [[nodiscard]] bool solid(double along_m) const {
    if (along_m < begins_m || along_m > length_m) return false;
    for (const Gap& gap : gaps)
      if (along_m > gap.from_m && along_m < gap.to_m) return false;
    return true;
  }
  [[nodiscard]] double heading_at(double s) const {
    const double turned = std::clamp((s - straight_m) / arc_radius_m, 0.0, std::abs(arc));
    return heading + std::copysign(turned, arc);
  }
};

Case draw(std::uint64_t seed, bool contact) {
  Draw d(2 * seed + (contact ? 1 : 0));
  Case c;
  c.seed = seed;
  c.radius_m = d.scale(3e-3, 16e-3);
  const int teeth = d.whole(1, 6);
  for (int i = 0; i < teeth; ++i)
    c.pitch.push_back(kTwoPi * (i + (teeth > 1 ? d.between(-0.04, 0.04) : 0)) / teeth);
  c.helix = d.between(0, 0.7);
  c.speed_rad_s = d.scale(0.8, 7) / c.radius_m;
  const double per_tooth_m = c.radius_m * d.between(0.004, 0.015);
  for (int i = 0; i < teeth; ++i) c.runout_m.push_back(per_tooth_m * d.between(-0.15, 0.15));
  c.feed_m = per_tooth_m * teeth * c.speed_rad_s / kTwoPi;
  c.depth_m = c.radius_m * d.scale(0.1, 1);
  const double wide = d.scale(0.05, 1) * 2 * c.radius_m;
  c.from_m = d.chance(0.5) ? -c.radius_m : c.radius_m - wide;
  c.to_m = c.from_m + wide;
  c.kc = d.between(500, 2000);
  c.mc = d.between(0.2, 0.3);
  c.radial = d.between(0.2, 0.6);
  c.edge_t = d.between(3, 20);
  c.edge_r = c.edge_t * d.between(0.8, 1.8);
  c.heading = d.between(0, kTwoPi);
  c.begins_m = c.radius_m + c.feed_m * 0.1;
  const double seconds = d.between(1.2, 2);
  c.straight_m = c.begins_m + c.feed_m * 0.4 * seconds;
  c.arc_radius_m = d.scale(5e-3, 40e-3);
  c.arc = std::min(c.feed_m * seconds / 2 / c.arc_radius_m, 4.0) * (d.chance(0.5) ? 1 : -1);
  c.length_m = c.begins_m + c.feed_m * seconds * (d.chance(0.5) ? 0.8 : 2);
  if (d.chance(0.6)) {
    const double wide_m = d.scale(0.2, 3) * c.radius_m;
    for (double at = c.begins_m + c.feed_m * 0.2; at < c.length_m; at += d.between(2, 4) * wide_m)
      c.gaps.push_back({at, at + wide_m});
  }
  if (d.chance(0.4)) {
    c.hold_at_m = c.begins_m + c.feed_m * d.between(0.2, 1);
    c.hold_s = d.between(0.02, 0.3);
  }
  if (contact) {
    c.touch_m = c.begins_m + c.feed_m * d.between(0.1, 1.2);
    c.stiffness = d.scale(1e6, 20e6);
    c.gives_way_N = d.scale(300, 2000);
  }
  // Largest torque of the cut: the spindle is made for it.
  const double h_mm = 1e3 * per_tooth_m;
  const double force = 1e3 * c.depth_m * (c.kc * std::pow(h_mm, 1 - c.mc) + c.edge_t);
  const double rated = force * c.radius_m * d.between(1.5, 10);
  Drive& s = c.drive[0];
  s.inertia = rated * d.between(1.5e-4, 4e-4);
  s.viscous = rated * d.between(1e-5, 6e-5);
  s.coulomb = rated * d.between(0.003, 0.015);
  s.knee = 0.5;
  s.loop_rad_s = kTwoPi * d.between(10, 60);
  s.per_ampere = rated / 20;
  s.unit_per_turn = kTwoPi;
  for (std::size_t i = 1; i < 3; ++i) {
    Drive& a = c.drive[i];
    a.inertia = d.scale(80, 500);
    a.viscous = a.inertia * d.between(1, 6);
    a.coulomb = a.inertia * d.between(0.2, 1);
    a.knee = 3e-4;
    a.loop_rad_s = kTwoPi * d.between(25, 60);
    a.position_per_s = a.loop_rad_s / 5;
    a.per_ampere = 250;
    a.unit_per_turn = 0.016;
  }
  for (Drive& one : c.drive) {
    one.bits = d.whole(17, 23);
    one.hold = 1 << d.whole(0, 3);
    one.noise_A = d.between(0.005, 0.05);
    one.resolution_A = 80.0 / (1 << d.whole(12, 16));
  }
  for (double& t : c.told) t = d.between(0.97, 1.03);
  return c;
}

struct Loads {
  double torque_Nm = 0, x_N = 0, y_N = 0;
};

// Of the teeth at a spindle angle, the tool's centre s along the path.
Loads cut(const Case& c, double angle, double s, double feed_m_s, double heading) {
  Loads sum;
  constexpr int kSlices = 6;
  const double period_s = kTwoPi / c.speed_rad_s / static_cast<double>(c.pitch.size());
  const double slice_mm = 1e3 * c.depth_m / kSlices;
  for (std::size_t i = 0; i < c.pitch.size(); ++i)
    for (int k = 0; k < kSlices; ++k) {
      const double lag = c.depth_m * (k + 0.5) / kSlices * std::tan(c.helix) / c.radius_m;
      const double a = angle + c.pitch[i] - lag;  // from the direction of feed
      const double ahead = std::cos(a), across_m = c.radius_m * std::sin(a);
      if (ahead <= 0 || across_m < c.from_m || across_m > c.to_m) continue;
      if (!c.solid(s + c.radius_m * ahead)) continue;
      const double before_m = c.runout_m[(i + 1) % c.pitch.size()];
      const double h_mm = 1e3 * (feed_m_s * period_s * ahead + c.runout_m[i] - before_m);
      if (h_mm <= 0) continue;
      const double chip = c.kc * std::pow(h_mm, 1 - c.mc);
      const double tangential = slice_mm * (chip + c.edge_t);
      const double radial = slice_mm * (c.radial * std::pow(h_mm / 0.1, -0.15) * chip + c.edge_r);
      sum.torque_Nm += tangential * c.radius_m;
      const double at = a + heading;
      sum.x_N += tangential * -std::sin(at) + radial * std::cos(at);
      sum.y_N += tangential * std::cos(at) + radial * std::sin(at);
    }
  return sum;
}

struct Trace {
  std::vector<ServoSample<double>> samples;
  double touch_s = kNever;
};

// The part; or, idle, some moves at 9 m/min and the program in the air.
Trace simulate(Case c, bool idle) {
  Trace t;
  GaussianNoise noise(c.seed * 31 + (idle ? 1 : 2));
  const double top = c.speed_rad_s;
  const double up_s = 0.3, wait_s = 0.3;
  double s = 0, speed = 0, x = 0, y = 0, held_s = 0;
  bool lost = false;
  const double fast_s = idle ? 1.2 : 0;  // to and fro, before the program
  const double starts_s = up_s + wait_s + fast_s;
  for (int n = 0; n * kPeriod_s < starts_s + 2.4; ++n) {
    const double now = n * kPeriod_s;
    double wanted = 0;
    if (now > starts_s) {
      wanted = c.feed_m;
      if (s > c.hold_at_m && held_s < c.hold_s) {
        wanted = 0;
        held_s += kPeriod_s;
      }
    } else if (now > up_s + wait_s) {
      const double into = std::fmod((now - up_s - wait_s) / fast_s, 0.5);
      wanted = into < 0.2 ? 0.15 : into < 0.4 ? -0.15 : 0;
    }
    const double step = 3 * kPeriod_s;  // 3 m/s2
    speed += std::clamp(wanted - speed, -step, step);
    s += speed * kPeriod_s;
    const double heading = c.heading_at(s);
    x += speed * kPeriod_s * std::cos(heading);
    y += speed * kPeriod_s * std::sin(heading);
    c.drive[0].control(top * std::min(1.0, now / up_s));
    c.drive[1].control(x);
    c.drive[2].control(y);
    for (int k = 0; k < kSteps; ++k) {
      Loads load;
      if (!idle) {
        load = cut(c, c.drive[0].x, s, speed, heading);
        const double into_m = s - c.touch_m;
        if (into_m > 0 && !lost) {
          if (t.touch_s == kNever) t.touch_s = now;
          const double force = c.stiffness * into_m;
          lost = force > c.gives_way_N;
          load.x_N += force * std::cos(heading);
          load.y_N += force * std::sin(heading);
        }
      }
      c.drive[0].advance(load.torque_Nm);
      c.drive[1].advance(load.x_N);
      c.drive[2].advance(load.y_N);
    }
    ServoSample<double> sample;
    sample.t_ns = static_cast<Nanoseconds>(n) * 125'000;
    sample.spindle = c.drive[0].report(n, noise);
    sample.axis[0] = c.drive[1].report(n, noise);
    sample.axis[1] = c.drive[2].report(n, noise);
    t.samples.push_back(sample);
  }
  return t;
}

// What the machine's file says after an idling run.
MachineFile learned(const Case& c) {
  auto parsed = MachineFile::parse("[machine]\nname = drawn\n", "drawn.ini");
  MachineFile f = *std::move(parsed);
  const char* sections[] = {"spindle", "axis.x", "axis.y"};
  for (std::size_t i = 0; i < 3; ++i) {
    const Drive& d = c.drive[i];
    const std::string name = sections[i];
    const bool turns = i == 0;
    f.set(name, turns ? "inertia_kg_m2" : "equivalent_mass_kg", c.told[i] * d.inertia);
    f.set(name, turns ? "viscous_friction_Nm_s_per_rad" : "viscous_friction_N_s_per_m",
          c.told[(i + 1) % 3] * d.viscous);
    f.set(name, turns ? "coulomb_friction_Nm" : "coulomb_friction_N",
          c.told[(i + 2) % 3] * d.coulomb);
    f.set(name, turns ? "torque_constant_Nm_per_A" : "force_constant_N_per_A", d.per_ampere);
    f.set(name, "encoder_counts_per_rev", std::ldexp(1.0, d.bits));
    f.set(name, "counter_bits", 32);
    f.set(name, "current_update_hz", 8000.0 / d.hold);
    if (!turns) f.set(name, "lead_m", d.unit_per_turn);
    if (!turns) f.set(name, "friction_knee_m", 3e-7);  // speed decides here, not travel
  }
  StackSignals signals;
  signals.spindle = signals.axis[0] = signals.axis[1] =
      DriveSignal{MotionKind::counts, EffortKind::current_A};
  const StackPlan plan = *plan_stack(f, signals);
  const Trace idle = simulate(c, true);
  for (std::size_t i = 0; i < 3; ++i) {
    DriveInput<double> input;
    input.configure(i == 0 ? plan.config.spindle.input : plan.config.axis[i - 1].input);
    DriveRecord record;
    record.sample_period_s = kPeriod_s;
    for (const auto& s : idle.samples)
      record.samples.push_back(input.process(i == 0 ? s.spindle : s.axis[i - 1]));
    const std::string name = i == 1 ? "x" : "y";
    if (i == 0) {
      f.set("monitor.collision", "cutting_torque_Nm",
            learn_cutting_torque(plan.config.spindle.monitor_observer, plan.config.cut, record));
      continue;
    }
    const HostAxisSlotConfig& axis = plan.config.axis[i - 1];
    const auto jerk = learn_collision(axis.monitor_observer, axis.collision, record);
    f.set("monitor.collision", "threshold_" + name + "_N_per_s", jerk.threshold());
    std::vector<double> phases;
    for (const auto phase : {MotionPhase::standstill, MotionPhase::constant_speed,
                             MotionPhase::acceleration, MotionPhase::reversal})
      phases.push_back(jerk.phase_threshold(phase));
    f.set("monitor.collision", "phase_thresholds_" + name + "_N_per_s",
          std::span<const double>(phases));
  }
  return f;
}

// Time of the first collision alarm from `from_s` on.
double alarm_s(const MachineFile& machine, const Trace& trace, double from_s) {
  StackSignals signals;
  signals.spindle = signals.axis[0] = signals.axis[1] =
      DriveSignal{MotionKind::counts, EffortKind::current_A};
  const StackPlan plan = *plan_stack(machine, signals);
  static auto stack = std::make_unique<HostStack>();
  prepare(*stack, plan);
  for (const auto& sample : trace.samples)
    for (const auto& change : stack->process(sample))
      if (change.monitor == MonitorId::collision && change.state == MonitorState::alarm &&
          1e-9 * static_cast<double>(sample.t_ns) >= from_s)
        return 1e-9 * static_cast<double>(sample.t_ns);
  return kNever;
}

}  // namespace

int main(int argc, char** argv) {
  std::size_t cases = 8;
  std::uint64_t from = 800000;
  for (int i = 1; i < argc; ++i) {
    const std::string option = argv[i];
    const auto next = [&] { return i + 1 < argc ? argv[++i] : "0"; };
    if (option == "--nightly") cases = 300;
    if (option == "--cases") cases = std::strtoul(next(), nullptr, 10);
    if (option == "--from") from = std::strtoul(next(), nullptr, 10);
  }
  std::size_t alarms = 0, alarms_by_torque = 0, contacts = 0, found = 0;
  std::vector<double> delay_ms;
  for (std::uint64_t seed = from; seed < from + cases; ++seed) {
    const Case sound = draw(seed, false);
    MachineFile machine = learned(sound);
    const Trace trace = simulate(sound, false);
    const double plain_s = alarm_s(machine, trace, 0);
    machine.set("tool", "diameter_m", 2 * sound.radius_m);
    const double torque_s = alarm_s(machine, trace, 0);
    if (plain_s < kNever) ++alarms;
    if (torque_s < kNever) ++alarms_by_torque;
    if (plain_s < kNever || torque_s < kNever)
      std::printf("  seed %llu: false alarm at %.4f s, with the tool's diameter %.4f s\n",
                  static_cast<unsigned long long>(seed), plain_s, torque_s);
    const Case hit = draw(seed, true);
    const Trace crash = simulate(hit, false);
    if (crash.touch_s == kNever) continue;
    MachineFile second = learned(hit);
    second.set("tool", "diameter_m", 2 * hit.radius_m);
    ++contacts;
    const double t = alarm_s(second, crash, crash.touch_s);
    if (t > crash.touch_s + 0.05) continue;
    ++found;
    delay_ms.push_back(1e3 * (t - crash.touch_s));
  }
  std::sort(delay_ms.begin(), delay_ms.end());
  const detection::Interval none = detection::wilson(0, static_cast<double>(cases));
  std::printf(
      "  %zu sound cuts (%zu without an alarm: below %.2g %%): alarms %zu, with the tool's "
      "diameter %zu; contacts found by it %zu of %zu, after %.1f ms (median)\n",
      cases, cases, 100 * none.high, alarms, alarms_by_torque, found, contacts,
      delay_ms.empty() ? 0.0 : delay_ms[delay_ms.size() / 2]);
  // None of seeds 1 to 60; the torque must not add to them.
  CHECK(20 * alarms <= cases + 20);
  CHECK(alarms_by_torque <= alarms);
  CHECK(2 * found + 4 >= contacts);
  return check::done();
}
