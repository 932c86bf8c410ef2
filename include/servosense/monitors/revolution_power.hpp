// The torque of the last R whole revolutions: its total power and that on the harmonics.
//
// Purpose: what the chatter monitor (chatter.hpp, with the equations) measures a cut by.
// Equation: over W samples, the last R revolutions (Koike 2016, sec. 2.3.3),
//   total  = variance of the torque
//   forced = sum over h = 1..H of 2 |M_h|^2 / W^2, M_h = sum of torque e^(-j h angle)     [Nm^2]
// Discretisation: every sample is added to the sums of the present revolution, and the window moves
// on by one revolution when that is complete. So nothing is ever subtracted, and no rounding error
// lives longer than the window. A revolution begins where the angle of the first sample comes round
// again, between two samples. Torque is counted from the mean of the revolution before.
// Delay: half the window, renewed once a revolution.
// Cost on Cortex-M4F: within that of the chatter monitor.
// Range, numerical bound: those of the chatter monitor.
// Bad at: speeds that change within a sample.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/fast_math.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/moving_fourier.hpp"

namespace servosense {

/// One sample of a revolution; what an alarm is replayed from.
template <RealNumber Real>
struct RevolutionSample {
  Real torque_Nm = 0;
  Real angle_rad = 0;  ///< from where the revolutions of the window begin, [0, 2 pi)
  Real increment_rad = 0;
};

/// Revolutions: largest R. Harmonics: largest H.
template <RealNumber Real, std::size_t Revolutions, std::size_t Harmonics>
class RevolutionPower {
 public:
  using Sample = RevolutionSample<Real>;
  static constexpr std::size_t kPairs = (Harmonics + 1) / 2;

  /// Sums over one revolution, or over the part of it that has come.
  struct Revolution {
    Real shift = 0;       // the torque counts from here
    Real sum = 0;         // of torque - shift
    Real square = 0;      // of (torque - shift)^2
    Real turned_rad = 0;  // increments of its samples
    std::uint32_t samples = 0;
    std::uint32_t stand_ins = 0;
    Real begins_after = 0;  // its beginning, as a part of the interval from `before` to `first`
    Sample before;          // last sample of the revolution before...
    Sample first;           // ...and first one of this
    SineCosine<Real> before_turn{0, 1};
    SineCosine<Real> first_turn{0, 1};
    Real load = 0;       // mean square of the torque
    Real change = 0;     // of the comb
    bool alone = false;  // there is no sample before: not part of a window
    std::array<SineCosine<Real>, 2 * kPairs> lines{};  // of torque - shift, harmonics 1, 2, ...
  };

  struct State {
    Sample last;  ///< newest sample
    SineCosine<Real> last_turn{0, 1};
    std::array<Revolution, Revolutions + 1> turns{};  ///< a ring
    std::uint32_t present = 0;  ///< the one of `turns` that fills; the window are those before it
    Real mean_Nm = 0;
    std::array<Real, 2 * kPairs> harmonic_Nm2{};
    Real samples = 0;               ///< W, with its fraction
    Real speed_rad_s = 0;           ///< mean over the window
    std::uint32_t revolutions = 0;  ///< complete ones so far, up to R
    std::uint32_t harmonics = 0;    ///< H, or fewer when the highest lie beyond half the rate
    struct {
      Real samples = 0;  // sums over the window, torque counted from the present shift
      Real sum = 0;
      Real square = 0;
      std::uint32_t stand_ins = 0;
      Real total_Nm2 = 0;
      Real forced_Nm2 = 0;
      Real scale = 0;        // 2 / W^2
      Real oldest_part = 0;  // what the two ends of the window add to its lines
      Real newest_part = 0;
      AngleMultiples<Real> oldest{{0, 1}};
      AngleMultiples<Real> newest{{0, 1}};
    } evaluation;  ///< the one under way
  };

  /// Revolutions: 1 to the capacity. Harmonics: 1 to the capacity.
  void configure(std::uint32_t revolutions, std::uint32_t harmonics,
                 double sample_period_s) noexcept {
    window_ = revolutions;
    harmonics_ = harmonics;
    pairs_ = (harmonics + 1) / 2;
    turn_rate_ = static_cast<Real>(revolutions * kTwoPi / sample_period_s);
    reset();
  }
  void reset() noexcept { state_ = State{}; }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  /// The revolution that fills.
  [[nodiscard]] Revolution& present() noexcept { return state_.turns[state_.present]; }
  [[nodiscard]] const Revolution& present() const noexcept { return state_.turns[state_.present]; }
  /// The last complete revolution (1), the one before (2)... up to R.
  [[nodiscard]] Revolution& before(std::uint32_t turns) noexcept { return state_.turns[at(turns)]; }
  [[nodiscard]] const Revolution& before(std::uint32_t turns) const noexcept {
    return state_.turns[at(turns)];
  }
  [[nodiscard]] const Revolution& oldest() const noexcept { return before(window_); }
  [[nodiscard]] bool empty() const noexcept { return present().samples == 0; }
  [[nodiscard]] bool full() const noexcept { return state_.revolutions >= window_; }

  /// Forgets the samples, keeps the last results.
  void empty_out() noexcept {
    present().samples = 0;
    state_.revolutions = 0;
  }
  /// The sample before the one that a revolution is opened with.
  void set_last(const Sample& in) noexcept { set_last(in, sine_cosine(in.angle_rad)); }

  /// The first revolution of all only teaches the mean. Its first sample lies on the boundary
  /// itself.
  void begin(const Sample& in) noexcept {
    state_.last = in;
    open(in, Real(1), in.torque_Nm);
    present().alone = true;
  }
  /// Starts the present revolution with `in`; torque counts from `shift`.
  void open(const Sample& in, Real boundary, Real shift) noexcept {
    State& s = state_;
    Revolution& r = s.turns[s.present];
    const auto turn = sine_cosine(in.angle_rad);
    const Real torque = in.torque_Nm - shift;
    r.shift = shift;
    r.sum = torque;
    r.square = torque * torque;
    r.turned_rad = in.increment_rad;
    r.samples = 1;
    r.stand_ins = 0;
    r.begins_after = boundary;
    r.before = s.last;
    r.before_turn = s.last_turn;
    r.first = in;
    r.first_turn = turn;
    r.alone = false;
    each_line(turn, [&](std::size_t i, const SineCosine<Real>& line) {
      r.lines[i].cosine = torque * line.cosine;
      r.lines[i].sine = torque * line.sine;
    });
    set_last(in, turn);
  }

  void add(const Sample& in) noexcept {
    Revolution& r = present();
    const auto turn = sine_cosine(in.angle_rad);
    const Real torque = in.torque_Nm - r.shift;
    r.sum += torque;
    r.square += torque * torque;
    r.turned_rad += in.increment_rad;
    ++r.samples;
    each_line(turn, [&](std::size_t i, const SineCosine<Real>& line) {
      r.lines[i].cosine += torque * line.cosine;
      r.lines[i].sine += torque * line.sine;
    });
    set_last(in, turn);
  }

  /// `in` lies beyond the boundary: ends the present revolution and opens the next.
  void pass_boundary(const Sample& in) noexcept {
    State& s = state_;
    const Revolution& r = present();
    // The mean of the whole revolution, so that a steady cut is always counted from the same
    // torque.
    const Real boundary = boundary_before(in);
    const Ends e = ends(r, boundary);
    const Real mean = (r.sum + e.newest_weight * (s.last.torque_Nm - r.shift) +
                       e.oldest_weight * (e.oldest_Nm - r.shift)) /
                      (static_cast<Real>(r.samples) + e.longer);
    const bool first_of_all = r.alone;
    s.present = s.present == Revolutions ? 0 : s.present + 1;
    open(in, boundary, r.shift + mean);
    if (s.revolutions < window_ && !first_of_all) ++s.revolutions;
  }

  /// Where the boundary lies between the last sample and `in`: 0 at the last one, 1 at `in`.
  [[nodiscard]] Real boundary_before(const Sample& in) const noexcept {
    const Real beyond = in.angle_rad < kTurn / 2 ? in.angle_rad : kTurn - in.angle_rad;
    const Real part = Real(1) - beyond / magnitude(in.increment_rad);
    return part > 0 ? part : Real(0);  // 0 also when the increment is zero
  }

  /// Calls `look` with the revolutions of the window, oldest first.
  template <typename Look>
  void for_window(Look&& look) const noexcept {
    const State& s = state_;
    std::size_t at = s.present + (s.present < window_ ? Revolutions + 1 : 0) - window_;
    for (std::uint32_t i = 0; i < window_; ++i) {
      look(s.turns[at]);
      if (++at == Revolutions + 1) at = 0;
    }
  }

  // The evaluation, a stage a call: sums, then length and total power, then line by line up to
  // state().harmonics.
  void evaluate_sums() noexcept {
    State& s = state_;
    const Real shift = s.turns[s.present].shift;
    Real samples = 0;
    Real sum = 0;
    Real square = 0;
    std::uint32_t stand_ins = 0;
    for_window([&](const Revolution& r) {
      const auto n = static_cast<Real>(r.samples);
      const Real apart = r.shift - shift;
      const Real moved = n * apart;
      sum += r.sum + moved;
      square += r.square + apart * (r.sum + r.sum + moved);
      stand_ins += r.stand_ins;
      samples += n;
    });
    auto& e = s.evaluation;
    e.samples = samples;
    e.sum = sum;
    e.square = square;
    e.stand_ins = stand_ins;
  }

  void evaluate_total() noexcept {
    State& s = state_;
    const Revolution& end = s.turns[s.present];
    const Revolution* first_turn = &oldest();
    const Real shift = end.shift;
    const Ends ends_of_window = ends(*first_turn, end.begins_after);
    const Real newest = end.before.torque_Nm - shift;
    const Real first = ends_of_window.oldest_Nm - shift;
    auto& e = s.evaluation;
    e.newest_part = ends_of_window.newest_weight * newest;
    e.oldest_part = ends_of_window.oldest_weight * first;
    e.newest = AngleMultiples<Real>(end.before_turn);
    e.oldest = AngleMultiples<Real>(ends_of_window.before_first ? first_turn->before_turn
                                                                : first_turn->first_turn);
    const Real sum = e.sum + e.newest_part + e.oldest_part;
    const Real square = e.square + e.newest_part * newest + e.oldest_part * first;

    s.samples = e.samples + ends_of_window.longer;
    const Real inverse = Real(1) / s.samples;
    const Real mean = sum * inverse;
    const Real total = square * inverse - mean * mean;
    e.total_Nm2 = total > 0 ? total : Real(0);
    e.forced_Nm2 = 0;
    e.scale = Real(2) * inverse * inverse;
    s.mean_Nm = shift + mean;
    s.speed_rad_s = turn_rate_ * inverse;
    // h R turns in W samples stay below half a turn a sample.
    const Real below = s.samples / static_cast<Real>(2 * window_);
    s.harmonics = harmonics_;
    while (static_cast<Real>(s.harmonics) >= below) s.harmonic_Nm2[--s.harmonics] = 0;
  }

  void evaluate_line(std::uint32_t line) noexcept {
    State& s = state_;
    auto& e = s.evaluation;
    const bool odd = line % 2 == 0;  // counted from 0, the harmonic is line + 1
    const SineCosine<Real> newest = odd ? e.newest.odd : e.newest.even;
    const SineCosine<Real> oldest = odd ? e.oldest.odd : e.oldest.even;
    Real c = e.newest_part * newest.cosine + e.oldest_part * oldest.cosine;
    Real q = e.newest_part * newest.sine + e.oldest_part * oldest.sine;
    for_window([&](const Revolution& r) {
      c += r.lines[line].cosine;
      q += r.lines[line].sine;
    });
    const Real power = e.scale * (c * c + q * q);
    s.harmonic_Nm2[line] = power;
    e.forced_Nm2 += power;
    if (odd) {
      e.newest.next_even();
      e.oldest.next_even();
    } else {
      e.newest.next_odd();
      e.oldest.next_odd();
    }
  }

 private:
  static constexpr Real kTurn = static_cast<Real>(kTwoPi);

  static Real magnitude(Real x) noexcept { return x < 0 ? -x : x; }
  [[nodiscard]] std::size_t at(std::uint32_t turns) const noexcept {
    const std::size_t present = state_.present;
    return present + (present < turns ? Revolutions + 1 : 0) - turns;
  }
  void set_last(const Sample& in, const SineCosine<Real>& turn) noexcept {
    state_.last = in;
    state_.last_turn = turn;
  }

  // Calls `take` with sine and cosine of h angle for h = i + 1.
  template <typename Take>
  void each_line(const SineCosine<Real>& turn, Take&& take) noexcept {
    AngleMultiples<Real> multiples(turn);
    for (std::size_t i = 0; i < std::size_t{2} * pairs_; i += 2) {
      take(i, multiples.odd);
      multiples.next_even();
      take(i + 1, multiples.even);
      multiples.next_odd();
    }
  }

  // What the ends of a stretch of n samples that is W = n + `longer` samples long add to its sums.
  // The trapezoid rule, closed over whole revolutions, gives both end samples the same weight:
  // 1 + longer / 2 to the first and last of the n when that is at most 1, else (1 + longer) / 2 to
  // the last and to the one before the first.
  struct Ends {
    Real longer;
    Real newest_weight;  // beyond the one it has
    Real oldest_weight;
    Real oldest_Nm;
    bool before_first;
  };
  static Ends ends(const Revolution& oldest, Real ends_after) noexcept {
    const Real longer = ends_after - oldest.begins_after;
    const bool before = longer > 0;
    return {longer, Real(0.5) * (before ? longer - Real(1) : longer),
            Real(0.5) * (before ? longer + Real(1) : longer),
            before ? oldest.before.torque_Nm : oldest.first.torque_Nm, before};
  }

  State state_;
  std::uint32_t window_ = 1;
  std::uint32_t harmonics_ = 1;
  std::uint32_t pairs_ = 1;  // of harmonics
  Real turn_rate_ = 0;       // speed * W
};

}  // namespace servosense
