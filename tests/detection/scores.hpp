// Detection against false alarms: ROC and the intervals of what is counted.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <string>
#include <vector>

namespace detection {

struct Interval {
  double low = 0, high = 1;
};

/// Of a share k / n, 95 % (Wilson 1927).
[[nodiscard]] inline Interval wilson(double k, double n) {
  if (!(n > 0)) return {};
  const double z = 1.959964, p = k / n, scale = 1 + z * z / n;
  const double middle = (p + z * z / (2 * n)) / scale;
  const double half = z / scale * std::sqrt(p * (1 - p) / n + z * z / (4 * n * n));
  return {std::max(0.0, middle - half), std::min(1.0, middle + half)};
}

/// Scores of one detector: value over threshold, so that 1 is its own operating point.
struct Scores {
  std::vector<double> with;     ///< records or instants with the event
  std::vector<double> without;  ///< and without

  /// Probability that an event scores higher than none (Mann and Whitney 1947; ties half).
  [[nodiscard]] double auc() const {
    if (with.empty() || without.empty()) return 0;
    std::vector<double> sorted = without;
    std::sort(sorted.begin(), sorted.end());
    double wins = 0;
    for (const double s : with) {
      const auto low = std::lower_bound(sorted.begin(), sorted.end(), s);
      const auto high = std::upper_bound(low, sorted.end(), s);
      wins += static_cast<double>(low - sorted.begin()) + static_cast<double>(high - low) / 2;
    }
    return wins / (static_cast<double>(with.size()) * static_cast<double>(without.size()));
  }
  /// Standard error of auc() (Hanley and McNeil 1982).
  [[nodiscard]] double auc_error() const {
    const double a = auc(), p = static_cast<double>(with.size()),
                 n = static_cast<double>(without.size());
    if (!(p > 0 && n > 0)) return 1;
    const double q1 = a / (2 - a), q2 = 2 * a * a / (1 + a);
    return std::sqrt(
        std::max(0.0, (a * (1 - a) + (p - 1) * (q1 - a * a) + (n - 1) * (q2 - a * a)) / (p * n)));
  }
  /// The score that a share of the events reaches.
  [[nodiscard]] double reached_by(double share) const {
    if (with.empty()) return 0;
    std::vector<double> sorted = with;
    std::sort(sorted.begin(), sorted.end());
    const auto missed =
        static_cast<std::size_t>((1 - share) * static_cast<double>(sorted.size()) + 1e-9);
    return sorted[std::min(missed, sorted.size() - 1)];
  }
  /// Share of the events found where at most `share` of the others alarm.
  [[nodiscard]] double found_at(double share) const {
    if (without.empty() || with.empty()) return 0;
    std::vector<double> sorted = without;
    std::sort(sorted.begin(), sorted.end());
    const auto allowed = static_cast<std::size_t>(share * static_cast<double>(sorted.size()));
    const double level = sorted[sorted.size() - 1 - std::min(allowed, sorted.size() - 1)];
    const auto found = std::count_if(with.begin(), with.end(), [&](double s) { return s > level; });
    return static_cast<double>(found) / static_cast<double>(with.size());
  }
  [[nodiscard]] std::size_t found(double level = 1) const { return count(with, level); }
  [[nodiscard]] std::size_t false_alarms(double level = 1) const { return count(without, level); }

  void print(const char* name) const {
    const auto share = [](std::size_t k, std::size_t n) {
      const Interval i = wilson(static_cast<double>(k), static_cast<double>(n));
      char text[80];
      std::snprintf(text, sizeof text, "%zu of %zu (%.1f..%.1f %%)", k, n, 100 * i.low,
                    100 * i.high);
      return std::string(text);
    };
    std::printf(
        "  %-36s AUC %.4f +- %.4f; found %s, false %s; %.1f %% found at 1 %% false; 99 %% "
        "reach %.3g\n",
        name, auc(), 1.96 * auc_error(), share(found(), with.size()).c_str(),
        share(false_alarms(), without.size()).c_str(), 100 * found_at(0.01), reached_by(0.99));
  }

 private:
  static std::size_t count(const std::vector<double>& scores, double level) {
    return static_cast<std::size_t>(
        std::count_if(scores.begin(), scores.end(), [&](double s) { return s >= level; }));
  }
};

[[nodiscard]] inline double quantile(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

}  // namespace detection
