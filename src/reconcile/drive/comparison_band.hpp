// The band in which forces are compared, and the floor that the encoder sets in it.
#pragma once

#include "servosense/reconcile/drive.hpp"

namespace servosense::reconcile {

/// The highest corner at which the encoder's noise, differentiated twice, does not dominate, nor a
/// drive that swings all the time: else whatever filters that would seem to explain the residual.
double comparison_corner(const DriveData& data, const Criteria& criteria = kCriteria);

/// Rms that the encoder's noise (the larger of its quantum and what is white in the position)
/// leaves at the least in a comparison of forces, through inertia and filter, in the unit of the
/// effort; 0 where it is not known. A loop that answers the noise with effort makes it look like a
/// relation between motion and effort, and inertia cancels it in the upper half of the band, so no
/// other floor sees it.
double encoder_floor(const DriveData& data, double corner, const Criteria& criteria = kCriteria);

}  // namespace servosense::reconcile
