// What is wrong with a configuration, in names of the C header. Fit for firmware.
#pragma once

#include <cstddef>

#include "config_translation.hpp"
#include "servosense/monitors/cutting_coefficients.hpp"
#include "servosense/monitors/friction_follower.hpp"
#include "servosense/monitors/monitor_stack.hpp"
#include "servosense/observer/estimate_band.hpp"

namespace servosense::capi {

using Stack = MonitorStack<float, SERVOSENSE_MAX_REVOLUTIONS, SERVOSENSE_MAX_HARMONICS,
                           SERVOSENSE_KEPT_SAMPLES, SERVOSENSE_MAX_TEETH, SERVOSENSE_AXES>;
inline constexpr std::size_t kCAxes = SERVOSENSE_AXES;

constexpr bool equal(const char* a, const char* b) noexcept {
  while (*a != '\0' && *a == *b) ++a, ++b;
  return *a == *b;
}

// The band about the estimate of one drive.
inline EstimateBandConfig band_config(const servosense_config& c, const StackConfig& b,
                                      std::size_t i) noexcept {
  const DriveSlotConfig& slot =
      i == 0 ? static_cast<const DriveSlotConfig&>(b.spindle) : b.axis[i - 1];
  const double count = slot.input.unit_per_count;
  EstimateBandConfig band = estimate_band_of(slot.observer, drive_of(c, i).estimate_noise,
                                             count < 0 ? -count : count, i == 0 || turns(i - 1));
  if (c.grouped != 0) band.sample_period_s *= i == 0 ? Stack::kSpindleGroup : Stack::kAxisGroup;
  return band;
}

// What the blocks call by another name than C does. Names that C does not have at all belong to an
// effect.
struct Name {
  const char* block;
  const char* c;
};
inline constexpr Name kDriveNames[] = {{"kind", "motion"},
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
inline constexpr const char* kDrives[] = {"spindle.", "axis[0].", "axis[1].", "axis[2].",
                                          "axis[3].", "axis[4].", "axis[5]."};
inline constexpr const char* kCollisions[] = {"collision[0].", "collision[1].", "collision[2].",
                                              "collision[3].", "collision[4].", "collision[5]."};

/// The first fault of a configuration, with the path of its field in C.
class Judge {
 public:
  Judge(StackConfig& config, const servosense_config& c) noexcept : config_(config) {
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
    if (c.coefficients.enabled != 0)
      coefficients(to_coefficients(c));
    else if (config_.tool.wear_on && config_.tool.wear.specific_force_ratio > 0)
      say("wear.", "specific_force_ratio", "needs coefficients.enabled: nothing tells the force");
    each_alone();
    part(Stack::validate(config_), "");
    beside(c);
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
    const bool mills = t.wear.specific_force_ratio > 0 && !judges_holes(t.wear);
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
        {t.wear_on, spindle && (config_.axis[2].present || mills), "wear.",
         "needs the spindle, and z where it judges holes"},
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
  void coefficients(const CuttingCoefficientsConfig& c) noexcept {
    if (!(config_.spindle.present && config_.axis[0].present && config_.axis[1].present))
      say("coefficients.", "enabled", "needs the spindle, x and y");
    part(CuttingCoefficients<float>::validate(c), "coefficients.");
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
      const servosense_drive& drive = drive_of(given, i);
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
    const Status s = FrictionFollower<float>::validate(friction_config(given));
    if (!s.ok() && equal(s.parameter(), "viscous, coulomb"))
      return say(kDrives[0], "viscous_friction", s.reason());
    part(s, "friction.");
  }

  StackConfig& config_;
  const char* fault_ = nullptr;
  const char* prefix_ = "";
  const char* name_ = "";
  const char* inner_ = "";
};

}  // namespace servosense::capi
