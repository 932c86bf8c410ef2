// One simulated current through both subsystems of Bertok 1984 (ch. 5), end to end: the program is
// predicted, run with a fault, recorded at 8 kHz and as the study's two computers heard it, a value
// every 20 and every 48 ms, and replayed by the program. Which monitor tells the fault, at which
// sample and time, and which of them say that such a record is too slow for them. Figures:
// docs/slow-records.md.
//
//   study_rates [--cases N] [--from SEED]    --nightly: 12 parts
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "check.hpp"
#include "detection/milled_passes.hpp"
#include "predicted_part.hpp"
#include "program.hpp"
#include "seed_range.hpp"

namespace {

using namespace servosense;
using namespace program_test;
namespace passes = detection::passes;
using passes::Course;
using passes::Part;
using passes::Trace;

constexpr std::array<int, 3> kEach = {1, 160, 384};  // servo periods of a value
constexpr std::array<const char*, 3> kRate = {"8 kHz", "20 ms", "48 ms"};

/// A cutter of 28 to 70 mm: slow enough for a value a revolution every 48 ms, fast enough for all.
constexpr double kLarger = 3.5;

constexpr std::array<const char*, 3> kByRevolution = {"monitor.chatter", "monitor.ar-breakage",
                                                      "monitor.tooth-breakage"};

/// Currents are means over the interval, as of a filter before the converter; angles its last.
std::string recorded(const Trace& trace, int each) {
  std::string csv =
      "t_s,spindle.angle_counts,spindle.current_A,x.angle_counts,x.current_A,y.angle_counts,"
      "y.current_A,machine.nc_block,machine.feed_override\n";
  std::array<double, 3> sum{};
  char row[200];
  const auto n = static_cast<std::size_t>(each);
  for (std::size_t i = 0; i < trace.samples.size(); ++i) {
    const auto& s = trace.samples[i];
    sum[0] += s.spindle.effort;
    sum[1] += s.axis[0].effort;
    sum[2] += s.axis[1].effort;
    if ((i + 1) % n != 0) continue;
    std::snprintf(row, sizeof row, "%.6f,%lld,%.6g,%lld,%.6g,%lld,%.6g,%d,%.3g\n",
                  1e-9 * static_cast<double>(s.t_ns), static_cast<long long>(s.spindle.counts),
                  sum[0] / each, static_cast<long long>(s.axis[0].counts), sum[1] / each,
                  static_cast<long long>(s.axis[1].counts), sum[2] / each, s.nc_block,
                  s.feed_override);
    csv += row;
    sum = {};
  }
  return csv;
}

enum Told { kTooth, kCollision, kBand, kTolds };
constexpr std::array<const char*, kTolds> kMonitors = {"tooth-breakage", "collision",
                                                       "torque-band"};

/// Both monitors of breakage tell a tooth.
bool tells(Told by, const std::string& monitor) {
  return monitor == kMonitors[by] || (by == kTooth && monitor == "ar-breakage");
}

struct Row {
  int runs = 0;   // in how many of them the monitor of the fault runs at this rate
  int found = 0;  // alarm of that monitor after the fault
  int early = 0;  // any alarm before it, or in a sound run
  std::vector<double> delay_s;
};
struct Kind {
  const char* what;
  Told by;
  int cuts = 0;
  std::array<Row, kEach.size()> at{};
};

Row hear(const Kind& kind, const Trace& trace, double event_s, std::size_t rate) {
  Row row;
  put("run.csv", recorded(trace, kEach[rate]));
  const Outcome o = run("monitor --machine " + std::string(rate == 0 ? "machine.ini" : "slow.ini") +
                        " --trace run.csv --json --events e.jsonl");
  that(o.status == 0, o, "is heard", __LINE__);
  const Json said(o.out);
  for (std::size_t m = 0; said.scalars.contains("monitors." + std::to_string(m) + ".name"); ++m) {
    const std::string at = "monitors." + std::to_string(m) + ".";
    if (said.text(at + "name") != kMonitors[kind.by]) continue;
    if (said.text(at + "runs") == "true") row.runs = 1;
    // What does not run says why.
    that(row.runs == 1 || said.text(at + "reason").size() > 20, o, "says why not", __LINE__);
  }
  double first = passes::kNever;
  for (const std::string& line : lines(content(folder / "e.jsonl"))) {
    const Json event(line);
    if (event.text("state") != "alarm") continue;
    const double t = event.number("t_s");
    std::printf("    %-24s %s  %-15s sample %6.0f, %8.4f s%s\n", kind.what, kRate[rate],
                event.text("monitor").c_str(), t / (125e-6 * kEach[rate]), t,
                t < event_s ? "  (before)" : "");
    if (t < event_s)
      row.early = 1;
    else if (tells(kind.by, event.text("monitor")))
      first = std::min(first, t);
  }
  if (first < passes::kNever) {
    row.found = 1;
    row.delay_s.push_back(first - event_s);
  }
  return row;
}

/// The same machine and tool for another rate: what was learned sample by sample stays behind.
MachineFile at_slow_rate(MachineFile machine) {
  for (const char* section : kByRevolution) machine.remove_section(section);
  machine.remove_section("monitor.collision");
  return machine;
}

void part(std::uint64_t seed, std::array<Kind, 4>& kinds) {
  const Part p = passes::draw(seed, kLarger);
  MachineFile machine = passes::learned(p);
  // What an idling run at so slow a spindle does not teach is not watched.
  for (const char* section : kByRevolution)
    for (const char* key : {"chatter_threshold_Nm2", "noise_Nm", "sample_noise_Nm"})
      if (machine.number(section, key) == 0.0) machine.remove_section(section);
  machine = predict(p, std::move(machine));
  put("slow.ini", at_slow_rate(machine).text());
  detection::second::Draw d(seed * 29 + 3);
  std::printf("  seed %llu: %zu teeth, %.0f rpm\n", static_cast<unsigned long long>(seed),
              p.teeth(), p.speed_rad_s * 60 / kTwoPi);
  for (std::size_t k = 0; k < kinds.size(); ++k) {
    Course c;
    c.harder = d.between(0.95, 1.05);
    c.stock_m = d.between(-0.15e-3, 0.15e-3);
    c.pass = static_cast<std::size_t>(d.whole(0, 3));
    c.goes_on_s = 2;
    if (k == 1) c.fault = Course::Fault::tooth, c.at_m = d.between(0.01, 0.04);
    if (k == 2) {
      c.fault = Course::Fault::contact;
      c.at_m = -p.radius_m - d.between(0.4, 0.8) * p.feed_m_s();
      c.stiffness = d.scale(1e6, 20e6);
      c.gives_way_N = d.scale(300, 2000);
    }
    if (k == 3) c.stock_m = d.between(0.5, 1) * p.passes[0].depth_m;
    const Trace trace = passes::simulate(p, c);
    // Stock that stands too high is met with the first pass.
    const double event_s = k == 3 ? 0 : trace.event_s;
    if (k > 0 && event_s == passes::kNever) continue;
    ++kinds[k].cuts;
    for (std::size_t r = 0; r < kEach.size(); ++r) {
      const Row row = hear(kinds[k], trace, event_s, r);
      Row& sum = kinds[k].at[r];
      sum.runs += row.runs;
      sum.found += row.found;
      sum.early += row.early;
      sum.delay_s.insert(sum.delay_s.end(), row.delay_s.begin(), row.delay_s.end());
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  const check::SeedRange seeds = check::seed_range(
      argc, argv, nightly ? check::SeedRange{973001, 12} : check::SeedRange{1, 1});
  return in_own_folder("study_rates", [&] {
    std::array<Kind, 4> kinds = {{{"sound", kBand},
                                  {"a tooth breaks", kTooth},
                                  {"a contact in the air", kCollision},
                                  {"stock stands too high", kBand}}};
    for (std::uint64_t seed = seeds.from; seed < seeds.from + seeds.cases; ++seed)
      part(seed, kinds);
    for (Kind& k : kinds)
      for (std::size_t r = 0; r < kEach.size(); ++r) {
        Row& row = k.at[r];
        std::sort(row.delay_s.begin(), row.delay_s.end());
        std::printf("  %-24s %s  %s runs in %d, found in %d of %d, after %.3f s; early %d\n",
                    k.what, kRate[r], kMonitors[k.by], row.runs, row.found, k.cuts,
                    row.delay_s.empty() ? 0 : row.delay_s[row.delay_s.size() / 2], row.early);
      }
    for (std::size_t r = 0; r < kEach.size(); ++r) {
      // The band hears levels: where it runs, the rate costs time alone.
      CHECK(kinds[3].at[r].found >= kinds[3].at[r].runs - kinds[3].cuts / 10);
      CHECK(2 * kinds[0].at[r].early <= kinds[0].cuts);  // what is reached, no goal
    }
    CHECK(10 * kinds[1].at[0].found >= 8 * kinds[1].cuts && kinds[1].at[1].runs == 0);
    CHECK(10 * kinds[2].at[0].found >= 8 * kinds[2].cuts && kinds[2].at[1].runs == 0);
  });
}
