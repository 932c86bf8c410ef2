// Modes of a structure from measured receptances: natural frequency, damping ratio, modal mass.
//
// Model, at s = decay + jw (the decay is that of an exponential window, mostly 0), of receptance f:
//   G_f(s) = sum_r a_fr / (s^2 + 2 zeta_r w_r s + w_r^2) + c_f + b_f / s^2
// with poles that all receptances share, real residues a_fr (of proportional damping), and what is
// left of the modes above the band (compliance c_f) and below it (inverse mass b_f). At the point
// of the force a_fr = 1 / modal mass.
//
// 1. Poles of rising order by least-squares complex frequency estimation: one denominator for all
//    receptances, in powers of exp(-s T), each line over its noise (Guillaume et al. 2003; Peeters
//    et al. 2004). The highest coefficient is 1, which makes those that only fit noise unstable
//    (Cauberghe et al. 2005).
// 2. Which are modes. Candidates are poles that come back, order after order. A candidate is a mode
//    if (a) it comes back in half of the orders from its first one on, (b) it lies in the band and
//    is damped, (c) at the point of the force it gives way along the force (its modal mass is
//    positive), (d) the fit needs it: without it the misfit rises by more than the Bayes
//    information criterion allows to chance (Schwarz 1978), what the fit leaves anyway counted as
//    noise.
// 3. Refinement: least squares over all lines at once, each over its noise, by variable projection
//    (Golub and Pereyra 1973). Standard errors are those of the inverse Hessian, times the noise as
//    it is left and as it is alike from line to line (a window, or what the model lacks).
//
// Noise of a line: from the coherence, var Re = var Im ~ |G|^2 (1 - coherence) / coherence, mean
// over neighbours (Bendat and Piersol 2010, ch. 9); without one from fourth differences. Its level
// is that of what the fit leaves.
// Bad at: modes that share energy (complex residues): their errors then say how badly they fit.
#pragma once

#include <complex>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/io/frf_file.hpp"

namespace servosense {

struct MeasuredReceptance {
  std::string name;  ///< the file, for sentences
  FrequencyResponse response;
  bool direct = true;  ///< motion at the point and in the direction of the force
};

struct ModesOptions {
  double from_hz = 0;
  double to_hz = std::numeric_limits<double>::infinity();
  int highest_order = 40;                        ///< of the stabilisation diagram, 4..200
  std::function<void(double share)> progress{};  ///< 0..1; may be empty
};

struct IdentifiedMode {
  Estimate natural_frequency_hz;
  Estimate damping_ratio;
  Estimate modal_mass_kg;                ///< NaN where no receptance is direct
  std::vector<Estimate> residue_per_kg;  ///< of each receptance
  double lines_in_peak = 0;              ///< lines in its half-power band
  std::string doubt;                     ///< why not to build on it; empty: nothing
};

struct DiagramPole {
  int order = 0;
  double frequency_hz = 0;
  double damping_ratio = 0;
  bool stable = false;  ///< comes back from the order below
};

struct PoleTurnedDown {
  double frequency_hz = 0;
  double damping_ratio = 0;
  std::string reason;
};

/// One receptance beside what was fitted; the lines that were used.
struct FittedReceptance {
  std::string name;
  bool direct = true;
  std::vector<double> frequency_hz;
  std::vector<std::complex<double>> measured_m_per_N;
  std::vector<std::complex<double>> fitted_m_per_N;
  Estimate compliance_m_per_N;   ///< of the modes above the band
  Estimate inverse_mass_per_kg;  ///< of those below it
  double explained = 0;          ///< share of the mean square of the lines, 0..1
};

struct ModesIdentification {
  std::vector<IdentifiedMode> modes;  ///< by rising frequency; one at least
  std::vector<FittedReceptance> receptances;
  std::vector<DiagramPole> diagram;
  std::vector<PoleTurnedDown> turned_down;  ///< candidates that are no modes, by rising frequency
  std::vector<std::string> remarks;
};

/// Of receptances that share their poles: of one direction, at any points. Data error where no
/// receptance has 8 usable lines, or no pole is a mode, with the reason.
[[nodiscard]] Expected<ModesIdentification> identify_modes(
    const std::vector<MeasuredReceptance>& receptances, const ModesOptions& options = {});

}  // namespace servosense
