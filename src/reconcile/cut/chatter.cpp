// A cut that is not stable: the tool vibrates for itself, at its own frequency, and remembers it
// from tooth to tooth. No simulation over time follows that for long. So the measured force leads
// the tool: the displacement that a mode answers it with gives the force of the next sample. Noise
// leads it as well, so that vibration has to stand out of it.
#include <algorithm>
#include <array>
#include <cmath>

#include "reconcile/cut/transients.hpp"
#include "reconcile/cut/workflow.hpp"
#include "reconcile/select/confidence.hpp"

namespace servosense::reconcile {
namespace {

/// `margin`: standard errors by which it is there where it was not fitted.
FoundEffect named(const CuttingEffectInfo& info, double explained, double margin,
                  const Criteria& criteria) {
  FoundEffect e;
  e.name = info.name;
  e.scope = info.scope;
  e.where = info.where;
  e.share_of_residual = std::clamp(explained, 0.0, 1.0);
  e.confidence = confidence_of(1, margin, criteria);
  return e;
}

}  // namespace

void CuttingWorkflow::name_chatter(Report& report, const CutTransients& transients) {
  // A line that is fixed in time is no answer of the tool.
  if (!lines_.empty()) return;
  const bool rigid = data_.structure.x.empty() && data_.structure.y.empty();
  std::array<double, 2> held{};
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
    for (const auto& [part, error] : its.part_of_pass)
      if (error > 0 && std::abs(part - 1) > criteria_.vibration_size_off +
                                                criteria_.sure_standard_errors * error * noise_N)
        return;
    if (is_modulation(transients, explained)) return;
    FoundEffect e = named(ExtraModeEffect::info, explained,
                          its.held_part / (its.held_part_error * noise_N), criteria_);
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
    report.effects.push_back(
        named(RegenerationEffect::info, explained, m.all.before / m.all.before_error, criteria_));
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
