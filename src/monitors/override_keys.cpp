#include "servosense/monitors/override_keys.hpp"

#include <string>
#include <utility>

namespace servosense {

Expected<std::optional<OverrideConfig>> override_config(const MachineFile& machine,
                                                        double sample_period_s) {
  constexpr const char* kSection = "override";
  if (!machine.has_section(kSection)) return std::optional<OverrideConfig>{};
  OverrideConfig c;
  c.sample_period_s = sample_period_s;
  if (const auto pair = machine.pairs(kSection, "speed_ratio")) {
    c.least_speed = (*pair)[0][0];
    c.greatest_speed = (*pair)[0][1];
  }
  if (const auto pair = machine.pairs(kSection, "feed_ratio")) {
    c.least_feed = (*pair)[0][0];
    c.greatest_feed = (*pair)[0][1];
  }
  for (const auto& [key, field] : {std::pair{"speed_rate_per_s", &OverrideConfig::speed_rate_per_s},
                                   {"feed_rate_per_s", &OverrideConfig::feed_rate_per_s},
                                   {"variation_amplitude", &OverrideConfig::variation_amplitude},
                                   {"variation_hz", &OverrideConfig::variation_hz},
                                   {"patience_s", &OverrideConfig::patience_s},
                                   {"return_s", &OverrideConfig::return_s}})
    if (const auto value = machine.number(kSection, key)) c.*field = *value;
  c.feed_per_minute = machine.flag(kSection, "feed_per_minute").value_or(c.feed_per_minute);
  if (const Status status = OverrideControl<double>::validate(c); !status.ok())
    return data_error(machine.where(kSection) + ": " + status.parameter() + ' ' + status.reason());
  return std::optional<OverrideConfig>{c};
}

}  // namespace servosense
