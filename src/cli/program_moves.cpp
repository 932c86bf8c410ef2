#include "program_moves.hpp"

#include <algorithm>
#include <limits>
#include <optional>
#include <string>

#include "servosense/process/engagement/chip_load.hpp"
#include "servosense/process/motion/plain_time.hpp"

namespace servosense::cli {

using process::CanonicalMove;

Expected<ProgramMoves> moves_of(const process::ProgramText& program,
                                const process::ProgramOptions& options, const MachineFile& machine,
                                process::MachineTools& tools) {
  process::RapidLimits limits;
  for (std::size_t i = 0; i < 3; ++i)
    if (const auto speed = machine.number("axis." + std::string(1, "xyz"[i]), "max_velocity_m_s"))
      limits.velocity_m_s[i] = *speed;
  ProgramMoves found;
  found.smallest_radius_m = std::numeric_limits<double>::infinity();
  const process::MillingTool* tool = nullptr;
  std::optional<Error> refused;
  int number = 0;
  double before_s = 0;
  process::PlainTime time(limits, [&](const CanonicalMove& move, double end_s) {
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
    MoveTechnology t{before_s, end_s, process::kNoAngle, move.spindle_rpm >= 0};
    if (tool != nullptr && move.kind != CanonicalMove::Kind::rapid)
      t.feed_per_tooth_m = feed_per_tooth_m(move, tool->teeth.value_or(0));
    found.moves.push_back(t);
    before_s = end_s;
  });
  const auto read =
      process::run_program(program, options, [&](const CanonicalMove& move) { time.put(move); });
  if (!read) return read.error();
  if (refused) return *refused;
  time.finish();
  found.duration_s = time.now_s();
  return found;
}

}  // namespace servosense::cli
