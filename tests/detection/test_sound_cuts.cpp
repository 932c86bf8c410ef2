// Sound cuts, and contacts in them, from a second generator that shares nothing with
// random_cuts.hpp but its purpose: Kienzle forces with edges that push more than they cut, uneven
// pitch, work with gaps, a path with an arc on which both axes move and turn round, feed holds,
// drives with Stribeck friction, stiff loops, coarse currents. The collision monitor has seen an
// idling run and no cut.
//
//   sound_cuts                 a small fixed set
//   sound_cuts --nightly       300 of each
//   sound_cuts --cases N [--from SEED]
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
#include "detection/second_machine.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/learn_thresholds.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/sim/gaussian_noise.hpp"

using namespace servosense;
using detection::second::Draw;
using detection::second::kPeriod_s;
using detection::second::Machine;
using detection::second::plan_for;

namespace {

constexpr int kSteps = 4;  // of the simulation in a servo period
constexpr double kStep_s = kPeriod_s / kSteps;
constexpr double kNever = 1e9;

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
  Machine machine;

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
  c.machine = detection::second::draw_machine(d, rated);
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
  detection::second::Samples samples;
  double touch_s = kNever;
};

// The part; or, idle, some moves at 9 m/min and the program in the air.
Trace simulate(Case c, bool idle) {
  Trace t;
  GaussianNoise noise(c.seed * 31 + (idle ? 1 : 2));
  const double top = c.speed_rad_s;
  const double up_s = 0.3, wait_s = 0.3;
  auto& drive = c.machine.drive;
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
    drive[0].control(top * std::min(1.0, now / up_s));
    drive[1].control(x);
    drive[2].control(y);
    for (int k = 0; k < kSteps; ++k) {
      Loads load;
      if (!idle) {
        load = cut(c, drive[0].x, s, speed, heading);
        const double into_m = s - c.touch_m;
        if (into_m > 0 && !lost) {
          if (t.touch_s == kNever) t.touch_s = now;
          const double force = c.stiffness * into_m;
          lost = force > c.gives_way_N;
          load.x_N += force * std::cos(heading);
          load.y_N += force * std::sin(heading);
        }
      }
      drive[0].advance(load.torque_Nm, kStep_s);
      drive[1].advance(load.x_N, kStep_s);
      drive[2].advance(load.y_N, kStep_s);
    }
    ServoSample<double> sample;
    sample.t_ns = static_cast<Nanoseconds>(n) * 125'000;
    sample.spindle = drive[0].report(n, noise);
    sample.axis[0] = drive[1].report(n, noise);
    sample.axis[1] = drive[2].report(n, noise);
    t.samples.push_back(sample);
  }
  return t;
}

MachineFile learned(const Case& c) {
  return detection::second::learned(c.machine, simulate(c, true).samples);
}

// Time of the first collision alarm from `from_s` on.
double alarm_s(const MachineFile& machine, const Trace& trace, double from_s) {
  const StackPlan plan = plan_for(machine);
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
