// The C interface: translation, nothing else. Fit for firmware (no exception, no heap).
#include "servosense/capi/servosense.h"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <new>
#include <type_traits>

#include "config_translation.hpp"
#include "servosense/core/constant_over_temperature.hpp"
#include "servosense/monitors/friction_follower.hpp"
#include "servosense/monitors/monitor_stack.hpp"
#include "servosense/observer/estimate_band.hpp"

using namespace servosense;

namespace {
using Stack = MonitorStack<float, SERVOSENSE_MAX_REVOLUTIONS, SERVOSENSE_MAX_HARMONICS,
                           SERVOSENSE_KEPT_SAMPLES, SERVOSENSE_MAX_TEETH, SERVOSENSE_AXES>;
constexpr std::size_t kCAxes = SERVOSENSE_AXES;
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
  capi::StackConfig config;  // here, because 5 kB are much on a controller's stack
};

static_assert(sizeof(servosense_stack) <= SERVOSENSE_STORAGE_BYTES);
static_assert(alignof(servosense_stack) <= 16);
static_assert(Stack::kMaxChanges <= SERVOSENSE_MAX_EVENTS);
static_assert(static_cast<int>(MonitorId::signal) == SERVOSENSE_SIGNAL);
static_assert(static_cast<int>(MonitorState::signal_fault) == SERVOSENSE_SIGNAL_FAULT);
static_assert(static_cast<int>(Channel::c) == SERVOSENSE_C);
static_assert(static_cast<int>(Channel::tool) == SERVOSENSE_TOOL);
static_assert(static_cast<int>(Channel::machine) == SERVOSENSE_MACHINE);
static_assert(static_cast<int>(MotionKind::velocity) == SERVOSENSE_VELOCITY);
static_assert(static_cast<int>(Quality::missing) == SERVOSENSE_MISSING);

namespace {

constexpr bool equal(const char* a, const char* b) noexcept {
  while (*a != '\0' && *a == *b) ++a, ++b;
  return *a == *b;
}

EstimateBandConfig band_config(const servosense_config& c, const capi::StackConfig& b,
                               std::size_t i) noexcept {
  const DriveSlotConfig& slot =
      i == 0 ? static_cast<const DriveSlotConfig&>(b.spindle) : b.axis[i - 1];
  const double count = slot.input.unit_per_count;
  EstimateBandConfig band =
      estimate_band_of(slot.observer, capi::drive_of(c, i).estimate_noise,
                       count < 0 ? -count : count, i == 0 || capi::turns(i - 1));
  if (c.grouped != 0) band.sample_period_s *= i == 0 ? Stack::kSpindleGroup : Stack::kAxisGroup;
  return band;
}

// What the blocks call by another name than C does. Names that C does not have at all belong to an
// effect.
struct Name {
  const char* block;
  const char* c;
};
constexpr Name kDriveNames[] = {{"kind", "motion"},
                                {"unit_per_count", "counts_per_turn"},
                                {"unit_per_turn", "unit_per_turn"},
                                {"counter_bits", "counter_bits"},
                                {"effort_per_unit", "effort_per_ampere"},
                                {"effort_update_s", "effort_update_s"},
                                {"inertia", "inertia"},
                                {"viscous", "viscous_friction"},
                                {"coulomb", "coulomb_friction"},
                                {"constant_load", "constant_load"},
                                {"friction_knee", "friction_knee"},
                                {"load_inertia_share", "load_inertia_share"},
                                {"load_friction_share", "load_friction_share"}};
constexpr const char* kDrives[] = {"spindle.", "axis[0].", "axis[1].", "axis[2].",
                                   "axis[3].", "axis[4].", "axis[5]."};
constexpr const char* kCollisions[] = {"collision[0].", "collision[1].", "collision[2].",
                                       "collision[3].", "collision[4].", "collision[5]."};

/// The first fault of a configuration, with the path of its field in C.
class Judge {
 public:
  Judge(capi::StackConfig& config, const servosense_config& given) noexcept : config_(config) {
    drive(config_.spindle, kDrives[0]);
    if (config_.spindle.present) {
      part(Stack::Chatter::validate(config_.spindle.chatter), "chatter.");
      part(CutDetector<float>::validate(config_.cut), "cut.");
    }
    for (std::size_t i = 0; i < kCAxes; ++i) {
      const AxisSlotConfig& axis = config_.axis[i];
      drive(axis, kDrives[1 + i]);
      if (axis.present) part(Stack::Collision::validate(axis.collision), kCollisions[i]);
      if (axis.present && i < 2 && config_.tool.needs_lateral_forces())
        observer(axis.tool_observer, kDrives[1 + i], "tool_cutoff_rad_s", "tool_cutoff_rad_s");
    }
    tool();
    each_alone();
    part(Stack::validate(config_), "");
    beside(given);
  }
  [[nodiscard]] const char* fault() const noexcept { return fault_; }
  /// Writes the path of the field.
  void write_path(char* to, std::size_t room) const noexcept {
    for (const char* text :
         {prefix_, name_, inner_[0] != '\0' ? " (" : "", inner_, inner_[0] != '\0' ? ")" : ""})
      for (; *text != '\0' && room > 1; --room) *to++ = *text++;
    *to = '\0';
  }

 private:
  void say(const char* prefix, const char* name, const char* fault,
           const char* inner = "") noexcept {
    if (fault_ != nullptr) return;
    // Of the whole machine, wherever a block says it.
    const bool shared = equal(name, "sample_period_s") || equal(name, "teeth");
    prefix_ = shared ? "" : prefix;
    name_ = name;
    inner_ = inner;
    fault_ = fault;
  }
  void part(const Status& s, const char* prefix) noexcept {
    if (!s.ok()) say(prefix, s.parameter(), s.reason());
  }
  void drive_field(const Status& s, const char* prefix) noexcept {
    if (s.ok()) return;
    for (const Name& n : kDriveNames)
      if (equal(n.block, s.parameter())) return say(prefix, n.c, s.reason());
    if (equal(s.parameter(), "sample_period_s") || equal(s.parameter(), "effects"))
      return say(prefix, s.parameter(), s.reason());
    say(prefix, "effects", s.reason(), s.parameter());
  }
  void observer(const DisturbanceObserverView& o, const char* prefix, const char* disturbance,
                const char* velocity) noexcept {
    const Status s = Stack::Observer::validate(o);
    if (s.ok()) return;
    if (equal(s.parameter(), "disturbance_cutoff_rad_s"))
      return say(prefix, disturbance, s.reason());
    if (equal(s.parameter(), "velocity_cutoff_rad_s")) return say(prefix, velocity, s.reason());
    drive_field(s, prefix);
  }
  void drive(const DriveSlotConfig& slot, const char* prefix) noexcept {
    if (!slot.present) return;
    if (slot.input.kind > MotionKind::velocity)
      return say(prefix, "motion", "must be SERVOSENSE_COUNTS, _POSITION or _VELOCITY");
    drive_field(DriveInput<float>::validate(slot.input), prefix);
    if (const Status s = SignalHealthMonitor<float>::validate(slot.signal); !s.ok())
      say(prefix, "signal", s.reason(), s.parameter());
    observer(slot.observer, prefix, "cutoff_rad_s", "velocity_cutoff_rad_s");
    observer(slot.monitor_observer, prefix, "monitor_cutoff_rad_s", "monitor_cutoff_rad_s");
  }
  void tool() noexcept {
    const ToolMonitorsConfig& t = config_.tool;
    const bool spindle = config_.spindle.present;
    const bool lateral = config_.axis[0].present && config_.axis[1].present;
    struct Need {
      bool on, there;
      const char* prefix;
      const char* what;
    };
    const Need needs[] = {
        {t.ar_breakage_on, spindle, "ar_breakage.", "needs the spindle"},
        {t.tooth_breakage_on, spindle && (t.tooth_breakage.torque || lateral), "tooth_breakage.",
         "needs the spindle, and on forces x and y"},
        {t.drill_fracture_on, spindle && lateral, "drill_fracture.", "needs the spindle, x and y"},
        {t.wear_on, spindle && config_.axis[2].present, "wear.", "needs the spindle and z"},
        {t.torque_band_on, spindle, "torque_band.", "needs the spindle"}};
    for (const Need& n : needs)
      if (n.on && !n.there) say(n.prefix, "enabled", n.what);
    if (t.ar_breakage_on) part(Stack::Tool::Ar::validate(t.ar_breakage), "ar_breakage.");
    if (t.tooth_breakage_on)
      part(Stack::Tool::Tooth::validate(t.tooth_breakage), "tooth_breakage.");
    if (t.drill_fracture_on)
      part(Stack::Tool::Drill::validate(t.drill_fracture), "drill_fracture.");
    if (t.wear_on) part(Stack::Tool::Wear::validate(t.wear), "wear.");
    if (t.torque_band_on) part(Stack::Tool::Band::validate(t.torque_band), "torque_band.");
  }
  // What the stack asks of a drive and its monitor together; one drive at a time, to tell which.
  void each_alone() noexcept {
    DriveSlotConfig* slots[1 + kCAxes] = {&config_.spindle};
    for (std::size_t i = 0; i < kCAxes; ++i) slots[1 + i] = &config_.axis[i];
    bool present[1 + kCAxes];
    for (std::size_t i = 0; i <= kCAxes; ++i) present[i] = slots[i]->present;
    bool any = false;
    for (std::size_t one = 0; one <= kCAxes; ++one) {
      any = any || present[one];
      if (!present[one] || fault_ != nullptr) continue;
      for (std::size_t i = 0; i <= kCAxes; ++i) slots[i]->present = i == one;
      const Status s = Stack::validate(config_);
      if (equal(s.parameter(), "chatter_threshold_Nm2"))
        say("chatter.", s.parameter(), "must be positive, or enabled 0: it could not alarm");
      else if (equal(s.parameter(), "threshold_N_per_s"))
        say(kCollisions[one - 1], s.parameter(),
            "must be positive, or enabled 0: it could not alarm");
      else if (equal(s.parameter(), "half_rate") || equal(s.parameter(), "grouped"))
        part(s, "");
      else
        drive_field(s, kDrives[one]);
    }
    for (std::size_t i = 0; i <= kCAxes; ++i) slots[i]->present = present[i];
    if (!any) say("", "present", "must be set of one drive at least");
  }

  void beside(const servosense_config& given) noexcept {
    for (std::size_t i = 0; i <= kCAxes; ++i) {
      const servosense_drive& drive = capi::drive_of(given, i);
      if (drive.present == 0) continue;
      if (!is_finite(drive.torque_constant_per_K))
        say(kDrives[i], "torque_constant_per_K", "must be finite");
      if (!is_finite(drive.torque_constant_at_C))
        say(kDrives[i], "torque_constant_at_C", "must be finite");
      if (!(drive.estimate_noise >= 0 && is_finite(drive.estimate_noise)))
        say(kDrives[i], "estimate_noise", "must not be negative");
      drive_field(EstimateBand<float>::validate(band_config(given, config_, i)), kDrives[i]);
    }
    if (given.friction.enabled == 0) return;
    if (!config_.spindle.present) return say("friction.", "enabled", "needs the spindle");
    const DriveEffectsView& effects = config_.spindle.observer.drive.effects;
    if (effects.find("backlash") != nullptr || effects.find("flexible-coupling") != nullptr)
      return say("friction.", "enabled",
                 "must be 0 with play or a coupling, which share the friction out");
    const Status s = FrictionFollower<float>::validate(capi::friction_config(given));
    if (!s.ok() && equal(s.parameter(), "viscous, coulomb"))
      return say(kDrives[0], "viscous_friction", s.reason());
    part(s, "friction.");
  }

  capi::StackConfig& config_;
  const char* fault_ = nullptr;
  const char* prefix_ = "";
  const char* name_ = "";
  const char* inner_ = "";
};

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
  capi::torque_band_fields(c.torque_band, TorqueBandConfig{}, visit);
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
    if (events != nullptr && n < capacity)
      events[n] = {static_cast<int>(change.monitor),
                   static_cast<int>(change.channel),
                   static_cast<int>(change.state),
                   static_cast<int>(change.before),
                   change.value,
                   change.threshold};
    ++n;
  }
  if (stack->bands || stack->follows) hear_beside(*stack);
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
