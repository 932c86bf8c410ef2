#include "reconcile/select/search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "reconcile/numerics/levenberg_marquardt.hpp"
#include "servosense/dsp/golden_section.hpp"

namespace servosense::reconcile {
namespace {

constexpr int kDescentRounds = 2;     // of coordinate descent: parameters are nearly independent
constexpr double kResolution = 0.02;  // of a step of the grid: far below what data resolve

const SearchRange& range_of(const Candidate& candidate, std::size_t i) {
  return candidate.search[std::min(i, candidate.search.size() - 1)];
}
double forward(const SearchRange& r, double value) {
  return r.logarithmic ? std::log(value) : value;
}
double backward(const SearchRange& r, double value) {
  return r.logarithmic ? std::exp(value) : value;
}

double coordinate_step(const SearchRange& r) {
  if (r.step > 0) return r.step;
  return r.points > 1 ? (forward(r, r.high) - forward(r, r.low)) / (r.points - 1) : 0;
}

std::vector<std::vector<double>> grid_of(const Candidate& candidate) {
  std::vector<std::vector<double>> grid = {{}};
  for (const SearchRange& r : candidate.search) {
    std::vector<std::vector<double>> wider;
    for (const auto& point : grid)
      for (unsigned k = 0; k < r.points; ++k) {
        wider.push_back(point);
        const double from = forward(r, r.low),
                     step = (forward(r, r.high) - from) / std::max(1U, r.points - 1);
        wider.back().push_back(backward(r, from + k * step));
      }
    grid = std::move(wider);
  }
  return grid;
}

constexpr int kMostTogether = 12;         // rounds
constexpr double kDescentSettled = 1e-4;  // of the sum of squares
constexpr double kSmallStep = 0.1;        // of a step of the grid, to see the slope

/// One after the other they creep along the valley that they form.
void refine_together(const Candidate& candidate, const Regression& known, Optimum& best) {
  std::vector<BoundedParameter> parameters;
  std::vector<double> start;
  for (std::size_t i = 0; i < best.theta.size(); ++i) {
    const SearchRange& r = range_of(candidate, i);
    parameters.push_back({forward(r, r.low), forward(r, r.high), kSmallStep * coordinate_step(r)});
    start.push_back(forward(r, best.theta[i]));
  }
  const auto theta_of = [&](const std::vector<double>& values) {
    std::vector<double> theta;
    for (std::size_t i = 0; i < values.size(); ++i)
      theta.push_back(backward(range_of(candidate, i), values[i]));
    return theta;
  };
  const NonlinearFit fit = levenberg_marquardt(
      [&](const std::vector<double>& values) {
        const std::vector<Column> columns = candidate.columns(theta_of(values));
        if (columns.empty())
          return Eigen::VectorXd(Eigen::VectorXd::Constant(
              known.rest().size(), std::numeric_limits<double>::infinity()));
        return Addition(known, columns, candidate.sized).left_of(known.rest());
      },
      std::move(start), parameters, kMostTogether, kDescentSettled);
  const double square = mean_square_of(fit.residual);
  if (!(square < best.mean_square)) return;
  best.theta = theta_of(fit.values);
  best.columns = candidate.columns(best.theta);
  best.mean_square = square;
}

}  // namespace

std::vector<std::vector<double>> starting_points(const Candidate& candidate,
                                                 const Column& residual) {
  return candidate.starts ? candidate.starts(residual) : grid_of(candidate);
}

Optimum search(const Candidate& candidate, const Regression& known, const Column& residual,
               double worth, const std::vector<double>* from) {
  Optimum best;
  best.mean_square = std::numeric_limits<double>::infinity();
  const auto consider_as = [&](const std::vector<double>& theta, std::vector<Column> columns) {
    if (columns.empty()) return std::numeric_limits<double>::infinity();
    const double square = Addition(known, columns, candidate.sized).mean_square(known.rest());
    if (square < best.mean_square) best = {theta, std::move(columns), square};
    return square;
  };
  const auto consider = [&](const std::vector<double>& theta) {
    return consider_as(theta, candidate.columns(theta));
  };
  if (from != nullptr)
    consider(*from);
  else
    for (const auto& theta : starting_points(candidate, residual))
      consider_as(theta, candidate.at_start(theta));
  if (best.columns.empty()) return best;
  if (from == nullptr && candidate.coarse_columns) {
    best.mean_square = std::numeric_limits<double>::infinity();
    consider(std::vector<double>(best.theta));
  }
  if (worth > 0 && best.mean_square > mean_square_of(known.rest()) - worth) return best;
  if (candidate.coupled) {
    refine_together(candidate, known, best);
    return best;
  }

  // Golden section in one parameter after the other.
  const int rounds = best.theta.size() > 1 ? kDescentRounds : 1;
  for (int round = 0; round < rounds; ++round)
    for (std::size_t i = 0; i < best.theta.size(); ++i) {
      const SearchRange& r = range_of(candidate, i);
      const double step = coordinate_step(r) / (round + 1);
      if (!(step > 0)) continue;
      std::vector<double> theta = best.theta;
      const auto at = [&](double x) {
        theta[i] = backward(r, std::clamp(x, forward(r, r.low), forward(r, r.high)));
        return consider(theta);
      };
      const double middle = forward(r, best.theta[i]);
      lowest_between(at, middle - step, middle + step,
                     [&](double low, double high) { return !(high - low > kResolution * step); });
    }
  return best;
}

}  // namespace servosense::reconcile
