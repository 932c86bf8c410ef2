// A cut that is not stable: the tool vibrates for itself, at its own frequency, and remembers it
// from tooth to tooth. No simulation over time follows that for long. So the measured force leads
// the tool: the displacement that a mode answers it with gives the force of the next sample. Noise
// leads it as well, so that vibration has to stand out of it.
#include <algorithm>
#include <array>
#include <cmath>

#include "reconcile/cut/transients.hpp"
#include "reconcile/cut/workflow.hpp"

namespace servosense::reconcile {
namespace {

/// Of all that does not repeat with the tool, noise included, what the vibration must explain.
/// Noise alone is explained to some thousandths.
constexpr double kLeastChatterShare = 0.33;
/// In every pass alike, and in the part kept for the proof.
constexpr double kMostOff = 0.3, kErrors = 3;
/// Powers of e by which a vibration fades within a pass: one that fades faster does not last.
constexpr double kMostFading = 3;
/// Memory goes with 1, none with 0; a tooth that leaves the work for a part of the wave remembers
/// the less.
constexpr double kLeastMemory = 0.5;

FoundEffect named(const CuttingEffectInfo& info, double explained) {
  FoundEffect e;
  e.name = info.name;
  e.scope = info.scope;
  e.where = info.where;
  e.share_of_residual = std::clamp(explained, 0.0, 1.0);
  e.confidence = 0.99;  // it was there again, of the same size, where it was not fitted
  return e;
}

}  // namespace

void CuttingWorkflow::name_chatter(Report& report, const CutTransients& transients) {
  // A line that is fixed in time is no answer of the tool.
  if (!lines_.empty()) return;
  const bool rigid = data_.structure.x.empty() && data_.structure.y.empty();
  std::array<double, 2> held{};
  if (rigid) {
    const CutTransients::Judged its = transients.best_driven(
        kLeastChatterShare * average_.noise_N * average_.noise_N * transients.freedom(false) / 4,
        options_.threads);
    const double explained = 1 - its.fitted[1] / its.fitted[0];
    const double noise_N = std::sqrt(its.fitted[1] / transients.freedom(false));
    const StructuralMode& mode = its.mode.mode;
    if (!(explained > kLeastChatterShare) || !(std::abs(its.held_part - 1) < kMostOff) ||
        !(its.held_part_error * noise_N * kErrors < 1) || !(its.held[1] < its.held[0]) ||
        mode.damping_ratio > kMostDamping || !(transients.fading(its.mode) < kMostFading))
      return;
    for (const auto& [part, error] : its.part_of_pass)
      if (error > 0 && std::abs(part - 1) > kMostOff + kErrors * error * noise_N) return;
    if (is_modulation(transients, explained)) return;
    FoundEffect e = named(ExtraModeEffect::info, explained);
    const double values[3] = {mode.natural_frequency_hz, mode.damping_ratio, mode.modal_mass_kg};
    for (std::size_t k = 0; k < 3; ++k) {
      e.parameters.push_back({ExtraModeEffect::info.parameters[k].key, {values[k]}});
      e.standard_errors.push_back(
          {ExtraModeEffect::info.parameters[k].key, {values[k] * its.errors[k] * noise_N}});
    }
    held = its.held;
    report.effects.push_back(std::move(e));
  } else {
    const CutTransients::JudgedMemory m = transients.memory_of(data_.structure);
    const double explained = 1 - m.fitted[2] / m.fitted[0];
    if (!(explained > kLeastChatterShare) ||
        !(1 - m.fitted[2] / m.fitted[1] > kLeastChatterShare) || !(m.all.before > kLeastMemory) ||
        !(m.all.before_error * kErrors < m.all.before) || !(m.held[2] < m.held[1]) ||
        !(m.held[2] < m.held[0]))
      return;
    for (const CutTransients::Memory& p : m.of_pass)
      if (std::abs(p.before - m.all.before) > kMostOff + kErrors * p.before_error) return;
    if (is_modulation(transients, explained)) return;
    held = {m.held[0], m.held[2]};
    report.effects.push_back(named(RegenerationEffect::info, explained));
  }
  FoundEffect& e = report.effects.back();
  e.gap_before = std::sqrt(held[0] / transients.freedom(true));
  e.gap_after = std::sqrt(held[1] / transients.freedom(true));
  if (report.effects.size() == 1) {
    report.gap_before = e.gap_before;
    report.gap_after = e.gap_after;
  }
  report.remarks.emplace_back(
      "the tool vibrates for itself (chatter); the gaps of " + e.name +
      " are of all samples, less what repeats with the tool, the tool led by the measured force");
}

}  // namespace servosense::reconcile
