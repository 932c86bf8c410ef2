// An eccentric encoder that the machine file has. Its force at the angle measured leaves an error
// of the second order, as that of one that is found does (workflow.cpp), so the true angle
// is taken before anything is fitted. The amplitude stays; the phase may be that of another
// power-up.
#include <algorithm>
#include <cmath>

#include "reconcile/drive/workflow.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

constexpr int kAngleRounds = 3;  // each leaves the amplitude's share of what the last one left

EffectSetting* eccentricity_of(DriveModelConfig& model) {
  for (std::size_t i = 0; i < model.effects.count; ++i)
    if (model.effects.settings[i].effect == drive_effect_index(kEccentricity))
      return &model.effects.settings[i];
  return nullptr;
}

}  // namespace

/// The phase that leaves least, found beside all that the model has; the angle is that of the last
/// one. False where it is the given one within its error.
bool DriveWorkflow::refit_known_phase() {
  EffectSetting* error = eccentricity_of(given_);
  bool any = false;
  for (int round = 0; round < kAngleRounds; ++round) {
    EffectSetting quarter = *error;
    quarter.parameters[1].value[0] += kTwoPi / 4;
    const Column across = signals_->response(quarter, data_.model);
    if (across.empty()) return any;
    add_known_terms(true);
    const FitRows rows = fit_rows(problem_, options_.blocks);
    Regression r = regression_of_known(problem_, rows);
    r.add(across);
    const Fit fit = r.fit();
    const Eigen::Index last = fit.coefficients.size() - 1;
    const double along = fitted(fit, kEccentricity).value_or(Told{}).value;
    if (!(std::abs(fit.coefficients(last)) >
          criteria_.certain_standard_errors * fit.standard_errors(last)))
      return any;
    double& phase = error->parameters[1].value[0];
    phase = std::remainder(phase + std::atan2(fit.coefficients(last), along), kTwoPi);
    phase_error_ = fit.standard_errors(last) / std::hypot(fit.coefficients(last), along);
    if (!correct_angle_by(*error)) return false;
    any = true;
  }
  return any;
}

Fit DriveWorkflow::fit_of_known() {
  add_known_terms(true);
  return fit_known();
}

/// Where the true angle leaves less: with the phase of the file, or found anew.
void DriveWorkflow::correct_angle_as_known() {
  const EffectSetting* error = eccentricity_of(given_);
  if (error == nullptr || !(model_.unit_per_turn > 0)) return;
  DriveWorkflow corrected = trial();
  if (!corrected.correct_angle_by(*error)) return;
  corrected.angle_corrected_ = true;
  double least = corrected.fit_of_known().loss;
  DriveWorkflow anew = corrected.trial();
  if (anew.refit_known_phase())
    if (const double loss = anew.fit_of_known().loss; loss < least) {
      least = loss;
      corrected.adopt(std::move(anew));
    }
  if (least < trial().fit_of_known().loss) adopt(std::move(corrected));
}

}  // namespace servosense::reconcile
