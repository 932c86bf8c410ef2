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
// tooth to the next as long as every tooth cuts: the averages know none of them. With a size effect
// or a tooth that passes over its chip they are no longer linear, and this does not hold.
#pragma once

#include <cmath>

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

/// `teeth` >= 1, lengths >= 0 in metres, `engagement` with 0 <= start <= exit <= 2 pi.
[[nodiscard]] inline AverageCutting average_cutting(int teeth, double radius_m,
                                                    double axial_depth_m, double feed_per_tooth_m,
                                                    const Engagement& engagement) {
  const double start = engagement.start_rad, exit = engagement.exit_rad;
  const double arc = exit - start;
  const double sine = std::cos(start) - std::cos(exit);
  const double cosine = std::sin(exit) - std::sin(start);
  const double sine_sine = arc / 2 - (std::sin(2 * exit) - std::sin(2 * start)) / 4;
  const double sine_cosine = cosine * (std::sin(exit) + std::sin(start)) / 2;
  const double edge = teeth * axial_depth_m / kTwoPi;
  const double chip = edge * feed_per_tooth_m;
  AverageCutting average;
  average.torque = {radius_m * chip * sine, radius_m * edge * arc, 0, 0, 0, 0};
  average.x = {-chip * sine_cosine, -edge * cosine, -chip * sine_sine, -edge * sine, 0, 0};
  average.y = {chip * sine_sine, edge * sine, -chip * sine_cosine, -edge * cosine, 0, 0};
  average.z = {0, 0, 0, 0, chip * sine, edge * arc};
  return average;
}

}  // namespace servosense
