// Spindle speeds of a program: of each S word the one at which the cuts under it take the least
// time.
//
//   SpeedPlan plan(lines, limits, motion, compliance, {least rpm, greatest rpm});
//   each tool: plan.set_cutting_speed(tool, least, greatest);
//   each move: plan.put(move, cutter law); each step: plan.add(engagement);
//   plan.solve(stable);
//
// One speed an S word, because a spindle takes seconds to change and the program says where it may.
// At a speed the feed of every line follows from the limits of its cuts (feed_limits.hpp); with it
// the time. Feed per tooth and deflection do not depend on the speed, torque that the motor has and
// power do. Of the speeds that are stable the fastest is taken, and among those that are alike
// within kAlike the nearest to that of the program, which stays where less than kLeastGain is won.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "servosense/model/milling.hpp"
#include "servosense/process/motion/motion_limits.hpp"
#include "servosense/process/optimise/feed_limits.hpp"
#include "servosense/process/program/canonical_move.hpp"
#include "servosense/process/torque/step_load.hpp"

namespace servosense::process {

/// What keeps a speed from being another.
enum class SpeedBound : std::uint8_t {
  loads,          ///< another gains nothing: what holds the feeds holds them there too
  cutting_speed,  ///< [tool] cutting_speed_m_s
  spindle_speed,  ///< [limits] spindle_speed_rpm
  stability,      ///< a faster one chatters
  axes,           ///< the machine does not get faster on these paths
  fixed,          ///< it stays: why, SpeedPlan tells
};
/// As in JSON.
[[nodiscard]] std::string_view bound_name(SpeedBound bound);

/// What a tool with a straight side cuts at once: tooth angles as in model/milling.hpp, about the
/// axes of the machine instead of the feed; whole kAngleStep.
struct SideCut {
  ::servosense::Engagement engagement;
  double axial_depth_m = 0;
};

class SpeedPlan {
 public:
  static constexpr double kAlike = 1e-3;
  /// Of the time of the cuts under a word (chosen: a hundredth is less than tool or stock differ
  /// by from part to part).
  static constexpr double kLeastGain = 0.01;
  /// From one speed that is tried to the next (chosen: the time of a cut that the speed bounds is
  /// met to half of that, and pockets are wider).
  static constexpr double kSpeedStep = 0.005;
  /// Of the angles of a SideCut [deg] (chosen: half of it moves a limit by some per cent at most).
  static constexpr double kAngleStep_deg = 3;

  struct Word {
    double before_rpm = 0, after_rpm = 0;
    SpeedBound bound = SpeedBound::fixed;
    std::string why;                       ///< of SpeedBound::fixed
    double probability_before = kNoAngle;  ///< that all its cuts are stable
    double probability_after = kNoAngle;
    double cut_before_s = 0, cut_after_s = 0;  ///< of its cuts, without acceleration
    bool forced = false;  ///< what the program says is outside a limit, or unstable
    [[nodiscard]] bool changed() const { return after_rpm != before_rpm; }
  };

  /// Probability that all cuts of a tool are stable; may stop counting, and tell less, where it is
  /// below `least`.
  using Stability =
      std::function<double(int tool, const std::vector<SideCut>& cuts, double rpm, double least)>;

  SpeedPlan(std::vector<std::string> lines, const CutLimits& limits, const MotionLimits& motion,
            const std::array<double, 2>& compliance_m_per_N,
            const std::array<double, 2>& spindle_rpm);
  /// A tool without it keeps its speeds.
  void set_cutting_speed(int tool, double least_m_s, double greatest_m_s) {
    cutting_speed_[tool] = {least_m_s, greatest_m_s};
  }
  /// A tool whose cuts cannot be judged keeps its speeds.
  void set_unstudied(int tool, const std::string& why) { unstudied_[tool] = why; }

  /// Every move, in order; `law` as of FeedPlan::put.
  void put(const CanonicalMove& move, const ToolLaw* law);
  /// Every step of the engagement.
  void add(const Engagement& engagement);
  /// A line whose feed does not follow keeps the speed it is cut at.
  void keep(std::size_t line, const std::string& why);
  /// Once all has been put.
  void solve(const Stability& probability_stable, double least_probability);
  /// What another rule says of a word.
  void revert(std::size_t line, SpeedBound bound);
  void set(std::size_t line, const Word& word) { words_.at(line) = word; }

  /// Lines with an S word under which something is cut.
  [[nodiscard]] const std::map<std::size_t, Word>& words() const { return words_; }
  /// Digits of the S words to write, by line.
  [[nodiscard]] std::map<std::size_t, std::string> digits() const;
  /// The moves with the speeds of the plan; feeds of a revolution go with them.
  [[nodiscard]] std::vector<CanonicalMove> moves() const;

 private:
  /// A line that cuts, under one word.
  struct LineCut {
    const ToolLaw* law = nullptr;  ///< null: so far all in air
    int tool = 0;
    double length_m = 0;
    double greatest_m_s = kNoLimit;              ///< axes and [limits] feed_m_s
    double feed_per_tooth_m = CutLimits::kNone;  ///< at any speed
    std::vector<StepAreas> areas;                ///< that no other exceeds in both
  };
  struct Section {
    std::map<std::size_t, LineCut> lines;
    std::map<int, std::map<std::pair<int, int>, double>> cuts;  ///< of a tool: arc, greatest depth
  };
  void fix(std::size_t word, const std::string& why);
  [[nodiscard]] double seconds(const Section& section, double rpm) const;
  [[nodiscard]] double feed(const LineCut& cut, double rpm) const;
  void choose(const Section& section, Word& word, const Stability& probability, double least);
  [[nodiscard]] double probability(const Section& section, const Stability& of, double rpm,
                                   double least) const;

  std::vector<std::string> text_;
  CutLimits limits_;
  MotionLimits motion_;
  std::array<double, 2> compliance_;
  std::array<double, 2> spindle_rpm_;
  std::map<int, std::array<double, 2>> cutting_speed_;
  std::map<int, std::string> unstudied_;
  std::vector<CanonicalMove> moves_;
  std::vector<const ToolLaw*> laws_;
  std::vector<double> axis_m_s_;      // what the axes allow along each move
  std::vector<std::size_t> word_of_;  // line of the S word of each move; 0: none
  std::vector<int> tool_of_;
  std::size_t word_ = 0;
  int tool_ = 0;
  AxisPoint machine_{};
  std::map<std::size_t, Section> sections_;
  std::map<std::size_t, Word> words_;
};

}  // namespace servosense::process
