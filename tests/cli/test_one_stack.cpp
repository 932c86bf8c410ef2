// One stack, both subsystems: programs are predicted, run on a simulated machine and watched, by
// the monitors with what the program says and by the same ones without it. The figures are those of
// docs/monitor-stack.md.
//
//   one_stack                    one part
//   one_stack --nightly          30 parts
//   one_stack --cases N [--from SEED]
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "check.hpp"
#include "detection/milled_passes.hpp"
#include "program.hpp"
#include "servosense/monitors/machine_stack.hpp"

namespace {

using namespace servosense;
using namespace program_test;
namespace passes = detection::passes;
using passes::Course;
using passes::Part;
using passes::Trace;

struct Alarm {
  MonitorId monitor;
  Channel channel;
  double t_s;
  std::size_t sample;
};

struct Watched {
  std::vector<Alarm> alarms;
  [[nodiscard]] double first(MonitorId monitor, double from_s = 0) const {
    for (const Alarm& a : alarms)
      if (a.monitor == monitor && a.t_s >= from_s) return a.t_s;
    return passes::kNever;
  }
};

StackPlan plan_of(const MachineFile& machine, bool told) {
  StackSignals signals;
  signals.spindle = signals.axis[0] = signals.axis[1] =
      DriveSignal{MotionKind::counts, EffortKind::current_A};
  signals.nc_block = true;
  StackPlan plan = detection::good(plan_stack(machine, signals), "plan");
  if (!told) {
    plan.expected_cuts.clear();
    plan.engagement_shares.clear();
    plan.config.tool.torque_band.has_cuts = false;
  }
  return plan;
}

Watched watch(const StackPlan& plan, const Trace& trace) {
  MachineStack stack(plan);
  Watched w;
  std::size_t n = 0;
  for (const auto& sample : trace.samples) {
    MachineServoSample all;
    all.t_ns = sample.t_ns;
    all.nc_block = sample.nc_block;
    all.feed_override = sample.feed_override;
    all.spindle = sample.spindle;
    for (std::size_t i = 0; i < 2; ++i) all.axis[i] = sample.axis[i];
    for (const auto& change : stack.process(all))
      if (change.state == MonitorState::alarm ||
          (change.state == MonitorState::warning &&
           change.monitor == MonitorId::cutting_coefficients)) {
        w.alarms.push_back(
            {change.monitor, change.channel, 1e-9 * static_cast<double>(sample.t_ns), n});
        if (std::getenv("DBG")) {
          const auto& st = stack.first();
          const auto& c = st.tool().torque_band().core();
          const auto* e = st.expected_cut();
          std::printf(
              "    %.4f %s/%s m %.3f e %.3f [%.3f %.3f] shift %.3f cell %u line %d kind %d | x "
              "%.0f [%.0f %.0f] y %.0f [%.0f %.0f] jerk %.3g/%.3g\n",
              1e-9 * double(sample.t_ns), std::string(name_of(change.monitor)).c_str(),
              std::string(name_of(change.channel)).c_str(), c.measured_Nm, c.expected_Nm,
              c.lower_Nm, c.upper_Nm, c.shift, st.tool().torque_band().cell(), sample.nc_block,
              e ? int(e->kind) : -1, st.axis(0).estimate, e ? e->force[0].least_N : 0,
              e ? e->force[0].most_N : 0, st.axis(1).estimate, e ? e->force[1].least_N : 0,
              e ? e->force[1].most_N : 0, change.value, change.threshold);
        }
      }
    ++n;
  }
  return w;
}

const char* text(double t) {
  static char texts[8][24];
  static int at = 0;
  char* s = texts[at++ % 8];
  if (t == passes::kNever)
    std::snprintf(s, 24, "-");
  else
    std::snprintf(s, 24, "%.4f", t);
  return s;
}

void part(std::uint64_t seed) {
  const Part p = passes::draw(seed);
  MachineFile machine = passes::learned(p);
  machine.set("monitor.torque-band", "reference", "steps.csv");
  put("part.ngc", passes::program_of(p));
  const std::string file = (folder / "machine.ini").string();
  if (const auto done = machine.write(file); !done)
    return check::that(false, done.error().sentence.c_str(), __FILE__, __LINE__);
  const Outcome o =
      run("program predict part.ngc --machine machine.ini --stock-tolerance 0.0002 --quiet --out "
          "steps.csv " +
          passes::stock_of(p));
  that(o.status == 0, o, "is predicted", __LINE__);
  const MachineFile read = detection::good(MachineFile::read(file), "read");
  const StackPlan with = plan_of(read, true), without = plan_of(read, false);
  detection::second::Draw d(seed * 13 + 1);
  std::printf("seed %llu: z%zu r %.1f mm %.0f rpm, %.1f mm/s, %zu points %zu engagements\n",
              (unsigned long long)seed, p.teeth(), 1e3 * p.radius_m, p.speed_rad_s * 60 / kTwoPi,
              1e3 * p.feed_m_s(), with.expected_cuts.size(), with.engagements.size());
  const auto report = [&](const char* what, const Course& c) {
    const Trace trace = passes::simulate(p, c);
    for (const auto* plan : {&with, &without}) {
      const Watched w = watch(*plan, trace);
      std::printf("  %-8s %-7s event %s:", what, plan == &with ? "with" : "without",
                  text(trace.event_s));
      for (const Alarm& a : w.alarms)
        std::printf(" %s/%s %.4f", std::string(name_of(a.monitor)).c_str(),
                    std::string(name_of(a.channel)).c_str(), a.t_s);
      std::printf("\n");
    }
  };
  Course sound;
  sound.harder = d.between(0.93, 1.07);
  sound.stock_m = d.between(-0.2e-3, 0.2e-3);
  report("sound", sound);
  if (std::getenv("DBG")) {
    run("program predict part.ngc --machine machine.ini --quiet --out /tmp/hq/steps.csv " +
        passes::stock_of(p));
    return;
  }
  Course c = sound;
  c.pass = static_cast<std::size_t>(d.whole(0, 3));
  c.fault = Course::Fault::contact;
  c.stiffness = d.scale(1e6, 20e6);
  c.gives_way_N = d.scale(300, 2000);
  c.at_m = d.between(0.01, 0.05);
  report("contact", c);
  c.at_m = -p.radius_m - d.between(0.4, 0.8) * p.feed_m_s();
  report("in air", c);
  c.fault = Course::Fault::clamp;
  c.at_m = passes::kBlock_m + 1.5 * p.radius_m + d.between(0.4, 0.8) * p.feed_m_s();
  report("clamp", c);
  c.fault = Course::Fault::tooth;
  c.at_m = d.between(0.01, 0.05);
  report("tooth", c);
}

}  // namespace

int main(int argc, char** argv) {
  std::uint64_t from = 1, cases = 1;
  for (int i = 1; i < argc; ++i) {
    const std::string option = argv[i];
    if (option == "--cases" && i + 1 < argc) cases = std::strtoull(argv[++i], nullptr, 10);
    if (option == "--from" && i + 1 < argc) from = std::strtoull(argv[++i], nullptr, 10);
  }
  return in_own_folder("one_stack", [&] {
    for (std::uint64_t seed = from; seed < from + cases; ++seed) part(seed);
  });
}
