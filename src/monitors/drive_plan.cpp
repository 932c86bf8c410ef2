#include "drive_plan.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <utility>

#include "collision_reason.hpp"
#include "obstacle.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/io/text.hpp"
#include "servosense/monitors/chatter_noise.hpp"
#include "servosense/monitors/collision_keys.hpp"

namespace servosense {
namespace {

// Koike 2016, table 3-3.
constexpr double kChatterCutoff_rad_s = 3500;
// Three samples at this rate last 6 ms: slower, a contact is over before it is confirmed.
constexpr double kCollisionLeastRate_hz = 500;
// A chatter window wants several harmonics of a spindle at 3000 rpm and more below half the rate.
constexpr double kChatterLeastRate_hz = 500;
// Range of the block (chatter.hpp).
constexpr double kChatterSamplesATooth = 3;

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

ChatterConfig chatter_config(const MachineFile& machine, Channel spindle, double period) {
  const std::string section = monitor_section(MonitorId::chatter, spindle);
  ChatterConfig c;
  c.sample_period_s = period;
  c.lines.threshold = usual_chatter_line_threshold(period);
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

void say_share(const MachineFile& machine, Channel channel, StackPlan& plan) {
  if (EffortShare share = effort_share(machine, channel); !share.said.empty())
    plan.remarks.push_back(std::move(share.said));
}

}  // namespace

ObserverCutoffs own_cutoffs(const MachineFile& machine, const std::string& section,
                            double standard) {
  const double g = machine.number(section, "cutoff_rad_s").value_or(standard);
  return {g, g};
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
  if (chatter.runs) tell_noise(slot);
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

}  // namespace servosense
