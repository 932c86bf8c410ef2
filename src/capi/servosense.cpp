// The C interface: translation, nothing else. Fit for firmware (no exception, no heap).
#include "servosense/capi/servosense.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <limits>
#include <new>

#include "servosense/monitors/monitor_stack.hpp"
#include "servosense/observer/drive_config.hpp"

using namespace servosense;

struct servosense_stack {
  MonitorStack<float> stack;
  bool present[1 + SERVOSENSE_AXES] = {};
  std::atomic<bool> stop_requested{false};
};

static_assert(sizeof(servosense_stack) <= SERVOSENSE_STORAGE_BYTES);
static_assert(alignof(servosense_stack) <= 16);
static_assert(MonitorStack<float>::kMaxChanges <= SERVOSENSE_MAX_EVENTS);
static_assert(kAxes == SERVOSENSE_AXES);
static_assert(static_cast<int>(MonitorId::signal) == SERVOSENSE_SIGNAL);
static_assert(static_cast<int>(MonitorState::signal_fault) == SERVOSENSE_SIGNAL_FAULT);
static_assert(static_cast<int>(Channel::tool) == SERVOSENSE_TOOL);
static_assert(static_cast<int>(MotionKind::velocity) == SERVOSENSE_VELOCITY);
static_assert(static_cast<int>(Quality::missing) == SERVOSENSE_MISSING);

namespace {

void translate(const servosense_drive& from, double period, bool turns, DriveSlotConfig& to) {
  to.present = from.present != 0;
  if (!to.present) return;
  to.input.kind = static_cast<MotionKind>(from.motion);
  to.input.sample_period_s = period;
  to.input.unit_per_turn = turns ? kTwoPi : from.unit_per_turn;
  to.input.unit_per_count =
      from.counts_per_turn != 0 ? to.input.unit_per_turn / from.counts_per_turn : 0;
  to.input.counter_bits = from.counter_bits;
  to.input.effort_per_unit = from.effort_per_ampere;
  to.input.max_acceleration = turns ? kImpossibleAcceleration_rad_s2 : kImpossibleAcceleration_m_s2;
  DisturbanceObserverConfig& observer = to.observer;
  observer.sample_period_s = period;
  observer.disturbance_cutoff_rad_s = observer.velocity_cutoff_rad_s = from.cutoff_rad_s;
  observer.drive.inertia = from.inertia;
  observer.drive.viscous = from.viscous_friction;
  observer.drive.coulomb = from.coulomb_friction;
  observer.drive.constant_load = from.constant_load;
  observer.drive.friction_knee = turns ? 1e-3 : 5e-6;
  observer.drive.unit_per_turn = to.input.unit_per_turn;
  to.monitor_observer = observer;
  to.monitor_observer.disturbance_cutoff_rad_s = to.monitor_observer.velocity_cutoff_rad_s =
      from.monitor_cutoff_rad_s;
}

MonitorStackConfig translated(const servosense_config& c) {
  MonitorStackConfig config;
  translate(c.spindle, c.sample_period_s, true, config.spindle);
  config.spindle.chatter.sample_period_s = c.sample_period_s;
  config.cut.sample_period_s = c.sample_period_s;
  config.cut.cutoff_rad_s = std::min(config.cut.cutoff_rad_s, 0.05 / c.sample_period_s);
  config.spindle.chatter.window_revolutions = c.window_revolutions;
  const auto threshold = [](double value) { return value == SERVOSENSE_OFF ? 0 : value; };
  config.spindle.chatter.chatter_threshold_Nm2 = threshold(c.chatter_threshold_Nm2);
  config.spindle.chatter.forced_threshold_Nm2 = threshold(c.forced_threshold_Nm2);
  config.spindle.chatter_on = c.chatter_threshold_Nm2 != SERVOSENSE_OFF;
  if (!config.spindle.chatter_on) config.spindle.chatter_on = c.forced_threshold_Nm2 > 0;
  config.spindle.chatter.teeth = c.teeth;
  for (std::size_t i = 0; i < kAxes; ++i) {
    translate(c.axis[i], c.sample_period_s, false, config.axis[i]);
    config.axis[i].collision.sample_period_s = c.sample_period_s;
    config.axis[i].collision.threshold_N_per_s = threshold(c.collision_threshold_N_per_s[i]);
    config.axis[i].collision_on = c.collision_threshold_N_per_s[i] != SERVOSENSE_OFF;
  }
  config.tool.ar_breakage_on = c.ar_noise_Nm > 0 && c.teeth > 0 && config.spindle.present;
  config.tool.ar_breakage.sample_period_s = c.sample_period_s;
  config.tool.ar_breakage.teeth = c.teeth;
  config.tool.ar_breakage.noise_Nm = c.ar_noise_Nm;
  config.tool.tooth_breakage_on = c.tooth_noise_Nm > 0 && c.teeth > 0 && config.spindle.present;
  config.tool.tooth_breakage.sample_period_s = c.sample_period_s;
  config.tool.tooth_breakage.teeth = c.teeth;
  config.tool.tooth_breakage.torque = true;
  config.tool.tooth_breakage.noise = c.tooth_noise_Nm;
  config.tool.tooth_breakage.sample_noise = c.tooth_sample_noise_Nm;
  return config;
}

void translate(const servosense_drive_sample& from, RawDriveSample<float>& to) {
  to.counts = from.counts;
  to.motion = from.motion;
  to.effort = from.effort;
  to.motion_quality = static_cast<Quality>(from.motion_flags);
  to.effort_quality = static_cast<Quality>(from.effort_flags);
}

servosense_drive default_drive(double cutoff, double monitor_cutoff) {
  servosense_drive d{};
  d.motion = SERVOSENSE_COUNTS;
  d.counter_bits = 32;
  d.unit_per_turn = kTwoPi;
  d.effort_per_ampere = 1;
  d.cutoff_rad_s = cutoff;
  d.monitor_cutoff_rad_s = monitor_cutoff;
  return d;
}

}  // namespace

extern "C" {

uint32_t servosense_version(void) { return SERVOSENSE_CAPI_VERSION; }
size_t servosense_size(void) { return sizeof(servosense_stack); }
size_t servosense_alignment(void) { return alignof(servosense_stack); }

void servosense_default_config(servosense_config* config) {
  if (config == nullptr) return;
  *config = servosense_config{};
  config->size = sizeof *config;
  config->sample_period_s = 125e-6;
  config->spindle = default_drive(500, 3500);
  for (servosense_drive& axis : config->axis) axis = default_drive(500, 335);
  config->window_revolutions = 8;
}

const char* servosense_init(void* storage, size_t bytes, const servosense_config* config,
                            servosense_stack** stack, const char** parameter) {
  const char* nowhere = "";
  const char** const field = parameter != nullptr ? parameter : &nowhere;
  *field = "";
  if (stack == nullptr) return "there is nowhere to put the stack";
  *stack = nullptr;
  if (storage == nullptr || config == nullptr) return "storage and configuration must be given";
  if (bytes < sizeof(servosense_stack)) return "the storage is smaller than servosense_size()";
  if (reinterpret_cast<std::uintptr_t>(storage) % alignof(servosense_stack) != 0)  // NOLINT
    return "the storage is not aligned to servosense_alignment()";
  if (config->size != sizeof *config) {
    *field = "size";
    return "the configuration is of another version, or servosense_default_config was not called";
  }
  for (int i = -1; i < SERVOSENSE_AXES; ++i) {
    const servosense_drive& drive = i < 0 ? config->spindle : config->axis[i];
    if (drive.present != 0 && (drive.motion < 0 || drive.motion > SERVOSENSE_VELOCITY)) {
      *field = "motion";
      return "must be SERVOSENSE_COUNTS, SERVOSENSE_POSITION or SERVOSENSE_VELOCITY";
    }
  }
  const MonitorStackConfig translation = translated(*config);
  if (const Status status = MonitorStack<float>::validate(translation); !status.ok()) {
    *field = status.parameter();
    return status.reason();
  }
  auto* const made = new (storage) servosense_stack;
  made->stack.configure(translation);
  made->present[0] = translation.spindle.present;
  for (std::size_t i = 0; i < kAxes; ++i) made->present[1 + i] = translation.axis[i].present;
  *stack = made;
  return nullptr;
}

void servosense_reset(servosense_stack* stack) {
  stack->stack.reset();
  servosense_release_stop(stack);
}

int servosense_process(servosense_stack* stack, const servosense_sample* sample,
                       servosense_event* events, int capacity) {
  ServoSample<float> in;
  in.t_ns = sample->t_ns;
  translate(sample->spindle, in.spindle);
  for (std::size_t i = 0; i < kAxes; ++i) translate(sample->axis[i], in.axis[i]);
  int n = 0;
  for (const StateChange<float>& change : stack->stack.process(in)) {
    if (change.state == MonitorState::alarm)
      stack->stop_requested.store(true, std::memory_order_relaxed);
    if (n < capacity)
      events[n] = {static_cast<int>(change.monitor),
                   static_cast<int>(change.channel),
                   static_cast<int>(change.state),
                   static_cast<int>(change.before),
                   change.value,
                   change.threshold};
    ++n;
  }
  return n;
}

int servosense_stop_requested(const servosense_stack* stack) {
  return stack->stop_requested.load(std::memory_order_relaxed) ? 1 : 0;
}

void servosense_release_stop(servosense_stack* stack) {
  stack->stop_requested.store(false, std::memory_order_relaxed);
}

float servosense_estimate(const servosense_stack* stack, int channel) {
  if (channel < 0 || channel > SERVOSENSE_AXES || !stack->present[channel])
    return std::numeric_limits<float>::quiet_NaN();
  return channel == SERVOSENSE_SPINDLE
             ? stack->stack.spindle().estimate
             : stack->stack.axis(static_cast<std::size_t>(channel - 1)).estimate;
}

const char* servosense_monitor_name(int monitor) {
  return monitor < 0 || monitor > SERVOSENSE_SIGNAL ? "" : name_of(static_cast<MonitorId>(monitor));
}
const char* servosense_state_name(int state) {
  return state < 0 || state > SERVOSENSE_SIGNAL_FAULT ? ""
                                                      : name_of(static_cast<MonitorState>(state));
}
const char* servosense_channel_name(int channel) {
  // Every name of a channel is a literal, so it ends in a zero.
  return channel < 0 || channel >= static_cast<int>(kChannelNames.size())
             ? ""
             : kChannelNames[static_cast<std::size_t>(channel)].data();
}

}  // extern "C"
