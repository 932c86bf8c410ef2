// Means over whole revolutions, gathered into steps of a program, and whether the spindle turned
// steadily in them.
//
// Purpose: what the torque band compares. Run-out and tooth passing average out over revolutions
// (Bertok 1984, 4.5.1). While a spindle stands, the torque that its observer reads is friction;
// while it changes speed, it is inertia: neither says anything of the cut, so such steps are told
// apart. Equation: a revolution that takes more or less than the first of its step by steady_share
// makes the step unsteady and ends it. The first step behind is an onset: a revolution in it may
// still have settled. The program moves where its steps are steady; an interruption of droop_steps
// at most that leaves the speed as it was is a droop of the spindle at a cut's entry, and is
// bridged. Discretisation: revolutions end between samples, the last sample is shared. Delay: a
// revolution. Cost, range: monitors/torque_band.hpp. Bad at: speeds that change by less than
// steady_share in a step, which count as steady.
#pragma once

#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

/// Mean over whole revolutions: run-out and tooth passing average out.
template <RealNumber Real>
class TurnMean {
 public:
  struct State {
    Real sum = 0, samples = 0, turned_rad = 0;  // of the revolution under way
    Real whole_sum = 0, whole_samples = 0;      // of complete ones
  };
  void reset() noexcept { state_ = State{}; }
  /// Forgets what take() has given; the revolution under way goes on.
  void next() noexcept { state_.whole_sum = state_.whole_samples = 0; }
  /// True with the sample that completes a revolution, of which it may belong to the next in part.
  bool add(Real value, Real increment_rad) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    s.sum += value;
    s.samples += Real(1);
    s.turned_rad += increment_rad;
    const Real turned = s.turned_rad < 0 ? -s.turned_rad : s.turned_rad;
    if (turned < kTurn) return false;
    const Real step = increment_rad < 0 ? -increment_rad : increment_rad;
    Real beyond = (turned - kTurn) / step;
    if (!(beyond < 1)) beyond = 0;  // more than a turn in a sample
    s.whole_sum += s.sum - beyond * value;
    s.whole_samples += s.samples - beyond;
    s.sum = beyond * value;
    s.samples = beyond;
    s.turned_rad = beyond * increment_rad;
    return true;
  }
  /// Samples in complete revolutions.
  [[nodiscard]] Real samples() const noexcept { return state_.whole_samples; }
  [[nodiscard]] Real mean() const noexcept { return state_.whole_sum / state_.whole_samples; }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  static constexpr Real kTurn = static_cast<Real>(kTwoPi);
  State state_;
};

/// Over path, a revolution that covers more than so many steps is rapid motion: no cut is so
/// coarse, and where in it the torque was nobody can tell.
inline constexpr double kMostSteps = 4;

/// What a step was.
enum class TurnStepKind : std::uint8_t {
  unsteady,  ///< the spindle changed its speed, or stood in it
  onset,     ///< the first steady one
  resumed,   ///< the same behind a droop: the program went on meanwhile, by `skipped`
  steady,
};

struct TurnStepsConfig {
  double step = 0;             ///< of the program, at least
  double steady_share = 0.02;  ///< by which the speed may change in a step
  double droop_steps = 5;
  double most_steps = 0;  ///< that a usable step may be long, in which a revolution is; 0 = any
  double tolerated_stand_ins = 0.25;  ///< faulty samples, part of a step
};

template <RealNumber Real>
class TurnSteps {
 public:
  using Config = TurnStepsConfig;
  struct Step {
    TurnStepKind kind = TurnStepKind::unsteady;
    bool usable = true;  ///< not too many of its samples were faulty, and not too long
    Real mean_Nm = 0;
    Real progress = 0;
    Real skipped = 0;  ///< progress since the last steady step
    Real feed_override = 1;
    Real turn_samples = 0;  ///< of its first revolution
    Real samples = 0;       ///< in all, those too in which the program stood
  };
  void configure(const Config& c) noexcept {
    step_ = static_cast<Real>(c.step);
    share_ = static_cast<Real>(c.steady_share);
    droop_ = static_cast<Real>(c.droop_steps * c.step);
    most_ = static_cast<Real>(c.most_steps * c.step);
    tolerated_ = static_cast<Real>(c.tolerated_stand_ins);
    reset();
  }
  void reset() noexcept {
    turns_.reset();
    now_ = Turn{};
    sums_ = Sums{};
    anchor_ = last_ = before_ = skipped_ = 0;
    steady_ = unsteady_ = false;
  }
  /// True with the sample that completes a step, see step().
  bool add(Real torque_Nm, Real increment_rad, Real advance,
           Real feed_override) SERVOSENSE_NONBLOCKING {
    now_.advance += advance;
    now_.feed_override += feed_override;
    now_.used += Real(1);
    return turns_.add(torque_Nm, increment_rad) && end_turn();
  }
  /// A sample that is not used.
  void leave_out(Real advance) noexcept {
    now_.advance += advance;
    now_.bad += Real(1);
  }
  [[nodiscard]] const Step& step() const noexcept { return out_; }
  /// Progress of the revolution and the step under way.
  [[nodiscard]] Real under_way() const noexcept { return now_.advance + sums_.progress; }
  /// The revolution under way lasts so long that the spindle stands, or nearly does.
  [[nodiscard]] bool stands() const noexcept {
    return turns_.state().samples > Real(2) * last_ + Real(2) && last_ > 0;
  }

 private:
  struct Turn {
    Real advance = 0, feed_override = 0, used = 0, bad = 0;
  };
  struct Sums {
    Real progress = 0, torque = 0, samples = 0, feed_override = 0, used = 0, bad = 0, turned = 0;
  };
  [[gnu::noinline]] bool end_turn() noexcept {
    const Real mean = turns_.mean(), samples = turns_.samples();
    turns_.next();
    if (!(anchor_ > 0)) anchor_ = samples;
    const Real off = samples < anchor_ ? anchor_ - samples : samples - anchor_;
    unsteady_ = unsteady_ || !(off <= share_ * anchor_) || !(last_ > 0);
    last_ = samples;
    Sums& s = sums_;
    s.progress += now_.advance;
    s.bad += now_.bad;
    s.turned += samples;
    if (now_.advance > 0) {  // else the program stood
      s.torque += mean * samples;
      s.samples += samples;
      s.feed_override += now_.feed_override;
      s.used += now_.used;
    }
    now_ = Turn{};
    if (!unsteady_ && !(s.progress >= step_ && s.samples > 0)) return false;
    close();
    return true;
  }
  void close() noexcept {
    const Sums& s = sums_;
    out_.progress = s.progress;
    out_.turn_samples = anchor_;
    out_.samples = s.turned;
    out_.usable = s.bad <= tolerated_ * (s.used + s.bad) && s.samples > 0 &&
                  !(most_ > 0 && s.progress > most_);
    out_.mean_Nm = s.samples > 0 ? s.torque / s.samples : Real(0);
    out_.feed_override = s.used > 0 ? s.feed_override / s.used : Real(1);
    out_.skipped = 0;
    if (unsteady_) {
      out_.kind = TurnStepKind::unsteady;
      if (steady_) before_ = anchor_;
      skipped_ += s.progress;
    } else if (steady_) {
      out_.kind = TurnStepKind::steady;
    } else {
      const Real off = anchor_ < before_ ? before_ - anchor_ : anchor_ - before_;
      const bool droop = skipped_ <= droop_ && off <= share_ * before_;
      out_.kind = droop ? TurnStepKind::resumed : TurnStepKind::onset;
      out_.skipped = skipped_;
      skipped_ = 0;
    }
    steady_ = !unsteady_;
    unsteady_ = false;
    anchor_ = last_;
    sums_ = Sums{};
  }

  TurnMean<Real> turns_;
  Turn now_;
  Sums sums_;
  Step out_;
  Real anchor_ = 0;  // samples of the revolution that the others are held against
  Real last_ = 0;    // of the last one
  Real before_ = 0;  // of the last steady step's
  Real skipped_ = 0;
  bool steady_ = false;    // the step before
  bool unsteady_ = false;  // this one
  Real step_ = 1;
  Real share_ = 0;
  Real droop_ = 0;
  Real most_ = 0;
  Real tolerated_ = 0;
};

}  // namespace servosense
