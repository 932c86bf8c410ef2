// A segment of a record, its mean taken off, under a Hann window, transformed (Welch 1967).
#pragma once

#include <cmath>
#include <complex>
#include <cstddef>
#include <span>
#include <vector>

#include "dsp/fourier.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

class WelchSegment {
 public:
  /// `length` even.
  explicit WelchSegment(std::size_t length) : tapered_(length) {
    for (std::size_t i = 0; i < length; ++i) {
      const double w =
          0.5 - 0.5 * std::cos(kTwoPi * static_cast<double>(i) / static_cast<double>(length));
      window_.push_back(w);
      window_power_ += w * w;
    }
  }
  [[nodiscard]] std::size_t length() const { return window_.size(); }
  /// Sum of squares of the window.
  [[nodiscard]] double window_power() const { return window_power_; }
  /// Lines 0 .. length / 2 and their mirror images, not scaled; valid until the next call.
  const std::vector<std::complex<double>>& transform(std::span<const double> samples) {
    double mean = 0;
    for (const double x : samples) mean += x;
    mean /= static_cast<double>(length());
    for (std::size_t i = 0; i < length(); ++i) tapered_[i] = (samples[i] - mean) * window_[i];
    fft_.forward(tapered_, lines_);
    return lines_;
  }

 private:
  std::vector<double> window_, tapered_;
  double window_power_ = 0;
  std::vector<std::complex<double>> lines_;
  FourierTransform fft_;
};

}  // namespace servosense
