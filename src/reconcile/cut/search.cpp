// Which set of effects leaves least? Candidates one by one, in pairs, backwards.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "reconcile/cut/workflow.hpp"
#include "reconcile/numerics/parallel_jobs.hpp"
#include "reconcile/select/compare.hpp"
#include "reconcile/select/standing.hpp"
#include "reconcile/select/steadiness.hpp"
#include "reconcile/select/subsets.hpp"

namespace servosense::reconcile {
namespace {

/// Families of one name that are fitted to the end.
constexpr std::size_t kNamesakes = 3;
/// Cut-off of a recorder's filter in sample rates: below half of it, and not much.
constexpr double kLowestFilter = 0.34, kHighestFilter = 0.51, kFilterStep = 0.04;

}  // namespace

bool CuttingWorkflow::compatible(const std::vector<std::size_t>& set, std::size_t more) const {
  if (!families_[more].startable()) return false;
  for (const std::size_t f : set) {
    if (f == more) return false;
    if (!families_[f].twin.empty() && families_[f].twin == families_[more].twin &&
        families_[f].tooth == families_[more].tooth)
      return false;
    // Two ways for one mode: not both.
    if (families_[f].info == families_[more].info && families_[f].twin == "extra-mode")
      return false;
  }
  return true;
}

std::vector<const Family*> CuttingWorkflow::chosen(const std::vector<std::size_t>& set) const {
  std::vector<const Family*> out;
  for (const std::size_t f : set) out.push_back(&families_[f]);
  return out;
}

CutFit CuttingWorkflow::fit(const std::vector<std::size_t>& set, const CutFit& from) const {
  return fitter_->fit(chosen(set), set, from);
}

/// From where the model stood without effects and from where it stands with them: the better of
/// both. A valley of its own must not count as the gain of an effect.
CutFit CuttingWorkflow::fit_afresh(const std::vector<std::size_t>& set) const {
  CutFit from_base = fit(set, base_), from_found = fit(set, found_);
  return from_base.loss < from_found.loss ? from_base : from_found;
}

/// Averages about what was found, and base and found refitted to them: losses of one average do not
/// compare with those of another.
void CuttingWorkflow::average_about(const std::vector<std::size_t>& set) {
  measure_again(found_);
  found_ = fitter_->fit_again(chosen(set), set, found_);
  measure_again(found_);
  found_ = fit(set, found_);
  base_ = fit_afresh({});
}

/// Goes on with this set. Where resonances are narrow, the scan sees those of what the set leaves.
void CuttingWorkflow::go_on_with(const std::vector<std::size_t>& set, CutFit its) {
  found_ = std::move(its);
  average_about(set);
  const std::vector<Family> anew = fitter_->families(found_);
  for (std::size_t f = 0; f < families_.size(); ++f) {
    if (std::find(set.begin(), set.end(), f) != set.end()) continue;
    std::vector<std::vector<double>>& starts = families_[f].starts;
    for (const std::vector<double>& start : anew[f].starts)
      if (std::find(starts.begin(), starts.end(), start) == starts.end()) starts.push_back(start);
  }
}

/// Of a name with a family for every tooth those are fitted to the end that leave least after a few
/// rounds.
std::vector<CutFit> CuttingWorkflow::fit_all(const std::vector<std::vector<std::size_t>>& sets,
                                             const CutFit& from) const {
  std::vector<CutFit> fits(sets.size());
  const auto info_of = [&](std::size_t i) { return families_[sets[i].back()].info; };
  std::vector<std::size_t> first_look, rest;
  for (std::size_t i = 0; i < sets.size(); ++i) {
    std::size_t namesakes = 0;
    for (std::size_t k = 0; k < sets.size(); ++k) namesakes += info_of(k) == info_of(i) ? 1 : 0;
    (namesakes > kNamesakes ? first_look : rest).push_back(i);
  }
  run_reporting(
      "looking at effects of every tooth", first_look.size(),
      [&](std::size_t i) {
        const std::vector<std::size_t>& set = sets[first_look[i]];
        fits[first_look[i]] = fitter_->fit_coarsely(chosen(set), set, from);
      },
      options_);
  std::stable_sort(first_look.begin(), first_look.end(),
                   [&](std::size_t a, std::size_t b) { return fits[a].loss < fits[b].loss; });
  for (std::size_t i = 0; i < first_look.size(); ++i) {
    const auto before =
        std::count_if(first_look.begin(), first_look.begin() + static_cast<long>(i),
                      [&](std::size_t k) { return info_of(k) == info_of(first_look[i]); });
    if (static_cast<std::size_t>(before) < kNamesakes) rest.push_back(first_look[i]);
  }
  run_reporting(
      "fitting the cut with each effect", rest.size(),
      [&](std::size_t i) { fits[rest[i]] = fit(sets[rest[i]], from); }, options_);
  return fits;
}

/// Difference of two losses in its standard errors, on the blocks fitted.
double CuttingWorkflow::errors_between(const CutFit& worse, const CutFit& better) const {
  const auto fitted = [&](const CutFit& fit) {
    Column losses;
    for (std::size_t b = 0; b < average_.blocks.size(); ++b)
      if (!average_.blocks[b].held_out) losses.push_back(fit.block_loss[b]);
    return losses;
  };
  return standard_errors_between(fitted(worse), fitted(better));
}

/// The rule of physics that an effect of a fit breaks; empty when it keeps them all.
std::string CuttingWorkflow::objection(const CutFit& fit, std::size_t position) const {
  const FittedEffect effect = effect_of(fit, position);
  if (std::string why = cut_effect(effect.family.info).objection(effect); !why.empty()) return why;
  if (!(fit.state.coefficients[0] > 0)) return "shape fits, physics does not: force pulls the chip";
  return {};
}

/// A cause has one size all along the record; a proxy grows or fades with it, or comes and goes.
std::string CuttingWorkflow::inconstancy(const CutFit& with, const CutFit& without) const {
  Steadiness steadiness(average_.blocks.size());
  for (std::size_t k = 0; k < average_.blocks.size(); ++k) {
    const CutBlock& b = average_.blocks[k];
    if (b.held_out) continue;
    const Eigen::VectorXd effect = with.bins[b.level] - without.bins[b.level];
    for (Eigen::Index r = 0; r < effect.size(); ++r)
      steadiness.add(k, effect(r), b.count(r) > 0 ? b.mean(r) - with.bins[b.level](r) : 0,
                     b.count(r));
  }
  if (steadiness.unsteadiness(average_.noise_N * average_.noise_N) > criteria_.largest_unsteadiness)
    return kUnsteadySize;
  // Size of the effect in each block, 1 on the whole, and its trend over time.
  std::vector<double> t, a, w;
  for (std::size_t k = 0; k < average_.blocks.size(); ++k) {
    if (!(steadiness.power(k) > 0)) continue;
    t.push_back(average_.blocks[k].time_s);
    a.push_back(steadiness.size(k));
    w.push_back(steadiness.power(k));
  }
  if (t.size() < 6) return {};
  double sw = 0, st = 0, sa = 0;
  for (std::size_t i = 0; i < t.size(); ++i) {
    sw += w[i];
    st += w[i] * t[i];
    sa += w[i] * a[i];
  }
  double stt = 0, sta = 0;
  for (std::size_t i = 0; i < t.size(); ++i) {
    stt += w[i] * (t[i] - st / sw) * (t[i] - st / sw);
    sta += w[i] * (t[i] - st / sw) * (a[i] - sa / sw);
  }
  if (!(stt > 0)) return {};
  const double slope = sta / stt;
  double rest = 0;
  for (std::size_t i = 0; i < t.size(); ++i) {
    const double r = a[i] - sa / sw - slope * (t[i] - st / sw);
    rest += w[i] * r * r;
  }
  const double error = std::sqrt(rest / (static_cast<double>(t.size()) - 2) / stt);
  const double change = slope * (t.back() - t.front());
  if (std::abs(change) > criteria_.largest_inconstancy &&
      std::abs(slope) > criteria_.certain_standard_errors * error)
    return kUnsteadySize;
  return {};
}

bool CuttingWorkflow::clearly_better(const CutFit& its, const CutFit& than) const {
  return root(beyond_noise(than) - beyond_noise(its)) > chance_gain() &&
         errors_between(than, its) > criteria_.sure_standard_errors;
}

/// Whether a tool that does not vibrate fits clearly better than the modes of the file, or as well
/// as these with an effect of theirs. Teeth that cut alike leave a surface that takes the vibration
/// out of the next chip: then modes that are remembered and none at all are one in a steady cut.
bool CuttingWorkflow::stiff_tool_fits(CutFitter& stiff, CutFit& base) const {
  if (given_.structure.x.empty() && given_.structure.y.empty()) return false;
  base = stiff.calibrate_with({}, given_.cut.regeneration, base_);
  std::vector<std::size_t> rest = found_.families;
  std::erase_if(rest, [&](std::size_t f) {
    return families_[f].info == &RegenerationEffect::info ||
           families_[f].info == &ProcessDampingEffect::info;
  });
  const CutFit its = rest.empty() ? base : stiff.fit(chosen(rest), rest, base);
  return clearly_better(its, found_) ||
         (rest.size() < found_.families.size() && !clearly_better(found_, its));
}

/// Modes that the machine does not have, or that the cut remembers though the file denies it: what
/// they leave is no effect of the steady cut. The search begins anew without them.
void CuttingWorkflow::look_without_structure() {
  CutFitter stiff = *fitter_;
  CutFit base;
  if (!stiff_tool_fits(stiff, base)) return;
  fitter_.emplace(std::move(stiff));
  base_ = std::move(base);
  given_.structure = {};
  calibrate_again(1);
  families_ = fitter_->families(base_);
  // Not for other modes than those of the file.
  std::erase_if(families_, [](const Family& f) { return f.info == &ExtraModeEffect::info; });
  why_nothing_.clear();
  search();
}

/// Goes over to the other paths of the teeth, trochoids or circles, where these leave less beside
/// the same effects. No cut is off by one or the other: it is how a simulation was made.
bool CuttingWorkflow::other_paths_fit(const CutFit& best) {
  CutFitter other = *fitter_;
  CutFit base = other.calibrate_other_paths(base_);
  const CutFit its =
      best.families.empty() ? base : other.fit(chosen(best.families), best.families, base);
  // Two effects can take on nearly all of the difference, and are then far off.
  const bool surely = best.families.size() > 1 &&
                      errors_between(best, its) > criteria_.beyond_doubt_standard_errors;
  if (!surely && !clearly_better(its, best)) return false;
  fitter_.emplace(std::move(other));
  base_ = found_ = std::move(base);
  return true;
}

CutFit CuttingWorkflow::with_offset(const CutFit& from) const {
  const Family offset = CutFitter::offset();
  std::vector<std::size_t> indices = from.families;
  std::vector<const Family*> all = chosen(indices);
  all.push_back(&offset);
  indices.push_back(families_.size());
  return fitter_->fit(all, indices, from);
}

/// Under a force that hardly changes over the turn, at one feed, coefficients and offset are one:
/// the fit would put any force into both, with opposite signs.
bool CuttingWorkflow::tells_offset(const CutFit& fit) const {
  for (std::size_t i = 0; i < fit.unknowns.size(); ++i) {
    const Unknown::Kind kind = fit.unknowns[i].kind;
    if ((kind == Unknown::Kind::offset_x || kind == Unknown::Kind::offset_y) &&
        fit.inflations[i] > criteria_.most_inflation)
      return false;
  }
  return true;
}

/// Whether an offset of the sensor, alone or beside the best candidate, takes off what no effect
/// does. An edge force that takes off as much comes first: under an even force they are one.
bool CuttingWorkflow::offset_shows(const CutFit& best) const {
  if (fitter_->has_offset()) return false;
  const CutFit alone = with_offset(found_);
  // Not by what is uneven with the effect alone: an offset would be had for a large one.
  if (!tells_offset(alone)) return false;
  if (clearly_better(alone, best)) return true;
  const CutFit beside = with_offset(best);
  if (!clearly_better(beside, best)) return false;
  for (std::size_t f = 0; f < families_.size(); ++f) {
    if (!families_[f].edges || !compatible(best.families, f)) continue;
    std::vector<std::size_t> set = best.families;
    set.push_back(f);
    if (!clearly_better(beside, fit(set, best))) return false;
  }
  return true;
}

/// Whether a filter of the recorder takes off what no effect does: what fits behind it, calibrated.
std::optional<std::pair<CutFitter, CutFit>> CuttingWorkflow::filter_shows(
    const CutFit& best) const {
  const CutLevel& level = average_.levels.front();
  if (filter_hz_ > 0 || !(level.samples_per_turn > 0)) return std::nullopt;
  const double rate_hz = level.samples_per_turn * level.speed_rad_s / kTwoPi;
  std::optional<std::pair<CutFitter, CutFit>> winner;
  double least = CutFit{}.loss;
  for (double part = kLowestFilter; part < kHighestFilter; part += kFilterStep) {
    CutFitter fitter = *fitter_;
    CutFit behind = fitter.calibrate_filtered(base_, part * rate_hz);
    if (!(behind.loss < least)) continue;
    least = behind.loss;
    winner.emplace(std::move(fitter), std::move(behind));
  }
  if (!winner || root(beyond_noise(best) - beyond_noise(winner->second)) < least_gain() ||
      errors_between(best, winner->second) < criteria_.sure_standard_errors)
    return std::nullopt;
  return winner;
}

/// All that may come to a set, fitted beside it, from `base`, and in order of what they leave;
/// without one family.
CuttingWorkflow::Ranking CuttingWorkflow::rank_beside(const std::vector<std::size_t>& set,
                                                      const CutFit& base,
                                                      std::optional<std::size_t> without) const {
  Ranking r;
  for (std::size_t f = 0; f < families_.size(); ++f)
    if (f != without && compatible(set, f)) {
      r.sets.push_back(set);
      r.sets.back().push_back(f);
    }
  r.fits = fit_all(r.sets, base);
  r.order.resize(r.fits.size());
  std::iota(r.order.begin(), r.order.end(), std::size_t{0});
  std::stable_sort(r.order.begin(), r.order.end(),
                   [&](std::size_t a, std::size_t b) { return r.fits[a].loss < r.fits[b].loss; });
  r.objections.resize(r.fits.size());
  for (const std::size_t i : r.order) {
    r.objections[i] = objection(r.fits[i], set.size());
    if (!r.best && r.objections[i].empty()) r.best = i;
  }
  return r;
}

/// What is left after `fit`, and its share of what was left after `base`.
RankedCandidate CuttingWorkflow::row_of(std::string name, const CutFit& fit, const CutFit& base,
                                        double worth, std::string objection) const {
  const double before = beyond_noise(base), left = beyond_noise(fit);
  return {std::move(name), root(left),
          std::clamp((before - left) / std::max({1e-300, worth * worth, before}), 0.0, 1.0),
          std::move(objection)};
}

/// Goes over to the other paths of the teeth where they leave less beside `best`, and begins anew.
bool CuttingWorkflow::begin_on_other_paths(const CutFit& best, std::vector<std::size_t>& set) {
  if (!other_paths_fit(best)) return false;
  calibrate_again(1);
  found_ = base_;
  families_ = fitter_->families(base_);
  set.clear();
  return true;
}

/// What no effect does, but paths, sensor or recorder: then the search begins anew.
bool CuttingWorkflow::not_of_the_cut(const CutFit& best, std::vector<std::size_t>& set,
                                     bool& paths_compared) {
  if (!paths_compared) {
    paths_compared = true;
    if (begin_on_other_paths(best, set)) return true;
  }
  if (offset_shows(best)) {
    fitter_->always_with_offset();
    base_ = found_ = fitter_->calibrate(base_);
    set.clear();
    return true;
  }
  if (!set.empty()) return false;
  auto behind = filter_shows(best);
  if (!behind) return false;
  fitter_.emplace(std::move(behind->first));
  base_ = found_ = std::move(behind->second);
  filter_hz_ = base_.state.filter_hz;
  return true;
}

/// One does not carry the gap: perhaps two do. True when a pair was taken.
bool CuttingWorkflow::take_pair(const Ranking& r, std::vector<std::size_t>& set) {
  const std::vector<std::size_t> top =
      best_for_pairs(r.order, [&](std::size_t i, const std::vector<std::size_t>& before) {
        return std::ranges::none_of(
            before, [&](std::size_t k) { return label_of(r, k) == label_of(r, i); });
      });
  struct Pair {
    std::vector<std::size_t> set;
    std::size_t better;  // of the two alone
  };
  std::vector<Pair> pairs;
  for_each_pair(top, [&](std::size_t a, std::size_t b) {
    if (!compatible({r.sets[a].back()}, r.sets[b].back())) return;
    pairs.push_back({r.sets[a], a});
    pairs.back().set.push_back(r.sets[b].back());
  });
  std::vector<CutFit> done(pairs.size());
  run_reporting(
      "fitting pairs of effects", pairs.size(),
      [&](std::size_t p) { done[p] = fit(pairs[p].set, r.fits[pairs[p].better]); }, options_);
  std::size_t winner = done.size();
  for (std::size_t p = 0; p < done.size(); ++p) {
    if (!objection(done[p], set.size()).empty() || !objection(done[p], set.size() + 1).empty())
      continue;
    if (winner == done.size() || done[p].loss < done[winner].loss) winner = p;
  }
  const double rest = beyond_noise(r.fits[*r.best]);
  if (winner == done.size() || !(beyond_noise(done[winner]) < criteria_.pair_leaves * rest) ||
      !(root(rest - beyond_noise(done[winner])) > floor_N()) ||
      !(explained(found_, done[winner]) > criteria_.carries_gap))
    return false;
  set = pairs[winner].set;
  go_on_with(set, std::move(done[winner]));
  return true;
}

/// Why the best of a ranking gets no name; empty when it may.
std::string CuttingWorkflow::objection_to_best(const Ranking& r, double worth) const {
  const double now = beyond_noise(found_);
  if (!r.best || root(now - beyond_noise(r.fits[*r.best])) < worth ||
      errors_between(found_, r.fits[*r.best]) < criteria_.sure_standard_errors)
    return kNothingBeyondNoise;
  const std::size_t first = r.order[0];
  const CutFit &best = r.fits[*r.best], &front = r.fits[first];
  if (first != *r.best && root(beyond_noise(best) - beyond_noise(front)) > least_gain() &&
      beyond_noise(front) < 0.5 * beyond_noise(best))
    return label_of(r, first) + ": " + r.objections[first];
  return {};
}

CutFit CuttingWorkflow::fit_without(std::size_t position) const {
  std::vector<std::size_t> fewer = found_.families;
  fewer.erase(fewer.begin() + static_cast<long>(position));
  return fewer.empty() ? base_ : fit_afresh(fewer);
}

void CuttingWorkflow::prune() {
  CutFit without;
  prune_needless(
      found_.families, floor_N(),
      [&](std::size_t i) {
        without = fit_without(i);
        return beyond_noise(without) - beyond_noise(found_);
      },
      [&](std::size_t /*i*/) { found_ = without; });
}

void CuttingWorkflow::search() {
  found_ = base_;
  std::vector<std::size_t> set;
  bool paths_compared = false, beside_next_compared = false;
  while (set.size() < options_.most_effects) {
    const double now = beyond_noise(found_);
    const double worth = set.empty() ? least_gain() : floor_N();
    if (!set.empty() && root(now) < worth) break;
    const Ranking r = rank_beside(set, found_);
    ranking_.clear();
    for (const std::size_t i : r.order)
      ranking_.push_back(row_of(label_of(r, i), r.fits[i], found_, worth, r.objections[i]));
    if (root(now) > worth && not_of_the_cut(r.best ? r.fits[*r.best] : found_, set, paths_compared))
      continue;
    if (std::string why = objection_to_best(r, worth); !why.empty()) {
      why_nothing_ = std::move(why);
      break;
    }
    const CutFit& best = r.fits[*r.best];
    const double share = explained(found_, best);
    if (share < criteria_.enough_for_a_cut && root(beyond_noise(best)) > floor_N() &&
        take_pair(r, set))
      continue;
    if (share < criteria_.carries_gap) {
      if (!set.empty() && !beside_next_compared) {
        beside_next_compared = true;
        if (begin_on_other_paths(best, set)) continue;
      }
      why_nothing_ = explains_too_little(label_of(r, *r.best), share);
      break;
    }
    set = r.sets[*r.best];
    go_on_with(set, best);
  }
  // Beside all of them, too: fewer may have stood in for what another one does.
  if (set.size() > 1 && other_paths_fit(found_)) {
    found_ = fit_afresh(set);
    average_about(set);
  }
  prune();
}

}  // namespace servosense::reconcile
