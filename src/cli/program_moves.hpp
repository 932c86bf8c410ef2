// The moves of an NC program, read once: what they are, when they are made, and with what.
#pragma once

#include <cstdint>
#include <vector>

#include "arguments.hpp"
#include "servosense/process/motion/trajectory.hpp"
#include "servosense/process/program/program_reader.hpp"
#include "servosense/process/tool/machine_tools.hpp"

namespace servosense::cli {

/// All that a changed feed or speed changes.
struct MoveTechnology {
  double begin_s = 0, end_s = 0;
  double feed_per_tooth_m = 0;  ///< NaN where it is not known
  double feed_per_turn_m = 0;   ///< NaN of a rapid, and where the spindle stands
  double spindle_rpm = 0;       ///< clockwise positive
  [[nodiscard]] bool clockwise() const { return spindle_rpm >= 0; }
};

/// Moves that are held at once, as cutting them needs (derived: 4 GB).
inline constexpr std::uint64_t kMostMovesHeld = 10'000'000;

/// Of --machine and of what the operator turns: --feed-override, --rapid-override.
Expected<process::MachineMotion> motion_of(const Arguments& arguments);
/// Gives every move and the time of its end to `sink`, with acceleration if that is known; the
/// whole time [s].
Expected<double> timed(const process::ProgramText& program, const process::ProgramOptions& options,
                       const process::MachineMotion& motion,
                       const process::TrajectoryPlanner::Sink& sink);
void say_what_is_unknown(const process::MachineMotion& motion, bool quiet);

struct ProgramMoves {
  std::vector<process::CanonicalMove> asked;  ///< by the program
  std::vector<MoveTechnology> moves;          ///< of each
  double duration_s = 0;
  bool accelerated = false;      ///< whether it holds acceleration
  bool rapids_timed = false;     ///< whether it holds rapids
  double smallest_radius_m = 0;  ///< of the tools that move; infinite without one
  std::vector<int> tools;        ///< that move, each once
  /// When each move is done [s]; empty where rapids take no time because their speed is not known.
  [[nodiscard]] std::vector<double> ends_s() const;
};

/// All that a program asks for. Error of the program; a data error beyond kMostMovesHeld.
Expected<std::vector<process::CanonicalMove>> read_moves(const process::ProgramText& program,
                                                         const process::ProgramOptions& options);
/// Errors of the program, and of a tool that the machine file has not.
Expected<ProgramMoves> moves_of(const process::ProgramText& program,
                                const process::ProgramOptions& options,
                                const process::MachineMotion& motion, process::MachineTools& tools);

}  // namespace servosense::cli
