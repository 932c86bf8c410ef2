#include "servosense/observer/inverse_filter.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "dsp/fourier.hpp"

namespace servosense {

using Complex = std::complex<double>;

std::vector<Complex> accelerance(std::span<const StructuralMode> modes, double sample_rate_hz,
                                 std::size_t lines) {
  std::vector<Complex> response(lines);
  for (std::size_t k = 0; k < lines; ++k) {
    const double w =
        kTwoPi * sample_rate_hz / 2 * static_cast<double>(k) / static_cast<double>(lines - 1);
    for (const StructuralMode& m : modes) response[k] -= w * w * m.receptance(w);
  }
  return response;
}

namespace {
constexpr double kLeastKept = 0.98;  // of the energy of the inverse, by its taps
}

struct InverseFilter::Content {
  std::size_t size = 0;         // N
  std::vector<Complex> filter;  // spectrum of the taps, the centre tap N/4 late
  std::vector<double> last;     // N samples, the newest block behind
  std::vector<Complex> spectrum;
  std::vector<double> out;
  std::size_t not_finite = 0;
  FourierTransform fft;
};

Expected<InverseFilter> InverseFilter::make(const Config& config) {
  constexpr std::size_t kLeast = 16, kMost = std::size_t{1} << 20U;
  const std::size_t lines = config.response.size();
  const std::size_t size = lines < 2 ? 0 : 2 * (lines - 1);
  if (size < kLeast || size > kMost || !std::has_single_bit(size))
    return usage_error(
        "inverse filter: the response needs N/2 + 1 lines, N a power of two from 16 "
        "to 2^20");
  if (!(config.regularisation > 0) || !std::isfinite(config.regularisation))
    return usage_error("inverse filter: the regularisation must be positive");
  if (!std::ranges::all_of(config.response, [](const Complex& g) {
        return std::isfinite(g.real()) && std::isfinite(g.imag());
      }))
    return usage_error("inverse filter: the response must be finite");
  auto content = std::make_unique<Content>();
  Content& c = *content;
  c.size = size;
  c.last.assign(size, 0);
  std::vector<Complex> inverse(size);
  for (std::size_t k = 0; k < lines; ++k) {
    const Complex g = config.response[k];
    inverse[k] = std::conj(g) / (std::norm(g) + config.regularisation * config.regularisation);
    if (k > 0 && k + 1 < lines) inverse[size - k] = std::conj(inverse[k]);
  }
  inverse.front() = inverse.front().real();
  inverse[lines - 1] = inverse[lines - 1].real();
  std::vector<Complex> response;
  c.fft.inverse(inverse, response);
  // Taps from -N/4 to N/4, the outer half of them falling to zero as a cosine.
  std::vector<Complex> taps(size);
  const auto reach = static_cast<std::ptrdiff_t>(size / 4);
  double kept = 0, all = 0;
  for (const Complex& tap : response) all += std::norm(tap);
  for (std::ptrdiff_t i = -reach; i <= reach; ++i) {
    const double part = std::abs(static_cast<double>(i)) / static_cast<double>(reach);
    const double weight = part < 0.5 ? 1 : 0.5 * (1 + std::cos(kTwoPi * (part - 0.5)));
    const auto from = static_cast<std::size_t>(i < 0 ? i + static_cast<std::ptrdiff_t>(size) : i);
    taps[static_cast<std::size_t>(i + reach)] = weight * response[from].real();
    kept += weight * weight * std::norm(response[from]);
  }
  if (!(kept >= kLeastKept * all))
    return usage_error(
        "inverse filter: the inverse remembers longer than the taps are; give more lines, or more "
        "regularisation");
  c.fft.forward(taps, c.filter);
  return InverseFilter(std::move(content));
}

InverseFilter::InverseFilter(std::unique_ptr<Content> content) : content_(std::move(content)) {}
InverseFilter::InverseFilter(InverseFilter&&) noexcept = default;
InverseFilter& InverseFilter::operator=(InverseFilter&&) noexcept = default;
InverseFilter::~InverseFilter() = default;

std::size_t InverseFilter::block_samples() const { return content_->size / 2; }
std::size_t InverseFilter::delay_samples() const { return content_->size / 4; }
std::size_t InverseFilter::not_finite() const { return content_->not_finite; }

void InverseFilter::process(std::span<const double> acceleration, std::span<double> force) {
  Content& c = *content_;
  const auto half = static_cast<std::ptrdiff_t>(c.size / 2);
  std::copy(c.last.begin() + half, c.last.end(), c.last.begin());
  std::transform(acceleration.begin(), acceleration.begin() + half, c.last.begin() + half,
                 [&](double a) {
                   if (std::isfinite(a)) return a;
                   ++c.not_finite;
                   return 0.0;
                 });
  c.fft.forward(c.last, c.spectrum);
  for (std::size_t k = 0; k < c.size; ++k) c.spectrum[k] *= c.filter[k];
  c.fft.inverse(c.spectrum, c.out);
  std::copy(c.out.begin() + half, c.out.end(), force.begin());
}

void InverseFilter::reset() {
  std::ranges::fill(content_->last, 0);
  content_->not_finite = 0;
}

}  // namespace servosense
