#include "stack_refusal.hpp"

#include <array>
#include <string>
#include <tuple>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {
namespace {

struct Alias {
  std::string_view field;
  std::array<std::string_view, 2> keys;  // of an axis, of the spindle; or of either
};
// Where a field is not called as the key that it is made from.
constexpr std::array<Alias, 11> kAliases = {
    {{"sample_period_s", {"sample_rate_hz", "sample_rate_hz"}},
     {"inertia", {"equivalent_mass_kg", "inertia_kg_m2"}},
     {"viscous", {"viscous_friction_N_s_per_m", "viscous_friction_Nm_s_per_rad"}},
     {"coulomb", {"coulomb_friction_N", "coulomb_friction_Nm"}},
     {"friction_knee", {"friction_knee_m", "friction_knee_rad"}},
     {"unit_per_turn", {"encoder_counts_per_rev", "encoder_counts_per_rev"}},
     {"unit_per_count", {"encoder_counts_per_rev", "encoder_counts_per_rev"}},
     {"effort_per_unit", {"torque_constant_Nm_per_A", "torque_constant_Nm_per_A"}},
     {"effort_limit", {"current_limit_A", "current_limit_A"}},
     {"noise", {"noise_Nm", "noise_N"}},
     {"sample_noise", {"sample_noise_Nm", "sample_noise_N"}}}};

/// The first of `sections` that has the key behind the field says it, or could have it.
Error refused(const MachineFile& machine, const std::vector<std::string>& sections,
              const Status& status) {
  const std::string_view field = status.parameter();
  std::vector<std::string_view> names = {field};
  for (const Alias& alias : kAliases)
    if (alias.field == field) names.insert(names.end(), alias.keys.begin(), alias.keys.end());
  for (const bool stated : {true, false})
    for (const std::string& section : sections)
      for (const std::string_view name : names)
        if (find_machine_key(section, name) != nullptr && machine.has(section, name) == stated)
          return data_error(machine.where(section, name) + ": " + std::string(name) + " in [" +
                            section + "] " + status.reason());
  return data_error(machine.where(sections.front()) + ": [" + sections.front() +
                    "]: " + std::string(field) + " " + status.reason());
}

template <typename Slot>
Status slot_status(const Slot& slot) {
  if (const Status s = DriveInput<double>::validate(slot.input); !s.ok()) return s;
  if (const Status s = HostStack::Observer::validate(slot.observer); !s.ok()) return s;
  return HostStack::Observer::validate(slot.monitor_observer);
}

}  // namespace

Expected<Done> accepted(const MachineFile& machine, const HostStackConfig& config,
                        Channel spindle) {
  const Status whole = HostStack::validate(config);
  if (whole.ok()) return Done{};
  // Each part alone, to know where what was refused comes from.
  const auto drive = [&](Channel channel) {
    const std::string name(name_of(channel));
    return std::vector<std::string>{std::string(section_of(channel)), "controller." + name,
                                    "observer." + name, "machine"};
  };
  if (config.spindle.present) {
    if (const Status s = slot_status(config.spindle); !s.ok())
      return refused(machine, drive(spindle), s);
    if (const Status s = HostStack::Chatter::validate(config.spindle.chatter); !s.ok())
      return refused(
          machine,
          {monitor_section(MonitorId::chatter, spindle), "monitor.collision", "tool", "machine"},
          s);
    if (const Status s = CutDetector<double>::validate(config.cut); !s.ok())
      return refused(machine, {"monitor.collision", "machine"}, s);
    if (const Status s = SignalHealthMonitor<double>::validate(config.spindle.signal); !s.ok())
      return refused(machine, {"monitor.signal", "controller." + std::string(name_of(spindle))}, s);
  }
  for (std::size_t i = 0; i < kAllAxes; ++i) {
    const HostAxisSlotConfig& axis = config.axis[i];
    if (!axis.present) continue;
    if (const Status s = slot_status(axis); !s.ok())
      return refused(machine, drive(axis_channel(i)), s);
    if (const Status s = HostStack::Collision::validate(axis.collision); !s.ok())
      return refused(machine, {monitor_section(MonitorId::collision, axis_channel(i)), "machine"},
                     s);
    if (const Status s = SignalHealthMonitor<double>::validate(axis.signal); !s.ok())
      return refused(machine,
                     {"monitor.signal", "controller." + std::string(name_of(axis_channel(i)))}, s);
  }
  const ToolMonitorsConfig& tool = config.tool;
  using Tool = HostStack::Tool;
  for (const auto& [on, section, s] :
       {std::tuple{tool.ar_breakage_on, "monitor.ar-breakage",
                   Tool::Ar::validate(tool.ar_breakage)},
        std::tuple{tool.tooth_breakage_on, "monitor.tooth-breakage",
                   Tool::Tooth::validate(tool.tooth_breakage)},
        std::tuple{tool.drill_fracture_on, "monitor.drill-fracture",
                   Tool::Drill::validate(tool.drill_fracture)},
        std::tuple{tool.wear_on, "monitor.wear", Tool::Wear::validate(tool.wear)},
        std::tuple{tool.torque_band_on, "monitor.torque-band",
                   Tool::Band::validate(tool.torque_band)}})
    if (on && !s.ok())
      return refused(machine, {section, "tool", "spindle", "axis.z", "machine"}, s);
  return data_error(machine.name() + ": " + whole.parameter() + " " + whole.reason());
}

}  // namespace servosense
