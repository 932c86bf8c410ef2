#include "import_agreement.hpp"

#include <algorithm>
#include <cmath>

namespace servosense::detail {
namespace {

struct Sums {
  std::size_t n = 0;
  double aa = 0, ab = 0, bb = 0;
  void add(double a, double b) {
    ++n;
    aa += a * a;
    ab += a * b;
    bb += b * b;
  }
  /// Squared correlation about zero.
  [[nodiscard]] double share() const {
    return aa > 0 && bb > 0 ? std::min(1.0, ab * ab / (aa * bb)) : 0;
  }
};

Sums sums_over(const RowSample& sample, std::size_t position, std::size_t speed, std::size_t lag,
               double most) {
  Sums sums;
  const std::size_t width = sample.columns.size();
  for (std::size_t s = 0; s < sample.t_s.size(); ++s) {
    const auto& t = sample.t_s[s];
    const auto& v = sample.values[s];
    for (std::size_t i = 0; i + lag < t.size(); i += lag) {
      double b = 0;
      for (std::size_t j = i; j < i + lag; ++j)
        b += 0.5 * (v[j * width + speed] + v[(j + 1) * width + speed]) * (t[j + 1] - t[j]);
      const double a = v[(i + lag) * width + position] - v[i * width + position];
      // An angle that begins anew is no step.
      if (std::isfinite(a) && std::isfinite(b) && std::abs(a) <= most) sums.add(a, b);
    }
  }
  return sums;
}

}  // namespace

std::optional<Agreement> agreement_of(const RowSample& sample, std::size_t position,
                                      std::size_t speed, double position_range) {
  constexpr std::size_t kLeastSteps = 20;
  // Noise and rounding lower it; below it something else than motion is in one of them.
  constexpr double kLeastShare = 0.9;
  Sums best;
  for (const std::size_t lag : {std::size_t{1}, std::size_t{4}, std::size_t{16}}) {
    const Sums sums = sums_over(sample, position, speed, lag, 0.5 * position_range);
    if (sums.n >= kLeastSteps && sums.share() > best.share()) best = sums;
  }
  if (best.share() < kLeastShare) return std::nullopt;
  Agreement found;
  found.ratio = best.ab / best.bb;
  found.standard_error =
      std::abs(found.ratio) * std::sqrt((1 / best.share() - 1) / static_cast<double>(best.n - 1));
  return found;
}

}  // namespace servosense::detail
