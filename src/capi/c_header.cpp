// The C configuration as a C99 initialiser.
#include <cctype>
#include <cstdio>

#include "config_fields.hpp"
#include "servosense/capi/machine_config.hpp"

namespace servosense {
namespace {

std::string number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", value);
  // The shortest that reads back as the same.
  for (int digits = 6; digits < 17; ++digits) {
    char shorter[40];
    std::snprintf(shorter, sizeof shorter, "%.*g", digits, value);
    if (std::stod(shorter) == value) return shorter;
  }
  return text;
}
std::string number(float value) {
  std::string text = number(static_cast<double>(value));
  if (text.find_first_of(".e") == std::string::npos) text += ".0";
  return text + "F";
}
std::string number(int value) { return std::to_string(value); }
std::string number(std::uint32_t value) { return std::to_string(value) + "U"; }

/// A member a line, indented.
class Initialiser {
 public:
  explicit Initialiser(std::string& to, int depth)
      : to_(to), indent_(2 * static_cast<std::size_t>(depth), ' ') {}
  void raw(const char* name, const std::string& value) const {
    to_ += indent_ + "." + name + " = " + value + ",\n";
  }
  template <typename C>
  void operator()(const char* name, const C& c) const {
    if constexpr (std::is_array_v<C>) {
      std::string values;
      for (const auto& value : c) values += (values.empty() ? "" : ", ") + number(value);
      raw(name, "{" + values + "}");
    } else {
      raw(name, number(c));
    }
  }
  template <typename C, typename B>
  void operator()(const char* name, const C& c, const B&) const {
    (*this)(name, c);
  }
  template <typename Inside>
  void part(const char* name, Inside inside) const {
    to_ += indent_ + (name[0] != '\0' ? std::string(".") + name + " = {\n" : "{\n");
    inside();
    to_ += indent_ + "},\n";
  }

 private:
  std::string& to_;
  std::string indent_;
};

void print_drive(std::string& to, int depth, const char* member, const servosense_drive& d,
                 const std::string& effects) {
  const Initialiser out(to, depth), in(to, depth + 1), deep(to, depth + 2);
  out.part(member, [&] {
    in("present", d.present);
    in("motion", d.motion);
    in("counts_per_turn", d.counts_per_turn);
    in("counter_bits", d.counter_bits);
    in("unit_per_turn", d.unit_per_turn);
    in("effort_per_ampere", d.effort_per_ampere);
    in("effort_update_s", d.effort_update_s);
    in("torque_constant_per_K", d.torque_constant_per_K);
    in("torque_constant_at_C", d.torque_constant_at_C);
    in("inertia", d.inertia);
    in("viscous_friction", d.viscous_friction);
    in("coulomb_friction", d.coulomb_friction);
    in("constant_load", d.constant_load);
    in("friction_knee", d.friction_knee);
    in("load_inertia_share", d.load_inertia_share);
    in("load_friction_share", d.load_friction_share);
    in("cutoff_rad_s", d.cutoff_rad_s);
    in("velocity_cutoff_rad_s", d.velocity_cutoff_rad_s);
    in("monitor_cutoff_rad_s", d.monitor_cutoff_rad_s);
    in("tool_cutoff_rad_s", d.tool_cutoff_rad_s);
    in("estimate_noise", d.estimate_noise);
    in.raw("effects", d.effect_count > 0 ? effects : "NULL");
    in("effect_count", d.effect_count);
    in.part("signal", [&] { capi::signal_fields(d.signal, SignalHealthConfig{}, deep); });
  });
}

void print_effects(std::string& to, const std::string& name,
                   const std::vector<servosense_effect>& effects) {
  if (effects.empty()) return;
  to += "static const servosense_effect " + name + "[] = {\n";
  for (const servosense_effect& e : effects) {
    const EffectInfo& info = kDriveEffects[e.effect];
    to += "  {/* " + std::string(info.name) + " */ .effect = " + std::to_string(e.effect) +
          ",\n   .parameters = {";
    for (std::size_t p = 0; p < kMaxEffectParameters; ++p) {
      to += p > 0 ? ",\n                  " : "";
      if (p < info.parameter_count()) to += "/* " + std::string(info.parameters[p].key) + " */ ";
      to += "{{";
      const std::size_t count = e.parameters[p].count;
      for (std::size_t k = 0; k < (count > 0 ? count : 1); ++k)
        to += (k > 0 ? ", " : "") + number(e.parameters[p].value[k]);
      to += "}, " + std::to_string(count) + "}";
    }
    to += "}},\n";
  }
  to += "};\n\n";
}

std::string upper(std::string text) {
  for (char& c : text) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return text;
}

}  // namespace

std::string c_header(const MachineConfig& machine, const std::string& name,
                     const std::string& title) {
  const auto effects_of = [&](std::size_t drive) {
    return name + "_" + std::string(name_of(static_cast<Channel>(drive))) + "_effects";
  };
  const servosense_config& c = machine.config;
  // A library with room for x, y, z alone serves a machine that has no other.
  std::size_t axes = kAxes;
  for (std::size_t i = kAxes; i < SERVOSENSE_AXES; ++i)
    if (c.axis[i].present != 0) axes = i + 1;
  std::string safe = title;  // a title must not end the comment
  for (std::size_t at = 0; (at = safe.find("*/", at)) != std::string::npos;) safe[at] = '+';
  std::string to = "/* " + safe +
                   "\n * Constant data for flash: servosense_init(storage, bytes, &" + name +
                   ", ...).\n";
  for (const MonitorAvailability& m : machine.monitors)
    to += " * " + std::string(name_of(m.monitor)) + " on " + std::string(name_of(m.channel)) +
          (m.runs ? ": runs" : ": does not run") + "\n";
  to += " */\n#ifndef " + upper(name) + "_H\n#define " + upper(name) +
        "_H\n\n#include \"servosense/capi/servosense.h\"\n\n#if SERVOSENSE_CAPI_VERSION != " +
        std::to_string(SERVOSENSE_CAPI_VERSION) +
        "\n#error \"made for another version of servosense; export the machine file again\"\n"
        "#endif\n" +
        (axes > kAxes ? "#if SERVOSENSE_AXES < " + std::to_string(axes) +
                            "\n#error \"the machine has more axes: define SERVOSENSE_AXES for the "
                            "library, too\"\n#endif\n"
                      : std::string()) +
        "\n";
  for (std::size_t d = 0; d <= SERVOSENSE_AXES; ++d)
    print_effects(to, effects_of(d), machine.effects[d]);
  if (!machine.reference.empty()) {
    to += "static const servosense_band_point " + name + "_reference[] = {\n";
    for (const servosense_band_point& p : machine.reference)
      to += "  {" + number(p.torque_Nm) + ", " + number(p.lower_Nm) + ", " + number(p.upper_Nm) +
            ", " + number(p.feed) + "},\n";
    to += "};\n\n";
  }
  if (!machine.sections.empty()) {
    to += "static const servosense_band_section " + name + "_sections[] = {\n";
    for (const servosense_band_section& s : machine.sections)
      to += "  {" + number(s.first) + ", " + number(s.block) + ", " + number(s.speed_rad_s) + ", " +
            std::to_string(s.has_air) + ", " + std::to_string(s.behind_gap) + ", " +
            number(s.air_Nm) + "},\n";
    to += "};\n\n";
  }
  to += "static const servosense_config " + name + " = {\n";
  const Initialiser top(to, 1), in(to, 2), deep(to, 3);
  top.raw("size", "sizeof(servosense_config)");
  top("sample_period_s", c.sample_period_s);
  print_drive(to, 1, "spindle", c.spindle, effects_of(0));
  top.part("axis", [&] {
    for (std::size_t i = 0; i < axes; ++i) print_drive(to, 2, "", c.axis[i], effects_of(1 + i));
  });
  top("teeth", c.teeth);
  top.part("chatter", [&] {
    in("enabled", c.chatter.enabled);
    capi::chatter_fields(c.chatter, ChatterConfig{}, in);
  });
  top.part("collision", [&] {
    for (std::size_t i = 0; i < axes; ++i)
      in.part("", [&] {
        deep("enabled", c.collision[i].enabled);
        capi::collision_fields(c.collision[i], CollisionConfig{}, deep);
      });
  });
  top.part("cut", [&] { capi::cut_fields(c.cut, CutDetectorConfig{}, in); });
  top.part("friction", [&] {
    in("enabled", c.friction.enabled);
    capi::friction_fields(c.friction, FrictionFollowerConfig{}, in);
  });
  top.part("ar_breakage", [&] {
    in("enabled", c.ar_breakage.enabled);
    capi::ar_breakage_fields(c.ar_breakage, ArBreakageConfig{}, in);
  });
  top.part("tooth_breakage", [&] {
    in("enabled", c.tooth_breakage.enabled);
    capi::tooth_breakage_fields(c.tooth_breakage, ToothBreakageConfig{}, in);
  });
  top.part("drill_fracture", [&] {
    in("enabled", c.drill_fracture.enabled);
    in("counter_clockwise", c.drill_fracture.counter_clockwise);
    capi::drill_fracture_fields(c.drill_fracture, DrillFractureConfig{}, in);
  });
  top.part("wear", [&] {
    in("enabled", c.wear.enabled);
    capi::wear_fields(c.wear, WearConfig{}, in);
    in("taught_thrust_N", c.wear.taught_thrust_N);
    in("taught_thrust_scatter_N", c.wear.taught_thrust_scatter_N);
    in("taught_torque_Nm", c.wear.taught_torque_Nm);
    in("taught_torque_scatter_Nm", c.wear.taught_torque_scatter_Nm);
  });
  top.part("coefficients", [&] {
    in("enabled", c.coefficients.enabled);
    capi::coefficients_fields(c.coefficients, CuttingCoefficientsConfig{}, in);
    capi::coefficients_structs(
        c.coefficients, CuttingCoefficientsConfig{},
        [&](const char* part, auto fields) { in.part(part, [&] { fields(deep); }); });
  });
  top.part("torque_band", [&] {
    in("enabled", c.torque_band.enabled);
    in.raw("reference", machine.reference.empty() ? "NULL" : name + "_reference");
    in("reference_count", c.torque_band.reference_count);
    in.raw("sections", machine.sections.empty() ? "NULL" : name + "_sections");
    in("section_count", c.torque_band.section_count);
    capi::torque_band_fields(c.torque_band, TorqueBandConfig{}, in);
  });
  top("half_rate", c.half_rate);
  top("grouped", c.grouped);
  to += "};\n\n#endif\n";
  return to;
}

}  // namespace servosense
