// The way of the torque into the record: how late and how smooth a drive reports its current.
//
// Purpose: drives report the current through a filter of their own and at a rate of their own.
// What the filter takes away no monitor of the current sees, so its bandwidth is part of what is
// known of a machine. In the air the torque is known from the motion: J dw/dt and friction.
// Equation, on the reported effort u and the torque m of the motion, both through the observer:
//   u = H m + e,  H of mean delay d and variance v [s, s2]:
//   lag             1 / (1 + tau s) and a delay,       v = tau^2      -3 dB at 1 / (2 pi tau)
//   moving average  of a stretch L and a delay,        v = L^2 / 12   -3 dB at 0.443 / L
// The shape that leaves less is taken; where they leave the same, the one that shows less. At
// frequencies far below the cutoff, mean delay and variance are all that a record shows of any
// filter. Method: d and v by Gauss and Newton, inertia and friction anew in each step (Golub and
// Pereyra 1973); the errors are those of regress() (correlated residuals), with what the fit moves
// by at half the cutoff (Hausman 1978). Of several cutoffs the one with the smallest error is
// taken. Values that are held are heard through the mean of their stretch. Bad at: soft
// accelerations, which show the delay but not the variance (said); springs between motor and
// encoder, which delay the motion; a speed that is filtered as well: seen is the current against
// the motion.
#pragma once

#include <optional>
#include <string>

#include "servosense/identify/idle.hpp"

namespace servosense {

struct TorquePath {
  bool told = false;         ///< else the record shows nothing of it
  bool too_early = false;    ///< the current comes before the torque: nothing is told
  Estimate delay_s;          ///< of the current against the motion, filter included
  Estimate filter_hz;        ///< -3 dB of a first order lag with the same half; 0: none is seen
  bool averages = false;     ///< it is rather a moving average than a lag
  bool shape_told = true;    ///< else the slower of the two is stated
  double half_to_hz = 0;     ///< up to here the current shows half of a vibration, at least
  double update_hz = 0;      ///< rate of new values; 0: every sample
  bool stated_from = false;  ///< half_to_hz is a lower bound: nothing slower was seen
  [[nodiscard]] bool filtered() const noexcept { return filter_hz.value > 0; }
  /// What a reader has to know, without the name of the drive.
  [[nodiscard]] std::string sentence() const;
};

/// `base` gives cutoffs and effects, `found` what the record has shown of the drive.
[[nodiscard]] TorquePath identify_torque_path(const DisturbanceObserverConfig& base,
                                              const IdleIdentification& found,
                                              const DriveRecord& record);

/// Rate of the new values of the effort in motion [Hz]; 0 where every sample brings one.
[[nodiscard]] double effort_update_hz(const DriveRecord& record);

}  // namespace servosense
