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
// the speeds from whole records of tools drawn at random one in nineteen is off by more than 2 %.
#pragma once

#include <functional>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense {

/// A record with one or more cuts in it; run-up, air and run-down may be there as well.
struct CuttingTorqueTrace {
  double sample_rate_hz = 8000;
  std::vector<double> torque_Nm;            ///< estimated cutting torque
  std::vector<double> spindle_speed_rad_s;  ///< as long as the torque
  /// -J dw/dt, what the angle alone says of the torque; as long, or empty when the angle is not
  /// known. Its chatter is that of the torque behind the velocity loop, and free of the noise of a
  /// current that is recorded more slowly than the loop runs.
  std::vector<double> inertia_torque_Nm;
  /// Torque of one count of the encoder between two samples, J (2 pi / counts) / T^2; 0: not from
  /// counts.
  double count_torque_Nm = 0;
};

struct StableSpeedOptions {
  int teeth = 2;                ///< of the tool, equal pitch
  double moving_average_s = 1;  ///< of the power that minima are sought below (Koike 2016, 8.2)
  /// Mean cutting torque that the cut should have, 0 when not known. It tells whether chatter could
  /// have been seen where none was.
  double expected_torque_Nm = 0;
  std::function<void(double share)> progress = {};  ///< called now and then, if given
};

enum class StableSpeedVerdict {
  found,
  insufficient_chatter,  ///< it would have been seen: too little of the ramp chatters
  hidden,                ///< noise would hide the chatter of such a cut
  unclear,               ///< chatter that no natural frequency explains, or several do that have
                         ///< no speed in common; only minima are given
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
  double uncertainty_rpm = 0;  ///< two standard errors
  int waves = 0;               ///< K, tooth passings per natural period near the pocket, rounded
  double spread_rpm = 0;       ///< largest less smallest of ramps and views
  /// Uncorrected minimum that belongs to it; NaN where there is none.
  double minimum_rpm = std::numeric_limits<double>::quiet_NaN();
};

/// A ramp in the cut.
struct RampInCut {
  std::size_t record = 0;  ///< which of the records
  double from_s = 0, to_s = 0;
  double fastest_rpm = 0, slowest_rpm = 0;
  double chatter_share = 0;  ///< of its teeth at which chatter stands out
  bool used = false;         ///< the speeds come from it
};

struct StableSpeeds {
  StableSpeedVerdict verdict = StableSpeedVerdict::insufficient_chatter;
  std::string sentence;              ///< what was found, or why not and what to do
  std::vector<StableSpeed> pockets;  ///< within the ramp, by rising speed; empty unless found
  /// All that were found, in order of records and time; `minima` and `ridge` are those of each.
  std::vector<RampInCut> ramps;
  std::vector<std::vector<PowerMinimum>> minima;
  std::vector<ChatterRidge> ridge;
  double chatter_share = 0;  ///< largest of the ramps
  double seen_below_hz = 0;  ///< band of the torque that was looked at
  /// Least torque of chatter, amplitude in that band, that would have stood out of the noise.
  double visible_torque_Nm = std::numeric_limits<double>::quiet_NaN();
  /// How many times as many counts a revolution would show the chatter; NaN unless hidden behind
  /// the counts.
  double counts_factor = std::numeric_limits<double>::quiet_NaN();
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
