// What a milling cut is made of: the tool, its cutting-force law, and the engagement.
//
// Frame (Tarng 1988, eq. 3-2 to 3-8): the cutter feeds toward +x, the tooth tip is at
// R (sin phi, cos phi), phi grows in the sense of cutting, chip thickness of a circular path is
// h = s sin(phi). Up milling engages phi in [0, swept], down milling [pi - swept, pi], a slot [0,
// pi].
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "servosense/core/units.hpp"

namespace servosense {

/// Tangential, radial and axial force of an edge element of length dz at chip thickness h:
///   dFt = (Kt h (h/h0)^-m + Kte) dz,  dFr = (c Kt h (h/h0)^-m + Kre) dz,
///   dFa = (Ka h (h/h0)^-m + Kae) dz
struct CuttingForceLaw {
  double tangential_coefficient_N_per_m2 = 0;
  double radial_ratio = 0;  ///< c = Kr/Kt
  double tangential_edge_N_per_m = 0;
  double radial_edge_N_per_m = 0;
  double size_effect_exponent = 0;        ///< m, 0 = force proportional to chip thickness
  double size_effect_reference_m = 1e-4;  ///< h0
  double process_damping_N_per_m = 0;     ///< Cp: dFr += Cp dz * (normal speed) / (cutting speed)
  double axial_coefficient_N_per_m2 = 0;  ///< Ka, 0 with Kae: no axial force is known
  double axial_edge_N_per_m = 0;          ///< Kae

  [[nodiscard]] bool has_axial() const {
    return axial_coefficient_N_per_m2 != 0 || axial_edge_N_per_m != 0;
  }
};

struct MillingTool {
  double diameter_m = 0;
  int teeth = 0;
  double helix_deg = 0;
  CuttingForceLaw force;
  /// Radial throw of each tooth [m]; empty means none. Size `teeth` otherwise.
  std::vector<double> throw_m;
  /// Fraction of each tooth's edge that is broken away, 0 intact, 1 gone; empty means none.
  std::vector<double> broken_fraction;
  /// Angle of each tooth ahead of tooth 1 [rad]; empty means equal pitch.
  std::vector<double> tooth_angle_rad;

  [[nodiscard]] double radius_m() const { return diameter_m / 2; }
};

/// A tool axis that runs out by `offset_m` toward `angle_rad`, counted from tooth 1 in the sense of
/// cutting, throws each tooth out or in.
inline void add_offset(MillingTool& tool, double offset_m, double angle_rad) {
  if (offset_m == 0) return;
  const auto teeth = static_cast<std::size_t>(tool.teeth);
  tool.throw_m.resize(teeth, 0.0);
  for (std::size_t i = 0; i < teeth; ++i) {
    const double at = tool.tooth_angle_rad.empty()
                          ? kTwoPi * static_cast<double>(i) / static_cast<double>(teeth)
                          : tool.tooth_angle_rad[i];
    tool.throw_m[i] += offset_m * std::cos(at - angle_rad);
  }
}

enum class MillingDirection { up, down, slot };

struct MillingCut {
  double spindle_speed_rpm = 0;
  double feed_per_tooth_m = 0;
  double axial_depth_m = 0;
  double radial_immersion_m = 0;  ///< width of cut a_e, 0..diameter
  MillingDirection direction = MillingDirection::down;
  /// The surface remembers the vibration of the teeth before; without, h = feed part + n.u(t) only:
  /// forced vibration.
  bool regeneration = true;
};

/// Range of tooth angle in which the tool is engaged [rad].
struct Engagement {
  double start_rad = 0;
  double exit_rad = 0;
  [[nodiscard]] double swept_rad() const { return exit_rad - start_rad; }
};

/// Engagement of a straight cut: swept angle arccos(1 - 2 a_e/D).
[[nodiscard]] inline Engagement engagement_of(const MillingTool& tool, const MillingCut& cut) {
  if (cut.direction == MillingDirection::slot) return {0, kPi};
  const double fraction = std::clamp(cut.radial_immersion_m / tool.diameter_m, 0.0, 1.0);
  const double swept = std::acos(1 - 2 * fraction);
  return cut.direction == MillingDirection::up ? Engagement{0, swept}
                                               : Engagement{kPi - swept, kPi};
}

}  // namespace servosense
