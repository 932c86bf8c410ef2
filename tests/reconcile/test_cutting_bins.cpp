// Means over bins of a force that steps within them.
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "check.hpp"
#include "reconcile/cut/bins.hpp"

namespace {

using servosense::reconcile::BinnedAngles;

constexpr double kTurn = 2 * std::numbers::pi;
constexpr std::size_t kBins = 24;

/// Angles that lie unevenly, some bins without any.
std::vector<double> angles() {
  std::vector<double> out;
  std::uint64_t state = 3;
  for (int i = 0; i < 400; ++i) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    const double unit = static_cast<double>(state >> 11) * 0x1.0p-53;
    out.push_back(kTurn * (0.1 + 0.8 * unit * unit));
  }
  return out;
}

/// Straight between steps: exact, as the mean over the samples of a bin.
void means_of_steps() {
  const std::vector<double> samples = angles(), breaks = {1.0, 1.02, 2.5, 4.4 - kTurn};
  const auto force = [&](double a) {
    return (a > 1 ? 100.0 : 0.0) - (a > 1.02 ? 30.0 : 0.0) + (a > 2.5 ? 7 * a : -a) +
           (a > 4.4 ? 50 : 0);
  };
  const BinnedAngles binned(samples, kBins);
  const BinnedAngles::Parts parts = binned.cut_at(breaks);
  const auto n = static_cast<Eigen::Index>(parts.angle_rad.size());
  Eigen::MatrixXd columns(2 * n, 1);
  for (Eigen::Index i = 0; i < n; ++i) {
    columns(i, 0) = force(parts.angle_rad[static_cast<std::size_t>(i)]);
    columns(n + i, 0) = -columns(i, 0);
  }
  const Eigen::MatrixXd means = parts.over_bins(columns, static_cast<Eigen::Index>(kBins));
  std::vector<double> sum(kBins, 0), count(kBins, 0);
  for (const double a : samples) {
    const auto b = static_cast<std::size_t>(a / kTurn * static_cast<double>(kBins));
    sum[b] += force(a);
    ++count[b];
  }
  for (std::size_t b = 0; b < kBins; ++b) {
    const auto row = static_cast<Eigen::Index>(b);
    const double middle = (static_cast<double>(b) + 0.5) * kTurn / static_cast<double>(kBins);
    CHECK_NEAR(means(row, 0), count[b] > 0 ? sum[b] / count[b] : force(middle), 1e-9);
    CHECK_NEAR(means(static_cast<Eigen::Index>(kBins) + row, 0), -means(row, 0), 1e-12);
  }
}

}  // namespace

int main() {
  means_of_steps();
  return check::done();
}
