// Calibration of a spindle's load meter: volts per watt, and the friction that it sees.
//
// Dunwoody 2010, eq. 3.1 to 3.11: V = K w (Tc + b w + Tcf) for w >= 209 rad/s. Air (Tc = 0) at
// several speeds shows K b and K Tcf, cuts whose torque a dynamometer on the tool measures show K;
// all three by one weighted least squares of V/w. The constant comes out negative where a line is
// laid through a Stribeck curve (-0.0647 Nm in the work), and is kept so. Slower than 2000 rpm the
// line does not hold: what is recorded there is not used.
// Bad at: a meter that is not proportional to the power (apparent power, a display in steps).
#pragma once

#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/idle.hpp"

namespace servosense {

/// A stretch at one speed, in the air or in a cut.
struct LoadMeterPoint {
  double speed_rad_s = 0;
  double volts = 0, volts_error = 0;  ///< mean and its standard error
  double torque_Nm = 0;               ///< of the cut, by the reference; 0: air
};

struct LoadMeter {
  Estimate volts_per_watt;        ///< K
  Estimate viscous_Nm_s_per_rad;  ///< b
  Estimate constant_Nm;           ///< Tcf, of either sign
  double misfit = 0;              ///< square root of chi square per degree of freedom
};

/// From which speed on the line is taken to hold (Dunwoody 2010, fig. 3.4).
inline constexpr double kLoadMeterFrom_rpm = 2000;

/// Data error when there are no two speeds in the air, no cut, or no point fast enough.
Expected<LoadMeter> calibrate_load_meter(const std::vector<LoadMeterPoint>& points);

}  // namespace servosense
