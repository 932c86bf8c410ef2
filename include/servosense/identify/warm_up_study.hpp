// Friction against warm-up: how the friction of a drive that idles changes along a record.
//
// The record is cut into parts of equal length. Of each: the mean effort against the motion near
// the highest speed, that is friction there, which one speed is enough for; and viscous and Coulomb
// friction where the motion tells them apart (identify/idle.hpp). Through the first
// goes F(t) = F_end + drop exp(-t / tau), least squares over a grid of tau, errors by what is left.
// (Koike 2016, sec. 4.3.4, tells of up to 55 N between the 1st and the 50th move, and asks for
// friction against time.)
// Bad at: records in which the motion itself changes; these are refused.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/idle.hpp"

namespace servosense {

struct WarmUpPart {
  double from_s = 0, to_s = 0;
  double friction = 0;                       ///< N or Nm at the speed of the study
  std::optional<Estimate> viscous, coulomb;  ///< N s/m or Nm s/rad; N or Nm
};

struct WarmUpStudy {
  double speed = 0;  ///< m/s or rad/s
  std::vector<WarmUpPart> parts;
  double end = 0, drop = 0;  ///< N or Nm, of the curve; a drop below 0 is a rise
  double time_constant_s = 0;
  Estimate change;  ///< N or Nm, from the middle of the first part to that of the last
  /// The change is more than chance: four standard errors, for the best of a grid is taken.
  bool changes = false;
  /// It has come to rest: the record is longer than the time constant.
  bool settles = false;
  [[nodiscard]] double at(double t_s) const;
};

inline constexpr std::size_t kFewestWarmUpParts = 6, kMostWarmUpParts = 200;

/// `record`: an idling run, one motion again and again. Data error where a part does not move, or
/// moves at another speed than the others (5 %), or the record is too short for the parts.
Expected<WarmUpStudy> study_warm_up(const DisturbanceObserverConfig& base,
                                    const DriveRecord& record, std::size_t parts);

}  // namespace servosense
