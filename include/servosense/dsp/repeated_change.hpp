// Has the pattern of a revolution changed for good? Torque of each tooth over four revolutions.
//
// Purpose: tells a tooth that has lost part of its edge from everything else that upsets the torque
// for a while: entry, exit, slots, holes, a change of feed, a single blow. A broken tooth takes
// less in each revolution from then on and its successor more, while the mean hardly moves (Bertok
// 1984, 3.5); the others do not repeat.
//   y(t)  torque of tooth t; level(t) = its mean over the revolution centred on t (half weight at
//         the ends of an even number of teeth); r = y - level, blind to any straight rise or fall
//   over the teeth of the newest whole revolution C, those before it B, A and Z:
//   D0 = r_A - r_Z,  D1 = r_B - r_A,  D2 = r_C - r_A
//   repeated = sum D1 D2
//   repetition = repeated / (sum (D2 - D1)^2 + sum D0^2 + m noise^2)
//   share = sqrt(repeated / 2) / greatest level
//   steadiness = least level / greatest level
//   explained = (1 - steadiness) sqrt(max(sum r_A^2, sum r_C^2) / 2) / greatest level
// A tooth that loses L gives D1 = D2 = (-L, +L, 0, ...), so share is L / level, and repetition
// grows without bound as noise falls. White noise gives 1/5. A pattern that grows in proportion to
// time has D1 = D0 and D2 = 2 D1: repetition 1. Run-out makes a pattern that grows and shrinks with
// the cut; `explained` is the share that comes from that.
//
// Delay: two revolutions for the change itself and half of one for the level, 2.5 m teeth.
// Cost on Cortex-M4F: a tooth 80 instructions, its comparison 251 with three teeth.
// Range: m = 2 up to the capacity; |y| < 1e15.
// Numerical bound: levels and sums are formed anew for each tooth; nothing drifts.
// Bad at: one tooth (no successor); breakage while nothing is cut or in the last three revolutions;
// wide cuts with many teeth, where several overlap and each loss is smeared over all of them.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"

namespace servosense {

struct RepeatedChangeConfig {
  unsigned teeth = 4;      ///< m, 2 up to the capacity
  double noise_Nm = 0.01;  ///< standard deviation of a tooth's torque when nothing is cut
};

template <RealNumber Real, std::size_t MaxTeeth>
class RepeatedChange {
  static_assert(MaxTeeth >= 2);

 public:
  using Config = RepeatedChangeConfig;
  static constexpr std::size_t kTeeth = 4 * MaxTeeth;
  struct State {
    bool full = false;  ///< four revolutions and the half behind them are there
    Real repetition = 0;
    Real share = 0;
    Real steadiness = 0;
    Real explained = 0;       ///< share that the change of the level alone may account for
    Real level_Nm = 0;        ///< greatest of the four revolutions
    std::uint32_t teeth = 0;  ///< come so far, stops when full
    std::uint32_t next_torque = 0;
    std::uint32_t next = 0;
    std::array<Real, MaxTeeth + 1> torque_Nm{};  // ring of the last m + 1
    std::array<Real, kTeeth> deviation_Nm{};     // r, ring of the last 4 m
    std::array<Real, kTeeth> levels_Nm{};        // likewise
  };

  static Status validate(const Config& c) noexcept {
    if (c.teeth < 2 || c.teeth > MaxTeeth)
      return Status::invalid("teeth", "must be within 2 and the block's capacity");
    if (!(c.noise_Nm > 0 && c.noise_Nm < 1e15))
      return Status::invalid("noise_Nm", "must be positive");
    return {};
  }
  void configure(const Config& c) noexcept {
    m_ = c.teeth;
    // Odd m: the mean of m teeth; even m: m + 1 teeth, half weight at both ends.
    span_ = m_ % 2 == 0 ? m_ + 1 : m_;
    inverse_ = Real(1) / static_cast<Real>(m_);
    noise_ = static_cast<Real>(c.noise_Nm * c.noise_Nm * c.teeth);
    reset();
  }
  /// The rings need not be cleared: nothing of them is read before it is written.
  void reset() noexcept {
    State& s = state_;
    s.full = false;
    s.repetition = s.share = s.steadiness = s.explained = s.level_Nm = 0;
    s.teeth = s.next_torque = s.next = 0;
  }

  /// Mean torque over one more tooth period, a moderate number. True when the figures are there.
  bool process(Real torque_Nm) SERVOSENSE_NONBLOCKING {
    if (!add(torque_Nm)) return false;
    compare();
    return true;
  }
  /// process() in two halves, for those who have several samples for it: takes a tooth; true when
  /// the teeth suffice...
  bool add(Real torque_Nm) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    s.torque_Nm[s.next_torque] = torque_Nm;
    s.next_torque = s.next_torque + 1 == span_ ? 0 : s.next_torque + 1;
    const std::uint32_t needed = span_ - 1 + 4 * m_;
    if (s.teeth < needed) ++s.teeth;
    if (s.teeth < span_) return false;

    Real sum = 0;
    for (std::uint32_t i = 0; i < span_; ++i) sum += s.torque_Nm[i];
    const Real oldest = s.torque_Nm[s.next_torque];
    if (span_ > m_) sum -= Real(0.5) * (oldest + torque_Nm);
    const Real level = sum * inverse_;
    s.levels_Nm[s.next] = level;
    s.deviation_Nm[s.next] = s.torque_Nm[wrap(s.next_torque + span_ / 2, span_)] - level;
    s.next = s.next + 1 == 4 * m_ ? 0 : s.next + 1;
    return s.full = s.teeth == needed;
  }
  /// ...and forms the figures, then.
  void compare() SERVOSENSE_NONBLOCKING {
    State& s = state_;
    Real repeated = 0;
    Real apart = noise_;
    Real pattern_a = 0;
    Real pattern_c = 0;
    std::array<Real, 4> level{};
    std::uint32_t z = s.next;
    for (std::uint32_t i = 0; i < m_; ++i) {
      const std::uint32_t a = wrap(z + m_, 4 * m_);
      const std::uint32_t b = wrap(a + m_, 4 * m_);
      const std::uint32_t c = wrap(b + m_, 4 * m_);
      const Real d0 = s.deviation_Nm[a] - s.deviation_Nm[z];
      const Real d1 = s.deviation_Nm[b] - s.deviation_Nm[a];
      const Real d2 = s.deviation_Nm[c] - s.deviation_Nm[a];
      repeated += d1 * d2;
      apart += (d2 - d1) * (d2 - d1) + d0 * d0;
      pattern_a += s.deviation_Nm[a] * s.deviation_Nm[a];
      pattern_c += s.deviation_Nm[c] * s.deviation_Nm[c];
      level[0] += s.levels_Nm[z];
      level[1] += s.levels_Nm[a];
      level[2] += s.levels_Nm[b];
      level[3] += s.levels_Nm[c];
      z = wrap(z + 1, 4 * m_);
    }
    Real least = level[0];
    Real greatest = level[0];
    for (const Real l : level) {
      if (l < least) least = l;
      if (l > greatest) greatest = l;
    }
    s.level_Nm = greatest * inverse_;
    s.repetition = repeated / apart;
    const bool cutting = greatest > 0;
    s.steadiness = cutting && least > 0 ? least / greatest : Real(0);
    s.share = cutting && repeated > 0 ? std::sqrt(Real(0.5) * repeated) / s.level_Nm : Real(0);
    const Real pattern = pattern_a > pattern_c ? pattern_a : pattern_c;
    s.explained =
        cutting ? (Real(1) - s.steadiness) * std::sqrt(Real(0.5) * pattern) / s.level_Nm : Real(0);
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }
  /// Teeth between the newest torque and the newest one judged.
  [[nodiscard]] unsigned lag() const noexcept { return span_ / 2; }
  [[nodiscard]] unsigned teeth() const noexcept { return m_; }

 private:
  static std::uint32_t wrap(std::uint32_t i, std::uint32_t n) noexcept { return i < n ? i : i - n; }

  State state_;
  std::uint32_t m_ = 2;
  std::uint32_t span_ = 3;
  Real inverse_ = 1;
  Real noise_ = 0;
};

}  // namespace servosense
