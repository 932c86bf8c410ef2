// Hammer tests of a structure of known modes: force pulses of closed form, the response of each
// mode to them as its equation has it, with what a measurement adds.
#pragma once

#include <algorithm>
#include <cmath>
#include <complex>
#include <random>
#include <vector>

#include "servosense/identify/impact.hpp"

namespace hammer_test {

constexpr double kTurn = 6.283185307179586;

struct Mode {
  double hz, damping, kg;
};

inline const std::vector<Mode> kTool = {{620, 0.03, 2.0}, {1450, 0.02, 0.6}};

/// Displacement over force at s.
inline std::complex<double> receptance(const std::vector<Mode>& modes, std::complex<double> s) {
  std::complex<double> g = 0;
  for (const Mode& m : modes) {
    const double w = kTurn * m.hz;
    g += 1.0 / (m.kg * (s * s + 2 * m.damping * w * s + w * w));
  }
  return g;
}

/// A blow: half a sine, or a whole raised cosine, whose spectrum falls faster.
struct Hit {
  double at_s, peak_N, width_s;
  bool raised = true;
};

inline double force_of(const Hit& h, double t) {
  const double u = (t - h.at_s) / h.width_s;
  if (u <= 0 || u >= 1) return 0;
  return h.peak_N * (h.raised ? 0.5 - 0.5 * std::cos(kTurn * u) : std::sin(kTurn / 2 * u));
}

/// Displacement, velocity and acceleration of a mode at rest on which exp(i w t) / kg begins to
/// act.
struct Motion {
  std::complex<double> x, v;
};
inline Motion begun(const Mode& m, double w, double t) {
  if (t <= 0) return {0, 0};
  const double own = kTurn * m.hz, decay = m.damping * own;
  const double ringing = own * std::sqrt(1 - m.damping * m.damping);
  const std::complex<double> i(0, 1);
  const std::complex<double> g = 1.0 / (m.kg * (own * own - w * w + 2.0 * i * m.damping * own * w));
  const std::complex<double> a = -g, b = -g * (decay + i * w) / ringing;
  const double e = std::exp(-decay * t), c = std::cos(ringing * t), s = std::sin(ringing * t);
  return {g * std::exp(i * w * t) + e * (a * c + b * s),
          i * w * g * std::exp(i * w * t) +
              e * ((ringing * b - decay * a) * c - (ringing * a + decay * b) * s)};
}

/// The response to a blow at t: displacement (0), velocity (1) or acceleration (2).
inline double response_to(const std::vector<Mode>& modes, const Hit& h, double t, int derivative) {
  double sum = 0;
  const double since = t - h.at_s, w = (h.raised ? 1.0 : 0.5) * kTurn / h.width_s;
  if (since <= 0) return 0;
  for (const Mode& m : modes) {
    double x = 0, v = 0;
    for (const double begin : {0.0, h.width_s}) {
      const Motion swung = begun(m, w, since - begin), pushed = begun(m, 0, since - begin);
      const double sign = h.raised && begin > 0 ? -1 : 1;
      x += sign * (h.raised ? 0.5 * (pushed.x.real() - swung.x.real()) : swung.x.imag());
      v += sign * (h.raised ? 0.5 * (pushed.v.real() - swung.v.real()) : swung.v.imag());
    }
    x *= h.peak_N, v *= h.peak_N;
    const double own = kTurn * m.hz;
    sum += derivative == 0   ? x
           : derivative == 1 ? v
                             : force_of(h, t) / m.kg - 2 * m.damping * own * v - own * own * x;
  }
  return sum;
}

/// What is between the structure and the record.
struct Bench {
  double rate_hz = 50000, duration_s = 0.2;
  int derivative = 0;
  double force_noise_N = 0, response_noise = 0;
  double force_offset_N = 0, response_offset = 0, response_drift_per_s = 0;
  double force_range_N = 0, response_range = 0;  ///< 0: unlimited
  double force_step_N = 0, response_step = 0;    ///< 0: none
};

inline double converted(double x, double range, double step) {
  if (range > 0) x = std::clamp(x, -range, range);
  return step > 0 ? step * std::round(x / step) : x;
}

inline servosense::ImpactRecord record(const std::vector<Mode>& modes, const std::vector<Hit>& hits,
                                       const Bench& b, std::mt19937_64& random) {
  servosense::ImpactRecord r{"hits.csv", b.rate_hz, 0, {}, {}};
  std::normal_distribution<double> normal;
  for (int i = 0; i < static_cast<int>(b.duration_s * b.rate_hz); ++i) {
    const double t = i / b.rate_hz;
    double f = b.force_offset_N + b.force_noise_N * normal(random);
    double x = b.response_offset + b.response_drift_per_s * t + b.response_noise * normal(random);
    for (const Hit& h : hits) {
      f += force_of(h, t);
      x += response_to(modes, h, t, b.derivative);
    }
    r.force_N.push_back(converted(f, b.force_range_N, b.force_step_N));
    r.response.push_back(converted(x, b.response_range, b.response_step));
  }
  return r;
}

}  // namespace hammer_test
