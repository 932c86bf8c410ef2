// Stable spindle speeds (stability pockets) from one chattering cut while the spindle slows down
// (Koike 2016, 2.4.2 and ch. 8), without a hammer test.
//
// Chatter rises with the spindle speed inside a lobe and jumps down at the pocket between two
// lobes, where its power is smallest. The source takes the minima of that power below its moving
// average. They lag: at the pocket the old chatter still rings and the new one has yet to grow, and
// forced vibration at the natural frequency holds it down, so the minimum comes 110 to 380 rpm
// late at 15 to 75 %/s. This block returns those minima, and corrects them without modal data:
//
// 1. Torque is sampled per angle of the tooth, minus the revolution before, so that whatever
//    repeats with the spindle (teeth, run-out) is gone. From tooth to tooth the rest is multiplied
//    by z = exp(g + 2 pi j u): u is the fraction of a wave left between two teeth, whichever
//    sideband carries it, g the growth per tooth. z comes from a subspace fit (Roy & Kailath 1989)
//    over eight teeth, so that neither the sweep nor growth smears it.
// 2. In every lobe u climbs through the same values while the waves k + u between teeth differ by
//    one: this fixes the whole number k, hence the frequency (k + u) / T.
// 3. Regeneration, s^2 + 2 zeta wn s + wn^2 = -C (1 - 1/z) with s = (g + 2 pi j (k + u)) / T and C
//    real but unknown (it falls as chatter leaves the cut), says of each tooth
//      Im[(s^2 + 2 zeta wn s + wn^2) conj(1 - 1/z)] = 0,
//    two unknowns for hundreds of teeth. Growth and decay are part of it, so that the rate of
//    change hardly enters. Strong chatter leaves the work, and the waves of the last tooth but one
//    stay where the last tooth missed: 1/z becomes (1 - q)/z + q/z^2, q in proportion to the
//    amplitude, its largest value the one that leaves the least phase error.
// 4. With wn and zeta the pockets are where both lobes have the same limit depth, Re lambda in
//    stability_lobes.hpp. At the detuning x, w^2 - wn^2 = +-2 zeta wn w x, with r(x) = w / wn, one
//    mode has Re lambda ~ x / ((1 + x^2) r), so the lobes meet at the detunings x < 1 and y > 1
//    where these are equal, and
//      K = T fn r(x) +- atan(x) / pi,   1 - (acot x - acot y) / pi = T fn |r(y) - r(x)|,
//    K = 1, 2, ... (+ when chatter lies above the natural frequency, - below).
//
// Range: the torque must show the teeth (8 or more samples per tooth passing) and chatter over most
// of the ramp, two lobes at least. Tooth passing and chatter may be anywhere below half the sample
// rate; the low-pass of the observer changes neither u nor g.
// Bad at: two modes that chatter in turn (one effective mode is fitted); a cut far deeper than its
// limit, where the tool misses several passes; unequal pitch. Of
// the answers for tools drawn at random one in nineteen is off by more than 2 %.
#pragma once

#include <limits>
#include <span>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense {

/// A recorded cut.
struct CuttingTorqueTrace {
  double sample_rate_hz = 8000;
  std::vector<double> torque_Nm;            ///< estimated cutting torque
  std::vector<double> spindle_speed_rad_s;  ///< as long as the torque
};

struct StableSpeedOptions {
  int teeth = 2;                ///< of the tool, equal pitch
  double moving_average_s = 1;  ///< of the power that minima are sought below (Koike 2016, 8.2)
};

enum class StableSpeedVerdict {
  found,
  insufficient_chatter,  ///< too little of the ramp chatters: deeper cut, wider immersion
  accelerating,          ///< chatter builds up slowly then; only minima are given
  unclear,               ///< chatter, but no natural frequency explains it; only minima are given
};

/// A minimum of the chatter power, as in the source.
struct PowerMinimum {
  double t_s = 0;
  double spindle_speed_rpm = 0;
  double power_Nm2 = 0;
  double average_Nm2 = 0;       ///< moving average there
  bool frequency_jump = false;  ///< the chatter frequency jumps down around it
  bool accepted = false;        ///< false: an outlier, its power is high and nothing jumps
};

/// Chatter from frame to frame, the middle of a window of 32 teeth.
struct ChatterRidge {
  std::vector<double> t_s, spindle_speed_rpm, power_Nm2, average_Nm2;
  std::vector<double> frequency_hz;  ///< NaN where there is no chatter, or no verdict on k
};

struct StableSpeed {
  double spindle_speed_rpm = 0;
  int waves = 0;          ///< K, tooth passings per natural period near the pocket, rounded
  double spread_rpm = 0;  ///< largest less smallest of the cuts
  /// Uncorrected minimum that belongs to it; NaN where there is none.
  double minimum_rpm = std::numeric_limits<double>::quiet_NaN();
};

struct StableSpeeds {
  StableSpeedVerdict verdict = StableSpeedVerdict::insufficient_chatter;
  std::string sentence;              ///< what was found, or why not and what to do
  std::vector<StableSpeed> pockets;  ///< within the ramp, by rising speed; empty unless found
  /// Of each cut, in order of time.
  std::vector<std::vector<PowerMinimum>> minima;
  std::vector<ChatterRidge> ridge;
  double chatter_share = 0;  ///< of the ramp's teeth at which chatter stands out
  /// Effective mode that the pockets stand on; NaN unless found. The damping ratio is biased by
  /// how deep the cut is; do not use it elsewhere.
  double natural_frequency_hz = std::numeric_limits<double>::quiet_NaN();
  double damping_ratio = std::numeric_limits<double>::quiet_NaN();
  double phase_error_rad = std::numeric_limits<double>::quiet_NaN();  ///< median of |residual|
};

/// From one cut. Errors: no ramp (the speed changes by less than 10 %), fewer than 64 teeth, too
/// slow a sample rate, lengths that differ, a value that is not finite.
[[nodiscard]] Expected<StableSpeeds> identify_stable_speeds(const CuttingTorqueTrace& cut,
                                                            const StableSpeedOptions& options);
/// From several cuts of the same tool and engagement: lobe numbers from all together, the mean of
/// the speeds that each cut gives. Best at different rates. (A straight line through the rates,
/// drawn on to no rate at all, makes more of the scatter than it takes of the bias.)
[[nodiscard]] Expected<StableSpeeds> identify_stable_speeds(
    std::span<const CuttingTorqueTrace> cuts, const StableSpeedOptions& options);

/// Pocket of a single mode, step 4 above [rpm]; waves >= 1, above: chatter above the natural
/// frequency.
[[nodiscard]] double single_mode_pocket_rpm(double natural_frequency_hz, double damping_ratio,
                                            int teeth, int waves, bool above);

}  // namespace servosense
