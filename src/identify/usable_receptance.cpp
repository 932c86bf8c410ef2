#include "servosense/identify/usable_receptance.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace servosense {
namespace {

constexpr double kLeastCoherence = 0.8;
// Of the magnitude: a phase of a degree or two ahead is the error of any measurement.
constexpr double kPhaseError = 0.03;
constexpr std::size_t kRun = 12;          // lines in a row that are no luck
constexpr double kLeastImpossible = 0.1;  // of the lines below: else they are of another resonance
constexpr std::size_t kFewest = 8;

bool dissipates(std::complex<double> g) { return g.imag() <= kPhaseError * std::abs(g); }

/// First line of the first run that is positive and dissipates; 0 when the lines below it, too, may
/// be those of a structure.
std::size_t bottom_of(const std::vector<std::complex<double>>& g) {
  std::size_t run = 0, first = 0;
  for (std::size_t i = 0; i < g.size(); ++i) {
    run = g[i].real() > 0 && dissipates(g[i]) ? run + 1 : 0;
    if (run < kRun) continue;
    first = i + 1 - kRun;
    break;
  }
  const auto impossible = std::count_if(g.begin(), g.begin() + static_cast<long>(first),
                                        [](std::complex<double> x) { return !dissipates(x); });
  return static_cast<double>(impossible) > kLeastImpossible * static_cast<double>(first) ? first
                                                                                         : 0;
}

std::string hertz(double f) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g Hz", f);
  return text;
}

}  // namespace

Expected<UsableReceptance> usable_receptance(const FrequencyResponse& measured,
                                             const std::string& name, bool direct) {
  UsableReceptance usable;
  ReceptanceTable coherent;
  std::vector<std::size_t> lines;
  std::size_t noisy = 0;
  for (std::size_t i = 0; i < measured.frequency_hz.size(); ++i) {
    if (!measured.coherence.empty() && !(measured.coherence[i] >= kLeastCoherence)) {
      ++noisy;
      continue;
    }
    coherent.frequency_hz.push_back(measured.frequency_hz[i]);
    coherent.receptance_m_per_N.push_back(measured.receptance_m_per_N[i]);
    lines.push_back(i);
  }
  if (noisy > 0)
    usable.remark = name + ": " + std::to_string(noisy) + " of " +
                    std::to_string(measured.frequency_hz.size()) +
                    " lines are left out, their coherence is below 0.8";
  const std::size_t bottom = direct ? bottom_of(coherent.receptance_m_per_N) : 0;
  if (bottom > 0)
    usable.remark += (usable.remark.empty() ? name + ": " : "; ") + "lines below " +
                     hertz(coherent.frequency_hz[bottom]) +
                     " are left out: no structure that is held moves against the force there";
  const auto from = static_cast<long>(bottom);
  usable.table.frequency_hz.assign(coherent.frequency_hz.begin() + from,
                                   coherent.frequency_hz.end());
  usable.table.receptance_m_per_N.assign(coherent.receptance_m_per_N.begin() + from,
                                         coherent.receptance_m_per_N.end());
  usable.lines.assign(lines.begin() + from, lines.end());
  if (usable.table.frequency_hz.size() < kFewest)
    return data_error(name + ": fewer than 8 usable lines are left; measure again" +
                      (usable.remark.empty() ? "" : " (" + usable.remark + ")"));
  return usable;
}

}  // namespace servosense
