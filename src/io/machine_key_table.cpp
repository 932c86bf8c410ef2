// The table of the keys of a machine file, one line each; those of the effects come from
// core/effect_keys.hpp.
#include <array>
#include <deque>
#include <utility>

#include "servosense/core/effect_keys.hpp"
#include "servosense/io/machine_keys.hpp"

namespace servosense {
namespace {

using enum KeyKind;

constexpr KeyRange kAny{};
constexpr KeyRange kNotNegative{0};
constexpr KeyRange kPositive{0, kAny.high, true};
constexpr KeyRange kShare{0, 1};
constexpr KeyRange kPositiveShare{0, 1, true};
constexpr KeyRange kDamping{0, 10};
constexpr KeyRange kSamples{0, 1e9};  // a day at 10 kHz
constexpr KeyRange kCountFrom1{1, 1e9};
constexpr KeyRange up_to(double high) { return {0, high}; }
constexpr KeyRange above_0_up_to(double high) { return {0, high, true}; }
constexpr KeyRange within(double limit) { return {-limit, limit}; }

// Upper limits catch millimetres in a key of metres, and the like.
constexpr auto kKeys = std::to_array<MachineKey>({
    {"machine", "name", text, kAny, "", "name of the machine"},
    {"machine", "sample_rate_hz", number, above_0_up_to(1e7), "Hz", "servo rate"},
    {"machine", "grouped_monitors", flag, kAny, "",
     "whether monitors hear of several samples as of one"},

    {"spindle", "torque_constant_Nm_per_A", number, kPositive, "Nm/A", "torque per ampere"},
    {"spindle", "inertia_kg_m2", number, kPositive, "kg m2", "inertia of all that turns"},
    {"spindle", "viscous_friction_Nm_s_per_rad", number, kNotNegative, "Nm s/rad",
     "friction per speed"},
    {"spindle", "coulomb_friction_Nm", number, kNotNegative, "Nm", "friction at any speed"},
    {"spindle", "friction_knee_rad", number, above_0_up_to(10), "rad",
     "presliding angle before the friction is fully there"},
    {"spindle", "encoder_counts_per_rev", number, kPositive, "counts", "encoder counts per turn"},
    {"spindle", "counter_bits", integer, {1, 64}, "bit", "width of the encoder counter"},
    {"spindle", "current_update_hz", number, above_0_up_to(1e7), "Hz",
     "rate of new current values"},
    {"spindle", "current_is_ratio", flag, kAny, "", "whether the current has no published scale"},
    {"spindle", "effort_column", text, kAny, "",
     "column of a trace that stands for its torque or current"},
    {"spindle", "constant_speed_rpm", number, above_0_up_to(1e6), "rpm",
     "speed when no column tells it"},
    {"spindle", "max_speed_rpm", number, above_0_up_to(1e6), "rpm",
     "greatest speed; beyond it a column is in another unit"},
    {"spindle", "rated_power_W", number, above_0_up_to(1e7), "W", "rated power"},
    {"spindle", "load_meter_V_per_W", number, kPositive, "V/W", "load meter volts per watt"},

    {"axis", "lead_m", number, above_0_up_to(1), "m", "travel per turn of the screw"},
    {"axis", "equivalent_mass_kg", number, kPositive, "kg",
     "stage plus reflected inertia of screw and motor"},
    {"axis", "moving_mass_kg", number, kNotNegative, "kg", "mass that gravity pulls at"},
    {"axis", "vertical", flag, kAny, "", "whether gravity pulls along the axis"},
    {"axis", "viscous_friction_N_s_per_m", number, kNotNegative, "N s/m", "friction per speed"},
    {"axis", "coulomb_friction_N", number, kNotNegative, "N", "friction at any speed"},
    {"axis", "friction_knee_m", number, above_0_up_to(0.01), "m",
     "presliding travel before the friction is fully there"},
    {"axis", "torque_constant_Nm_per_A", number, kPositive, "Nm/A", "motor torque per ampere"},
    {"axis", "force_constant_N_per_A", number, kPositive, "N/A", "force at the stage per ampere"},
    {"axis", "encoder_counts_per_rev", number, kPositive, "counts", "encoder counts per turn"},
    {"axis", "counter_bits", integer, {1, 64}, "bit", "width of the encoder counter"},
    {"axis", "current_update_hz", number, above_0_up_to(1e7), "Hz", "rate of new current values"},
    {"axis", "current_is_ratio", flag, kAny, "", "whether the current has no published scale"},
    {"axis", "effort_column", text, kAny, "",
     "column of a trace that stands for its force or current"},

    {"axis", "max_velocity_m_s", number, above_0_up_to(100), "m/s",
     "greatest velocity; beyond it a column is in another unit"},

    {"controller", "position_gain_per_s", number, kNotNegative, "1/s", "position loop gain"},
    {"controller", "velocity_integral_per_s", number, kNotNegative, "1/s",
     "1/Ti of the velocity loop"},
    {"controller", "current_limit_A", number, kPositive, "A", "largest current"},
    {"controller", "current_bandwidth_hz", number, above_0_up_to(1e6), "Hz",
     "first-order bandwidth of the current loop"},
    {"controller", "delay_s", number, up_to(1), "s", "dead time of the loop"},
    {"controller", "current_noise_A", number, kNotNegative, "A",
     "noise of the reported current, rms"},
    {"controller.axis", "velocity_gain_A_s_per_m", number, kNotNegative, "A s/m",
     "velocity loop gain at the stage"},
    {"controller.spindle", "velocity_gain_A_s_per_rad", number, kNotNegative, "A s/rad",
     "velocity loop gain"},

    {"observer", "disturbance_cutoff_rad_s", number, above_0_up_to(1e7), "rad/s",
     "cut-off of the disturbance observer"},
    {"observer", "velocity_cutoff_rad_s", number, above_0_up_to(1e7), "rad/s",
     "cut-off of the pseudo-derivative"},

    {"tool", "diameter_m", number, above_0_up_to(2), "m", "cutting diameter"},
    {"tool", "teeth", integer, {1, 1000}, "", "number of teeth"},
    {"tool", "helix_deg", number, within(89), "deg", "helix angle"},
    {"tool", "tangential_coefficient_N_per_m2", number, kNotNegative, "N/m2",
     "tangential force per chip area"},
    {"tool", "radial_ratio", number, within(10), "", "radial over tangential force"},
    {"tool", "tangential_edge_N_per_m", number, kNotNegative, "N/m",
     "tangential ploughing force per edge length"},
    {"tool", "radial_edge_N_per_m", number, kNotNegative, "N/m",
     "radial ploughing force per edge length"},
    {"tool", "runout_m", number, up_to(0.01), "m", "offset of the tool axis"},
    {"tool", "throw_m", list, within(0.01), "m", "radial throw of each tooth"},
    {"tool", "broken_teeth", list, kShare, "", "share of each tooth that is gone"},

    {"cut", "spindle_speed_rpm", number, above_0_up_to(1e6), "rpm", "spindle speed"},
    {"cut", "feed_per_tooth_m", number, above_0_up_to(0.05), "m", "feed per tooth"},
    {"cut", "axial_depth_m", number, above_0_up_to(2), "m", "axial depth of cut"},
    {"cut", "radial_immersion_m", number, above_0_up_to(2), "m", "radial width of cut"},
    {"cut", "direction", word, kAny, "", "milling direction", "up down slot"},
    {"cut", "regeneration", flag, kAny, "",
     "whether the chip remembers the vibration of the teeth before"},

    {"simulation", "step_s", number, above_0_up_to(1), "s", "time step"},
    {"simulation", "layers", integer, {1, 1e6}, "", "axial layers of the tool"},
    {"simulation", "surface_points", integer, {64, 1e6}, "", "points of the surface"},
    {"simulation", "duration_s", number, above_0_up_to(1e7), "s", "simulated time"},
    {"simulation", "seed", integer, {0, 0x1p53}, "", "seed of the random numbers"},
    {"simulation", "workpiece", text, kAny, "", "block, triangle with its depths, or a file"},
    {"simulation", "spindle_speed_profile", text, kAny, "", "a file, or a ramp in %/s"},
    {"simulation",
     "tooth_breaks",
     triples,
     kNotNegative,
     "s, 1, 1",
     "time_s tooth fraction of each tooth that breaks in the cut",
     "",
     {1, 1000},
     kPositiveShare},
    {"simulation", "start", word, kAny, "", "where the cut begins", "entry immersed"},

    {"structure", "modes", triples, kPositive, "Hz, 1, kg",
     "natural_frequency_hz damping_ratio modal_mass_kg of each mode", "", kDamping, kPositive},
    {"structure", "frf", text, kAny, "", "file with the receptance"},

    {"monitor", "enabled", flag, kAny, "", "whether the monitor runs"},
    {"monitor", "provenance", text, kAny, "", "which run found the values"},
    {"monitor", "false_alarm_rate_per_hour", number, kNotNegative, "1/h",
     "false alarms the thresholds were set for"},
    {"monitor.levels", "warning_fraction", number, kPositiveShare, "",
     "share of the threshold that warns"},
    {"monitor.own-cutoff", "cutoff_rad_s", number, above_0_up_to(1e7), "rad/s",
     "cut-off of its own observer"},
    // What its thresholds were learned under (monitors/learned_under.hpp).
    {"monitor.learned", "learned_sample_rate_hz", number, above_0_up_to(1e7), "Hz",
     "sample rate its thresholds were learned at"},
    {"monitor.learned", "learned_cutoff_rad_s", number, above_0_up_to(1e7), "rad/s",
     "cut-off of the observer they were learned with"},
    {"monitor.learned", "learned_velocity_cutoff_rad_s", number, above_0_up_to(1e7), "rad/s",
     "and of its pseudo-derivative"},
    {"monitor.learned-turning", "learned_counts_per_rev", number, kNotNegative, "counts",
     "encoder counts a turn they were learned with, 0: none"},
    {"monitor.learned-turning",
     "learned_teeth",
     integer,
     {0, 1000},
     "",
     "teeth of the tool they were learned with"},
    {"monitor.chatter", "learned_harmonics", integer, {1, 1e6}, "", "harmonics likewise"},
    {"monitor.chatter",
     "learned_window_revolutions",
     integer,
     {1, 1000},
     "",
     "turns in the window likewise"},
    {"monitor.collision", "consecutive_samples", integer, kCountFrom1, "",
     "samples in a row beyond the threshold"},
    {"monitor.collision", "learned_counts_x_per_rev", number, kNotNegative, "counts",
     "encoder counts a turn that those of x were learned with, 0: none"},
    {"monitor.collision", "learned_counts_y_per_rev", number, kNotNegative, "counts",
     "the same for y"},
    {"monitor.collision", "learned_counts_z_per_rev", number, kNotNegative, "counts",
     "the same for z"},
    {"monitor.collision",
     "learned_notch_hz",
     list,
     kNotNegative,
     "Hz",
     "lines taken out when they were learned",
     "",
     {},
     {},
     {2, 2}},

    {"monitor.collision", "threshold_N_per_s", number, kPositive, "N/s",
     "force rate that means a collision"},
    {"monitor.collision", "threshold_x_N_per_s", number, kPositive, "N/s", "the same for x"},
    {"monitor.collision", "threshold_y_N_per_s", number, kPositive, "N/s", "the same for y"},
    {"monitor.collision", "threshold_z_N_per_s", number, kPositive, "N/s", "the same for z"},
    {"monitor.collision",
     "phase_thresholds_x_N_per_s",
     list,
     above_0_up_to(1e12),
     "N/s",
     "thresholds of x at standstill, at constant speed, accelerating, reversing",
     "",
     {},
     {},
     {4, 4}},
    {"monitor.collision",
     "phase_thresholds_y_N_per_s",
     list,
     above_0_up_to(1e12),
     "N/s",
     "the same for y",
     "",
     {},
     {},
     {4, 4}},
    {"monitor.collision",
     "phase_thresholds_z_N_per_s",
     list,
     above_0_up_to(1e12),
     "N/s",
     "the same for z",
     "",
     {},
     {},
     {4, 4}},
    {"monitor.collision", "cutting_threshold_x_N_per_s", number, kPositive, "N/s",
     "force rate of x that means a collision while the tool cuts"},
    {"monitor.collision", "cutting_threshold_y_N_per_s", number, kPositive, "N/s",
     "the same for y"},
    {"monitor.collision", "cutting_threshold_z_N_per_s", number, kPositive, "N/s",
     "the same for z"},
    {"monitor.collision", "cutting_torque_Nm", number, kPositive, "Nm",
     "low-passed torque that means that the tool cuts"},
    {"monitor.collision", "maximum_feed_m_s", number, above_0_up_to(10), "m/s",
     "faster is a rapid"},
    {"monitor.collision", "slow_signal", flag, kAny, "",
     "whether it runs below 500 Hz too, late as it then is"},
    {"monitor.collision", "accelerating_m_s2", number, kPositive, "m/s2",
     "acceleration from which an axis counts as accelerating"},
    {"monitor.collision", "resonance_x_hz", number, kPositive, "Hz",
     "resonance of the stage of x while the motor is held"},
    {"monitor.collision", "resonance_y_hz", number, kPositive, "Hz", "the same for y"},
    {"monitor.collision", "resonance_z_hz", number, kPositive, "Hz", "the same for z"},
    {"monitor.collision",
     "notch_hz",
     list,
     above_0_up_to(1e6),
     "Hz",
     "lines to take out",
     "",
     {},
     {},
     {1, 2}},
    {"monitor.chatter", "chatter_threshold_Nm2", number, kPositive, "(Nm)2",
     "power of the torque that means chatter"},
    {"monitor.chatter", "forced_threshold_Nm2", number, kPositive, "(Nm)2",
     "variance of the torque that means forced vibration"},
    {"monitor.chatter",
     "window_revolutions",
     integer,
     {1, 1000},
     "",
     "spindle turns in the window"},
    {"monitor.chatter", "consecutive_revolutions", integer, kCountFrom1, "",
     "turns in a row at or above a level"},
    {"monitor.chatter", "minimum_speed_rad_s", number, above_0_up_to(1e6), "rad/s",
     "slower than this the monitor idles"},
    {"monitor.chatter",
     "harmonics",
     integer,
     {1, 1e6},
     "",
     "harmonics of the rotation that count as forced"},

    {"monitor.ar-breakage", "noise_Nm", number, kPositive, "Nm",
     "noise of the idling torque, mean over a tooth period"},
    {"monitor.ar-breakage", "share_threshold", number, above_0_up_to(10), "",
     "share of a tooth's load that has moved when it is broken"},
    {"monitor.tooth-breakage", "signal", word, kAny, "", "what it listens to", "torque force"},
    {"monitor.tooth-breakage", "noise_Nm", number, kPositive, "Nm",
     "noise of the idling torque, mean over a tooth period"},
    {"monitor.tooth-breakage", "sample_noise_Nm", number, kPositive, "Nm",
     "noise of the idling torque, of a sample"},
    {"monitor.tooth-breakage", "noise_N", number, kPositive, "N",
     "noise of the idling forces, mean over a tooth period"},
    {"monitor.tooth-breakage", "sample_noise_N", number, kPositive, "N",
     "noise of the idling forces, of a sample"},
    {"monitor.tooth-breakage", "tolerated_throw", number, kShare, "",
     "throw of a tooth as a part of the feed per tooth"},
    {"monitor.tooth-breakage", "swept_angle_rad", number, above_0_up_to(3.1416), "rad",
     "swept angle of every cut, when it is known"},
    {"monitor.drill-fracture", "threshold_N", number, kPositive, "N",
     "rotating force that means a fracture"},
    {"monitor.drill-fracture", "drilling_thrust_N", number, kPositive, "N",
     "thrust that means drilling"},
    {"monitor.drill-fracture", "rotation", word, kAny, "",
     "how a force that turns with the tool turns in x and y", "clockwise counter-clockwise"},
    {"monitor.drill-fracture",
     "window_samples",
     integer,
     {8, 512},
     "",
     "order of the rotational filter"},
    {"monitor.drill-fracture", "entry_s", number, up_to(100), "s", "of a hole, not judged"},
    {"monitor.drill-fracture", "average_s", number, above_0_up_to(100), "s",
     "over which the force is averaged"},
    {"monitor.wear", "feed_direction", integer, {-1, 1}, "", "of z into the workpiece; 0 = both"},
    {"monitor.wear", "cutting_thrust_N", number, kPositive, "N", "thrust that means cutting"},
    {"monitor.wear", "cutting_torque_Nm", number, kPositive, "Nm", "torque that means cutting"},
    {"monitor.wear", "thrust_limit_N", number, kPositive, "N", "mean thrust of a worn tool"},
    {"monitor.wear", "thrust_step_N", number, kPositive, "N", "step from hole to hole: chipping"},
    {"monitor.wear", "thrust_ratio", number, kPositive, "", "of the taught thrust"},
    {"monitor.wear", "torque_limit_Nm", number, kPositive, "Nm", "mean torque of a worn tool"},
    {"monitor.wear", "torque_step_Nm", number, kPositive, "Nm", "step from hole to hole"},
    {"monitor.wear", "torque_ratio", number, kPositive, "", "of the taught torque"},
    {"monitor.wear", "entry_m", number, up_to(1), "m", "of a cut, not counted"},
    {"monitor.wear", "exit_m", number, up_to(1), "m", "of a cut, not counted"},
    {"monitor.wear", "shortest_m", number, up_to(1), "m", "that has to remain of a cut"},
    {"monitor.wear", "clearance_m", number, up_to(1), "m", "of air before the workpiece"},
    {"monitor.wear", "peck_window_s", number, up_to(1000), "s", "pecks within it are one hole"},
    {"monitor.wear", "maximum_feed_m_s", number, above_0_up_to(10), "m/s", "faster is a rapid"},
    {"monitor.wear",
     "teach_holes",
     integer,
     {2, 10000},
     "",
     "first holes of a tool: the reference"},
    {"monitor.wear", "average_holes", integer, {1, 16}, "", "that make the level"},
    {"monitor.wear", "confirm_holes", integer, {1, 13}, "", "that agree on a step"},
    {"monitor.wear", "minimum_speed_rad_s", number, above_0_up_to(1e5), "rad/s",
     "slower than this the spindle does not cut"},
    {"monitor.wear", "friction_error_N", number, kNotNegative, "N",
     "that the friction of z may be off at the start"},
    {"monitor.wear", "friction_drift_N", number, kNotNegative, "N",
     "that it may drift by in a second"},
    {"monitor.wear", "friction_noise_N", number, kPositive, "N", "of a part of the stroke in air"},
    {"monitor.wear", "taught_thrust_N", number, kPositive, "N", "mean thrust of a new tool"},
    {"monitor.wear", "taught_thrust_scatter_N", number, kNotNegative, "N", "from hole to hole"},
    {"monitor.wear", "taught_torque_Nm", number, kPositive, "Nm", "mean torque of a new tool"},
    {"monitor.wear", "taught_torque_scatter_Nm", number, kNotNegative, "Nm", "from hole to hole"},
    {"monitor.reference", "reference", text, kAny, "",
     "file with sound cuts (`identify reference` writes it)"},
    {"monitor.torque-band", "reference", text, kAny, "", "file with the expected torque"},
    {"monitor.torque-band", "step_s", number, above_0_up_to(100), "s", "between verdicts"},
    {"monitor.torque-band", "max_shift_s", number, up_to(1000), "s",
     "that the program may be early or late"},
    {"monitor.torque-band", "shift_step_s", number, above_0_up_to(100), "s", "grid of shifts"},
    {"monitor.torque-band", "sync_shift_s", number, up_to(1000), "s",
     "that it may be off where a section has just begun"},
    {"monitor.torque-band", "step_m", number, above_0_up_to(1), "m",
     "between verdicts, for a reference over path"},
    {"monitor.torque-band", "max_shift_m", number, up_to(10), "m",
     "that the program may be early or late, likewise"},
    {"monitor.torque-band", "shift_step_m", number, above_0_up_to(1), "m",
     "grid of shifts, likewise"},
    {"monitor.torque-band", "sync_shift_m", number, up_to(10), "m",
     "that it may be off where a section has just begun, likewise"},
    {"monitor.torque-band", "max_drift", number, kShare, "", "of the shift, part of the progress"},
    {"monitor.torque-band",
     "memory_steps",
     number,
     {1, 1e6},
     "",
     "that a contradiction is remembered for"},
    {"monitor.torque-band", "alarm_steps", number, kPositive, "", "outside the band: an alarm"},
    {"monitor.torque-band", "air_limit_Nm", number, kPositive, "Nm",
     "by which the air level may differ from the taught one"},
    {"monitor.signal", "tolerated_share", number, kPositiveShare, "", "of faulty samples"},
    {"monitor.signal", "frozen_samples", integer, kSamples, "",
     "equal efforts in motion that are suspicious; 0: off"},

    {"detectability", "false_alarm_rate_per_hour", number, kNotNegative, "1/h",
     "false alarms at the smallest step"},
    {"detectability", "cutoff_rad_s", number, above_0_up_to(1e7), "rad/s",
     "observer cut-off the figures hold for"},
    {"detectability", "provenance", text, kAny, "", "which run found the values"},
    {"detectability.axis", "noise_floor_N", number, kNotNegative, "N", "noise of the force, rms"},
    {"detectability.axis", "smallest_step_N", number, kNotNegative, "N",
     "smallest force step that is seen"},
    {"detectability.spindle", "noise_floor_Nm", number, kNotNegative, "Nm",
     "noise of the torque, rms"},
    {"detectability.spindle", "smallest_step_Nm", number, kNotNegative, "Nm",
     "smallest torque step that is seen"},

    {"effect", "provenance", text, kAny, "", "which run found it, with what evidence"},
    {"effect", "used_by_monitors", flag, kAny, "", "whether monitors have it in their model"},
});

KeyKind kind_of(EffectValue value) {
  switch (value) {
    case EffectValue::number:
      return number;
    case EffectValue::integer:
      return integer;
    case EffectValue::word:
      return word;
    case EffectValue::list:
      return list;
    case EffectValue::pairs:
      return pairs;
  }
  return text;
}

// The keys above and those of core/effect_keys.hpp, the names of which it owns.
class Table {
 public:
  Table() : keys_(kKeys.begin(), kKeys.end()) {
    for (const EffectKey& effect : kEffectKeys)
      add(effect, "effect." + std::string(effect.effect),
          {effect.key, effect.unit, effect.meaning});
    for (const EffectKey& effect : kEffectKeys)
      if (effect.turning.key[0] != '\0')
        add(effect, "effect." + std::string(effect.effect) + ".turning", effect.turning);
  }
  [[nodiscard]] std::span<const MachineKey> keys() const { return keys_; }

 private:
  void add(const EffectKey& effect, std::string family, const EffectKey::Turning& called) {
    const bool is_word = effect.kind == EffectValue::word;
    const KeyRange range = is_word ? kAny : KeyRange{effect.low, effect.high};
    keys_.push_back({families_.emplace_back(std::move(family)), called.key, kind_of(effect.kind),
                     range, called.unit, called.meaning, effect.choices, range});
  }
  std::deque<std::string> families_;
  std::vector<MachineKey> keys_;
};

}  // namespace

std::span<const MachineKey> machine_keys() {
  static const Table table;
  return table.keys();
}

}  // namespace servosense
