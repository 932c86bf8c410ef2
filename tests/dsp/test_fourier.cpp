// The transforms against the sum that defines them, at lengths of one factor and of several.
#include <cmath>

#include "check.hpp"
#include "dsp/fourier.hpp"
#include "servosense/core/units.hpp"

namespace {

using Complex = std::complex<double>;
using servosense::FourierTransform;

std::vector<Complex> by_the_sum(const std::vector<Complex>& x) {
  const auto n = static_cast<double>(x.size());
  std::vector<Complex> lines(x.size());
  for (std::size_t k = 0; k < x.size(); ++k)
    for (std::size_t i = 0; i < x.size(); ++i)
      lines[k] += x[i] * std::polar(1.0, -servosense::kTwoPi * static_cast<double>(k * i) / n);
  return lines;
}

double farthest(const auto& a, const auto& b) {
  double most = 0;
  for (std::size_t i = 0; i < b.size(); ++i) most = std::max(most, std::abs(a[i] - b[i]));
  return most;
}

}  // namespace

int main() {
  FourierTransform transform;  // one object for all lengths
  for (const std::size_t n : {16U, 2U, 30U, 7U, 97U, 16U}) {
    std::vector<double> real(n);
    std::vector<Complex> complex(n);
    for (std::size_t i = 0; i < n; ++i) {
      real[i] = std::sin(1.7 * static_cast<double>(i * i)) + 0.3;
      complex[i] = {real[i], std::cos(0.9 * static_cast<double>(i * i))};
    }
    const std::vector<Complex> of_real = by_the_sum({real.begin(), real.end()});
    const double rounding = 1e-13 * static_cast<double>(n);
    std::vector<Complex> lines, back;
    std::vector<double> real_back;
    transform.forward(real, lines);
    CHECK(lines.size() == n && farthest(lines, of_real) < rounding);
    CHECK(servosense::fourier_lines(real) == lines);
    for (std::size_t k = n / 2 + 1; k < n; ++k) lines[k] = 1e9;  // not looked at
    transform.inverse(lines, real_back);
    CHECK(real_back.size() == n && farthest(real_back, real) < rounding);
    transform.forward(complex, lines);
    CHECK(lines.size() == n && farthest(lines, by_the_sum(complex)) < rounding);
    transform.inverse(lines, back);
    CHECK(back.size() == n && farthest(back, complex) < rounding);
    if (n % 2 != 0) continue;
    const Eigen::VectorXd samples =
        Eigen::Map<const Eigen::VectorXd>(real.data(), static_cast<Eigen::Index>(n));
    const Eigen::VectorXcd half = transform.forward_half(samples);
    CHECK(static_cast<std::size_t>(half.size()) == n / 2 + 1);
    for (Eigen::Index k = 0; k < half.size(); ++k)
      CHECK(std::abs(half(k) - of_real[static_cast<std::size_t>(k)]) < rounding);
    CHECK((transform.inverse_half(half) - samples).cwiseAbs().maxCoeff() < rounding);
  }
  return check::done();
}
