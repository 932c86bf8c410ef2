#include "servosense/identify/losses_by_current.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace servosense {
namespace {

constexpr std::size_t kFewestRows = 40;
constexpr double kBlocksAlike = 2;  // blocks after one another err alike

struct LossFit {
  std::array<Estimate, 3> parameters;  // of shaft, one, square
};

/// Least squares of the power over those of the three that are asked for.
template <typename Rows>
std::optional<LossFit> fit_of(const Rows& rows, std::array<bool, 3> asked) {
  Eigen::Vector3d scale(1e-300, 1, 1e-300);
  for (const auto& row : rows) {
    scale(0) = std::max(scale(0), std::abs(row.shaft));
    scale(2) = std::max(scale(2), row.square);
  }
  const auto regressors = [&](const auto& row) -> Eigen::Vector3d {
    return {asked[0] ? row.shaft / scale(0) : 0, asked[1] ? 1.0 : 0,
            asked[2] ? row.square / scale(2) : 0};
  };
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const auto& row : rows) {
    const Eigen::Vector3d x = regressors(row);
    normal += x * x.transpose();
    right += row.power * x;
  }
  for (Eigen::Index i = 0; i < 3; ++i)
    if (!asked[static_cast<std::size_t>(i)]) normal(i, i) = 1;
  const auto n = static_cast<double>(rows.size());
  const Eigen::LLT<Eigen::Matrix3d> root(normal);
  if (root.info() != Eigen::Success) return {};
  const Eigen::Vector3d pivots = root.matrixLLT().diagonal().array().square();
  constexpr double kApart = 1e-6;  // of the mean square of a regressor
  for (Eigen::Index i = 0; i < 3; ++i)
    if (asked[static_cast<std::size_t>(i)] && !(pivots(i) > kApart * n)) return {};
  const Eigen::Vector3d found = root.solve(right);
  const Eigen::Matrix3d inverse = root.solve(Eigen::Matrix3d::Identity());
  double left = 0;
  for (const auto& row : rows) {
    const double e = row.power - regressors(row).dot(found);
    left += e * e / (n - 3);
  }
  LossFit fit;
  for (Eigen::Index i = 0; i < 3; ++i)
    if (const auto of = static_cast<std::size_t>(i); asked[of])
      fit.parameters[of] = {found(i) / scale(i),
                            kBlocksAlike * std::sqrt(left * inverse(i, i)) / scale(i)};
  return fit;
}

}  // namespace

void LossesByCurrent::add(double power_W, double torque_Nm, double speed_rad_s) {
  ++n_;
  sum_.power += power_W;
  sum_.shaft += torque_Nm * speed_rad_s;
  sum_.square += torque_Nm * torque_Nm;
  highest_rad_s_ = std::max(highest_rad_s_, std::abs(speed_rad_s));
}

void LossesByCurrent::end_block() {
  if (!(n_ > 0)) return;
  rows_.push_back({sum_.power / n_, sum_.shaft / n_, sum_.square / n_});
  largest_Nm_ = std::max(largest_Nm_, std::sqrt(rows_.back().square));
  sum_ = {};
  n_ = 0;
}

std::optional<LossesByCurrent::Found> LossesByCurrent::found(double least_known_from_rad_s) const {
  if (rows_.size() < kFewestRows) return {};
  std::array<bool, 3> asked = {true, true, true};
  std::optional<LossFit> fit;
  for (int round = 0; round < 3; ++round) {
    fit = fit_of(rows_, asked);
    if (!fit) return {};
    bool all = true;
    for (const std::size_t i : {std::size_t{2}, std::size_t{1}}) {
      const Estimate& e = fit->parameters[i];
      if (!asked[i] || e.value > kLossEvidence * e.standard_error) continue;
      asked[i] = all = false;
      break;
    }
    if (all) break;
  }
  Found found;
  found.ratio = fit->parameters[0];
  found.losses.constant_W = fit->parameters[1];
  found.losses.copper_W_per_Nm2 = fit->parameters[2];
  found.losses.known_from_rad_s =
      std::max({least_known_from_rad_s, kSlowestShare * highest_rad_s_,
                kTellsTimesCopper * fit->parameters[2].value * largest_Nm_});
  return found;
}

}  // namespace servosense
