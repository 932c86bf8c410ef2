// Whether the effort of a record belongs to its motion.
#pragma once

#include <string>

#include "servosense/core/expected.hpp"
#include "servosense/reconcile/drive.hpp"

namespace servosense::reconcile {

/// Effort against motion of a conditioned drive: an effort that stays where the motion asks for
/// another is marked invalid and reported; one that goes with another motion, lags far behind, has
/// lost its sign or comes in steps too coarse is refused.
Expected<Done> check_effort(const std::string& column, DriveData& data, const Criteria& criteria);

}  // namespace servosense::reconcile
