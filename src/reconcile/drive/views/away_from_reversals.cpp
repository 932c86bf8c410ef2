// A second look where friction laws agree. Just after a reversal they do not, and what the drive
// does there may be several times the noise: beside it a weak effect that acts everywhere does not
// carry the gap. Rows away from reversals do not have that part.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "reconcile/drive/workflow.hpp"

namespace servosense::reconcile {
namespace {

/// Travel since the last reversal or until the next, whichever is less; 0 within the filter's
/// reach.
Column travel_beside_reversals(const Column& position, const Column& velocity, std::size_t reach) {
  const std::size_t n = position.size();
  Column travel(n, std::numeric_limits<double>::infinity());
  std::vector<std::size_t> reversals;
  for (std::size_t i = 1; i < n; ++i)
    if (!(velocity[i] * velocity[i - 1] > 0)) reversals.push_back(i);
  for (std::size_t k = 0; k < reversals.size(); ++k) {
    const std::size_t at = reversals[k];
    const std::size_t from = k > 0 ? reversals[k - 1] : 0;
    const std::size_t to = k + 1 < reversals.size() ? reversals[k + 1] : n;
    for (std::size_t i = from; i < to; ++i)
      travel[i] = std::min(travel[i], std::abs(position[i] - position[at]));
    for (std::size_t i = at - std::min(at, reach); i < std::min(n, at + reach); ++i) travel[i] = 0;
  }
  return travel;
}

}  // namespace

/// The least travel beyond which more of it takes nothing more off what the model leaves.
std::vector<bool> DriveWorkflow::away_from_reversals() const {
  const auto reach = 1 + static_cast<std::size_t>(
                             kFilterReach / (problem_.noise_bandwidth_hz * problem_.row_period_s));
  const Column travel =
      travel_beside_reversals(signals_->position_rows, signals_->velocity_rows, reach);
  const Fit fit = fit_known();
  std::vector<const Column*> columns;
  for (const KnownTerm& term : problem_.known) columns.push_back(&term.column);
  const Column rest = residual_of(problem_.target, columns, fit.coefficients);

  struct Level {
    double travel = 0, mean_square = 0;
    std::size_t rows = 0;
  };
  std::vector<Level> levels;
  for (double from = model_.friction_knee; from < 1e4 * model_.friction_knee; from *= 2) {
    Level level;
    level.travel = from;
    for (std::size_t i = 0; i < rest.size(); ++i)
      if (problem_.usable[i] && !problem_.held_out[i] && travel[i] > from) {
        level.mean_square += rest[i] * rest[i];
        ++level.rows;
      }
    if (!levels.empty() && static_cast<double>(level.rows) <
                               criteria_.rows_kept_away * static_cast<double>(levels[0].rows))
      break;
    level.mean_square /= static_cast<double>(std::max<std::size_t>(1, level.rows));
    levels.push_back(level);
  }
  double least = std::numeric_limits<double>::infinity();
  for (const Level& level : levels) least = std::min(least, level.mean_square);
  const auto chosen = std::find_if(levels.begin(), levels.end(), [&](const Level& level) {
    return level.mean_square <= criteria_.no_longer * least;
  });
  std::vector<bool> away = problem_.usable;
  for (std::size_t i = 0; i < away.size(); ++i)
    away[i] = away[i] && travel[i] > (chosen != levels.end() ? chosen->travel : 0);
  return away;
}

/// Takes the place of a decision that has no name.
void DriveWorkflow::decide_away_from_reversals() {
  const std::vector<bool> everywhere = problem_.usable;
  const std::vector<std::string> dropped = dropped_terms_;
  // Without these shapes, else they would hide how far the presliding distance reaches.
  dropped_terms_.emplace_back("presliding shape");
  add_known_terms();
  problem_.usable = away_from_reversals();
  std::vector<Candidate> others = drive_candidates(situation());
  // What acts at reversals is not to be seen here. Lateness shows nowhere as much as there, where
  // the effort changes fastest: what seems late away from them alone is something else.
  std::erase_if(others, [](const Candidate& c) { return c.memory || c.timing; });
  // Fewer rows may show another law no more, but they do not take it back.
  std::erase_if(others, [&](const Candidate& c) {
    return std::ranges::find(decision_.proxies, c.name) != decision_.proxies.end();
  });
  for (Candidate& c : others)
    for (const Candidate& before : candidates_)
      if (c.name == before.name) c.refuted = before.refuted;
  Options options = options_;
  options.criteria.least_gain_in_floors = criteria_.strong_gain_in_floors;
  options.criteria.least_gain_in_effort = criteria_.away_gain_in_effort;
  options.criteria.least_explained_of_seen = criteria_.away_explained_of_seen;
  Decision decision = decide(problem_, others, options);
  if (decision.accepted.empty()) {
    problem_.usable = everywhere;
    dropped_terms_ = dropped;
    add_known_terms();
    return;
  }
  away_ = true;
  decision_ = std::move(decision);
  candidates_ = std::move(others);
}

}  // namespace servosense::reconcile
