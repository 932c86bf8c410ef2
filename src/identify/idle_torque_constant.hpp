// How torque per ampere falls with speed and with current, both sought in an idling run.
#pragma once

#include <optional>

#include "idle_design.hpp"

namespace servosense::idle_fit {

struct TorqueConstantTaken {
  bool falls = false;
  /// What that leaves open of inertia, viscous and Coulomb friction, standard errors.
  Eigen::Vector3d errors = Eigen::Vector3d::Zero();
  /// The record with its effort smoothed, where the constant falls with current: what noise has
  /// beyond the knee is lost to it, what it has below is not, and the inertia would come out low.
  std::optional<DriveRecord> calm;
};

/// Puts what is found into `config` and `found`. Each is sought with the other taken off, in turn,
/// until the saturation moves no more.
TorqueConstantTaken take_torque_constant(DisturbanceObserverConfig& config,
                                         const DriveRecord& record, const IdleOptions& options,
                                         bool with_load, IdleIdentification& found);

}  // namespace servosense::idle_fit
