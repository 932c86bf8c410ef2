// Presliding distance, timing and inertia were found without the effects that a first pass names:
// once more with them.
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "reconcile/drive/workflow.hpp"

namespace servosense::reconcile {
namespace {

constexpr int kMostRounds = 2;  // of calibration with the effects found

}  // namespace

bool DriveWorkflow::has_accepted(std::string_view name) const {
  return std::any_of(decision_.accepted.begin(), decision_.accepted.end(),
                     [&](const Accepted& a) { return candidates_[a.candidate].name == name; });
}

bool DriveWorkflow::acts_at_reversals(const Accepted& accepted) const {
  const std::string& name = candidates_[accepted.candidate].name;
  return name == "presliding-hysteresis" || name == kBacklash;
}

/// The timing was fitted without the other effects: what repeats with the motion, as ripple does,
/// makes the effort look late or early by what the loop answers to it. Beside them it may be usual.
bool DriveWorkflow::still_late_beside(const std::vector<Column>& backlash) {
  const std::size_t others = found_.size();
  found_.insert(found_.end(), backlash.begin(), backlash.end());
  if (!timing_found_ && !found_.empty()) fit_timing();
  found_.resize(others);
  return timing_open_;
}

/// Once more, beside the effects that were accepted. `reversals`: those that act there, too;
/// otherwise the presliding distance takes what it can of them.
Expected<Done> DriveWorkflow::calibrate_with_accepted(bool reversals) {
  acting_.clear();
  if (!reversals)
    longest_beside_backlash_ = 0;  // nor is there backlash that it must leave room for
  std::vector<Column> backlash, late;
  for (const Accepted& accepted : decision_.accepted) {
    const Candidate& candidate = candidates_[accepted.candidate];
    const std::string& name = candidate.name;
    const bool presliding = name == "presliding-hysteresis";
    if (!reversals && acts_at_reversals(accepted)) continue;
    if (drive_effect_index(name) != kDriveEffectCount)
      acting_.push_back(setting_of(name, accepted.meaning, data_.turns()));
    if (presliding) {
      // The presliding distance was fitted to both; its ladder now begins at the short one beside
      // the bristle.
      presliding_found_ = true;
      model_.friction_knee =
          std::min(model_.friction_knee, criteria_.presliding_span * accepted.theta[1]);
    }
    // The same, but how short the presliding distance is comes out beside a spring that is wound
    // up.
    const bool winding = name == "flexible-coupling" && accepted.meaning.like_bristle;
    if (winding) model_.friction_knee = std::min(model_.friction_knee, accepted.theta[3]);
    // As it swung over before is not how it does.
    coulomb_found_ = coulomb_found_ || name == "coulomb-friction";
    if (name == "coulomb-friction") continue;
    std::vector<Column>& to = name == kBacklash ? backlash : candidate.timing ? late : found_;
    std::vector<Column> columns = candidate.columns(accepted.theta);
    if (winding) columns.resize(1);  // without the presliding distance's
    for (Column& column : columns) to.push_back(std::move(column));
  }
  if (!late.empty() && still_late_beside(backlash)) {
    timing_found_ = true;
    for (Column& column : late) found_.push_back(std::move(column));
  }
  if (!backlash.empty()) {
    // The presliding distance was fitted without it.
    if (std::vector<Column> refitted = fit_presliding_and_backlash(); !refitted.empty())
      backlash = std::move(refitted);
    for (Column& column : backlash) found_.push_back(std::move(column));
    longest_beside_backlash_ = model_.friction_knee;
  }
  if (auto ok = calibrate(); !ok) return ok;
  found_.clear();
  coulomb_found_ = false;
  add_known_terms();
  return Done{};
}

/// Effects that show only then were not in the calibration either.
Expected<Done> DriveWorkflow::calibrate_and_decide(bool reversals) {
  std::vector<std::string> beside;
  const auto is_new = [&](const Accepted& a) {
    return std::find(beside.begin(), beside.end(), candidates_[a.candidate].name) == beside.end();
  };
  for (int round = 0; round < kMostRounds; ++round) {
    if (std::none_of(decision_.accepted.begin(), decision_.accepted.end(), is_new)) break;
    beside.clear();
    for (const Accepted& accepted : decision_.accepted)
      if (reversals || !acts_at_reversals(accepted))
        beside.push_back(candidates_[accepted.candidate].name);
    if (auto ok = calibrate_with_accepted(reversals); !ok) return ok;
    decide_by(options_);
    reversals = true;
  }
  return Done{};
}

/// What these effects gain counts against the presliding distance that was fitted without them,
/// beside the others.
bool DriveWorkflow::beyond_presliding_alone(const Decision& presliding_alone) const {
  const Report& with = decision_.report;
  const double gain = presliding_alone.loss - decision_.loss;
  const double least =
      options_.least_gain(with.floors.used, with.effort_rms, has_accepted("presliding-hysteresis"));
  const double beyond_noise = presliding_alone.loss - with.floors.used * with.floors.used;
  const double before = presliding_alone.report.gap_after;
  return gain > least * least && gain > criteria_.least_explained * beyond_noise &&
         1 - std::pow(with.gap_after / before, 2) >
             criteria_.least_held_out_share * gain / presliding_alone.loss;
}

/// Backlash or a bristle beside another effect may be what was wrong with a presliding distance
/// that was fitted without that effect: the presliding distance first. Where it then leaves nothing
/// for them, the better of the two.
Expected<Done> DriveWorkflow::recalibrate() {
  const bool all = std::all_of(decision_.accepted.begin(), decision_.accepted.end(),
                               [&](const Accepted& a) { return acts_at_reversals(a); });
  if (!any_at_reversals() || all) return calibrate_and_decide(true);
  DriveWorkflow alone = trial();
  if (auto ok = alone.calibrate_and_decide(false); !ok) return ok;
  if (!alone.any_at_reversals()) {
    DriveWorkflow with = trial();
    if (with.calibrate_and_decide(true).has_value() && with.any_at_reversals() &&
        with.beyond_presliding_alone(alone.decision_)) {
      adopt(std::move(with));
      return Done{};
    }
  }
  adopt(std::move(alone));
  return Done{};
}

bool DriveWorkflow::any_at_reversals() const {
  return std::any_of(decision_.accepted.begin(), decision_.accepted.end(),
                     [&](const Accepted& a) { return acts_at_reversals(a); });
}

/// Presliding distance, timing and inertia were found without the effects of the first pass: once
/// more with them.
Expected<Done> DriveWorkflow::repeat_with_accepted() {
  correct_angle();
  if (auto ok = recalibrate(); !ok) return ok;
  if (angle_corrected_ && eccentricity() == nullptr &&
      data_.model.effects.find(kEccentricity) == nullptr) {
    // It does not stand beside the others: then nor does the correction.
    const double presliding_speed = signals_->presliding_speed;
    *signals_ = DriveSignals(data_, signals_->corner_hz);
    signals_->presliding_speed = presliding_speed;
    angle_corrected_ = false;
    add_coordinates();
    add_known_terms();
    decide_by(options_);
  }
  // Only beside loads that are known it shows when the load behind backlash leaves its flank.
  refit_presliding_beside_backlash(options_);
  return Done{};
}

}  // namespace servosense::reconcile
