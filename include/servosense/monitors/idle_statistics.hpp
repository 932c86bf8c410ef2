// What a monitor's value does while nothing is cut, and the threshold that follows from it.
//
// threshold = max(|mean| + 6 sigma, 1.5 * highest level held for as many samples as an alarm takes)
// The first is the source's rule (Koike 2016, section 5.4) and holds for noise. The second keeps
// what repeats in every idle run, such as friction at reversals, from raising an alarm: on a real
// axis (EMPS) reversals reach 9 sigma at each turn. How often noise alone passes a threshold, and
// the one for a rate that is accepted: identify/alarm_rate.hpp; the rules here are its lower bound.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "servosense/core/real_time.hpp"

namespace servosense {

class IdleStatistics {
 public:
  static constexpr unsigned kLongest = 16;
  /// Over the highest level that the run holds.
  static constexpr double kMargin = 1.5;

  /// `consecutive`: samples in a row that raise an alarm, 1..kLongest.
  explicit IdleStatistics(unsigned consecutive = 1) noexcept
      : consecutive_(std::clamp(consecutive, 1U, kLongest)) {}

  /// A value that is not finite is passed over.
  void add(double value) noexcept {  // Welford (1962)
    if (!is_finite(value)) return;
    ++count_;
    const double d = value - mean_;
    mean_ += d / static_cast<double>(count_);
    squares_ += d * (value - mean_);
    const double size = std::abs(value);
    peak_ = std::max(peak_, size);
    last_[count_ % consecutive_] = size;
    if (count_ < consecutive_) return;
    const auto end = last_.begin() + static_cast<std::ptrdiff_t>(consecutive_);
    const double held = *std::min_element(last_.begin(), end);
    held_peak_ = std::max(held_peak_, held);
  }
  [[nodiscard]] std::uint64_t count() const noexcept { return count_; }
  [[nodiscard]] double mean() const noexcept { return mean_; }
  [[nodiscard]] double sigma() const noexcept {
    return count_ > 1 ? std::sqrt(squares_ / static_cast<double>(count_ - 1)) : 0;
  }
  /// Largest magnitude.
  [[nodiscard]] double peak() const noexcept { return peak_; }
  /// Largest magnitude that was held for `consecutive` samples.
  [[nodiscard]] double held_peak() const noexcept { return held_peak_; }
  /// |mean| + 6 sigma, the source's rule alone.
  [[nodiscard]] double noise_threshold() const noexcept { return std::abs(mean_) + 6 * sigma(); }
  /// 0 before the first value.
  [[nodiscard]] double threshold() const noexcept {
    return std::max(noise_threshold(), kMargin * held_peak_);
  }

 private:
  unsigned consecutive_;
  std::uint64_t count_ = 0;
  double mean_ = 0;
  double squares_ = 0;
  double peak_ = 0;
  double held_peak_ = 0;
  std::array<double, kLongest> last_{};
};

}  // namespace servosense
