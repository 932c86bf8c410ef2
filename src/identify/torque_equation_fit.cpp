#include "servosense/identify/torque_equation_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "dsp/dense.hpp"

namespace servosense {
namespace {

/// A torque is off by a share of itself, and by this share of the highest (chosen: what the level
/// in the air is known to).
constexpr double kFloorShare = 0.02;

struct ScaledCuts {
  Eigen::MatrixXd a;       // V f, f S, S over the error of the torque, each brought to length 1
  Eigen::VectorXd torque;  // over its error
  Eigen::VectorXd error;   // but for a factor
  Eigen::Vector3d scale;
};

ScaledCuts scaled(std::span<const TorqueCut> cuts) {
  ScaledCuts c;
  c.a.resize(static_cast<Eigen::Index>(cuts.size()), 3);
  c.torque.resize(c.a.rows());
  c.error.resize(c.a.rows());
  double highest = 0;
  for (const TorqueCut& cut : cuts) highest = std::max(highest, std::abs(cut.torque_Nm));
  for (Eigen::Index i = 0; i < c.a.rows(); ++i) {
    const TorqueCut& cut = cuts[static_cast<std::size_t>(i)];
    const double f = cut.feed_per_tooth_m;
    const double error = std::abs(cut.torque_Nm) + kFloorShare * highest;
    c.error[i] = error > 0 ? error : 1;
    c.a.row(i) << cut.removed_m2 * f, cut.contact_m2 * f, cut.contact_m2;
    c.a.row(i) /= c.error[i];
    c.torque[i] = cut.torque_Nm / c.error[i];
  }
  for (Eigen::Index k = 0; k < 3; ++k) {
    c.scale[k] = c.a.col(k).norm();
    c.a.col(k) /= c.scale[k];
  }
  return c;
}

/// Greatest over smallest, less 1.
double spread(std::span<const TorqueCut> cuts, const std::function<double(const TorqueCut&)>& of) {
  double low = std::numeric_limits<double>::infinity(), high = 0;
  for (const TorqueCut& cut : cuts) low = std::min(low, of(cut)), high = std::max(high, of(cut));
  return high / low - 1;
}

struct Solution {
  Eigen::Vector3d x = Eigen::Vector3d::Zero();  // of the scaled columns
  std::array<bool, 3> held{};
};

/// Non-negative least squares: of all choices of columns the best whose constants are positive.
Solution solve(const ScaledCuts& c) {
  Solution best;
  double least = std::numeric_limits<double>::infinity();
  for (unsigned choice = 1; choice < 8; ++choice) {
    std::array<Eigen::Index, 3> used{};
    Eigen::Index count = 0;
    for (Eigen::Index k = 0; k < 3; ++k)
      if ((choice >> static_cast<unsigned>(k) & 1U) != 0)
        used[static_cast<std::size_t>(count++)] = k;
    Eigen::MatrixXd a(c.a.rows(), count);
    for (Eigen::Index j = 0; j < count; ++j) a.col(j) = c.a.col(used[static_cast<std::size_t>(j)]);
    const Eigen::VectorXd x = dense::least_squares(a, c.torque);
    if (x.minCoeff() < 0) continue;
    const double rest = (c.torque - a * x).squaredNorm();
    if (!(rest < least)) continue;
    least = rest;
    best = {};
    best.held = {true, true, true};
    for (Eigen::Index j = 0; j < count; ++j) {
      const Eigen::Index k = used[static_cast<std::size_t>(j)];
      best.x[k] = x[j];
      best.held[static_cast<std::size_t>(k)] = false;
    }
  }
  return best;
}

}  // namespace

Expected<TorqueEquationFit> fit_torque_equation(std::span<const TorqueCut> cuts) {
  if (cuts.size() < 4)
    return data_error("three constants and their errors need four cuts or more, not " +
                      std::to_string(cuts.size()));
  for (const TorqueCut& cut : cuts)
    if (!(cut.removed_m2 > 0) || !(cut.contact_m2 > 0) || !(cut.feed_per_tooth_m > 0) ||
        !std::isfinite(cut.torque_Nm))
      return data_error(
          "a cut has an area removed, an area of contact and a feed above 0, and a "
          "torque; leave out cuts in the air");
  if (spread(cuts, [](const TorqueCut& c) { return c.feed_per_tooth_m; }) < kLeastSpread)
    return data_error(
        "all cuts have one feed per tooth, so that k2 and k3 cannot be told apart; "
        "cut at two feeds or more");
  if (spread(cuts, [](const TorqueCut& c) { return c.contact_m2 / c.removed_m2; }) < kLeastSpread)
    return data_error(
        "all cuts have one length of contact over width (L/a), so that k1 and k2 "
        "cannot be told apart; cut at two radial depths or more");
  const ScaledCuts c = scaled(cuts);
  const Eigen::VectorXd values = dense::singular_values(c.a).values;
  if (!(values[0] < kMostCondition * values[2]))
    return data_error(
        "feed and length of contact over width (L/a) change together, so that the "
        "constants cannot be told apart; cut each radial depth at two feeds");
  const Solution found = solve(c);
  TorqueEquationFit fit;
  fit.cuts = cuts.size();
  fit.held_at_zero = found.held;
  const Eigen::Index n = c.a.rows();
  Eigen::Index used = 0;
  for (const bool held : found.held) used += held ? 0 : 1;
  const Eigen::VectorXd off = c.torque - c.a * found.x;
  const auto freedom = static_cast<double>(n - used);
  const double deviation = std::sqrt(off.squaredNorm() / freedom);
  fit.residual_Nm = std::sqrt(off.cwiseProduct(c.error).squaredNorm() / freedom);
  const Eigen::Matrix3d covariance = (c.a.transpose() * c.a).inverse();
  for (std::size_t k = 0; k < 3; ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    fit.k[k] = found.x[i] / c.scale[i];
    if (!found.held[k])
      fit.standard_error[k] = deviation * std::sqrt(covariance(i, i)) / c.scale[i];
  }
  double sum = 0;
  for (std::size_t i = 0; i < cuts.size(); ++i) {
    std::vector<TorqueCut> others(cuts.begin(), cuts.end());
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
    const ScaledCuts without = scaled(others);
    const Solution x = solve(without);
    double predicted = 0;
    for (Eigen::Index k = 0; k < 3; ++k)
      predicted += x.x[k] / without.scale[k] * c.a(static_cast<Eigen::Index>(i), k) * c.scale[k];
    const auto row = static_cast<Eigen::Index>(i);
    const double share = predicted * c.error[row] / cuts[i].torque_Nm - 1;
    sum += share * share;
  }
  fit.relative_error = std::sqrt(sum / static_cast<double>(cuts.size()));
  return fit;
}

}  // namespace servosense
