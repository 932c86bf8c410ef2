// How much later than its encoder a drive reports its effort.
#pragma once

#include <limits>

#include "reconcile/drive/signals.hpp"
#include "servosense/reconcile/drive.hpp"
#include "servosense/reconcile/problem.hpp"

namespace servosense::reconcile {

/// Time that passes from the encoder to the reported effort, filters of the speed apart [s], surely
/// no less and surely no more.
struct ControllerDelay {
  double least_s = 0;
  double most_s = std::numeric_limits<double>::infinity();
};
/// That of a cascade of P and PI, fitted with all its gains free. Anything where the trace has no
/// command or another law was at work. What moves the drive, and so what its model lacks, does not
/// matter here.
ControllerDelay controller_delay(const DriveData& data, const DriveSignals& signals,
                                 const Problem& problem, const Criteria& criteria);

}  // namespace servosense::reconcile
