#include "servosense/dsp/ar_order.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "servosense/dsp/lattice_ar.hpp"

namespace servosense {
namespace {

constexpr std::size_t kMostOrder = 256;
// One stage more than the highest order: the residual of order i enters stage i.
using Lattice = LatticeAr<double, kMostOrder + 1>;

}  // namespace

Expected<ArOrderCurve> ar_order_curve(std::span<const double> samples, std::size_t most_order,
                                      double noise_variance) {
  if (most_order < 1 || most_order > kMostOrder)
    return usage_error("the highest order to try must be from 1 to " + std::to_string(kMostOrder));
  if (samples.size() < 3 * (most_order + 1))
    return data_error("an AR order of up to " + std::to_string(most_order) + " needs at least " +
                      std::to_string(3 * (most_order + 1)) + " samples, there are " +
                      std::to_string(samples.size()) + ": record longer or try lower orders");
  for (std::size_t i = 0; i < samples.size(); ++i)
    if (!(std::abs(samples[i]) < 1e12))
      return data_error("sample " + std::to_string(i + 1) + " of the recording is not a number");
  const LatticeArConfig config{static_cast<unsigned>(most_order + 1), noise_variance, 1};
  if (const Status s = Lattice::validate(config); !s.ok())
    return usage_error(std::string(s.parameter()) + " " + s.reason());

  const auto lattice = std::make_unique<Lattice>();
  lattice->configure(config);
  std::vector<double> sum(most_order + 1, 0.0);
  for (std::size_t k = 0; k < samples.size(); ++k) {
    lattice->begin(samples[k]);
    for (std::size_t p = 0; p <= most_order; ++p) {
      const double e = lattice->state().forward;
      if (k >= most_order) sum[p] += e * e;
      lattice->process_some(1);
    }
  }
  if (lattice->state().resets > 0)
    return data_error("the recording holds values that no AR model can follow in double precision");

  ArOrderCurve curve;
  const auto n = static_cast<double>(samples.size() - most_order);
  for (std::size_t i = 0; i <= most_order; ++i) {
    const auto p = static_cast<double>(i);
    curve.variance.push_back(sum[i] / n);
    curve.fpe.push_back((n + p + 1) / (n - p - 1) * sum[i] / n);
    // A recording of zeros is predicted exactly by every order.
    curve.aic.push_back(n * std::log(std::max(sum[i] / (n - p - 1), 1e-300)) + 2 * p);
  }
  const auto least = [](const std::vector<double>& v) {
    return static_cast<std::size_t>(std::min_element(v.begin(), v.end()) - v.begin());
  };
  curve.least_fpe = least(curve.fpe);
  curve.least_aic = least(curve.aic);
  return curve;
}

std::vector<std::size_t> candidate_orders(std::span<const double> aic) {
  constexpr double kFall = 4;
  constexpr std::size_t kApart = 2;  // orders without a fall end a group
  std::vector<std::size_t> last;
  for (std::size_t p = 1; p < aic.size(); ++p) {
    if (!(aic[p] < aic[p - 1] - kFall)) continue;
    if (last.empty() || p - last.back() > kApart)
      last.push_back(p);
    else
      last.back() = p;
  }
  return last;
}

}  // namespace servosense
