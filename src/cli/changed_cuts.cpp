#include "changed_cuts.hpp"

#include <algorithm>
#include <limits>
#include <span>
#include <string>

#include "program_cut.hpp"
#include "program_loads.hpp"
#include "servosense/process/engagement/program_engagement.hpp"
#include "servosense/process/engagement/turning_tools.hpp"

namespace servosense::cli {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

MachineFile with_wider_tools(MachineFile machine) {
  for (const std::string& section : machine.sections()) {
    if (section != "tool" && !section.starts_with("tool.")) continue;
    if (const auto diameter = machine.number(section, "diameter_m"))
      machine.set(section, "diameter_m", *diameter * (1 + kChange));
  }
  return machine;
}

Expected<TorqueCourse> torque_course(const MachineFile& machine, const ProgramMoves& program,
                                     std::span<const process::CanonicalMove> moves,
                                     process::Workpiece stock, const std::string& name,
                                     Progress& progress) {
  process::MachineTools tools(machine);
  ProgramLoads loads(machine, 0);
  if (const auto known = loads.look_up(program.tools); !known) return known.error();
  TorqueCourse course;
  process::ProgramEngagement engagement(
      stock, process::cutters_of(tools), [&](const process::Engagement& e) {
        const MoveTechnology& t = program.moves[e.move];
        const double lasts_s = t.end_s - t.begin_s;
        course.add(t.begin_s + lasts_s * e.from_share, t.begin_s + lasts_s * e.to_share,
                   loads.mean_torque_Nm(e, t));
      });
  if (const auto done = give_moves(name, moves, engagement, progress); !done) return done.error();
  return course;
}

}  // namespace

double TorqueCourse::mean_Nm(double from_s, double to_s) {
  while (at_ + 1 < steps_.size() && steps_[at_].to_s <= from_s) ++at_;
  double sum = 0, lasts_s = 0;
  for (std::size_t i = at_; i < steps_.size() && steps_[i].from_s < to_s; ++i) {
    const Step& s = steps_[i];
    const double shared_s = std::min(to_s, s.to_s) - std::max(from_s, s.from_s);
    if (!(shared_s > 0)) continue;
    sum += shared_s * s.torque_Nm;
    lasts_s += shared_s;
  }
  return lasts_s > 0 ? sum / lasts_s : kUnknown;
}

Expected<ChangedCuts> changed_cuts(const MachineFile& machine, const ProgramMoves& moves,
                                   const process::Workpiece& stock, const std::string& program,
                                   Progress& progress) {
  ChangedCuts cuts;
  const MachineFile wider = with_wider_tools(machine);
  // A tool of which only the diameter grows may be none: its corner, its holder.
  process::MachineTools tools(wider);
  if (std::ranges::all_of(moves.tools,
                          [&](int tool) { return static_cast<bool>(tools.of(tool)); })) {
    auto course = torque_course(wider, moves, moves.asked, stock, program, progress);
    if (!course) return course.error();
    cuts.wider = *std::move(course);
  }
  std::vector<process::CanonicalMove> lower = moves.asked;
  for (process::CanonicalMove& move : lower)
    for (process::AxisPoint* point : {&move.end, &move.machine, &move.begin})
      (*point)[2] -= kChange * moves.smallest_radius_m;
  auto course = torque_course(machine, moves, lower, stock, program, progress);
  if (!course) return course.error();
  cuts.higher = *std::move(course);
  return cuts;
}

}  // namespace servosense::cli
