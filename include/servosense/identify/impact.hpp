// Receptance from hammer hits: force of an instrumented hammer, motion of the tool.
//
// Purpose: what the stability of a cut needs to know of a tool in its spindle (Dunwoody 2010,
// 4.3).
//   F, X   transforms of the windowed force (identify/impact_pulse.hpp) and of the response, a
//          segment a hit; Sff, Sxx, Sfx = conj(F) X means over M hits (dsp/cross_spectrum.hpp)
//   H1 = Sfx / Sff,  H2 = Sxx / conj(Sfx),  Hv = sqrt(H1 H2),  C = |Sfx|^2 / (Sxx Sff)
// Noise of N samples, of standard deviations ef and ex (eq. 4.39 and 4.41):
//   var H1 = (|H1|^2 / (M Sff)) (Px / |H1|^2 + Pf / C),   Px = ex^2 sum of its window squared,
//   var H2 = (|H2|^2 / (M Sxx)) (Px / C + |H2|^2 Pf),     Pf likewise: with 1 / M, and with N
// of the complex value, noise taken from where nothing moves. Where hits scatter more than that,
// the standard errors are widened, and it is said.
//
// Acceleration and velocity are integrated as transforms: X = A / s^2, s = i w + a.
//
// A response that has not died away at the end of its record is brought there by an exponential
// window exp(-a t) over force and response alike, which moves every pole by -a and does nothing
// else: H(i w + a) is obtained, and a is written beside it.
//
// A hit is not used, with its reason in words, when it is a double hit, cut off at the range of a
// channel, weak, measured in too wide a range, sampled too coarsely, recorded from within its
// pulse, given to a tool that still moves, or not recorded long enough.
//
// Bad at: noise that is not white, which the standard errors know only as scatter of hits; a second
// contact of less than 3 % of the first; modes that the hammer's tip does not excite.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/frf_file.hpp"

namespace servosense {

/// A trace of one or several hits. NaN: the sensor had no value.
struct ImpactRecord {
  std::string name;  ///< in sentences
  double sample_rate_hz = 0;
  double begin_s = 0;                     ///< time of the first sample
  std::vector<double> force_N, response;  ///< of one length
};

enum class ResponseQuantity { displacement, velocity, acceleration };  // m, m/s, m/s2
enum class FrfEstimator { h1, h2, hv };

struct ImpactOptions {
  ResponseQuantity response = ResponseQuantity::displacement;
  FrfEstimator estimator = FrfEstimator::h1;
  double length_s = 0;  ///< of a segment; 0: as recorded, at most 16 times what the response lasts
  /// Rate of the exponential window [1/s], 0: none; not given: as much as is needed.
  std::optional<double> exponential_window_per_s;
  bool reversed = false;   ///< the sensor counts against the hammer's direction
  double offset_m = 0;     ///< of the hammer above the sensor
  double stick_out_m = 0;  ///< of the tool; needed with an offset
};

struct ImpactHit {
  std::size_t record = 0;
  double t_s = 0;      ///< of its peak, as the trace counts
  double peak_N = 0;   ///< with its sign
  double width_s = 0;  ///< between tenths of the peak
  bool used = false;
  std::string reason;                           ///< why not; empty when used
  std::size_t peak = 0, begin = 0, length = 0;  ///< samples of the record: its segment
};

struct ImpactResult {
  /// Lines above zero at which the force is above -40 dB and above its noise: between the lobes of
  /// a pulse's spectrum some are missing. With one hit the coherence is that which the noise lets
  /// expect, as the measured one would be 1 whatever was measured.
  FrequencyResponse response;
  std::vector<double> force_Ns;  ///< a line: rms of |F| over hits, times the sample period
  std::vector<ImpactHit> hits;   ///< in the order of records and time
  std::size_t averages = 0;      ///< hits that were used
  double sample_rate_hz = 0, length_s = 0;
  double usable_from_hz = 0, usable_to_hz = 0;   ///< standard error below a third of the receptance
  double coherence = 0, relative_error = 0;      ///< medians there, the latter of the receptance
  double peak_hz = 0, peak_m_per_N = 0;          ///< highest resonance there; both 0: there is none
  double force_noise_N = 0, response_noise = 0;  ///< standard deviation of a sample
  double window_noise_gain = 0;  ///< noise that the force window leaves, mean over hits
  double widened_by = 1;         ///< factor on the standard errors, as hits scatter
  double offset_factor = 1;
  std::vector<double> softened_hz;  ///< resonances below that of the tool: too soft by the offset
  std::vector<std::string> remarks;
};

/// Errors: data for no record, records of two rates, no hit that can be used (the reasons are
/// named), or noise everywhere; usage for an offset that makes no sense.
[[nodiscard]] Expected<ImpactResult> identify_impact(std::span<const ImpactRecord> records,
                                                     const ImpactOptions& options = {});

}  // namespace servosense
