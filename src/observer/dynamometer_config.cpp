#include "servosense/observer/dynamometer_config.hpp"

#include <algorithm>
#include <string>

namespace servosense {

Expected<std::optional<DynamometerFilterConfig>> dynamometer_config(const MachineFile& machine,
                                                                    char direction,
                                                                    double sample_period_s) {
  const std::string section = std::string("dynamometer.") + direction;
  const auto modes = machine.triples(section, "modes");
  if (!modes) return std::optional<DynamometerFilterConfig>();
  DynamometerFilterConfig c;
  c.sample_period_s = sample_period_s;
  c.modes = modes->size();
  if (c.modes > kMostDynamometerModes)
    return data_error(machine.where(section, "modes") + ": a dynamometer has " +
                      std::to_string(kMostDynamometerModes) +
                      " modes at most; leave the highest ones out");
  for (std::size_t k = 0; k < c.modes; ++k) {
    const auto& [frequency_hz, damping, share] = (*modes)[k];
    c.mode[k] = {frequency_hz, damping, share};
  }
  const auto teeth = static_cast<std::size_t>(machine.number("tool", "teeth").value_or(4));
  const std::size_t standard = std::clamp<std::size_t>(3 * teeth, 12, kMostDynamometerHarmonics);
  const auto harmonics = machine.number("dynamometer", "harmonics");
  c.harmonics = harmonics ? static_cast<std::size_t>(*harmonics) : standard;
  c.averaged_turns = machine.number("dynamometer", "averaged_turns").value_or(c.averaged_turns);
  if (const Status s = DynamometerFilter<double>::validate(c); !s.ok())
    return data_error(machine.where(section, "modes") + ": at the trace's rate " + s.parameter() +
                      " " + s.reason() + "; correct the modes, or record faster");
  return std::optional(c);
}

}  // namespace servosense
