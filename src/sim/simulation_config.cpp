#include "servosense/sim/simulation_config.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>

#include "servosense/io/coefficient_file.hpp"
#include "servosense/observer/machine_config.hpp"
#include "simulation_texts.hpp"

namespace servosense {
namespace {

using detail::speed_profile;
using detail::workpiece_of;
using detail::wrong_at;

constexpr double kServoRate_hz = 8000;

void take(const MachineFile& machine, std::string_view section, const char* key, double& to) {
  if (const auto value = machine.number(section, key)) to = *value;
}

Expected<Done> require(const MachineFile& machine, std::string_view section,
                       std::initializer_list<std::pair<const char*, double*>> keys) {
  for (const auto& [key, to] : keys) {
    auto value = machine.required_number(section, key);
    if (!value) return value.error();
    *to = *value;
  }
  return Done{};
}

/// Calls `take` with the name and section of every effect in the file.
template <typename Take>
Expected<Done> for_each_effect(const MachineFile& machine, Take take) {
  constexpr std::string_view kPrefix = "effect.";
  for (const std::string& section : machine.sections()) {
    if (!section.starts_with(kPrefix)) continue;
    const std::size_t dot = section.find('.', kPrefix.size());
    if (dot == std::string::npos) continue;
    if (Expected<Done> done =
            take(section, std::string_view(section).substr(kPrefix.size(), dot - kPrefix.size()),
                 std::string_view(section).substr(dot + 1));
        !done)
      return done;
  }
  return Done{};
}

Expected<std::vector<double>> one_a_tooth(const MachineFile& machine, std::string_view section,
                                          const char* key, int teeth) {
  auto values = machine.list(section, key).value_or(std::vector<double>{});
  if (values.empty() || static_cast<int>(values.size()) == teeth) return values;
  return wrong_at(machine, section, key,
                  std::string(key) + " needs one number for each of the " + std::to_string(teeth) +
                      " teeth, not " + std::to_string(values.size()));
}

Expected<Done> add_tool_effect(const MachineFile& machine, const std::string& section,
                               std::string_view name, MillingTool& tool) {
  const auto teeth = static_cast<std::size_t>(tool.teeth);
  if (name == "edge-force") {
    tool.force.tangential_edge_N_per_m +=
        machine.number(section, "tangential_edge_N_per_m").value_or(0);
    tool.force.radial_edge_N_per_m += machine.number(section, "radial_edge_N_per_m").value_or(0);
  } else if (name == "size-effect") {
    return require(machine, section, {{"exponent", &tool.force.size_effect_exponent}});
  } else if (name == "process-damping") {
    return require(machine, section, {{"coefficient", &tool.force.process_damping_N_per_m}});
  } else if (name == "helix-lag") {
    return require(machine, section, {{"helix_deg", &tool.helix_deg}});
  } else if (name == "missing-tooth") {
    double number = 0, fraction = 1;
    if (auto done = require(machine, section, {{"tooth", &number}}); !done) return done;
    take(machine, section, "fraction", fraction);
    if (number < 1 || number > tool.teeth)
      return wrong_at(
          machine, section, "tooth",
          "tooth counts from 1 to the " + std::to_string(tool.teeth) + " teeth of the tool");
    const std::size_t tooth = static_cast<std::size_t>(number) - 1;
    // Chipped along its whole edge a tooth reaches less; broken, its lower part is gone.
    if (const auto shorter_m = machine.number(section, "shorter_m")) {
      tool.throw_m.resize(teeth, 0.0);
      tool.throw_m[tooth] -= *shorter_m;
      return Done{};
    }
    tool.broken_fraction.resize(teeth, 0.0);
    tool.broken_fraction[tooth] = std::max(tool.broken_fraction[tooth], fraction);
  } else if (name == "runout") {
    const auto throws = machine.list(section, "throw_m").value_or(std::vector<double>{});
    if (throws.size() == 1) {
      add_offset(tool, throws[0], machine.number(section, "angle_rad").value_or(0));
    } else {
      auto each = one_a_tooth(machine, section, "throw_m", tool.teeth);
      if (!each) return each.error();
      tool.throw_m.resize(teeth, 0.0);
      for (std::size_t i = 0; i < each->size(); ++i) tool.throw_m[i] += (*each)[i];
    }
  }
  return Done{};
}

std::vector<StructuralMode> modes_of(const MachineFile& machine, const std::string& section) {
  std::vector<StructuralMode> modes;
  const auto triples = machine.triples(section, "modes");
  if (!triples) return modes;
  for (const auto& [frequency_hz, damping, mass_kg] : *triples)
    modes.push_back({frequency_hz, damping, mass_kg});
  return modes;
}

/// How the teeth stand, and what effects add to the tool.
Expected<Done> add_teeth(const MachineFile& machine, MillingTool& tool) {
  take(machine, "tool", "helix_deg", tool.helix_deg);
  auto throws = one_a_tooth(machine, "tool", "throw_m", tool.teeth);
  if (!throws) return throws.error();
  tool.throw_m = std::move(*throws);
  auto broken = one_a_tooth(machine, "tool", "broken_teeth", tool.teeth);
  if (!broken) return broken.error();
  tool.broken_fraction = std::move(*broken);

  // Where the teeth stand comes first: a throw acts at their angles.
  auto done = for_each_effect(
      machine, [&](const std::string& section, std::string_view, std::string_view name) {
        if (name != "pitch-error") return Expected<Done>(Done{});
        auto off = one_a_tooth(machine, section, "angle_rad", tool.teeth);
        if (!off) return Expected<Done>(off.error());
        tool.tooth_angle_rad.resize(off->size());
        for (std::size_t i = 0; i < off->size(); ++i)
          tool.tooth_angle_rad[i] =
              kTwoPi * static_cast<double>(i) / static_cast<double>(off->size()) + (*off)[i];
        return Expected<Done>(Done{});
      });
  if (!done) return done.error();
  add_offset(tool, machine.number("tool", "runout_m").value_or(0), 0);
  return for_each_effect(machine,
                         [&](const std::string& section, std::string_view, std::string_view name) {
                           return add_tool_effect(machine, section, name, tool);
                         });
}

}  // namespace

double servo_rate_hz(const MachineFile& machine) {
  return machine.number("machine", "sample_rate_hz").value_or(kServoRate_hz);
}

Expected<MillingTool> milling_teeth(const MachineFile& machine) {
  MillingTool tool;
  double teeth = 0;
  if (auto done = require(machine, "tool", {{"diameter_m", &tool.diameter_m}, {"teeth", &teeth}});
      !done)
    return done.error();
  tool.teeth = static_cast<int>(teeth);
  if (auto done = add_teeth(machine, tool); !done) return done.error();
  return tool;
}

Expected<MillingTool> milling_tool(const MachineFile& file) {
  const auto joined = with_coefficients(file);
  if (!joined) return joined.error();
  const MachineFile& machine = *joined;
  MillingTool tool;
  double teeth = 0;
  if (auto done = require(
          machine, "tool",
          {{"diameter_m", &tool.diameter_m},
           {"teeth", &teeth},
           {"tangential_coefficient_N_per_m2", &tool.force.tangential_coefficient_N_per_m2}});
      !done)
    return done.error();
  tool.teeth = static_cast<int>(teeth);
  take(machine, "tool", "radial_ratio", tool.force.radial_ratio);
  take(machine, "tool", "tangential_edge_N_per_m", tool.force.tangential_edge_N_per_m);
  take(machine, "tool", "radial_edge_N_per_m", tool.force.radial_edge_N_per_m);
  take(machine, "tool", "axial_coefficient_N_per_m2", tool.force.axial_coefficient_N_per_m2);
  take(machine, "tool", "axial_edge_N_per_m", tool.force.axial_edge_N_per_m);
  if (auto done = add_teeth(machine, tool); !done) return done.error();
  return tool;
}

Expected<MillingCut> milling_cut(const MachineFile& machine) {
  MillingCut cut;
  if (auto done = require(machine, "cut",
                          {{"spindle_speed_rpm", &cut.spindle_speed_rpm},
                           {"feed_per_tooth_m", &cut.feed_per_tooth_m},
                           {"axial_depth_m", &cut.axial_depth_m}});
      !done)
    return done.error();
  const std::string direction = machine.text("cut", "direction").value_or("down");
  cut.direction = direction == "slot" ? MillingDirection::slot
                  : direction == "up" ? MillingDirection::up
                                      : MillingDirection::down;
  if (cut.direction == MillingDirection::slot) {
    take(machine, "cut", "radial_immersion_m", cut.radial_immersion_m);
  } else if (auto done = require(machine, "cut", {{"radial_immersion_m", &cut.radial_immersion_m}});
             !done) {
    return done.error();
  }
  cut.regeneration = machine.flag("cut", "regeneration").value_or(true);
  auto done = for_each_effect(
      machine, [&](const std::string&, std::string_view, std::string_view name) -> Expected<Done> {
        cut.regeneration = cut.regeneration || name == "regeneration";
        return Done{};
      });
  if (!done) return done.error();
  return cut;
}

Expected<Structure> structure_modes(const MachineFile& machine) {
  for (const char* section : {"structure.x", "structure.y"})
    if (machine.has(section, "frf"))
      return wrong_at(machine, section, "frf",
                      "modes are needed here, not a measured receptance; write modes = "
                      "natural_frequency_hz damping_ratio modal_mass_kg, ...");
  Structure structure{modes_of(machine, "structure.x"), modes_of(machine, "structure.y")};
  auto done = for_each_effect(
      machine, [&](const std::string& section, std::string_view channel, std::string_view name) {
        if (name != "extra-mode") return Expected<Done>(Done{});
        StructuralMode mode;
        if (auto found = require(machine, section,
                                 {{"natural_frequency_hz", &mode.natural_frequency_hz},
                                  {"damping_ratio", &mode.damping_ratio},
                                  {"modal_mass_kg", &mode.modal_mass_kg}});
            !found)
          return found;
        if (channel != "y") structure.x.push_back(mode);
        if (channel != "x") structure.y.push_back(mode);
        return Expected<Done>(Done{});
      });
  if (!done) return done.error();
  return structure;
}

Expected<MillingSimulation> milling_simulation(const MachineFile& machine, double duration_s) {
  if (tool_spindle(machine) != Channel::spindle)
    return data_error(
        machine.where("tool") +
        ": [tool] spindle is spindle2; a cut is simulated on [spindle] alone, so give "
        "a file in which the spindle of the tool has that name");
  MillingSimulation s;
  auto tool = milling_tool(machine);
  if (!tool) return tool.error();
  auto cut = milling_cut(machine);
  if (!cut) return cut.error();
  auto structure = structure_modes(machine);
  if (!structure) return structure.error();
  auto speed = speed_profile(machine, cut->spindle_speed_rpm, duration_s);
  if (!speed) return speed.error();
  s.tool = std::move(*tool);
  s.cut = *cut;
  s.structure = std::move(*structure);
  s.speed = std::move(*speed);
  // Upper bound of the feed: the fastest speed all the time.
  double fastest_rpm = cut->spindle_speed_rpm;
  for (const auto& point : s.speed.points) fastest_rpm = std::max(fastest_rpm, point.speed_rpm);
  auto work =
      workpiece_of(machine, duration_s * fastest_rpm / 60 * s.tool.teeth * s.cut.feed_per_tooth_m);
  if (!work) return work.error();
  s.workpiece = std::move(*work);
  if (machine.text("simulation", "start").value_or("immersed") == "entry")
    s.start = MillingStart::entry;
  // An endless block has no face to enter by.
  if (s.start == MillingStart::entry && s.workpiece.is_endless()) s.workpiece.length_m = 1e6;
  if (const auto breaks = machine.triples("simulation", "tooth_breaks"))
    for (const auto& [time_s, tooth, fraction] : *breaks) {
      if (tooth != std::floor(tooth) || tooth > s.tool.teeth)
        return wrong_at(machine, "simulation", "tooth_breaks",
                        "tooth_breaks: the tool has teeth 1 to " + std::to_string(s.tool.teeth));
      s.breaks.push_back({time_s, static_cast<int>(tooth), fraction});
    }
  take(machine, "simulation", "step_s", s.step_s);
  if (const auto layers = machine.number("simulation", "layers"))
    s.layers = static_cast<int>(*layers);
  if (const auto points = machine.number("simulation", "surface_points"))
    s.surface_points = static_cast<int>(*points);
  return s;
}

Expected<DriveSimulatorConfig> drive_simulation(const MachineFile& machine, Channel channel) {
  const bool turns = is_turning(channel);
  const std::string name{name_of(channel)}, section{section_of(channel)};
  const std::string controller = "controller." + name;
  for (const std::string& needed : {section, controller})
    if (!machine.has_section(needed))
      return data_error(machine.name() + ": to simulate the drive of " + name + " the section [" +
                        needed + "] is needed; write it");

  DriveSimulatorConfig c;
  c.sample_period_s = 1 / servo_rate_hz(machine);
  auto drive = drive_config(machine, channel);
  if (!drive) return drive.error();
  if (is_spindle(channel)) c.loop = DriveLoop::velocity;
  c.drive = drive->disturbance_observer(c.sample_period_s, drive->observer()).drive;
  c.effort_per_A = drive->effort_per_ampere();
  // Both motors of a gantry get the same current.
  if (machine.flag(section, "gantry").value_or(false)) c.effort_per_A *= 2;
  c.encoder.counts_per_turn = drive->encoder_counts_per_rev();
  c.encoder.counter_bits = drive->counter_bits();
  if (!(c.drive.inertia > 0)) {
    const char* key = turns ? "inertia_kg_m2" : "equivalent_mass_kg";
    return machine.required_number(section, key).error();
  }
  const char* gain = turns ? "velocity_gain_A_s_per_rad" : "velocity_gain_A_s_per_m";
  if (auto done = require(machine, controller, {{gain, &c.controller.velocity_gain_A_s}}); !done)
    return done.error();
  if (is_axis(channel)) {
    if (auto done = require(machine, controller,
                            {{"position_gain_per_s", &c.controller.position_gain_per_s}});
        !done)
      return done.error();
  }
  take(machine, controller, "velocity_integral_per_s", c.controller.velocity_integral_per_s);
  take(machine, controller, "current_limit_A", c.controller.current_limit_A);
  take(machine, controller, "current_bandwidth_hz", c.controller.current_bandwidth_hz);
  take(machine, controller, "delay_s", c.controller.delay_s);
  take(machine, controller, "current_noise_A", c.current_noise_A);
  take(machine, section, "current_update_hz", c.current_update_hz);
  // One stream of noise a drive.
  const auto seed = static_cast<std::uint64_t>(machine.number("simulation", "seed").value_or(1));
  c.seed = 16 * seed + static_cast<std::uint64_t>(channel);

  const std::string vibration = "effect." + name + ".time-locked-vibration";
  if (machine.has_section(vibration)) {
    TimeLockedVibration v;
    if (auto done = require(machine, vibration,
                            {{"frequency_hz", &v.frequency_hz},
                             {turns ? "amplitude_Nm" : "amplitude_N", &v.amplitude}});
        !done)
      return done.error();
    c.vibrations.push_back(v);
  }
  return c;
}

Expected<MachineSimulation> machine_simulation(const MachineFile& machine, double cut_s) {
  MachineSimulation s;
  auto milling = milling_simulation(machine, cut_s);
  if (!milling) return milling.error();
  s.milling = std::move(*milling);
  s.sample_period_s = 1 / servo_rate_hz(machine);
  for (const auto& [channel, drive] :
       {std::pair{Channel::spindle, &s.spindle}, std::pair{Channel::x, &s.x},
        std::pair{Channel::y, &s.y}, std::pair{Channel::z, &s.z}}) {
    if (!machine.has_section("controller." + std::string(name_of(channel)))) continue;
    if (machine.flag(section_of(channel), "gantry").value_or(false))
      return data_error(machine.where(section_of(channel), "gantry") +
                        ": a cut is not simulated on a gantry; leave 'gantry' out and give the "
                        "constant of both motors together");
    auto config = drive_simulation(machine, channel);
    if (!config) return config.error();
    *drive = std::move(*config);
  }
  CutProgram& p = s.program;
  p.cut_s = cut_s;
  p.dwell_s = 0.2;
  if (s.spindle) p.spindle_acceleration_rad_s2 = 2000;
  p.feed_acceleration_m_s2 = 1;
  p.feed_jerk_m_s3 = 50;
  if (s.milling.start == MillingStart::entry) {
    // Enough air for the feed to come up, and for a look at it.
    const double first_rpm = s.milling.speed.points.empty() ? s.milling.cut.spindle_speed_rpm
                                                            : s.milling.speed.speed_rpm(0);
    const double feed = first_rpm / 60 * s.milling.tool.teeth * s.milling.cut.feed_per_tooth_m;
    s.milling.clearance_m =
        feed * (feed / p.feed_acceleration_m_s2 + 2 * std::sqrt(feed / p.feed_jerk_m_s3) +
                p.feed_acceleration_m_s2 / p.feed_jerk_m_s3 + 0.1);
  }
  return s;
}

Expected<std::vector<CrossTalk>> cross_talk_of(const MachineFile& machine, Channel channel) {
  const std::string section = "effect." + std::string(name_of(channel)) + ".cross-talk";
  if (!machine.has_section(section)) return std::vector<CrossTalk>{};
  CrossTalk talk;
  if (auto done = require(machine, section, {{"coefficient", &talk.coefficient}}); !done)
    return done.error();
  const auto other = channel_from(machine.text(section, "other_channel").value_or(""));
  if (!other || *other == channel)
    return wrong_at(machine, section, "other_channel",
                    "other_channel must name another drive than " + std::string(name_of(channel)));
  talk.from = *other;
  const auto of = machine.text(section, "of");
  if (of)
    talk.of = static_cast<CrossTalkOf>(std::ranges::find(kCrossTalkOf, *of) - kCrossTalkOf.begin());
  return std::vector<CrossTalk>{talk};
}

}  // namespace servosense
