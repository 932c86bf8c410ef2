#include "servosense/identify/alarm_rate.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

namespace servosense {
AlarmRate::AlarmRate(unsigned consecutive) : consecutive_(std::max(1U, consecutive)) {}

void AlarmRate::add(double value, double seconds) {
  if (!std::isfinite(value)) return;
  seconds_ += seconds;
  if (run_.size() == consecutive_) run_.erase(run_.begin());
  run_.push_back(std::abs(value));
  if (run_.size() == consecutive_) held_.push_back(*std::min_element(run_.begin(), run_.end()));
}

void AlarmRate::interrupt() { run_.clear(); }

std::size_t AlarmRate::blocks() const {
  return std::min(kMostBlocks, held_.size() / (kBlock * consecutive_));
}

bool AlarmRate::known() const { return blocks() >= kLeastBlocks; }

AlarmRate::Tail AlarmRate::tail() const {
  const std::size_t n = blocks();
  std::vector<double> highest;
  highest.reserve(n);
  for (std::size_t b = 0; b < n; ++b) {
    const auto at = [&](std::size_t block) {
      return held_.begin() + static_cast<std::ptrdiff_t>(block * held_.size() / n);
    };
    const double most = *std::max_element(at(b), at(b + 1));
    highest.push_back(most * most);
  }
  std::sort(highest.begin(), highest.end(), std::greater<>());
  const std::size_t k = n / 4;
  Tail t;
  t.u = highest[k];
  t.excesses = static_cast<double>(k);
  t.per_hour = t.excesses / hours();
  for (std::size_t i = 0; i < k; ++i) t.mean_excess += (highest[i] - t.u) / t.excesses;
  return t;
}

double AlarmRate::level(double per_hour) const {
  if (!known()) return 0;
  const Tail t = tail();
  const double longer = std::pow(t.per_hour / per_hour, 1 / t.excesses);
  return std::sqrt(t.u + t.excesses * t.mean_excess * std::max(0.0, longer - 1));
}

double AlarmRate::per_hour(double level) const {
  if (!known()) return std::numeric_limits<double>::quiet_NaN();
  const Tail t = tail();
  const double over = std::max(0.0, level) * std::max(0.0, level) - t.u;
  if (!(over > 0)) return t.per_hour;
  if (!(t.mean_excess > 0)) return 0;
  return t.per_hour * std::pow(1 + over / (t.excesses * t.mean_excess), -t.excesses);
}

}  // namespace servosense
