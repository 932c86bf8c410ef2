// A cut that is not stable: the tool vibrates for itself, at its own frequency, and remembers it
// from tooth to tooth. No simulation over time follows that for long. So the measured force leads
// the tool: the displacement that a mode answers it with gives the force of the next sample. Noise
// leads it as well, so that vibration has to stand out of it.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "reconcile/cut/transients.hpp"
#include "reconcile/cut/workflow.hpp"
#include "reconcile/select/confidence.hpp"

namespace servosense::reconcile {
namespace {

/// `margin`: standard errors by which it is there where it was not fitted.
FoundEffect named(const CuttingEffectInfo& info, double explained, double margin,
                  const Criteria& criteria) {
  FoundEffect e = found_effect(info);
  e.share_of_residual = std::clamp(explained, 0.0, 1.0);
  e.confidence = confidence_of({.margin = margin}, criteria);
  return e;
}

}  // namespace

void CuttingWorkflow::name_chatter(Report& report, const CutTransients& transients) {
  // A line that is fixed in time is no answer of the tool.
  if (!lines_.empty()) return;
  const bool rigid = data_.structure.x.empty() && data_.structure.y.empty();
  std::array<double, 2> held{};
  FoundEffect e;
  if (rigid) {
    const CutTransients::Judged its =
        transients.best_driven(criteria_.vibration_explains * average_.noise_N * average_.noise_N *
                                   transients.freedom(false) / 4,
                               options_.threads);
    const double explained = 1 - its.fitted[1] / its.fitted[0];
    const double noise_N = std::sqrt(its.fitted[1] / transients.freedom(false));
    const StructuralMode& mode = its.mode.mode;
    if (!(explained > criteria_.vibration_explains) ||
        !(std::abs(its.held_part - 1) < criteria_.vibration_size_off) ||
        !(its.held_part_error * noise_N * criteria_.sure_standard_errors < 1) ||
        !(its.held[1] < its.held[0]) || mode.damping_ratio > criteria_.most_damping ||
        !(transients.fading(its.mode) < criteria_.decay_within_pass))
      return;
    if (!alike_in_passes(its, noise_N) || is_modulation(transients, explained)) return;
    e = named(ExtraModeEffect::info, explained, its.held_part / (its.held_part_error * noise_N),
              criteria_);
    add_mode_parameters(e, its, noise_N);
    held = its.held;
  } else {
    const CutTransients::JudgedMemory m = transients.memory_of(data_.structure);
    const double explained = 1 - m.fitted[2] / m.fitted[0];
    if (!(explained > criteria_.vibration_explains) ||
        !(1 - m.fitted[2] / m.fitted[1] > criteria_.vibration_explains) ||
        !(m.all.before > criteria_.least_regeneration) ||
        !(m.all.before_error * criteria_.sure_standard_errors < m.all.before) ||
        !(m.held[2] < m.held[1]) || !(m.held[2] < m.held[0]))
      return;
    for (const CutTransients::Memory& p : m.of_pass)
      if (std::abs(p.before - m.all.before) >
          criteria_.vibration_size_off + criteria_.sure_standard_errors * p.before_error)
        return;
    if (is_modulation(transients, explained)) return;
    held = {m.held[0], m.held[2]};
    e = named(RegenerationEffect::info, explained, m.all.before / m.all.before_error, criteria_);
  }
  report.remarks.emplace_back(
      "the tool vibrates for itself (chatter); the gaps of " + e.name +
      " are of all samples, less what repeats with the tool, the tool led by the measured force");
  add_vibration(report, std::move(e), held, transients);
}

}  // namespace servosense::reconcile
