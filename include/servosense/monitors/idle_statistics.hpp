// What a monitor's value does while nothing is cut, and the threshold that follows from it.
//
// threshold = max(|mean| + 6 sigma, 1.5 * highest level held for as many samples as an alarm takes)
// The first is the source's rule (Koike 2016, section 5.4) and holds for noise. The second keeps
// what repeats in every idle run, such as friction at reversals, from raising an alarm: on a real
// axis (EMPS) reversals reach 9 sigma at each turn.
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
    if (!(held > 0)) return;
    ++held_count_;
    const double l = std::log(held) - log_mean_;
    log_mean_ += l / static_cast<double>(held_count_);
    log_squares_ += l * (std::log(held) - log_mean_);
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
    return std::max(noise_threshold(), 1.5 * held_peak_);
  }
  /// Probability that a held level reaches `level`, from a log-normal law fitted to those seen
  /// (those at 0 never do). Its tail is heavier than that of the power of noise, so it errs high.
  /// An extrapolation: beyond 1 / count() it tells the order of magnitude. 1 below 30 values.
  [[nodiscard]] double exceedance(double level) const noexcept {
    if (held_count_ < 30) return count_ < 30 ? 1 : 0;
    if (!(level > 0)) return 1;
    const double sigma = std::sqrt(log_squares_ / static_cast<double>(held_count_ - 1));
    const double above = std::log(level) - log_mean_;
    if (!(sigma > 0)) return above > 0 ? 0 : 1;
    const double share = static_cast<double>(held_count_) / static_cast<double>(count_);
    return std::min(1.0, share * 0.5 * std::erfc(above / (sigma * std::sqrt(2.0))));
  }

 private:
  unsigned consecutive_;
  std::uint64_t count_ = 0;
  double mean_ = 0;
  double squares_ = 0;
  double peak_ = 0;
  double held_peak_ = 0;
  std::uint64_t held_count_ = 0;  // positive ones
  double log_mean_ = 0;           // of held levels
  double log_squares_ = 0;
  std::array<double, kLongest> last_{};
};

}  // namespace servosense
