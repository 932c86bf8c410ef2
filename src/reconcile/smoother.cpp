#include "smoother.hpp"

#include <algorithm>
#include <cmath>

namespace servosense::reconcile {
namespace {

constexpr double kHalfPower = 0.13253;  // corner * standard deviation: sqrt(ln 2) / 2 pi

}  // namespace

Smoother::Smoother(double corner_hz, double period_s) : reach_(1) {
  const double sigma = std::max(0.45, kHalfPower / (corner_hz * period_s));  // samples
  reach_ = static_cast<std::size_t>(std::ceil(4.5 * sigma));
  const auto n = static_cast<long>(reach_);
  double sum = 0, first = 0, second = 0, level = 0;
  for (int order = 0; order < 3; ++order) kernel_[order].assign(2 * reach_ + 1, 0);
  for (long i = -n; i <= n; ++i) {
    const double t = static_cast<double>(i) / sigma;
    const double g = std::exp(-0.5 * t * t);
    const auto at = static_cast<std::size_t>(i + n);
    kernel_[0][at] = g;
    kernel_[1][at] = t * g;
    kernel_[2][at] = (t * t - 1) * g;
    sum += g;
    level += kernel_[2][at];
  }
  for (std::size_t at = 0; at < kernel_[0].size(); ++at) {
    kernel_[0][at] /= sum;
    kernel_[2][at] -= level * kernel_[0][at];
  }
  for (long i = -n; i <= n; ++i) {
    const auto at = static_cast<std::size_t>(i + n);
    first += static_cast<double>(i) * period_s * kernel_[1][at];
    second += 0.5 * static_cast<double>(i * i) * period_s * period_s * kernel_[2][at];
  }
  for (std::size_t at = 0; at < kernel_[0].size(); ++at) {
    kernel_[1][at] /= first;
    kernel_[2][at] /= second;
  }
}

Column Smoother::apply(const Column& samples, int order, std::size_t stride) const {
  const std::vector<double>& kernel = kernel_[order];
  const auto n = static_cast<long>(samples.size());
  const auto reach = static_cast<long>(reach_);
  Column out;
  out.reserve(samples.size() / stride + 1);
  for (long i = 0; i < n; i += static_cast<long>(stride)) {
    double sum = 0;
    if (i >= reach && i + reach < n) {
      const double* from = samples.data() + (i - reach);
      for (std::size_t k = 0; k < kernel.size(); ++k) sum += kernel[k] * from[k];
    } else {
      for (long k = -reach; k <= reach; ++k) {
        const long at = std::clamp(i + k, 0L, n - 1);
        sum += kernel[static_cast<std::size_t>(k + reach)] * samples[static_cast<std::size_t>(at)];
      }
    }
    out.push_back(sum);
  }
  return out;
}

Column difference(Column a, const Column& b) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] -= b[i];
  return a;
}

double between_samples(const Column& samples, double index) {
  const double at = std::clamp(index, 0.0, static_cast<double>(samples.size() - 1));
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, samples.size() - 1);
  return samples[below] + (at - static_cast<double>(below)) * (samples[above] - samples[below]);
}

}  // namespace servosense::reconcile
