#include "servosense/reconcile/decide.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "reconcile/numerics/floors.hpp"
#include "reconcile/numerics/maps.hpp"
#include "reconcile/select/selection.hpp"

namespace servosense::reconcile {

Decision Selection::run() {
  Decision decision;
  effort_rms_ = rms_over(problem_.target, rows_.rows);

  const Regression start = regression();
  const Fit first = start.fit();
  start_loss_ = first.loss;
  const Column before = residual(first);
  floors_ = floors_of(problem_, before, criteria_);
  decision.report.maps_before = maps_of(problem_, before, options_);
  decision.report.gap_before = held_gap(before);
  decision.report.simulated_before = problem_.target;
  for (std::size_t i = 0; i < before.size(); ++i) decision.report.simulated_before[i] -= before[i];

  testability(decision);
  decision.report.classes = classes_of(problem_, candidates_, options_);

  while (chosen_.size() < options_.most_effects) {
    const Regression known = regression();
    const Fit base = known.fit();
    const Floors now = floors_of(problem_, residual(base), criteria_);
    if (now.used > 0) floors_ = now;
    if (root(structured(base.loss)) < least_gain()) {
      why_nothing_.clear();
      break;
    }
    if (chance_.empty()) draw_nulls();
    const std::vector<Entry> ranking = rank(known, base);
    auto next = choose(ranking, known, base);
    if (!next && join(ranking, base)) continue;
    if (!next) break;
    chosen_.push_back(std::move(*next));
    refine();
  }
  prune();
  for (unsigned round = 0; round < 2 * options_.most_effects; ++round)
    if (settle() && !drop_proxies() && !drop_unsure()) break;
  finish(decision);
  return decision;
}

/// The gap on held-out data as the effects come in one after the other.
void Selection::follow_gap(Decision& decision) {
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

Selection::Own Selection::own_of(std::size_t i, const Fit& fit) const {
  auto at = static_cast<Eigen::Index>(problem_.known.size());
  for (std::size_t k = 0; k < i; ++k)
    at += static_cast<Eigen::Index>(chosen_[k].entry.optimum.columns.size());
  Own own;
  for (std::size_t j = 0; j < chosen_[i].entry.optimum.columns.size(); ++j, ++at) {
    own.values.push_back(fit.coefficients(at));
    own.errors.push_back(fit.standard_errors(at));
  }
  return own;
}

/// Errors of the physical parameters, by changes of each coefficient and of each nonlinear
/// parameter beside all others. The response of a load that flies jumps where it lands at another
/// reversal: its slope is that of a step, not of a point. And what the model leaves there is the
/// same at every reversal: blocks that are left out do not show it, so it counts in full.
std::vector<NamedValue> Selection::errors_of(const Chosen& chosen, const Regression& known,
                                             const Own& own) const {
  constexpr double kSmall = 0.02, kJumps = 0.15;  // of a parameter
  const Candidate& candidate = candidates_[chosen.entry.candidate];
  const std::vector<double>& theta = chosen.entry.optimum.theta;
  const Meaning meaning = candidate.meaning(theta, own.values);
  std::vector<NamedValue> errors = meaning.parameters;
  for (NamedValue& v : errors) std::fill(v.values.begin(), v.values.end(), 0.0);
  const auto spread = [&](const Meaning& moved, double by) {
    for (std::size_t p = 0; p < moved.parameters.size() && p < errors.size(); ++p)
      for (std::size_t k = 0; k < moved.parameters[p].values.size() && k < errors[p].values.size();
           ++k) {
        const double d = (moved.parameters[p].values[k] - meaning.parameters[p].values[k]) * by;
        errors[p].values[k] = std::hypot(errors[p].values[k], d);
      }
  };
  for (std::size_t j = 0; j < own.values.size(); ++j) {
    std::vector<double> moved = own.values;
    moved[j] += own.errors[j];
    spread(candidate.meaning(theta, moved), 1);
  }
  std::vector<Column> slopes;     // of the response, for a change by `step`
  std::vector<Meaning> meanings;  // after it
  for (std::size_t k = 0; k < theta.size(); ++k) {
    const double step = (candidate.memory ? kJumps : kSmall) * std::max(std::abs(theta[k]), 1e-12);
    std::vector<double> up = theta, down = theta;
    up[k] += step;
    down[k] -= step;
    const std::vector<Column> above = candidate.columns(up), below = candidate.columns(down);
    if (above.size() != own.values.size() || below.size() != own.values.size()) continue;
    Column slope(problem_.rows(), 0);
    for (std::size_t j = 0; j < own.values.size(); ++j)
      for (std::size_t i = 0; i < slope.size(); ++i)
        slope[i] += 0.5 * own.values[j] * (above[j][i] - below[j][i]);
    if (!(known.share_left(slope) > 0)) continue;
    slopes.push_back(std::move(slope));
    meanings.push_back(candidate.meaning(up, own.values));
  }
  const Fit with = known.fit_with(slopes);
  for (std::size_t k = 0; k < slopes.size(); ++k) {
    double error = with.standard_errors(known.columns() + static_cast<Eigen::Index>(k));
    if (candidate.memory) {
      Regression others = known;
      for (std::size_t m = 0; m < slopes.size(); ++m)
        if (m != k) others.add(slopes[m]);
      error = std::hypot(error, unexplained_along(others.projected(slopes[k]), others.rest()));
    }
    spread(meanings[k], error);
  }
  if (!errors.empty() && !errors[0].values.empty())
    errors[0].values[0] = std::hypot(errors[0].values[0], candidate.resolution);
  return errors;
}

/// What is left beyond the noise in the rows that a slope lives in, in that slope.
double Selection::unexplained_along(const Eigen::VectorXd& slope,
                                    const Eigen::VectorXd& rest) const {
  const Eigen::ArrayXd weight = slope.array().square();
  const double power = weight.sum();
  if (!(power > 0)) return 0;
  const double left = (weight * rest.array().square()).sum() / power;
  const double rows = power * power / weight.square().sum();
  return root(structured(left) * rows / power);
}

void Selection::finish(Decision& decision) {
  follow_gap(decision);
  Report& report = decision.report;
  const Regression known = regression();
  const Fit fit = known.fit();
  const Column rest = residual(fit);
  report.gap_unit = problem_.unit;
  report.effort_rms = effort_rms_;
  report.floors = floors_;
  report.gap_after = held_gap(rest);
  report.maps_after = chosen_.empty() ? report.maps_before : maps_of(problem_, rest, options_);
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
  for (std::size_t i = 0; i < chosen_.size(); ++i) {
    Chosen& c = chosen_[i];
    const Candidate& candidate = candidates_[c.entry.candidate];
    const Own own = own_of(i, fit);
    const Meaning meaning = candidate.meaning(c.entry.optimum.theta, own.values);
    c.effect.parameters = meaning.parameters;
    c.effect.standard_errors = errors_of(c, known, own);
    decision.accepted.push_back({c.entry.candidate, c.entry.optimum.theta, own.values, meaning});
    report.effects.push_back(c.effect);
    std::erase_if(report.not_testable,
                  [&](const NotTestable& n) { return n.name == c.effect.name; });
  }

  decision.proxies = proxies_;
  decision.failed = banned_;
  report.time_s = problem_.time_s;
  report.measured = problem_.target;
  report.compared = problem_.usable;
  report.simulated_after = problem_.target;
  for (std::size_t i = 0; i < rest.size(); ++i) report.simulated_after[i] -= rest[i];
  if (!held_.rows.empty()) {
    report.held_from_s = problem_.time_s[held_.rows.front()];
    report.held_to_s = problem_.time_s[held_.rows.back()];
  }

  decision.loss = fit.loss;
  const double left = root(structured(fit.loss));
  const bool fits = left < least_gain();
  const bool holds = report.gap_after < criteria_.larger_elsewhere * root(fit.loss);
  const bool at_floor =
      report.gap_after <= criteria_.floor_tolerance * floors_.used || (fits && holds) ||
      std::max(report.gap_after, left) < criteria_.negligible_in_effort * effort_rms_;
  if (fits && !at_floor && why_nothing_.empty())
    why_nothing_ =
        "the part kept for the proof is another one: places, speeds or reversals that were not "
        "fitted, or something has changed";
  report.verdict = verdict_of(!report.effects.empty(), at_floor);
  report.residual_white = at_floor;
  report.residual_detail = why_nothing_;
  if (report.verdict == Verdict::unexplained) report.resembles = resembles_;
}

Decision decide(const Problem& problem, const std::vector<Candidate>& candidates,
                const Options& options) {
  return Selection(problem, candidates, options).run();
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
