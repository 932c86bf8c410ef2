// The feeds of a program's lines: as high as its cuts, its axes and their acceleration allow.
//
//   FeedPlan plan(lines, limits, motion, compliance);
//   each move: plan.put(move, cutter law); each step: plan.add(engagement);
//   plan.solve();
//   with_words(text, 'F', plan.words());
//
// A line is one block, whatever it makes: all its moves, in a loop each time, go at one feed, the
// least that any of their steps stands. Speeds and path stay as they are, so that a step is cut as
// before.
#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "servosense/process/motion/motion_limits.hpp"
#include "servosense/process/optimise/feed_limits.hpp"
#include "servosense/process/program/canonical_move.hpp"

namespace servosense::process {

class FeedPlan {
 public:
  struct Line {
    double before_m_s = 0, after_m_s = 0;  ///< the fastest of its moves before
    double spindle_rpm = 0;                ///< of its first move
    bool cuts = false;
    FeedBound bound = FeedBound::none;
    std::string why;  ///< of FeedBound::fixed
    [[nodiscard]] bool changed() const { return after_m_s != before_m_s; }
  };

  /// `lines`: of the program. `accelerated`: `motion` has every acceleration.
  FeedPlan(std::vector<std::string> lines, const CutLimits& limits, const MotionLimits& motion,
           bool accelerated, const std::array<double, 2>& compliance_m_per_N);

  /// Every move, in order. `law` of the tool in the spindle, null where none has moved yet; it
  /// outlives the plan.
  void put(const CanonicalMove& move, const ToolLaw* law);
  /// Every step of the engagement.
  void add(const Engagement& engagement);
  /// Once all has been put.
  void solve();

  /// Lines with moves at a feed, by number.
  [[nodiscard]] const std::map<std::size_t, Line>& lines() const { return lines_; }
  /// Digits of the F words to write, by line.
  [[nodiscard]] const std::map<std::size_t, std::string>& words() const { return words_; }
  /// The moves with the feeds of the plan.
  [[nodiscard]] std::vector<CanonicalMove> moves() const;

 private:
  struct Of {
    BoundFeed bound;
    bool cuts = false;
  };
  void fix(Line& line, const std::string& why) const;
  [[nodiscard]] bool has_word(std::size_t line) const;
  void bound_moves();
  void leave_out_what_gains_nothing();
  void write_words();
  /// How fast the machine gets on each line, and the time.
  double run(std::map<std::size_t, double>& fastest_m_s) const;

  std::vector<std::string> text_;
  CutLimits limits_;
  MotionLimits motion_;
  bool accelerated_;
  std::array<double, 2> compliance_;
  std::vector<CanonicalMove> moves_;
  std::vector<const ToolLaw*> laws_;
  std::vector<Of> of_;
  std::vector<double> axis_m_s_;  // what the axes allow along each move
  AxisPoint machine_{};
  std::map<std::size_t, Line> lines_;
  std::map<std::size_t, std::string> words_;
};

}  // namespace servosense::process
