#include "reconcile/numerics/smoother.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kHalfPower = 0.13253;  // corner * standard deviation: sqrt(ln 2) / 2 pi
constexpr double kTails = 4.5;          // standard deviations to which a Gaussian is carried

}  // namespace

Smoother::Smoother(double corner_hz, double period_s, Notch notch) : reach_(1) {
  const double sigma = std::max(0.45, kHalfPower / (corner_hz * period_s));  // samples
  reach_ = static_cast<std::size_t>(std::ceil(kTails * sigma));
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
  if (notch.frequency_hz > 0) cut_out(notch, period_s);
}

/// Each kernel less what of it lies in the notch, which holds nothing of constants, so that what
/// it does to these, to ramps and parabolas stays as it is.
void Smoother::cut_out(Notch notch, double period_s) {
  const double sigma = 1 / (kTwoPi * notch.width_hz * period_s);  // samples
  const auto n = static_cast<long>(std::ceil(kTails * sigma));
  std::vector<double> envelope, band;
  double whole = 0, sum = 0;
  for (long i = -n; i <= n; ++i) {
    const double t = static_cast<double>(i) / sigma;
    envelope.push_back(std::exp(-0.5 * t * t));
    band.push_back(2 * envelope.back() *
                   std::cos(kTwoPi * notch.frequency_hz * period_s * static_cast<double>(i)));
    whole += envelope.back();
    sum += band.back();
  }
  for (std::size_t k = 0; k < band.size(); ++k)
    band[k] = (band[k] - sum / whole * envelope[k]) / whole;
  for (std::vector<double>& kernel : kernel_) {
    std::vector<double> wider(kernel.size() + band.size() - 1, 0);
    for (std::size_t k = 0; k < kernel.size(); ++k) {
      wider[k + static_cast<std::size_t>(n)] += kernel[k];
      for (std::size_t m = 0; m < band.size(); ++m) wider[k + m] -= kernel[k] * band[m];
    }
    kernel = std::move(wider);
  }
  reach_ += static_cast<std::size_t>(n);
}

Column Smoother::apply(const Column& samples, int order, std::size_t stride) const {
  const std::vector<double>& kernel = kernel_[order];
  const std::size_t n = samples.size(), taps = kernel.size();
  Column out(n > 0 ? (n - 1) / stride + 1 : 0);
  // Where the kernel reaches beyond neither end.
  const std::size_t inner = std::min(out.size(), (reach_ + stride - 1) / stride);
  const std::size_t outer = n > 2 * reach_ ? std::max(inner, (n - reach_ - 1) / stride + 1) : inner;
  // With the ends held.
  const auto single_row = [&](std::size_t row) {
    double sum = 0;
    for (std::size_t k = 0; k < taps; ++k) {
      const std::size_t at = row * stride + k;
      sum += kernel[k] * samples[std::clamp(at, reach_, n - 1 + reach_) - reach_];
    }
    out[row] = sum;
  };
  for (std::size_t row = 0; row < inner; ++row) single_row(row);
  // Each sum waits for its own last addition, so several at once.
  constexpr std::size_t kAtOnce = 4;
  std::size_t row = inner;
  for (; row + kAtOnce <= outer; row += kAtOnce) {
    const double* from = samples.data() + (row * stride - reach_);
    std::array<double, kAtOnce> sums{};
    for (std::size_t k = 0; k < taps; ++k)
      for (std::size_t s = 0; s < kAtOnce; ++s) sums[s] += kernel[k] * from[s * stride + k];
    std::copy(sums.begin(), sums.end(), out.begin() + static_cast<long>(row));
  }
  for (; row < out.size(); ++row) single_row(row);
  return out;
}

Column difference(Column a, const Column& b) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] -= b[i];
  return a;
}

void add_to(Column& to, double factor, const Column& column) {
  for (std::size_t i = 0; i < to.size(); ++i) to[i] += factor * column[i];
}

}  // namespace servosense::reconcile
