// Modes of a machine without a hammer: from what still rings when a cut ends.
//
// Model of a signal y from the end of the forcing on:
//   y(t) = c + sum_k (forced lines at k times the rotation, locked to the spindle's angle)
//            + sum_r exp(-a_r t) (p_r cos(v_r t) + q_r sin(v_r t)) + noise,
//   natural frequency w_r = sqrt(v_r^2 + a_r^2), damping ratio a_r / w_r.
//
// 1. Ends of cuts: where the rms over a turn of the spindle falls to the lowest level that the
//    record holds, and stays there. The forced lines are those that stay.
// 2. Where the forcing ends: from the quiet backwards, as long as decays alone describe the record
//    down to the noise of the quiet.
// 3. Decays one after the other, the strongest first: the best of a dictionary of decaying
//    sinusoids (Mallat and Zhang 1993), then least squares of all by variable projection (Golub and
//    Pereyra 1973), until the Bayes information criterion has enough (Schwarz 1978).
// 4. Standard errors: inverse Hessian, noise as it is about each frequency where that is more than
//    the mean. Over several ends: weighted mean, errors widened where they disagree (Birge 1932).
//
// No mode is what does not decay by three standard errors, and what stands at a multiple of the
// rotation: a cut that ends slowly lets it die out like a decay.
// What it cannot tell: modal mass, for the force that set the mode ringing is unknown.
// Bad at: modes that die within few samples; two modes within each other's half-power band.
#pragma once

#include <cstddef>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/modes.hpp"

namespace servosense {

struct DecayRecord {
  std::string name;           ///< file and column, for sentences
  std::vector<double> t_s;    ///< rising
  std::vector<double> value;  ///< one an instant, any unit; not finite: no sample
  std::vector<double> turns;  ///< of the spindle at each instant, added up; empty: unknown
};

struct FreeDecayOptions {
  double from_hz = 0;
  double to_hz = std::numeric_limits<double>::infinity();
  std::function<void(double share)> progress{};  ///< 0..1; may be empty
};

struct FreeDecayMode {
  Estimate natural_frequency_hz;
  Estimate damping_ratio;
  std::size_t decays = 0;  ///< in which it was found
  std::string doubt;       ///< why not to build on it; empty: nothing
};

/// One end of a cut in which something rings.
struct FreeDecay {
  std::string record;
  double from_s = 0, to_s = 0;  ///< the stretch that was fitted; forcing ends at or before from_s
  double rotation_hz = std::numeric_limits<double>::quiet_NaN();  ///< NaN: unknown
  std::vector<double> t_s{}, measured{}, fitted{};
};

struct FreeDecayIdentification {
  std::vector<FreeDecayMode> modes;  ///< by rising frequency; one at least
  std::vector<FreeDecay> decays;     ///< one at least
  std::size_t ends = 0;              ///< of cuts, with decays or without
  std::vector<PoleTurnedDown> turned_down;
};

/// Data error: too few samples, no end of a cut, nothing that rings there.
Expected<FreeDecayIdentification> identify_free_decays(std::span<const DecayRecord> records,
                                                       const FreeDecayOptions& options = {});

}  // namespace servosense
