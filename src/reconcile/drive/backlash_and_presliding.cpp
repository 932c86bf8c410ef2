// Backlash beside what moves its load, and beside the presliding distance, which was fitted without
// it.
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "reconcile/drive/candidates/kinds.hpp"
#include "reconcile/drive/workflow.hpp"
#include "reconcile/select/search.hpp"

namespace servosense::reconcile {
namespace {

constexpr std::size_t kMostRefits = 4;  // of the grid, each followed to its least
constexpr double kPreslidingStep = 1.5, kFinePreslidingStep = 1.05;

/// Whether physics would allow it.
bool sound(const Candidate& candidate, const Regression& known, const Optimum& optimum) {
  const Fit fit = known.fit_with(optimum.columns);
  std::vector<double> own;
  for (Eigen::Index k = known.columns(); k < fit.coefficients.size(); ++k)
    own.push_back(fit.coefficients(k));
  return candidate.meaning(optimum.theta, own).violation.empty();
}

/// Backlash of the grid beside the presliding distance with which it leaves least.
struct BacklashStart {
  std::vector<double> theta;
  std::size_t presliding = 0;
  double mean_square = std::numeric_limits<double>::infinity();
};

/// Every backlash of a grid is tried beside every presliding distance: the best that physics
/// allows.
std::vector<BacklashStart> best_starts(const Candidate& backlash,
                                       const std::vector<Regression>& beside) {
  std::vector<BacklashStart> starts;
  for (std::vector<double>& theta : starts_of_backlash(backlash.search)) {
    // Hundreds of backlashes of a long record would not fit into memory: their columns go at once.
    const std::vector<Column> columns = backlash.columns(theta);
    if (columns.empty()) continue;
    BacklashStart start{std::move(theta)};
    for (std::size_t k = 0; k < beside.size(); ++k) {
      const double square = Addition(beside[k], columns, false).mean_square(beside[k].rest());
      if (!(square < start.mean_square)) continue;
      start.mean_square = square;
      start.presliding = k;
    }
    starts.push_back(std::move(start));
  }
  std::sort(starts.begin(), starts.end(), [](const BacklashStart& a, const BacklashStart& b) {
    return a.mean_square < b.mean_square;
  });
  std::vector<BacklashStart> best;
  for (BacklashStart& start : starts) {
    if (best.size() == kMostRefits) break;
    if (sound(backlash, beside[start.presliding], {start.theta, backlash.columns(start.theta), 0}))
      best.push_back(std::move(start));
  }
  return best;
}

}  // namespace

/// The friction and the loads of the drive, whether the model has them or a first pass found them.
DriveModelConfig DriveWorkflow::with_found() const {
  DriveModelConfig drive = model_;
  for (const EffectSetting& found : acting_) {
    const std::string name = kDriveEffects[found.effect].name;
    if (name == "viscous-friction") drive.viscous += found.scalar(0);
    if (name == "coulomb-friction") drive.coulomb += found.scalar(0);
    if (name == kConstantLoad) drive.constant_load += found.scalar(0);
    if (name == "spring-load" || name == "load-dependent-friction")
      add_effect(drive.effects, found);
  }
  return drive;
}

/// Whether backlash is worth a term, though not beside the presliding distance that was fitted
/// without it and may have stood for part of it: hardly wider than that, too little, or no good
/// elsewhere.
bool DriveWorkflow::backlash_worth_a_term() const {
  const Report& report = decision_.report;
  if (decision_.accepted.empty() &&
      std::any_of(decision_.failed.begin(), decision_.failed.end(),
                  [&](std::size_t k) { return candidates_[k].name == kBacklash; }))
    return true;
  const double least = options_.least_gain(report.floors.used, report.effort_rms);
  return std::any_of(report.ranking.begin(), report.ranking.end(), [&](const RankedCandidate& c) {
    return c.name == kBacklash && decision_.loss - c.gap_after * c.gap_after > least * least;
  });
}

/// Presliding distance and backlash that together leave least beside all that is known, and the
/// columns of that backlash; none where physics would allow none. Beside the backlash the
/// presliding distance is no longer than the one that was fitted alone, which has taken what it can
/// of the backlash.
std::vector<Column> DriveWorkflow::fit_presliding_and_backlash() {
  const FitRows rows = fit_rows(problem_, options_.blocks);
  const double longest = model_.friction_knee;
  if (backlash_.empty()) presliding_alone_ = longest;
  // A presliding distance that was fitted beside a bristle stays.
  const double shortest = presliding_found_ ? longest : std::min(longest, shortest_presliding());
  const auto searched = [&](double presliding) {
    return presliding > shortest / 1.01 && presliding < 1.01 * longest;
  };
  dropped_terms_.clear();
  const auto known_beside = [&](double presliding) {
    model_.friction_knee = presliding;
    add_known_terms(true);
    return regression_of_known(problem_, rows);
  };
  const auto backlash_beside = [&](double presliding) {
    model_.friction_knee = presliding;
    DriveSituation s = situation();
    s.model.friction_knee = shortest;
    return backlash_candidate(drive_effect_index(kBacklash), s);
  };
  std::vector<double> distances;
  for (double presliding = longest; searched(presliding); presliding /= kPreslidingStep)
    distances.push_back(presliding);
  std::vector<Regression> beside;
  for (const double presliding : distances) beside.push_back(known_beside(presliding));
  struct {
    Optimum backlash;
    double presliding = 0;
  } best;
  best.presliding = longest;
  best.backlash.mean_square = std::numeric_limits<double>::infinity();
  const auto consider = [&](double presliding, const std::vector<double>& theta) {
    if (!searched(presliding)) return;
    const Candidate candidate = backlash_beside(presliding);
    const Regression known = known_beside(presliding);
    Optimum backlash = search(candidate, known, {}, 0, &theta);
    if (backlash.mean_square < best.backlash.mean_square && sound(candidate, known, backlash))
      best = {std::move(backlash), presliding};
  };
  for (const BacklashStart& start : best_starts(backlash_beside(shortest), beside))
    consider(distances[start.presliding], start.theta);
  for (double step = std::sqrt(kPreslidingStep);
       !best.backlash.columns.empty() && step > kFinePreslidingStep; step = std::sqrt(step)) {
    const double middle = best.presliding;
    const std::vector<double> theta = best.backlash.theta;
    consider(middle * step, theta);
    consider(middle / step, theta);
  }
  model_.friction_knee = best.presliding;
  backlash_ = best.backlash.theta;
  return best.backlash.columns;
}

/// All else that the model has is fitted again beside presliding distance and backlash: kept where
/// backlash then has a name, which beside other effects has to gain over the presliding distance
/// alone.
void DriveWorkflow::refit_presliding_beside_backlash(const Options& options) {
  if (has_accepted(kBacklash)) return;
  if (!backlash_worth_a_term() && decision_.report.verdict != Verdict::unexplained) return;
  if (std::none_of(candidates_.begin(), candidates_.end(), [](const Candidate& c) {
        return c.name == kBacklash && c.not_testable.empty() && c.refuted.empty();
      }))
    return;
  DriveWorkflow tried = trial();
  for (const Accepted& accepted : decision_.accepted)
    for (Column& column : candidates_[accepted.candidate].columns(accepted.theta))
      tried.found_.push_back(std::move(column));
  std::vector<Column> backlash = tried.fit_presliding_and_backlash();
  // A presliding distance that ends on the bound of its range has made room for what friction
  // itself does, and that is over within the presliding distance that was fitted alone.
  if (backlash.empty() ||
      !(tried.model_.friction_knee > criteria_.off_bound * shortest_presliding() ||
        tried.backlash_.front() > criteria_.presliding_span * model_.friction_knee))
    return;
  for (Column& column : backlash) tried.found_.push_back(std::move(column));
  tried.longest_beside_backlash_ = tried.model_.friction_knee;
  if (!tried.calibrate().has_value()) return;
  tried.found_.clear();
  tried.add_known_terms();
  tried.decide_by(options);
  if (tried.has_accepted(kBacklash) &&
      (decision_.accepted.empty() || tried.beyond_presliding_alone(decision_)))
    adopt(std::move(tried));
}

}  // namespace servosense::reconcile
