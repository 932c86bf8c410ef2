// What was found, in names and physical parameters, with what it might be instead.
#include <algorithm>
#include <cmath>

#include "reconcile/cut/workflow.hpp"
#include "reconcile/select/standing.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {
FittedEffect CuttingWorkflow::effect_of(const CutFit& fit, std::size_t position) const {
  return {fit,
          families_[fit.families[position]],
          position,
          data_.cut.feed_per_tooth_m,
          given_.coefficients[0],
          criteria_};
}

std::vector<NamedValue> CuttingWorkflow::parameters(const CutFit& fit, std::size_t position,
                                                    bool errors) const {
  const FittedEffect effect = effect_of(fit, position);
  return cut_effect(effect.family.info).parameters(effect, errors);
}

/// An effect beside the others: its class and its runner-up.
FoundEffect CuttingWorkflow::described(std::size_t position, const CutFit& without) const {
  const std::size_t family = found_.families[position];
  const CuttingEffectInfo& info = *families_[family].info;
  const Ranking others = rank_beside(without.families, without, family);
  const double before = beyond_noise(without), rest = beyond_noise(found_), gain = before - rest;
  FoundEffect effect = found_effect(info);
  effect.ranking.push_back(row_of(info.name, found_, without, 0, ""));
  effect.share_of_residual = effect.ranking.front().explained;
  std::vector<Rival> rivals;
  for (const std::size_t i : others.order) {
    const CutFit& other = others.fits[i];
    const std::string name = label_of(others, i);
    if (name == info.name) continue;
    effect.ranking.push_back(row_of(name, other, without, 0, others.objections[i]));
    if (!others.objections[i].empty()) continue;
    const double its = beyond_noise(other), more = its - rest;
    const double behind = errors_between(other, found_);
    const bool alike = more < criteria_.class_gain_of_cut * gain ||
                       behind < criteria_.class_standard_errors || root(more) < 0.5 * least_gain();
    rivals.push_back({name, std::hypot(root(its), average_.noise_N), behind,
                      alike && before - its > criteria_.carries_gap * gain});
  }
  std::ranges::stable_sort(effect.ranking, {}, &RankedCandidate::gap_after);
  stand_beside(effect, rivals, info.splitting_experiment, {.explained = explained(base_, found_)},
               criteria_);
  effect.parameters = parameters(found_, position, false);
  effect.standard_errors = parameters(found_, position, true);
  return effect;
}

/// All that were found, but for what has no class that can be told, or no size of its own.
void CuttingWorkflow::name_effects(Report& report) {
  for (std::size_t i = 0; i < found_.families.size();) {
    CutFit without = fit_without(i);
    FoundEffect effect = described(i, without);
    std::string why = inconstancy(found_, without);
    if (why.empty()) why = class_too_large(effect.class_members.size(), "this cut");
    if (why.empty() && effect.confidence < criteria_.least_confidence) why = kAsLikelyWrong;
    if (why.empty()) {
      report.effects.push_back(std::move(effect));
      ++i;
      continue;
    }
    why_nothing_ = effect.name + ": " + why;
    ranking_ = effect.ranking;
    found_ = std::move(without);
    // What is left must still carry the gap.
    if (!found_.families.empty() && explained(base_, found_) < criteria_.carries_gap)
      found_ = base_;
    report.effects.clear();
    i = 0;
  }
}

}  // namespace servosense::reconcile
