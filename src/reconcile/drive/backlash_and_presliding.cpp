// Play beside what moves its load, and beside the knee of friction, which was fitted without it.
#include <algorithm>
#include <cmath>
#include <functional>
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
constexpr double kKneeStep = 1.5, kFineKneeStep = 1.05;

/// Whether physics would allow it.
bool sound(const Candidate& candidate, const Regression& known, const Optimum& optimum) {
  const Fit fit = known.fit_with(optimum.columns);
  std::vector<double> own;
  for (Eigen::Index k = known.columns(); k < fit.coefficients.size(); ++k)
    own.push_back(fit.coefficients(k));
  return candidate.meaning(optimum.theta, own).violation.empty();
}

/// A play of the grid beside the knee with which it leaves least.
struct PlayStart {
  std::vector<double> theta;
  std::size_t knee = 0;
  double mean_square = std::numeric_limits<double>::infinity();
};

/// Every play of a grid is tried beside every knee: the best that physics allows.
std::vector<PlayStart> best_starts(const Candidate& play, const std::vector<Regression>& beside) {
  std::vector<PlayStart> starts;
  for (std::vector<double>& theta : starts_of_play(play.search)) {
    // Hundreds of plays of a long record would not fit into memory: their columns go at once.
    const std::vector<Column> columns = play.columns(theta);
    if (columns.empty()) continue;
    PlayStart start{std::move(theta)};
    for (std::size_t k = 0; k < beside.size(); ++k) {
      const double square = Addition(beside[k], columns, false).mean_square(beside[k].rest());
      if (!(square < start.mean_square)) continue;
      start.mean_square = square;
      start.knee = k;
    }
    starts.push_back(std::move(start));
  }
  std::sort(starts.begin(), starts.end(),
            [](const PlayStart& a, const PlayStart& b) { return a.mean_square < b.mean_square; });
  std::vector<PlayStart> best;
  for (PlayStart& start : starts) {
    if (best.size() == kMostRefits) break;
    if (sound(play, beside[start.knee], {start.theta, play.columns(start.theta), 0}))
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
    if ((name == "spring-load" || name == "load-dependent-friction") &&
        drive.effects.count < kMaxActiveEffects)
      drive.effects.settings[drive.effects.count++] = found;
  }
  return drive;
}

/// Whether play is worth a term, though not beside the knee that was fitted without it and may have
/// stood for part of it: hardly wider than that, too little, or no good elsewhere.
bool DriveWorkflow::play_worth_a_term() const {
  const Report& report = decision_.report;
  if (decision_.accepted.empty() &&
      std::any_of(decision_.failed.begin(), decision_.failed.end(),
                  [&](std::size_t k) { return candidates_[k].name == kPlay; }))
    return true;
  const double least = options_.least_gain(report.floors.used, report.effort_rms);
  return std::any_of(report.ranking.begin(), report.ranking.end(), [&](const RankedCandidate& c) {
    return c.name == kPlay && decision_.loss - c.gap_after * c.gap_after > least * least;
  });
}

/// Knee and play that together leave least beside all that is known, and the columns of that play;
/// none where physics would allow none. Beside the play the knee is no longer than the one that was
/// fitted alone, which has taken what it can of the play.
std::vector<Column> DriveWorkflow::fit_knee_and_play() {
  const FitRows rows = fit_rows(problem_, options_.blocks);
  const double longest = model_.friction_knee;
  if (play_.empty()) knee_alone_ = longest;
  // A knee that was fitted beside a bristle stays.
  const double shortest = presliding_found_ ? longest : std::min(longest, shortest_knee());
  const auto searched = [&](double knee) {
    return knee > shortest / 1.01 && knee < 1.01 * longest;
  };
  idle_.clear();
  const auto known_beside = [&](double knee) {
    model_.friction_knee = knee;
    know_terms(true);
    return regression_of_known(rows);
  };
  const auto play_beside = [&](double knee) {
    model_.friction_knee = knee;
    DriveSituation s = situation();
    s.model.friction_knee = shortest;
    return play_candidate(drive_effect_index(kPlay), s);
  };
  std::vector<double> knees;
  for (double knee = longest; searched(knee); knee /= kKneeStep) knees.push_back(knee);
  std::vector<Regression> beside;
  for (const double knee : knees) beside.push_back(known_beside(knee));
  struct {
    Optimum play;
    double knee = 0;
  } best;
  best.knee = longest;
  best.play.mean_square = std::numeric_limits<double>::infinity();
  const auto consider = [&](double knee, const std::vector<double>& theta) {
    if (!searched(knee)) return;
    const Candidate candidate = play_beside(knee);
    const Regression known = known_beside(knee);
    Optimum play = search(candidate, known, {}, 0, &theta);
    if (play.mean_square < best.play.mean_square && sound(candidate, known, play))
      best = {std::move(play), knee};
  };
  for (const PlayStart& start : best_starts(play_beside(shortest), beside))
    consider(knees[start.knee], start.theta);
  for (double step = std::sqrt(kKneeStep); !best.play.columns.empty() && step > kFineKneeStep;
       step = std::sqrt(step)) {
    const double middle = best.knee;
    const std::vector<double> theta = best.play.theta;
    consider(middle * step, theta);
    consider(middle / step, theta);
  }
  model_.friction_knee = best.knee;
  play_ = best.play.theta;
  return best.play.columns;
}

/// All else that the model has is fitted again beside knee and play: kept where play then has a
/// name, which beside other effects has to gain over the knee alone.
void DriveWorkflow::refit_knee_beside_play(const std::function<void()>& look) {
  if (has_accepted(kPlay)) return;
  if (!play_worth_a_term() && decision_.report.verdict != Verdict::unexplained) return;
  if (std::none_of(candidates_.begin(), candidates_.end(), [](const Candidate& c) {
        return c.name == kPlay && c.not_testable.empty() && c.refuted.empty();
      }))
    return;
  const DriveState before = *this;
  for (const Accepted& accepted : decision_.accepted)
    for (Column& column : candidates_[accepted.candidate].columns(accepted.theta))
      found_.push_back(std::move(column));
  std::vector<Column> play = fit_knee_and_play();
  // A knee that ends on the bound of its range has made room for what friction itself does, and
  // that is over within the knee that was fitted alone.
  const bool within = !play.empty() && (model_.friction_knee > kOffBound * shortest_knee() ||
                                        play_.front() > kKneeSpan * before.model_.friction_knee);
  for (Column& column : play) found_.push_back(std::move(column));
  widest_knee_ = model_.friction_knee;
  const bool fitted = within && calibrate().has_value();
  found_.clear();
  if (fitted) {
    know_terms();
    look();
    if (has_accepted(kPlay) &&
        (before.decision_.accepted.empty() || beyond_the_knee(before.decision_)))
      return;
  }
  DriveState::operator=(before);
}

}  // namespace servosense::reconcile
