// Parameters: numbered ones, named ones, and those by which a program asks what is in force.
#include <cmath>

#include "machine.hpp"
#include "servosense/io/text.hpp"

namespace servosense::process {

Expected<double> Machine::numbered(long index) const {
  if (index == 0 && options_.dialect == Dialect::fanuc)
    return data_error("#0, the parameter without a value, is not supported; compare with a number");
  if (index < 1 || index > kLastParameter)
    return data_error("there is no parameter #" + std::to_string(index) + "; they are #1 to #" +
                      std::to_string(kLastParameter));
  if (index >= 5061 && index <= 5070)
    return data_error("#" + std::to_string(index) +
                      " is what a probe found, which is not known here");
  if (index == 5399) return data_error("#5399 is what M66 read, which is not known here");
  if (index >= 5420 && index <= 5428) {
    if (compensating())
      return data_error("#" + std::to_string(index) +
                        " is the place of the tool, which is open while cutter compensation is on");
    const auto axis = static_cast<std::size_t>(index - 5420);
    return position_[axis] / (is_rotary(axis) ? 1 : modes_.unit_mm);
  }
  return parameters[static_cast<std::size_t>(index)];
}

namespace {

/// What LinuxCNC keeps as `#<_name>`; each is read only.
struct KeptValue {
  std::string_view name;
  double (*of)(const Modes&);
};
double yes(bool value) { return value ? 1 : 0; }
constexpr KeptValue kKept[] = {
    {"_vmajor", [](const Modes&) { return 2.9; }},
    {"_vminor", [](const Modes&) { return 0.0; }},
    {"_task", [](const Modes&) { return 0.0; }},
    {"_motion_mode", [](const Modes& m) { return static_cast<double>(m.motion); }},
    {"_plane",
     [](const Modes& m) {
       return m.plane == Plane::xy ? 170.0 : m.plane == Plane::zx ? 180.0 : 190.0;
     }},
    {"_coord_system",
     [](const Modes& m) {
       return m.coordinate_system <= 6 ? 530.0 + 10 * m.coordinate_system
                                       : 584.0 + m.coordinate_system;
     }},
    {"_metric", [](const Modes& m) { return yes(m.unit_mm == 1); }},
    {"_imperial", [](const Modes& m) { return yes(m.unit_mm != 1); }},
    {"_absolute", [](const Modes& m) { return yes(m.absolute); }},
    {"_incremental", [](const Modes& m) { return yes(!m.absolute); }},
    {"_inverse_time", [](const Modes& m) { return yes(m.feed_mode == FeedMode::inverse_time); }},
    {"_units_per_minute", [](const Modes& m) { return yes(m.feed_mode == FeedMode::per_minute); }},
    {"_units_per_rev", [](const Modes& m) { return yes(m.feed_mode == FeedMode::per_revolution); }},
    {"_retract_r_plane", [](const Modes& m) { return yes(m.retract_to_r); }},
    {"_retract_old_z", [](const Modes& m) { return yes(!m.retract_to_r); }},
    {"_spindle_rpm_mode", [](const Modes& m) { return yes(!m.surface_speed); }},
    {"_spindle_css_mode", [](const Modes& m) { return yes(m.surface_speed); }},
    {"_ijk_absolute_mode", [](const Modes& m) { return yes(m.arc_absolute); }},
    {"_lathe_diameter_mode", [](const Modes&) { return 0.0; }},
    {"_lathe_radius_mode", [](const Modes&) { return 1.0; }},
    {"_spindle_on", [](const Modes& m) { return yes(m.spindle_direction != 0); }},
    {"_spindle_cw", [](const Modes& m) { return yes(m.spindle_direction > 0); }},
    {"_mist", [](const Modes& m) { return yes(m.mist); }},
    {"_flood", [](const Modes& m) { return yes(m.flood); }},
    {"_speed_override", [](const Modes& m) { return yes(m.speed_override); }},
    {"_feed_override", [](const Modes& m) { return yes(m.feed_override); }},
    {"_adaptive_feed", [](const Modes& m) { return yes(m.adaptive_feed); }},
    {"_feed_hold", [](const Modes& m) { return yes(m.feed_hold); }},
    {"_feed", [](const Modes& m) { return m.feed; }},
    {"_rpm", [](const Modes& m) { return m.speed_rpm; }},
};

}  // namespace

Expected<double> Machine::named(std::string_view name) const {
  const auto& locals = frames.back().locals;
  if (name.starts_with('_')) {
    for (const KeptValue& kept : kKept)
      if (kept.name == name) return kept.of(modes_);
    for (std::size_t i = 0; i < kAxisLetters.size(); ++i) {
      const char letter = kAxisLetters[i];
      if (name == std::string("_") + letter || name == std::string("_abs_") + letter) {
        if (name.size() == 2) return numbered(5420 + static_cast<long>(i));
        return offsets_.to_machine(position_)[i] / (is_rotary(i) ? 1 : modes_.unit_mm);
      }
    }
    if (name == "_line") return static_cast<double>(file_line);
    if (name == "_ccomp") return side_ == Side::none ? 400.0 : side_ == Side::left ? 410.0 : 420.0;
    if (name == "_value") return returned.value_or(0);
    if (name == "_value_returned") return returned ? 1.0 : 0.0;
    if (name == "_call_level") return static_cast<double>(frames.size() - 1);
    if (name == "_remap_level") return 0.0;
    if (name == "_current_tool") return static_cast<double>(in_spindle_.number);
    if (name == "_selected_tool") return static_cast<double>(selected_tool_);
    if (name == "_current_pocket" || name == "_selected_pocket" || name == "_tool_offset" ||
        name.starts_with("_ini[") || name.starts_with("_hal["))
      return data_error("#<" + std::string(name) + "> is known on the machine alone");
    if (const auto found = globals_.find(name); found != globals_.end()) return found->second;
  } else if (const auto found = locals.find(name); found != locals.end()) {
    return found->second;
  }
  return data_error("#<" + std::string(name) + "> has no value yet; set it before" +
                    (name.starts_with('_') ? "" : ", in the same subroutine"));
}

bool Machine::exists(std::string_view name) const { return named(name).has_value(); }

Refusal Machine::set_named(const std::string& name, double value) {
  if (name.empty()) return refuse("a parameter has an empty name");
  if (name[0] != '_') {
    frames.back().locals[name] = value;
    return std::nullopt;
  }
  if (!globals_.contains(name) && exists(name))
    return refuse("#<" + name + "> is kept by the machine and cannot be set");
  globals_[name] = value;
  return std::nullopt;
}

}  // namespace servosense::process
