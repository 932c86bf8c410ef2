// One cause, one alarm: whether a broken tooth raises chatter, too, and whether chatter that begins
// after a tooth has broken is found as it is in the same cut with a whole tool and with a tool that
// lacked the tooth from the start; whether chatter of a whole tool raises a breakage, too, and a
// tooth that breaks while it chatters is found. On the cuts of random_cuts.hpp and on those of a
// second generator that shares nothing with them (second_cuts.hpp).
//
//   one_cause                  a small fixed set
//   one_cause --nightly        150 of each, 60 that chatter
//   one_cause --cases N [--twins M] [--late L] [--from SEED] [--first | --second]
//   one_cause --matrix [--cases N] [--from SEED]    every monitor against every event
//   one_cause --show SEED [--second] [--deeper]     one broken tooth, revolution by revolution
// Figures: docs/detection.md.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "check.hpp"
#include "detection/random_cuts.hpp"
#include "detection/scores.hpp"
#include "detection/second_cuts.hpp"
#include "servosense/monitors/event_text.hpp"

using namespace servosense;

namespace {

/// What is done to the tool of a cut that becomes unstable.
enum class Tool { whole, breaks, lacks, breaks_late };
constexpr std::array kTools = {Tool::whole, Tool::breaks, Tool::lacks};
constexpr const char* name_of(Tool tool) {
  constexpr const char* names[] = {"tool whole", "tooth broken before",
                                   "tooth missing from the start"};
  return names[static_cast<int>(tool)];
}

constexpr double kNever = detection::kNever;
constexpr double kPeriod_s = detection::kPeriod_s;
// A cut that vibrates by less than the first chatters not, by more than the second it does, in
// feeds per tooth (test_detection_study.cpp).
constexpr double kStill = 0.2, kChatters = 0.3;
// The displacement is held against that of three revolutions ago, so a break is out of it after
// four.
constexpr double kOver_turns = 6;

double wide(float x) { return static_cast<double>(x); }

/// A record of either generator, and the truth about it.
struct Record {
  std::string text;
  HostStackConfig config;
  std::vector<ServoSample<double>> samples;
  std::vector<float> vibration_m;
  double feed_m = 0, turn_s = 0;
  double in_s = 0;  ///< second generator: the tool is in the cut for good
  double event_s = kNever;

  [[nodiscard]] std::size_t at(double t_s) const {
    return std::min(samples.size(), static_cast<std::size_t>(std::max(0.0, t_s) / kPeriod_s));
  }
  [[nodiscard]] double most_feeds(double from_s, double to_s) const {
    float most = 0;
    for (std::size_t i = at(from_s); i < at(std::min(to_s, 1e6)); ++i)
      most = std::max(most, vibration_m[i]);
    return wide(most) / feed_m;
  }
  /// When vibration first reaches so many feeds per tooth.
  [[nodiscard]] double reaches_s(double feeds, double from_s) const {
    for (std::size_t i = at(from_s); i < samples.size(); ++i)
      if (wide(vibration_m[i]) >= feeds * feed_m) return static_cast<double>(i) * kPeriod_s;
    return kNever;
  }
};

struct Alarms {
  bool says_why = false;                    ///< a breakage's sentence tells why it is no chatter
  std::array<std::vector<double>, 8> at_s;  // by monitor
  [[nodiscard]] double first(MonitorId id, double from_s, double to_s = kNever) const {
    for (const double t : at_s[static_cast<std::size_t>(id)])
      if (t >= from_s && t <= to_s) return t;
    return kNever;
  }
  [[nodiscard]] bool any(MonitorId id, double from_s, double to_s = kNever) const {
    return first(id, from_s, to_s) < kNever;
  }
};

using Look = std::function<void(double t_s, const HostStack&)>;

Alarms watch(const Record& r, const Look& look = {}) {
  Alarms alarms;
  static auto stack = std::make_unique<HostStack>();
  CHECK_TEXT(HostStack::validate(r.config).reason(), "");
  stack->configure(r.config);
  for (std::size_t i = 0; i < r.samples.size(); ++i) {
    const double t = static_cast<double>(i) * kPeriod_s;
    for (const auto& change : stack->process(r.samples[i]))
      if (change.state == MonitorState::alarm && change.detail == 0) {
        alarms.at_s[static_cast<std::size_t>(change.monitor)].push_back(t);
        const std::string reason = event_from(change, 0).reason;
        alarms.says_why =
            alarms.says_why || reason.find("not judged as chatter") != std::string::npos;
      }
    if (look) look(t, *stack);
  }
  return alarms;
}

// ---- The cuts of the study.

Record study_record(const detection::Cut& c, bool good_part = false) {
  MachineFile machine = detection::learn(c, detection::idle_run(c));
  if (good_part) (void)detection::learn_good_cut(c, machine);
  const detection::Record cut = detection::simulate(c);
  Record r;
  r.text = c.text;
  r.config = detection::good(plan_stack(machine, detection::signals()), "plan").config;
  detection::Reporter<double> reporter(c, cut, c.seed + 1);
  for (std::size_t i = 0; i < cut.size(); ++i) r.samples.push_back(reporter.at(i));
  r.vibration_m = cut.vibration_m;
  r.feed_m = c.milling().cut.feed_per_tooth_m;
  r.turn_s = c.turn_s();
  r.event_s = std::min(cut.break_s, cut.touch_s);
  // Of what changes besides, until four turns later, nothing is said.
  double quiet_s = 0;
  for (std::size_t i = 0; i < cut.size(); ++i) {
    if (cut.changing[i] != 0) quiet_s = static_cast<double>(i) * kPeriod_s + 4 * r.turn_s;
    if (static_cast<double>(i) * kPeriod_s < quiet_s) r.vibration_m[i] = 0;
  }
  return r;
}

/// Torque is on where the tooth breaks, and two turns later.
bool loaded(const Record& r, const detection::Record& cut) {
  std::vector<double> sum(cut.size() + 1, 0);
  for (std::size_t i = 0; i < cut.size(); ++i) sum[i + 1] = sum[i] + wide(cut.torque_Nm[i]);
  const std::size_t turn = r.at(r.turn_s), at = r.at(cut.break_s);
  double most = 0;
  for (std::size_t i = turn; i <= cut.size(); i += turn / 4 + 1)
    most = std::max(most, sum[i] - sum[i - turn]);
  if (at < turn || at + 2 * turn > cut.size()) return false;
  return std::min(sum[at] - sum[at - turn], sum[at + 2 * turn] - sum[at + turn]) > 0.6 * most;
}

std::optional<Record> study_break(std::uint64_t seed) {
  const detection::Cut c = detection::draw(seed, detection::Event::tooth_break);
  Record r = study_record(c);
  if (!loaded(r, detection::simulate(c))) return std::nullopt;
  return r;
}

/// A wedge, from half of what the structure bears to twice that; the tooth breaks below the limit.
Record study_wedge(std::uint64_t seed, Tool tool) {
  detection::Cut c = detection::draw(seed, detection::Event::chatter, detection::Feature::none);
  detection::detail::Draw d(4 * seed + 8'000'000'000U);
  MillingSimulation& m = c.simulation.milling;
  const double limit_m = m.cut.axial_depth_m / c.depth_over_limit;
  const double feed = m.cut.feed_per_tooth_m * m.tool.teeth / c.turn_s();
  const double grows_s = std::max(d.between(0.8, 1.5), 80 * c.turn_s());
  m.workpiece.front_depth_m = 0.5 * limit_m;
  m.workpiece.far_depth_m = 2 * limit_m;
  m.workpiece.length_m = feed * (c.entry_s + grows_s);
  m.cut.axial_depth_m = m.workpiece.far_depth_m;
  c.simulation.program.cut_s = c.entry_s + 0.95 * grows_s;
  double break_s = c.entry_s + d.between(0.1, 0.25) * grows_s;
  const int tooth = d.whole(1, m.tool.teeth);
  const double fraction = d.chance(0.5) ? 1 : d.between(0.3, 0.9);
  if (tool == Tool::breaks_late) break_s = c.entry_s + d.between(0.7, 0.85) * grows_s;
  if (tool != Tool::whole) m.breaks = {{tool == Tool::lacks ? 0.0 : break_s, tooth, fraction}};
  Record r = study_record(c);
  // The twin counts from the same instant.
  r.event_s =
      detection::good(MachineSimulator::create(c.simulation), "wedge").schedule().contact_s +
      break_s;
  return r;
}

// ---- The cuts of the second generator.

Record second_record(const detection::second::Case& c, const detection::second::Course& course) {
  const auto trace = detection::second::simulate(c, course);
  Record r;
  char text[160];
  std::snprintf(text, sizeof text, "seed %llu: z%zu, %.0f rpm, feed %.0f um, limit %.2f mm, %d bit",
                static_cast<unsigned long long>(c.seed), c.teeth(), rpm_from_rad_s(c.speed_rad_s),
                1e6 * c.feed_m, 1e3 * c.limit_m, c.machine.drive[0].bits);
  r.text = text;
  r.config = detection::second::plan_for(
                 detection::second::learned(c.machine, detection::second::idle_run(c),
                                            static_cast<unsigned>(c.teeth())))
                 .config;
  r.samples = trace.samples;
  r.vibration_m = trace.vibration_m;
  r.feed_m = c.feed_m;
  r.turn_s = c.turn_s();
  r.in_s = trace.in_s;
  r.event_s = r.in_s + course.break_s;
  return r;
}

std::optional<Record> second_break(std::uint64_t seed) {
  const auto c = detection::second::draw(seed);
  detection::second::Draw d(seed * 0x2545f4914f6cdd1dU + 6'000'000);
  detection::second::Course course;
  course.break_s = d.between(12, 20) * c.turn_s() + d.between(0, 0.3);
  course.fraction = d.chance(0.5) ? 1 : d.between(0.3, 0.9);
  course.cut_s = course.break_s + 40 * c.turn_s();
  return second_record(c, course);
}

/// Steady, then deeper until it chatters; the tooth breaks while it is steady, or at its end.
Record second_deeper(std::uint64_t seed, Tool tool) {
  const auto c = detection::second::draw(seed);
  detection::second::Draw d(seed * 0x2545f4914f6cdd1dU + 5'000'000);
  detection::second::Course course;
  course.break_s = d.between(12, 20) * c.turn_s();
  course.fraction = d.chance(0.5) ? 1 : d.between(0.3, 0.9);
  course.grows_from_s = course.break_s + d.between(0, 40) * c.turn_s();
  course.grows_until_s = course.grows_from_s + std::max(d.between(0.2, 0.6), 30 * c.turn_s());
  course.grown = d.between(1.5, 2.2);
  course.cut_s = course.grows_until_s + std::max(0.3, 25 * c.turn_s());
  if (tool == Tool::breaks_late)
    course.break_s =
        course.grows_until_s + d.between(-0.1, 0.1) * (course.cut_s - course.grows_until_s);
  const double event_s = course.break_s;
  if (tool == Tool::whole) course.break_s = kNever;
  if (tool == Tool::lacks) course.break_s = -kNever;
  Record r = second_record(c, course);
  r.event_s = r.in_s + (tool == Tool::breaks_late ? course.break_s : event_s);
  return r;
}

// ---- What is counted.

// An alarm later than three windows of the monitor has a cause of its own.
constexpr double kSoon_turns = 24;

struct Count {
  std::size_t all = 0, chatter = 0, later = 0, tooth = 0, ar = 0, either = 0, says_why = 0;
};

struct Twins {
  std::size_t cuts = 0, found = 0;
  std::vector<double> late_turns;  // alarm after the vibration has reached kChatters
};

/// Cuts that chatter.
struct Vibrating {
  std::size_t cuts = 0, tooth = 0, ar = 0;  // with a whole tool, and who speaks of a broken one
  std::size_t broken = 0, found = 0;        // in which a tooth breaks
};

struct Study {
  Count broken;
  std::size_t passed_over = 0;
  std::array<Twins, kTools.size()> twins;
  Vibrating vibrating;
  std::size_t not_unstable = 0;
  bool talks = false;
};

void study_broken(Study& s, const std::optional<Record>& r) {
  if (!r || r->most_feeds(r->event_s + kOver_turns * r->turn_s, kNever) > kStill) {
    ++s.passed_over;
    return;
  }
  const Alarms alarms = watch(*r);
  if (alarms.any(MonitorId::chatter, 0, r->event_s)) {  // false before it already
    ++s.passed_over;
    return;
  }
  ++s.broken.all;
  const double soon_s = r->event_s + kSoon_turns * r->turn_s;
  const bool chatter = alarms.any(MonitorId::chatter, r->event_s, soon_s);
  const bool tooth = alarms.any(MonitorId::tooth_breakage, r->event_s, soon_s);
  const bool ar = alarms.any(MonitorId::ar_breakage, r->event_s, soon_s);
  s.broken.chatter += chatter;
  s.broken.later += alarms.any(MonitorId::chatter, soon_s);
  s.broken.tooth += tooth;
  s.broken.ar += ar;
  s.broken.either += tooth || ar;
  s.broken.says_why += alarms.says_why;
  const auto turns = [&](MonitorId id) {
    return (alarms.first(id, r->event_s) - r->event_s) / r->turn_s;
  };
  if (chatter && s.talks)
    std::printf("  chatter %.1f turns after the break, tooth-breakage %.1f, ar-breakage %.1f: %s\n",
                turns(MonitorId::chatter), turns(MonitorId::tooth_breakage),
                turns(MonitorId::ar_breakage), r->text.c_str());
}

/// A whole tool that chatters.
void study_vibrating(Study& s, const Record& r, const Alarms& alarms) {
  ++s.vibrating.cuts;
  const double tooth_s = alarms.first(MonitorId::tooth_breakage, 0);
  const double ar_s = alarms.first(MonitorId::ar_breakage, 0);
  s.vibrating.tooth += tooth_s < kNever;
  s.vibrating.ar += ar_s < kNever;
  if (s.talks && std::min(tooth_s, ar_s) < kNever) {
    const double chatter_s = alarms.first(MonitorId::chatter, 0);
    std::printf(
        "  of a whole tool, after the chatter alarm tooth-breakage %.1f, ar-breakage %.1f, after "
        "0.1 %.1f: %s\n",
        (tooth_s - chatter_s) / r.turn_s, (ar_s - chatter_s) / r.turn_s,
        (std::min(tooth_s, ar_s) - r.reaches_s(0.1, 0)) / r.turn_s, r.text.c_str());
  }
}

/// A tooth that breaks while it chatters.
void study_late(Study& s, const Record& r) {
  if (r.most_feeds(r.event_s - 2 * r.turn_s, r.event_s) < kChatters) return;
  const Alarms alarms = watch(r);
  ++s.vibrating.broken;
  const double until_s = r.event_s + kSoon_turns * r.turn_s;
  s.vibrating.found += alarms.any(MonitorId::tooth_breakage, r.event_s, until_s) ||
                       alarms.any(MonitorId::ar_breakage, r.event_s, until_s);
}

void study_twin(Study& s, Tool tool, const Record& r) {
  Twins& to = s.twins[static_cast<std::size_t>(tool)];
  const double over_s = r.event_s + kOver_turns * r.turn_s;
  if (r.most_feeds(over_s, kNever) < kChatters || r.reaches_s(kStill, over_s) < over_s + r.turn_s) {
    ++s.not_unstable;
    return;
  }
  ++to.cuts;
  const Alarms alarms = watch(r);
  if (tool == Tool::whole) study_vibrating(s, r, alarms);
  const double t = alarms.first(MonitorId::chatter, over_s);
  if (t == kNever) {
    if (s.talks) std::printf("  chatter missed, %s: %s\n", name_of(tool), r.text.c_str());
    return;
  }
  ++to.found;
  to.late_turns.push_back((t - r.reaches_s(kChatters, over_s)) / r.turn_s);
}

/// Which monitors speak of what, first after the event or, without one, at all.
void matrix(std::uint64_t from, std::size_t cases) {
  using detection::Event;
  for (const Event event : {Event::none, Event::chatter, Event::tooth_break, Event::collision}) {
    std::array<std::size_t, 8> heard{};
    std::size_t cuts = 0;
    for (std::uint64_t seed = from; seed < from + cases; ++seed) {
      const detection::Cut c = detection::draw(seed, event);
      const Record r = study_record(c, event == Event::none || event == Event::collision);
      if (event == Event::chatter
              ? r.most_feeds(0, kNever) < kChatters
              : r.most_feeds(event == Event::none ? 0 : r.event_s + kOver_turns * r.turn_s,
                             kNever) > kStill)
        continue;
      if ((event == Event::tooth_break || event == Event::collision) && r.event_s == kNever)
        continue;
      ++cuts;
      const Alarms alarms = watch(r);
      const double from_s =
          event == Event::tooth_break || event == Event::collision ? r.event_s : 0;
      for (std::size_t m = 0; m < heard.size(); ++m) {
        const bool any = alarms.any(static_cast<MonitorId>(m), from_s);
        heard[m] += any;
        if (any && event == Event::chatter && (m == 3 || m == 4))
          std::printf(
              "   %s at %.1f turns after chatter alarm, vibration %.2f feeds\n",
              name_of(static_cast<MonitorId>(m)),
              (alarms.first(static_cast<MonitorId>(m), 0) - alarms.first(MonitorId::chatter, 0)) /
                  r.turn_s,
              wide(r.vibration_m[r.at(alarms.first(static_cast<MonitorId>(m), 0))]) / r.feed_m);
      }
    }
    std::printf("  %s, %zu cuts:", detection::name_of(event), cuts);
    for (std::size_t m = 0; m < heard.size(); ++m)
      if (heard[m] > 0) std::printf(" %s %zu", name_of(static_cast<MonitorId>(m)), heard[m]);
    std::printf("\n");
  }
}

void print(const char* name, const Study& s) {
  const auto share = [](std::size_t k, std::size_t n) {
    const auto i = detection::wilson(static_cast<double>(k), static_cast<double>(n));
    char text[80];
    std::snprintf(text, sizeof text, "%zu of %zu (%.1f..%.1f %%)", k, n, 100 * i.low, 100 * i.high);
    return std::string(text);
  };
  std::printf(
      "  %s: broken teeth that raise chatter, too, %s, later %zu; tooth-breakage %zu, ar-breakage "
      "%zu, either %zu, with the reason %zu; %zu passed over\n",
      name, share(s.broken.chatter, s.broken.all).c_str(), s.broken.later, s.broken.tooth,
      s.broken.ar, s.broken.either, s.broken.says_why, s.passed_over);
  for (const Tool tool : kTools) {
    const Twins& t = s.twins[static_cast<std::size_t>(tool)];
    std::printf(
        "    chatter that begins, %s: found %s, %.1f turns after 0.3 feeds per tooth "
        "(median), %.1f (90 %%)\n",
        name_of(tool), share(t.found, t.cuts).c_str(), detection::quantile(t.late_turns, 0.5),
        detection::quantile(t.late_turns, 0.9));
  }
  const Vibrating& v = s.vibrating;
  std::printf(
      "    that chatter, tool whole: tooth-breakage %s, ar-breakage %s; a tooth that breaks then: "
      "found %s\n",
      share(v.tooth, v.cuts).c_str(), share(v.ar, v.cuts).c_str(),
      share(v.found, v.broken).c_str());
  std::printf("    %zu passed over that vibrated at the event or not at the end\n", s.not_unstable);
}

/// A monitor's values revolution by revolution, about the event.
void show(const Record& r) {
  std::printf("%s\n  event at %.4f s\n", r.text.c_str(), r.event_s);
  std::uint64_t verdicts = 0;
  const Alarms alarms = watch(r, [&](double t, const HostStack& stack) {
    const auto& c = stack.chatter();
    if (c.state().verdicts == verdicts) return;
    verdicts = c.state().verdicts;
    const double turns = (t - r.event_s) / r.turn_s;
    if (turns < -4 || turns > 90) return;
    const auto& comb = c.comb().state();
    std::printf(
        "  turn %5.1f: %s change %.3g tooth %.3g turn %.3g; held %.2f; load %.3g; beyond %.3g "
        "judged "
        "%.3g of %.3g, vibration %.2f feeds\n",
        turns, comb.steps ? "STEP" : "", comb.change_Nm2, comb.tooth_Nm2, comb.turn_Nm2,
        comb.held_Nm2 / comb.change_before_Nm2, c.state().load_Nm2, c.state().beyond_Nm2,
        c.state().chatter_Nm2, c.alarm(ChatterSign::power).threshold(),
        wide(r.vibration_m[r.at(t)]) / r.feed_m);
  });
  for (std::size_t m = 0; m < alarms.at_s.size(); ++m)
    for (const double t : alarms.at_s[m])
      std::printf("  %s %.1f turns after it\n", name_of(static_cast<MonitorId>(m)),
                  (t - r.event_s) / r.turn_s);
}

}  // namespace

int main(int argc, char** argv) {
  std::size_t cases = 8, twins = 2, late = 2;
  std::uint64_t from = 810000;
  bool first = true, second = true, talks = false, shows = false, deeper = false, all = false;
  for (int i = 1; i < argc; ++i) {
    const std::string option = argv[i];
    const auto next = [&] { return i + 1 < argc ? argv[++i] : "0"; };
    if (option == "--nightly") cases = twins = 150, late = 60;
    if (option == "--cases") cases = twins = std::strtoul(next(), nullptr, 10), talks = true;
    if (option == "--twins") twins = std::strtoul(next(), nullptr, 10);
    if (option == "--from") from = std::strtoul(next(), nullptr, 10);
    if (option == "--late") late = std::strtoul(next(), nullptr, 10);
    if (option == "--second") first = false;
    if (option == "--first") second = false;
    if (option == "--deeper") deeper = true;
    if (option == "--matrix") all = true;
    if (option == "--show") from = std::strtoul(next(), nullptr, 10), shows = true;
  }
  if (all) {
    matrix(from, cases);
    return 0;
  }
  if (shows) {
    if (deeper)
      show(first ? study_wedge(from, Tool::breaks) : second_deeper(from, Tool::breaks));
    else if (const auto r = first ? study_break(from) : second_break(from))
      show(*r);
    return 0;
  }
  Count broken;
  std::array<Twins, kTools.size()> sum;
  Vibrating vibrating;
  for (const bool other : {false, true}) {
    if (other ? !second : !first) continue;
    Study s;
    s.talks = talks;
    for (std::uint64_t seed = from; seed < from + cases; ++seed)
      study_broken(s, other ? second_break(seed) : study_break(seed));
    for (std::uint64_t seed = from; seed < from + twins; ++seed)
      for (const Tool tool : kTools)
        study_twin(s, tool, other ? second_deeper(seed, tool) : study_wedge(seed, tool));
    for (std::uint64_t seed = from; seed < from + late; ++seed)
      study_late(
          s, other ? second_deeper(seed, Tool::breaks_late) : study_wedge(seed, Tool::breaks_late));
    if (!other)
      for (std::uint64_t seed = from; seed < from + late; ++seed) {
        const Record r = study_record(detection::draw(seed, detection::Event::chatter));
        if (r.most_feeds(0, kNever) >= kChatters) study_vibrating(s, r, watch(r));
      }
    print(other ? "second generator" : "study", s);
    broken.all += s.broken.all;
    broken.chatter += s.broken.chatter;
    broken.either += s.broken.either;
    broken.says_why += s.broken.says_why;
    vibrating.cuts += s.vibrating.cuts;
    vibrating.tooth += s.vibrating.tooth;
    vibrating.broken += s.vibrating.broken;
    vibrating.found += s.vibrating.found;
    for (std::size_t k = 0; k < sum.size(); ++k) {
      sum[k].cuts += s.twins[k].cuts;
      sum[k].found += s.twins[k].found;
    }
  }
  // One in twenty-five: 8 of 226 on seeds 810000 to 810149, 0 of 217 on 830000 to 830149 (13 before
  // tooth breakage told of the step), together one in fifty-five.
  CHECK(25 * broken.chatter <= broken.all);
  // One in ten: 2 of 59 on seeds 830000 to 830059; 20 while any news counted as a break.
  CHECK(10 * vibrating.tooth <= vibrating.cuts);
  // 72 of 99 there; less than half would say that chatter hides a break.
  CHECK(2 * vibrating.found >= vibrating.broken);
  // Where AR breakage alone speaks, the chatter monitor may have heard no step.
  CHECK(2 * broken.says_why >= broken.either);
  // Found as where the tooth was missing from the start, to five in a hundred and one.
  const Twins& breaks = sum[static_cast<std::size_t>(Tool::breaks)];
  const Twins& lacks = sum[static_cast<std::size_t>(Tool::lacks)];
  const auto share = [](const Twins& t) {
    return t.cuts > 0 ? static_cast<double>(t.found) / static_cast<double>(t.cuts) : 1.0;
  };
  CHECK(share(breaks) >= share(lacks) - 0.05 - 1 / std::max(1.0, static_cast<double>(breaks.cuts)));
  return check::done();
}
