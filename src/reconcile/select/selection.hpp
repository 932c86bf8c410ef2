// Which of the candidates is missing: one run on one problem. rank.cpp (fits all candidates and
// judges each by itself), choose.cpp (which of them gets the name), guards.cpp (what an effect must
// stand), testability.cpp (what the motion cannot show), decide.cpp (order of the stages, report).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "reconcile/select/compare.hpp"
#include "reconcile/select/search.hpp"
#include "reconcile/select/standing.hpp"
#include "reconcile/select/subsets.hpp"
#include "servosense/reconcile/decide.hpp"

namespace servosense::reconcile {

/// Coordinate of what the presliding distance does.
inline constexpr const char* kSinceReversal = "travel-since-reversal";
/// Coordinate of what depends on the load.
inline constexpr const char* kTransmittedForce = "transmitted-force";

/// A candidate at its best parameters, beside everything already accepted.
struct Entry {
  std::size_t candidate = 0;
  Optimum optimum;
  Fit fit;
  Meaning meaning;
  std::string objection;
  [[nodiscard]] bool usable() const { return !optimum.columns.empty(); }
};

/// A column that has its physical size already.
[[nodiscard]] inline bool sized_right(double coefficient, const Criteria& criteria) {
  return coefficient > criteria.least_size && coefficient < criteria.largest_size;
}

/// Difference of two losses in its standard errors, over the same blocks.
[[nodiscard]] inline double standard_errors_between(const Fit& worse, const Fit& better) {
  return standard_errors_between(worse.block_loss, better.block_loss);
}

class Selection {
 public:
  Selection(const Problem& problem, const std::vector<Candidate>& candidates,
            const Options& options)
      : problem_(problem),
        candidates_(candidates),
        options_(options),
        criteria_(options.criteria),
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
  [[nodiscard]] double held_gap(const Column& residual) const {
    return rms_over(residual, held_.rows);
  }
  /// Of a coordinate; null where the problem does not have it.
  [[nodiscard]] const Column* values_along(const char* coordinate) const {
    const auto c = std::ranges::find(problem_.coordinates, coordinate, &Coordinate::name);
    return c != problem_.coordinates.end() ? &c->values : nullptr;
  }
  [[nodiscard]] std::vector<Entry> rank(const Regression& known, const Fit& base,
                                        std::optional<std::size_t> without = {}) const;
  /// An effect already found, and everything that its law, off by a little, would leave.
  struct ModelError {
    const Chosen* chosen = nullptr;
    [[nodiscard]] std::size_t candidate() const { return chosen->entry.candidate; }
    std::optional<Regression> known;  ///< with them; none where they cannot be written down
  };
  [[nodiscard]] std::vector<ModelError> model_errors(const Regression& known, const Fit& base,
                                                     std::optional<std::size_t> without) const;
  [[nodiscard]] bool outlasts_presliding(const Entry& entry) const;
  void judge(Entry& entry, const Regression& known, const Fit& base,
             const std::vector<ModelError>& found) const;
  [[nodiscard]] bool later_the_faster(const Column& timing, const Regression& known) const;
  [[nodiscard]] std::string inconstancy(const Entry& entry, const Regression& known) const;
  [[nodiscard]] bool beaten_by(const Entry& front, const Fit& fit, double errors) const;
  [[nodiscard]] std::optional<Chosen> choose(std::vector<Entry> ranking, const Regression& known,
                                             const Fit& base);
  [[nodiscard]] double structured(double loss) const {
    return std::max(0.0, loss - floors_.used * floors_.used);
  }
  /// Share of what was beyond the floor that all effects together explain.
  [[nodiscard]] double explained_by_all() const {
    const double whole = structured(start_loss_);
    return whole > 0 ? 1 - structured(regression().fit().loss) / whole : 1;
  }
  [[nodiscard]] double least_gain() const { return options_.least_gain(floors_.used, effort_rms_); }
  /// That of a candidate: more for a bristle, or what acts like one, which may be any friction
  /// law's presliding.
  [[nodiscard]] double least_gain_of(const Candidate& candidate, bool like_bristle = false) const {
    return options_.least_gain(
        floors_.used, effort_rms_,
        like_bristle || (candidate.memory && candidate.where == kSinceReversal));
  }
  [[nodiscard]] bool both_physical(const Entry& a, const Entry& b, const Fit& fit,
                                   const Regression& known) const;
  [[nodiscard]] bool all_that_is_seen(const Entry& entry, const Fit& base) const;
  [[nodiscard]] bool contains(const Entry& richer, const Entry& entry,
                              const Regression& known) const;
  [[nodiscard]] std::vector<std::size_t> class_of(const std::vector<Entry>& ranking,
                                                  std::size_t best, const Fit& base,
                                                  const Regression& known) const;
  [[nodiscard]] double pick_frequency(const std::vector<Entry>& ranking, std::size_t best,
                                      const std::vector<std::size_t>& members,
                                      const Regression& known) const;
  [[nodiscard]] double resampled_share(const std::vector<Fit>& fits,
                                       const std::vector<bool>& good) const;
  bool join(const std::vector<Entry>& ranking, const Fit& base);
  void draw_nulls();
  void drop(std::size_t i, const std::string& why);
  void prefer_simpler(const std::vector<Entry>& ranking, const Regression& known, std::size_t& best,
                      std::vector<std::size_t>& members) const;
  [[nodiscard]] std::string objection_beside(const std::vector<Entry>& ranking, std::size_t best,
                                             const std::vector<std::size_t>& members,
                                             const Regression& known, const Fit& base);
  [[nodiscard]] FoundEffect described(const std::vector<Entry>& ranking, std::size_t best,
                                      const std::vector<std::size_t>& members,
                                      const Regression& known, const Fit& base) const;
  bool stands(std::size_t i);
  bool settle();
  [[nodiscard]] double unsteadiness(std::size_t i, const Fit& fit, const Column& rest) const;
  bool drop_proxies();
  bool drop_unsure();
  /// Coefficients of one effect in a fit of all, and their standard errors.
  struct Own {
    std::vector<double> values, errors;
  };
  [[nodiscard]] Own own_of(std::size_t i, const Fit& fit) const;
  void prune();
  void follow_gap(Decision& decision);
  void refine();
  [[nodiscard]] std::vector<NamedValue> errors_of(const Chosen& chosen, const Regression& known,
                                                  const Own& own) const;
  [[nodiscard]] double unexplained_along(const Eigen::VectorXd& slope,
                                         const Eigen::VectorXd& rest) const;
  void finish(Decision& decision);
  void testability(Decision& decision) const;
  [[nodiscard]] FitRows rows_at_steady_speeds() const;
  [[nodiscard]] std::vector<RankedCandidate> table(const std::vector<Entry>& ranking,
                                                   const Fit& base) const;

  const Problem& problem_;
  const std::vector<Candidate>& candidates_;
  const Options& options_;
  const Criteria& criteria_;
  FitRows rows_, held_;
  Floors floors_;
  double effort_rms_ = 0;
  double start_loss_ = 0;  // without an effect
  std::vector<Chosen> chosen_;
  std::vector<RankedCandidate> last_ranking_;
  std::string why_nothing_;
  std::string resembles_;             // of a rival that has beaten all names
  std::vector<double> chance_;        // gain of each candidate that chance would show, once drawn
  std::vector<std::size_t> banned_;   // candidates that failed a guard
  std::vector<std::string> proxies_;  // names that another law was seen to beat
};

}  // namespace servosense::reconcile
