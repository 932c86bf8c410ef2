#include "stable_speeds_mode.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <set>

#include "servosense/core/units.hpp"

namespace servosense {
namespace {

using Complex = std::complex<double>;

constexpr double kLeastDamping = 0.005;  // no holder damps its tool less; it comes out high

/// Frequency over natural frequency where w^2 - wn^2 = 2 zeta wn w `detuning`.
double frequency_ratio(double damping, double detuning) {
  const double x = damping * detuning;
  return x + std::sqrt(1 + x * x);
}

/// Least squares of the sine of the phase error; frequencies in units of `scale_hz`. `older` is the
/// share of the wave under each tooth that the last tooth but one left.
std::optional<ChatterMode> fit(const std::vector<ToothChatter>& chatter,
                               const std::vector<double>& waves, const std::vector<double>& older,
                               double scale_hz) {
  const double unit = kTwoPi * scale_hz;
  double a = 0.04, b = 1;  // 2 zeta wn, wn^2
  std::vector<double> error(chatter.size());
  for (int pass = 0; pass < 8; ++pass) {
    double aa = 0, ab = 0, bb = 0, ay = 0, by = 0;
    for (std::size_t i = 0; i < chatter.size(); ++i) {
      const ToothChatter& c = chatter[i];
      const Complex s = Complex(c.growth, kTwoPi * (waves[i] + c.fraction)) / (c.period_s * unit);
      // The wave left by the tooth before counts from half a period ago.
      const Complex back = std::polar(std::exp(-c.growth), -kTwoPi * (c.fraction - c.fraction_lag));
      const Complex chip = std::conj(1.0 - back * (1 - older[i] + older[i] * back));
      const double weight = 1 / (std::abs(s * s + a * s + b) * std::abs(chip));
      if (!std::isfinite(weight)) return std::nullopt;
      const double x = weight * (s * chip).imag(), y = weight * chip.imag();
      const double z = -weight * (s * s * chip).imag();
      aa += x * x, ab += x * y, bb += y * y, ay += x * z, by += y * z;
      error[i] = std::abs(a * x + b * y - z);
    }
    const double determinant = aa * bb - ab * ab;
    if (!(determinant > 1e-12 * aa * bb)) return std::nullopt;
    a = (ay * bb - by * ab) / determinant;
    b = (by * aa - ay * ab) / determinant;
    if (!(a > 0) || !(b > 0)) return std::nullopt;
  }
  const auto middle = error.begin() + static_cast<std::ptrdiff_t>(error.size() / 2);
  std::nth_element(error.begin(), middle, error.end());
  ChatterMode mode;
  mode.frequency_hz = scale_hz * std::sqrt(b);
  mode.damping = a / (2 * std::sqrt(b));
  mode.phase_error_rad = std::asin(std::min(1.0, *middle));
  return mode;
}

double strongest_power(const std::vector<ToothChatter>& chatter) {
  std::vector<double> power;
  for (const ToothChatter& c : chatter) power.push_back(c.power_Nm2);
  std::sort(power.begin(), power.end());
  return power[power.size() * 95 / 100];
}

}  // namespace

double chatter_frequency(const ChatterMode& mode, double fraction) {
  const double slope = 1 / std::tan(kPi * (fraction - 0.5));
  return mode.frequency_hz * frequency_ratio(mode.damping, std::clamp(slope, -5.0, 5.0));
}

double waves_of(const ToothChatter& c, double frequency_hz) {
  return std::max(0.0, std::round(frequency_hz * c.period_s - c.fraction));
}

std::optional<ChatterMode> fit_from(const std::vector<ToothChatter>& chatter,
                                    const ChatterMode& guess, double older_share) {
  std::vector<double> waves(chatter.size()), older(chatter.size());
  const double strongest = strongest_power(chatter);
  for (std::size_t i = 0; i < chatter.size(); ++i) {
    waves[i] = waves_of(chatter[i], chatter_frequency(guess, chatter[i].fraction));
    older[i] = older_share * std::sqrt(std::min(1.0, chatter[i].power_Nm2 / strongest));
  }
  std::optional<ChatterMode> mode;
  for (int pass = 0; pass < 6; ++pass) {
    mode = fit(chatter, waves, older, guess.frequency_hz);
    // Chatter of one mode stays within a tenth or so of it.
    if (!mode || mode->damping > 0.2 || mode->damping < kLeastDamping) return std::nullopt;
    bool same = true;
    for (std::size_t i = 0; i < chatter.size(); ++i) {
      const double w = waves_of(chatter[i], chatter_frequency(*mode, chatter[i].fraction));
      same = same && w == waves[i];
      waves[i] = w;
    }
    if (same) break;
  }
  mode->older_share = older_share;
  std::vector<double> distance;
  for (const ToothChatter& c : chatter) {
    const double w = chatter_frequency(*mode, c.fraction) * c.period_s - c.fraction;
    distance.push_back(std::abs(w - std::round(w)));
  }
  const auto middle = distance.begin() + static_cast<std::ptrdiff_t>(distance.size() / 2);
  std::nth_element(distance.begin(), middle, distance.end());
  // A wrong lobe number shows in both: half the frequency leaves whole waves too, but not the
  // phase, and a high one the phase, but not whole waves.
  mode->misfit = std::sqrt(*middle * mode->phase_error_rad);
  // One lobe alone does not tell its number. Twice the frequency finds chatter in every other lobe.
  std::set<double> lobes;
  for (const double w : waves)
    if (static_cast<double>(std::count(waves.begin(), waves.end(), w)) >
        0.05 * static_cast<double>(waves.size()))
      lobes.insert(w);
  if (lobes.size() < 2) return std::nullopt;
  const bool gaps = *lobes.rbegin() - *lobes.begin() >= static_cast<double>(lobes.size());
  return gaps ? std::nullopt : mode;
}

std::vector<ChatterMode> search_modes(const std::vector<ToothChatter>& chatter, double highest_hz) {
  double rate = 0;
  for (const ToothChatter& c : chatter) rate += 1 / c.period_s;
  rate /= static_cast<double>(chatter.size());
  std::vector<ChatterMode> found;
  for (double guess = rate; guess < highest_hz; guess += rate / 4)
    if (auto mode = fit_from(chatter, {.frequency_hz = guess})) found.push_back(*mode);
  return found;
}

std::vector<ToothChatter> strong(const std::vector<ToothChatter>& chatter) {
  if (chatter.empty()) return {};
  const double strongest = strongest_power(chatter);
  std::vector<ToothChatter> result;
  for (const ToothChatter& c : chatter)
    if (c.power_Nm2 > 0.05 * strongest) result.push_back(c);
  return result;
}

double single_mode_pocket_rpm(double natural_frequency_hz, double damping_ratio, int teeth,
                              int waves, bool above) {
  const double sign = above ? 1 : -1;
  auto ratio = [&](double x) { return frequency_ratio(damping_ratio, sign * x); };
  auto real_part = [&](double x) { return x / ((1 + x * x) * ratio(x)); };  // of lambda, but scale
  auto root = [](double low, double high, auto&& rising) {
    for (int i = 0; i < 100; ++i) {
      const double middle = (low + high) / 2;
      (rising(middle) < 0 ? low : high) = middle;
    }
    return (low + high) / 2;
  };
  // From the detuning of the chatter near the natural frequency to that of the other lobe, and to
  // the natural periods per tooth passing at which both come to the same limit.
  auto periods = [&](double near) {
    const double far = root(1, 3 / near, [&](double x) { return real_part(near) - real_part(x); });
    return (1 - (std::atan(1 / near) - std::atan(1 / far)) / kPi) /
           std::abs(ratio(far) - ratio(near));
  };
  const double near = root(1e-6, 1 - 2 * damping_ratio, [&](double x) {
    return periods(x) * ratio(x) + sign * std::atan(x) / kPi - waves;
  });
  return 60 * natural_frequency_hz / (teeth * periods(near));
}

}  // namespace servosense
