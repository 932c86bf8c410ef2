// One stack, both subsystems: programs are predicted, run on a simulated machine and watched, by
// the monitors with what the program says and by the same ones without it. The figures are those of
// docs/monitor-stack.md.
//
//   one_stack                    one part
//   one_stack --nightly          12 parts
//   one_stack --cases N [--from SEED]
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "check.hpp"
#include "detection/milled_passes.hpp"
#include "predicted_part.hpp"
#include "program.hpp"
#include "seed_range.hpp"
#include "servosense/monitors/machine_stack.hpp"

namespace {

using namespace servosense;
using namespace program_test;
namespace passes = detection::passes;
using passes::Course;
using passes::kNever;
using passes::Part;
using passes::Trace;

/// A collision is told in time, a broken tooth before much is cut.
constexpr double kInTime_s = 0.05, kToothInTime_s = 0.5;

struct Watched {
  struct Alarm {
    MonitorId monitor;
    double t_s;
  };
  std::vector<Alarm> alarms;
  int changes = 0;           // of the coefficients
  double specific_N_m2 = 0;  // specific cutting force; 0: not told

  [[nodiscard]] double first(MonitorId monitor, double from_s = 0) const {
    for (const Alarm& a : alarms)
      if (a.monitor == monitor && a.t_s >= from_s) return a.t_s;
    return kNever;
  }
};

StackPlan plan_of(const MachineFile& machine, bool told) {
  StackSignals signals;
  signals.spindle = signals.axis[0] = signals.axis[1] =
      DriveSignal{MotionKind::counts, EffortKind::current_A};
  signals.nc_block = true;
  StackPlan plan = detection::good(plan_stack(machine, signals), "plan");
  if (!told) {
    plan.engagement_shares.clear();
    plan.config.tool.torque_band.has_cuts = false;
  }
  return plan;
}

Watched watch(const StackPlan& plan, const Trace& trace) {
  MachineStack stack(plan);
  Watched w;
  for (const auto& s : trace.samples) {
    MachineServoSample all;
    all.t_ns = s.t_ns;
    all.nc_block = s.nc_block;
    all.feed_override = s.feed_override;
    all.spindle = s.spindle;
    for (std::size_t i = 0; i < 2; ++i) all.axis[i] = s.axis[i];
    for (const auto& change : stack.process(all))
      if (change.state == MonitorState::alarm)
        w.alarms.push_back({change.monitor, 1e-9 * static_cast<double>(s.t_ns)});
  }
  if (const auto* c = stack.coefficients()) {
    w.changes = static_cast<int>(c->state().changes);
    if (c->specific_force().told) w.specific_N_m2 = c->specific_force().value;
  }
  return w;
}

/// With the program and without.
struct Score {
  const char* what;
  int runs = 0;
  std::array<int, 2> found{}, alarms{};
  std::array<std::vector<double>, 2> delay_ms{};

  void add(int with, double event_s, double alarm_s, double in_time_s) {
    if (!(alarm_s <= event_s + in_time_s)) return;
    ++found[static_cast<std::size_t>(with)];
    delay_ms[static_cast<std::size_t>(with)].push_back(1e3 * (alarm_s - event_s));
  }
  [[nodiscard]] double median_ms(std::size_t i) {
    auto& d = delay_ms[i];
    std::sort(d.begin(), d.end());
    return d.empty() ? 0 : d[d.size() / 2];
  }
  void print() {
    std::printf("  %-34s of %3d: with the program %3d after %6.1f ms, without %3d after %6.1f ms\n",
                what, runs, found[1], median_ms(1), found[0], median_ms(0));
  }
};

Score touched{"contacts in the cut"}, in_air{"contacts in the air"}, clamp{"a clamp milled into"},
    tooth{"broken teeth"};
struct Sound {
  int runs = 0;
  std::array<int, 2> collision{}, tooth{}, ar{}, changes{};
  int band = 0;
  std::array<std::vector<double>, 2> error{};  // of the specific cutting force
} sound_runs;
void hear_sound(const Part& p, const Course& c, const std::array<StackPlan, 2>& plans) {
  const Trace trace = passes::simulate(p, c);
  ++sound_runs.runs;
  for (std::size_t i = 0; i < 2; ++i) {
    const Watched w = watch(plans[i], trace);
    for (const auto& a : w.alarms) {
      sound_runs.collision[i] += a.monitor == MonitorId::collision;
      sound_runs.tooth[i] += a.monitor == MonitorId::tooth_breakage;
      sound_runs.ar[i] += a.monitor == MonitorId::ar_breakage;
      if (i == 1) sound_runs.band += a.monitor == MonitorId::torque_band;
      std::printf("    %s: %s at %.4f s\n", i == 1 ? "with" : "without",
                  std::string(name_of(a.monitor)).c_str(), a.t_s);
    }
    sound_runs.changes[i] += w.changes;
    if (!(w.specific_N_m2 > 0)) continue;
    const auto [slope, rest] = passes::linear_law(p);
    const CuttingShares& s = plans[i].coefficients->shares;
    const double chip_mm = 1e3 * p.feed_m * s.torque_chip_m3 / s.torque_edge_m2;
    const double truth = 1e6 * c.harder * (slope + (rest + p.edge_t) / chip_mm);
    sound_runs.error[i].push_back(std::abs(w.specific_N_m2 / truth - 1));
  }
}

void hear_fault(const Part& p, const Course& c, const std::array<StackPlan, 2>& plans, Score& score,
                MonitorId monitor, double in_time_s) {
  const Trace trace = passes::simulate(p, c);
  if (trace.event_s == kNever) return;
  ++score.runs;
  for (std::size_t i = 0; i < 2; ++i) {
    const Watched w = watch(plans[i], trace);
    const double t = w.first(monitor, trace.event_s);
    score.add(static_cast<int>(i), trace.event_s, t, in_time_s);
    if (w.first(monitor) < trace.event_s) ++score.alarms[i];
  }
}

void part(std::uint64_t seed) {
  const Part p = passes::draw(seed);
  predict(p, passes::learned(p));
  const std::string file = (folder / "machine.ini").string();
  const MachineFile read = detection::good(MachineFile::read(file), "read");
  const std::array<StackPlan, 2> plans = {plan_of(read, false), plan_of(read, true)};
  CHECK(plans[1].engagements.size() >= p.passes.size());
  std::printf("  seed %llu: %zu teeth, %.1f mm, %.0f rpm, %.1f mm/s\n",
              static_cast<unsigned long long>(seed), p.teeth(), 1e3 * p.radius_m,
              p.speed_rad_s * 60 / kTwoPi, 1e3 * p.feed_m_s());
  detection::second::Draw d(seed * 13 + 1);
  const auto plain = [&] {
    Course c;
    c.harder = d.between(0.95, 1.05);
    c.stock_m = d.between(-0.15e-3, 0.15e-3);
    return c;
  };
  Course c = plain();
  hear_sound(p, c, plans);
  c = plain();
  c.slower_from_s = d.between(1, 15);
  c.slower = d.between(0.6, 1.2);
  c.hold_pass = static_cast<std::size_t>(d.whole(0, 3));
  hear_sound(p, c, plans);

  c = plain();
  c.goes_on_s = 0.6;
  c.pass = static_cast<std::size_t>(d.whole(0, 3));
  c.fault = Course::Fault::contact;
  c.stiffness = d.scale(1e6, 20e6);
  c.gives_way_N = d.scale(300, 2000);
  c.at_m = d.between(0.01, 0.05);
  hear_fault(p, c, plans, touched, MonitorId::collision, kInTime_s);
  c.at_m = -p.radius_m - d.between(0.4, 0.8) * p.feed_m_s();
  hear_fault(p, c, plans, in_air, MonitorId::collision, kInTime_s);
  c.fault = Course::Fault::tooth;
  c.at_m = d.between(0.01, 0.05);
  hear_fault(p, c, plans, tooth, MonitorId::tooth_breakage, kToothInTime_s);
  c.fault = Course::Fault::clamp;
  c.goes_on_s = 1.5;
  c.at_m = passes::kBlock_m + 1.5 * p.radius_m + d.between(0.4, 0.8) * p.feed_m_s();
  hear_fault(p, c, plans, clamp, MonitorId::collision, kInTime_s);
}

double median(std::vector<double> of) {
  std::sort(of.begin(), of.end());
  return of.empty() ? 0 : of[of.size() / 2];
}

void print() {
  const Sound& s = sound_runs;
  std::printf(
      "  %d sound runs, with the program and without: collision %d, %d; tooth-breakage "
      "%d, %d; ar-breakage %d, %d; torque-band %d; false changes of coefficients %d, %d\n",
      s.runs, s.collision[1], s.collision[0], s.tooth[1], s.tooth[0], s.ar[1], s.ar[0], s.band,
      s.changes[1], s.changes[0]);
  std::printf(
      "  specific cutting force: with the program told in %zu, off by %.1f %% (median), "
      "without in %zu, off by %.1f %%\n",
      s.error[1].size(), 100 * median(s.error[1]), s.error[0].size(), 100 * median(s.error[0]));
  for (Score* score : {&touched, &in_air, &clamp, &tooth}) {
    score->print();
    std::printf("    alarms before: %d, %d\n", score->alarms[1], score->alarms[0]);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  const check::SeedRange seeds = check::seed_range(
      argc, argv, nightly ? check::SeedRange{971001, 12} : check::SeedRange{1, 1});
  return in_own_folder("one_stack", [&] {
    for (std::uint64_t seed = seeds.from; seed < seeds.from + seeds.cases; ++seed) {
      part(seed);
      if (seed + 1 < seeds.from + seeds.cases) print();
    }
    print();
    const Sound& s = sound_runs;
    CHECK(s.collision[1] <= s.collision[0] + s.runs / 20);
    CHECK(touched.found[1] >= touched.found[0]);
    CHECK(in_air.found[1] >= in_air.found[0]);
    CHECK(clamp.found[1] > clamp.found[0]);
    CHECK(s.changes[1] < s.changes[0] || s.changes[0] == 0);
  });
}
