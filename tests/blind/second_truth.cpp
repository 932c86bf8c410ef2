#include "second_truth.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace blind::second {
namespace {

constexpr double kBandHz = 80;
/// Timing that a machine without a hidden effect may be off by: a current loop of 300 Hz.
constexpr double kTiming_s = 6e-4;

Signal thinned(const Signal& x, std::size_t every) {
  Signal y;
  for (std::size_t i = 0; i < x.size(); i += every) y.push_back(x[i]);
  return y;
}

/// x at `ahead` rows later, by a cubic through four rows.
Signal shifted(const Signal& x, double ahead) {
  const auto n = static_cast<std::ptrdiff_t>(x.size());
  const auto at = [&](std::ptrdiff_t i) {
    return x[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(i, 0, n - 1))];
  };
  const double whole = std::floor(ahead), f = ahead - whole;
  Signal y(x.size());
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const std::ptrdiff_t j = i + static_cast<std::ptrdiff_t>(whole);
    const double a = at(j - 1), b = at(j), c = at(j + 1), d = at(j + 2);
    y[static_cast<std::size_t>(i)] =
        b + 0.5 * f * (c - a + f * (2 * a - 5 * b + 4 * c - d + f * (3 * (b - c) + d - a)));
  }
  return y;
}

}  // namespace

Gaps refitted(const Record& r, const Baseline& b) {
  const auto every =
      std::max<std::size_t>(1, static_cast<std::size_t>(std::floor(b.rate_hz / 500)));
  const auto band = [&](const Signal& x) { return low_pass(x, b.rate_hz, kBandHz); };
  const Signal q = band(r.position);
  const Signal v = derivative(q, b.rate_hz), a = derivative(v, b.rate_hz);
  const Signal u = band(r.effort);
  // The knee is smaller than what the band keeps of the position.
  const Signal fine = low_pass(r.position, b.rate_hz, std::min(300.0, b.rate_hz / 5));

  std::vector<Signal> signs;
  if (b.coulomb)
    for (const double knee : {0.3, 0.7, 1.5, 3.0, 6.0, 10.0}) {
      signs.push_back(thinned(band(soft_sign(fine, knee * b.small)), every));
      signs.push_back(thinned(band(fading_sign(fine, knee * b.small)), every));
    }
  else
    signs.emplace_back();
  const Signal a_thin = thinned(a, every), v_thin = thinned(v, every);
  // Ends of filters and of the run-in are nobody's.
  const auto edge = static_cast<std::size_t>(0.05 * b.rate_hz) / every;
  const std::size_t held = b.held_out / every, end = a_thin.size() - edge;
  Gaps best{1e300, 1e300};
  for (int step = -6; step <= 6; ++step) {
    const Signal target = thinned(shifted(u, kTiming_s * step / 6 * b.rate_hz), every);
    for (const Signal& s : signs) {
      std::vector<Signal> columns{a_thin};
      if (b.viscous) columns.push_back(v_thin);
      if (!s.empty()) columns.push_back(s);
      const Fit fit = least_squares(columns, target, edge, held);
      const double left = rms(fit.residual, edge, held);
      if (left < best.learnt) best = {left, rms(fit.residual, held, end)};
    }
  }
  return best;
}

double noise_floor(const Record& r, const Baseline& b) {
  const Signal seen = low_pass(r.position_error, b.rate_hz, kBandHz);
  const Signal rate = derivative(derivative(seen, b.rate_hz), b.rate_hz);
  Signal all = low_pass(r.effort_error, b.rate_hz, kBandHz);
  for (std::size_t i = 0; i < all.size(); ++i) all[i] -= b.inertia * rate[i];
  const auto edge = static_cast<std::size_t>(0.05 * b.rate_hz);
  return rms(all, edge, std::min(b.held_out, all.size() - edge));
}

}  // namespace blind::second
