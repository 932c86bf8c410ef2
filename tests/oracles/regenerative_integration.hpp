// Growth of a small vibration in milling, by integrating the linear delay equation
//   m q'' + 2 zeta wn m q' + wn^2 m q = Kt a/2 A(t) [u(t) - u(t - T)]
// in time by Runge-Kutta of fourth order, layer by layer along the helix. It shares nothing with
// semi-discretisation but the equation.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace oracle {

struct Mode {
  double hz, damping, mass_kg;
  bool along_x;
};

struct RegenerativeCut {
  std::vector<Mode> modes;
  int teeth = 2;
  double diameter_m = 0.01, helix_rad = 0;
  double tangential_N_per_m2 = 0, radial_ratio = 0;
  double start_rad = 0, exit_rad = 3.141592653589793;
};

/// ln|mu| per tooth period, the mean over the later half of `periods`. Positive: chatter.
/// `vibration_hz`: by the zero crossings of the direction that swings more.
inline double growth_per_tooth(const RegenerativeCut& cut, double rpm, double depth_m,
                               int periods = 160, double steps_per_vibration = 30,
                               double* vibration_hz = nullptr) {
  const double pi = 3.141592653589793;
  const double period = 60 / (rpm * cut.teeth);
  double fastest = 0;
  for (const Mode& m : cut.modes) fastest = std::max(fastest, m.hz);
  const double share_in_cut = (cut.exit_rad - cut.start_rad) / (2 * pi) * cut.teeth;
  const auto steps = static_cast<std::size_t>(
      std::ceil(std::max({steps_per_vibration * fastest * period, 40.0, 40 / share_in_cut})));
  const std::size_t halves = 2 * steps;
  const double h = period / static_cast<double>(steps);

  // Directional coefficients at every half step, the mean over the depth. Between two half steps
  // the share of the time that a tooth is in the cut counts.
  struct Matrix {
    double xx = 0, xy = 0, yx = 0, yy = 0;
  };
  std::vector<Matrix> a(halves);
  const double lag = depth_m * std::tan(cut.helix_rad) / (cut.diameter_m / 2);
  const int layers = lag > 0 ? std::max(10, static_cast<int>(lag / 0.02)) : 1;
  constexpr int kWithin = 8;
  for (std::size_t i = 0; i < halves; ++i)
    for (int part = 0; part < kWithin; ++part)
      for (int layer = 0; layer < layers; ++layer)
        for (int tooth = 0; tooth < cut.teeth; ++tooth) {
          double phi = (static_cast<double>(i) + (part + 0.5) / kWithin - 0.5) /
                           static_cast<double>(halves) * 2 * pi / cut.teeth +
                       tooth * 2 * pi / cut.teeth - lag * (layer + 0.5) / layers;
          phi -= 2 * pi * std::floor(phi / (2 * pi));
          if (phi < cut.start_rad || phi > cut.exit_rad) continue;
          // Chip h = sin(phi) dx + cos(phi) dy; forces against it, as the tool feels them.
          const double s = std::sin(phi), c = std::cos(phi);
          const double fx = -c - cut.radial_ratio * s, fy = s - cut.radial_ratio * c;
          const double scale = cut.tangential_N_per_m2 * depth_m / (layers * kWithin);
          a[i].xx += scale * fx * s, a[i].xy += scale * fx * c;
          a[i].yx += scale * fy * s, a[i].yy += scale * fy * c;
        }

  const std::size_t n = cut.modes.size();
  std::vector<double> q(2 * n), rate(2 * n), at(2 * n), sum(2 * n);
  for (std::size_t i = 0; i < 2 * n; ++i)
    q[i] = 1e-6 * (i % 2 == 0 ? 1 : 3000) * (1 + 0.37 * static_cast<double>(i));
  std::vector<double> past(2 * (halves + 1), 0), now(2 * (halves + 1), 0);
  const auto tip = [&](const std::vector<double>& state, double* u) {
    u[0] = u[1] = 0;
    for (std::size_t m = 0; m < n; ++m) u[cut.modes[m].along_x ? 0 : 1] += state[2 * m];
  };
  const auto derivative = [&](const std::vector<double>& state, std::size_t half) {
    double u[2];
    tip(state, u);
    const Matrix& k = a[half % halves];
    const double dx = u[0] - past[2 * half], dy = u[1] - past[2 * half + 1];
    const double fx = k.xx * dx + k.xy * dy, fy = k.yx * dx + k.yy * dy;
    for (std::size_t m = 0; m < n; ++m) {
      const Mode& mode = cut.modes[m];
      const double w = 2 * pi * mode.hz;
      rate[2 * m] = state[2 * m + 1];
      rate[2 * m + 1] = (mode.along_x ? fx : fy) / mode.mass_kg -
                        2 * mode.damping * w * state[2 * m + 1] - w * w * state[2 * m];
    }
  };
  double log_size = 0, log_halfway = 0;
  int counted = 0;
  double swing[2] = {}, crossings[2] = {};
  for (int tooth = 0; tooth < periods; ++tooth) {
    tip(q, &now[0]);
    for (std::size_t step = 0; step < steps; ++step) {
      const std::size_t half = 2 * step;
      const std::vector<double> from = q;
      derivative(q, half);
      sum = rate;
      for (std::size_t i = 0; i < 2 * n; ++i) at[i] = from[i] + h / 2 * rate[i];
      derivative(at, half + 1);
      for (std::size_t i = 0; i < 2 * n; ++i) {
        sum[i] += 2 * rate[i];
        at[i] = from[i] + h / 2 * rate[i];
      }
      derivative(at, half + 1);
      for (std::size_t i = 0; i < 2 * n; ++i) {
        sum[i] += 2 * rate[i];
        at[i] = from[i] + h * rate[i];
      }
      derivative(at, half + 2);
      double before[2], middle[2], after[2], speed_before[2] = {}, speed_after[2] = {};
      tip(from, before);
      for (std::size_t i = 0; i < 2 * n; ++i) q[i] = from[i] + h / 6 * (sum[i] + rate[i]);
      tip(q, after);
      for (std::size_t m = 0; m < n; ++m) {
        speed_before[cut.modes[m].along_x ? 0 : 1] += from[2 * m + 1];
        speed_after[cut.modes[m].along_x ? 0 : 1] += q[2 * m + 1];
      }
      for (int d = 0; d < 2; ++d) {  // cubic Hermite
        middle[d] = 0.5 * (before[d] + after[d]) + h / 8 * (speed_before[d] - speed_after[d]);
        now[2 * (half + 1) + static_cast<std::size_t>(d)] = middle[d];
        now[2 * (half + 2) + static_cast<std::size_t>(d)] = after[d];
      }
    }
    // Scaled back to one, its logarithm kept. The size of a complex pair beats; the mean of the
    // second half and of the quarter before evens that out.
    double size = 0;
    for (std::size_t i = 0; i < now.size(); ++i) size += now[i] * now[i];
    for (std::size_t d = 0; d < 2 && tooth > 10; ++d)
      for (std::size_t i = 0; i < halves; ++i) {
        swing[d] += now[2 * i + d] * now[2 * i + d] / size;
        crossings[d] += (now[2 * i + d] < 0) != (now[2 * i + 2 + d] < 0);
      }
    if (tooth > 10 && vibration_hz)
      *vibration_hz = crossings[swing[1] > swing[0]] / (2 * period * (tooth - 10));
    size = std::sqrt(size);
    if (!(size > 1e-290)) return -10;
    for (double& x : now) x /= size;
    for (double& x : q) x /= size;
    log_size += std::log(size);
    past.swap(now);
    if (tooth == periods / 2) log_halfway = log_size;
    if (tooth > periods / 2) ++counted;
    if (tooth > 20 && log_size > 200) return log_size / tooth;
  }
  return (log_size - log_halfway) / counted;
}

}  // namespace oracle
