// servosense program optimise: the same program with feeds, and speeds, as cut and machine allow.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iostream>
#include <iterator>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "program_cut.hpp"
#include "program_loads.hpp"
#include "program_moves.hpp"
#include "program_options.hpp"
#include "program_speeds.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/write_file.hpp"
#include "servosense/process/engagement/program_engagement.hpp"
#include "servosense/process/engagement/turning_tools.hpp"
#include "servosense/process/optimise/feed_plan.hpp"
#include "servosense/process/optimise/word_text.hpp"
#include "servosense/process/verification/program_check.hpp"

namespace servosense::cli {
namespace {

using process::CanonicalMove;
using process::Engagement;
using process::FeedBound;
using process::FeedPlan;
using process::SpeedBound;
using process::SpeedPlan;

/// Steps half as long as those of a prediction: the feed of a block is that of its worst step.
constexpr double kFinerStep = process::kStepShare / 2;

/// The program, cut once, with what bounds its speeds.
struct CutPlan {
  process::ProgramEngagement engagement;
  SpeedPlan* plan;  ///< null: speeds stay
  const ProgramLoads& loads;
  int tool = 0;

  Expected<Done> put(const CanonicalMove& move) {
    if (move.kind == CanonicalMove::Kind::tool) tool = move.tool;
    if (plan != nullptr) plan->put(move, loads.knows(tool) ? &loads.law(tool) : nullptr);
    return engagement.put(move);
  }
  void finish() { engagement.finish(); }
  [[nodiscard]] std::size_t moves() const { return engagement.moves(); }
};

/// A program that runs over others cannot be rewritten in one file.
Expected<Done> in_one_file(const process::ProgramText& program, const FeedPlan& plan) {
  for (const auto& [number, line] : plan.lines()) {
    std::string_view text = number <= program.lines().size()
                                ? std::string_view(program.lines()[number - 1])
                                : std::string_view();
    text = trim(text);
    if (text.starts_with('o') || text.starts_with('O'))
      return data_error(program.name() + ":" + std::to_string(number) +
                        ": a subroutine in a file of its own moves the tool; put it into the "
                        "program, then its feeds can be written");
  }
  return Done{};
}

/// What a new text asks for is what the plan says; `words` that were changed.
Expected<Done> same_moves(const std::string& name, const std::vector<CanonicalMove>& moves,
                          const std::vector<CanonicalMove>& expected, char words) {
  const auto same = [](const CanonicalMove& a, const CanonicalMove& b) {
    return a.kind == b.kind && a.machine == b.machine &&
           std::abs(a.feed_m_s - b.feed_m_s) <= 2e-4 * b.feed_m_s &&
           std::abs(a.spindle_rpm - b.spindle_rpm) <= 1e-9 * std::abs(b.spindle_rpm);
  };
  const auto [other, missed] = std::ranges::mismatch(
      moves, expected, [&](const auto& m, const auto& e) { return same(m, e); });
  if (other == moves.end() && missed == expected.end()) return Done{};
  const std::size_t wrong = other == moves.end() ? 0 : other->line;
  const bool feeds = words == 'F';
  return data_error(name + ":" + std::to_string(wrong) + ": with other " + words +
                    " words the program would make another move here; it may compute with its " +
                    (feeds ? "feed: write the feed as a number" : "speed: write it as a number"));
}

/// The program with other words, and what it then does.
struct Rewritten {
  std::string text;
  FeedPlan plan;
  ProgramMoves moves;
};

/// All that a rewritten program is made of; it was cut once, and is cut alike at any feed and
/// speed.
struct Rewriter {
  const std::string& text;
  const process::ProgramText& program;
  const process::ProgramOptions& options;
  const process::CutLimits& limits;
  const process::MachineMotion& motion;
  process::MachineTools& tools;
  const ProgramLoads& loads;
  const ProgramMoves& before;
  const std::vector<Engagement>& steps;  ///< that cut

  /// With the speeds of `speeds`, and the feeds that follow.
  Expected<Rewritten> with(const SpeedPlan& speeds) const {
    const auto digits = speeds.digits();
    const std::string turned = process::with_words(text, 'S', digits);
    const auto read = process::ProgramText::from(turned, program.name());
    std::vector<CanonicalMove> asked = before.asked;
    if (!digits.empty()) {
      auto moves = read_moves(read, options);
      if (!moves) return moves.error();
      const std::vector<CanonicalMove> expected = speeds.moves();
      if (const auto same = same_moves(program.name(), *moves, expected, 'S'); !same)
        return same.error();
      asked = std::move(*moves);
    }
    Rewritten r{
        {},
        FeedPlan(read.lines(), limits, motion.limits, before.accelerated, loads.compliance()),
        {}};
    int tool = 0;
    for (const CanonicalMove& move : asked) {
      if (move.kind == CanonicalMove::Kind::tool) tool = move.tool;
      r.plan.put(move, loads.knows(tool) ? &loads.law(tool) : nullptr);
    }
    for (const Engagement& e : steps) r.plan.add(e);
    if (const auto one = in_one_file(program, r.plan); !one) return one.error();
    r.plan.solve();
    r.text = process::with_words(turned, 'F', r.plan.words());
    auto after =
        moves_of(process::ProgramText::from(r.text, program.name()), options, motion, tools);
    if (!after) return after.error();
    if (const auto same = same_moves(program.name(), after->asked, r.plan.moves(), 'F'); !same)
      return same.error();
    r.moves = std::move(*after);
    return r;
  }
};

/// The speeds by which the program becomes faster, one word after the other: each has to gain in
/// the time of the whole, with acceleration, unless what the program says is unstable or outside
/// its limits.
Expected<Rewritten> with_speeds(const Rewriter& rewriter, SpeedPlan& speeds,
                                const ProgramSpeeds& known, Progress& progress) {
  auto best = rewriter.with(speeds);
  if (!best) return best;
  for (const auto& [number, line] : best->plan.lines())
    if (line.bound == FeedBound::fixed) speeds.keep(number, line.why);
  speeds.solve([&](int tool, const std::vector<process::SideCut>& cuts, double rpm,
                   double least) { return known.probability(tool, cuts, rpm, least); },
               ProgramSpeeds::kLeastProbability);
  SpeedPlan wanted = speeds;
  for (const auto& [line, word] : wanted.words())
    if (word.changed()) speeds.revert(line, SpeedBound::loads);
  double done = 0;
  for (const auto& [line, word] : wanted.words()) {
    progress.show(done++ / static_cast<double>(wanted.words().size()));
    if (!word.changed()) continue;
    speeds.set(line, word);
    auto trial = rewriter.with(speeds);
    if (!trial) return trial;
    const double gained_s = best->moves.duration_s - trial->moves.duration_s;
    const bool follows = std::ranges::none_of(trial->plan.lines(), [&](const auto& l) {
      return l.second.cuts && l.second.bound == FeedBound::fixed &&
             best->plan.lines().at(l.first).bound != FeedBound::fixed;
    });
    if (follows && (word.forced || gained_s >= SpeedPlan::kLeastGain * word.cut_before_s))
      best = std::move(trial);
    else
      speeds.revert(line, SpeedBound::axes);
  }
  return best;
}

struct Optimised {
  double before_s = 0, after_s = 0;
  bool accelerated = false;
  std::map<std::size_t, double> feeds_before_m_s;  ///< by line
  LoadSummary load;
  std::vector<process::Finding> findings;
};

double mm_min(double feed_m_s) { return feed_m_s * 60000; }

void say_speeds(const SpeedPlan& speeds) {
  const auto chance = [](double p) { return printed(100 * p, 3) + " %"; };
  for (const auto& [number, word] : speeds.words()) {
    if (!word.why.empty()) {
      say("line %zu: S stays at %.6g rpm: %s\n", number, word.before_rpm, word.why.c_str());
      continue;
    }
    say("line %zu: S%s %.6g rpm, held by %s; its cuts are stable with %s", number,
        word.changed() ? (" from " + printed(word.before_rpm, 6) + " to").c_str() : " stays at",
        word.after_rpm, std::string(bound_name(word.bound)).c_str(),
        chance(word.probability_after).c_str());
    if (word.changed()) say(" (%s before)", chance(word.probability_before).c_str());
    say("\n");
  }
}

void print_plan(const Arguments& arguments, const std::string& name, const std::string& out,
                const SpeedPlan& speeds, const FeedPlan& plan, const Optimised& o) {
  if (!arguments.json()) {
    say_speeds(speeds);
    for (const auto& [number, line] : plan.lines()) {
      const double before = mm_min(o.feeds_before_m_s.at(number));
      if (line.bound == FeedBound::fixed)
        say("line %zu: stays at %.5g mm/min: %s\n", number, before, line.why.c_str());
      else
        say("line %zu: %.5g to %.5g mm/min, held by %s\n", number, before, mm_min(line.after_m_s),
            std::string(bound_name(line.bound)).c_str());
    }
    say("%s: %.6g s before, %.6g s after, %s acceleration (%.3g %% less)\n", name.c_str(),
        o.before_s, o.after_s, o.accelerated ? "with" : "without",
        100 * (1 - o.after_s / o.before_s));
    o.load.say_greatest();
    for (const process::Finding& f : o.findings) say("line %zu: %s\n", f.line, f.message.c_str());
    return;
  }
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("program", name);
  json.member("out", out);
  json.member("time_before_s", o.before_s);
  json.member("time_after_s", o.after_s);
  json.member("accelerated", o.accelerated);
  json.objects("speeds", speeds.words(), [&](const auto& entry) {
    const auto& [number, word] = entry;
    json.member("line", number);
    json.member("limit", bound_name(word.bound));
    json.member("spindle_before_rpm", word.before_rpm);
    json.member("spindle_after_rpm", word.after_rpm);
    if (!std::isnan(word.probability_before)) {
      json.member("probability_stable_before", word.probability_before);
      json.member("probability_stable_after", word.probability_after);
    }
    if (!word.why.empty()) json.member("reason", word.why);
  });
  json.objects("limits", plan.lines(), [&](const auto& entry) {
    const auto& [number, line] = entry;
    json.member("line", number);
    json.member("limit", bound_name(line.bound));
    json.member("cuts", line.cuts);
    json.member("feed_before_m_s", o.feeds_before_m_s.at(number));
    json.member("feed_after_m_s", line.after_m_s);
    json.member("spindle_rpm", line.spindle_rpm);
    if (!line.why.empty()) json.member("reason", line.why);
  });
  json.objects("findings", o.findings, [&](const process::Finding& f) {
    json.member("line", f.line);
    json.member("last_line", f.last_line);
    json.member("kind", finding_name(f.kind));
    json.member("message", f.message);
    json.member("tool", f.tool);
  });
  o.load.write(json);
  json.end_object();
  std::cout << '\n';
}

int run_program_optimise(const Arguments& arguments) {
  const auto asked = asked_program(arguments, "program optimise");
  if (!asked) return fail(asked.error());
  const auto& [options, program] = *asked;
  std::ifstream file(arguments.operands()[0], std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  const auto machine = machine_with_coefficients(arguments);
  if (!machine) return fail(machine.error());
  const auto limits = process::CutLimits::from(*machine);
  if (!limits.bound_a_cut())
    return fail(data_error(machine->name() +
                           ": nothing limits a cut; give torque_Nm, power_W, feed_per_tooth_m or "
                           "deflection_m in [limits]"));
  const auto check_limits = process::CheckLimits::from(*machine);
  if (!check_limits) return fail(check_limits.error());
  const auto motion = motion_of(arguments);
  if (!motion) return fail(motion.error());
  process::MachineTools tools(*machine);
  const auto before = moves_of(program, options, *motion, tools);
  if (!before) return fail(before.error());
  ProgramLoads loads(*machine, 0);
  if (const auto done = loads.look_up(before->tools); !done) return fail(done.error());

  const bool quiet = arguments.quiet();
  Progress progress("cutting", quiet);
  auto stock = stock_of(arguments, options, tools, before->smallest_radius_m, progress);
  if (!stock) return fail(stock.error());
  const auto known = ProgramSpeeds::of(*machine, before->tools, loads);
  if (!known) return fail(known.error());
  SpeedPlan speeds = known->plan(program.lines(), limits, motion->limits, loads.compliance());
  std::vector<Engagement> steps;
  CutPlan cut{{stock->workpiece, process::cutters_of(tools),
               [&](const Engagement& e) {
                 if (known->asked()) speeds.add(e);
                 if (e.cuts()) steps.push_back(e);
               },
               kFinerStep},
              known->asked() ? &speeds : nullptr,
              loads};
  if (const auto done = give_moves(program.name(), before->asked, cut, progress); !done)
    return fail(done.error());
  const Rewriter rewriter{text, program, options, limits, *motion, tools, loads, *before, steps};
  const auto rewritten =
      known->asked() ? with_speeds(rewriter, speeds, *known, progress) : rewriter.with(speeds);
  if (!rewritten) return fail(rewritten.error());
  const auto& [better, plan, after] = *rewritten;

  Optimised o;
  o.before_s = before->duration_s, o.after_s = after.duration_s;
  o.accelerated = after.accelerated;
  for (const CanonicalMove& move : before->asked)
    if (process::at_a_feed(move)) {
      double& fastest = o.feeds_before_m_s[move.line];
      fastest = std::max(fastest, move.feed_m_s);
    }
  o.load.lacks = loads.lacks();
  for (const Engagement& e : steps)
    o.load.add(e, loads.of(e, loads.conditions(e, after.moves[e.move])));
  auto fresh = stock_of(arguments, options, tools, before->smallest_radius_m, progress);
  if (!fresh) return fail(fresh.error());
  process::ProgramCheck check(fresh->workpiece, tools, *check_limits);
  if (options.tools) check.set_tool_table(*options.tools);
  check.set_times(after.ends_s());
  if (const auto done = give_moves(program.name(), after.asked, check, progress); !done)
    return fail(done.error());
  o.findings = check.findings();
  if (const auto written = write_file(arguments.at("--out"), better); !written)
    return fail(written.error());

  say_what_is_unknown(*motion, quiet);
  for (const std::string& remark : loads.remarks(*machine)) note(remark, quiet);
  for (const std::string& remark : known->remarks()) note(remark, quiet);
  if (!machine->has("limits", "power_W") && limits.power_W < process::CutLimits::kNone)
    note("no [limits] power_W: [spindle] rated_power_W is the limit", quiet);
  if (limits.feed_per_tooth_m == process::CutLimits::kNone)
    note("feed per tooth is not limited ([limits] feed_per_tooth_m): a light cut may go very fast",
         quiet);
  print_plan(arguments, program.name(), arguments.at("--out"), speeds, plan, o);
  return 0;
}

}  // namespace

Program program_optimise_program() {
  std::vector<Option> options = {
      {"--machine", "FILE", "its tools, [limits] of the cut, how fast and how hard the axes go",
       true, FileUse::input},
      {"--out", "FILE", "the program with other F and S words", true, FileUse::output}};
  for (Option& option : stock_options()) options.push_back(std::move(option));
  for (Option& option : program_options()) options.push_back(std::move(option));
  return {
      {"program optimise", "the same program with the feeds and speeds that cut and machine allow",
       std::move(options), "FILE",
       "Each block goes as fast as [limits] torque_Nm, power_W, feed_per_tooth_m and "
       "deflection_m allow in its worst\n"
       "step, and no faster than the machine gets there. Where [tool] cutting_speed_m_s says how "
       "fast a tool may cut,\n"
       "each S word becomes the stable speed at which its cuts take the least time. F and S "
       "words alone change. The new\n"
       "program is checked and predicted again; which limit holds which line is told."},
      run_program_optimise};
}

}  // namespace servosense::cli
