// How many teeth cut: the torque over the angle of a revolution.
//
// Purpose: tells a cutter with another number of teeth, whose mean torque is nearly the same (of M
// = N/2pi (Kt f V + Kte S) the first term does not change, a revolution removes what it did).
// Equation: N teeth with loads l_j, j of N, and a pulse of the torque p(phi) each, make lines
//   a_k = P_k L_k,  P_k = 1/2pi int p(phi) exp(-i k phi) dphi,  L_k = sum l_j exp(-2 pi i j k/N)
// at k times the spindle's speed. |L_k| <= L_0, and L_N = L_0 whatever the loads: run-out adds
// lines, and takes none from tooth passing. So |a_N| = |P_N/P_0| a_0 of a cutter with N teeth, and
// less of any number that is no multiple of it. P_k follows from the engagement
// (monitors/tooth_lines.hpp). A line is there from `there` of that on, and missing up to `missing`
// of it. What cuts are as many teeth as the lowest line that is there with all its multiples, and
// of whose divisors none is there or half there; it is told where the line of the program's tool
// could be seen, and another number than its own where that line is missing or where the number
// divides it: then every so many teeth do not cut.
// Discretisation: means over 48 parts of a revolution; their part in a line is in P_k.
// Delay: `turns` revolutions of one engagement, and a sample a line.
// Cost on Cortex-M4F: in that of torque_band.
// Range: each of 48 parts of a revolution must have been met: a spindle that turns by a whole part
// of a revolution a sample is not counted.
// Numerical bound: sums over one engagement; the angle is exact to rounding of the increments.
// Bad at: slots, where many lines vanish; teeth of which every so many hardly cut; fast spindles,
// whose lines the observer takes away.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/core/units.hpp"
#include "servosense/monitors/tooth_lines.hpp"

namespace servosense {

struct ToothCountConfig {
  unsigned teeth = 0;     ///< of the program's tool; 0: not known
  double turns = 20;      ///< revolutions of an engagement
  double there = 0.65;    ///< part of a line's expected amplitude (chosen: pulses of another shape)
  double missing = 0.35;  ///< the same
  double noise = 6;       ///< standard errors that an expected line must have to be looked for
};

template <RealNumber Real>
class ToothCount {
 public:
  static constexpr std::size_t kParts = 48;
  using Lines = ToothLines<Real>;

  void configure(const ToothCountConfig& c) noexcept {
    teeth_ = c.teeth;
    turns_ = static_cast<Real>(c.turns);
    there_ = static_cast<Real>(c.there * c.there);
    missing_ = static_cast<Real>(c.missing * c.missing);
    noise_ = static_cast<Real>(c.noise * c.noise);
    for (std::size_t i = 0; i < kParts; ++i)
      cosine_[i] = static_cast<Real>(std::cos(kTwoPi * static_cast<double>(i) / double{kParts}));
    begin(nullptr);
  }
  /// An engagement begins; nullptr: none, or none that is known. What it points at must stay.
  void begin(const Lines* lines) noexcept {
    lines_ = lines;
    sum_.fill(0);
    count_.fill(0);
    squares_ = turned_ = place_ = 0;
    line_ = kToothLines;
    told_ = 0;
  }
  [[nodiscard]] const Lines* lines() const noexcept { return lines_; }
  /// A sample of the cut.
  void add(Real torque_Nm, Real increment_rad) SERVOSENSE_NONBLOCKING {
    if (line_ < kToothLines) weigh();
    if (lines_ == nullptr) return;
    constexpr Real kPerRad = Real(double{kParts} / kTwoPi);
    place_ += increment_rad * kPerRad;
    turned_ += increment_rad < 0 ? -increment_rad : increment_rad;
    while (place_ >= Real(kParts)) place_ -= Real(kParts);
    while (place_ < 0) place_ += Real(kParts);
    auto part = static_cast<std::size_t>(place_);
    if (part >= kParts) part = kParts - 1;
    sum_[part] += torque_Nm;
    count_[part] += Real(1);
    squares_ += torque_Nm * torque_Nm;
  }
  /// What has been heard may be judged: the engagement has not ended.
  void judge() noexcept {
    if (lines_ == nullptr || line_ < kToothLines) return;
    if (turned_ < turns_ * Real(kTwoPi)) return;
    line_ = 0;
  }
  /// Teeth that cut in this engagement; 0: not told.
  [[nodiscard]] unsigned told() const noexcept { return told_; }
  /// Whether that is another number than that of the program's tool.
  [[nodiscard]] bool other() const noexcept { return told_ != 0 && told_ != teeth_; }

 private:
  enum class Line : std::uint8_t { unseen, missing, weak, there };

  /// A line a sample; with the first of them what they are held against, with the last the verdict.
  [[gnu::noinline]] void weigh() noexcept {
    if (line_ == 0 && !level()) {
      line_ = kToothLines;
      return;
    }
    const std::size_t k = line_ + 1;
    Real re = 0, im = 0;
    for (std::size_t i = 0, at = 0; i < kParts; ++i) {
      const Real mean = sum_[i] / count_[i];
      re += mean * cosine_[at];
      im += mean * cosine_[(at + kParts / 4) % kParts];
      at = (at + k) % kParts;
    }
    constexpr Real kEach = Real(1) / (Real(kParts) * Real(kParts));
    const Real share = lines_->share[line_];
    const Real expected = share * share * mean_ * mean_;
    const Real found = (re * re + im * im) * kEach;
    found_[line_] = !(expected > noise_ * error_)  ? Line::unseen
                    : found >= there_ * expected   ? Line::there
                    : found <= missing_ * expected ? Line::missing
                                                   : Line::weak;
    if (++line_ == kToothLines) told_ = verdict();
  }
  /// Mean, and the variance of a line by what does not repeat with the revolution.
  bool level() noexcept {
    Real means = 0, repeats = 0, samples = 0;
    for (std::size_t i = 0; i < kParts; ++i) {
      if (!(count_[i] > 0)) return false;
      means += sum_[i] / count_[i];
      repeats += sum_[i] * sum_[i] / count_[i];
      samples += count_[i];
    }
    mean_ = means / Real(kParts);
    const Real rest = squares_ - repeats;
    error_ = rest > 0 ? rest / (samples * samples) : Real(0);
    return true;
  }
  [[nodiscard]] unsigned verdict() const noexcept {
    if (teeth_ < 1 || teeth_ > kToothLines) return 0;
    const Line own = found_[teeth_ - 1];
    if (own == Line::unseen || own == Line::weak) return 0;
    for (std::size_t n = 1; n <= kToothLines; ++n) {
      if (found_[n - 1] != Line::there) continue;
      // A cutter of fewer teeth has their multiples too: its own line must be missing.
      bool all = true;
      for (std::size_t k = 1; 2 * k <= n; ++k)
        all = all && (n % k != 0 || found_[k - 1] == Line::missing);
      for (std::size_t k = 2 * n; k <= kToothLines; k += n)
        all = all && (found_[k - 1] == Line::there || found_[k - 1] == Line::unseen);
      if (!all) continue;
      const auto teeth = static_cast<unsigned>(n);
      const bool possible = own == Line::missing ? teeth_ % teeth != 0 : teeth_ % teeth == 0;
      return possible ? teeth : 0;
    }
    return 0;
  }

  unsigned teeth_ = 0;
  Real turns_ = 0, there_ = 0, missing_ = 0, noise_ = 0;
  std::array<Real, kParts> cosine_{};
  const Lines* lines_ = nullptr;
  std::array<Real, kParts> sum_{}, count_{};
  Real squares_ = 0, turned_ = 0, place_ = 0;
  std::size_t line_ = kToothLines;
  Real mean_ = 0, error_ = 0;
  std::array<Line, kToothLines> found_{};
  unsigned told_ = 0;
};

}  // namespace servosense
