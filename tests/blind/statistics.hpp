// Rates and quantiles with what so few cases leave open.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace blind {

/// NaN where there is no value.
inline double quantile(std::vector<double> values, double q) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::ranges::sort(values);
  const double at = q * static_cast<double>(values.size() - 1);
  const auto low = static_cast<std::size_t>(at);
  const std::size_t high = std::min(low + 1, values.size() - 1);
  return values[low] + (at - static_cast<double>(low)) * (values[high] - values[low]);
}

struct Interval {
  double low = 0, high = 1;
};

/// So many of so many cases.
struct Rate {
  std::size_t hits = 0, of = 0;
  void add(bool hit) {
    hits += hit;
    ++of;
  }
  [[nodiscard]] double share() const {
    return of > 0 ? static_cast<double>(hits) / static_cast<double>(of)
                  : std::numeric_limits<double>::quiet_NaN();
  }
  /// 95 % (Wilson 1927); everything is possible without a case.
  [[nodiscard]] Interval interval() const {
    if (of == 0) return {};
    constexpr double z = 1.959964;
    const auto n = static_cast<double>(of);
    const double p = share(), wider = 1 + z * z / n;
    const double middle = (p + z * z / (2 * n)) / wider;
    const double half = z * std::sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / wider;
    return {std::max(0.0, middle - half), std::min(1.0, middle + half)};
  }
};

/// 95 % interval of a quantile: order statistics, their ranks by the normal approximation to the
/// binomial law.
inline Interval quantile_interval(std::vector<double> values, double q) {
  if (values.empty())
    return {-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  std::ranges::sort(values);
  const auto n = static_cast<double>(values.size());
  const double half = 1.959964 * std::sqrt(n * q * (1 - q));
  const auto rank = [&](double at) { return static_cast<std::size_t>(std::clamp(at, 0.0, n - 1)); };
  return {values[rank(std::floor(n * q - half))], values[rank(std::ceil(n * q + half))]};
}

}  // namespace blind
