// A shift with faults in it: one program after another, rapids, cuts and rest, with one kind of
// fault in each on at least 0.1 % of its rows, in fresh places every time. No alarm comes from any
// but those that docs/faults.md names.
// The usual run takes ten minutes of machine time, --nightly eight hours.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <random>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "check.hpp"
#include "faults/bench.hpp"
#include "faults/fault_kinds.hpp"

using namespace faults;

namespace {

constexpr double kProgram_s = 10;

/// Rapids to and fro, a cut, rest, rapids, a long cut, a rapid back.
Course program() {
  Course c;
  c.x = SpeedCourse({{0.3, ramp_s(0.45), 0.45},
                     {0.8, ramp_s(0.45), -0.45},
                     {1.3, ramp_s(0.45), 0.02},
                     {3.0, ramp_s(0.3), -0.3},
                     {3.3, ramp_s(0.3), 0},
                     {4.2, ramp_s(0.83), 0.83},
                     {4.7, ramp_s(0.83), -0.3},
                     {5.2, ramp_s(0.3), 0.02},
                     {9.0, ramp_s(0.45), -0.45},
                     {9.4, ramp_s(0.45), 0}});
  c.spindle = SpeedCourse({{0.1, 0.3, kSpeed_rad_s}, {3.1, 0.3, 0}, {4.0, 0.3, kSpeed_rad_s}});
  c.entry_s = 1.8, c.exit_s = 2.8;
  c.entry2_s = 5.6, c.exit2_s = 8.8;
  c.chatter_s = c.contact_s = 1e9;
  c.chatter_ends_s = 0;
  c.end_s = kProgram_s;
  return c;
}

}  // namespace

int main(int argc, char** argv) {
  double hours = 1.0 / 6;
  unsigned seed = 13;  // 1 to 12 served development
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--nightly") == 0) hours = 8;
    if (std::strcmp(argv[i], "--seed") == 0) seed = static_cast<unsigned>(std::atoi(argv[++i]));
  }
  const Machines machines(seed);
  std::vector<std::vector<Rows>> programs;
  for (unsigned i = 0; i < 4; ++i) {
    const Plant plant(program(), 100 * seed + 80 + i);
    auto& rates = programs.emplace_back();
    for (const Reporting& r : kReporting) rates.push_back(rows_of(plant, r));
  }
  Random random(seed);
  std::size_t injected = 0, told = 0, alarms = 0, accused = 0;
  std::map<std::tuple<Part, std::string, Channel>, std::size_t> alarmed;  // programs
  const auto section = [&](const Fault& fault, Channel channel) {
    const std::size_t r = random() % kReporting.size();
    const Reporting& reporting = kReporting[r];
    Rows rows = programs[random() % programs.size()][r];
    const bool clean = fault.part == Part::nothing;
    if (!clean) {
      Place p{State::moving, reporting, 0, channel, 0};
      const double length = static_cast<double>(p.rows(fault.spoil.lasts_s));
      const double expected = 0.001 * static_cast<double>(rows.size()) / length;
      const unsigned here = std::max(1U, std::poisson_distribution<unsigned>(expected)(random));
      for (unsigned k = 0; k < here; ++k) {
        // Not before the monitors are armed.
        const std::size_t first = p.rows(1.0);
        p.from = first + random() % (rows.size() - first - 16);
        fault.spoil.apply(rows, p, random);
      }
      injected += here;
    }
    auto stack = std::make_unique<HostStack>();
    prepare(*stack, detection::good(plan_stack(machines[r], signals_of(reporting)), "plan"));
    bool sick = false;
    std::size_t here = 0;
    std::string first;
    const std::string ended =
        listen(rows, 0, machines[r], *stack,
               [&](std::int64_t row, const ServoSample<double>&, std::span<const Change> changes) {
                 for (const Change& c : changes) {
                   sick = sick || (c.monitor == MonitorId::signal && is_sick(c.state));
                   if (!is_alarm(c)) continue;
                   if (here++ == 0)
                     first = text_of(c, static_cast<double>(row) * reporting.period_s());
                 }
               });
    told += sick;
    alarms += here;
    CHECK(ended.empty());
    if (clean) accused += sick;
    if (here > 0) ++alarmed[{fault.part, fault.kind, channel}];
    if (here > 0 || !ended.empty())
      std::printf("  %s %s %s of %s, %s: %zu alarms, %s %s\n", fault.kind.c_str(),
                  fault.size.c_str(), name_of(fault.part), name(channel).c_str(),
                  reporting.text().c_str(), here, first.c_str(), ended.c_str());
  };
  std::vector<std::pair<const Fault*, Channel>> all;
  const std::vector<Fault> faults = all_faults();
  for (const Fault& fault : faults)
    if (!fault.to_the_end())
      for (const Channel channel : channels_of(fault.part)) all.emplace_back(&fault, channel);
  const auto sections = static_cast<std::size_t>(std::ceil(3600 * hours / kProgram_s));
  for (std::size_t i = 0; i < sections; ++i) {
    if (i % all.size() == 0) std::shuffle(all.begin(), all.end(), random);
    section(*all[i % all.size()].first, all[i % all.size()].second);
  }
  check::figure("simulated", static_cast<double>(sections) * kProgram_s / 3600, "h");
  check::figure("programs", static_cast<double>(sections));
  check::figure("faults put in", static_cast<double>(injected));
  check::figure("programs in which one was told", static_cast<double>(told));
  check::figure("alarms", static_cast<double>(alarms));
  check::figure("sound programs called faulty", static_cast<double>(accused));
  std::size_t programs_with_alarms = 0;
  for (const auto& [line, count] : alarmed) {
    const auto& [part, kind, channel] = line;
    std::printf("  %zu of %s, %s of %s\n", count, kind.c_str(), name_of(part),
                name(channel).c_str());
    CHECK(count <= open_of(part, kind, channel).shift);
    programs_with_alarms += count;
  }
  check::figure("programs with alarms", static_cast<double>(programs_with_alarms));
  CHECK(accused <= open_of(Part::nothing, "nothing", Channel::machine).shift);
  return check::done();
}
