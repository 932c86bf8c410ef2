// Verifies an NC program: cuts it into the stock and tells by line what must not be.
//
//   ProgramCheck check(workpiece, tools, limits);
//   run_program(text, options, [&](const CanonicalMove& move) { check.put(move); });
//   check.finish();
//   for (const Finding& finding : check.findings()) ...
//
// A finding that goes on from step to step, or from block to block, is one, with its greatest size.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "servosense/process/engagement/program_engagement.hpp"
#include "servosense/process/motion/spindle_start.hpp"
#include "servosense/process/program/tool_table.hpp"
#include "servosense/process/tool/machine_tools.hpp"
#include "servosense/process/verification/finding.hpp"

namespace servosense::process {

/// What the machine and the tools stand, [limits] and [machine] of the machine file. Infinite: not
/// known.
struct CheckLimits {
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  /// Machine coordinates of x, y, z [m], least and greatest.
  std::array<std::array<double, 2>, 3> travel_m = {
      {{-kNone, kNone}, {-kNone, kNone}, {-kNone, kNone}}};
  std::array<double, 2> spindle_speed_rpm = {0, kNone};
  double feed_per_tooth_m = kNone;
  double axial_depth_m = kNone;
  /// What the spindle takes to its speed while the control goes on [s]; 0 where that waits.
  double spindle_start_s = kNone;

  /// Data error for a pair that is none.
  static Expected<CheckLimits> from(const MachineFile& machine);
};

/// Removed by a step below this [m3] (derived: a micrometre on a square millimetre, what chords of
/// arcs and floats make) is no contact.
inline constexpr double kLeastContact = 1e-12;
/// Deviation from the target that is none, unless it is given [m] (chosen: what general tolerances
/// leave to a milled face of 6 mm, ISO 2768-1 fine).
inline constexpr double kTargetTolerance = 5e-5;

class ProgramCheck {
 public:
  /// All of them outlive the check. `workpiece` is cut.
  ProgramCheck(Workpiece& workpiece, MachineTools& tools, const CheckLimits& limits);
  /// Where the cutter and its holder must not be. It is cut, too.
  void add_fixture(Workpiece& fixture);
  /// What is to be left. `target` is cut by a cutter that is `tolerance_m` smaller all round: where
  /// it removes anything, the program gouges.
  void set_target(Workpiece& target, double tolerance_m);
  /// Lengths of the tools, where the machine file has none of them. Where the offset in force is
  /// another, the cut is made at the height at which the tip then is.
  void set_tool_table(const ToolTable& table) { table_ = &table; }

  /// When each of the moves that put() takes is done [s]: without it no cut is found that begins
  /// before the spindle has its speed.
  void set_times(std::vector<double> ends_s) { ends_s_ = std::move(ends_s); }

  /// Hears of every step.
  void set_listener(ProgramEngagement::Sink listener) { listener_ = std::move(listener); }

  /// Errors as of ProgramEngagement::put().
  Expected<Done> put(const CanonicalMove& move);
  void finish();

  /// By line.
  [[nodiscard]] const std::vector<Finding>& findings() const { return findings_; }
  [[nodiscard]] double removed_m3() const { return engagement_.removed_m3(); }
  [[nodiscard]] std::size_t moves() const { return moves_.size(); }
  /// Lines at which a cut that goes on turns from climb to conventional milling, or back.
  [[nodiscard]] const std::vector<std::size_t>& direction_changes() const {
    return direction_changes_;
  }

 private:
  struct Move {
    CanonicalMove::Kind kind{};
    double spindle_rpm = 0, feed_per_tooth_m = 0;
    double begin_s = 0, end_s = 0;
    double spindle_ready_s = 0;  // of a feed that does not follow the spindle
  };
  /// The last finding of a kind, from 1, and the move at which it was seen last.
  struct Open {
    std::size_t finding = 0, move = 0;
  };
  void look_at(const CanonicalMove& move);
  void judge(const Engagement& e);
  void judge_direction(const Engagement& e, double spindle_rpm);
  void find(FindingKind kind, const Engagement& at, double size);
  [[nodiscard]] std::string message_of(const Finding& finding) const;
  /// From the gauge line to the tip [m]; nothing without a table.
  [[nodiscard]] std::optional<double> real_length(int number) const;
  /// The offset in force less that; 0 if it is right or not known.
  [[nodiscard]] double length_off(const CanonicalMove& move) const;
  [[nodiscard]] bool measured(int number) const;
  [[nodiscard]] double flute_of(int number) const;
  [[nodiscard]] double ramp_of(int number) const;

  MachineTools& tools_;
  CheckLimits limits_;
  ProgramEngagement engagement_;
  std::vector<std::unique_ptr<ProgramEngagement>> fixtures_;
  std::unique_ptr<ProgramEngagement> target_;
  std::map<int, std::unique_ptr<Cutter>> smaller_;
  ProgramEngagement::Sink listener_;
  double tolerance_m_ = 0;
  const ToolTable* table_ = nullptr;
  std::vector<Move> moves_;
  std::vector<double> ends_s_;
  SpindleStart spindle_;
  int tool_ = 0;
  AxisPoint machine_{};  // where it stands
  std::vector<Finding> findings_;
  std::array<Open, kFindingKinds> open_{};
  std::vector<std::size_t> direction_changes_;
  int direction_ = 0;  // 1 climb, -1 conventional, 0 not known
};

}  // namespace servosense::process
