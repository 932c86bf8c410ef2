// The C interface: translation, nothing else. Fit for firmware (no exception, no heap).
#include "servosense/capi/servosense.h"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <new>
#include <type_traits>

#include "config_judge.hpp"
#include "config_translation.hpp"
#include "servosense/core/constant_over_temperature.hpp"
#include "servosense/monitors/cut_beside_stack.hpp"
#include "servosense/monitors/friction_follower.hpp"
#include "servosense/monitors/monitor_stack.hpp"
#include "servosense/observer/estimate_band.hpp"

using namespace servosense;

using capi::band_config, capi::equal, capi::Judge, capi::kCAxes, capi::Stack;

namespace {
constexpr std::uint32_t kMade = 0x53564f32;
}  // namespace

struct servosense_stack {
  std::uint32_t made = kMade;
  std::atomic<bool> stop_requested{false};
  bool present[1 + SERVOSENSE_AXES] = {};
  bool scaled = false;  // some constant is not as stated, by the temperature of its motor
  bool bands = false;
  bool follows = false;
  float constant_ratio[1 + SERVOSENSE_AXES];
  ConstantOverTemperature constant[1 + SERVOSENSE_AXES];
  EstimateBand<float> band[1 + SERVOSENSE_AXES];
  FrictionFollower<float> follower;
  Stack stack;
  bool follows_cut = false;
  CutBesideStack<float> cut;
  capi::StackConfig config;  // here, because 5 kB are much on a controller's stack
};

static_assert(sizeof(servosense_stack) <= SERVOSENSE_STORAGE_BYTES);
static_assert(alignof(servosense_stack) <= 16);
static_assert(Stack::kMaxChanges + 1 <= SERVOSENSE_MAX_EVENTS);
static_assert(static_cast<int>(MonitorId::signal) == SERVOSENSE_SIGNAL);
static_assert(static_cast<int>(MonitorState::signal_fault) == SERVOSENSE_SIGNAL_FAULT);
static_assert(static_cast<int>(Channel::c) == SERVOSENSE_C);
static_assert(static_cast<int>(Channel::tool) == SERVOSENSE_TOOL);
static_assert(static_cast<int>(Channel::machine) == SERVOSENSE_MACHINE);
static_assert(static_cast<int>(MotionKind::velocity) == SERVOSENSE_VELOCITY);
static_assert(static_cast<int>(Quality::missing) == SERVOSENSE_MISSING);

namespace {

void translate(const servosense_drive_sample& from, RawDriveSample<float>& to) {
  to.counts = from.counts;
  to.motion = from.motion;
  to.effort = from.effort;
  to.motion_quality = static_cast<Quality>(from.motion_flags);
  to.effort_quality = static_cast<Quality>(from.effort_flags);
}

/// The blocks beside the stack, of what Judge has let pass.
void add_beside(servosense_stack& made, const servosense_config& config) noexcept {
  for (std::size_t i = 0; i <= kCAxes; ++i) {
    const servosense_drive& drive = capi::drive_of(config, i);
    made.constant_ratio[i] = 1;
    made.constant[i] = {drive.torque_constant_per_K, drive.torque_constant_at_C};
    if (made.present[i]) made.band[i].configure(band_config(config, made.config, i));
  }
  made.follows = config.friction.enabled != 0;
  if (made.follows) made.follower.configure(capi::friction_config(config));
}

[[gnu::noinline]] void scale(const servosense_stack& stack, ServoSample<float, kCAxes>& in) {
  in.spindle.effort *= stack.constant_ratio[0];
  for (std::size_t i = 0; i < kCAxes; ++i) in.axis[i].effort *= stack.constant_ratio[1 + i];
}

[[gnu::noinline]] void hear_beside(servosense_stack& made) {
  Stack& stack = made.stack;
  if (made.bands) {
    if (made.present[0] && stack.spindle_heard())
      made.band[0].process(stack.spindle().sample.increment, stack.spindle().quality);
    for (std::size_t i = 0; i < kCAxes; ++i)
      if (made.present[1 + i] && stack.axis_heard(i))
        made.band[1 + i].process(stack.axis(i).sample.increment, stack.axis(i).quality);
  }
  if (!made.follows) return;
  if (!made.follower.process(stack.spindle().estimate, stack.spindle_increment(),
                             stack.spindle().quality))
    return;
  const auto& found = made.follower.state();
  stack.set_spindle_friction(found.viscous, found.coulomb);
}

void default_drive(servosense_drive& d, double monitor_cutoff, double knee) {
  d.motion = SERVOSENSE_COUNTS;
  d.counter_bits = 32;
  d.unit_per_turn = kTwoPi;
  d.effort_per_ampere = 1;
  d.torque_constant_at_C = 20;
  d.friction_knee = knee;
  d.load_inertia_share = d.load_friction_share = 0.5;
  d.cutoff_rad_s = 500;
  d.monitor_cutoff_rad_s = monitor_cutoff;
  d.tool_cutoff_rad_s = 3500;
}

template <typename Visit>
void defaults(servosense_config& c, Visit visit) {
  capi::signal_fields(c.spindle.signal, SignalHealthConfig{}, visit);
  capi::chatter_fields(c.chatter, ChatterConfig{}, visit);
  c.chatter.enabled = 1;
  for (int i = 0; i < SERVOSENSE_AXES; ++i) {
    capi::signal_fields(c.axis[i].signal, SignalHealthConfig{}, visit);
    capi::collision_fields(c.collision[i],
                           collision_defaults(capi::turns(static_cast<std::size_t>(i))), visit);
    c.collision[i].enabled = 1;
  }
  capi::cut_fields(c.cut, CutDetectorConfig{}, visit);
  capi::friction_fields(c.friction, FrictionFollowerConfig{}, visit);
  capi::ar_breakage_fields(c.ar_breakage, ArBreakageConfig{}, visit);
  capi::tooth_breakage_fields(c.tooth_breakage, ToothBreakageConfig{}, visit);
  c.tooth_breakage.torque = 1;
  capi::drill_fracture_fields(c.drill_fracture, DrillFractureConfig{}, visit);
  capi::wear_fields(c.wear, WearConfig{}, visit);
  capi::all_coefficients(c.coefficients, CuttingCoefficientsConfig{}, visit);
  capi::torque_band_fields(c.torque_band, TorqueBandConfig{}, visit);
}

void tell(servosense_event* events, int capacity, int at, const StateChange<float>& change) {
  if (events == nullptr || at >= capacity) return;
  events[at] = {static_cast<int>(change.monitor),
                static_cast<int>(change.channel),
                static_cast<int>(change.state),
                static_cast<int>(change.before),
                change.value,
                change.threshold,
                change.frequency_hz,
                change.error_hz};
}

bool is_made(const servosense_stack* stack) noexcept {
  return stack != nullptr && stack->made == kMade;
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
  default_drive(config->spindle, 3500, 1e-3);
  for (std::size_t i = 0; i < kCAxes; ++i)
    default_drive(config->axis[i], 335, capi::turns(i) ? kTableKnee_rad : kAxisKnee_m);
  defaults(*config, capi::kFromBlock);
}

int servosense_effect_number(const char* name) {
  for (std::size_t i = 0; name != nullptr && i < kDriveEffectCount; ++i)
    if (equal(name, kDriveEffects[i].name)) return static_cast<int>(i);
  return -1;
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
  const servosense_torque_band& band = config->torque_band;
  if (band.enabled != 0 && (band.reference == nullptr || band.reference_count < 2)) {
    *field = "torque_band.reference";
    return "must be given, two points at least";
  }
  auto* const made = new (storage) servosense_stack;
  capi::to_blocks(*config, made->config);
  const Judge judge(made->config, *config);
  if (const char* const fault = judge.fault(); fault != nullptr) {
    judge.write_path(static_cast<char*>(storage), 96);
    *field = static_cast<const char*>(storage);
    return fault;
  }
  made->present[0] = made->config.spindle.present;
  for (std::size_t i = 0; i < kCAxes; ++i) made->present[1 + i] = made->config.axis[i].present;
  add_beside(*made, *config);
  if (config->grouped != 0) {
    group(made->config);
    const Status in_groups = Stack::validate(made->config);
    if (!in_groups.ok()) {
      *field = "grouped";
      made->made = 0;
      return in_groups.reason();
    }
  }
  made->stack.configure(made->config);
  made->follows_cut = config->coefficients.enabled != 0;
  if (made->follows_cut)
    made->cut.configure(capi::to_coefficients(*config), made->config.tool.wear_on);
  const servosense_wear& wear = config->wear;
  if (wear.enabled != 0 && (wear.taught_thrust_N > 0 || wear.taught_torque_Nm > 0))
    made->stack.tool().wear().set_taught(static_cast<float>(wear.taught_thrust_N),
                                         static_cast<float>(wear.taught_thrust_scatter_N),
                                         static_cast<float>(wear.taught_torque_Nm),
                                         static_cast<float>(wear.taught_torque_scatter_Nm));
  if (band.enabled != 0) {
    // NOLINTBEGIN: the same layout, see config_translation.hpp
    const auto* points = reinterpret_cast<const TorqueBandPoint<float>*>(band.reference);
    const auto* sections = reinterpret_cast<const TorqueBandSection<float>*>(band.sections);
    // NOLINTEND
    made->stack.tool().torque_band().set_reference(TorqueBandView<float>{
        {points, band.reference_count}, {sections, sections ? band.section_count : 0}});
    made->stack.tool().torque_band().start();
  }
  *stack = made;
  return nullptr;
}

void servosense_reset(servosense_stack* stack) {
  if (!is_made(stack)) return;
  stack->stack.reset();
  for (EstimateBand<float>& band : stack->band) band.reset();
  if (stack->follows) {
    stack->follower.reset();
    const auto& stated = stack->follower.state();
    stack->stack.set_spindle_friction(stated.viscous, stated.coulomb);
  }
  if (stack->follows_cut) stack->cut.reset();
  servosense_release_stop(stack);
}

void servosense_set_temperature(servosense_stack* stack, int channel, float temperature_C) {
  if (!is_made(stack) || channel < 0 || channel > SERVOSENSE_AXES || !is_finite(temperature_C))
    return;
  const double ratio = stack->constant[channel].ratio(static_cast<double>(temperature_C));
  if (!(ratio > 0) || !is_finite(ratio)) return;
  stack->constant_ratio[channel] = static_cast<float>(ratio);
  stack->scaled = true;
}

void servosense_use_bands(servosense_stack* stack, int use) {
  if (!is_made(stack)) return;
  stack->bands = use != 0;
  for (EstimateBand<float>& band : stack->band) band.reset();
}

void servosense_start_program(servosense_stack* stack, uint32_t point) {
  if (is_made(stack) && stack->config.tool.torque_band_on)
    stack->stack.tool().torque_band().start(point);
}

int servosense_process(servosense_stack* stack, const servosense_sample* sample,
                       servosense_event* events, int capacity) {
  if (!is_made(stack) || sample == nullptr) {
    if (events != nullptr && capacity > 0)
      events[0] = {SERVOSENSE_SIGNAL,
                   SERVOSENSE_MACHINE,
                   SERVOSENSE_SIGNAL_FAULT,
                   SERVOSENSE_SIGNAL_FAULT,
                   0,
                   0,
                   0,
                   0};
    return 1;
  }
  ServoSample<float, kCAxes> in;
  in.t_ns = sample->t_ns;
  translate(sample->spindle, in.spindle);
  for (std::size_t i = 0; i < kCAxes; ++i) translate(sample->axis[i], in.axis[i]);
  if (sample->tells_program != 0) {
    in.nc_block = sample->nc_block;
    in.feed_override = static_cast<float>(sample->feed_override);
  }
  if (stack->scaled) scale(*stack, in);
  int n = 0;
  for (const StateChange<float>& change : stack->stack.process(in)) {
    if (change.state == MonitorState::alarm)
      stack->stop_requested.store(true, std::memory_order_relaxed);
    tell(events, capacity, n++, change);
  }
  if (stack->bands || stack->follows) hear_beside(*stack);
  // Only warns: no stop is asked for.
  if (StateChange<float> change; stack->follows_cut && stack->cut.process(stack->stack, change))
    tell(events, capacity, n++, change);
  return n;
}

int servosense_stop_requested(const servosense_stack* stack) {
  return is_made(stack) && stack->stop_requested.load(std::memory_order_relaxed) ? 1 : 0;
}

void servosense_release_stop(servosense_stack* stack) {
  if (is_made(stack)) stack->stop_requested.store(false, std::memory_order_relaxed);
}

float servosense_estimate(const servosense_stack* stack, int channel) {
  if (!is_made(stack) || channel < 0 || channel > SERVOSENSE_AXES || !stack->present[channel])
    return std::numeric_limits<float>::quiet_NaN();
  return channel == SERVOSENSE_SPINDLE
             ? stack->stack.spindle().estimate
             : stack->stack.axis(static_cast<std::size_t>(channel - 1)).estimate;
}

float servosense_estimate_band(const servosense_stack* stack, int channel) {
  if (!is_made(stack) || channel < 0 || channel > SERVOSENSE_AXES || !stack->present[channel] ||
      !stack->bands)
    return std::numeric_limits<float>::quiet_NaN();
  return stack->band[channel].state().half_width;
}

int servosense_followed_friction(const servosense_stack* stack, float* viscous_Nm_s_per_rad,
                                 float* coulomb_Nm) {
  if (!is_made(stack) || !stack->follows) return 0;
  if (viscous_Nm_s_per_rad != nullptr) *viscous_Nm_s_per_rad = stack->follower.state().viscous;
  if (coulomb_Nm != nullptr) *coulomb_Nm = stack->follower.state().coulomb;
  return 1;
}

servosense_found servosense_cutting_coefficient(const servosense_stack* stack, int which) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  if (!is_made(stack) || !stack->follows_cut) return {kNan, kNan, kNan, 0};
  const auto& coefficients = stack->cut.coefficients();
  const auto found = [](const CuttingEstimate<float>& e) -> servosense_found {
    const float half = 1.96F * e.error;
    return {e.value, e.value - half, e.value + half, e.told ? 1 : 0};
  };
  switch (which) {
    case SERVOSENSE_SPECIFIC_FORCE:
      return found(coefficients.specific_force());
    case SERVOSENSE_FORCE_RATIO:
      return found(coefficients.force_ratio());
    case SERVOSENSE_K_TC:
    case SERVOSENSE_K_TE:
    case SERVOSENSE_K_RC:
    case SERVOSENSE_K_RE:
      return found(coefficients.coefficient(static_cast<std::size_t>(which - SERVOSENSE_K_TC)));
    case SERVOSENSE_RADIAL_RATIO:
      return found(coefficients.radial_ratio());
    default:
      return {kNan, kNan, kNan, 0};
  }
}

uint32_t servosense_cutting_changes(const servosense_stack* stack, float* share) {
  const bool follows = is_made(stack) && stack->follows_cut;
  if (share != nullptr) *share = follows ? stack->cut.coefficients().state().change : 0;
  return follows ? static_cast<uint32_t>(stack->cut.coefficients().state().changes) : 0;
}

int servosense_set_cut(servosense_stack* stack, const servosense_cut_shares* shares) {
  if (!is_made(stack) || !stack->follows_cut || shares == nullptr) return -1;
  CuttingShares next;
  capi::cut_shares_fields(*shares, next, capi::kToBlock);
  if (!validate(next).ok()) return -1;
  stack->cut.coefficients().set_cut(next);
  return 0;
}

servosense_taught servosense_taught_force(const servosense_stack* stack) {
  if (!is_made(stack) || !stack->follows_cut) return {0, 0};
  const auto& state = stack->cut.coefficients().state();
  return {state.taught_N_per_m2, state.taught_error};
}

int servosense_new_tool(servosense_stack* stack, const servosense_taught* taught) {
  if (!is_made(stack) || !stack->follows_cut) return -1;
  const servosense_taught known = taught != nullptr ? *taught : servosense_taught{0, 0};
  for (const float value : {known.specific_force_N_per_m2, known.error_N_per_m2})
    if (!(value >= 0 && value <= std::numeric_limits<float>::max())) return -1;
  stack->cut.coefficients().new_tool(known.specific_force_N_per_m2, known.error_N_per_m2);
  stack->stack.tool().wear().new_tool();
  return 0;
}

uint64_t servosense_faulty_samples(const servosense_stack* stack, int channel) {
  if (!is_made(stack) || channel < 0 || channel > SERVOSENSE_AXES) return 0;
  return channel == SERVOSENSE_SPINDLE
             ? stack->stack.spindle_health().state().faults
             : stack->stack.axis_health(static_cast<std::size_t>(channel - 1)).state().faults;
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
