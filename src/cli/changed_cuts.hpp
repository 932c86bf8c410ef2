// What a program would ask for with another tool or another stock: it is cut again with each.
//
// A cause that moves the torque has its own course along a program. A wider tool asks for more in a
// slot, where it is as wide as the cut, and for little more in a side cut, whose width the program
// says; a higher stock asks for more in its upper layer, and the more so the shallower that is.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "console.hpp"
#include "program_moves.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/process/workpiece/workpiece.hpp"

namespace servosense::cli {

/// Change that a second cut has: of every diameter, and of the stock's height over the smallest
/// radius (chosen: well above what the lines of a workpiece leave to chance, small for a wrong
/// tool).
inline constexpr double kChange = 0.1;

/// Mean torque over the time of a program.
class TorqueCourse {
 public:
  void add(double from_s, double to_s, double torque_Nm) {
    steps_.push_back({from_s, to_s, torque_Nm});
  }
  /// Mean from one time to another; asked for in the order of the program. NaN where it is not
  /// known.
  [[nodiscard]] double mean_Nm(double from_s, double to_s);

 private:
  struct Step {
    double from_s = 0, to_s = 0, torque_Nm = 0;
  };
  std::vector<Step> steps_;
  std::size_t at_ = 0;
};

struct ChangedCuts {
  std::optional<TorqueCourse> wider;   ///< with tools a tenth wider; none: no such tool
  std::optional<TorqueCourse> higher;  ///< with the stock higher, or the program lower
};

/// `stock` as the program finds it.
Expected<ChangedCuts> changed_cuts(const MachineFile& machine, const ProgramMoves& moves,
                                   const process::Workpiece& stock, const std::string& program,
                                   Progress& progress);

}  // namespace servosense::cli
