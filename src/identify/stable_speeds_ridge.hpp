// Chatter of one cut, tooth by tooth: what stable_speeds.cpp fits its mode to.
#pragma once

#include <vector>

#include "servosense/identify/stable_speeds.hpp"

namespace servosense {

/// Chatter must stand out during this share of the ramp, or its lobes are not seen.
inline constexpr double kChatteringShare = 0.3;

/// Chatter about one tooth: from tooth to tooth it is multiplied by exp(growth + 2 pi j fraction).
struct ToothChatter {
  double period_s = 0;      ///< of tooth passing
  double fraction = 0;      ///< u, 0..1
  double fraction_lag = 0;  ///< by how much u was smaller half a tooth earlier
  double growth = 0;        ///< g, per tooth
  double power_Nm2 = 0;
};

struct ChatterOfCut {
  double rate_rpm_per_s = 0;  ///< of the ramp, negative when it slows down
  double slowest_rpm = 0, fastest_rpm = 0;
  double teeth = 0;          ///< passed in the ramp
  double share = 0;          ///< of them at which chatter stands out
  bool leaves_work = false;  ///< chatter is as high as the cut where it is strongest
  bool above = true;         ///< u falls when the spindle speeds up and lies above one half
  std::vector<ToothChatter> chatter;
  ChatterRidge ridge;
  std::vector<double> ridge_fraction;  ///< u of each frame of the ridge
  std::vector<PowerMinimum> minima;
};

[[nodiscard]] Expected<ChatterOfCut> chatter_of(const CuttingTorqueTrace& cut,
                                                const StableSpeedOptions& options);

}  // namespace servosense
