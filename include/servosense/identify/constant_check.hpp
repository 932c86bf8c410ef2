// Whether the torque constant of a drive still is what it was, from its accelerations in normal
// use.
//
// Purpose: the torque of inertia is the reference. Where the effort is rho times what the motor
// gives, or the inertia has changed by as much, the disturbance observer reads
//   est = (rho - 1) J a + friction that has changed + cut.
// A run-up and a run-down through the same speeds see the same friction, whatever its law, so
//   est_up - est_down = (rho - 1) J (a_up - a_down)
// in bins of speed, least squares over the bins: the drift of one pair. What is left is what the
// friction has changed by, and is told apart. Each run-up is held against the run-down before and
// the one behind it, so that friction that warms up on the way cancels.
// Of the last kWindow pairs the median is the drift (a cut in one of them, or a collision, does not
// count), with the standard error of a median. It is told once it is beyond kLeast and four
// standard errors, and four pairs of five are beyond kLeast by themselves. One that came at once
// across a standstill is a step: another tool or work, not a motor. Cost: two observers more a
// drive, O(1) a sample; memory grows by a few numbers a pair. Host code. Bad at: telling a torque
// constant from an inertia; fewer than four pairs; speeds that are passed only one way.
#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <optional>
#include <vector>

#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

struct ConstantDrift {
  double drift = 0;  ///< rho - 1
  double standard_error = 0;
  double friction = 0;    ///< N or Nm against the motion more than the machine file has
  std::size_t pairs = 0;  ///< of the window
  bool beyond = false;    ///< by the rule above
  bool step = false;      ///< it came at once, across a standstill
  double before = 0;      ///< of a step: the drift until then
};

class ConstantCheck {
 public:
  static constexpr double kLeast = 0.02;      // a tool of 2 % of what turns is no drift
  static constexpr std::size_t kWindow = 12;  // pairs
  static constexpr std::size_t kFewest = 4;   // likewise

  /// The observer of a drive, used at 100 rad/s at most: accelerations last longer than that, and
  /// encoder noise does not pass. Its inertia must be positive.
  explicit ConstantCheck(DisturbanceObserverConfig observer);
  /// A sample; `usable` where its effort tells of the torque.
  void sample(const DriveSample<double>& sample, bool usable);
  /// What the last pairs say; nothing before there are enough.
  [[nodiscard]] const std::optional<ConstantDrift>& now() const { return now_; }
  /// Accelerations that were compared so far.
  [[nodiscard]] std::size_t pairs() const { return pairs_.size(); }

 private:
  struct Bin {
    double estimate = 0, acceleration = 0, n = 0;
  };
  /// An acceleration, up or down, one way.
  struct Leg {
    std::map<int, Bin> bins;  // six to the octave of speed
    bool any = false;
    std::size_t stands = 0;  // standstills until then
  };
  struct Pair {
    double drift = 0, standard_error = 0, friction = 0;
    std::size_t stands = 0;
  };
  void end_leg();
  void compare(const Leg& up, const Leg& down, std::size_t stands);
  void forget();
  [[nodiscard]] ConstantDrift of(std::size_t from, std::size_t to) const;
  [[nodiscard]] std::size_t change() const;
  void judge();

  double period_s_, inertia_, fade_;
  DisturbanceObserver<double> estimate_, acceleration_, speed_;
  double highest_speed_ = 0, hardest_ = 0;
  Leg leg_;
  int way_ = 0, sense_ = 0;  // of the leg: of the motion, of its acceleration along the motion
  std::size_t slack_ = 0, standing_ = 0, stands_ = 0;
  std::array<std::array<Leg, 2>, 2> last_;  // by way and sense
  std::vector<Pair> pairs_;
  std::optional<ConstantDrift> now_, stepped_;  // the last, the last step
};

}  // namespace servosense
