#include "servosense/dsp/wavelet.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <string>
#include <utility>

#include "dsp/fourier.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

namespace {

using Complex = std::complex<double>;

double weight_of(WaveletWindow window, std::size_t n, std::size_t count) {
  switch (window) {
    case WaveletWindow::hann:
      return window_weight(CosineWindow::hann, n, count);
    case WaveletWindow::blackman:
      return window_weight(CosineWindow::blackman, n, count);
    case WaveletWindow::gauss: {
      const double u = (static_cast<double>(n) + 0.5) / static_cast<double>(count) - 0.5;
      return std::exp(-32 * u * u);  // sigma an eighth of the length
    }
    case WaveletWindow::rectangular:
      break;
  }
  return 1;
}

std::vector<Complex> spectrum_of(const std::vector<Complex>& padded) {
  std::vector<Complex> lines;
  FourierTransform().forward(padded, lines);
  return lines;
}

}  // namespace

struct WaveletTransform::Content {
  WaveletConfig config;
  std::vector<Complex> record;
  std::vector<Complex> spectrum;  // of the record, padded for the window in hand

  const std::vector<Complex>& padded_to(std::size_t length) {
    if (spectrum.size() != length) {
      std::vector<Complex> padded = record;
      padded.resize(length);
      spectrum = spectrum_of(padded);
    }
    return spectrum;
  }
};

WaveletTransform::WaveletTransform(std::unique_ptr<Content> content)
    : content_(std::move(content)) {}
WaveletTransform::WaveletTransform(WaveletTransform&&) noexcept = default;
WaveletTransform& WaveletTransform::operator=(WaveletTransform&&) noexcept = default;
WaveletTransform::~WaveletTransform() = default;

Expected<WaveletTransform> WaveletTransform::of(std::span<const double> record,
                                                const WaveletConfig& config) {
  if (!(config.sample_rate_hz > 0 && std::isfinite(config.sample_rate_hz)))
    return usage_error("wavelet transform: the sample rate must be a positive number of hertz");
  if (!(config.cycles >= 1 && config.cycles <= 1e6))
    return usage_error("wavelet transform: the window must be 1 to 1e6 periods long");
  if (record.empty()) return data_error("wavelet transform: the record is empty");
  const auto bad =
      std::find_if(record.begin(), record.end(), [](double x) { return !std::isfinite(x); });
  if (bad != record.end())
    return data_error("wavelet transform: sample " + std::to_string(bad - record.begin()) +
                      " is not a finite number; cut the record there");
  auto content = std::make_unique<Content>();
  content->config = config;
  content->record.assign(record.begin(), record.end());
  return WaveletTransform(std::move(content));
}

std::size_t WaveletTransform::window_samples(double frequency_hz) const {
  const WaveletConfig& c = content_->config;
  return static_cast<std::size_t>(std::lround(c.cycles * c.sample_rate_hz / frequency_hz));
}

std::size_t WaveletTransform::reach(double frequency_hz) const {
  return window_samples(frequency_hz) / 2;
}

Expected<std::vector<Complex>> WaveletTransform::line(double frequency_hz) const {
  Content& content = *content_;
  const WaveletConfig& c = content.config;
  if (!(frequency_hz > 0 && frequency_hz < c.sample_rate_hz / 2))
    return usage_error("wavelet transform: the frequency must lie between 0 and half the rate, " +
                       std::to_string(c.sample_rate_hz / 2) + " Hz");
  if (c.cycles * c.sample_rate_hz / frequency_hz > 1e8)
    return usage_error("wavelet transform: the window at " + std::to_string(frequency_hz) +
                       " Hz has more than 1e8 samples; ask for fewer periods");
  const std::size_t count = window_samples(frequency_hz);
  if (count < 4)
    return usage_error("wavelet transform: the window at " + std::to_string(frequency_hz) +
                       " Hz is shorter than 4 samples; ask for more periods");

  // Correlation as convolution with the mirrored window: tap m meets the sample n = back - m away.
  const std::size_t back = count / 2;
  // A power of two: fast, and most frequencies share the record's spectrum.
  const std::size_t length = std::bit_ceil(content.record.size() + count - 1);
  std::vector<Complex> taps(length);
  double weights = 0;
  for (std::size_t m = 0; m < count; ++m) {
    const double n = static_cast<double>(back) - static_cast<double>(m);
    const double w = weight_of(c.window, m, count);
    weights += w;
    taps[m] = w * std::polar(1.0, -kTwoPi * frequency_hz / c.sample_rate_hz * n);
  }
  std::vector<Complex> product = spectrum_of(taps);
  const std::vector<Complex>& lines = content.padded_to(length);
  for (std::size_t k = 0; k < length; ++k) product[k] *= lines[k] * (2 / weights);
  std::vector<Complex> whole;
  FourierTransform().inverse(product, whole);
  // Tap `back` belongs to the sample itself.
  const auto first = whole.begin() + static_cast<std::ptrdiff_t>(back);
  return std::vector<Complex>(first, first + static_cast<std::ptrdiff_t>(content.record.size()));
}

std::vector<double> combined_density(std::span<const Complex> x, std::span<const Complex> y) {
  std::vector<double> density(x.size());
  for (std::size_t i = 0; i < x.size(); ++i)
    density[i] = std::sqrt(std::norm(x[i]) + std::norm(y[i]));
  return density;
}

}  // namespace servosense
