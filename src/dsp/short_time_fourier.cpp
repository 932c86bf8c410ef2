#include "servosense/dsp/short_time_fourier.hpp"

#include <cmath>
#include <complex>
#include <limits>

#include "dsp/fourier.hpp"
#include "servosense/core/units.hpp"

namespace servosense {
namespace {

void take_trend(std::vector<double>& x, Detrend detrend) {
  if (detrend == Detrend::none) return;
  const auto n = static_cast<double>(x.size());
  const double middle = (n - 1) / 2;
  double mean = 0, moment = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    mean += x[i];
    moment += x[i] * (static_cast<double>(i) - middle);
  }
  mean /= n;
  const double slope = detrend == Detrend::line ? 12 * moment / (n * (n * n - 1)) : 0;
  for (std::size_t i = 0; i < x.size(); ++i)
    x[i] -= mean + slope * (static_cast<double>(i) - middle);
}

}  // namespace

std::vector<double> window_of(WindowShape shape, std::size_t samples) {
  std::vector<double> w(samples, 1.0);
  for (std::size_t i = 0; i < samples; ++i) {
    const double angle = kTwoPi * static_cast<double>(i) / static_cast<double>(samples);
    switch (shape) {
      case WindowShape::rectangular:
        break;
      case WindowShape::hann:
        w[i] = 0.5 - 0.5 * std::cos(angle);
        break;
      case WindowShape::hamming:
        w[i] = 0.54 - 0.46 * std::cos(angle);
        break;
      case WindowShape::blackman:
        w[i] = 0.42 - 0.5 * std::cos(angle) + 0.08 * std::cos(2 * angle);
        break;
    }
  }
  return w;
}

Expected<Spectrogram> short_time_fourier(std::span<const double> samples, double sample_rate_hz,
                                         const ShortTimeFourierConfig& config) {
  const std::size_t points = config.lines == 0 ? config.window : config.lines;
  if (!(sample_rate_hz > 0) || !std::isfinite(sample_rate_hz))
    return usage_error("the sample rate of a short-time Fourier transform must be positive");
  if (config.window < 4 || config.hop < 1 || points < config.window)
    return usage_error(
        "a short-time Fourier transform needs a window of at least 4 samples, a hop of at least 1 "
        "and no fewer points than the window has samples");
  if (samples.size() < config.window)
    return data_error("the record holds " + std::to_string(samples.size()) +
                      " samples, fewer than one window of " + std::to_string(config.window) +
                      ": record longer or choose a shorter window");
  const std::vector<double> window = window_of(config.shape, config.window);
  double sum = 0, squares = 0;
  for (const double w : window) {
    sum += w;
    squares += w * w;
  }
  Spectrogram result;
  result.peak_to_mean_square = squares * static_cast<double>(points) / (sum * sum);
  const std::size_t lines = points / 2 + 1;
  for (std::size_t k = 0; k < lines; ++k)
    result.frequency_hz.push_back(static_cast<double>(k) * sample_rate_hz /
                                  static_cast<double>(points));
  const double scale = 2 / (squares * static_cast<double>(points));
  FourierTransform fft;
  std::vector<double> x(config.window), padded(points);
  std::vector<std::complex<double>> transformed;
  for (std::size_t at = 0; at + config.window <= samples.size(); at += config.hop) {
    result.t_s.push_back((static_cast<double>(at) + 0.5 * static_cast<double>(config.window - 1)) /
                         sample_rate_hz);
    bool finite = true;
    for (std::size_t i = 0; i < config.window; ++i) {
      x[i] = samples[at + i];
      finite = finite && std::isfinite(x[i]);
    }
    if (!finite) {
      result.power.insert(result.power.end(), lines, std::numeric_limits<double>::quiet_NaN());
      continue;
    }
    take_trend(x, config.detrend);
    for (std::size_t i = 0; i < config.window; ++i) padded[i] = x[i] * window[i];
    fft.forward(padded, transformed);
    for (std::size_t k = 0; k < lines; ++k) {
      // Both halves of the spectrum; the lines at zero and at half the rate stand alone.
      const bool alone = k == 0 || 2 * k == points;
      result.power.push_back((alone ? scale / 2 : scale) * std::norm(transformed[k]));
    }
  }
  return result;
}

}  // namespace servosense
