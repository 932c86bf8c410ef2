#include "servosense/dsp/cross_spectrum.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "welch_segment.hpp"

namespace servosense {
namespace {

/// Of the noise of two half overlapping Hann windows: sum of w(i) w(i + N/2) over that of w^2.
constexpr double kShared = 1.0 / 6;

CrossSums zeros(std::size_t lines) {
  return {0, std::vector(lines, 0.0), std::vector(lines, 0.0),
          std::vector(lines, std::complex<double>{})};
}

}  // namespace

CrossSums& CrossSums::operator+=(const CrossSums& other) {
  if (input.empty()) return *this = other;
  segments += other.segments;
  for (std::size_t m = 0; m < other.input.size(); ++m) {
    input[m] += other.input[m];
    output[m] += other.output[m];
    cross[m] += other.cross[m];
  }
  return *this;
}

void CrossSums::add(std::span<const std::complex<double>> x,
                    std::span<const std::complex<double>> y) {
  for (std::size_t m = 0; m < input.size(); ++m) {
    input[m] += std::norm(x[m]);
    output[m] += std::norm(y[m]);
    cross[m] += std::conj(x[m]) * y[m];
  }
  ++segments;
}

std::complex<double> CrossSums::h1(std::size_t m) const {
  return input[m] > 0 ? cross[m] / input[m] : 0;
}

std::complex<double> CrossSums::h2(std::size_t m) const {
  return std::abs(cross[m]) > 0 ? output[m] / std::conj(cross[m]) : 0;
}

std::complex<double> CrossSums::hv(std::size_t m) const {
  const double size = std::abs(cross[m]);
  return size > 0 && input[m] > 0 ? cross[m] / size * std::sqrt(output[m] / input[m]) : 0;
}

double CrossSums::coherence(std::size_t m) const {
  if (!(input[m] > 0 && output[m] > 0)) return 0;
  return std::min(1.0, std::norm(cross[m]) / input[m] / output[m]);
}

CrossSpectrum cross_spectrum(std::span<const double> input, std::span<const double> output,
                             std::size_t segment, std::ptrdiff_t delay, std::size_t most_parts) {
  const auto shift = static_cast<std::size_t>(std::abs(delay));
  std::size_t n = std::min(input.size(), output.size());
  n = n > shift ? n - shift : 0;
  input = input.subspan(delay < 0 ? std::min(shift, input.size()) : 0);
  output = output.subspan(delay > 0 ? std::min(shift, output.size()) : 0);
  const std::size_t lines = segment / 2 + 1, step = segment / 2;
  const std::size_t count = n < segment ? 0 : (n - segment) / step + 1;
  WelchSegment of_input(segment), of_output(segment);
  CrossSpectrum all{zeros(lines), {}, std::vector(lines, 1.0), of_input.window_power()};
  const std::size_t parts = std::min(count, std::max<std::size_t>(most_parts, 1));
  std::vector<std::complex<double>> before;
  std::vector<double> alike(lines, 0.0);
  for (std::size_t p = 0; p < parts; ++p) {
    CrossSums part = zeros(lines);
    for (std::size_t k = p * count / parts; k < (p + 1) * count / parts; ++k) {
      const auto& x = of_input.transform(input.subspan(k * step, segment));
      const auto& y = of_output.transform(output.subspan(k * step, segment));
      part.add(x, y);
      // Half a segment later a line has turned by m half turns.
      for (std::size_t m = 0; k > 0 && m < lines; ++m)
        alike[m] += (m % 2 ? -1 : 1) * (std::conj(before[m]) * x[m]).real();
      before = x;
    }
    all.whole += part;
    all.parts.push_back(std::move(part));
  }
  for (std::size_t m = 0; m < lines; ++m)
    if (all.whole.input[m] > 0) all.overlap[m] += 2 * kShared * alike[m] / all.whole.input[m];
  return all;
}

}  // namespace servosense
