// What of a torque neither repeats from revolution to revolution nor changes evenly.
//
// Purpose: tells a vibration at a frequency of the tool's own (chatter) from a cut that changes:
// entry, exit, slots, corners, feed holds, speed ramps.
// Equation, on the means y_n of the torque over N equal parts of a revolution, B = N / teeth of
// them a tooth; each is a mean over the revolution [Nm^2]:
//   r_n = y_n - y_(n-N)          change since the last revolution; no forced vibration is left
//   change = <r^2> / 2
//   tooth  = <(r_n - r_(n-B))^2> / 4   of that, what changed since the last tooth
//   turn   = <(r_n - r_(n-N))^2> / 6   and since the last revolution
//   beyond change = max(tooth - change / teeth, turn - 2/5 change), change the larger of the last
//   two
//   held   = <min(r_n^2, r_(n-N)^2)> / 2   of change, what goes on at the angles where it was
//   steps: held < 0.18 change of the revolution before; from then on until change is no less
//   than the revolution before: what rings after a step dies away
//   rings: the same after what somebody says has shaken the machine
// White noise of the means gives its own variance in all three. A line of amplitude A, f off the
// nearest harmonic of the rotation and g off that of the tooth passing frequency (parts of these),
// gives change = A^2 sin^2(pi f), tooth = 2 sin^2(pi g) change, turn = 4/3 sin^2(pi f) change: it
// is heard where f > 0.185, or g > 0.17, 0.13, 0.12, 0.10, 0.09 for two to six teeth. A level that
// jumps once and stays, at any instant, gives tooth <= change / teeth in the two revolutions that
// see it, and turn > 2/5 change in the second of them alone; one that moves over a revolution or
// more gives far less. Teeth unknown: turn alone.
// While a cut is entered each tooth's part of it grows evenly, but by as much as its throw has it
// cut: tooth is up to the whole change, turn next to nothing. There (tell_entry) tooth counts for
// 2 turn at most: of a line a third off the harmonics of the rotation that is all of it.
// A tooth that breaks gives the revolution another course, once: each part of it changes in one
// revolution and is then as it was a revolution ago, so held is next to nothing. Of anything
// stationary held is 1 - 2 / pi = 0.36 of the change at least (a line a quarter off; white noise
// 0.42), and of what grows more of the change before: half of that decides. A part may step twice
// where a tooth breaks in its cut while others cut: then somebody has to say so (tell_step).
// Discretisation: straight lines from sample to sample (trapezoid rule), cut where the angle says,
// so the parts lie at the same angles at every speed. Each is 2 to 5 samples long, longer where
// that takes more than Parts. The means are a low-pass, with 2.4 samples at 8 kHz -3 dB at 1.3 kHz
// and -10 dB at 2.3 kHz: most of the noise of an encoder lies above.
// Delay: results are renewed with each revolution, valid from the third on.
// Cost on Cortex-M4F: within that of the chatter monitor (chatter.hpp).
// Range: |torque| < 1e15 Nm.
// Numerical bound: sums live for one revolution.
// Bad at: lines near a harmonic of both, and beyond the low-pass; a tooth that breaks in its cut
// while others cut, where a part may step twice.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

template <RealNumber Real, std::size_t Parts>
class RevolutionComb {
 public:
  struct State {
    std::uint32_t parts = 0;  ///< N; 0 = stopped
    std::int32_t turns = 0;   ///< complete since the start, up to 3
    Real change_Nm2 = 0;      ///< of the last revolution
    Real change_before_Nm2 = 0;
    Real tooth_Nm2 = 0;
    Real turn_Nm2 = 0;
    Real held_Nm2 = 0;       ///< of the change, what goes on at the angles where it was
    bool steps = false;      ///< from one course of the revolution to another, or rings from that
    bool rings = false;      ///< from a step or a jolt, and dies away
    bool entry = false;      ///< the cut is being entered (tell_entry)
    std::uint32_t part = 0;  // that fills
    Real integral = 0;       // of the torque, and time, where it began
    Real time = 0;
    Real change_sum = 0;
    Real tooth_sum = 0;
    Real turn_sum = 0;
    Real held_sum = 0;
    std::array<Real, Parts> mean{};    // of the last revolution
    std::array<Real, Parts> change{};  // of those against the revolution before
  };

  /// Teeth 0: unknown. What is beyond change is judged from `judged_Nm2` on; steps that cannot come
  /// near it are none: among revolutions of noise one in ten looks like one.
  void configure(std::uint32_t teeth, Real judged_Nm2) noexcept {
    judged_ = judged_Nm2;
    teeth_ = teeth > 0 && teeth <= Parts ? teeth : 1;
    one_tooth_ = Real(1) / static_cast<Real>(teeth_);
    stop();
  }
  void stop() noexcept {
    state_.parts = 0;
    state_.rings = state_.entry = false;
    edge_ = kNever;
  }
  /// So many parts, from the next begin_turn() on.
  void start(std::uint32_t parts) noexcept {
    stop();
    if (parts == 0) return;
    state_.parts = parts;
    state_.turns = -1;
    width_ = kTurn / static_cast<Real>(parts);
    scale_ = Real(0.5) / static_cast<Real>(parts);
    lag_ = parts / teeth_;
  }
  /// Whoever knows the tool says that the torque has stepped: what is compared is newer than this
  /// revolution.
  void tell_step() noexcept {
    if (running()) state_.turns = -1;
  }
  /// Parts for a revolution of so many samples: whole parts a tooth, of 2.4 samples or more. A part
  /// must not become shorter than two: with the second sample of a revolution it is begun.
  [[nodiscard]] std::uint32_t parts_for(std::uint32_t samples) const noexcept {
    const std::uint32_t fit = 5 * samples / 12;
    const std::uint32_t most = fit < Parts ? fit : Parts;
    return most - most % teeth_;
  }
  /// Whether another number of parts is due for a revolution of so many samples.
  [[nodiscard]] bool unfit(std::uint32_t samples) const noexcept {
    const std::uint32_t n = state_.parts;
    return samples < 2 * n || (samples >= 5 * n && parts_for(samples) > n);
  }

  /// Something has shaken the machine in the revolutions that are compared: after end_turn().
  void shake() noexcept { state_.rings = valid(); }
  /// Whether the torque has only risen since the first teeth touched. The course of a revolution
  /// then changes evenly, but of each tooth by as much as its throw has it cut: no difference from
  /// tooth to tooth is believed beyond twice what is uneven.
  void tell_entry(bool entry) noexcept { state_.entry = entry; }

  /// Where the present part ends, along the rotation [rad]; beyond reach when that is where the
  /// revolution ends.
  [[nodiscard]] Real edge_rad() const noexcept { return edge_; }
  /// The present part ends here. Torque counted from `shift`, its integral, and the time [samples],
  /// both since any instant of the revolution.
  void end_part(Real shift_Nm, Real integral, Real time) noexcept {
    State& s = state_;
    const Real mean = shift_Nm + (integral - s.integral) / (time - s.time);
    const Real change = mean - s.mean[s.part];
    const Real tooth = change - s.change[s.part + (s.part < lag_ ? s.parts : 0) - lag_];
    const Real before = s.change[s.part];
    const Real turn = change - before;
    s.mean[s.part] = mean;
    s.change[s.part] = change;
    const Real square = change * change;
    const Real square_before = before * before;
    s.change_sum += square;
    s.held_sum += square < square_before ? square : square_before;
    s.tooth_sum += tooth * tooth;
    s.turn_sum += turn * turn;
    s.integral = integral;
    s.time = time;
    ++s.part;
    edge_ = s.part + 1 < s.parts ? edge_ + width_ : kNever;
  }
  /// After the last end_part() of a revolution: the results.
  void end_turn() noexcept {
    State& s = state_;
    if (s.part != s.parts && s.turns >= 0) return stop();  // the angle has jumped
    s.change_before_Nm2 = s.change_Nm2;
    s.change_Nm2 = s.change_sum * scale_;
    s.held_Nm2 = s.held_sum * scale_;
    s.tooth_Nm2 = s.tooth_sum * scale_ * Real(0.5);
    s.turn_Nm2 = s.turn_sum * scale_ * Real(1.0 / 3);
    if (s.turns < 3) ++s.turns;
    s.steps = valid() && steps(s.held_Nm2, s.change_Nm2, s.change_before_Nm2, s.steps, judged_);
    s.rings = s.steps || (valid() && s.rings && s.change_Nm2 < s.change_before_Nm2);
  }
  /// Integral and time where a revolution begins.
  void begin_turn(Real integral, Real time) noexcept {
    State& s = state_;
    s.integral = integral;
    s.time = time;
    s.part = 0;
    edge_ = s.parts > 1 ? width_ : kNever;
    s.change_sum = s.tooth_sum = s.turn_sum = s.held_sum = 0;
  }

  [[nodiscard]] bool running() const noexcept { return state_.parts > 0; }
  [[nodiscard]] bool knows_teeth() const noexcept { return teeth_ > 1; }
  /// Whether the parts of the present revolution are compared with those of the last.
  [[nodiscard]] bool compares() const noexcept { return running() && state_.turns >= 0; }
  /// What the part that ended last has changed by since the revolution before [Nm], while
  /// compares().
  [[nodiscard]] Real last_change() const noexcept {
    return state_.change[state_.part > 0 ? state_.part - 1 : 0];
  }
  /// Whether change_Nm2 holds.
  [[nodiscard]] bool settled() const noexcept { return running() && state_.turns >= 2; }
  /// Whether all results hold.
  [[nodiscard]] bool valid() const noexcept { return running() && state_.turns >= 3; }
  /// Whether the torque has stepped from one course of the revolution to another, or still rings
  /// from that: its change does not go on at the angles where it was a revolution ago, and has not
  /// grown since.
  [[nodiscard]] bool steps() const noexcept { return valid() && state_.steps; }
  /// The same of other results; `stepped`: whether it had before.
  [[nodiscard]] static bool steps(Real held_Nm2, Real change_Nm2, Real change_before_Nm2,
                                  bool stepped, Real judged_Nm2) noexcept {
    const bool falls = change_Nm2 < change_before_Nm2;
    // Beyond change is twice the larger at most.
    if (Real(2) * (falls ? change_before_Nm2 : change_Nm2) < judged_Nm2) return false;
    return held_Nm2 < kHeld * change_before_Nm2 || (stepped && falls);
  }
  /// Whether it steps, or what a step or a jolt (shake) has rung is less than in the revolution
  /// before: that dies away, and chatter grows.
  [[nodiscard]] bool rings() const noexcept { return valid() && state_.rings; }
  /// Power that a change of the cut does not explain [Nm^2], steps or not; 0 while not valid.
  [[nodiscard]] Real beyond_change() const noexcept {
    if (!valid()) return Real(0);
    const State& s = state_;
    return beyond_change(s.change_Nm2, s.change_before_Nm2, s.tooth_Nm2, s.turn_Nm2);
  }
  /// The same of other results.
  [[nodiscard]] Real beyond_change(Real change_Nm2, Real change_before_Nm2, Real tooth_Nm2,
                                   Real turn_Nm2) const noexcept {
    const Real change = change_Nm2 > change_before_Nm2 ? change_Nm2 : change_before_Nm2;
    Real tooth = teeth_ > 1 ? tooth_Nm2 - one_tooth_ * change : Real(0);
    if (state_.entry && tooth > kUneven * turn_Nm2) tooth = kUneven * turn_Nm2;
    const Real turn = turn_Nm2 - Real(0.4) * change;
    const Real most = tooth > turn ? tooth : turn;
    return most > 0 ? most : Real(0);
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  static constexpr Real kTurn = static_cast<Real>(kTwoPi);
  static constexpr Real kNever = 10;         // no angle comes so far
  static constexpr Real kHeld = Real(0.18);  // least part of a change that goes on
  static constexpr Real kUneven = 2;         // of `turn`, what counts of `tooth` in an entry

  State state_;
  Real edge_ = kNever;
  Real width_ = 0;
  Real scale_ = 0;
  Real one_tooth_ = 1;  // part of a revolution
  Real judged_ = 0;     // threshold of what is beyond change
  std::uint32_t teeth_ = 1;
  std::uint32_t lag_ = 1;  // parts a tooth
};

}  // namespace servosense
