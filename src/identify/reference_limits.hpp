// Limits that the windows of a reference and what learns them share.
#pragma once

namespace servosense {

/// Revolutions of a window with orders: their lines lie apart (convention).
inline constexpr double kLeastTurns = 4;
/// Part of the usual speed, below which nothing is cut (convention).
inline constexpr double kTurning = 0.2;

}  // namespace servosense
