// What the golden files say, worked out without the blocks: closed forms of impulse responses,
// sums by definition, least squares with the whole covariance.
#pragma once

#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "configs.hpp"
#include "oracles/batch_variance.hpp"
#include "oracles/direct_dft.hpp"
#include "oracles/drive_plant.hpp"
#include "oracles/recursive_ar.hpp"
#include "table.hpp"

namespace golden {

using Sequence = std::vector<double>;
using Wide = long double;
inline const double kPi = std::acos(-1.0);

/// A number that float and the file hold exactly.
inline double exactly(double x) { return std::round(x * 4096) / 4096; }

/// 20 with a tone, a jump at 100 and a spike at 200: what a torque may do.
inline Sequence torque(std::size_t count) {
  Sequence x(count);
  for (std::size_t n = 0; n < count; ++n) {
    const auto t = static_cast<double>(n);
    x[n] = exactly(20 + 3 * std::sin(0.31 * t) + std::sin(1.7 * t + 1) + (n >= 100 ? 5 : 0) +
                   (n == 200 ? 25 : 0));
  }
  return x;
}

/// Sum of h(k) x(n-k).
template <typename Response>
Sequence convolved(const Sequence& x, Response&& h) {
  Sequence y(x.size());
  for (std::size_t n = 0; n < x.size(); ++n) {
    Wide sum = 0;
    for (std::size_t k = 0; k <= n; ++k) sum += h(static_cast<int>(k)) * Wide(x[n - k]);
    y[n] = static_cast<double>(sum);
  }
  return y;
}

/// g / (s + g) by the trapezoid rule: c (1 + q) / (1 - p q).
inline auto low_pass_response(double cutoff_rad_s) {
  const Wide half = Wide(cutoff_rad_s) * Wide(kPeriod_s) / 2;
  const Wide c = half / (1 + half), p = (1 - half) / (1 + half);
  return [c, p](int k) { return k == 0 ? c : c * (1 + p) * std::pow(p, Wide(k - 1)); };
}
/// s g / (s + g) by the trapezoid rule, of the changes of its input.
inline auto derivative_response(double cutoff_rad_s) {
  const Wide half = Wide(cutoff_rad_s) * Wide(kPeriod_s) / 2;
  const Wide p = (1 - half) / (1 + half);
  return [gain = Wide(cutoff_rad_s) / (1 + half), p](int k) { return gain * std::pow(p, Wide(k)); };
}
/// b over 1 + a1 q + a2 q^2, whose poles are a pair r exp(+-j angle).
inline auto pair_response(Wide b0, Wide b1, Wide b2, Wide a1, Wide a2) {
  const Wide r = std::sqrt(a2), angle = std::acos(-a1 / (2 * r));
  auto all_pole = [r, angle](int k) {
    return k < 0 ? 0 : std::pow(r, Wide(k)) * std::sin(Wide(k + 1) * angle) / std::sin(angle);
  };
  return [=](int k) { return b0 * all_pole(k) + b1 * all_pole(k - 1) + b2 * all_pole(k - 2); };
}

/// Columns of one length, the inputs first.
inline Table table(std::vector<std::string> names, std::vector<double> tolerances,
                   const std::vector<Sequence>& columns) {
  Table t{std::move(names), std::move(tolerances), {}};
  for (std::size_t n = 0; n < columns.front().size(); ++n) {
    t.rows.emplace_back();
    for (const Sequence& column : columns) t.rows.back().push_back(column[n]);
  }
  return t;
}

// Rounding of a value of 30 is 2e-6 in float; filters gather some of it.
inline Table low_pass() {
  const Sequence x = torque(300);
  const Wide gT = Wide(kEuler.cutoff_rad_s) * Wide(kPeriod_s), p = 1 / (1 + gT);
  return table({"x", "tustin", "backward_euler"}, {3e-5, 1e-5},
               {x, convolved(x, low_pass_response(kTustin.cutoff_rad_s)),
                convolved(x, [&](int k) { return gT * p * std::pow(p, Wide(k)); })});
}
// Rates reach 17000 / s, rounded in float by 1e-3 each.
inline Table pseudo_derivative() {
  Sequence increment = torque(300);
  for (double& x : increment) x = exactly((x - 20) / 16);
  const Wide gT = Wide(kEuler.cutoff_rad_s) * Wide(kPeriod_s), p = 1 / (1 + gT);
  return table({"increment", "tustin", "backward_euler"}, {4e-3, 4e-3},
               {increment, convolved(increment, derivative_response(kTustin.cutoff_rad_s)),
                convolved(increment, [&](int k) {
                  return Wide(kEuler.cutoff_rad_s) * p * std::pow(p, Wide(k));
                })});
}
inline Table biquad() {
  const Sequence x = torque(300);
  const Wide r = Wide(kPole);
  return table({"x", "y"}, {2e-4},
               {x, convolved(x, pair_response(0.25L, -0.25L, 0.5L,
                                              -2 * r * std::cos(Wide(kPoleAngle_rad)), r * r))});
}
// (s^2 + w^2) / (s^2 + s w / Q + w^2), s = w / tan(w T / 2) (1 - q) / (1 + q).
inline Table notch() {
  const Sequence x = torque(300);
  const Wide w = 2 * std::acos(-1.0L) * Wide(kNotch.frequency_hz);
  const Wide k = w / std::tan(w * Wide(kPeriod_s) / 2), d = w * k / Wide(kNotch.quality);
  const Wide a0 = k * k + d + w * w;
  const Wide middle = 2 * (w * w - k * k) / a0, edge = (k * k + w * w) / a0;
  return table(
      {"x", "y"}, {2e-4},
      {x, convolved(x, pair_response(edge, middle, edge, middle, (k * k - d + w * w) / a0))});
}

/// The newest up to `count` values ending with n.
inline Sequence newest(const Sequence& x, std::size_t n, std::size_t count) {
  const std::size_t from = n + 1 < count ? 0 : n + 1 - count;
  return {x.begin() + static_cast<std::ptrdiff_t>(from),
          x.begin() + static_cast<std::ptrdiff_t>(n + 1)};
}
inline Table moving_average() {
  const Sequence x = torque(300);
  Sequence mean(x.size());
  for (std::size_t n = 0; n < x.size(); ++n) mean[n] = oracle::batch(newest(x, n, kAverage)).mean;
  return table({"x", "mean"}, {1e-5}, {x, mean});
}
// The header of the block: 8 sqrt(N) u (variance + d^2), d = 40.
inline Table moving_variance() {
  const Sequence x = torque(300);
  Sequence mean(x.size()), variance(x.size());
  for (std::size_t n = 0; n < x.size(); ++n) {
    const oracle::Batch b = oracle::batch(newest(x, n, kWindow));
    mean[n] = b.mean, variance[n] = b.variance;
  }
  return table({"x", "variance", "mean"}, {6e-3, 1e-4}, {x, variance, mean});
}

/// Angle of a spindle that speeds up, within [0, 2 pi].
inline Sequence angles(std::size_t count) {
  Sequence angle(count);
  for (std::size_t n = 0; n < count; ++n) {
    const auto t = static_cast<double>(n);
    angle[n] = exactly(std::fmod(0.5 + 0.2 * t + 1e-4 * t * t, 2 * kPi));
  }
  return angle;
}
// The header of the block: 1e-6 N max|x| a line.
inline Table moving_fourier() {
  const Sequence x = torque(300), angle = angles(300);
  std::vector<Sequence> columns{x, angle};
  for (int h = 1; h <= static_cast<int>(kHarmonics); h += 2) {
    Sequence cosine(x.size()), sine(x.size());
    for (std::size_t n = 0; n < x.size(); ++n) {
      const auto line = oracle::direct_line(newest(x, n, kWindow), newest(angle, n, kWindow), h);
      cosine[n] = line.real(), sine[n] = -line.imag();
    }
    columns.push_back(cosine);
    columns.push_back(sine);
  }
  return table({"x", "angle_rad", "cosine_1", "sine_1", "cosine_3", "sine_3"},
               {3e-3, 3e-3, 3e-3, 3e-3}, columns);
}
// A vector x + jy that turns clockwise goes as exp(-j angle): turned on to the newest angle, times
// a Hann window. The header of the block: N u / 2 of the largest, 51.
inline Table rotational_filter() {
  const Sequence angle = angles(300);
  Sequence x(300), y(300), sx(300), sy(300), radius(300);
  for (std::size_t n = 0; n < 300; ++n) {
    const auto t = static_cast<double>(n);
    x[n] = exactly(10 + 8 * std::cos(angle[n] + 0.5) + 3 * std::sin(0.9 * t));
    y[n] = exactly(5 - 8 * std::sin(angle[n] + 0.5) + 4 * std::sin(angle[n]) + (n > 150 ? 20 : 0));
    std::complex<Wide> sum = 0;
    for (std::size_t k = 0; k < kWindow && k <= n; ++k) {
      const Wide half = std::sin(Wide(kPi) * (Wide(k) + 0.5L) / Wide(kWindow));
      sum += half * half * std::complex<Wide>(Wide(x[n - k]), Wide(y[n - k])) *
             std::polar(1.0L, Wide(angle[n - k]) - Wide(angle[n]));
    }
    sum *= 2.0L / Wide(kWindow);  // sin^2 over whole periods is a half each
    sx[n] = static_cast<double>(sum.real());
    sy[n] = static_cast<double>(sum.imag());
    radius[n] = static_cast<double>(std::abs(sum));
  }
  return table({"x", "y", "angle_rad", "turning_x", "turning_y", "radius"}, {1e-4, 1e-4, 1e-4},
               {x, y, angle, sx, sy, radius});
}
// 1e-5 of the signal's size.
inline Table lattice_ar() {
  Sequence z = torque(300), residual(300);
  for (double& value : z) value = exactly((value - 20) / 4);
  oracle::CovarianceAr<double> model(static_cast<int>(kLattice.order), kLattice.noise_variance);
  for (std::size_t n = 0; n < z.size(); ++n) residual[n] = model.process(z[n]);
  return table({"z", "residual"}, {1e-4}, {z, residual});
}
// 20 values of rounding, 1.2e-6 of the ratio.
inline Table moving_threshold() {
  Sequence x = torque(300), ratio(300);
  for (double& value : x) value = exactly((value - 22) / 4);
  const std::size_t n = kThreshold.window, q = kThreshold.judged;
  for (std::size_t k = n + q - 1; k < x.size(); ++k) {
    Wide judged = 0, before = 0;
    for (std::size_t i = 0; i < q; ++i) judged += Wide(x[k - i]) * Wide(x[k - i]);
    for (std::size_t i = q; i < q + n; ++i) before += Wide(x[k - i]) * Wide(x[k - i]);
    ratio[k] = static_cast<double>(
        judged / (before / Wide(n) + Wide(kThreshold.floor) * Wide(kThreshold.floor)));
  }
  return table({"x", "ratio_squared"}, {1e-4}, {x, ratio});
}

// The mean over a part of the turn, from the integral of the signal drawn straight from sample to
// sample. A part is known with the first sample beyond its end. Error in float: 2e-7 N of 30.
inline Table angle_sampler() {
  const Sequence x = torque(300), angle = angles(300);
  Sequence index(300), mean(300), turned(300), integral(300);
  double turns = 0;
  for (std::size_t n = 0; n < x.size(); ++n) {
    if (n > 0 && angle[n] < angle[n - 1]) turns += 2 * kPi;
    turned[n] = angle[n] + turns - kSampler.origin_rad;
    if (n > 0) integral[n] = integral[n - 1] + (turned[n] - turned[n - 1]) * (x[n] + x[n - 1]) / 2;
  }
  const double part = 2 * kPi / kSampler.samples_per_turn;
  auto up_to = [&](double to) {
    const auto k = static_cast<std::size_t>(std::lower_bound(turned.begin(), turned.end(), to) -
                                            turned.begin());
    const double way = to - turned[k - 1], slope = (x[k] - x[k - 1]) / (turned[k] - turned[k - 1]);
    return integral[k - 1] + way * (x[k - 1] + slope * way / 2);
  };
  const double first = std::ceil(turned[0] / part);
  for (std::size_t n = 0; n < x.size(); ++n) {
    const double last = std::floor(turned[n] / part);
    if (last <= first) continue;
    index[n] = std::fmod(last - 1, kSampler.samples_per_turn);
    mean[n] = (up_to(last * part) - up_to((last - 1) * part)) / part;
  }
  return table({"x", "angle_rad", "index", "mean"}, {1e-9, 1e-4}, {x, angle, index, mean});
}

// M x'' + D x' + C sign + L = E - F: what E leaves, and the motion, through the law of the
// observer:
//   g/(s+g) { h/(s+h) (E - C sign - L) - (D + J s) s h/(s+h) x }
// At rest until sample 20, so that every filter begins at nothing. Header of the block: 2u (E + g J
// v) / (g T) = 2e-2 at most.
inline Table disturbance_observer() {
  const DisturbanceObserverConfig c = observer();
  const DriveModelConfig& d = c.drive;
  Sequence increment_um(400), effort(400), drive(400), increment_m(400);
  oracle::Bristle bristle;
  bristle.knee = d.friction_knee;
  for (std::size_t n = 0; n < 400; ++n) {
    const auto t = static_cast<double>(n) - 20;
    // Increments that float holds: micrometres over 4096, to and fro.
    increment_um[n] = t < 0 ? 0
                            : exactly(12 * std::sin(0.02 * t) * std::sin(0.02 * t) *
                                      (std::sin(0.02 * t) < 0 ? -1 : 1));
    increment_m[n] = static_cast<double>(static_cast<float>(increment_um[n] * 1e-6));
    effort[n] = t < 0 ? d.constant_load
                      : exactly(d.constant_load + 90 * std::sin(0.02 * t) + 60 * std::sin(0.1 * t) +
                                (n > 250 ? 200 : 0));
    drive[n] = effort[n] - d.constant_load - d.coulomb * bristle.follow(increment_m[n]);
  }
  const Sequence speed = convolved(increment_m, derivative_response(c.velocity_cutoff_rad_s));
  Sequence change(speed), resisted(speed);
  for (std::size_t n = 1; n < speed.size(); ++n) change[n] = speed[n] - speed[n - 1];
  const Sequence left = convolved(drive, low_pass_response(c.velocity_cutoff_rad_s));
  for (std::size_t n = 0; n < speed.size(); ++n) resisted[n] = left[n] - d.viscous * speed[n];
  Sequence estimate = convolved(resisted, low_pass_response(c.disturbance_cutoff_rad_s));
  const Sequence inertial = convolved(change, derivative_response(c.disturbance_cutoff_rad_s));
  for (std::size_t n = 0; n < speed.size(); ++n) estimate[n] -= d.inertia * inertial[n];
  return table({"increment_um", "effort_N", "estimate_N"}, {2e-2},
               {increment_um, effort, estimate});
}

/// Every golden file.
inline const std::map<std::string, std::function<Table()>>& oracles() {
  static const std::map<std::string, std::function<Table()>> all{
      {"low_pass", low_pass},
      {"pseudo_derivative", pseudo_derivative},
      {"biquad", biquad},
      {"notch", notch},
      {"moving_average", moving_average},
      {"moving_variance", moving_variance},
      {"moving_fourier", moving_fourier},
      {"rotational_filter", rotational_filter},
      {"lattice_ar", lattice_ar},
      {"moving_threshold", moving_threshold},
      {"angle_sampler", angle_sampler},
      {"disturbance_observer", disturbance_observer},
  };
  return all;
}

}  // namespace golden
