#include "servosense/identify/alarm_rate.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

namespace servosense {

PeakTail::PeakTail(std::vector<double> highest, unsigned parts, double hours) {
  if (highest.size() < std::max<std::size_t>(kLeast, parts + 1)) return;
  std::sort(highest.begin(), highest.end(), std::greater<>());
  const std::size_t k = highest.size() / parts;
  u_ = highest[k] * highest[k];
  excesses_ = static_cast<double>(k);
  per_hour_ = excesses_ / hours;
  for (std::size_t i = 0; i < k; ++i) mean_excess_ += (highest[i] * highest[i] - u_) / excesses_;
}

double PeakTail::level(double per_hour) const {
  if (!known()) return 0;
  const double longer = std::pow(per_hour_ / per_hour, 1 / excesses_);
  return std::sqrt(u_ + excesses_ * mean_excess_ * std::max(0.0, longer - 1));
}

double PeakTail::per_hour(double level, double times) const {
  if (!known()) return std::numeric_limits<double>::quiet_NaN();
  const double over = std::max(0.0, level) * std::max(0.0, level) - u_;
  if (!(over > 0)) return per_hour_;
  if (!(mean_excess_ > 0)) return 0;
  const double k = times * excesses_;
  return per_hour_ * std::pow(1 + over / (k * mean_excess_), -k);
}

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

PeakTail AlarmRate::tail() const {
  if (!known()) return {};
  const std::size_t n = blocks();
  std::vector<double> highest;
  highest.reserve(n);
  for (std::size_t b = 0; b < n; ++b) {
    const auto at = [&](std::size_t block) {
      return held_.begin() + static_cast<std::ptrdiff_t>(block * held_.size() / n);
    };
    highest.push_back(*std::max_element(at(b), at(b + 1)));
  }
  return {std::move(highest), 4, hours()};
}

}  // namespace servosense
