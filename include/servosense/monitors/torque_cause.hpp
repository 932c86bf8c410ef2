// Why a torque is not what the program asks for, as far as the cuts of a run tell.
//
// Purpose: a wrong tool, another stock, a worn tool and a fault in one place, told from each other.
// Each moves the torque along the program in its own way: what wears and what is harder, every cut
// by one share; a wider tool, slots by much and side cuts, whose width the program says, by little;
// a higher stock, shallow cuts more than deep ones; what is in one place, that cut alone. The last
// but one of these courses are the program cut again (TorqueBandChange).
// Equation: of cut i let e_i be what is expected, d_i what is measured beyond that, both means, and
// c_i a course. An explanation leaves
//   chi2 = min over s, a of sum (d_i - s e_i - a c_i)^2 / v_i + s^2 / kCommon^2
//   v_i = (kSpread e_i)^2 + (kRough d_i)^2 + floor^2
// where s is what material and edge of a sound run have in common; one share for all has s free and
// no a, a fault in place leaves out the cut that it is in. Explanations are named whose chi2 is not
// more than kMargin above the least: one, and the cause is told; several, and these are what it can
// be. Under an override o of the feed torque goes with 1 + 0.75 (o - 1), known to 0.15 |o - 1|.
// Discretisation: none; a sum of nine a cut. Delay: that of the band. Cost: in torque_band.
// Range: torques of one sign or the other. Numerical bound: sums of squares over the cuts of a run,
// Real(1e-6) of the largest is lost in float.
// Bad at: programs whose cuts are of one kind, of which it names all that they leave open; two
// causes at once.
#pragma once

#include <array>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/monitors/torque_band_points.hpp"

namespace servosense {

/// What may explain the torque of the cuts.
enum class TorqueExplanation : std::uint8_t {
  here = 1,      ///< this cut alone
  every = 2,     ///< every cut by one share
  diameter = 4,  ///< a tool of another diameter
  height = 8,    ///< stock that stands higher or lower
};

/// Why the band was left, as far as torque tells.
class TorqueCause {
 public:
  enum class Kind : std::uint8_t {
    unknown = 0,
    never_cut = 1,  ///< the program cuts, and nothing has been cut yet
    not_cut = 2,    ///< nothing is cut here, and was before
    cuts_air = 3,   ///< something is cut where the program cuts nothing
    teeth = 4,      ///< another number of teeth cuts
    more = 5,       ///< more torque than expected
    less = 6,
  };
  constexpr TorqueCause() noexcept = default;
  /// `rest`: of `teeth` their number, of `more` and `less` a sum of explanations; below 16.
  constexpr TorqueCause(Kind kind, unsigned rest = 0) noexcept
      : code_(static_cast<std::uint8_t>(static_cast<unsigned>(kind) * 16 + rest % 16)) {}
  static constexpr TorqueCause from_code(std::uint8_t code) noexcept {
    TorqueCause cause;
    cause.code_ = code;
    return cause;
  }
  [[nodiscard]] constexpr std::uint8_t code() const noexcept { return code_; }
  [[nodiscard]] constexpr Kind kind() const noexcept { return static_cast<Kind>(code_ / 16); }
  [[nodiscard]] constexpr unsigned teeth() const noexcept { return code_ % 16; }
  [[nodiscard]] constexpr bool can_be(TorqueExplanation e) const noexcept {
    return (code_ & static_cast<unsigned>(e)) != 0;
  }
  /// One explanation is left.
  [[nodiscard]] constexpr bool is(TorqueExplanation e) const noexcept {
    return code_ % 16 == static_cast<unsigned>(e);
  }
  friend constexpr bool operator==(TorqueCause, TorqueCause) noexcept = default;

 private:
  std::uint8_t code_ = 0;
};

/// The steps of a cut.
template <RealNumber Real>
struct ComparedCut {
  Real steps = 0;
  Real measured_Nm = 0, expected_Nm = 0, wider_Nm = 0, higher_Nm = 0;  // sums
  Real slowed_Nm = 0;  // |override - 1| times what is expected

  void add(Real measured, Real expected, const TorqueBandChange<Real>& change,
           Real feed_override) noexcept {
    const Real slower = feed_override - Real(1);
    const Real share = Real(1) + Real(0.75) * slower;
    steps += Real(1);
    measured_Nm += measured;
    expected_Nm += share * expected;
    wider_Nm += share * change.wider_Nm;
    higher_Nm += share * change.higher_Nm;
    slowed_Nm += (slower < 0 ? -slower : slower) * expected;
  }
};

/// The cuts of a run, as sums.
template <RealNumber Real>
class TorqueExplanations {
 public:
  /// Of torque from cut to cut, as a taught band assumes from one run (docs/torque-band.md).
  static constexpr double kSpread = 0.03;
  /// What material and edge of a run have in common (chosen: a third of the band's
  /// tolerance_share).
  static constexpr double kCommon = 0.05;
  /// To which a course holds of a large change (chosen).
  static constexpr double kRough = 0.1;
  /// "Very strong" evidence: 2 ln of the ratio of likelihoods (Kass and Raftery 1995, 3.2).
  static constexpr double kMargin = 10;

  void add(const ComparedCut<Real>& cut, Real floor_Nm) noexcept {
    if (!(cut.steps > 0)) return;
    const Real per = Real(1) / cut.steps;
    const Real e = cut.expected_Nm * per, d = cut.measured_Nm * per - e;
    const Real w = cut.wider_Nm * per, h = cut.higher_Nm * per, o = cut.slowed_Nm * per;
    const Real v = square(Real(kSpread) * e) + square(Real(kRough) * d) + square(floor_Nm) +
                   square(Real(0.15) * o);
    if (!(v > 0)) return;
    const Real weight = Real(1) / v;
    ee_ += weight * e * e, ew_ += weight * e * w, eh_ += weight * e * h;
    ww_ += weight * w * w, hh_ += weight * h * h;
    ed_ += weight * e * d, wd_ += weight * w * d, hd_ += weight * h * d;
    dd_ += weight * d * d;
    ++cuts_;
  }
  [[nodiscard]] unsigned cuts() const noexcept { return cuts_; }
  /// What `here`, the cut that is under way, and these leave open: a sum of TorqueExplanation.
  /// `at_least`: the cut is not in for good, so more will come; not counted where the cuts so far
  /// let expect that.
  [[nodiscard]] unsigned with(const ComparedCut<Real>& here, Real floor_Nm,
                              bool at_least) const noexcept {
    TorqueExplanations all = *this;
    const Real off = here.measured_Nm - here.expected_Nm;
    const bool due = ee_ > 0 && (off > 0 ? ed_ * here.expected_Nm >= off * ee_
                                         : ed_ * here.expected_Nm <= off * ee_);
    if (!(at_least && due)) all.add(here, floor_Nm);
    const std::array<Real, 4> left = {
        common(0, 0, 0), all.dd_ - (all.ee_ > 0 ? all.ed_ * all.ed_ / all.ee_ : Real(0)),
        all.common(all.ew_, all.ww_, all.wd_), all.common(all.eh_, all.hh_, all.hd_)};
    const std::array<bool, 4> known = {true, true, all.ww_ > 0, all.hh_ > 0};
    Real least = left[0];
    for (std::size_t i = 1; i < left.size(); ++i)
      if (known[i] && left[i] < least) least = left[i];
    unsigned open = 0;
    for (std::size_t i = 0; i < left.size(); ++i)
      if (known[i] && left[i] <= least + Real(kMargin)) open |= 1U << i;
    return open;
  }

 private:
  static Real square(Real x) noexcept { return x * x; }
  /// chi2 with s, and with a where its course is known.
  [[nodiscard]] Real common(Real ec, Real cc, Real cd) const noexcept {
    const Real ee = ee_ + Real(1 / (kCommon * kCommon));
    const Real by_s = dd_ - ed_ * ed_ / ee;
    const Real rest = cc - ec * ec / ee, on = cd - ec * ed_ / ee;
    return rest > Real(1e-4) * cc ? by_s - on * on / rest : by_s;
  }

  Real ee_ = 0, ew_ = 0, eh_ = 0, ww_ = 0, hh_ = 0;
  Real ed_ = 0, wd_ = 0, hd_ = 0, dd_ = 0;
  unsigned cuts_ = 0;
};

}  // namespace servosense
