#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <utility>

#include "reconcile/numerics/parallel_jobs.hpp"
#include "reconcile/numerics/smoother.hpp"
#include "reconcile/select/selection.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kOtherParameter = 1.05;  // a law that is off by a little

}  // namespace

std::vector<const Column*> Selection::columns(std::optional<std::size_t> without) const {
  std::vector<const Column*> all;
  for (const KnownTerm& term : problem_.known) all.push_back(&term.column);
  for (std::size_t i = 0; i < chosen_.size(); ++i)
    if (!without || *without != i)
      for (const Column& column : chosen_[i].entry.optimum.columns) all.push_back(&column);
  return all;
}

Regression Selection::regression(std::optional<std::size_t> without) const {
  Regression r(rows_, problem_.target);
  for (const Column* column : columns(without)) r.add(*column);
  return r;
}

/// No law is exact: a found effect leaves a few per cent of itself. What it leaves comes early or
/// late, has other parameters, or its size depends on direction, speed, acceleration or on how far
/// friction has swung over. What is unlike all these is no leftover of it, however small beside it.
std::vector<Selection::ModelError> Selection::model_errors(
    const Regression& known, const Fit& base, std::optional<std::size_t> without) const {
  const Column* velocity = values_along("velocity");
  const Column* acceleration = values_along("acceleration");
  std::vector<ModelError> all;
  auto at = static_cast<Eigen::Index>(problem_.known.size());
  for (std::size_t i = 0; i < chosen_.size(); ++i) {
    if (without && *without == i) continue;
    const Entry& e = chosen_[i].entry;
    const Candidate& c = candidates_[e.candidate];
    ModelError r;
    r.chosen = &chosen_[i];
    const auto first = at;
    at += static_cast<Eigen::Index>(e.optimum.columns.size());
    if (velocity != nullptr && acceleration != nullptr && !c.memory) {
      const Column whole = weighted_sum(e.optimum.columns, base.coefficients_from(first));
      r.known = known;
      const auto add = [&](auto&& factor) {
        Column column(whole.size(), 0);
        for (std::size_t k = 0; k < column.size(); ++k) column[k] = whole[k] * factor(k);
        r.known->add(column);
      };
      const auto direction = [&](std::size_t k) { return (*velocity)[k] < 0 ? -1.0 : 1.0; };
      add(direction);
      add([&](std::size_t k) { return (*velocity)[k]; });
      add([&](std::size_t k) { return std::abs((*velocity)[k]); });
      add([&](std::size_t k) { return std::abs((*acceleration)[k]); });
      for (const KnownTerm& term : problem_.known)
        if (term.name == "presliding shape")
          add([&](std::size_t k) { return direction(k) * term.column[k]; });
      Column slope(whole.size(), 0);
      for (std::size_t k = 1; k + 1 < slope.size(); ++k) slope[k] = whole[k + 1] - whole[k - 1];
      r.known->add(slope);
      for (std::size_t p = 0; p < e.optimum.theta.size(); ++p) {
        std::vector<double> theta = e.optimum.theta;
        theta[p] *= kOtherParameter;
        const std::vector<Column> columns = c.columns(theta);
        if (columns.size() == e.optimum.columns.size())
          r.known->add(weighted_sum(columns, base.coefficients_from(first)));
      }
      (void)r.known->rest();  // prepared before the threads share it
    }
    all.push_back(std::move(r));
  }
  return all;
}

std::vector<Entry> Selection::rank(const Regression& known, const Fit& base,
                                   std::optional<std::size_t> without) const {
  const Column rest = residual(base, without);
  std::vector<Entry> entries(candidates_.size());
  (void)known.rest();  // prepared once, before the threads share it
  const std::vector<ModelError> found = model_errors(known, base, without);
  run_reporting(
      "comparing effects", candidates_.size(),
      [&](std::size_t i) {
        Entry& e = entries[i];
        e.candidate = i;
        if (!candidates_[i].not_testable.empty()) return;
        for (std::size_t k = 0; k < chosen_.size(); ++k)
          if (chosen_[k].entry.candidate == i && k != without) return;
        if (std::find(banned_.begin(), banned_.end(), i) != banned_.end()) return;
        // A third of the way there, the grid may have missed the best.
        const double needed = least_gain_of(candidates_[i]);
        e.optimum = search(candidates_[i], known, rest, 0.1 * needed * needed);
        if (e.usable()) judge(e, known, base, found);
      },
      options_);
  std::erase_if(entries, [](const Entry& e) { return !e.usable(); });
  std::stable_sort(entries.begin(), entries.end(),
                   [](const Entry& a, const Entry& b) { return a.fit.loss < b.fit.loss; });
  return entries;
}

/// Of a travel far beyond that of friction itself: the presliding distance from which on travels
/// are looked for, or the shorter one that is fitted beside it.
bool Selection::outlasts_presliding(const Entry& e) const {
  const std::vector<double>& theta = e.optimum.theta;
  if (theta.empty()) return false;
  double presliding = candidates_[e.candidate].search.front().low;
  if (theta.size() > 1) presliding = std::min(presliding, criteria_.presliding_span * theta[1]);
  return theta.front() > criteria_.lasting_travel * presliding;
}

void Selection::judge(Entry& e, const Regression& known, const Fit& base,
                      const std::vector<ModelError>& found) const {
  const Candidate& candidate = candidates_[e.candidate];
  e.fit = known.fit_with(e.optimum.columns);
  const auto first = static_cast<std::size_t>(known.columns());
  std::vector<double> own;
  for (std::size_t j = 0; j < e.optimum.columns.size(); ++j)
    own.push_back(e.fit.coefficients(static_cast<Eigen::Index>(first + j)));
  e.meaning = candidate.meaning(e.optimum.theta, own);
  double most = 0;
  for (const Column& column : e.optimum.columns) most = std::max(most, known.share_left(column));
  if (most < criteria_.least_testable)
    e.objection = "this motion does not show it apart from the terms of the model";
  else if (!candidate.refuted.empty())
    e.objection = candidate.refuted;
  else if (!e.meaning.violation.empty())
    e.objection = "shape fits, physics does not: " + e.meaning.violation;
  else if (candidate.sized && own.size() == 1 && !sized_right(own[0], criteria_))
    e.objection = "shape fits, size does not";
  // What the effects already found leave behind is not noise. What imitates it leaves much of it,
  // in turn; what takes it away down to the noise does not imitate.
  const double explained = (base.loss - e.fit.loss) / std::max(1e-300, structured(base.loss));
  const Column whole = weighted_sum(e.optimum.columns, own);
  const double apart = known.share_left(whole);
  double largest = 0;
  for (const ModelError& r : found) {
    if (r.candidate() == e.candidate) continue;
    double alike = 1;
    if (r.known && apart > 0) alike = root(1 - std::pow(r.known->share_left(whole) / apart, 2));
    largest = std::max(largest, r.chosen->gain * alike);
  }
  if (!(candidate.memory && options_.before_recalibration)) largest *= root(1 - explained);
  const double least = candidate.memory ? std::max(largest * criteria_.least_gain_beside_memory,
                                                   least_gain_of(candidate, e.meaning.like_bristle))
                                        : largest * criteria_.least_gain_beside;
  // What friction laws leave open just after reversals is some two floors, of any shape.
  const bool carries = explained > criteria_.carries_gap &&
                       root(base.loss - e.fit.loss) > criteria_.far_beyond_least_gain * least;
  if (e.objection.empty() && !e.meaning.doubt.empty() && !carries)
    e.objection = "too little to be told from friction: " + e.meaning.doubt;
  const bool little = root(base.loss - e.fit.loss) < least;
  const bool part = candidate.memory &&
                    explained < std::max(criteria_.least_explained, e.meaning.least_explained);
  if (e.objection.empty() && !(root(base.loss - e.fit.loss) > chance_[e.candidate]))
    e.objection = "no more than chance would show";
  // Delays, and laws of friction, refitted beside each other move the presliding distance.
  if (e.objection.empty() && largest > 0 && candidate.where == kSinceReversal &&
      !outlasts_presliding(e))
    e.objection = "its travel is that of the friction beside other effects";
  if (e.objection.empty() && (little || part))
    e.objection = "too little to be told from what friction laws leave open";
}

/// Parametric bootstrap. The known terms drop out of any gain, so a record of the refitted model is
/// its noise; it goes through the search of every candidate. The tail over a whole catalogue from a
/// dozen records: Gumbel, by moments. What laws of friction leave open is no chance: the limits of
/// Options are for that.
void Selection::draw_nulls() {
  chance_.assign(candidates_.size(), 0);
  if (options_.null_records < 2 || !(floors_.used > 0)) return;
  std::mt19937_64 random(options_.seed);
  std::normal_distribution<double> normal;
  // White noise through the filter that the rows went through: half power at its corner.
  const double corner_rows = problem_.noise_bandwidth_hz * problem_.row_period_s;
  const double sigma = corner_rows > 0 ? std::sqrt(std::log(2.0)) / (kTwoPi * corner_rows) : 0;
  const auto reach = static_cast<std::size_t>(std::ceil(4 * sigma));
  std::vector<double> kernel;
  double power = 0;
  for (std::size_t k = 0; k <= 2 * reach; ++k) {
    const double t = static_cast<double>(k) - static_cast<double>(reach);
    kernel.push_back(sigma > 0 ? std::exp(-0.5 * t * t / (sigma * sigma)) : 1);
    power += kernel.back() * kernel.back();
  }
  const Regression known = regression();
  std::vector<Column> records;         // less what the known terms explain
  std::vector<Eigen::VectorXd> rests;  // the same over the fitted rows
  for (unsigned n = 0; n < options_.null_records; ++n) {
    Column white(problem_.rows() + 2 * reach);
    for (double& w : white) w = normal(random) * floors_.used / root(power);
    Column record(problem_.rows(), 0);
    for (std::size_t i = 0; i < record.size(); ++i)
      for (std::size_t k = 0; k < kernel.size(); ++k) record[i] += kernel[k] * white[i + k];
    const Regression r = known.with_target(record);
    rests.push_back(r.rest());
    records.push_back(residual_of(record, columns(), r.fit().coefficients));
  }
  run_reporting(
      "drawing what chance shows", candidates_.size(),
      [&](std::size_t i) {
        const Candidate& candidate = candidates_[i];
        if (!candidate.not_testable.empty()) return;
        // Only where records ask for other parameters columns are made anew.
        std::map<std::vector<double>, std::vector<std::size_t>> askers;
        for (std::size_t n = 0; n < records.size(); ++n)
          for (auto& theta : starting_points(candidate, records[n]))
            askers[std::move(theta)].push_back(n);
        std::vector<double> least(records.size(), std::numeric_limits<double>::infinity());
        for (const auto& [theta, asking] : askers) {
          const std::vector<Column> columns = candidate.at_start(theta);
          if (columns.empty()) continue;
          const Addition added(known, columns, candidate.sized);
          for (const std::size_t n : asking)
            least[n] = std::min(least[n], added.mean_square(rests[n]));
        }
        double sum = 0, square = 0;
        for (std::size_t n = 0; n < records.size(); ++n) {
          if (!std::isfinite(least[n])) continue;
          const double gain = mean_square_of(rests[n]) - least[n];
          sum += gain;
          square += gain * gain;
        }
        const auto count = static_cast<double>(records.size());
        const double mean = sum / count;
        const double deviation = root((square - count * mean * mean) / (count - 1));
        const double scale = deviation * std::sqrt(6.0) / (0.5 * kTwoPi);
        const double each = criteria_.null_probability / static_cast<double>(candidates_.size());
        constexpr double kEuler = 0.5772156649;
        chance_[i] = root(mean - scale * (kEuler + std::log(-std::log1p(-each))));
      },
      options_);
}

std::vector<RankedCandidate> Selection::table(const std::vector<Entry>& ranking,
                                              const Fit& base) const {
  std::vector<RankedCandidate> rows;
  const double whole = std::max(1e-300, structured(base.loss));
  for (const Entry& e : ranking)
    rows.push_back({candidates_[e.candidate].name, root(e.fit.loss),
                    std::clamp((base.loss - e.fit.loss) / whole, 0.0, 1.0), e.objection,
                    chance_[e.candidate]});
  return rows;
}

}  // namespace servosense::reconcile
