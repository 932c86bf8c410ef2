// Play beside what moves its load, and beside the knee of friction, which was fitted without it.
#include <algorithm>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "drive_candidate_kinds.hpp"
#include "drive_workflow.hpp"
#include "search.hpp"

namespace servosense::reconcile {
namespace {

constexpr int kRounds = 3;  // of knee and play, each fitted beside the other
constexpr double kSameKnee = 0.95;
constexpr double kShorterKnee = 0.25;  // where it may have taken all of the play

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

/// Whether all that speaks against play is that it is hardly wider than the knee: that was fitted
/// without it, and may have stood for it.
bool DriveWorkflow::play_within_knee() const {
  return std::any_of(decision_.report.ranking.begin(), decision_.report.ranking.end(),
                     [&](const RankedCandidate& c) {
                       return c.name == "backlash" && c.explained > options_.least_explained &&
                              c.objection.find(kAsWideAsKnee) != std::string::npos;
                     });
}

/// The column of the play that explains most beside those given.
std::vector<Column> DriveWorkflow::best_play(const std::vector<Column>& beside) const {
  const FitRows rows = fit_rows(problem_, options_.blocks);
  Regression known = regression_of_known(rows);
  std::vector<const Column*> columns;
  for (const KnownTerm& term : problem_.known) columns.push_back(&term.column);
  for (const Column& column : beside) {
    known.add(column);
    columns.push_back(&column);
  }
  const Column rest = residual_of(problem_.target, columns, known.fit().coefficients);
  const Candidate play = play_candidate(drive_effect_index("backlash"), situation());
  return search(play, known, rest, 0).columns;
}

/// Knee and all else that the model has are fitted again beside the play: kept where it then has a
/// name. Each round of it leaves the knee a part of what it had taken of the play; a knee that has
/// taken all of it leaves no play to begin with, so then a shorter one begins.
void DriveWorkflow::refit_knee_beside_play(const std::function<void()>& look) {
  const bool taken = !play_within_knee();
  if (taken && decision_.report.verdict != Verdict::unexplained) return;
  const DriveState before = *this;
  std::vector<Column> named;
  for (const Accepted& accepted : decision_.accepted)
    for (Column& column : candidates_[accepted.candidate].columns(accepted.theta))
      named.push_back(std::move(column));
  if (taken) {
    model_.friction_knee *= kShorterKnee;
    know_terms();
  }
  for (int round = 0; round < kRounds; ++round) {
    widest_knee_ = taken && round == 0 ? before.model_.friction_knee : model_.friction_knee;
    found_ = named;
    for (Column& column : best_play(named)) found_.push_back(std::move(column));
    const bool fitted = calibrate().has_value();
    found_.clear();
    if (!fitted || model_.friction_knee > kSameKnee * widest_knee_) break;
    know_terms();
    look();
    for (const Accepted& accepted : decision_.accepted)
      if (candidates_[accepted.candidate].name == "backlash") return;
  }
  DriveState::operator=(before);
}

}  // namespace servosense::reconcile
