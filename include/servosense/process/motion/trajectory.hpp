// When a machine is where: the moves of an NC program as a control drives them, with acceleration
// (and jerk) of every axis limited, corners rounded within G64 P, arcs held to what their
// centripetal acceleration allows, and a look ahead over the moves that follow.
//
// Modelled on the trajectory planner of LinuxCNC 2.9: straight moves within G64 Q are one, an arc
// of G17 within it is two; a corner is taken straight on, by an arc or by overlapping
// accelerations, whichever is fastest; the speed between moves is the greatest from which the
// machine can still stop within the look-ahead. Without jerk limits a profile is a trapezoid, as
// there. With them every change of speed within a move begins and ends without acceleration: no
// jerk is exceeded within a move, and a path of many short moves becomes slower than it need be.
//
// With `spindle_start_s` the first feed after a change of the spindle's speed waits for it. Takes
// no time: coolant, operator, finding the angle of the spindle before G33 and G33.1. Rigid tapping
// takes its way there and back at its feed.
#pragma once

#include <deque>
#include <functional>
#include <vector>

#include "servosense/process/motion/path_segment.hpp"
#include "servosense/process/motion/spindle_start.hpp"
#include "servosense/process/motion/velocity_profile.hpp"

namespace servosense::process {

/// A stretch of path with its time. Stretches may overlap where accelerations do: the machine's
/// displacement is the sum of theirs.
struct TimedMotion {
  PathCurve curve;
  VelocityProfile profile;
  double start_s = 0;
  std::size_t line = 0;  ///< of the program
  bool rapid = false;
  bool rounding = false;  ///< of a corner
  [[nodiscard]] double end_s() const { return start_s + profile.duration_s(); }
};

class TrajectoryPlanner {
 public:
  /// A move with the time at which it is done: the next takes over (where the rounding of a
  /// corner begins).
  using Sink = std::function<void(const CanonicalMove&, double end_s)>;
  using MotionSink = std::function<void(TimedMotion&&)>;
  /// Every acceleration of `limits` is finite.
  TrajectoryPlanner(const MotionLimits& limits, Sink sink, MotionSink motions = {})
      : limits_(limits),
        sink_(std::move(sink)),
        motions_(std::move(motions)),
        spindle_(limits.spindle_start_s) {}

  void put(const CanonicalMove& move);
  /// The machine comes to stand; all moves are given out.
  void finish();
  [[nodiscard]] double now_s() const { return now_s_; }

 private:
  using Mark = PathSegment::Mark;

  /// A point of a line that may be one with others.
  struct LinePoint {
    CanonicalMove move;         // straight to `move.machine`
    CanonicalMove::Kind asked;  // by the program
    bool ends_move;
  };

  void put_path(const CanonicalMove& move);
  void put_line(const CanonicalMove& move, CanonicalMove::Kind asked, bool ends_move);
  /// Whether `move` goes on within the line that is being gathered.
  [[nodiscard]] bool in_line(const CanonicalMove& move) const;
  void close_line();
  void append(PathSegment segment);
  void run_first(bool last);
  [[nodiscard]] double leaving_speed() const;

  MotionLimits limits_;
  Sink sink_;
  MotionSink motions_;
  SpindleStart spindle_;
  AxisPoint machine_{};          // where the path ends
  std::vector<LinePoint> line_;  // from `line_from_`
  AxisPoint line_from_{};
  std::deque<PathSegment> ahead_;
  double now_s_ = 0, speed_m_s_ = 0;
  double given_s_ = 0;    // time of the last move that was given out
  double overlap_s_ = 0;  // how early the next sets out
};

/// A whole trajectory to be asked by time.
class Trajectory {
 public:
  void add(TimedMotion&& motion);
  [[nodiscard]] const std::vector<TimedMotion>& motions() const { return motions_; }
  [[nodiscard]] double duration_s() const { return end_s_; }
  /// Where the machine is [m; deg of a, b, c]; before and after, where it stands.
  [[nodiscard]] AxisPoint position(double t_s) const;
  /// Of x, y, z [m/s].
  [[nodiscard]] Eigen::Vector3d velocity(double t_s) const;

 private:
  /// First motion that has not ended before `t_s`.
  [[nodiscard]] std::size_t first_at(double t_s) const;

  std::vector<TimedMotion> motions_;  // their ends do not go back
  double end_s_ = 0;
};

}  // namespace servosense::process
