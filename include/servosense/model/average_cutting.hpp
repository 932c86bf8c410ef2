// Torque and forces of a milling cut averaged over a revolution, for any engagement.
//
// Law (Dunwoody 2010, eq. 2.1 and 3.13 to 3.19): dFt = (Ktc h + Kte) dz, dFr = (Krc h + Kre) dz,
// dFa = (Kac h + Kae) dz with h = s sin(phi) inside the engagement, nothing outside. The averages
// are linear in the six coefficients:
//   torque = R m [Ktc s S + Kte A]          m = N a / 2 pi, R the radius
//   fx     = -m [Ktc s SC + Kte C + Krc s SS + Kre S]
//   fy     =  m [Ktc s SS + Kte S - Krc s SC - Kre C]
//   fz     =  m [Kac s S + Kae A]
// with A, S, C, SS, SC the integrals of 1, sin, cos, sin^2 and sin cos over the engagement. Eq.
// 3.19 is the slot: S = 2, A = pi. Frame and sign: model/milling.hpp, forces on the tool.
//
// Helix and pitch only move forces within the revolution, and run-out only moves chip from one
// tooth to the next: what all teeth take of it at one angle stays N s sin(phi). But a tooth that
// passes over its chip has no edge force either: tooth j, thrown out by t_j, meets a chip where
//   sin(phi) > max_k (t_{j-k} - t_j) / (k s)      k = 1 ... N - 1 (Kline and DeVor 1983)
// so with throws A, S and C are over that part of the engagement, a mean over the teeth. Those
// alone then depend on the feed. With a size effect the averages are not linear, and this does not
// hold.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

#include "servosense/core/units.hpp"
#include "servosense/model/milling.hpp"

namespace servosense {

/// Average of a force or torque per unit of the coefficients that it depends on. A force per
/// N/m^2 is in m^2, one per N/m in m; torques have another metre.
struct AverageShare {
  double tangential = 0, tangential_edge = 0;
  double radial = 0, radial_edge = 0;
  double axial = 0, axial_edge = 0;
};

struct AverageCutting {
  AverageShare torque;  ///< against the rotation
  AverageShare x, y;    ///< on the tool, x along the feed
  AverageShare z;       ///< along the tool, positive as the axial coefficients are
};

/// Sine of the angle from which on tooth `j` meets a chip; 0 for one thrown out as far as any, 1
/// and more for one that cuts nowhere.
[[nodiscard]] inline double least_sine(std::span<const double> throw_m, std::size_t j,
                                       double feed_per_tooth_m) {
  double least = 0;
  for (std::size_t k = 1, n = throw_m.size(); k < n; ++k)
    if (const double behind = throw_m[(j + n - k) % n] - throw_m[j]; behind > 0)
      least = std::max(least, behind / (static_cast<double>(k) * feed_per_tooth_m));
  return least;
}

/// `teeth` >= 1, lengths >= 0 in metres, `engagement` with 0 <= start <= exit <= pi where there is
/// run-out, else 2 pi. `throw_m`: of each tooth, or none.
[[nodiscard]] inline AverageCutting average_cutting(int teeth, double radius_m,
                                                    double axial_depth_m, double feed_per_tooth_m,
                                                    const Engagement& engagement,
                                                    std::span<const double> throw_m = {}) {
  const double start = engagement.start_rad, exit = engagement.exit_rad;
  const double sine = std::cos(start) - std::cos(exit);
  const double cosine = std::sin(exit) - std::sin(start);
  const double sine_sine = (exit - start) / 2 - (std::sin(2 * exit) - std::sin(2 * start)) / 4;
  const double sine_cosine = cosine * (std::sin(exit) + std::sin(start)) / 2;
  struct {
    double arc = 0, sine = 0, cosine = 0;
  } rubs;  // integrals where the edges do
  const auto add = [&](double from, double to, double share) {
    rubs.arc += share * (to - from);
    rubs.sine += share * (std::cos(from) - std::cos(to));
    rubs.cosine += share * (std::sin(to) - std::sin(from));
  };
  if (throw_m.empty()) add(start, exit, 1);
  for (std::size_t j = 0; j < throw_m.size(); ++j) {
    const double least = least_sine(throw_m, j, feed_per_tooth_m);
    const double in = least > 0 ? std::asin(std::min(1.0, least)) : 0;
    const double from = std::max(start, in), to = least > 0 ? std::min(exit, kPi - in) : exit;
    if (to > from) add(from, to, 1 / static_cast<double>(throw_m.size()));
  }
  const double edge = teeth * axial_depth_m / kTwoPi;
  const double chip = edge * feed_per_tooth_m;
  AverageCutting average;
  average.torque = {radius_m * chip * sine, radius_m * edge * rubs.arc, 0, 0, 0, 0};
  average.x = {
      -chip * sine_cosine, -edge * rubs.cosine, -chip * sine_sine, -edge * rubs.sine, 0, 0};
  average.y = {chip * sine_sine, edge * rubs.sine, -chip * sine_cosine, -edge * rubs.cosine, 0, 0};
  average.z = {0, 0, 0, 0, chip * sine, edge * rubs.arc};
  return average;
}

}  // namespace servosense
