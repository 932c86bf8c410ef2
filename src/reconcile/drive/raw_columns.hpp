// What was recorded of a drive, as columns.
#pragma once

#include "servosense/reconcile/drive.hpp"

namespace servosense::reconcile {

/// Positions of the samples, from the first [m or rad].
Column raw_position(const DriveData& data);

/// Efforts of the samples, not filtered [N or Nm].
Column raw_effort(const DriveData& data);

}  // namespace servosense::reconcile
