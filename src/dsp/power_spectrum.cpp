#include "servosense/dsp/power_spectrum.hpp"

#include <cmath>

#include "welch_segment.hpp"

namespace servosense {

struct PowerSpectrum::Content {
  WelchSegment segment;
  double rate;
  std::vector<double> held;
  std::vector<double> sum;
  std::size_t segments = 0;

  void transform() {
    const auto& lines = segment.transform(held);
    for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += std::norm(lines[k]);
    ++segments;
    held.erase(held.begin(), held.begin() + static_cast<std::ptrdiff_t>(segment.length() / 2));
  }
};

PowerSpectrum::PowerSpectrum(std::size_t segment, double sample_rate_hz)
    : content_(std::make_unique<Content>(
          Content{WelchSegment(segment), sample_rate_hz, {}, std::vector(segment / 2 + 1, 0.0)})) {}
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
  if (c.held.size() == c.segment.length()) c.transform();
}

std::size_t PowerSpectrum::segments() const { return content_->segments; }

std::vector<double> PowerSpectrum::frequency_hz() const {
  std::vector<double> f;
  for (std::size_t k = 0; k < content_->sum.size(); ++k)
    f.push_back(static_cast<double>(k) * content_->rate /
                static_cast<double>(content_->segment.length()));
  return f;
}

std::vector<double> PowerSpectrum::power() const {
  const Content& c = *content_;
  std::vector<double> p = c.sum;
  if (c.segments == 0) return p;
  // Both halves of the spectrum; the lines at zero and at half the rate stand alone.
  const double scale = 2.0 / (c.segment.window_power() * static_cast<double>(c.segment.length()) *
                              static_cast<double>(c.segments));
  for (double& line : p) line *= scale;
  p.front() /= 2;
  p.back() /= 2;
  return p;
}

}  // namespace servosense
