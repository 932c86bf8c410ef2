#include "servosense/monitors/stack_config.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <type_traits>
#include <utility>

#include "coefficients_plan.hpp"
#include "collision_reason.hpp"
#include "printed.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/monitors/collision_keys.hpp"
#include "servosense/monitors/learned_under.hpp"
#include "servosense/observer/machine_config.hpp"
#include "stack_refusal.hpp"
#include "torque_band_plan.hpp"

namespace servosense {
namespace {

// Koike 2016, table 3-3.
constexpr double kCollisionCutoff_rad_s = 335;
constexpr double kChatterCutoff_rad_s = 3500;
// Three samples at this rate last 6 ms: slower, a contact is over before it is confirmed.
constexpr double kCollisionLeastRate_hz = 500;
// 8 kHz and its rounding: from there on drill fracture, wear and torque band make do with half, and
// the monitors may hear of groups of samples.
constexpr double kHalfRateFrom_hz = 7999;
// A chatter window wants several harmonics of a spindle at 3000 rpm and more below half the rate.
constexpr double kChatterLeastRate_hz = 500;
// Ranges of the blocks (angle_sampler.hpp, chatter.hpp): samples a tooth, and a turn.
constexpr double kSamplesATooth = 8;
constexpr double kChatterSamplesATooth = 3;
constexpr double kSamplesATurn = 8;
// Where no speed of the cut is stated, a breakage monitor has to follow this one at least.
// Convention: below it mill cutters of 0.1 m and more.
constexpr double kSlowCut_rpm = 600;
// A hole takes seconds: a drill that is judged later is judged too late. Convention.
constexpr double kDrillLatest_s = 5;
constexpr double kDrillAverage = 64;  // samples of its mean (drill_fracture.hpp)

constexpr const char* kRatio = "no scale is published for the ";

ObserverCutoffs limited(ObserverCutoffs cutoffs, double period, const std::string& what,
                        std::vector<std::string>& remarks) {
  const double highest = highest_cutoff_rad_s(period);
  const double asked = std::max(cutoffs.disturbance_cutoff_rad_s, cutoffs.velocity_cutoff_rad_s);
  if (asked > highest)
    remarks.push_back(what + ": cutoff lowered from " + printed(asked) + " to " + printed(highest) +
                      " rad/s, the highest that a sample rate of " + printed(1 / period) +
                      " Hz supports");
  cutoffs.disturbance_cutoff_rad_s = std::min(cutoffs.disturbance_cutoff_rad_s, highest);
  cutoffs.velocity_cutoff_rad_s = std::min(cutoffs.velocity_cutoff_rad_s, highest);
  return cutoffs;
}

ObserverCutoffs own_cutoffs(const MachineFile& machine, const std::string& section,
                            double standard) {
  const double g = machine.number(section, "cutoff_rad_s").value_or(standard);
  return {g, g};
}

/// Takes out the effects that are kept from the monitors; their sections, for a remark.
std::string leave_out_effects(const MachineFile& machine, Channel channel,
                              DriveEffectsConfig& effects) {
  std::string sections;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < effects.count; ++i) {
    const std::string section = "effect." + std::string(name_of(channel)) + "." +
                                std::string(kDriveEffects[effects.settings[i].effect].name);
    if (machine.flag(section, "used_by_monitors").value_or(true)) {
      effects.settings[kept++] = effects.settings[i];
      continue;
    }
    sections += (sections.empty() ? "[" : ", [") + section + "]";
  }
  effects.count = kept;
  return sections;
}

/// The same, and those of a current where the drive reports another effort, said.
void leave_out_effects(const MachineFile& machine, Channel channel, EffortKind effort,
                       DriveEffectsConfig& effects, std::vector<std::string>& remarks) {
  if (std::string said = leave_out_effects_of_current(channel, effort, effects); !said.empty())
    remarks.push_back(std::move(said));
  const std::string sections = leave_out_effects(machine, channel, effects);
  if (!sections.empty())
    remarks.push_back(sections + ": kept from the monitors (used_by_monitors = no)");
}

bool states_observer(const MachineFile& machine, Channel channel) {
  return machine.has_section("observer." + std::string(name_of(channel)));
}

/// Of the observer that a spindle's monitors listen to; `stated` are those of its [observer...].
ObserverCutoffs chatter_cutoffs(const MachineFile& machine, Channel spindle,
                                const ObserverCutoffs& stated) {
  const std::string section = monitor_section(MonitorId::chatter, spindle);
  if (states_observer(machine, spindle) && !machine.has(section, "cutoff_rad_s")) return stated;
  return own_cutoffs(machine, section, kChatterCutoff_rad_s);
}

/// The sentence for a drive whose signals the machine file cannot scale; empty when it can.
std::string unusable(const MachineFile& machine, Channel channel, DriveSignal signal) {
  const std::string section(section_of(channel));
  const bool linear = is_linear_axis(channel);
  if (!machine.has_section(section))
    return "the trace has this drive but " + machine.name() + " has no section [" + section +
           "]; add it";
  if (signal.motion == MotionKind::counts && !machine.has(section, "encoder_counts_per_rev"))
    return machine.where(section) + ": [" + section +
           "] needs encoder_counts_per_rev to read the encoder counts of the trace";
  if (linear && signal.motion == MotionKind::counts && !machine.has(section, "lead_m"))
    return machine.where(section) + ": [" + section +
           "] needs lead_m to turn encoder counts into metres";
  if (linear && signal.effort == EffortKind::torque_Nm && !machine.has(section, "lead_m"))
    return machine.where(section) + ": [" + section +
           "] needs lead_m to turn the motor torque of the trace into a force";
  if (signal.effort == EffortKind::current_A && !machine.has(section, "torque_constant_Nm_per_A") &&
      !(linear && machine.has(section, "force_constant_N_per_A")))
    return machine.where(section) + ": [" + section +
           "] needs torque_constant_Nm_per_A to turn the current of the trace into a torque";
  return {};
}

bool enabled(const MachineFile& machine, const std::string& section) {
  return machine.flag(section, "enabled").value_or(true);
}

/// What keeps a monitor from running; nothing when it can.
struct Obstacle {
  std::string word;
  std::string sentence;
  [[nodiscard]] bool none() const { return word.empty(); }
};

void keep_from(MonitorAvailability& m, Obstacle obstacle) {
  m.runs = false;
  m.obstacle = std::move(obstacle.word);
  m.reason = std::move(obstacle.sentence);
}

/// Of a threshold that was learned under other conditions than those of the plan.
Obstacle elsewhere(const MachineFile& machine, const StackPlan& plan, MonitorId monitor,
                   Channel channel) {
  std::string sentence = learned_elsewhere(machine, plan.stack_of(channel), monitor, channel);
  return {sentence.empty() ? "" : "other conditions", std::move(sentence)};
}

/// Said of a monitor that runs all the same.
std::string unknown_conditions(const MachineFile& machine, MonitorId monitor, Channel channel) {
  return states_conditions(machine, monitor, channel)
             ? ""
             : "; the machine file does not say what its threshold was learned under: set by hand?";
}

Obstacle no_spindle() {
  return {"no signals", "needs the spindle's angle or speed and its current or torque"};
}
std::string no_axis(Channel axis) {
  return is_turning(axis)
             ? "needs the axis's angle or speed and its current or torque"
             : "needs the axis's position or velocity and its current, torque or force";
}

CutDetectorConfig cut_config(double period) {
  CutDetectorConfig cut;
  cut.sample_period_s = period;
  cut.cutoff_rad_s = std::min(cut.cutoff_rad_s, 0.05 / period);
  return cut;
}
Obstacle switched_off() { return {"switched off", "switched off in the machine file"}; }

ChatterConfig chatter_config(const MachineFile& machine, Channel spindle, double period) {
  const std::string section = monitor_section(MonitorId::chatter, spindle);
  ChatterConfig c;
  c.sample_period_s = period;
  auto take = [&](const char* key, auto& to) {
    if (const auto value = machine.number(section, key))
      to = static_cast<std::remove_reference_t<decltype(to)>>(*value);
  };
  take("harmonics", c.harmonics);
  take("chatter_threshold_Nm2", c.chatter_threshold_Nm2);
  take("forced_threshold_Nm2", c.forced_threshold_Nm2);
  take("warning_fraction", c.warning_fraction);
  take("consecutive_revolutions", c.consecutive_revolutions);
  take("minimum_speed_rad_s", c.minimum_speed_rad_s);
  c.release_fraction = std::min(c.release_fraction, c.warning_fraction);
  // The block wants to see more than eight samples a turn.
  c.minimum_speed_rad_s = std::min(c.minimum_speed_rad_s, 0.5 / period);
  if (spindle == tool_spindle(machine)) {
    if (const auto teeth = machine.number("tool", "teeth")) c.teeth = static_cast<unsigned>(*teeth);
    if (c.teeth > HostStack::Chatter::kParts) c.teeth = 0;
    c.cutting_torque_Nm = machine.number("monitor.collision", "cutting_torque_Nm").value_or(0);
  }
  ChatterWindowChoice window;
  window.sample_period_s = period;
  window.slowest_rad_s = c.minimum_speed_rad_s;
  window.teeth = c.teeth;
  window.harmonics = c.harmonics;
  window.consecutive_revolutions = c.consecutive_revolutions;
  window.most = kHostRevolutions;
  c.window_revolutions = chatter_window_revolutions(window);
  take("window_revolutions", c.window_revolutions);
  return c;
}

/// At which speeds it listens, and how high the lags of its observer let it hear: half is left.
std::string chatter_listens(const ChatterConfig& c, const DisturbanceObserverConfig& observer) {
  const double fastest =
      60 / c.sample_period_s / std::max(kSamplesATurn, kChatterSamplesATooth * c.teeth);
  const double half_hz =
      std::min(observer.disturbance_cutoff_rad_s, observer.velocity_cutoff_rad_s) / kTwoPi;
  return "listens from " + printed(rpm_from_rad_s(c.minimum_speed_rad_s)) + " to " +
         printed(fastest) + " rpm, up to " + printed(half_hz) + " Hz (half is left there)";
}

CollisionConfig collision_config(const MachineFile& machine, Channel axis, double period,
                                 double cutoff_rad_s) {
  const CollisionKeys keys(axis);
  const std::string& section = keys.section;
  CollisionConfig c = collision_defaults(is_turning(axis));
  c.sample_period_s = period;
  c.cutoff_rad_s = cutoff_rad_s;
  c.threshold_N_per_s = machine.number(section, keys.threshold)
                            .value_or(machine.number(section, "threshold_N_per_s").value_or(0));
  if (const auto thresholds = machine.list(section, keys.phase_thresholds))
    std::copy_n(thresholds->begin(), std::min(thresholds->size(), kMotionPhases),
                c.phase_threshold_N_per_s.begin());
  c.accelerating_m_s2 = machine.number(section, keys.accelerating).value_or(c.accelerating_m_s2);
  c.cutting_threshold_N_per_s = machine.number(section, keys.cutting_threshold).value_or(0);
  c.maximum_feed_m_s = machine.number(section, keys.maximum_feed).value_or(c.maximum_feed_m_s);
  c.resonance_hz = machine.number(section, keys.resonance).value_or(0);
  c.warning_fraction = machine.number(section, "warning_fraction").value_or(c.warning_fraction);
  c.release_fraction = std::min(c.release_fraction, c.warning_fraction);
  c.consecutive_samples = static_cast<unsigned>(
      machine.number(section, "consecutive_samples").value_or(c.consecutive_samples));
  c.release_samples = static_cast<unsigned>(std::max(1.0, 0.1 / period));
  if (const auto notches = machine.list(section, "notch_hz")) {
    c.notch_hz = {0, 0};
    for (std::size_t i = 0; i < std::min(notches->size(), c.notch_hz.size()); ++i)
      c.notch_hz[i] = (*notches)[i];
  }
  return c;
}

SignalHealthConfig signal_config(const MachineFile& machine, Channel channel, double period,
                                 double effort_per_ampere) {
  SignalHealthConfig c;
  const char* section = "monitor.signal";
  c.tolerated_share = machine.number(section, "tolerated_share").value_or(c.tolerated_share);
  // 0.2 s of equal values, 1 s of memory, at any rate.
  const auto samples = [&](double seconds) {
    return static_cast<unsigned>(std::max(8.0, seconds / period));
  };
  c.frozen_samples = samples(0.2);
  if (const auto n = machine.number(section, "frozen_samples"))
    c.frozen_samples = static_cast<unsigned>(*n);
  c.window_samples = c.release_samples = samples(1);
  c.saturated_samples = samples(0.01);
  const std::string controller = "controller." + std::string(name_of(channel));
  if (const auto limit = machine.number(controller, "current_limit_A"))
    c.effort_limit = std::abs(*limit * effort_per_ampere) *
                     (machine.flag(section_of(channel), "gantry").value_or(false) ? 2 : 1);
  return c;
}

MonitorAvailability signal_availability(const MachineFile& machine, Channel channel,
                                        SignalHealthConfig& config) {
  MonitorAvailability m{MonitorId::signal, channel, enabled(machine, "monitor.signal"),
                        "watches for gaps, jumps, frozen and saturated signals", ""};
  if (!m.runs) {
    keep_from(m, switched_off());
    config.enabled = false;
  }
  return m;
}

/// The monitors of the tool, as far as machine file and signals allow.
Expected<Done> plan_tool(const MachineFile& machine, const StackSignals& signals, StackPlan& plan) {
  const double period = signals.sample_period_s;
  HostStackConfig& config = plan.config;
  ToolMonitorsConfig& tool = config.tool;
  const bool spindle = config.spindle.present;
  const auto teeth = static_cast<unsigned>(machine.number("tool", "teeth").value_or(0));
  const auto number = [&](const std::string& section, const char* key, double& to) {
    if (const auto value = machine.number(section, key)) to = *value;
  };
  const auto whole = [&](const std::string& section, const char* key, unsigned& to) {
    if (const auto value = machine.number(section, key)) to = static_cast<unsigned>(*value);
  };
  const auto plan_one = [&](MonitorId id, const std::string& section, const Obstacle& missing,
                            const std::string& watches) {
    MonitorAvailability m{id, Channel::tool, true, watches, ""};
    if (!enabled(machine, section))
      keep_from(m, switched_off());
    else if (!missing.none())
      keep_from(m, missing);
    else if (id == MonitorId::ar_breakage || id == MonitorId::tooth_breakage)
      m.reason += unknown_conditions(machine, id, Channel::tool);
    plan.monitors.push_back(m);
    return m.runs;
  };
  const double fastest_rpm =
      teeth > 0 ? 60 / (kSamplesATooth * period * teeth) : 60 / (kSamplesATurn * period);
  const std::string up_to = ", up to " + printed(fastest_rpm) + " rpm";
  const auto breakage_lacks = [&](MonitorId id, bool noise, const char* key) -> Obstacle {
    if (!spindle) return no_spindle();
    if (teeth < 2) return {"no teeth", "needs a tool of two teeth or more; write teeth in [tool]"};
    if (teeth > kHostTeeth)
      return {"too many teeth", "has room for " + std::to_string(kHostTeeth) + " teeth"};
    const double cut_rpm = machine.number("cut", "spindle_speed_rpm").value_or(kSlowCut_rpm);
    if (fastest_rpm < cut_rpm)
      return {"slow signal", "needs at least " + printed(kSamplesATooth * teeth * cut_rpm / 60) +
                                 " Hz for " + std::to_string(teeth) + " teeth at " +
                                 printed(cut_rpm) + " rpm, eight samples a tooth; the signal has " +
                                 printed(1 / period) + " Hz"};
    if (!noise)
      return {"no threshold", std::string("has not learned its noise; run 'servosense identify "
                                          "idle' with [tool] teeth, or write ") +
                                  key};
    return elsewhere(machine, plan, id, Channel::tool);
  };

  std::string section = "monitor.ar-breakage";
  tool.ar_breakage.sample_period_s = period;
  tool.ar_breakage.teeth = teeth;
  number(section, "noise_Nm", tool.ar_breakage.noise_Nm);
  number(section, "share_threshold", tool.ar_breakage.share_threshold);
  number(section, "warning_fraction", tool.ar_breakage.warning_fraction);
  tool.ar_breakage_on =
      plan_one(MonitorId::ar_breakage, section,
               breakage_lacks(MonitorId::ar_breakage, machine.has(section, "noise_Nm"),
                              "noise_Nm in [monitor.ar-breakage]"),
               "watches the torque of " + std::to_string(teeth) + " teeth" + up_to);

  section = "monitor.tooth-breakage";
  const bool force = machine.text(section, "signal").value_or("torque") == "force";
  ToothBreakageConfig& t = tool.tooth_breakage;
  t.sample_period_s = period;
  t.teeth = teeth;
  t.torque = !force;
  number(section, force ? "noise_N" : "noise_Nm", t.noise);
  number(section, force ? "sample_noise_N" : "sample_noise_Nm", t.sample_noise);
  number(section, "tolerated_throw", t.tolerated_throw);
  number(section, "swept_angle_rad", t.swept_angle_rad);
  number(section, "warning_fraction", t.warning_fraction);
  Obstacle missing = breakage_lacks(
      MonitorId::tooth_breakage, machine.has(section, force ? "noise_N" : "noise_Nm"),
      force ? "noise_N in [monitor.tooth-breakage]" : "noise_Nm in [monitor.tooth-breakage]");
  if (missing.none() && force && !(config.axis[0].present && config.axis[1].present))
    missing = {"no signals",
               "needs both x and y; write signal = torque in [monitor.tooth-breakage]"};
  tool.tooth_breakage_on =
      plan_one(MonitorId::tooth_breakage, section, missing,
               std::string("watches the ") + (force ? "forces of x and y" : "torque") + " of " +
                   std::to_string(teeth) + " teeth" + up_to);

  // Forces beyond some hundred hertz do not reach these three.
  tool.half_rate = 1 / period >= kHalfRateFrom_hz && !(tool.tooth_breakage_on && force);
  const double pace = tool.half_rate ? 2 * period : period;
  for (HostAxisSlotConfig& slot : config.axis) slot.tool_observer.sample_period_s = pace;

  section = "monitor.drill-fracture";
  DrillFractureConfig& d = tool.drill_fracture;
  d.sample_period_s = pace;
  number(section, "threshold_N", d.threshold_N);
  number(section, "drilling_thrust_N", d.drilling_thrust_N);
  number(section, "entry_s", d.entry_s);
  number(section, "average_s", d.average_s);
  number(section, "warning_fraction", d.warning_fraction);
  whole(section, "window_samples", d.window_samples);
  if (tool.half_rate) d.window_samples = (d.window_samples + 1) / 2;
  if (machine.text(section, "rotation").value_or("clockwise") == "counter-clockwise")
    d.rotation = Rotation::counter_clockwise;
  // Three turns in the window, as the block wants.
  d.minimum_speed_rad_s = 3 * kTwoPi / (d.window_samples * pace);
  const double first_s = d.window_samples * pace + d.entry_s + d.average_s;
  const double drill_hz =
      std::max(d.window_samples / std::max(0.5, kDrillLatest_s - d.entry_s - d.average_s),
               kDrillAverage / d.average_s);
  missing =
      !spindle ? no_spindle()
      : !(config.axis[0].present && config.axis[1].present)
          ? Obstacle{"no signals", "needs x and y, each with position and current"}
      : !(d.threshold_N > 0)
          ? Obstacle{"no threshold",
                     "has no threshold; write threshold_N in [monitor.drill-fracture], 1.5 "
                     "times what intact drills show"}
      : 1 / pace < drill_hz
          ? Obstacle{"slow signal", "needs at least " + printed(drill_hz) +
                                        " Hz to tell of a hole within " + printed(kDrillLatest_s) +
                                        " s, or fewer window_samples; the signal has " +
                                        printed(1 / pace) + " Hz"}
          : Obstacle{};
  tool.drill_fracture_on =
      plan_one(MonitorId::drill_fracture, section, missing,
               "fires on a rotating force of " + printed(d.threshold_N) + " N from " +
                   printed(rpm_from_rad_s(d.minimum_speed_rad_s)) + " to " +
                   printed(60 / (kSamplesATurn * pace)) + " rpm, first after " + printed(first_s) +
                   " s of a hole");

  section = "monitor.wear";
  WearConfig& w = tool.wear;
  w.sample_period_s = pace;
  w.part_s = std::max(w.part_s, 8 * pace);
  if (config.axis[2].present) w.equivalent_mass_kg = config.axis[2].observer.drive.inertia;
  if (spindle) w.inertia_kg_m2 = config.spindle.observer.drive.inertia;
  if (const auto direction = machine.number(section, "feed_direction"))
    w.feed_direction = static_cast<int>(*direction);
  for (const auto& [key, to] :
       {std::pair{"cutting_thrust_N", &w.cutting_thrust_N},
        std::pair{"cutting_torque_Nm", &w.cutting_torque_Nm},
        std::pair{"thrust_limit_N", &w.thrust_limit_N},
        std::pair{"thrust_step_N", &w.thrust_step_N}, std::pair{"thrust_ratio", &w.thrust_ratio},
        std::pair{"torque_limit_Nm", &w.torque_limit_Nm},
        std::pair{"torque_step_Nm", &w.torque_step_Nm}, std::pair{"torque_ratio", &w.torque_ratio},
        std::pair{"entry_m", &w.entry_m}, std::pair{"exit_m", &w.exit_m},
        std::pair{"shortest_m", &w.shortest_m}, std::pair{"clearance_m", &w.clearance_m},
        std::pair{"peck_window_s", &w.peck_window_s},
        std::pair{"maximum_feed_m_s", &w.maximum_feed_m_s},
        std::pair{"minimum_speed_rad_s", &w.minimum_speed_rad_s},
        std::pair{"friction_error_N", &w.friction_error_N},
        std::pair{"friction_drift_N", &w.friction_drift_N},
        std::pair{"friction_noise_N", &w.friction_noise_N},
        std::pair{"warning_fraction", &w.warning_fraction}})
    number(section, key, *to);
  whole(section, "teach_holes", w.teach_holes);
  whole(section, "average_holes", w.average_holes);
  whole(section, "confirm_holes", w.confirm_holes);
  const auto taught = [&](const char* mean, const char* scatter) {
    std::optional<std::array<double, 2>> values;
    if (const auto value = machine.number(section, mean))
      values = {*value, machine.number(section, scatter).value_or(0)};
    return values;
  };
  plan.taught_thrust_N = taught("taught_thrust_N", "taught_thrust_scatter_N");
  plan.taught_torque_Nm = taught("taught_torque_Nm", "taught_torque_scatter_Nm");
  const bool rules = w.thrust_limit_N > 0 || w.thrust_step_N > 0 || w.thrust_ratio > 0 ||
                     w.torque_limit_Nm > 0 || w.torque_step_Nm > 0 || w.torque_ratio > 0;
  missing =
      !spindle                  ? no_spindle()
      : !config.axis[2].present ? Obstacle{"no signals", "needs z, with position and current"}
      : !(w.cutting_thrust_N > 0 || w.cutting_torque_Nm > 0)
          ? Obstacle{"no threshold",
                     "does not know what cutting is; write cutting_thrust_N in [monitor.wear]"}
      : !rules ? Obstacle{"no threshold",
                          "has no rule; write thrust_limit_N, thrust_step_N or the like in "
                          "[monitor.wear]"}
               : Obstacle{};
  tool.wear_on = plan_one(MonitorId::wear, section, missing,
                          "compares every hole with the first " + std::to_string(w.teach_holes));

  const auto lacks = plan_torque_band(machine, pace, signals, plan);
  if (!lacks) return lacks.error();
  tool.torque_band_on =
      plan_one(MonitorId::torque_band, "monitor.torque-band",
               lacks->has_value() ? Obstacle{"no reference", **lacks} : Obstacle{},
               torque_band_watches(plan, signals));
  return Done{};
}

void say_share(const MachineFile& machine, Channel channel, StackPlan& plan) {
  if (EffortShare share = effort_share(machine, channel); !share.said.empty())
    plan.remarks.push_back(std::move(share.said));
}

Expected<Done> plan_spindle(const MachineFile& machine, Channel channel, DriveSignal signal,
                            double period, StackPlan& plan) {
  const std::string section = monitor_section(MonitorId::chatter, channel);
  const std::string name(name_of(channel));
  auto spindle = spindle_config(machine, channel);
  if (!spindle) return spindle.error();
  spindle->effort_is_current = signal.effort == EffortKind::current_A;
  leave_out_effects(machine, channel, signal.effort, spindle->effects, plan.remarks);
  say_share(machine, channel, plan);
  const bool stated = states_observer(machine, channel);
  if (!stated) spindle->observer = own_cutoffs(machine, section, kChatterCutoff_rad_s);
  if (machine.flag(name, "current_is_ratio").value_or(false))
    plan.remarks.push_back(kRatio + name + "'s current: its torques are ratios, not Nm");
  HostStackConfig& config = channel == plan.tool_spindle ? plan.config : plan.second.emplace();
  HostSpindleSlotConfig& slot = config.spindle;
  slot.present = true;
  if (spindle->effort_is_current)
    plan.torque_constant_known_to_rad_s[channel == Channel::spindle2 ? 1 : 0] =
        rad_s_from_rpm(machine.number(name, "torque_constant_known_to_rpm").value_or(0));
  slot.input = spindle->input(signal, period);
  slot.input.watch_effort = true;
  slot.observer =
      spindle->disturbance_observer(period, limited(spindle->observer, period, name, plan.remarks));
  // Without a cutoff of its own the monitor shares the observer.
  slot.monitor_observer = slot.observer;
  if (machine.has(section, "cutoff_rad_s") && stated)
    slot.monitor_observer = spindle->disturbance_observer(
        period, limited(own_cutoffs(machine, section, kChatterCutoff_rad_s), period,
                        "chatter on " + name, plan.remarks));
  slot.chatter = chatter_config(machine, channel, period);
  slot.signal = signal_config(machine, channel, period, slot.input.effort_per_unit);
  const double rate = 1 / period;
  MonitorAvailability chatter{MonitorId::chatter, channel, true,
                              chatter_listens(slot.chatter, slot.monitor_observer), ""};
  if (!enabled(machine, section))
    keep_from(chatter, switched_off());
  else if (rate < kChatterLeastRate_hz)
    keep_from(chatter, {"slow signal", "needs at least " + printed(kChatterLeastRate_hz) +
                                           " Hz, the signal has " + printed(rate) + " Hz"});
  else if (!(slot.chatter.chatter_threshold_Nm2 > 0))
    keep_from(chatter, {"no threshold",
                        "has no threshold; run 'servosense identify idle' or write "
                        "chatter_threshold_Nm2 in [" +
                            section + "]"});
  else if (!(slot.observer.drive.inertia > 0))
    keep_from(chatter,
              {"no inertia",
               "would take every acceleration for a cut; run 'servosense identify idle' or "
               "write inertia_kg_m2 in [" +
                   name + "]"});
  else if (Obstacle other = elsewhere(machine, plan, MonitorId::chatter, channel); !other.none())
    keep_from(chatter, std::move(other));
  else
    chatter.reason += unknown_conditions(machine, MonitorId::chatter, channel);
  slot.chatter_on = chatter.runs;
  if (!chatter.runs) slot.chatter.chatter_threshold_Nm2 = slot.chatter.forced_threshold_Nm2 = 0;
  // The usual minimum speed is more than a slow signal can follow; it must not cost the estimate.
  if (rate < kChatterLeastRate_hz)
    slot.chatter.minimum_speed_rad_s = std::min(slot.chatter.minimum_speed_rad_s, 0.1 * rate);
  plan.monitors.push_back(chatter);
  plan.monitors.push_back(signal_availability(machine, channel, slot.signal));
  return Done{};
}

Expected<Done> plan_axis(const MachineFile& machine, Channel channel, DriveSignal signal,
                         double period, StackPlan& plan) {
  const CollisionKeys keys(channel);
  const std::string& section = keys.section;
  const bool turns = is_turning(channel);
  auto axis = drive_config(machine, channel);
  if (!axis) return axis.error();
  axis->reports(signal.effort);
  leave_out_effects(machine, channel, signal.effort, axis->effects(), plan.remarks);
  say_share(machine, channel, plan);
  const std::string name{name_of(channel)}, own_section{section_of(channel)};
  if (machine.flag(own_section, "current_is_ratio").value_or(false))
    plan.remarks.push_back(kRatio + name + " current: its " +
                           (turns ? "torques are ratios, not Nm" : "forces are ratios, not N"));
  HostAxisSlotConfig& slot = plan.config.axis[axis_index(channel)];
  slot.present = true;
  slot.input = axis->input(signal, period);
  slot.input.watch_effort = true;
  // Where nothing is stated, the estimate that is reported is the one the monitor listens to.
  const bool stated = states_observer(machine, channel);
  const ObserverCutoffs own = limited(own_cutoffs(machine, section, kCollisionCutoff_rad_s), period,
                                      stated ? "collision on " + name : name, plan.remarks);
  slot.monitor_observer = axis->disturbance_observer(period, own);
  slot.collision = collision_config(machine, channel, period, own.disturbance_cutoff_rad_s);
  // Along the spindle torque does not bound the force, and a slower torque would come too late.
  const double torque_rad_s = plan.config.spindle.monitor_observer.disturbance_cutoff_rad_s;
  if (!turns && channel != Channel::z && plan.config.spindle.present &&
      torque_rad_s >= 2 * own.disturbance_cutoff_rad_s)
    slot.collision.tool_radius_m = machine.number("tool", "diameter_m").value_or(0) / 2;
  slot.collision.friction_N = slot.monitor_observer.drive.coulomb;
  slot.signal = signal_config(machine, channel, period, slot.input.effort_per_unit);
  const double high = std::min(kChatterCutoff_rad_s, highest_cutoff_rad_s(period));
  slot.tool_observer = axis->disturbance_observer(period, {high, high});
  slot.observer = stated ? axis->disturbance_observer(
                               period, limited(axis->observer(), period, name, plan.remarks))
                         : slot.monitor_observer;
  const double rate = 1 / period;
  const bool slow = rate < kCollisionLeastRate_hz;
  MonitorAvailability collision{MonitorId::collision, channel, true, "", ""};
  if (!enabled(machine, section)) {
    keep_from(collision, switched_off());
  } else if (slow && !machine.flag(section, "slow_signal").value_or(false)) {
    keep_from(collision, {"slow signal", "needs at least " + printed(kCollisionLeastRate_hz) +
                                             " Hz to confirm a contact in time, the signal has " +
                                             printed(rate) + " Hz; slow_signal = yes in [" +
                                             section + "] makes it run all the same"});
  } else if (!(slot.collision.threshold_N_per_s > 0)) {
    keep_from(collision,
              {"no threshold", "has no threshold; run 'servosense identify idle' or write " +
                                   keys.threshold + " in [" + section + "]"});
  } else if (!(slot.observer.drive.inertia > 0)) {
    keep_from(collision, {"no inertia",
                          "would take every acceleration for a contact; run 'servosense identify "
                          "idle' or write " +
                              std::string(turns ? "inertia_kg_m2" : "equivalent_mass_kg") +
                              " in [" + own_section + "]"});
  } else if (Obstacle other = elsewhere(machine, plan, MonitorId::collision, channel);
             !other.none()) {
    keep_from(collision, std::move(other));
  } else {
    const unsigned samples = slot.collision.consecutive_samples;
    collision.reason = "fires on " + std::to_string(samples) + " samples beyond " +
                       printed(slot.collision.threshold_N_per_s) + (turns ? " Nm/s" : " N/s");
    if (slow)
      collision.reason += ", which takes " + printed(1e3 * samples * period) + " ms after some " +
                          printed(2e3 / own.disturbance_cutoff_rad_s) + " ms of its filters at " +
                          printed(rate) + " Hz";
    collision.reason += collision_in_the_cut(plan.config, slot.collision, turns);
    collision.reason += unknown_conditions(machine, MonitorId::collision, channel);
  }
  slot.collision_on = collision.runs;
  if (!collision.runs) slot.collision.threshold_N_per_s = 0;
  plan.monitors.push_back(collision);
  plan.monitors.push_back(signal_availability(machine, channel, slot.signal));
  return Done{};
}

// The monitors hear of groups of samples, where the rate and what runs allow.
void plan_groups(StackPlan& plan, double period) {
  const ToolMonitorsConfig& tool = plan.config.tool;
  const char* against = 1 / period < kHalfRateFrom_hz ? "the signal is slower than 8 kHz"
                        : tool.tooth_breakage_on && !tool.tooth_breakage.torque
                            ? "tooth breakage watches the forces of x and y"
                            : nullptr;
  if (against != nullptr) {
    plan.remarks.push_back(std::string("grouped_monitors is not used: ") + against);
    return;
  }
  plan.grouped = true;
  plan.remarks.push_back(
      "monitors hear of 2 samples of the spindle and of 4 of an axis as of one: chatter up to " +
      printed(0.25 / period) + " Hz");
}

/// Of a spindle whose friction the file has followed.
void plan_follower(const MachineFile& machine, double period, StackPlan& plan) {
  constexpr const char* kSection = "observer.spindle";
  const auto share = machine.number(kSection, "follow_friction_share");
  if (!share || plan.slot_of(Channel::spindle) == nullptr) return;
  const std::string name = machine.where(kSection) + ": follow_friction_share ";
  if (plan.tool_spindle != Channel::spindle) {
    plan.remarks.push_back(name +
                           "is not used: the tool is on the other spindle, and its torque alone "
                           "tells a cut from the air");
    return;
  }
  const DriveModelConfig& drive = plan.config.spindle.observer.drive;
  FrictionFollowerConfig follow;
  follow.sample_period_s = period;
  follow.viscous = drive.viscous;
  follow.coulomb = drive.coulomb;
  follow.share = *share;
  follow.cutting_torque_Nm = plan.config.cut.torque_Nm;
  if (!(follow.cutting_torque_Nm > 0)) {
    plan.remarks.push_back(name +
                           "is not used: [monitor.collision] lacks cutting_torque_Nm, which tells "
                           "a cut from the air; run 'servosense identify idle' on an idling run");
    return;
  }
  for (const char* shared : {"backlash", "flexible-coupling"})
    if (drive.effects.find(shared) != nullptr) {
      plan.remarks.push_back(name + "is not used: the effect " + shared +
                             " shares the friction out between motor and load");
      return;
    }
  if (const Status s = FrictionFollower<double>::validate(follow); !s.ok()) {
    plan.remarks.push_back(name + "is not used: " + s.parameter() + " " + s.reason());
    return;
  }
  FrictionFollower<double> follower;
  follower.configure(follow);
  plan.follow = follow;
  plan.remarks.push_back("spindle: friction is followed as it warms up, by up to " +
                         printed(100 * follow.share) +
                         " % of the machine file's; of a cut, at most " +
                         printed(follower.gate_Nm()) + " Nm is taken for friction");
}

/// What the file holds for others: simulators and reconcile know more effects than observers do.
void say_unused(const MachineFile& machine, StackPlan& plan) {
  constexpr std::string_view kPrefix = "effect.";
  for (const std::string& section : machine.sections()) {
    if (!section.starts_with(kPrefix)) continue;
    const std::size_t dot = section.find('.', kPrefix.size());
    const auto channel = channel_from(section.substr(kPrefix.size(), dot - kPrefix.size()));
    if (!channel || !is_drive(*channel) ||
        drive_effect_index(section.substr(dot + 1)) == kDriveEffectCount)
      plan.remarks.push_back("[" + section +
                             "] is not used: no monitor's model has such an effect");
  }
}

}  // namespace

Expected<DisturbanceObserverConfig> monitor_observer(const MachineFile& machine, Channel channel,
                                                     EffortKind effort, double sample_period_s) {
  std::vector<std::string> unsaid;
  const std::string name{name_of(channel)};
  if (is_spindle(channel)) {
    auto spindle = spindle_config(machine, channel);
    if (!spindle) return spindle.error();
    spindle->effort_is_current = effort == EffortKind::current_A;
    leave_out_effects(machine, channel, effort, spindle->effects, unsaid);
    return spindle->disturbance_observer(
        sample_period_s, limited(chatter_cutoffs(machine, channel, spindle->observer),
                                 sample_period_s, name, unsaid));
  }
  auto axis = drive_config(machine, channel);
  if (!axis) return axis.error();
  axis->reports(effort);
  leave_out_effects(machine, channel, effort, axis->effects(), unsaid);
  return axis->disturbance_observer(
      sample_period_s, limited(own_cutoffs(machine, monitor_section(MonitorId::collision, channel),
                                           kCollisionCutoff_rad_s),
                               sample_period_s, name, unsaid));
}

const HostDriveSlotConfig* StackPlan::slot_of(Channel drive) const {
  if (drive == other_spindle(tool_spindle) && !second) return nullptr;
  const HostDriveSlotConfig& slot =
      is_spindle(drive) ? static_cast<const HostDriveSlotConfig&>(stack_of(drive).spindle)
                        : config.axis[axis_index(drive)];
  return slot.present ? &slot : nullptr;
}

Expected<StackPlan> plan_stack(const MachineFile& machine, const StackSignals& signals) {
  StackPlan plan;
  plan.tool_spindle = tool_spindle(machine);
  const double period = signals.sample_period_s;
  std::string first_obstacle;
  bool any = false;  // in the first stack
  auto obstacle = [&](MonitorId monitor, Channel channel, const std::string& reason) {
    if (first_obstacle.empty()) first_obstacle = reason;
    plan.monitors.push_back({monitor, channel, false, reason, "incomplete machine file"});
  };
  plan.config.cut.unseen = machine.has_section(name_of(plan.tool_spindle));
  const auto reports_nothing = [&](MonitorId monitor, Channel channel) {
    // A machine has a spindle and x, y, z; of the others the file tells.
    const bool usual = channel == plan.tool_spindle || is_linear_axis(channel);
    if (!usual && !machine.has_section(section_of(channel))) return;
    plan.monitors.push_back({monitor, channel, false,
                             is_spindle(channel) ? no_spindle().sentence : no_axis(channel),
                             no_spindle().word});
  };
  /// Whether it can be heard, and is planned.
  const auto hears_spindle = [&](Channel channel) -> Expected<bool> {
    const std::optional<DriveSignal>& signal = signals.drive(channel);
    if (!signal) {
      reports_nothing(MonitorId::chatter, channel);
      return false;
    }
    if (const std::string why = unusable(machine, channel, *signal); !why.empty()) {
      obstacle(MonitorId::chatter, channel, why);
      return false;
    }
    if (channel == plan.tool_spindle) {
      CutDetectorConfig& cut = plan.config.cut;
      cut = cut_config(period);
      cut.torque_Nm = machine.number("monitor.collision", "cutting_torque_Nm").value_or(0);
      cut.load_cutoff_rad_s = own_cutoffs(machine, "monitor.collision", kCollisionCutoff_rad_s)
                                  .disturbance_cutoff_rad_s;
    }
    if (auto done = plan_spindle(machine, channel, *signal, period, plan); !done)
      return done.error();
    return true;
  };
  const auto of_tool = hears_spindle(plan.tool_spindle);
  if (!of_tool) return of_tool.error();
  any = *of_tool;
  for (std::size_t i = 0; i < kAllAxes; ++i) {
    const Channel channel = axis_channel(i);
    if (!signals.axis[i]) {
      reports_nothing(MonitorId::collision, channel);
      continue;
    }
    if (const std::string why = unusable(machine, channel, *signals.axis[i]); !why.empty()) {
      obstacle(MonitorId::collision, channel, why);
      continue;
    }
    if (auto done = plan_axis(machine, channel, *signals.axis[i], period, plan); !done)
      return done.error();
    any = true;
  }
  const auto of_other = hears_spindle(other_spindle(plan.tool_spindle));
  if (!of_other) return of_other.error();
  if (plan.second) plan.second->cut = cut_config(period);
  if (!any && !plan.second)
    return data_error(first_obstacle.empty() ? "no drive has both motion and effort"
                                             : first_obstacle);
  if (auto done = plan_tool(machine, signals, plan); !done) return done.error();
  plan_follower(machine, period, plan);
  if (auto done = plan_coefficients(machine, period, plan); !done) return done.error();
  if (machine.flag("machine", "grouped_monitors").value_or(false)) plan_groups(plan, period);
  const auto accept = [&](const HostStackConfig& config, Channel spindle) {
    return accepted(machine, plan.grouped ? in_groups(config) : config, spindle);
  };
  if (any)
    if (auto done = accept(plan.config, plan.tool_spindle); !done) return done.error();
  if (plan.second)
    if (auto done = accept(*plan.second, other_spindle(plan.tool_spindle)); !done)
      return done.error();
  say_unused(machine, plan);
  return plan;
}

void prepare(HostStack& stack, const StackPlan& plan) {
  stack.configure(plan.grouped ? in_groups(plan.config) : plan.config);
  if (plan.taught_thrust_N || plan.taught_torque_Nm) {
    const auto thrust = plan.taught_thrust_N.value_or(std::array<double, 2>{});
    const auto torque = plan.taught_torque_Nm.value_or(std::array<double, 2>{});
    stack.tool().wear().set_taught(thrust[0], thrust[1], torque[0], torque[1]);
  }
  if (plan.torque_band.empty()) return;
  stack.tool().torque_band().set_reference(
      TorqueBandView<double>{plan.torque_band, plan.torque_band_sections});
  stack.tool().torque_band().start();
}

}  // namespace servosense
