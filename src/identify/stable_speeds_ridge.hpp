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

/// What of the torque is looked at. Chatter shows in every sideband of the tooth passing, so the
/// lowest do where noise hides the others; a filter changes neither u nor g.
struct TorqueView {
  bool inertia_alone = false;  ///< the angle's own share, without the current
  double cutoff_hz = 0;        ///< of a low-pass; 0: none
};

/// Torque of the whole record in a view.
[[nodiscard]] std::vector<double> torque_in(const CuttingTorqueTrace& cut, const TorqueView& view);

struct ChatterOfCut {
  double rate_rpm_per_s = 0;  ///< of the ramp, negative when it slows down
  double slowest_rpm = 0, fastest_rpm = 0;
  double teeth = 0;          ///< passed in the ramp
  double share = 0;          ///< of them at which chatter stands out
  bool leaves_work = false;  ///< chatter is as high as the cut where it is strongest
  double mean_Nm = 0;
  double forced_Nm2 = 0;     ///< power of what repeats with the teeth
  double strongest_Nm2 = 0;  ///< of the chatter
  double noise_Nm2 = 0;      ///< mean square of the torque that is neither chatter nor repeats
  bool above = true;         ///< u falls when the spindle speeds up and lies above one half
  std::vector<ToothChatter> chatter;
  ChatterRidge ridge;
  std::vector<double> ridge_fraction;  ///< u of each frame of the ridge
  std::vector<PowerMinimum> minima;
};

/// Of one ramp in the cut.
[[nodiscard]] Expected<ChatterOfCut> chatter_of(const CuttingTorqueTrace& cut,
                                                const StableSpeedOptions& options,
                                                const TorqueView& view);

/// Data error for a ramp that is too short or too fast to show its lobes.
[[nodiscard]] Expected<Done> check_ramp(const CuttingTorqueTrace& ramp,
                                        const StableSpeedOptions& options);

/// Usage error for options, data error for torque and speed that cannot be used.
[[nodiscard]] Expected<Done> check_cut(const CuttingTorqueTrace& cut,
                                       const StableSpeedOptions& options);

}  // namespace servosense
