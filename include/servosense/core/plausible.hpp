// What no machine tool does. A signal beyond it is in another unit than its name says, or wrong.
// Kind of all: conventions, above what the fastest machines state (source behind each).
#pragma once

#include "servosense/core/units.hpp"

namespace servosense {

/// 60 000 rpm. Series milling spindles end at 42 000 to 60 000 rpm; air bearings for circuit boards
/// go beyond, and say so by max_speed_rpm in [spindle].
inline constexpr double kImpossibleSpeed_rad_s = 60000 * kTwoPi / 60;
/// Linear motor machines state rapids of 120 to 300 m/min, 5 m/s.
inline constexpr double kImpossibleVelocity_m_s = 6;
/// The longest portal machines travel some 60 m.
inline constexpr double kImpossibleTravel_m = 100;
/// Axes state 5 to 30 m/s2, small linear motors 200; not even against an obstacle more than 800.
/// Beyond it the encoder reading is wrong.
inline constexpr double kImpossibleAcceleration_m_s2 = 800;
inline constexpr double kImpossibleAcceleration_rad_s2 = 4e5;
/// Feed drives of the heaviest machines push 100 kN, their spindles turn with 100 kNm.
inline constexpr double kImpossibleForce_N = 2e5;
inline constexpr double kImpossibleTorque_Nm = 2e5;
/// Motors of 300 kW take some 600 A.
inline constexpr double kImpossibleCurrent_A = 2000;
/// The strongest spindles of heavy machines take some hundred kW.
inline constexpr double kImpossiblePower_W = 1e6;
/// Between two rows: the slowest records of drives come at 10 Hz.
inline constexpr double kImpossiblePeriod_s = 0.5;
/// Part by which the rate of a trace may be off that of the machine file: two clocks and rounded
/// times are nearer, any two rates in use further apart.
inline constexpr double kSameRate = 0.02;

}  // namespace servosense
