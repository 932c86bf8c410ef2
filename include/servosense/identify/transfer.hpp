// Transfer function from one recorded signal to another: torque to current, force to its estimate.
//
// Purpose: how much of what acts on the tool a drive shows, and up to which frequency (Bertok 1984,
// ch. 2: cutting torque to spindle current).
//   H = Pxy / Pxx,   coherence |Pxy|^2 / (Pxx Pyy)                  (Bertok 1984, eq. 2.1 to 2.3)
// over half overlapping segments (dsp/cross_spectrum.hpp). The output is shifted by its delay
// first, because what a segment cuts off at its end is lost (Bendat and Piersol 2010, sec. 9.2);
// the phase has it again.
//
// Several records are merged line by line, each weighted by the inverse of its variance, which its
// coherence tells. Bands of 95 %, of gain and of phase each by itself:
//   closed form   |dH| <= t |H| sqrt(v (1 / c - 1) / (2 (K - 1))),  c the coherence,
//                 t of Student at 2 (K' - 1), v and K' for the overlap (t^2 is F of 1 and 2 (K' -
//                 1); Goodman 1957)
//   resampling    segments drawn anew (Efron 1979), percentiles
// Where segments differ more than noise lets them (a cut that begins, records of two loads),
// drawing gives the wider bands, and those of the closed form are widened to them, and said.
//
// A line is excited when the input's power there is more than what the window lets through from
// other lines. Usable: from the lowest excited line on as long as the coherence is above 0.9.
//
// Bad at: noise on the input, which makes the gain low by its share of the input's power: by
// 1 - coherence at most, and not at all once it is given as `input_noise`; loops in which the
// output acts back on the input; a resonance narrower than a line.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense {

struct TransferRecord {
  std::string name;  ///< in sentences
  double sample_rate_hz = 0;
  std::vector<double> input, output;  ///< of one length, all finite
};

struct TransferOptions {
  /// The nearest power of two of samples is taken, 16 to 16384. 0: chosen, 32 segments or more, as
  /// many as the course of the transfer function allows while the usable band has 60 lines
  /// and the band of constant gain 12.
  double segment_s = 0;
  double input_noise = 0;  ///< standard deviation of white noise on the input, in its unit
  std::string input = "input", output = "output";  ///< their names in sentences
};

struct TransferFunction {
  /// A value a line, from the first line above zero to the last below half the rate; NaN where the
  /// input is not excited.
  std::vector<double> frequency_hz, gain, gain_low, gain_high;
  std::vector<double> phase_rad;  ///< -pi..pi; its band may reach beyond
  std::vector<double> phase_low, phase_high, coherence;
  /// Bands by resampling.
  std::vector<double> gain_resampled_low, gain_resampled_high;

  double usable_from_hz = 0, usable_to_hz = 0;               ///< both 0: nowhere
  std::vector<std::pair<double, double>> coherent_bands_hz;  ///< all, the usable one among them
  double low_gain = 0;        ///< median of the first five lines of the usable band
  double constant_to_hz = 0;  ///< up to here no line's gain is more than 5 % from that for certain
  double late_s = 0;          ///< slope of the phase over that band: lag and delay together
  std::size_t segments = 0;
  double segment_s = 0;
  double shift_s = 0;              ///< whole samples by which the output was shifted
  double resampled_to_closed = 0;  ///< width of the resampled band over that of the closed form; 0:
                                   ///< fewer than eight segments
  double widened_by = 1;           ///< factor on the closed bands
  double records_disagree = 0;     ///< their spread over what noise explains; 0: one record
  double segment_bias = 0;         ///< share of the gain that so short a segment may hide
  double input_noise_share = 0;    ///< by which noise on the input may lower the gain at most
  std::vector<std::string> remarks;
};

/// Errors (data): no record or rates that differ; a signal that does not vary or has lost its sign;
/// fewer than two segments; an input that is a few lines, which are named.
[[nodiscard]] Expected<TransferFunction> identify_transfer(std::span<const TransferRecord> records,
                                                           const TransferOptions& options);

/// Whether a signal was folded at zero: it never changes its sign and turns there as a straight
/// line does that is bent back.
[[nodiscard]] bool is_rectified(std::span<const double> signal);

}  // namespace servosense
