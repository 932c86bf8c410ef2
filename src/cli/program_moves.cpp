#include "program_moves.hpp"

#include <algorithm>
#include <limits>
#include <optional>
#include <string>

#include "console.hpp"
#include "servosense/process/engagement/chip_load.hpp"
#include "servosense/process/motion/plain_time.hpp"
#include "servosense/process/motion/trajectory.hpp"

namespace servosense::cli {

using process::CanonicalMove;

Expected<process::MachineMotion> motion_of(const Arguments& arguments) {
  process::MachineMotion motion{{}, "xyz", "xyz"};
  if (const auto path = arguments.value("--machine")) {
    const auto machine = MachineFile::read(*path);
    if (!machine) return machine.error();
    motion = process::machine_motion(*machine);
  }
  for (const auto& [name, share] : {std::pair{"--feed-override", &motion.limits.feed_override},
                                    std::pair{"--rapid-override", &motion.limits.rapid_override}}) {
    const auto percent = arguments.within(name, 1, 300, "percent");
    if (!percent) return percent.error();
    if (*percent) *share = **percent / 100;
  }
  return motion;
}

Expected<double> timed(const process::ProgramText& program, const process::ProgramOptions& options,
                       const process::MachineMotion& motion,
                       const process::TrajectoryPlanner::Sink& sink) {
  const auto run = [&](auto&& time) -> Expected<double> {
    const auto done =
        process::run_program(program, options, [&](const CanonicalMove& move) { time.put(move); });
    if (!done) return done.error();
    time.finish();
    return time.now_s();
  };
  if (motion.unknown_acceleration.empty())
    return run(process::TrajectoryPlanner(motion.limits, sink));
  return run(process::PlainTime(motion.limits, sink));
}

void say_what_is_unknown(const process::MachineMotion& motion, bool quiet) {
  if (!motion.unknown_velocity.empty())
    note("how fast " + motion.unknown_velocity +
             " can go is not known ([axis.*] max_velocity_m_s): there rapids take no time" +
             (motion.unknown_acceleration.empty() ? " but acceleration" : ""),
         quiet);
  if (motion.unknown_spindle_start)
    note(
        "feeds wait for the spindle, but how long is not known ([machine] spindle_start_s): that "
        "takes no time",
        quiet);
  const auto known = 3 - motion.unknown_acceleration.size();
  if (known > 0 && known < 3)
    note("how hard " + motion.unknown_acceleration +
             " can accelerate is not known ([axis.*] max_acceleration_m_s2): times are without "
             "acceleration",
         quiet);
}

std::vector<double> ProgramMoves::ends_s() const {
  std::vector<double> ends;
  if (rapids_timed)
    for (const MoveTechnology& move : moves) ends.push_back(move.end_s);
  return ends;
}

namespace {

process::ProgramOptions held(process::ProgramOptions options) {
  options.most_moves = std::min(options.most_moves, kMostMovesHeld);
  return options;
}

}  // namespace

Expected<std::vector<CanonicalMove>> read_moves(const process::ProgramText& program,
                                                const process::ProgramOptions& options) {
  std::vector<CanonicalMove> moves;
  const auto done = process::run_program(program, held(options),
                                         [&](const CanonicalMove& move) { moves.push_back(move); });
  if (!done) return done.error();
  return moves;
}

Expected<ProgramMoves> moves_of(const process::ProgramText& program,
                                const process::ProgramOptions& options,
                                const process::MachineMotion& motion,
                                process::MachineTools& tools) {
  ProgramMoves found;
  found.smallest_radius_m = std::numeric_limits<double>::infinity();
  const process::MillingTool* tool = nullptr;
  std::optional<Error> refused;
  int number = 0;
  double before_s = 0;
  const auto duration =
      timed(program, held(options), motion, [&](const CanonicalMove& move, double end_s) {
        if (move.kind == CanonicalMove::Kind::tool && move.tool != number)
          number = move.tool, tool = nullptr;
        if (is_motion(move.kind) && tool == nullptr && !refused) {
          if (const auto known = tools.of(number)) {
            tool = *known;
            found.smallest_radius_m = std::min(found.smallest_radius_m, tool->cutter.radius_m());
            if (std::ranges::find(found.tools, number) == found.tools.end())
              found.tools.push_back(number);
          } else {
            refused = known.error();
          }
        }
        MoveTechnology t{before_s, end_s, process::kNoAngle, process::kNoAngle, move.spindle_rpm};
        if (tool != nullptr && move.kind != CanonicalMove::Kind::rapid) {
          t.feed_per_tooth_m = feed_per_tooth_m(move, tool->teeth.value_or(0));
          t.feed_per_turn_m = feed_per_tooth_m(move, 1);
        }
        found.asked.push_back(move);
        found.moves.push_back(t);
        before_s = end_s;
      });
  if (!duration) return duration.error();
  if (refused) return *refused;
  found.duration_s = *duration;
  found.accelerated = motion.unknown_acceleration.empty();
  found.rapids_timed = motion.unknown_velocity.empty();
  return found;
}

}  // namespace servosense::cli
