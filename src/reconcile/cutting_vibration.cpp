// A mode of the tool that only entries and changes of feed show.
#include <algorithm>
#include <cmath>
#include <string>

#include "cutting_transients.hpp"
#include "cutting_workflow.hpp"

namespace servosense::reconcile {
namespace {

/// Gain in mean squares of the noise. The best of some thousand modes, three parameters each,
/// reaches it on noise alone once in 10^4 records (chi-squared of three: 2 ln 10^7 and a little).
constexpr double kLeastGain = 40;
constexpr double kWorthALook = 12;  // of a coarse scan
/// What the mode must explain of all that does not repeat with the tool and is not noise.
constexpr double kLeastShare = 0.33;
/// Where it was not fitted: standard errors by which it is there, and how far its size may be off
/// beside two of them.
constexpr double kLeastHeldErrors = 3, kMostOff = 0.3;
/// At each change of the feed alike, beside three errors.
constexpr double kPassErrors = 3;
/// Decay within a pass, as a power of e: what rings on from one change to the next is no answer to
/// them.
constexpr double kLeastDecay = 3;

}  // namespace

void CuttingWorkflow::name_transients(Report& report) {
  const CutTransients transients(data_, average_, found_.state);
  if (!transients.usable() || report.effects.size() >= options_.most_effects) return;
  const CutTransients::Judged best =
      transients.best_mode(kWorthALook * average_.noise_N * average_.noise_N, options_.threads);
  // Vibration that goes on for long is in the scatter between revolutions, too.
  const double noise =
      std::min(average_.noise_N * average_.noise_N, best.fitted[1] / transients.freedom(false));
  const double gain = (best.fitted[0] - best.fitted[1]) / noise;
  const double excess = best.fitted[0] / noise - transients.freedom(false);
  const double error = best.held_part_error * std::sqrt(noise);
  const StructuralMode& mode = best.mode.mode;
  if (!(gain > kLeastGain) || gain < kLeastShare * excess ||
      !(best.held_part > kLeastHeldErrors * error) ||
      !(std::abs(best.held_part - 1) < kMostOff + 2 * error) || !(best.held[1] < best.held[0]) ||
      mode.damping_ratio > kMostDamping ||
      mode.damping_ratio * mode.natural_frequency_rad_s() * transients.shortest_s() < kLeastDecay)
    return;
  for (const auto& [part, its_error] : best.part_of_pass)
    if (its_error > 0 && std::abs(part - 1) > kMostOff + kPassErrors * its_error * std::sqrt(noise))
      return;
  FoundEffect e;
  e.name = ExtraModeEffect::info.name;
  e.scope = ExtraModeEffect::info.scope;
  e.where = ExtraModeEffect::info.where;
  e.share_of_residual = std::clamp(gain / std::max(gain, excess), 0.0, 1.0);
  e.confidence = 0.99;  // it was there again, of the same size, where it was not fitted
  const auto add = [&](std::size_t k, double value) {
    e.parameters.push_back({ExtraModeEffect::info.parameters[k].key, {value}});
    e.standard_errors.push_back(
        {ExtraModeEffect::info.parameters[k].key, {value * best.errors[k] * std::sqrt(noise)}});
  };
  add(0, mode.natural_frequency_hz);
  add(1, mode.damping_ratio);
  add(2, mode.modal_mass_kg);
  e.gap_before = std::sqrt(best.held[0] / transients.freedom(true));
  e.gap_after = std::sqrt(best.held[1] / transients.freedom(true));
  if (report.effects.empty()) {
    report.gap_before = e.gap_before;
    report.gap_after = e.gap_after;
  }
  report.remarks.emplace_back(
      std::string("a mode of the tool along ") + (best.mode.axis == 0 ? "x" : "y") +
      " shows after changes of the feed; its gaps are of all samples, less what repeats with the "
      "tool");
  report.effects.push_back(std::move(e));
}

}  // namespace servosense::reconcile
