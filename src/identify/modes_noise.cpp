#include "modes_noise.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "servosense/dsp/quantile.hpp"

namespace servosense::modes {
namespace {

using Eigen::Index;
using Eigen::VectorXcd;
using Eigen::VectorXd;

constexpr Index kNeighbours = 4;         // on either side, over which the noise is the same
constexpr double kNothing = 1e-9;        // of the response's square: nothing was averaged
constexpr double kLeast = 1e-12;         // of the greatest response: what rounding leaves
constexpr double kLeastOfMedian = 1e-3;  // of the noise: coherence that is 1 by rounding

/// Mean over neighbours: a few averages tell the noise of one line badly. Empty where most is zero.
VectorXd over_neighbours(const VectorXd& variance, const VectorXcd& response) {
  const Index n = response.size();
  if (variance.size() != n) return {};
  const VectorXd share = variance.array() / response.array().abs2();
  if (!(median({share.data(), share.data() + n}) > kNothing)) return {};
  VectorXd smooth(n);
  for (Index k = 0; k < n; ++k) {
    const Index from = std::max<Index>(0, k - kNeighbours), to = std::min(n, k + kNeighbours + 1);
    smooth(k) = variance.segment(from, to - from).mean();
  }
  return smooth;
}

/// Variance by fourth differences: their median over a band, which no peak moves.
VectorXd by_differences(const VectorXcd& h) {
  const Index n = h.size();
  std::vector<double> square;
  for (Index k = 2; k + 2 < n; ++k)
    square.push_back(std::norm(h(k - 2) - 4. * h(k - 1) + 6. * h(k) - 4. * h(k + 1) + h(k + 2)) /
                     70);
  const auto differences = static_cast<Index>(square.size());
  const Index half = std::max<Index>(10, n / 40);
  VectorXd variance(n);
  for (Index k = 0; k < n; ++k) {
    const Index from = std::clamp<Index>(k - 2 - half, 0, std::max<Index>(0, differences - 1));
    const Index to = std::min(differences, std::max<Index>(k - 2 + half + 1, from + 1));
    // The square of a complex normal number has its median at ln 2 of its mean.
    variance(k) = median({square.begin() + from, square.begin() + to}) / std::numbers::ln2;
  }
  return variance;
}

}  // namespace

VectorXd noise_of(const VectorXcd& response, const VectorXd& coherence,
                  const VectorXd& standard_error) {
  VectorXd variance = over_neighbours(standard_error.array().square(), response);
  if (variance.size() == 0 && coherence.size() == response.size())
    variance = over_neighbours(
        response.array().abs2() * (1 - coherence.array()) / coherence.array(), response);
  if (variance.size() == 0) variance = by_differences(response);
  const double least = std::max(kLeastOfMedian * kLeastOfMedian *
                                    median({variance.data(), variance.data() + variance.size()}),
                                std::pow(kLeast * response.cwiseAbs().maxCoeff(), 2));
  return (variance.cwiseMax(least) / 2).cwiseSqrt();
}

}  // namespace servosense::modes
