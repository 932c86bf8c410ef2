// Which set of effects leaves least? Candidates one by one, in pairs, backwards.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "reconcile/cut/workflow.hpp"
#include "reconcile/numerics/parallel_jobs.hpp"

namespace servosense::reconcile {
namespace {

constexpr std::size_t kTop = 6;
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

/// Difference of two losses in its standard errors, block by block.
double CuttingWorkflow::errors_between(const CutFit& worse, const CutFit& better) const {
  double sum = 0, square = 0, n = 0;
  for (std::size_t b = 0; b < average_.blocks.size(); ++b) {
    if (average_.blocks[b].held_out) continue;
    const double d = worse.block_loss[b] - better.block_loss[b];
    sum += d;
    square += d * d;
    ++n;
  }
  const double variance = (square - sum * sum / n) * n / std::max(1.0, n - 1);
  return sum / std::sqrt(std::max(1e-300, variance));
}

/// The rule of physics that an effect of a fit breaks; empty when it keeps them all.
std::string CuttingWorkflow::objection(const CutFit& fit, std::size_t position) const {
  const Family& family = families_[fit.families[position]];
  const auto value = [&](std::size_t k) { return fit.own[position][k]; };
  if (family.edges) {
    const double kte = fit.state.coefficients[2], kre = fit.state.coefficients[3];
    const double sure = criteria_.sure_standard_errors;
    if (kte < -sure * fit.coefficient_errors(2) || kre < -sure * fit.coefficient_errors(3)) {
      // Small beside the other is no contradiction: one of them may be absent.
      if (kte < -0.15 * std::abs(kre) || kre < -0.15 * std::abs(kte))
        return "shape fits, physics does not: an edge force that pulls";
    }
  }
  if (family.info == &SizeEffect::info && !(value(0) > 0))
    return "shape fits, physics does not: force that grows faster than the chip";
  if (!family.unknowns.empty()) {
    switch (family.unknowns[0].kind) {
      case Unknown::Kind::shorter:
        if (!(value(0) > 0)) return "shape fits, physics does not: a tooth that has grown";
        break;
      case Unknown::Kind::broken:
        if (!(value(0) > 0)) return "nothing is broken";
        break;
      case Unknown::Kind::throw_x:
        if (std::hypot(value(0), value(family.unknowns.size() - 1)) > 2.9)
          return "shape fits, physics does not: a throw of several feeds";
        break;
      case Unknown::Kind::pitch:
        for (std::size_t k = 0; k < family.unknowns.size(); ++k)
          if (std::abs(value(k)) > 0.99 * family.unknowns[k].high)
            return "shape fits, physics does not: a tooth next to another one";
        break;
      case Unknown::Kind::helix:
        if (value(0) >= 69.9 || value(0) <= -4.9)
          return "shape fits, physics does not: no such helix";
        break;
      case Unknown::Kind::sensor_hz: {
        // In a direction that hardly rings the damping may be anything, and its error says so.
        const auto damped = [&](std::size_t k) {
          const double error = fit.value_errors[fit.first[position] + k];
          return value(k) > std::log(criteria_.most_damping) +
                                (error < criteria_.known_logarithm ? 0 : 2 * error);
        };
        // One that is no faster than the rotation lets no tooth through.
        for (const std::size_t k : {std::size_t{0}, std::size_t{2}})
          if (value(k) < family.unknowns[k].low + 0.01)
            return "shape fits, physics does not: a sensor slower than the rotation";
        // One beyond the samples sharpens edges: it stands in for how samples are taken.
        const auto beyond = [&](std::size_t k) {
          return value(k) > family.unknowns[k].high - std::log(kBeyondBand);
        };
        const auto known = [&](std::size_t k) {
          return fit.value_errors[fit.first[position] + k] < criteria_.known_logarithm;
        };
        if ((beyond(0) && (beyond(2) || known(1))) || (beyond(2) && known(3)))
          return "shape fits, physics does not: a sensor faster than the samples";
        if (damped(1) || damped(3) ||
            std::min(value(1), value(3)) > std::log(criteria_.most_damping))
          return "shape fits, physics does not: a resonance with a damping of 0.3 and more";
        break;
      }
      case Unknown::Kind::damping:
        if (!(value(0) > 0)) return "shape fits, physics does not: a process that drives vibration";
        break;
      case Unknown::Kind::mode_hz:
        if (!(fit.value_errors[fit.first[position]] > 0)) return "nothing vibrates";
        if (value(0) > family.unknowns[0].high - std::log(kBeyondBand))
          return "shape fits, physics does not: a mode faster than the samples";
        if (value(1) > std::log(criteria_.most_damping))
          return "shape fits, physics does not: a resonance with a damping of 0.3 and more";
        break;
      default:
        break;
    }
  }
  if (!(fit.state.coefficients[0] > 0)) return "shape fits, physics does not: force pulls the chip";
  return {};
}

/// A cause has one size all along the record; a proxy grows or fades with it.
std::string CuttingWorkflow::inconstancy(const CutFit& with, const CutFit& without) const {
  // Size of the effect in each block, 1 on the whole, and its trend over time.
  std::vector<double> t, a, w;
  for (const CutBlock& b : average_.blocks) {
    if (b.held_out) continue;
    const Eigen::ArrayXd d = (with.bins[b.level] - without.bins[b.level]).array();
    const double power = (b.count.array() * d * d).sum();
    if (!(power > 0)) continue;
    const double more = (b.count.array() * d * (b.mean - with.bins[b.level]).array()).sum() / power;
    t.push_back(b.time_s);
    a.push_back(1 + more);
    w.push_back(power);
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
    return "its size changes along the record";
  return {};
}

bool CuttingWorkflow::clearly_better(const CutFit& its, const CutFit& than) const {
  return root(beyond_noise(than) - beyond_noise(its)) > chance_gain() &&
         errors_between(than, its) > criteria_.sure_standard_errors;
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

void CuttingWorkflow::search() {
  found_ = base_;
  std::vector<std::size_t> set;
  bool paths_compared = false, beside_next_compared = false;
  const auto over_to_other_paths = [&](const CutFit& best) {
    if (!other_paths_fit(best)) return false;
    calibrate_again(1);
    found_ = base_;
    families_ = fitter_->families(base_);
    set.clear();
    return true;
  };
  while (set.size() < options_.most_effects) {
    const double now = beyond_noise(found_);
    const double worth = set.empty() ? least_gain() : floor_N();
    if (!set.empty() && root(now) < worth) break;
    std::vector<std::vector<std::size_t>> sets;
    for (std::size_t f = 0; f < families_.size(); ++f)
      if (compatible(set, f)) {
        sets.push_back(set);
        sets.back().push_back(f);
      }
    std::vector<CutFit> fits = fit_all(sets, found_);
    std::vector<std::size_t> order(fits.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return fits[a].loss < fits[b].loss; });
    std::vector<std::string> objections(fits.size());
    ranking_.clear();
    for (const std::size_t i : order) {
      objections[i] = objection(fits[i], set.size());
      ranking_.push_back(
          {families_[sets[i].back()].info->name, root(beyond_noise(fits[i])),
           std::clamp((now - beyond_noise(fits[i])) / std::max(worth * worth, now), 0.0, 1.0),
           objections[i]});
    }
    std::size_t best = order.size();
    for (const std::size_t i : order)
      if (objections[i].empty()) {
        best = i;
        break;
      }
    if (root(now) > worth && !paths_compared) {
      paths_compared = true;
      if (over_to_other_paths(best < order.size() ? fits[best] : found_)) continue;
    }
    if (root(now) > worth && offset_shows(best < order.size() ? fits[best] : found_)) {
      fitter_->always_with_offset();
      base_ = found_ = fitter_->calibrate(base_);
      set.clear();
      continue;
    }
    if (set.empty() && root(now) > worth) {
      if (auto behind = filter_shows(best < order.size() ? fits[best] : found_)) {
        fitter_.emplace(std::move(behind->first));
        base_ = found_ = std::move(behind->second);
        filter_hz_ = base_.state.filter_hz;
        continue;
      }
    }
    if (best == order.size() || root(now - beyond_noise(fits[best])) < worth ||
        errors_between(found_, fits[best]) < criteria_.sure_standard_errors) {
      why_nothing_ = "no candidate explains more than the noise allows";
      break;
    }
    const CutFit& front = fits[order[0]];
    if (order[0] != best && root(beyond_noise(fits[best]) - beyond_noise(front)) > least_gain() &&
        beyond_noise(front) < 0.5 * beyond_noise(fits[best])) {
      why_nothing_ =
          std::string(families_[sets[order[0]].back()].info->name) + ": " + objections[order[0]];
      break;
    }
    const double rest = beyond_noise(fits[best]);
    const double share = explained(found_, fits[best]);
    if (share < criteria_.enough_for_a_cut && root(rest) > floor_N()) {
      // One does not carry the gap: perhaps two do.
      std::vector<std::vector<std::size_t>> pairs;
      std::vector<std::size_t> top;
      for (const std::size_t i : order) {
        const bool same_name = std::any_of(top.begin(), top.end(), [&](std::size_t t) {
          return families_[sets[t].back()].info == families_[sets[i].back()].info;
        });
        if (!same_name) top.push_back(i);
        if (top.size() == kTop) break;
      }
      for (std::size_t a = 0; a < top.size(); ++a)
        for (std::size_t b = a + 1; b < top.size(); ++b)
          if (compatible({sets[top[a]].back()}, sets[top[b]].back())) {
            pairs.push_back(sets[top[a]]);
            pairs.back().push_back(sets[top[b]].back());
          }
      std::vector<CutFit> pair_fits;
      for (std::size_t p = 0; p < pairs.size(); ++p) {
        // From the better of the two alone.
        const auto first = static_cast<std::size_t>(
            std::find_if(top.begin(), top.end(),
                         [&](std::size_t t) { return sets[t].back() == pairs[p][set.size()]; }) -
            top.begin());
        pair_fits.push_back(fits[top[first]]);
      }
      std::vector<CutFit> done(pairs.size());
      run_reporting(
          "fitting pairs of effects", pairs.size(),
          [&](std::size_t p) { done[p] = fit(pairs[p], pair_fits[p]); }, options_);
      std::size_t winner = done.size();
      for (std::size_t p = 0; p < done.size(); ++p) {
        if (!objection(done[p], set.size()).empty() || !objection(done[p], set.size() + 1).empty())
          continue;
        if (winner == done.size() || done[p].loss < done[winner].loss) winner = p;
      }
      if (winner < done.size() && beyond_noise(done[winner]) < criteria_.pair_leaves * rest &&
          root(rest - beyond_noise(done[winner])) > floor_N() &&
          explained(found_, done[winner]) > criteria_.carries_gap) {
        set = pairs[winner];
        go_on_with(set, std::move(done[winner]));
        continue;
      }
    }
    if (share < criteria_.carries_gap) {
      if (!set.empty() && !beside_next_compared) {
        beside_next_compared = true;
        if (over_to_other_paths(fits[best])) continue;
      }
      why_nothing_ = "the best candidate, " + std::string(families_[sets[best].back()].info->name) +
                     ", explains only " + std::to_string(static_cast<int>(100 * share)) +
                     " % of what is beyond the noise";
      break;
    }
    set = sets[best];
    go_on_with(set, std::move(fits[best]));
  }
  // Beside all of them, too: fewer may have stood in for what another one does.
  if (set.size() > 1 && other_paths_fit(found_)) {
    found_ = fit_afresh(set);
    average_about(set);
  }
  // Backwards: what later additions made needless.
  for (std::size_t i = 0; i < set.size() && set.size() > 1;) {
    std::vector<std::size_t> fewer = set;
    fewer.erase(fewer.begin() + static_cast<long>(i));
    CutFit without = fit_afresh(fewer);
    if (root(beyond_noise(without) - beyond_noise(found_)) < floor_N()) {
      set = fewer;
      found_ = std::move(without);
    } else {
      ++i;
    }
  }
}

}  // namespace servosense::reconcile
