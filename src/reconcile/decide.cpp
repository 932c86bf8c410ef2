#include "servosense/reconcile/decide.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <random>

#include "search.hpp"
#include "servosense/core/units.hpp"
#include "servosense/sim/run_parallel.hpp"

namespace servosense::reconcile {
namespace {

/// A candidate at its best parameters, beside everything already accepted.
struct Entry {
  std::size_t candidate = 0;
  Optimum optimum;
  Fit fit;
  Meaning meaning;
  std::string objection;
  [[nodiscard]] bool usable() const { return !optimum.columns.empty(); }
};

/// Difference of two losses in its standard errors, over the same blocks.
double standard_errors_between(const Fit& worse, const Fit& better) {
  double sum = 0, square = 0;
  const auto n = static_cast<double>(worse.block_loss.size());
  for (std::size_t b = 0; b < worse.block_loss.size(); ++b) {
    const double d = worse.block_loss[b] - better.block_loss[b];
    sum += d;
    square += d * d;
  }
  const double variance = std::max(1e-300, (square - sum * sum / n) * n / (n - 1));
  return sum / std::sqrt(variance);
}

class Workflow {
 public:
  Workflow(const Problem& problem, const std::vector<Candidate>& candidates, const Options& options)
      : problem_(problem),
        candidates_(candidates),
        options_(options),
        rows_(fit_rows(problem, options.blocks)),
        held_(fit_rows(problem, options.blocks, true)) {}

  Decision run();

 private:
  struct Chosen {
    Entry entry;
    double gain = 0;
    FoundEffect effect;
  };

  [[nodiscard]] Regression regression(std::optional<std::size_t> without = {}) const;
  [[nodiscard]] std::vector<const Column*> columns(std::optional<std::size_t> without = {}) const;
  [[nodiscard]] Column residual(const Fit& fit, std::optional<std::size_t> without = {}) const {
    return residual_of(problem_.target, columns(without), fit.coefficients);
  }
  [[nodiscard]] double held_gap(const Column& residual) const;
  [[nodiscard]] std::vector<Entry> rank(const Regression& known, const Fit& base,
                                        std::optional<std::size_t> without = {}) const;
  void judge(Entry& entry, const Regression& known, const Fit& base) const;
  [[nodiscard]] std::string inconstancy(const Entry& entry, const Regression& known) const;
  [[nodiscard]] std::optional<Chosen> choose(std::vector<Entry> ranking, const Regression& known,
                                             const Fit& base);
  [[nodiscard]] double structured(double loss) const {
    return std::max(0.0, loss - floors_.used * floors_.used);
  }
  [[nodiscard]] double least_gain() const {
    return std::max(options_.least_gain_in_floors * floors_.used,
                    options_.least_gain_in_effort * effort_rms_);
  }
  [[nodiscard]] std::vector<std::size_t> class_of(const std::vector<Entry>& ranking,
                                                  std::size_t best, const Fit& base,
                                                  const Regression& known) const;
  [[nodiscard]] double pick_frequency(const std::vector<Entry>& ranking, std::size_t best,
                                      const std::vector<std::size_t>& members) const;
  void draw_nulls();
  bool settle();
  bool drop_proxies();
  bool prune();
  void follow_gap(Decision& decision);
  void refine();
  void finish(Decision& decision);
  void testability(Decision& decision) const;
  [[nodiscard]] std::vector<RankedCandidate> table(const std::vector<Entry>& ranking,
                                                   const Fit& base) const;

  const Problem& problem_;
  const std::vector<Candidate>& candidates_;
  const Options& options_;
  FitRows rows_, held_;
  Floors floors_;
  double effort_rms_ = 0;
  std::vector<Chosen> chosen_;
  std::vector<RankedCandidate> last_ranking_;
  std::string why_nothing_;
  std::vector<double> chance_;       // gain of each candidate that chance would show
  std::vector<std::size_t> banned_;  // candidates that failed a guard
};

std::vector<const Column*> Workflow::columns(std::optional<std::size_t> without) const {
  std::vector<const Column*> all;
  for (const KnownTerm& term : problem_.known) all.push_back(&term.column);
  for (std::size_t i = 0; i < chosen_.size(); ++i)
    if (!without || *without != i)
      for (const Column& column : chosen_[i].entry.optimum.columns) all.push_back(&column);
  return all;
}

Regression Workflow::regression(std::optional<std::size_t> without) const {
  Regression r(rows_, problem_.target);
  for (const Column* column : columns(without)) r.add(*column);
  return r;
}

double Workflow::held_gap(const Column& residual) const {
  double square = 0;
  for (const std::size_t i : held_.rows) square += residual[i] * residual[i];
  return root(square / static_cast<double>(std::max<std::size_t>(1, held_.rows.size())));
}

std::vector<Entry> Workflow::rank(const Regression& known, const Fit& base,
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

void Workflow::judge(Entry& e, const Regression& known, const Fit& base) const {
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
void Workflow::draw_nulls() {
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

/// A cause has one size everywhere; a proxy changes with the range it is fitted on.
std::string Workflow::inconstancy(const Entry& e, const Regression& known) const {
  // The effect as fitted, one column; its share above and below the middle of each coordinate.
  const auto first = known.columns();
  Column whole(problem_.rows(), 0);
  for (std::size_t j = 0; j < e.optimum.columns.size(); ++j) {
    const double c = e.fit.coefficients(first + static_cast<Eigen::Index>(j));
    for (std::size_t i = 0; i < whole.size(); ++i) whole[i] += c * e.optimum.columns[j][i];
  }
  for (const Coordinate& coordinate : problem_.coordinates) {
    if (coordinate.period > 0 || !coordinate.factor.empty()) continue;
    // What acts at reversals has no range of speeds or accelerations to be compared over.
    if (candidates_[e.candidate].memory && coordinate.name != "time" &&
        coordinate.name != "position")
      continue;
    const bool speed = coordinate.name == "velocity";
    const auto value = [&](std::size_t i) {
      return speed ? std::abs(coordinate.values[i]) : coordinate.values[i];
    };
    // The middle in the sense of the effect's own energy, so both halves show it.
    std::vector<std::pair<double, double>> energy;
    double sum = 0;
    for (const std::size_t i : rows_.rows) {
      energy.emplace_back(value(i), whole[i] * whole[i]);
      sum += whole[i] * whole[i];
    }
    std::sort(energy.begin(), energy.end());
    double below = 0, middle = 0;
    for (const auto& [v, w] : energy) {
      below += w;
      if (below > 0.5 * sum) {
        middle = v;
        break;
      }
    }
    Column upper(whole.size(), 0);
    for (std::size_t i = 0; i < whole.size(); ++i)
      if (value(i) > middle) upper[i] = whole[i];
    const Fit split = known.fit_with({whole, upper});
    const double change = split.coefficients(first + 1);
    const double error = split.standard_errors(first + 1);
    if (std::abs(change) > options_.largest_inconstancy && std::abs(change) > 4 * error)
      return "its size changes with " + coordinate.name + (speed ? "" : " along the record");
  }
  return {};
}

std::vector<RankedCandidate> Workflow::table(const std::vector<Entry>& ranking,
                                             const Fit& base) const {
  std::vector<RankedCandidate> rows;
  const double whole = std::max(1e-300, structured(base.loss));
  for (const Entry& e : ranking)
    rows.push_back({candidates_[e.candidate].name, root(e.fit.loss),
                    std::clamp((base.loss - e.fit.loss) / whole, 0.0, 1.0), e.objection,
                    chance_[e.candidate]});
  return rows;
}

std::optional<Workflow::Chosen> Workflow::choose(std::vector<Entry> ranking,
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
    why_nothing_ = "no candidate explains more than the noise allows";
    return {};
  }
  std::size_t best = static_cast<std::size_t>(first_allowed - ranking.begin());
  if (best > 0) {
    const Entry& front = ranking[0];
    if (!candidates_[front.candidate].memory &&
        root(first_allowed->fit.loss - front.fit.loss) > least_gain() &&
        standard_errors_between(first_allowed->fit, front.fit) > options_.class_standard_errors) {
      why_nothing_ = candidates_[front.candidate].name + ": " + front.objection;
      return {};
    }
  }
  double explained = (base.loss - ranking[best].fit.loss) / std::max(1e-300, whole);

  // When one does not carry the gap, perhaps two do: then take the stronger of the best pair.
  if (explained < 0.7) {
    std::vector<std::size_t> top;
    for (std::size_t i = 0; i < ranking.size() && top.size() < 6; ++i)
      if (allowed(ranking[i])) top.push_back(i);
    double least = std::numeric_limits<double>::infinity(), least_with_best = least;
    std::pair<std::size_t, std::size_t> pair{best, best};
    Fit pair_fit, with_best_fit;
    for (std::size_t a = 0; a < top.size(); ++a)
      for (std::size_t b = a + 1; b < top.size(); ++b) {
        std::vector<Column> both = ranking[top[a]].optimum.columns;
        const auto& more = ranking[top[b]].optimum.columns;
        both.insert(both.end(), more.begin(), more.end());
        Fit fit = known.fit_with(both);
        if (top[a] == best && fit.loss < least_with_best) {
          least_with_best = fit.loss;
          with_best_fit = fit;
        }
        if (fit.loss < least) {
          least = fit.loss;
          pair = {top[a], top[b]};
          pair_fit = std::move(fit);
        }
      }
    if (top.size() >= 2) {
      if (pair.first != best &&
          standard_errors_between(with_best_fit, pair_fit) > options_.class_standard_errors)
        best = pair.first;
      explained = std::max(explained, 0.5 * (base.loss - least) / std::max(1e-300, whole));
    }
  }
  Entry& entry = ranking[best];
  const Candidate& candidate = candidates_[entry.candidate];
  if (explained < options_.least_explained) {
    why_nothing_ = "the best candidate, " + candidate.name + ", explains only " +
                   std::to_string(static_cast<int>(100 * explained)) +
                   " % of what is beyond the noise";
    return {};
  }
  const std::vector<std::size_t> members = class_of(ranking, best, base, known);
  const double frequency = pick_frequency(ranking, best, members);
  if (frequency < options_.least_pick_frequency) {
    why_nothing_ = "resampled data pick other names than " + candidate.name;
    return {};
  }
  Chosen chosen;
  chosen.gain = gain(entry);
  chosen.entry = std::move(entry);
  return chosen;
}

/// What loses by no more than chance. A richer candidate that contains the best one is no rival.
std::vector<std::size_t> Workflow::class_of(const std::vector<Entry>& ranking, std::size_t best,
                                            const Fit& base, const Regression& known) const {
  const Entry& entry = ranking[best];
  std::vector<std::size_t> members;
  for (std::size_t i = 0; i < ranking.size(); ++i) {
    const Entry& other = ranking[i];
    if (i == best || !other.objection.empty()) continue;
    const bool close =
        standard_errors_between(other.fit, entry.fit) < options_.class_standard_errors ||
        root(other.fit.loss - entry.fit.loss) < 0.2 * floors_.used;
    // Blocks that differ much make the standard error large; what leaves much more than the best,
    // on the very rows of the fit, is no rival all the same.
    const double more = other.fit.mean_square - entry.fit.mean_square;
    if (more > std::max(least_gain() * least_gain(), 0.25 * entry.fit.mean_square)) continue;
    // It must itself explain what the best explains.
    if (!close || base.loss - other.fit.loss < 0.5 * (base.loss - entry.fit.loss)) continue;
    if (other.optimum.columns.size() > entry.optimum.columns.size()) {
      Regression with = known;
      for (const Column& column : other.optimum.columns) with.add(column);
      double most = 0;
      for (const Column& column : entry.optimum.columns)
        most = std::max(most, with.share_left(column) / std::max(1e-300, known.share_left(column)));
      if (most < 0.05) continue;
    }
    members.push_back(i);
  }
  return members;
}

/// Would other data of the same kind have given the same name, or one of its class?
double Workflow::pick_frequency(const std::vector<Entry>& ranking, std::size_t best,
                                const std::vector<std::size_t>& members) const {
  std::mt19937_64 random(options_.seed);
  const std::size_t blocks = rows_.blocks();
  unsigned picked = 0;
  for (unsigned k = 0; k < options_.resamples; ++k) {
    std::vector<double> weight(blocks, 0);
    for (std::size_t b = 0; b < blocks; ++b) ++weight[random() % blocks];
    std::size_t winner = best;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < ranking.size(); ++i) {
      if (!ranking[i].objection.empty()) continue;
      const double loss =
          std::inner_product(weight.begin(), weight.end(), ranking[i].fit.block_loss.begin(), 0.0);
      if (loss < least) {
        least = loss;
        winner = i;
      }
    }
    if (winner == best || std::find(members.begin(), members.end(), winner) != members.end())
      ++picked;
  }
  return static_cast<double>(picked) / options_.resamples;
}

/// Each effect again, beside all others: is it still the best, what else would do, and does it
/// keep the rules? Takes out the one that fails; true when nothing changed.
bool Workflow::settle() {
  for (std::size_t i = 0; i < chosen_.size(); ++i) {
    const Regression known = regression(i);
    const Fit base = known.fit();
    std::vector<Entry> ranking = rank(known, base, i);
    const auto allowed = [](const Entry& e) { return e.objection.empty(); };
    const auto mine = std::find_if(ranking.begin(), ranking.end(), [&](const Entry& e) {
      return e.candidate == chosen_[i].entry.candidate;
    });
    const auto first = std::find_if(ranking.begin(), ranking.end(), allowed);
    const auto drop = [&](const std::string& why) {
      why_nothing_ = candidates_[chosen_[i].entry.candidate].name + ": " + why;
      last_ranking_ = table(ranking, base);
      banned_.push_back(chosen_[i].entry.candidate);
      chosen_.erase(chosen_.begin() + static_cast<long>(i));
    };
    if (first == ranking.end() || mine == ranking.end() || !allowed(*mine)) {
      drop(mine == ranking.end() ? "cannot be fitted" : mine->objection);
      return false;
    }
    std::size_t best = static_cast<std::size_t>(mine - ranking.begin());
    if (first != mine &&
        standard_errors_between(mine->fit, first->fit) > options_.class_standard_errors)
      best = static_cast<std::size_t>(first - ranking.begin());
    std::vector<std::size_t> members = class_of(ranking, best, base, known);
    // The simplest of those that fit alike gives the name.
    const auto size_of = [](const Entry& e) {
      return e.optimum.columns.size() + e.optimum.theta.size();
    };
    for (std::size_t& m : members)
      if (size_of(ranking[m]) < size_of(ranking[best]) &&
          standard_errors_between(ranking[m].fit, ranking[best].fit) < 1)
        std::swap(m, best);
    const bool exchanged = ranking[best].candidate != chosen_[i].entry.candidate;
    Entry& named = ranking[best];
    const Candidate& who = candidates_[named.candidate];
    if (root(base.loss - named.fit.loss) < least_gain()) {
      drop("adds nothing beside the others");
      return false;
    }
    if (members.size() > 2) {
      drop("this motion cannot tell it from " + std::to_string(members.size()) + " other effects");
      return false;
    }
    if (std::string why = inconstancy(named, known); !why.empty()) {
      drop(why);
      return false;
    }
    FoundEffect& effect = chosen_[i].effect;
    effect = {};
    effect.name = who.name;
    effect.scope = who.scope;
    effect.where = who.where;
    effect.class_members = who.equals;
    for (const std::size_t m : members) {
      const std::string& other = candidates_[ranking[m].candidate].name;
      if (std::find(effect.class_members.begin(), effect.class_members.end(), other) ==
          effect.class_members.end())
        effect.class_members.push_back(other);
    }
    if (!effect.class_members.empty()) effect.splitting_motion = who.splitting_motion;
    effect.share_of_residual = std::clamp((base.loss - named.fit.loss) / base.loss, 0.0, 1.0);
    double margin = 8;
    for (std::size_t k = 0; k < ranking.size(); ++k) {
      if (k == best || !allowed(ranking[k]) ||
          std::find(members.begin(), members.end(), k) != members.end())
        continue;
      margin = standard_errors_between(ranking[k].fit, named.fit);
      effect.runner_up = candidates_[ranking[k].candidate].name;
      effect.runner_up_gap = root(ranking[k].fit.loss);
      break;
    }
    effect.confidence = std::min(
        0.99, pick_frequency(ranking, best, members) * 0.5 * std::erfc(-margin / std::sqrt(2.0)));
    effect.ranking = table(ranking, base);
    chosen_[i].gain = root(base.loss - named.fit.loss);
    chosen_[i].entry = std::move(named);
    if (exchanged) return false;
  }
  return true;
}

/// A free function of its own coordinate must not explain much of what an effect leaves behind:
/// then the effect only stands in for something else there.
bool Workflow::drop_proxies() {
  const Fit fit = regression().fit();
  // An effect must pay where it was not fitted, by a fair part of what it paid where it was.
  const double held = held_gap(residual(fit));
  for (std::size_t i = 0; i < chosen_.size(); ++i) {
    const Fit without = regression(i).fit();
    const double fitted = 1 - fit.loss / without.loss;
    const double before = held_gap(residual(without, i));
    if (1 - held * held / (before * before) > options_.least_held_out_share * fitted) continue;
    why_nothing_ = candidates_[chosen_[i].entry.candidate].name + ": fails on the held-out part";
    banned_.push_back(chosen_[i].entry.candidate);
    chosen_.erase(chosen_.begin() + static_cast<long>(i));
    return true;
  }
  const std::vector<ResidualMap> maps = maps_of(problem_, residual(fit), options_);
  for (std::size_t i = 0; i < chosen_.size(); ++i) {
    const Candidate& c = candidates_[chosen_[i].entry.candidate];
    const double gain = regression(i).fit().loss - fit.loss;
    for (const ResidualMap& map : maps) {
      if (map.variable != c.where || map.probability > 0.05) continue;
      if (map.share * fit.loss > options_.largest_proxy * gain) {
        why_nothing_ = c.name + ": a free function of " + map.variable +
                       " explains more than it; something else acts there";
        banned_.push_back(chosen_[i].entry.candidate);
        chosen_.erase(chosen_.begin() + static_cast<long>(i));
        return true;
      }
    }
  }
  return false;
}

/// Takes out again what later additions made needless. True when something went.
bool Workflow::prune() {
  bool any = false;
  for (std::size_t i = 0; i < chosen_.size() && chosen_.size() > 1;) {
    const double with = regression().fit().loss;
    const double without = regression(i).fit().loss;
    if (root(without - with) < least_gain()) {
      chosen_.erase(chosen_.begin() + static_cast<long>(i));
      any = true;
    } else {
      ++i;
    }
  }
  return any;
}

/// Nonlinear parameters of all effects again, each beside the others.
void Workflow::refine() {
  for (int round = 0; round < (chosen_.size() > 1 ? 2 : 1); ++round)
    for (std::size_t i = 0; i < chosen_.size(); ++i) {
      Entry& e = chosen_[i].entry;
      if (e.optimum.theta.empty()) continue;
      const Regression others = regression(i);
      Optimum better = search(candidates_[e.candidate], others, {}, 0, &e.optimum.theta);
      if (!better.columns.empty()) e.optimum = std::move(better);
    }
}

void Workflow::testability(Decision& decision) const {
  const Regression known = regression();
  for (const Candidate& c : candidates_) {
    if (!c.not_testable.empty()) {
      decision.report.not_testable.push_back({c.name, c.not_testable, c.would_need});
      continue;
    }
    // At the middle of its range: is there anything that the known terms cannot imitate?
    std::vector<double> theta;
    for (const SearchRange& r : c.search)
      theta.push_back(r.logarithmic ? std::sqrt(r.low * r.high) : 0.5 * (r.low + r.high));
    double most = 0;
    for (const Column& column : c.columns(theta)) most = std::max(most, known.share_left(column));
    if (most < options_.least_testable) {
      decision.report.not_testable.push_back(
          {c.name, "with this motion the terms of the model can imitate it", c.splitting_motion});
      continue;
    }
    // The size at which it would just be worth a term.
    const std::vector<Column> columns = c.columns(theta);
    if (columns.empty() || c.sized) continue;
    const double unit = known.projected(columns[0]).norm() /
                        std::sqrt(static_cast<double>(std::max<std::size_t>(1, rows_.rows.size())));
    if (!(unit > 0)) continue;
    std::vector<double> own(columns.size(), 0);
    own[0] = least_gain() / unit;
    for (const NamedValue& v : c.meaning(theta, own).parameters)
      if (v.values.size() == 1 && std::abs(v.values[0] - own[0]) < 1e-9 * own[0])
        decision.report.detectable.push_back({c.name, v.key, own[0]});
  }
}

Decision Workflow::run() {
  Decision decision;
  double square = 0;
  for (const std::size_t i : rows_.rows) square += problem_.target[i] * problem_.target[i];
  effort_rms_ = root(square / static_cast<double>(std::max<std::size_t>(1, rows_.rows.size())));

  const Regression start = regression();
  const Fit first = start.fit();
  const Column before = residual(first);
  floors_ = floors_of(problem_, before);
  decision.report.maps_before = maps_of(problem_, before, options_);
  decision.report.gap_before = held_gap(before);
  decision.report.simulated_before = problem_.target;
  for (std::size_t i = 0; i < before.size(); ++i) decision.report.simulated_before[i] -= before[i];

  testability(decision);
  decision.report.classes = classes_of(problem_, candidates_, options_);
  draw_nulls();

  while (chosen_.size() < options_.most_effects) {
    const Regression known = regression();
    const Fit base = known.fit();
    const Floors now = floors_of(problem_, residual(base));
    if (now.used > 0) floors_ = now;
    if (root(structured(base.loss)) < least_gain()) {
      why_nothing_.clear();
      break;
    }
    auto next = choose(rank(known, base), known, base);
    if (!next) break;
    chosen_.push_back(std::move(*next));
    refine();
  }
  prune();
  for (unsigned round = 0; round < 2 * options_.most_effects; ++round)
    if (settle() && !drop_proxies()) break;
  finish(decision);
  return decision;
}

/// The gap on held-out data as the effects come in one after the other.
void Workflow::follow_gap(Decision& decision) {
  std::vector<Chosen> all;
  std::swap(all, chosen_);
  const auto step = [&] {
    const Fit fit = regression().fit();
    decision.steps.emplace_back(fit.coefficients.begin(), fit.coefficients.end());
    return held_gap(residual(fit));
  };
  double gap = step();
  for (Chosen& c : all) {
    c.effect.gap_before = gap;
    chosen_.push_back(std::move(c));
    gap = step();
    chosen_.back().effect.gap_after = gap;
  }
}

void Workflow::finish(Decision& decision) {
  follow_gap(decision);
  Report& report = decision.report;
  const Regression known = regression();
  const Fit fit = known.fit();
  const Column rest = residual(fit);
  report.gap_unit = problem_.unit;
  report.effort_rms = effort_rms_;
  report.floors = floors_;
  report.gap_after = held_gap(rest);
  report.maps_after = maps_of(problem_, rest, options_);
  report.ranking = last_ranking_;

  Eigen::Index at = 0;
  for (const KnownTerm& term : problem_.known) {
    const double value = fit.coefficients(at);
    decision.known.push_back(value);
    decision.known_errors.push_back(fit.standard_errors(at));
    if (term.recalibrated)
      report.recalibrated.push_back({term.name, term.nominal, value, fit.standard_errors(at)});
    ++at;
  }
  for (Chosen& c : chosen_) {
    const Candidate& candidate = candidates_[c.entry.candidate];
    std::vector<double> own, errors;
    for (std::size_t j = 0; j < c.entry.optimum.columns.size(); ++j, ++at) {
      own.push_back(fit.coefficients(at));
      errors.push_back(fit.standard_errors(at));
    }
    const Meaning meaning = candidate.meaning(c.entry.optimum.theta, own);
    c.effect.parameters = meaning.parameters;
    // Errors by small changes of each coefficient and nonlinear parameter.
    c.effect.standard_errors = meaning.parameters;
    for (NamedValue& v : c.effect.standard_errors) std::fill(v.values.begin(), v.values.end(), 0.0);
    const auto spread = [&](const Meaning& moved, double by) {
      for (std::size_t p = 0; p < moved.parameters.size() && p < meaning.parameters.size(); ++p)
        for (std::size_t k = 0;
             k < moved.parameters[p].values.size() && k < meaning.parameters[p].values.size();
             ++k) {
          const double d = (moved.parameters[p].values[k] - meaning.parameters[p].values[k]) * by;
          double& e = c.effect.standard_errors[p].values[k];
          e = std::hypot(e, d);
        }
    };
    for (std::size_t j = 0; j < own.size(); ++j) {
      std::vector<double> moved = own;
      moved[j] += errors[j];
      spread(candidate.meaning(c.entry.optimum.theta, moved), 1);
    }
    for (std::size_t k = 0; k < c.entry.optimum.theta.size(); ++k) {
      std::vector<double> theta = c.entry.optimum.theta;
      const double small = 0.02 * std::max(std::abs(theta[k]), 1e-12);
      theta[k] += small;
      const std::vector<Column> moved = candidate.columns(theta);
      if (moved.size() != own.size()) continue;
      Column slope(problem_.rows(), 0);
      for (std::size_t j = 0; j < own.size(); ++j)
        for (std::size_t i = 0; i < slope.size(); ++i)
          slope[i] += own[j] * (moved[j][i] - c.entry.optimum.columns[j][i]);
      const Fit with = known.fit_with({slope});
      spread(candidate.meaning(theta, own), with.standard_errors(known.columns()));
    }
    decision.accepted.push_back({c.entry.candidate, c.entry.optimum.theta, own, meaning});
    report.effects.push_back(c.effect);
  }

  report.time_s = problem_.time_s;
  report.measured = problem_.target;
  report.compared = problem_.usable;
  report.simulated_after = problem_.target;
  for (std::size_t i = 0; i < rest.size(); ++i) report.simulated_after[i] -= rest[i];
  if (!held_.rows.empty()) {
    report.held_from_s = problem_.time_s[held_.rows.front()];
    report.held_to_s = problem_.time_s[held_.rows.back()];
  }

  const double left = structured(fit.loss);
  const bool at_floor = report.gap_after <= options_.floor_tolerance * floors_.used ||
                        root(left) < least_gain() || report.gap_after < 0.01 * effort_rms_;
  if (report.effects.empty())
    report.verdict = at_floor ? Verdict::agrees : Verdict::unexplained;
  else
    report.verdict = at_floor ? Verdict::explained : Verdict::partly_explained;
  report.residual_white = at_floor;
  report.residual_detail = why_nothing_;
}

}  // namespace

std::vector<Alike> classes_of(const Problem& problem, const std::vector<Candidate>& candidates,
                              const Options& options) {
  const FitRows rows = fit_rows(problem, options.blocks);
  Regression known(rows, problem.target);
  for (const KnownTerm& term : problem.known) known.add(term.column);
  struct Shape {
    std::size_t candidate;
    std::vector<Eigen::VectorXd> columns;
  };
  std::vector<Shape> shapes;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const Candidate& c = candidates[i];
    if (!c.not_testable.empty()) continue;
    std::vector<double> theta;
    for (const SearchRange& r : c.search)
      theta.push_back(r.logarithmic ? std::sqrt(r.low * r.high) : 0.5 * (r.low + r.high));
    Shape shape{i, {}};
    for (const Column& column : c.columns(theta))
      if (known.share_left(column) > options.least_testable)
        shape.columns.push_back(known.projected(column).normalized());
    if (shape.columns.size() == 1) shapes.push_back(std::move(shape));
  }
  std::vector<Alike> classes;
  std::vector<bool> taken(shapes.size(), false);
  for (std::size_t a = 0; a < shapes.size(); ++a) {
    if (taken[a]) continue;
    Alike alike;
    std::vector<std::string> motions;
    const auto join = [&](const Candidate& c) {
      alike.names.push_back(c.name);
      for (const std::string& name : c.equals)
        if (std::find(alike.names.begin(), alike.names.end(), name) == alike.names.end())
          alike.names.push_back(name);
      if (std::find(motions.begin(), motions.end(), c.splitting_motion) == motions.end())
        motions.push_back(c.splitting_motion);
    };
    join(candidates[shapes[a].candidate]);
    for (std::size_t b = a + 1; b < shapes.size(); ++b)
      if (!taken[b] &&
          std::abs(shapes[a].columns[0].dot(shapes[b].columns[0])) > options.class_correlation) {
        taken[b] = true;
        join(candidates[shapes[b].candidate]);
      }
    if (alike.names.size() < 2) continue;
    for (const std::string& motion : motions)
      if (!motion.empty()) alike.split_by += (alike.split_by.empty() ? "" : "; ") + motion;
    classes.push_back(std::move(alike));
  }
  return classes;
}

Decision decide(const Problem& problem, const std::vector<Candidate>& candidates,
                const Options& options) {
  return Workflow(problem, candidates, options).run();
}

const char* name_of(Verdict verdict) noexcept {
  switch (verdict) {
    case Verdict::agrees:
      return "agrees";
    case Verdict::explained:
      return "explained";
    case Verdict::partly_explained:
      return "partly-explained";
    case Verdict::unexplained:
      return "unexplained";
  }
  return "unexplained";
}

}  // namespace servosense::reconcile
