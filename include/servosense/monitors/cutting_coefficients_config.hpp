// Configuration of the cutting coefficients monitor (cutting_coefficients.hpp).
#pragma once

#include <array>

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/monitors/cutting_turns.hpp"

namespace servosense {

/// Averages of a cut per unit of its coefficients (model/average_cutting.hpp), at its depth and
/// engagement; what goes with the chip, at a feed of 1 m per tooth. x is along the feed, forces are
/// on the tool.
struct CuttingShares {
  double torque_chip_m3 = 0, torque_edge_m2 = 0;
  double x_tangential_chip_m2 = 0, x_tangential_edge_m = 0;
  double x_radial_chip_m2 = 0, x_radial_edge_m = 0;
  double y_tangential_chip_m2 = 0, y_tangential_edge_m = 0;
  double y_radial_chip_m2 = 0, y_radial_edge_m = 0;
};

/// What is known before anything is cut, and its standard error.
struct ToldCoefficient {
  double value = 0;
  double error = 0;
};

struct CuttingCoefficientsConfig {
  CuttingTurnsConfig turns;
  CuttingShares shares;
  ToldCoefficient tangential;       ///< K_tc [N/m2]
  ToldCoefficient tangential_edge;  ///< K_te [N/m]
  ToldCoefficient radial;           ///< K_rc [N/m2]
  ToldCoefficient radial_edge;      ///< K_re [N/m]
  double feed_per_tooth_m = 0;      ///< usual, [m]
  /// Mean chip thickness at which the specific cutting force is stated [m]; 0: that of the usual
  /// feed in `shares`. Where programs differ in width or feed they must state it at one.
  double chip_m = 0;
  /// Standard error of the friction that the observers know.
  double torque_friction_error_Nm = 0;
  std::array<double, 2> force_friction_error_N{};
  double friction_memory_s = 1800;  ///< in which friction may change by its standard error
  double drift = 0.03;              ///< share by which a coefficient may wander in 1000 revolutions
  double smallest_change = 0.1;     ///< share of the specific cutting force that the test is for
  double false_change_slots = 1e7;  ///< from one false change to the next, at least
  unsigned teach_slots = 300;       ///< of cut: the reference for the force ratio
  double taught_N_per_m2 = 0;       ///< specific cutting force of a new tool; 0: teach
};

[[nodiscard]] inline Status validate(const CuttingShares& s) noexcept {
  const double all[] = {s.torque_chip_m3,       s.torque_edge_m2,      s.x_tangential_chip_m2,
                        s.x_tangential_edge_m,  s.x_radial_chip_m2,    s.x_radial_edge_m,
                        s.y_tangential_chip_m2, s.y_tangential_edge_m, s.y_radial_chip_m2,
                        s.y_radial_edge_m};
  for (const double share : all)
    if (!is_finite(share)) return Status::invalid("shares", "must be finite");
  if (!(s.torque_chip_m3 > 0 && s.torque_edge_m2 > 0))
    return Status::invalid("shares", "must be of a cut with depth and engagement");
  return {};
}

inline Status validate(const CuttingCoefficientsConfig& c) noexcept {
  if (const Status s = CuttingTurns<double>::validate(c.turns); !s.ok()) return s;
  if (const Status s = validate(c.shares); !s.ok()) return s;
  if (!(c.tangential.value > 0 && c.tangential.error > 0))
    return Status::invalid("tangential", "must be positive, and so its error");
  if (!(c.tangential_edge.error > 0 && c.radial.error > 0 && c.radial_edge.error > 0))
    return Status::invalid("error", "must be positive of every coefficient");
  if (!(c.feed_per_tooth_m > 0)) return Status::invalid("feed_per_tooth_m", "must be positive");
  if (!(c.chip_m >= 0 && c.chip_m < 1))
    return Status::invalid("chip_m", "must be zero (that of the usual feed) or below 1");
  if (!(c.torque_friction_error_Nm >= 0 && c.force_friction_error_N[0] >= 0 &&
        c.force_friction_error_N[1] >= 0))
    return Status::invalid("friction_error", "must not be negative");
  if (!(c.friction_memory_s > 0)) return Status::invalid("friction_memory_s", "must be positive");
  if (!(c.drift >= 0 && c.drift < 1)) return Status::invalid("drift", "must be within 0 and 1");
  if (!(c.smallest_change > 0 && c.smallest_change < 1))
    return Status::invalid("smallest_change", "must be within 0 and 1");
  if (!(c.false_change_slots > 1 && is_finite(c.false_change_slots)))
    return Status::invalid("false_change_slots", "must be above 1");
  if (c.teach_slots < 1) return Status::invalid("teach_slots", "must be at least 1");
  if (!(c.taught_N_per_m2 >= 0))
    return Status::invalid("taught_N_per_m2", "must be zero (teach) or positive");
  return {};
}

}  // namespace servosense
