// What this motion cannot show, and what it cannot tell apart.
#include <algorithm>
#include <cmath>

#include "reconcile/select/selection.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kSteady = 0.05;  // of the largest acceleration
constexpr std::size_t kLeastRowsOfBlock = 10;

std::vector<double> middle_of_range(const Candidate& candidate) {
  std::vector<double> theta;
  for (const SearchRange& r : candidate.search)
    theta.push_back(r.logarithmic ? std::sqrt(r.low * r.high) : 0.5 * (r.low + r.high));
  return theta;
}

}  // namespace

/// Rows of the fit at steady speeds: there laws of friction are told apart by their values at
/// several speeds, while where the speed changes inertia is what acts most. None where the drive is
/// hardly ever steady.
FitRows Selection::rows_at_steady_speeds() const {
  const Column* acceleration = values_along("acceleration");
  if (acceleration == nullptr) return {};
  double largest = 0;
  for (const std::size_t i : rows_.rows) largest = std::max(largest, std::abs((*acceleration)[i]));
  std::vector<std::size_t> steady;
  for (const std::size_t i : rows_.rows)
    if (std::abs((*acceleration)[i]) < kSteady * largest) steady.push_back(i);
  if (steady.size() < kLeastRowsOfBlock * rows_.blocks()) return {};
  return in_blocks(std::move(steady), rows_.blocks());
}

void Selection::testability(Decision& decision) const {
  const Regression known = regression();
  const FitRows steady = rows_at_steady_speeds();
  const Regression at_steady = regression_of_known(problem_, steady);
  for (const Candidate& c : candidates_) {
    if (!c.rival.empty()) continue;
    if (!c.not_testable.empty()) {
      decision.report.not_testable.push_back({c.name, c.not_testable, c.would_need});
      continue;
    }
    // At the middle of its range: is there anything that the known terms cannot imitate?
    const std::vector<double> theta = middle_of_range(c);
    double most = 0, most_steady = 0;
    for (const Column& column : c.columns(theta)) {
      most = std::max(most, known.share_left(column));
      if (!steady.rows.empty()) most_steady = std::max(most_steady, at_steady.share_left(column));
    }
    if (most < criteria_.least_testable) {
      decision.report.not_testable.push_back(
          {c.name, "with this motion the terms of the model can imitate it", c.splitting_motion});
      continue;
    }
    if (!steady.rows.empty() && c.where == "velocity" && most_steady < criteria_.least_testable)
      decision.report.not_testable.push_back(
          {c.name, "at the steady speeds of this motion the terms of the model can imitate it",
           c.splitting_motion});
    if (!c.part_not_testable.empty())
      decision.report.not_testable.push_back({c.name, c.part_not_testable, c.part_would_need});
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

std::vector<Alike> classes_of(const Problem& problem, const std::vector<Candidate>& candidates,
                              const Options& options) {
  const FitRows rows = fit_rows(problem, options.blocks);
  const Regression known = regression_of_known(problem, rows);
  struct Shape {
    std::size_t candidate;
    std::vector<Eigen::VectorXd> columns;
  };
  std::vector<Shape> shapes;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const Candidate& c = candidates[i];
    if (!c.not_testable.empty() || !c.rival.empty()) continue;
    const std::vector<double> theta = middle_of_range(c);
    Shape shape{i, {}};
    for (const Column& column : c.columns(theta))
      if (known.share_left(column) > options.criteria.least_testable)
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
      if (!taken[b] && std::abs(shapes[a].columns[0].dot(shapes[b].columns[0])) >
                           options.criteria.class_correlation) {
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

}  // namespace servosense::reconcile
