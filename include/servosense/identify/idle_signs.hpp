// The signs of an idling run whose effort is an absolute value.
//
// Where the drive does not brake, the effort is along the motion: that shows inertia and friction,
// and these tell the sign where it brakes (identify/effort_sign.hpp).
#pragma once

#include <optional>

#include "servosense/core/expected.hpp"
#include "servosense/identify/idle.hpp"

namespace servosense {

/// Puts the signs into the record; the share of its samples that is sure. Data error where the
/// record does not show the drive without its braking.
Expected<double> find_idle_signs(const DisturbanceObserverConfig& base, DriveRecord& record,
                                 double unit_per_count, const IdleOptions& options);

/// The same where an absolute value explains the record better than the values as they are: they
/// are never negative. Nothing where they have a sign, or where both explain it.
std::optional<double> recognise_idle_signs(const DisturbanceObserverConfig& base,
                                           DriveRecord& record, double unit_per_count,
                                           const IdleOptions& options);

}  // namespace servosense
