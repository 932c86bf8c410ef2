#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include "reconcile/numerics/maps.hpp"
#include "reconcile/numerics/smoother.hpp"
#include "reconcile/select/selection.hpp"
#include "reconcile/select/steadiness.hpp"

namespace servosense::reconcile {
namespace {

// Of the corner: programs move below, disturbances act above, too, and are seldom narrow.
constexpr double kSlowShares[] = {0.1, 0.2};

}  // namespace

/// What pushes at the drive moves it, and the loop answers with effort that comes later than this
/// motion, the more so the faster it is. No delay and no lag grows with frequency.
bool Selection::later_the_faster(const Column& timing, const Regression& known) const {
  for (const double share : kSlowShares) {
    // Gaussians in a row: the squares of their widths add.
    const double corner = share * problem_.noise_bandwidth_hz / std::sqrt(1 - share * share);
    const Column slow = Smoother(corner, problem_.row_period_s).apply(timing, 0, 1);
    const Fit split = known.fit_with({timing, slow});
    const double less = -split.coefficients(known.columns() + 1);
    if (less > criteria_.largest_inconstancy &&
        less > criteria_.certain_standard_errors * split.standard_errors(known.columns() + 1))
      return true;
  }
  return false;
}

/// A cause has one size everywhere; a proxy changes with the range it is fitted on.
std::string Selection::inconstancy(const Entry& e, const Regression& known) const {
  // The effect as fitted, one column; its share above and below the middle of each coordinate.
  const auto first = known.columns();
  const Column whole = weighted_sum(e.optimum.columns, e.fit.coefficients_from(first));
  if (candidates_[e.candidate].timing && later_the_faster(whole, known))
    return "it is the later the faster the force changes, as what the loop answers to a "
           "disturbance";
  // Whether its share beyond a level of a coordinate is another one; the level in the sense of the
  // effect's own energy, so both parts show it.
  const auto changes = [&](const Column& value, double below_level) {
    std::vector<std::pair<double, double>> energy;
    double sum = 0;
    for (const std::size_t i : rows_.rows) {
      energy.emplace_back(value[i], whole[i] * whole[i]);
      sum += whole[i] * whole[i];
    }
    std::sort(energy.begin(), energy.end());
    double below = 0, level = 0;
    for (const auto& [v, w] : energy) {
      below += w;
      if (below > below_level * sum) {
        level = v;
        break;
      }
    }
    Column upper(whole.size(), 0);
    for (std::size_t i = 0; i < whole.size(); ++i)
      if (value[i] > level) upper[i] = whole[i];
    const Fit split = known.fit_with({whole, upper});
    const double change = std::abs(split.coefficients(first + 1));
    return change > criteria_.largest_inconstancy &&
           change > criteria_.certain_standard_errors * split.standard_errors(first + 1);
  };
  const Candidate& candidate = candidates_[e.candidate];
  for (const Coordinate& coordinate : problem_.coordinates) {
    const bool force = coordinate.name == kTransmittedForce;
    if (force ? candidate.where != kTransmittedForce
              : coordinate.period > 0 || !coordinate.factor.empty())
      continue;
    // What acts at reversals has no range of speeds or accelerations to be compared over.
    if (candidate.memory && coordinate.name != "time" && coordinate.name != "position") continue;
    const bool speed = coordinate.name == "velocity";
    Column value = coordinate.values;
    if (speed)
      for (double& v : value) v = std::abs(v);
    // From which force on a motor gives less than is asked of it nobody knows.
    const auto levels = force ? std::vector<double>{0.5, 0.7, 0.85} : std::vector<double>{0.5};
    for (const double level : levels)
      if (changes(value, level))
        return "its size changes with " + coordinate.name +
               (speed || force ? "" : " along the record");
  }
  return {};
}

/// Has the columns of `entry`, and more: a spring with its rest position contains a constant load.
bool Selection::contains(const Entry& richer, const Entry& entry, const Regression& known) const {
  if (richer.optimum.columns.size() <= entry.optimum.columns.size()) return false;
  Regression with = known;
  for (const Column& column : richer.optimum.columns) with.add(column);
  double most = 0;
  for (const Column& column : entry.optimum.columns)
    most = std::max(most, with.share_left(column) / std::max(1e-300, known.share_left(column)));
  return most < criteria_.contained;
}

/// What loses by no more than chance. A richer candidate that contains the best one is no rival.
std::vector<std::size_t> Selection::class_of(const std::vector<Entry>& ranking, std::size_t best,
                                             const Fit& base, const Regression& known) const {
  const Entry& entry = ranking[best];
  std::vector<std::size_t> members;
  for (std::size_t i = 0; i < ranking.size(); ++i) {
    const Entry& other = ranking[i];
    if (i == best || !other.objection.empty()) continue;
    const bool close =
        standard_errors_between(other.fit, entry.fit) < criteria_.class_standard_errors;
    // Blocks that differ much make the standard error large; what leaves much more than the best,
    // on the very rows of the fit, is no rival all the same.
    const double more = other.fit.mean_square - entry.fit.mean_square;
    if (more >
        std::max(least_gain() * least_gain(), criteria_.class_mean_square * entry.fit.mean_square))
      continue;
    // It must itself explain what the best explains.
    if (!close || base.loss - other.fit.loss < criteria_.class_gain * (base.loss - entry.fit.loss))
      continue;
    if (contains(other, entry, known)) continue;
    members.push_back(i);
  }
  return members;
}

/// Would other data of the same kind have given the same name, or one of its class?
double Selection::pick_frequency(const std::vector<Entry>& ranking, std::size_t best,
                                 const std::vector<std::size_t>& members,
                                 const Regression& known) const {
  const std::vector<std::string>& equals = candidates_[ranking[best].candidate].equals;
  std::vector<std::size_t> rivals;
  for (std::size_t i = 0; i < ranking.size(); ++i)
    if (ranking[i].objection.empty() && !contains(ranking[i], ranking[best], known) &&
        std::find(equals.begin(), equals.end(), candidates_[ranking[i].candidate].name) ==
            equals.end())
      rivals.push_back(i);
  std::vector<Fit> fits;
  std::vector<bool> good;
  for (const std::size_t i : rivals) {
    fits.push_back(ranking[i].fit);
    good.push_back(i == best || std::find(members.begin(), members.end(), i) != members.end());
  }
  return resampled_share(fits, good);
}

/// Share of resampled data sets in which the fit with the least loss is a good one.
double Selection::resampled_share(const std::vector<Fit>& fits,
                                  const std::vector<bool>& good) const {
  std::mt19937_64 random(options_.seed);
  const std::size_t blocks = rows_.blocks();
  unsigned picked = 0;
  for (unsigned k = 0; k < options_.resamples; ++k) {
    std::vector<double> weight(blocks, 0);
    for (std::size_t b = 0; b < blocks; ++b) ++weight[random() % blocks];
    std::size_t winner = fits.size();
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < fits.size(); ++i) {
      const double loss =
          std::inner_product(weight.begin(), weight.end(), fits[i].block_loss.begin(), 0.0);
      if (loss < least) {
        least = loss;
        winner = i;
      }
    }
    if (winner == fits.size() || good[winner]) ++picked;
  }
  return static_cast<double>(picked) / options_.resamples;
}

/// Of an effect beside all others, from one stretch of the record to the next.
double Selection::unsteadiness(std::size_t i, const Fit& fit, const Column& rest) const {
  constexpr double kStretch_s = 0.5;  // longer than a reversal
  std::size_t first = problem_.known.size();
  for (std::size_t k = 0; k < i; ++k) first += chosen_[k].entry.optimum.columns.size();
  const Column own = weighted_sum(chosen_[i].entry.optimum.columns,
                                  fit.coefficients_from(static_cast<Eigen::Index>(first)));
  const double start_s = problem_.time_s[rows_.rows.front()];
  const auto stretch_of = [&](std::size_t row) {
    return static_cast<std::size_t>((problem_.time_s[row] - start_s) / kStretch_s);
  };
  Steadiness steadiness(stretch_of(rows_.rows.back()) + 1);
  for (const std::size_t k : rows_.rows) steadiness.add(stretch_of(k), own[k], rest[k]);
  return steadiness.unsteadiness();
}

/// A free function of its own coordinate must not explain much of what an effect leaves behind:
/// then the effect only stands in for something else there.
/// An effect of which no parameter differs from none by two standard errors is as well absent. So
/// is one whose name is as likely wrong as right.
bool Selection::drop_unsure() {
  const Regression known = regression();
  const Fit fit = known.fit();
  for (std::size_t i = 0; i < chosen_.size(); ++i) {
    if (chosen_[i].effect.confidence < criteria_.least_confidence) {
      drop(i, kAsLikelyWrong);
      return true;
    }
    const Own own = own_of(i, fit);
    const Candidate& c = candidates_[chosen_[i].entry.candidate];
    if (c.memory) continue;  // its errors count what is left in full, which is the worst case
    const Meaning meaning = c.meaning(chosen_[i].entry.optimum.theta, own.values);
    const std::vector<NamedValue> errors = errors_of(chosen_[i], known, own);
    bool none = true, sure = false;
    for (std::size_t p = 0; p < errors.size(); ++p)
      for (std::size_t k = 0; k < errors[p].values.size(); ++k) {
        none = false;
        sure |= std::abs(meaning.parameters[p].values[k]) >=
                criteria_.class_standard_errors * errors[p].values[k];
      }
    if (none || sure) continue;
    drop(i, "its size is not known beside what is left where it acts");
    return true;
  }
  return false;
}

bool Selection::drop_proxies() {
  if (chosen_.empty()) return false;
  const Fit fit = regression().fit();
  const Column rest = residual(fit);
  for (std::size_t i = 0; i < chosen_.size(); ++i)
    if (unsteadiness(i, fit, rest) > criteria_.largest_unsteadiness) {
      drop(i, kUnsteadySize);
      return true;
    }
  // An effect must pay where it was not fitted, by a fair part of what it paid where it was.
  const double held = held_gap(rest);
  for (std::size_t i = 0; i < chosen_.size(); ++i) {
    const Fit without = regression(i).fit();
    const double fitted = 1 - fit.loss / without.loss;
    const double before = held_gap(residual(without, i));
    if (1 - held * held / (before * before) > criteria_.least_held_out_share * fitted) continue;
    drop(i, "fails on the held-out part");
    return true;
  }
  const std::vector<ResidualMap> maps = maps_of(problem_, rest, options_);
  for (std::size_t i = 0; i < chosen_.size(); ++i) {
    const Candidate& c = candidates_[chosen_[i].entry.candidate];
    // What a nut carries is not all that the motor exerts: the law itself leaves some of that.
    if (c.where == kTransmittedForce) continue;
    const double gain = regression(i).fit().loss - fit.loss;
    for (const ResidualMap& map : maps) {
      if (map.variable != c.where || map.probability > criteria_.significant_map) continue;
      if (map.share * fit.loss > criteria_.largest_proxy * gain) {
        proxies_.push_back(c.name);
        drop(i, "a free function of " + map.variable +
                    " explains much of what it leaves; something else acts there");
        return true;
      }
    }
  }
  return false;
}

void Selection::prune() {
  prune_needless(
      chosen_, least_gain(),
      [&](std::size_t i) { return regression(i).fit().loss - regression().fit().loss; },
      [&](std::size_t i) { chosen_.erase(chosen_.begin() + static_cast<long>(i)); });
}

}  // namespace servosense::reconcile
