#include "reconcile/numerics/line_spectrum.hpp"

#include <algorithm>
#include <vector>

#include "dsp/fourier.hpp"

namespace servosense::reconcile {
Eigen::Index transform_size(Eigen::Index length, Eigen::Index least) {
  Eigen::Index size = least;
  while (size < 2 * length) size *= 2;
  return size;
}

Eigen::VectorXd power_of(const Eigen::VectorXd& signal) {
  return FourierTransform().forward_half(signal).head(signal.size() / 2).cwiseAbs2();
}

double quantile_of(const Eigen::VectorXd& power, double share) {
  std::vector<double> sorted(power.data() + 1, power.data() + power.size());
  const auto at = sorted.begin() + static_cast<long>(share * static_cast<double>(sorted.size()));
  std::nth_element(sorted.begin(), at, sorted.end());
  return *at;
}

std::optional<Eigen::Index> peak_of(const Eigen::VectorXd& power,
                                    const std::function<bool(Eigen::Index)>& counts,
                                    const Criteria& criteria) {
  std::optional<Eigen::Index> peak;
  for (Eigen::Index k = 1; k + 1 < power.size(); ++k)
    if (counts(k) && (!peak || power(k) > power(*peak))) peak = k;
  if (!peak || power(*peak) < criteria.line_peak * quantile_of(power, 0.5)) return std::nullopt;
  // A peak, not the skirt of something that was passed over.
  if (power(*peak - 1) > power(*peak) || power(*peak + 1) > power(*peak)) return std::nullopt;
  return peak;
}

}  // namespace servosense::reconcile
