#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "naming_workflow.hpp"
#include "servosense/core/units.hpp"
#include "servosense/sim/run_parallel.hpp"

namespace servosense::reconcile {

std::vector<const Column*> NamingWorkflow::columns(std::optional<std::size_t> without) const {
  std::vector<const Column*> all;
  for (const KnownTerm& term : problem_.known) all.push_back(&term.column);
  for (std::size_t i = 0; i < chosen_.size(); ++i)
    if (!without || *without != i)
      for (const Column& column : chosen_[i].entry.optimum.columns) all.push_back(&column);
  return all;
}

Regression NamingWorkflow::regression(std::optional<std::size_t> without) const {
  Regression r(rows_, problem_.target);
  for (const Column* column : columns(without)) r.add(*column);
  return r;
}

double NamingWorkflow::held_gap(const Column& residual) const {
  double square = 0;
  for (const std::size_t i : held_.rows) square += residual[i] * residual[i];
  return root(square / static_cast<double>(std::max<std::size_t>(1, held_.rows.size())));
}

std::vector<Entry> NamingWorkflow::rank(const Regression& known, const Fit& base,
                                        std::optional<std::size_t> without) const {
  const Column rest = residual(base, without);
  std::vector<Entry> entries(candidates_.size());
  (void)known.mean_square_with({});  // prepared once, before the threads share it
  run_parallel(
      candidates_.size(),
      [&](std::size_t i) {
        Entry& e = entries[i];
        e.candidate = i;
        if (!candidates_[i].not_testable.empty()) return;
        for (std::size_t k = 0; k < chosen_.size(); ++k)
          if (chosen_[k].entry.candidate == i && k != without) return;
        if (std::find(banned_.begin(), banned_.end(), i) != banned_.end()) return;
        // A third of the way there, the grid may have missed the best.
        const double needed = candidates_[i].memory
                                  ? std::max(options_.least_gain_of_memory_in_floors * floors_.used,
                                             options_.least_gain_of_memory_in_effort * effort_rms_)
                                  : least_gain();
        e.optimum = search(candidates_[i], known, rest, 0.1 * needed * needed);
        if (e.usable()) judge(e, known, base);
      },
      options_.threads);
  std::erase_if(entries, [](const Entry& e) { return !e.usable(); });
  std::stable_sort(entries.begin(), entries.end(),
                   [](const Entry& a, const Entry& b) { return a.fit.loss < b.fit.loss; });
  return entries;
}

void NamingWorkflow::judge(Entry& e, const Regression& known, const Fit& base) const {
  const Candidate& candidate = candidates_[e.candidate];
  e.fit = known.fit_with(e.optimum.columns);
  const auto first = static_cast<std::size_t>(known.columns());
  std::vector<double> own;
  for (std::size_t j = 0; j < e.optimum.columns.size(); ++j)
    own.push_back(e.fit.coefficients(static_cast<Eigen::Index>(first + j)));
  e.meaning = candidate.meaning(e.optimum.theta, own);
  double most = 0;
  for (const Column& column : e.optimum.columns) most = std::max(most, known.share_left(column));
  if (most < options_.least_testable)
    e.objection = "this motion does not show it apart from the terms of the model";
  else if (!candidate.refuted.empty())
    e.objection = candidate.refuted;
  else if (!e.meaning.violation.empty())
    e.objection = "shape fits, physics does not: " + e.meaning.violation;
  else if (candidate.sized && own.size() == 1 && !(own[0] > 0.4 && own[0] < 1.8))
    e.objection = "shape fits, size does not";
  // What the effects already found leave behind is not noise.
  double largest = 0;
  for (const Chosen& c : chosen_)
    if (c.entry.candidate != e.candidate) largest = std::max(largest, c.gain);
  const double least = candidate.memory
                           ? std::max({largest * options_.least_gain_beside_memory,
                                       options_.least_gain_of_memory_in_floors * floors_.used,
                                       options_.least_gain_of_memory_in_effort * effort_rms_})
                           : largest * options_.least_gain_beside;
  const bool little = root(base.loss - e.fit.loss) < least;
  const bool part =
      candidate.memory &&
      base.loss - e.fit.loss < options_.least_explained_by_memory * structured(base.loss);
  if (e.objection.empty() && !(root(base.loss - e.fit.loss) > chance_[e.candidate]))
    e.objection = "no more than chance would show";
  if (e.objection.empty() && (little || part))
    e.objection = "too little to be told from what friction laws leave open";
}

/// Parametric bootstrap. The known terms drop out of any gain, so a record of the refitted model is
/// its noise; it goes through the search of every candidate. The tail over a whole catalogue from a
/// dozen records: Gumbel, by moments. What laws of friction leave open is no chance: the limits of
/// Options are for that.
void NamingWorkflow::draw_nulls() {
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
  std::vector<Column> records;
  std::vector<Regression> regressions;
  for (unsigned n = 0; n < options_.null_records; ++n) {
    Column white(problem_.rows() + 2 * reach);
    for (double& w : white) w = normal(random) * floors_.used / root(power);
    Column record(problem_.rows(), 0);
    for (std::size_t i = 0; i < record.size(); ++i)
      for (std::size_t k = 0; k < kernel.size(); ++k) record[i] += kernel[k] * white[i + k];
    Regression r(rows_, record);
    for (const Column* column : columns()) r.add(*column);
    (void)r.mean_square_with({});
    records.push_back(residual_of(record, columns(), r.fit().coefficients));
    regressions.push_back(std::move(r));
  }
  run_parallel(
      candidates_.size(),
      [&](std::size_t i) {
        if (!candidates_[i].not_testable.empty()) return;
        double sum = 0, square = 0;
        for (std::size_t n = 0; n < records.size(); ++n) {
          constexpr double kGridOnly = std::numeric_limits<double>::infinity();
          const Optimum o = search(candidates_[i], regressions[n], records[n], kGridOnly);
          if (o.columns.empty()) continue;
          const double gain = regressions[n].mean_square_with({}) - o.mean_square;
          sum += gain;
          square += gain * gain;
        }
        const auto count = static_cast<double>(records.size());
        const double mean = sum / count;
        const double deviation = root((square - count * mean * mean) / (count - 1));
        const double scale = deviation * std::sqrt(6.0) / (0.5 * kTwoPi);
        const double each = options_.null_probability / static_cast<double>(candidates_.size());
        constexpr double kEuler = 0.5772156649;
        chance_[i] = root(mean - scale * (kEuler + std::log(-std::log1p(-each))));
      },
      options_.threads);
}

std::vector<RankedCandidate> NamingWorkflow::table(const std::vector<Entry>& ranking,
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
