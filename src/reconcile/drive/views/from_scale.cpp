// What a scale on the stage shows, added to what the forces show.
#include <algorithm>
#include <string>

#include "reconcile/drive/views/scale.hpp"
#include "reconcile/drive/workflow.hpp"
#include "reconcile/select/standing.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

/// 3.2 um, 41 urad.
std::string micro(double value, const std::string& unit) {
  return printed(1e6 * value, 3) + " u" + unit;
}

/// How wide backlash is shows between motor and scale without any law of friction.
void take_width(DriveOutcome& outcome, const LostMotion& lost, const std::string& unit) {
  const std::size_t backlash = drive_effect_index(kBacklash);
  for (FoundEffect& effect : outcome.report.effects) {
    if (effect.name != kBacklash || !(lost.width > 2 * lost.windup)) continue;
    double& width = effect.parameters[0].values[0];
    if (effect.gap_unit.empty())
      outcome.report.remarks.push_back(
          "the width of the backlash is what the scale shows; the forces alone would say " +
          micro(width, unit));
    width = lost.width;
    effect.standard_errors[0].values[0] = lost.error;
    const auto set = [&](EffectSetting& setting) {
      if (setting.effect == backlash) setting.parameters[0].value[0] = lost.width;
    };
    for (EffectSetting& setting : outcome.added) set(setting);
    for (std::size_t i = 0; i < outcome.model.effects.count; ++i)
      set(outcome.model.effects.settings[i]);
  }
}

}  // namespace

/// What a scale on the stage shows beside the forces.
void DriveWorkflow::add_from_scale(DriveOutcome& outcome) const {
  Report& report = outcome.report;
  const auto named = [&](const std::string& name) { return reports_effect(report, name); };
  const SeenInForces seen{
      named(kEccentricity) || data_.model.effects.find(kEccentricity) != nullptr,
      named("spring-load") || data_.model.effects.find("spring-load") != nullptr};
  const auto scale = compare_scale(situation(), problem_, seen, options_);
  if (!scale) return;
  for (const NotTestable& n : scale->not_testable) report.not_testable.push_back(n);
  for (std::size_t i = 0; i < scale->effects.size(); ++i) {
    const FoundEffect& effect = scale->effects[i];
    if (named(effect.name)) continue;
    report.effects.push_back(effect);
    report.verdict = with_a_name(report.verdict);
    outcome.added.push_back(scale->settings[i]);
    // The motor's encoder does not see the error between screw and scale.
    if (effect.name != kLeadError) add_effect(outcome.model.effects, scale->settings[i]);
  }
  if (!scale->effects.empty() && !scale->at_floor) {
    if (report.verdict == Verdict::explained) report.verdict = Verdict::partly_explained;
    report.remarks.push_back("between motor and scale " + micro(scale->left, scale->between.unit) +
                             " rms are left that no effect here explains");
  }
  if (scale->lost) take_width(outcome, *scale->lost, scale->between.unit);
  report.between_encoders = scale->between;
  if (const auto& hz = scale->between.held_resonance_hz)
    report.remarks.push_back("between motor and scale: with the motor held, the load swings at " +
                             printed(hz->value, 3) + " +- " + printed(hz->error, 2) + " Hz");
  if (named(kLeadError))
    report.remarks.push_back(
        "lead-error lies between motor and scale: the model keeps the motor's counts and does "
        "without it");
}

}  // namespace servosense::reconcile
