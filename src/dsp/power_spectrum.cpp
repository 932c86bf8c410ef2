#include "servosense/dsp/power_spectrum.hpp"

#include <cmath>
#include <complex>
#include <unsupported/Eigen/FFT>

#include "servosense/core/units.hpp"

namespace servosense {

struct PowerSpectrum::Content {
  std::size_t segment;
  double rate;
  std::vector<double> window;
  double window_power = 0;  // sum of squares
  std::vector<double> held;
  std::vector<double> sum;
  std::size_t segments = 0;
  Eigen::FFT<double> fft;

  void transform() {
    double mean = 0;
    for (const double x : held) mean += x;
    mean /= static_cast<double>(segment);
    std::vector<double> tapered(segment);
    for (std::size_t i = 0; i < segment; ++i) tapered[i] = (held[i] - mean) * window[i];
    std::vector<std::complex<double>> lines;
    fft.fwd(lines, tapered);
    for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += std::norm(lines[k]);
    ++segments;
    held.erase(held.begin(), held.begin() + static_cast<std::ptrdiff_t>(segment / 2));
  }
};

PowerSpectrum::PowerSpectrum(std::size_t segment, double sample_rate_hz)
    : content_(std::make_unique<Content>()) {
  Content& c = *content_;
  c.segment = segment;
  c.rate = sample_rate_hz;
  c.sum.assign(segment / 2 + 1, 0.0);
  for (std::size_t i = 0; i < segment; ++i) {
    const double w =
        0.5 - 0.5 * std::cos(kTwoPi * static_cast<double>(i) / static_cast<double>(segment));
    c.window.push_back(w);
    c.window_power += w * w;
  }
}
PowerSpectrum::PowerSpectrum(PowerSpectrum&&) noexcept = default;
PowerSpectrum& PowerSpectrum::operator=(PowerSpectrum&&) noexcept = default;
PowerSpectrum::~PowerSpectrum() = default;

void PowerSpectrum::add(double sample) {
  Content& c = *content_;
  if (!std::isfinite(sample)) {
    c.held.clear();
    return;
  }
  c.held.push_back(sample);
  if (c.held.size() == c.segment) c.transform();
}

std::size_t PowerSpectrum::segments() const { return content_->segments; }

std::vector<double> PowerSpectrum::frequency_hz() const {
  std::vector<double> f;
  for (std::size_t k = 0; k < content_->sum.size(); ++k)
    f.push_back(static_cast<double>(k) * content_->rate / static_cast<double>(content_->segment));
  return f;
}

std::vector<double> PowerSpectrum::power() const {
  const Content& c = *content_;
  std::vector<double> p = c.sum;
  if (c.segments == 0) return p;
  // Both halves of the spectrum; the lines at zero and at half the rate stand alone.
  const double scale =
      2.0 / (c.window_power * static_cast<double>(c.segment) * static_cast<double>(c.segments));
  for (double& line : p) line *= scale;
  p.front() /= 2;
  p.back() /= 2;
  return p;
}

}  // namespace servosense
