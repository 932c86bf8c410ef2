// servosense program optimise: the same program with feeds as high as cut and machine allow.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iostream>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "program_cut.hpp"
#include "program_loads.hpp"
#include "program_moves.hpp"
#include "program_options.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/write_file.hpp"
#include "servosense/process/engagement/program_engagement.hpp"
#include "servosense/process/engagement/turning_tools.hpp"
#include "servosense/process/optimise/feed_plan.hpp"
#include "servosense/process/optimise/feed_text.hpp"
#include "servosense/process/verification/program_check.hpp"

namespace servosense::cli {
namespace {

using process::CanonicalMove;
using process::Engagement;
using process::FeedBound;
using process::FeedPlan;

/// Steps half as long as those of a prediction: the feed of a block is that of its worst step.
constexpr double kFinerStep = process::kStepShare / 2;

/// The program, cut once, with what bounds its feeds.
struct CutPlan {
  process::ProgramEngagement engagement;
  FeedPlan& plan;
  const ProgramLoads& loads;
  int tool = 0;

  Expected<Done> put(const CanonicalMove& move) {
    if (move.kind == CanonicalMove::Kind::tool) tool = move.tool;
    plan.put(move, loads.knows(tool) ? &loads.law(tool) : nullptr);
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

/// What the new text asks for is what the plan says.
Expected<Done> same_moves(const std::string& name, const std::vector<CanonicalMove>& moves,
                          const FeedPlan& plan) {
  const std::vector<CanonicalMove> expected = plan.moves();
  const auto same = [](const CanonicalMove& a, const CanonicalMove& b) {
    return a.kind == b.kind && a.machine == b.machine &&
           std::abs(a.feed_m_s - b.feed_m_s) <= 2e-4 * b.feed_m_s;
  };
  const auto [other, missed] = std::ranges::mismatch(
      moves, expected, [&](const auto& m, const auto& e) { return same(e, m); });
  if (other == moves.end() && missed == expected.end()) return Done{};
  const std::size_t wrong = other == moves.end() ? 0 : other->line;
  return data_error(name + ":" + std::to_string(wrong) +
                    ": with other F words the program would make another move here; it may compute "
                    "with its feed: write the feed as a number");
}

struct Optimised {
  double before_s = 0, after_s = 0;
  bool accelerated = false;
  LoadSummary load;
  std::vector<process::Finding> findings;
};

double mm_min(double feed_m_s) { return feed_m_s * 60000; }

void print_plan(const Arguments& arguments, const std::string& name, const std::string& out,
                const FeedPlan& plan, const Optimised& o) {
  if (!arguments.json()) {
    for (const auto& [number, line] : plan.lines()) {
      if (line.bound == FeedBound::fixed)
        say("line %zu: stays at %.5g mm/min: %s\n", number, mm_min(line.before_m_s),
            line.why.c_str());
      else
        say("line %zu: %.5g to %.5g mm/min, held by %s\n", number, mm_min(line.before_m_s),
            mm_min(line.after_m_s), std::string(bound_name(line.bound)).c_str());
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
  json.objects("limits", plan.lines(), [&](const auto& entry) {
    const auto& [number, line] = entry;
    json.member("line", number);
    json.member("limit", bound_name(line.bound));
    json.member("cuts", line.cuts);
    json.member("feed_before_m_s", line.before_m_s);
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
  if (const auto known = loads.look_up(before->tools); !known) return fail(known.error());

  const bool quiet = arguments.quiet();
  Progress progress("cutting", quiet);
  auto stock = stock_of(arguments, options, tools, before->smallest_radius_m, progress);
  if (!stock) return fail(stock.error());
  FeedPlan plan(program.lines(), limits, motion->limits, before->accelerated, loads.compliance());
  std::vector<Engagement> steps;
  CutPlan cut{{stock->workpiece, process::cutters_of(tools),
               [&](const Engagement& e) {
                 plan.add(e);
                 if (e.cuts()) steps.push_back(e);
               },
               kFinerStep},
              plan,
              loads};
  if (const auto done = give_moves(program.name(), before->asked, cut, progress); !done)
    return fail(done.error());
  if (const auto one = in_one_file(program, plan); !one) return fail(one.error());
  plan.solve();

  const std::string better = process::with_feeds(text, plan.words());
  const auto changed = process::ProgramText::from(better, program.name());
  const auto after = moves_of(changed, options, *motion, tools);
  if (!after) return fail(after.error());
  if (const auto same = same_moves(changed.name(), after->asked, plan); !same)
    return fail(same.error());
  Optimised o;
  o.before_s = before->duration_s, o.after_s = after->duration_s;
  o.accelerated = after->accelerated;
  o.load.lacks = loads.lacks();
  for (const Engagement& e : steps)
    o.load.add(e, loads.of(e, loads.conditions(e, after->moves[e.move])));
  auto fresh = stock_of(arguments, options, tools, before->smallest_radius_m, progress);
  if (!fresh) return fail(fresh.error());
  process::ProgramCheck check(fresh->workpiece, tools, *check_limits);
  if (options.tools) check.set_tool_table(*options.tools);
  check.set_times(after->ends_s());
  if (const auto done = give_moves(changed.name(), after->asked, check, progress); !done)
    return fail(done.error());
  o.findings = check.findings();
  if (const auto written = write_file(arguments.at("--out"), better); !written)
    return fail(written.error());

  say_what_is_unknown(*motion, quiet);
  for (const std::string& remark : loads.remarks(*machine)) note(remark, quiet);
  if (limits.feed_per_tooth_m == process::CutLimits::kNone)
    note("feed per tooth is not limited ([limits] feed_per_tooth_m): a light cut may go very fast",
         quiet);
  print_plan(arguments, program.name(), arguments.at("--out"), plan, o);
  return 0;
}

}  // namespace

Program program_optimise_program() {
  std::vector<Option> options = {
      {"--machine", "FILE", "its tools, [limits] of the cut, how fast and how hard the axes go",
       true, FileUse::input},
      {"--out", "FILE", "the program with other F words", true, FileUse::output}};
  for (Option& option : stock_options()) options.push_back(std::move(option));
  for (Option& option : program_options()) options.push_back(std::move(option));
  return {{"program optimise", "the same program with the feeds that cut and machine allow",
           std::move(options), "FILE",
           "Each block goes as fast as [limits] torque_Nm, power_W, feed_per_tooth_m and "
           "deflection_m allow in its worst\n"
           "step, and no faster than the machine gets there. F words alone change. The new program "
           "is checked and\n"
           "predicted again; which limit holds which line is told."},
          run_program_optimise};
}

}  // namespace servosense::cli
