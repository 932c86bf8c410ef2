// Sampling by angle: the mean of a signal over each 1/N of a turn of the spindle.
//
// Purpose: turns samples in time into N samples a revolution that lie at the same angles whatever
// the speed: one a tooth (tooth-period average, Tarng 1988, sec. 4.2), one a revolution, or several
// a tooth (Bertok 1984 lets time sampling approximate them: 12 a revolution for six teeth).
//   mean = N / (2 pi) * integral of x d(angle) from one edge to the next
// Edges lie at origin + k 2 pi / N. Averages over angle: at constant speed the same as over time.
// Discretisation: the signal runs straight from sample to sample, and an edge cuts that line where
// the angle says (trapezoid rule, exact for straight lines). Nothing is lost or counted twice
// at an edge, so the N means of a revolution have the mean of the revolution. Counted from
// the value at the edge, so a constant comes out as itself to the last bit.
// Both directions of rotation. An angle that trembles does no harm: way back counts negative, and a
// part of the turn is complete only when left at the edge opposite to where it was entered.
// Faults: a bad sample is left out and the line drawn past it (`left_out` counts); a jump by more
// than a part or an eighth of a turn, a gap and a restart begin anew at the next edge.
// Delay: half a part of a turn (the mean of a ramp is that of its middle), and up to one sample.
// Cost: about 35 instructions a signal on Cortex-M4F, 80 at an edge; no loop over parts or samples.
// Range: N up to 1000; one part of a turn must take at least a sample. |x| < 1e18.
// Numerical bound: sums live for one part only; nothing drifts. Error of a mean in float: 2e-7 N of
// the signal's excursion within it, and rounding.
// Bad at: lines above N/2 a revolution are damped by sinc(line / N) and then fold down.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/fast_math.hpp"
#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

struct AngleSamplerConfig {
  unsigned samples_per_turn = 12;  ///< N, 1..1000: teeth for tooth periods, 1 for revolutions
  double origin_rad = 0;           ///< where part 0 begins, 0..2 pi
};

/// Signals: how many are averaged over the same parts (say fx and fy).
template <RealNumber Real, std::size_t Signals = 1>
class AngleSampler {
  static_assert(Signals >= 1);

 public:
  using Config = AngleSamplerConfig;
  using Values = std::array<Real, Signals>;
  static constexpr unsigned kMostSamples = 1000;

  /// What the sampler says of the part of the turn completed last.
  struct Part {
    Values mean{};
    std::uint32_t index = 0;     ///< 0..N-1, counted along the angle
    std::int32_t direction = 1;  ///< of the rotation, +1 or -1
    std::uint32_t in_a_row = 0;  ///< parts that followed each other without a break, this included
    std::uint32_t samples = 0;   ///< good samples it was made of
    std::uint32_t left_out = 0;  ///< bad ones
  };
  struct State {
    Part part;                   ///< completed last
    bool running = false;        ///< there is a sample to draw the line from
    std::uint32_t samples = 0;   ///< good ones since the last edge; stops at 2^32 - 1
    std::uint32_t left_out = 0;  ///< bad ones since the last edge
    std::uint32_t restarts = 0;  ///< begun anew because of a jump, a gap or a restart
    Real position = 0;           ///< newest, in parts of a turn from the origin, [0, N)
    std::uint32_t index = 0;     ///< part that fills
    Real edge = 0;               ///< its lower edge, in parts of a turn
    std::int32_t entered = 0;    ///< at its lower edge: +1, at its upper: -1, somewhere within: 0
    std::uint32_t in_a_row = 0;
    Values last{};      ///< newest sample
    Values shift{};     ///< the sum counts from here
    Values integral{};  ///< of x - shift over the part so far
  };

  static Status validate(const Config& c) noexcept {
    if (c.samples_per_turn < 1 || c.samples_per_turn > kMostSamples)
      return Status::invalid("samples_per_turn", "must be within 1 and 1000");
    if (!(c.origin_rad >= 0 && c.origin_rad <= kTwoPi))
      return Status::invalid("origin_rad", "must be within 0 and 2 pi");
    return {};
  }
  void configure(const Config& c) noexcept {
    parts_ = c.samples_per_turn;
    n_ = static_cast<Real>(c.samples_per_turn);
    scale_ = static_cast<Real>(c.samples_per_turn / kTwoPi);
    origin_ = static_cast<Real>(c.origin_rad);
    // At most one edge a sample, and no doubt about the direction.
    longest_ = parts_ > 8 ? Real(1) : n_ / 8;
    reset();
  }
  void reset() noexcept { state_ = State{}; }

  /// One sample of the signals and the spindle angle [0, 2 pi] it belongs to. True when it has
  /// completed a part of the turn: state().part.
  bool process(const Values& x, Real turn_angle_rad, Quality quality) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    // Almost every sample: sound, and within the part under way. The full path gives the same.
    if (s.running && !has(quality, kBreaks | kUnusable) && turn_angle_rad <= kTurn &&
        are_moderate(x)) {
      const Real position = (turn_angle_rad - origin_) * scale_;
      const Real turned = position - s.position;
      if (is_fraction(position - s.edge) && std::abs(turned) <= longest_) {
        add(x, turned);
        s.position = position;
        count(s.samples);
        return false;
      }
    }
    return process_in_full(x, turn_angle_rad, quality);
  }
  bool process(Real x, Real turn_angle_rad, Quality quality) SERVOSENSE_NONBLOCKING
      requires(Signals == 1) {
    return process(Values{x}, turn_angle_rad, quality);
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  [[nodiscard]] unsigned samples_per_turn() const noexcept { return parts_; }

 private:
  static constexpr Real kTurn = static_cast<Real>(kTwoPi);
  static constexpr Quality kBreaks = Quality::restarted | Quality::gap | Quality::settling;

  static bool are_moderate(const Values& x) noexcept {
    Real squares = 0;
    for (const Real value : x) squares += value * value;
    return is_finite(squares);
  }

  [[gnu::noinline]] bool process_in_full(const Values& x, Real turn_angle_rad,
                                         Quality quality) noexcept {
    State& s = state_;
    if (has(quality, kBreaks)) {
      begin_anew();
      if (has(quality, Quality::gap | Quality::settling)) return false;
    }
    if (has(quality, kUnusable) || !(turn_angle_rad >= 0 && turn_angle_rad <= kTurn) ||
        !are_moderate(x)) {
      if (s.running) count(s.left_out);
      return false;
    }
    Real position = (turn_angle_rad - origin_) * scale_;
    if (position < 0) position += n_;
    if (position >= n_) position -= n_;
    if (!s.running) return start(x, position);
    return advance(x, position);
  }

  static void count(std::uint32_t& n) noexcept { n += n != 0xffffffffU; }

  void begin_anew() noexcept {
    State& s = state_;
    if (s.running) count(s.restarts);
    s.running = false;
    s.in_a_row = 0;
  }

  // The part the first sample lies in is never complete.
  bool start(const Values& x, Real position) noexcept {
    State& s = state_;
    s.running = true;
    s.position = position;
    s.index = part_of(position);
    s.edge = static_cast<Real>(s.index);
    s.entered = 0;
    s.in_a_row = 0;
    s.last = s.shift = x;
    s.integral = Values{};
    s.samples = 1;
    s.left_out = 0;
    return false;
  }

  // The remainder of a division in float may come out as N itself.
  [[nodiscard]] std::uint32_t part_of(Real position) const noexcept {
    const auto index = static_cast<std::uint32_t>(position);
    return index < parts_ ? index : parts_ - 1;
  }

  bool advance(const Values& x, Real position) noexcept {
    State& s = state_;
    Real turned = position - s.position;
    const bool around = turned > n_ / 2 || turned < -n_ / 2;
    if (around) turned += turned > 0 ? -n_ : n_;
    const Real way = turned < 0 ? -turned : turned;
    if (!(way <= longest_)) {
      begin_anew();
      return start(x, position);
    }
    const std::uint32_t index = part_of(position);
    if (index != s.index || around) return pass_edge(x, position, index, turned, way);
    add(x, turned);
    s.position = position;
    count(s.samples);
    return false;
  }

  // Trapezoid from the newest sample to `x`.
  void add(const Values& x, Real turned) noexcept {
    State& s = state_;
    const Real half = Real(0.5) * turned;
    for (std::size_t i = 0; i < Signals; ++i) {
      s.integral[i] += half * ((s.last[i] - s.shift[i]) + (x[i] - s.shift[i]));
      s.last[i] = x[i];
    }
  }

  [[gnu::noinline]] bool pass_edge(const Values& x, Real position, std::uint32_t index, Real turned,
                                   Real way) noexcept {
    State& s = state_;
    const bool onward = turned > 0;
    const std::int32_t direction = onward ? 1 : -1;
    const Real within = s.position - s.edge;
    const Real to_edge = onward ? Real(1) - within : within;
    const Real part = to_edge < way ? to_edge / way : Real(1);  // of this step, before the edge
    Values edge;
    for (std::size_t i = 0; i < Signals; ++i) edge[i] = s.last[i] + part * (x[i] - s.last[i]);
    add(edge, onward ? to_edge : -to_edge);

    const bool complete = s.entered == direction;
    if (complete) {
      for (std::size_t i = 0; i < Signals; ++i)
        s.part.mean[i] = s.shift[i] + (onward ? s.integral[i] : -s.integral[i]);
      if (direction != s.part.direction) s.in_a_row = 0;
      count(s.in_a_row);
      s.part.index = s.index;
      s.part.direction = direction;
      s.part.in_a_row = s.in_a_row;
      s.part.samples = s.samples;
      s.part.left_out = s.left_out;
    }
    s.index = index;
    s.edge = static_cast<Real>(index);
    s.position = position;
    s.entered = direction;
    s.shift = s.last = edge;
    s.integral = Values{};
    s.samples = 1;
    s.left_out = 0;
    add(x, turned - (onward ? to_edge : -to_edge));
    return complete;
  }

  State state_;
  Real scale_ = 0;
  Real n_ = 0;
  Real origin_ = 0;
  Real longest_ = 0;
  std::uint32_t parts_ = 1;
};

}  // namespace servosense
