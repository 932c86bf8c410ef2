// Discrete Fourier transforms of any length by Eigen's FFT, compiled once: each file that names it
// takes a compiler seconds.
//   X_k = sum over n of x_n e^(-2 pi i k n / N),   x_n = 1/N sum over k of X_k e^(2 pi i k n / N)
#pragma once

#include <Eigen/Core>
#include <complex>
#include <memory>
#include <span>
#include <vector>

namespace servosense {

/// Keeps its tables for each length. One object serves one thread.
class FourierTransform {
 public:
  using Complex = std::complex<double>;

  FourierTransform();
  FourierTransform(FourierTransform&&) noexcept;
  FourierTransform& operator=(FourierTransform&&) noexcept;
  ~FourierTransform();

  /// All N lines of N samples, resized to that. What is transformed must not be the result.
  void forward(std::span<const double> samples, std::vector<Complex>& lines);
  void forward(std::span<const Complex> samples, std::vector<Complex>& lines);
  /// N samples of N lines; of real samples the upper half of the lines is not looked at.
  void inverse(std::span<const Complex> lines, std::vector<double>& samples);
  void inverse(std::span<const Complex> lines, std::vector<Complex>& samples);

  /// Lines 0 to N/2 of N real samples, N even, and back. Shapes: samples (N), lines (N/2 + 1).
  [[nodiscard]] Eigen::VectorXcd forward_half(const Eigen::VectorXd& samples);
  [[nodiscard]] Eigen::VectorXd inverse_half(const Eigen::VectorXcd& lines);

 private:
  struct Tables;
  std::unique_ptr<Tables> tables_;
};

/// All lines of a record, once.
[[nodiscard]] std::vector<std::complex<double>> fourier_lines(std::span<const double> samples);

}  // namespace servosense
