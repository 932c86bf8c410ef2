#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "reconcile/numerics/maps.hpp"
#include "reconcile/select/selection.hpp"

namespace servosense::reconcile {
namespace {

constexpr int kMostJoined = 3;  // candidates that are tried

}  // namespace

/// Beside something without a name, an effect may explain little of all that is left. It is no
/// proxy for it if no free function of any coordinate sees more there than the effect.
bool Selection::all_that_is_seen(const Entry& entry, const Fit& base) const {
  const Candidate& candidate = candidates_[entry.candidate];
  if (!(criteria_.least_explained_of_seen < 1) || candidate.memory || candidate.scope == "record")
    return false;
  const double gain = base.loss - entry.fit.loss;
  // What does not repeat counts in full here.
  if (!(root(gain) > criteria_.least_gain_in_floors * std::max(floors_.lap, floors_.local)) ||
      gain < criteria_.least_explained_beside_unseen * structured(base.loss))
    return false;
  std::vector<const Column*> all = columns();
  for (const Column& column : entry.optimum.columns) all.push_back(&column);
  const Column rest = residual_of(problem_.target, all, entry.fit.coefficients);
  double seen = 0;
  for (const ResidualMap& map : maps_of(problem_, rest, options_))
    if (map.probability <= criteria_.significant_map)
      seen = std::max(seen, map.share * entry.fit.loss);
  return gain >= criteria_.least_explained_of_seen * (gain + seen);
}

/// Do the parameters of both stay within their ranges where both are fitted together?
bool Selection::both_physical(const Entry& a, const Entry& b, const Fit& fit,
                              const Regression& known) const {
  Eigen::Index at = known.columns();
  for (const Entry* e : {&a, &b}) {
    std::vector<double> own;
    for (std::size_t j = 0; j < e->optimum.columns.size(); ++j)
      own.push_back(fit.coefficients(at++));
    const Candidate& candidate = candidates_[e->candidate];
    if (candidate.sized && own.size() == 1 && !sized_right(own[0], criteria_)) return false;
    const Meaning meaning = candidate.meaning(e->optimum.theta, own);
    if (!meaning.violation.empty() || !meaning.doubt.empty()) return false;
  }
  return true;
}

/// By an effect that has an objection, so that the cause is neither of them.
bool Selection::beaten_by(const Entry& front, const Fit& fit, double errors) const {
  return !front.objection.empty() &&
         root(fit.loss - front.fit.loss) > criteria_.least_gain_in_floors * floors_.used &&
         standard_errors_between(fit, front.fit) > errors;
}

std::optional<Selection::Chosen> Selection::choose(std::vector<Entry> ranking,
                                                   const Regression& known, const Fit& base) {
  last_ranking_ = table(ranking, base);
  if (ranking.empty()) return {};
  const double whole = structured(base.loss);
  const auto gain = [&](const Entry& e) { return root(base.loss - e.fit.loss); };
  const auto allowed = [](const Entry& e) { return e.objection.empty(); };
  // What breaks its rule cannot be named, but if it fits far better than all that may be, the
  // cause is not among them.
  const auto first_allowed = std::find_if(ranking.begin(), ranking.end(), allowed);
  if (first_allowed == ranking.end() || gain(*first_allowed) < least_gain()) {
    why_nothing_ = kNothingBeyondNoise;
    return {};
  }
  std::size_t best = static_cast<std::size_t>(first_allowed - ranking.begin());
  bool beaten = beaten_by(ranking[0], first_allowed->fit, criteria_.class_standard_errors);
  double explained = (base.loss - ranking[best].fit.loss) / std::max(1e-300, whole);

  // When one does not carry the gap, perhaps two do: then take the stronger of the best pair.
  std::vector<Fit> pairs;
  std::vector<bool> pair_with;  // of each: is this candidate in it?
  if (beaten || explained < criteria_.carries_gap) {
    std::vector<std::size_t> order(ranking.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    const std::vector<std::size_t> top = best_for_pairs(
        order, [&](std::size_t i, const auto& /*before*/) { return allowed(ranking[i]); });
    double least = std::numeric_limits<double>::infinity(), least_with_best = least;
    std::pair<std::size_t, std::size_t> pair{best, best};
    std::vector<std::pair<std::size_t, std::size_t>> members;
    Fit pair_fit, with_best_fit;
    for_each_pair(top, [&](std::size_t a, std::size_t b) {
      std::vector<Column> both = ranking[a].optimum.columns;
      const auto& more = ranking[b].optimum.columns;
      both.insert(both.end(), more.begin(), more.end());
      Fit fit = known.fit_with(both);
      if (a == best && fit.loss < least_with_best) {
        least_with_best = fit.loss;
        with_best_fit = fit;
      }
      if (fit.loss < least) {
        least = fit.loss;
        pair = {a, b};
        pair_fit = fit;
      }
      members.emplace_back(a, b);
      pairs.push_back(std::move(fit));
    });
    if (top.size() >= 2) {
      if (pair.first != best &&
          standard_errors_between(with_best_fit, pair_fit) > criteria_.class_standard_errors)
        best = pair.first;
      explained = std::max(explained, 0.5 * (base.loss - least) / std::max(1e-300, whole));
    }
    if (base.loss - least < criteria_.carries_gap * whole) {
      pairs.clear();
    } else if (beaten && !beaten_by(ranking[0], pair_fit, criteria_.class_standard_errors) &&
               both_physical(ranking[pair.first], ranking[pair.second], pair_fit, known)) {
      // A shape that breaks its rule also stands in for two that keep theirs and carry the gap.
      beaten = false;
      best = pair.first;
    }
    // Resampled data may pick either of the two by itself: the pair is what they must pick.
    for (const auto& [a, b] : members) pair_with.push_back(a == best || b == best);
  }
  if (beaten) {
    const Entry& front = ranking[0];
    // Fewer rows would not take that back.
    if (const std::string& what = candidates_[front.candidate].rival; !what.empty()) {
      resembles_ = what;
      for (const Entry& e : ranking)
        if (allowed(e) && beaten_by(front, e.fit, criteria_.class_standard_errors))
          proxies_.push_back(candidates_[e.candidate].name);
    }
    why_nothing_ = candidates_[front.candidate].name + ": " + front.objection;
    return {};
  }
  Entry& entry = ranking[best];
  const Candidate& candidate = candidates_[entry.candidate];
  if (explained < criteria_.least_explained && !all_that_is_seen(entry, base)) {
    why_nothing_ = explains_too_little(candidate.name, explained);
    return {};
  }
  const std::vector<std::size_t> members = class_of(ranking, best, base, known);
  double frequency = pick_frequency(ranking, best, members, known);
  if (!pairs.empty()) frequency = std::max(frequency, resampled_share(pairs, pair_with));
  if (frequency < criteria_.least_pick_frequency) {
    why_nothing_ = "resampled data pick other names than " + candidate.name;
    return {};
  }
  Chosen chosen;
  chosen.gain = gain(entry);
  chosen.entry = std::move(entry);
  return chosen;
}

/// Takes out an effect that failed, for good.
void Selection::drop(std::size_t i, const std::string& why) {
  const std::size_t candidate = chosen_[i].entry.candidate;
  why_nothing_ = candidates_[candidate].name + ": " + why;
  banned_.push_back(candidate);
  chosen_.erase(chosen_.begin() + static_cast<long>(i));
}

/// The simplest of those that fit alike gives the name; and where what one column has beyond a
/// simpler effect is worth no term by itself, that one.
void Selection::prefer_simpler(const std::vector<Entry>& ranking, const Regression& known,
                               std::size_t& best, std::vector<std::size_t>& members) const {
  const auto size_of = [](const Entry& e) {
    return e.optimum.columns.size() + e.optimum.theta.size();
  };
  for (std::size_t& m : members)
    if (size_of(ranking[m]) < size_of(ranking[best]) &&
        standard_errors_between(ranking[m].fit, ranking[best].fit) < 1)
      std::swap(m, best);
  for (std::size_t m = 0; m < ranking.size(); ++m)
    if (ranking[m].objection.empty() &&
        ranking[best].optimum.columns.size() == ranking[m].optimum.columns.size() + 1 &&
        root(ranking[m].fit.loss - ranking[best].fit.loss) < least_gain() &&
        contains(ranking[best], ranking[m], known)) {
      std::erase(members, m);
      members.push_back(best);
      best = m;
      return;
    }
}

/// Why an effect of the ranking may not stay beside the others; empty when it may.
std::string Selection::objection_beside(const std::vector<Entry>& ranking, std::size_t best,
                                        const std::vector<std::size_t>& members,
                                        const Regression& known, const Fit& base) {
  const Entry& named = ranking[best];
  if (root(base.loss - named.fit.loss) < least_gain()) return "adds nothing beside the others";
  if (std::string why = class_too_large(members.size(), "this motion"); !why.empty()) return why;
  if (std::string why = inconstancy(named, known); !why.empty()) return why;
  // Of an effect that does not carry the gap less is enough: the other shape may be the cause.
  if (beaten_by(ranking[0], named.fit, 1) &&
      base.loss - named.fit.loss < criteria_.carries_gap * structured(base.loss)) {
    const Candidate& front = candidates_[ranking[0].candidate];
    if (!front.rival.empty()) resembles_ = front.rival;
    return front.name + " fits better, but " + ranking[0].objection;
  }
  return {};
}

/// What the report says of it.
FoundEffect Selection::described(const std::vector<Entry>& ranking, std::size_t best,
                                 const std::vector<std::size_t>& members, const Regression& known,
                                 const Fit& base) const {
  const Entry& named = ranking[best];
  const Candidate& own = candidates_[named.candidate];
  const auto is_in = [](const auto& all, const auto& one) {
    return std::find(all.begin(), all.end(), one) != all.end();
  };
  FoundEffect effect;
  effect.name = own.name;
  effect.scope = own.scope;
  effect.where = own.where;
  effect.class_members = own.equals;
  effect.share_of_residual = std::clamp((base.loss - named.fit.loss) / base.loss, 0.0, 1.0);
  std::vector<Rival> rivals;
  for (std::size_t k = 0; k < ranking.size(); ++k) {
    const Entry& other = ranking[k];
    const std::string& name = candidates_[other.candidate].name;
    const bool member = is_in(members, k);
    if (k == best || !other.objection.empty() ||
        (!member && (is_in(own.equals, name) || contains(other, named, known))))
      continue;
    rivals.push_back(
        {name, root(other.fit.loss), standard_errors_between(other.fit, named.fit), member});
  }
  stand_beside(
      effect, rivals, own.splitting_motion,
      {.picked = pick_frequency(ranking, best, members, known), .explained = explained_by_all()},
      criteria_);
  effect.ranking = table(ranking, base);
  return effect;
}

/// An effect again, beside all others: is it still the best, what else would do, and does it keep
/// the rules? Takes it out where it fails, exchanges it where another is better; true when nothing
/// changed.
bool Selection::stands(std::size_t i) {
  const Regression known = regression(i);
  const Fit base = known.fit();
  std::vector<Entry> ranking = rank(known, base, i);
  const auto allowed = [](const Entry& e) { return e.objection.empty(); };
  const auto mine = std::find_if(ranking.begin(), ranking.end(), [&](const Entry& e) {
    return e.candidate == chosen_[i].entry.candidate;
  });
  const auto first = std::find_if(ranking.begin(), ranking.end(), allowed);
  const auto fails = [&](const std::string& why) {
    last_ranking_ = table(ranking, base);
    drop(i, why);
    return false;
  };
  if (mine != ranking.end() && !allowed(*mine)) {
    // A spring whose rest is far beyond the axis, beside the others: what it has beyond a simpler
    // effect broke its rule, and is worth no term. Then it was the simpler one.
    const auto simpler = std::find_if(ranking.begin(), ranking.end(), [&](const Entry& e) {
      return allowed(e) && root(e.fit.loss - mine->fit.loss) < least_gain() &&
             contains(*mine, e, known);
    });
    if (simpler != ranking.end()) {
      chosen_[i].gain = root(base.loss - simpler->fit.loss);
      chosen_[i].entry = std::move(*simpler);
      return false;
    }
  }
  if (first == ranking.end() || mine == ranking.end() || !allowed(*mine))
    return fails(mine == ranking.end() ? "cannot be fitted" : mine->objection);
  std::size_t best = static_cast<std::size_t>(mine - ranking.begin());
  if (first != mine &&
      standard_errors_between(mine->fit, first->fit) > criteria_.class_standard_errors)
    best = static_cast<std::size_t>(first - ranking.begin());
  std::vector<std::size_t> members = class_of(ranking, best, base, known);
  prefer_simpler(ranking, known, best, members);
  const bool exchanged = ranking[best].candidate != chosen_[i].entry.candidate;
  if (const std::string why = objection_beside(ranking, best, members, known, base); !why.empty())
    return fails(why);
  chosen_[i].effect = described(ranking, best, members, known, base);
  chosen_[i].gain = root(base.loss - ranking[best].fit.loss);
  chosen_[i].entry = std::move(ranking[best]);
  return !exchanged;
}

bool Selection::settle() {
  for (std::size_t i = 0; i < chosen_.size(); ++i)
    if (!stands(i)) return false;
  return true;
}

/// Nonlinear parameters of all effects again, each beside the others.
void Selection::refine() {
  for (int round = 0; round < (chosen_.size() > 1 ? 2 : 1); ++round)
    for (std::size_t i = 0; i < chosen_.size(); ++i) {
      Entry& e = chosen_[i].entry;
      if (e.optimum.theta.empty()) continue;
      const Regression others = regression(i);
      Optimum better = search(candidates_[e.candidate], others, {}, 0, &e.optimum.theta);
      if (!better.columns.empty()) e.optimum = std::move(better);
    }
}

/// Alone, an effect also takes what it can of one that is still missing, and leaves something else.
/// Where nothing explains that: does a further effect carry the gap once all parameters are fitted
/// again? settle() judges it then.
bool Selection::join(const std::vector<Entry>& ranking, const Fit& base) {
  if (chosen_.empty()) return false;
  const std::vector<Chosen> before = chosen_;
  std::vector<Chosen> best;
  double least = base.loss - std::max(criteria_.carries_gap * structured(base.loss),
                                      least_gain() * least_gain());
  int tried = 0;
  for (const Entry& entry : ranking) {
    if (!entry.objection.empty()) continue;
    if (++tried > kMostJoined) break;
    chosen_ = before;
    chosen_.push_back({entry, 0, {}});
    // From the whole range: what stood for both may be far from where it stands for one.
    for (std::size_t i = 0; i < before.size(); ++i) {
      Entry& e = chosen_[i].entry;
      if (e.optimum.theta.empty() || candidates_[e.candidate].memory) continue;
      const Regression others = regression(i);
      Optimum better = search(candidates_[e.candidate], others, residual(others.fit(), i), 0);
      if (!better.columns.empty()) e.optimum = std::move(better);
    }
    refine();
    const double loss = regression().fit().loss;
    if (!(loss < least)) continue;
    least = loss;
    chosen_.back().gain = root(base.loss - loss);
    best = chosen_;
  }
  chosen_ = best.empty() ? before : best;
  return !best.empty();
}

}  // namespace servosense::reconcile
