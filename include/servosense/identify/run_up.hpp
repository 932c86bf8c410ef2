// Modes of a machine without a hammer: from the harmonics of the spindle's rotation that sweep
// through them in a run-up or run-down.
//
// Model of one harmonic (order n) near a mode of pole p, by the spindle's measured angle a:
//   y(t) = Re[r x(t)] + Re[(b_0 + b_1 u + b_2 u^2 + b_3 u^3) exp(j n a(t))] + other orders + noise,
//   x'(t) = p x(t) + exp(j n a(t)),   p = w (-z + j sqrt(1 - z^2)),   u: speed about the crossing.
// x is integrated sample by sample, so what a fast sweep does to the peak (shift, ringing, lower
// height: Lewis 1932) is in the model, not in the result. How the force grows with the speed need
// not be known: force(w) / (jw - p) is force at the pole / (jw - p) and a smooth rest, which b has.
//
// 1. Sweeps: where the speed rises or falls by a tenth at least.
// 2. Complex amplitude of each order: mean of y exp(-j n a) under a Hann window of four turns,
// which
//    has zeros at all other orders; one every two turns. x is treated likewise.
// 3. Candidates: the steady response of a mode against the smooth part alone, on a grid; then least
//    squares of w and z by variable projection (Golub and Pereyra 1973), further modes of the band
//    beside while the Bayes information criterion asks for them (Schwarz 1978).
// 4. Standard errors: inverse Hessian. Over several orders and sweeps: weighted mean, errors
// widened
//    where they disagree (Birge 1932).
//
// No mode is what a line of fixed frequency (mains, another motor) explains as well, what does not
// decay by three standard errors, and what hardly stands out of the smooth part. A sweep that
// crosses the half-power band within the window of four turns is too fast.
// What it cannot tell: modal mass, for the force is not measured; modes that no order reaches.
// Bad at: two modes within each other's half-power band; modes that move with the speed.
#pragma once

#include <cstddef>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/free_decay.hpp"

namespace servosense {

struct RunUpOptions {
  double from_hz = 0;
  double to_hz = std::numeric_limits<double>::infinity();
  int highest_order = 24;                        ///< harmonics of the rotation that are followed
  std::function<void(double share)> progress{};  ///< 0..1; may be empty
};

/// One order of one sweep that crosses a mode.
struct ModeCrossing {
  std::string record;
  int order = 0;
  double at_s = 0;
  double rate_hz_per_s = 0;  ///< of the order; falling: below 0
  /// Sweep rate over (z w)^2, both in rad: well below 1 the peak is that of a steady response.
  double relative_rate = 0;
  Estimate natural_frequency_hz;
  Estimate damping_ratio;
  std::vector<double> frequency_hz{}, measured{}, fitted{};  ///< amplitudes about it
};

struct RunUpMode {
  Estimate natural_frequency_hz;
  Estimate damping_ratio;
  std::vector<ModeCrossing> crossings;  ///< one at least
  std::string doubt;                    ///< why not to build on it; empty: nothing
};

struct RunUpIdentification {
  std::vector<RunUpMode> modes;  ///< by rising frequency; one at least
  std::size_t sweeps = 0;
  double from_hz = 0, to_hz = 0;  ///< that the orders reach, within the band
  std::vector<PoleTurnedDown> turned_down;
};

/// Records with turns of the spindle. Data error: no turns, gaps, no sweep, no mode in it.
Expected<RunUpIdentification> identify_run_ups(std::span<const DecayRecord> records,
                                               const RunUpOptions& options = {});

}  // namespace servosense
