// What was found, in names and physical parameters, with what it might be instead.
#include <algorithm>
#include <cmath>
#include <limits>

#include "reconcile/cut/workflow.hpp"
#include "reconcile/select/confidence.hpp"
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

/// Each effect beside the others: its class, its constancy, its runner-up.
void CuttingWorkflow::name_effects(Report& report) {
  for (bool changed = true; changed;) {
    changed = false;
    report.effects.clear();
    std::vector<std::size_t> set = found_.families;
    for (std::size_t i = 0; i < set.size() && !changed; ++i) {
      std::vector<std::size_t> fewer = set;
      fewer.erase(fewer.begin() + static_cast<long>(i));
      const CutFit without = fewer.empty() ? base_ : fit_afresh(fewer);
      std::vector<std::vector<std::size_t>> sets;
      for (std::size_t f = 0; f < families_.size(); ++f)
        if (f != set[i] && compatible(fewer, f)) {
          sets.push_back(fewer);
          sets.back().push_back(f);
        }
      const std::vector<CutFit> others = fit_all(sets, without);
      const double rest = beyond_noise(found_);
      const double gain = beyond_noise(without) - rest;
      FoundEffect effect;
      const CuttingEffectInfo& info = *families_[set[i]].info;
      effect.name = info.name;
      effect.scope = info.scope;
      effect.where = info.where;
      effect.share_of_residual =
          std::clamp(gain / std::max(1e-300, beyond_noise(without)), 0.0, 1.0);
      effect.ranking.push_back({info.name, root(rest), effect.share_of_residual, ""});
      double margin = 8, runner = std::numeric_limits<double>::infinity();
      for (std::size_t k = 0; k < others.size(); ++k) {
        const Family& other = families_[sets[k].back()];
        if (other.info == &info) continue;
        const std::string why = objection(others[k], fewer.size());
        const double its = beyond_noise(others[k]);
        effect.ranking.push_back(
            {other.info->name, root(its),
             std::clamp((beyond_noise(without) - its) / std::max(1e-300, beyond_noise(without)),
                        0.0, 1.0),
             why});
        if (!why.empty()) continue;
        const double more = its - rest;
        const bool alike = more < criteria_.class_gain_of_cut * gain ||
                           errors_between(others[k], found_) < criteria_.class_standard_errors ||
                           root(more) < 0.5 * least_gain();
        if (alike && beyond_noise(without) - its > criteria_.carries_gap * gain) {
          if (std::find(effect.class_members.begin(), effect.class_members.end(),
                        other.info->name) == effect.class_members.end())
            effect.class_members.emplace_back(other.info->name);
        } else if (its < runner) {
          runner = its;
          effect.runner_up = other.info->name;
          effect.runner_up_gap = std::hypot(root(its), average_.noise_N);
          margin = errors_between(others[k], found_);
        }
      }
      std::stable_sort(effect.ranking.begin(), effect.ranking.end(),
                       [](const RankedCandidate& a, const RankedCandidate& b) {
                         return a.gap_after < b.gap_after;
                       });
      if (!effect.class_members.empty()) effect.splitting_motion = info.splitting_experiment;
      std::string why = inconstancy(found_, without);
      if (why.empty() && effect.class_members.size() > 2)
        why = "this cut cannot tell it from " + std::to_string(effect.class_members.size()) +
              " other effects";
      if (!why.empty()) {
        why_nothing_ = effect.name + ": " + why;
        ranking_ = effect.ranking;
        found_ = without;
        changed = true;
        break;
      }
      effect.confidence =
          confidence_of(std::min(1.0, explained(base_, found_) + 0.05), margin, criteria_);
      effect.parameters = parameters(found_, i, false);
      effect.standard_errors = parameters(found_, i, true);
      report.effects.push_back(std::move(effect));
    }
    if (changed && !found_.families.empty()) {
      // What is left must still carry the gap.
      if (explained(base_, found_) < criteria_.carries_gap) found_ = base_;
    }
  }
}

}  // namespace servosense::reconcile
