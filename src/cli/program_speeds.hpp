// The spindle speeds that `program optimise` may choose, and what is known of the stability of the
// program's cuts at each.
#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "program_loads.hpp"
#include "servosense/identify/uncertain_cut.hpp"
#include "servosense/process/optimise/speed_plan.hpp"

namespace servosense::cli {

class ProgramSpeeds {
 public:
  /// Of the machines that a tool may be on, at least so many are stable.
  static constexpr double kLeastProbability = 0.95;
  /// Chosen: a share of 95 % of them is met to 1.5 %.
  static constexpr std::ptrdiff_t kSamples = 200;

  /// Of the tools that the program uses. Data errors of [structure.*] and of a reversed range.
  static Expected<ProgramSpeeds> of(const MachineFile& machine, const std::vector<int>& tools,
                                    const ProgramLoads& loads);
  /// Whether any tool says how fast it may cut; else every speed stays, and nothing is said of it.
  [[nodiscard]] bool asked() const { return !cutting_speed_.empty(); }
  /// A plan that knows the tools.
  [[nodiscard]] process::SpeedPlan plan(std::vector<std::string> lines,
                                        const process::CutLimits& limits,
                                        const process::MotionLimits& motion,
                                        const std::array<double, 2>& compliance) const;
  [[nodiscard]] double probability(int tool, const std::vector<process::SideCut>& cuts, double rpm,
                                   double least) const;
  [[nodiscard]] const std::vector<std::string>& remarks() const { return remarks_; }

 private:
  struct Studied {
    UncertainCut cut;
    CutBelief belief;
  };
  std::array<double, 2> spindle_rpm_ = {0, process::kNoLimit};
  std::map<int, std::array<double, 2>> cutting_speed_;
  std::map<int, Studied> studied_;
  std::map<int, std::string> unstudied_;
  std::vector<std::string> remarks_;
};

}  // namespace servosense::cli
