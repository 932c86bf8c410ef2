// Where the machine file holds what the collision monitor knows of an axis: keys with the axis in
// their name in [monitor.collision], in N and m; of an axis that turns, a section of its own
// ([monitor.collision.a]) in Nm and rad.
#pragma once

#include <string>

#include "servosense/core/channel.hpp"
#include "servosense/io/machine_keys.hpp"

namespace servosense {

struct CollisionKeys {
  explicit CollisionKeys(Channel axis) : section(monitor_section(MonitorId::collision, axis)) {
    const bool turns = is_turning(axis);
    const std::string own = turns ? "_" : "_" + std::string(name_of(axis)) + "_";
    const std::string rate = own + (turns ? "Nm_per_s" : "N_per_s");
    threshold = "threshold" + rate;
    phase_thresholds = "phase_thresholds" + rate;
    cutting_threshold = "cutting_threshold" + rate;
    resonance = "resonance" + own + "hz";
    learned_counts = "learned_counts" + own + "per_rev";
    maximum_feed = turns ? "maximum_feed_rad_s" : "maximum_feed_m_s";
    accelerating = turns ? "accelerating_rad_s2" : "accelerating_m_s2";
  }

  std::string section;  ///< without brackets
  std::string threshold, phase_thresholds, cutting_threshold, resonance, learned_counts;
  std::string maximum_feed, accelerating;
};

}  // namespace servosense
