// Where the hammer touches: contacts found in a force record, and those that belong together.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "servosense/identify/impact_pulse.hpp"

namespace servosense::impact {

/// A force record, what is no blow taken off.
struct ForceRecord {
  std::vector<double> force_N;  ///< offset and drift removed; 0 where there was no value
  std::vector<bool> known;      ///< where there was one
  double noise_N = 0;           ///< standard deviation of a sample
};
[[nodiscard]] ForceRecord force_record(std::span<const double> measured_N, double sample_rate_hz);

/// One blow: its strongest contact, and the strongest of the others that came with it.
struct Blow {
  ForcePulse pulse;
  bool doubled = false;
  ForcePulse second;
};

/// In the order of time. The force of the strongest contact gives the sign that counts.
[[nodiscard]] std::vector<Blow> find_blows(const ForceRecord& record, double sample_rate_hz);

}  // namespace servosense::impact
