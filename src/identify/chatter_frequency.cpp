#include "servosense/identify/chatter_frequency.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <unsupported/Eigen/FFT>

#include "servosense/core/units.hpp"

namespace servosense {
namespace {

constexpr std::size_t kFewest = 64;
constexpr double kStandsOut = 6.3;  // 8 dB
constexpr double kOfStrongest = 0.1;
constexpr int kSidebands = 40;

/// What is left of the torque beside its mean and the harmonics of the rotation.
Eigen::VectorXd without_harmonics(std::span<const double> torque, std::span<const double> angle,
                                  unsigned harmonics) {
  const auto n = static_cast<Eigen::Index>(torque.size());
  Eigen::MatrixXd basis(n, 1 + 2 * static_cast<Eigen::Index>(harmonics));
  for (Eigen::Index i = 0; i < n; ++i) {
    basis(i, 0) = 1;
    for (Eigen::Index h = 1; h <= static_cast<Eigen::Index>(harmonics); ++h) {
      const double phase = static_cast<double>(h) * angle[static_cast<std::size_t>(i)];
      basis(i, 2 * h - 1) = std::cos(phase);
      basis(i, 2 * h) = std::sin(phase);
    }
  }
  const Eigen::Map<const Eigen::VectorXd> y(torque.data(), n);
  const Eigen::VectorXd fit = (basis.transpose() * basis).ldlt().solve(basis.transpose() * y);
  return y - basis * fit;
}

double turned(std::span<const double> angle) {
  double sum = 0;
  for (std::size_t i = 1; i < angle.size(); ++i)
    sum += std::remainder(angle[i] - angle[i - 1], kTwoPi);
  return sum;
}

/// Gain of the observer at a frequency.
double gain_of(const ChatterLineConfig& c, double frequency_hz) {
  double gain = 1;
  for (const double cutoff : {c.disturbance_cutoff_rad_s, c.velocity_cutoff_rad_s})
    if (cutoff > 0) gain /= std::hypot(1, kTwoPi * frequency_hz / cutoff);
  return gain;
}

}  // namespace

std::optional<ChatterLine> chatter_line(std::span<const double> torque_Nm,
                                        std::span<const double> angle_rad,
                                        const ChatterLineConfig& config) {
  const std::size_t n = torque_Nm.size();
  if (n != angle_rad.size() || n < kFewest || n < 8 * std::size_t{config.harmonics})
    return std::nullopt;
  for (std::size_t i = 0; i < n; ++i)
    if (!std::isfinite(torque_Nm[i]) || !std::isfinite(angle_rad[i])) return std::nullopt;
  const double span_s = static_cast<double>(n - 1) * config.sample_period_s;
  const double rotation_hz = std::abs(turned(angle_rad)) / kTwoPi / span_s;

  const Eigen::VectorXd rest = without_harmonics(torque_Nm, angle_rad, config.harmonics);
  std::vector<double> tapered(n);
  for (std::size_t i = 0; i < n; ++i)
    tapered[i] = rest[static_cast<Eigen::Index>(i)] *
                 (0.5 - 0.5 * std::cos(kTwoPi * static_cast<double>(i) / static_cast<double>(n)));
  std::vector<std::complex<double>> lines;
  Eigen::FFT<double> fft;
  fft.fwd(lines, tapered);
  const double spacing_hz = 1 / (static_cast<double>(n) * config.sample_period_s);

  // Of the peaks that stand out of the noise, the strongest as it was before the observer. Noise
  // must not be weighed so: it grows with frequency.
  const std::size_t last = n / 2 - 2;
  double mean = 0, strongest = 0;
  for (std::size_t k = 2; k <= last; ++k) {
    mean += std::norm(lines[k]) / static_cast<double>(last - 1);
    strongest = std::max(strongest, std::norm(lines[k]));
  }
  const double least = std::max(kStandsOut * mean, kOfStrongest * strongest);
  std::size_t top = 0;
  double highest = 0;
  for (std::size_t k = 2; k <= last; ++k) {
    const double power = std::norm(lines[k]);
    if (!(power > least) || power < std::norm(lines[k - 1]) || power < std::norm(lines[k + 1]))
      continue;
    const double size = std::sqrt(power) / gain_of(config, static_cast<double>(k) * spacing_hz);
    if (size > highest) {
      highest = size;
      top = k;
    }
  }
  if (top == 0) return std::nullopt;

  const double below = std::abs(lines[top - 1]), above = std::abs(lines[top + 1]);
  const double peak = std::abs(lines[top]);
  const double ratio = std::max(below, above) / peak;
  const double offset = (2 * ratio - 1) / (ratio + 1) * (above > below ? 1 : -1);

  ChatterLine line;
  line.seen_hz = (static_cast<double>(top) + offset) * spacing_hz;
  // A Hann window spreads a line at offset d with sinc(d) / (1 - d^2).
  const double x = kPi * offset;
  const double spread = (std::abs(x) < 1e-6 ? 1 : std::sin(x) / x) / (1 - offset * offset);
  line.amplitude_Nm = 4 * peak / (static_cast<double>(n) * spread);
  const double power = rest.squaredNorm() / static_cast<double>(n);
  line.share = power > 0 ? std::min(1.0, line.amplitude_Nm * line.amplitude_Nm / 2 / power) : 0;
  line.spindle_speed_rpm = 60 * rotation_hz;
  line.frequency_hz = line.seen_hz;

  // Which member of the comb lies nearest above a natural frequency? Chatter is stiffer than the
  // structure alone.
  double nearest = 0.25;  // of the natural frequency, at most
  const double tooth_hz = rotation_hz * (config.teeth > 0 ? config.teeth : 1);
  for (const double natural_hz : config.natural_frequencies_hz)
    for (int k = -kSidebands; k <= kSidebands; ++k) {
      const double member = std::abs(line.seen_hz + k * tooth_hz);
      const double off = std::abs(member / natural_hz - 1.02);
      if (off < nearest) {
        nearest = off;
        line.frequency_hz = member;
      }
    }
  return line;
}

std::vector<double> quiet_speeds_rpm(double frequency_hz, unsigned teeth, double from_rpm,
                                     double to_rpm) {
  std::vector<double> speeds;
  if (!(frequency_hz > 0) || teeth == 0 || !(from_rpm > 0)) return speeds;
  const double one_wave_rpm = 60 * frequency_hz / teeth;
  const auto fewest = std::max(1.0, std::ceil(one_wave_rpm / to_rpm));
  for (double k = std::floor(one_wave_rpm / from_rpm); k >= fewest; --k)
    speeds.push_back(one_wave_rpm / k);
  return speeds;
}

}  // namespace servosense
