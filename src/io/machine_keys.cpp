#include "servosense/io/machine_keys.hpp"

#include <algorithm>
#include <array>
#include <optional>

#include "servosense/core/channel.hpp"
#include "servosense/io/text.hpp"

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
    {"effect.viscous-friction", "coefficient_N_s_per_m", number, kNotNegative, "N s/m", "D"},
    {"effect.coulomb-friction", "force_N", number, kNotNegative, "N", "C"},
    {"effect.stribeck-friction", "extra_static_N", number, kNotNegative, "N",
     "friction at rest beyond Coulomb's"},
    {"effect.stribeck-friction", "stribeck_velocity_m_per_s", number, kPositive, "m/s",
     "velocity at which it has fallen to 1/e"},
    {"effect.asymmetric-friction", "viscous_difference_N_s_per_m", number, kAny, "N s/m",
     "viscous friction forward less backward"},
    {"effect.asymmetric-friction", "coulomb_difference_N", number, kAny, "N",
     "Coulomb friction forward less backward"},
    {"effect.presliding-hysteresis", "stiffness_N_per_m", number, kPositive, "N/m",
     "stiffness of the bristles"},
    {"effect.presliding-hysteresis", "breakaway_N", number, kPositive, "N", "breakaway force"},
    {"effect.quadratic-drag", "coefficient_N_s2_per_m2", number, kAny, "N s2/m2", "Q"},
    {"effect.position-dependent-friction", "profile", pairs, kAny, "m, N",
     "position and friction of each knot", "", kAny},
    {"effect.thermal-friction-drift", "change_N", number, kAny, "N", "change from cold to warm"},
    {"effect.thermal-friction-drift", "time_constant_s", number, kPositive, "s", "time constant"},
    {"effect.constant-load", "force_N", number, kAny, "N", "load toward -axis"},
    {"effect.spring-load", "stiffness_N_per_m", number, kAny, "N/m", "stiffness"},
    {"effect.spring-load", "rest_position_m", number, kAny, "m", "position without force"},
    {"effect.torque-ripple", "order", list, kPositive, "1/turn", "periods per turn"},
    {"effect.torque-ripple", "amplitude_N", list, kNotNegative, "N", "amplitude of each order"},
    {"effect.torque-ripple", "phase_rad", list, kAny, "rad", "phase of each order"},
    {"effect.backlash", "width_m", number, up_to(0.1), "m", "play between motor and stage"},
    {"effect.flexible-coupling", "resonance_hz", number, kPositive, "Hz", "resonance"},
    {"effect.flexible-coupling", "damping_ratio", number, kDamping, "", "damping ratio"},
    {"effect.flexible-coupling", "mass_share", number, kShare, "", "share of the mass on the load"},
    {"effect.flexible-coupling", "friction_share", number, kShare, "",
     "share of the friction on the load"},
    {"effect.transport-delay", "delay_s", number, within(10), "s", "how much later"},
    {"effect.current-loop-lag", "bandwidth_hz", number, kPositive, "Hz", "bandwidth"},
    {"effect.encoder-eccentricity", "amplitude_rad", number, kNotNegative, "rad", "amplitude"},
    {"effect.encoder-eccentricity", "phase_rad", number, kAny, "rad", "phase"},
    {"effect.lead-error", "amplitude_m", list, kNotNegative, "m", "amplitude of each order"},
    {"effect.lead-error", "order", list, kPositive, "1/turn", "periods per turn"},
    {"effect.lead-error", "phase_rad", list, kAny, "rad", "phase of each order"},
    {"effect.lead-error", "slope", number, kAny, "m/m", "error per travel"},
    {"effect.runout", "throw_m", list, within(0.01), "m", "radial throw of the teeth"},
    {"effect.runout", "angle_rad", number, kAny, "rad", "where the throw points"},
    {"effect.missing-tooth", "tooth", integer, {1, 1000}, "", "number of the tooth, from 1"},
    {"effect.missing-tooth", "fraction", number, kShare, "", "share that is gone"},
    {"effect.missing-tooth", "shorter_m", number, within(0.01), "m",
     "chipped along the whole edge: by how much it reaches less"},
    {"effect.edge-force", "tangential_edge_N_per_m", number, kNotNegative, "N/m", "Kte"},
    {"effect.edge-force", "radial_edge_N_per_m", number, kNotNegative, "N/m", "Kre"},
    {"effect.size-effect", "exponent", number, within(10), "", "m in (h/h0)^-m"},
    {"effect.process-damping", "coefficient", number, kNotNegative, "", "coefficient"},
    {"effect.extra-mode", "natural_frequency_hz", number, kPositive, "Hz", "natural frequency"},
    {"effect.extra-mode", "damping_ratio", number, kDamping, "", "damping ratio"},
    {"effect.extra-mode", "modal_mass_kg", number, kPositive, "kg", "modal mass"},
    {"effect.sensor-resonance", "natural_frequency_hz", number, kPositive, "Hz",
     "natural frequency"},
    {"effect.sensor-resonance", "damping_ratio", number, kDamping, "", "damping ratio"},
    {"effect.sensor-resonance", "natural_frequency_y_hz", number, kPositive, "Hz",
     "natural frequency in y, where it differs"},
    {"effect.sensor-resonance", "damping_ratio_y", number, kDamping, "",
     "damping ratio in y, where it differs"},
    {"effect.helix-lag", "helix_deg", number, within(89), "deg", "helix angle"},
    {"effect.pitch-error", "angle_rad", list, kAny, "rad", "angle of each tooth off its place"},
    {"effect.cross-talk", "other_channel", word, kAny, "", "channel whose motion is felt",
     "spindle x y z a b c tool dyno hammer machine"},
    {"effect.cross-talk", "coefficient", number, kAny, "", "coefficient"},
    {"effect.cross-talk", "of", word, kAny, "", "what of that channel is felt",
     "acceleration velocity position effort"},
    {"effect.load-dependent-friction", "coefficient", number, kNotNegative, "",
     "friction per transmitted force"},
    {"effect.time-locked-vibration", "frequency_hz", number, kPositive, "Hz", "frequency"},
    {"effect.time-locked-vibration", "amplitude_N", number, kNotNegative, "N", "amplitude"},

    // The same effects where the channel turns: the equations are in torque and angle.
    {"effect.viscous-friction.turning", "coefficient_Nm_s_per_rad", number, kNotNegative,
     "Nm s/rad", "D"},
    {"effect.coulomb-friction.turning", "torque_Nm", number, kNotNegative, "Nm", "C"},
    {"effect.stribeck-friction.turning", "extra_static_Nm", number, kNotNegative, "Nm",
     "friction at rest beyond Coulomb's"},
    {"effect.stribeck-friction.turning", "stribeck_velocity_rad_per_s", number, kPositive, "rad/s",
     "speed at which it has fallen to 1/e"},
    {"effect.asymmetric-friction.turning", "viscous_difference_Nm_s_per_rad", number, kAny,
     "Nm s/rad", "viscous friction forward less backward"},
    {"effect.asymmetric-friction.turning", "coulomb_difference_Nm", number, kAny, "Nm",
     "Coulomb friction forward less backward"},
    {"effect.presliding-hysteresis.turning", "stiffness_Nm_per_rad", number, kPositive, "Nm/rad",
     "stiffness of the bristles"},
    {"effect.presliding-hysteresis.turning", "breakaway_Nm", number, kPositive, "Nm",
     "breakaway torque"},
    {"effect.quadratic-drag.turning", "coefficient_Nm_s2_per_rad2", number, kAny, "Nm s2/rad2",
     "Q"},
    {"effect.thermal-friction-drift.turning", "change_Nm", number, kAny, "Nm",
     "change from cold to warm"},
    {"effect.constant-load.turning", "torque_Nm", number, kAny, "Nm", "load"},
    {"effect.spring-load.turning", "stiffness_Nm_per_rad", number, kAny, "Nm/rad", "stiffness"},
    {"effect.spring-load.turning", "rest_angle_rad", number, kAny, "rad", "angle without torque"},
    {"effect.torque-ripple.turning", "amplitude_Nm", list, kNotNegative, "Nm",
     "amplitude of each order"},
    {"effect.backlash.turning", "width_rad", number, kNotNegative, "rad", "play"},
    {"effect.flexible-coupling.turning", "inertia_share", number, kShare, "",
     "share of the inertia on the load"},
    {"effect.time-locked-vibration.turning", "amplitude_Nm", number, kNotNegative, "Nm",
     "amplitude"},
});

constexpr auto kEffects = std::to_array<std::string_view>({
    "viscous-friction",
    "coulomb-friction",
    "stribeck-friction",
    "asymmetric-friction",
    "presliding-hysteresis",
    "quadratic-drag",
    "position-dependent-friction",
    "thermal-friction-drift",
    "constant-load",
    "spring-load",
    "torque-ripple",
    "backlash",
    "flexible-coupling",
    "transport-delay",
    "current-loop-lag",
    "encoder-eccentricity",
    "lead-error",
    "runout",
    "missing-tooth",
    "edge-force",
    "size-effect",
    "process-damping",
    "regeneration",
    "extra-mode",
    "sensor-resonance",
    "helix-lag",
    "pitch-error",
    "cross-talk",
    "load-dependent-friction",
    "time-locked-vibration",
});

constexpr auto kMonitors =
    std::to_array<std::string_view>({"chatter", "collision", "drill-fracture", "ar-breakage",
                                     "tooth-breakage", "wear", "torque-band", "signal"});

// Keys of some monitors and not of the others.
constexpr std::array<std::string_view, 4> kLearned = {"chatter", "collision", "ar-breakage",
                                                      "tooth-breakage"};
constexpr std::array<std::string_view, 3> kTurning = {"chatter", "ar-breakage", "tooth-breakage"};
constexpr std::array<std::string_view, 2> kOwnCutoff = {"chatter", "collision"};
constexpr std::array<std::string_view, 7> kLevels = {
    "chatter",        "collision", "drill-fracture", "ar-breakage",
    "tooth-breakage", "wear",      "torque-band"};
struct SharedKeys {
  std::string_view family;
  std::span<const std::string_view> monitors;
};
constexpr std::array<SharedKeys, 4> kSharedKeys = {{{"monitor.levels", kLevels},
                                                    {"monitor.own-cutoff", kOwnCutoff},
                                                    {"monitor.learned", kLearned},
                                                    {"monitor.learned-turning", kTurning}}};

// Sections with a fixed name and the families of their keys.
struct PlainSection {
  std::string_view name;
  std::string_view family;
  std::string_view special;  // "" for none
};
constexpr auto kPlainSections = std::to_array<PlainSection>({
    {"machine", "machine", ""},
    {"spindle", "spindle", ""},
    {"axis.x", "axis", ""},
    {"axis.y", "axis", ""},
    {"axis.z", "axis", ""},
    {"controller.x", "controller", "controller.axis"},
    {"controller.y", "controller", "controller.axis"},
    {"controller.z", "controller", "controller.axis"},
    {"controller.spindle", "controller", "controller.spindle"},
    {"observer.x", "observer", ""},
    {"observer.y", "observer", ""},
    {"observer.z", "observer", ""},
    {"observer.spindle", "observer", ""},
    {"tool", "tool", ""},
    {"cut", "cut", ""},
    {"simulation", "simulation", ""},
    {"structure.x", "structure", ""},
    {"structure.y", "structure", ""},
    {"detectability.x", "detectability", "detectability.axis"},
    {"detectability.y", "detectability", "detectability.axis"},
    {"detectability.z", "detectability", "detectability.axis"},
    {"detectability.spindle", "detectability", "detectability.spindle"},
});

bool contains(std::span<const std::string_view> names, std::string_view name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

bool turns(Channel channel) {
  return channel == Channel::spindle || channel == Channel::a || channel == Channel::b ||
         channel == Channel::c;
}

/// {"x", "backlash"} from "effect.x.backlash".
struct EffectSection {
  std::string_view channel;
  std::string_view name;
};
std::optional<EffectSection> effect_section(std::string_view section) {
  constexpr std::string_view kPrefix = "effect.";
  if (!section.starts_with(kPrefix)) return std::nullopt;
  section.remove_prefix(kPrefix.size());
  const std::size_t dot = section.find('.');
  if (dot == std::string_view::npos) return EffectSection{section, {}};
  return EffectSection{section.substr(0, dot), section.substr(dot + 1)};
}

std::string range_text(const KeyRange& range) {
  const bool from = range.low > kAny.low;
  const bool to = range.high < kAny.high;
  const std::string low =
      (range.low_excluded ? " greater than " : " of at least ") + number_text(range.low);
  if (from && to) return low + " and at most " + number_text(range.high);
  if (from) return low;
  return to ? " of at most " + number_text(range.high) : "";
}

/// "1 to 2 " before "numbers"; nothing where any count will do.
std::string count_text(const KeyCount& count) {
  if (count.most == KeyCount{}.most) return "";
  const std::string most = std::to_string(count.most) + " ";
  return count.fewest == count.most ? most : std::to_string(count.fewest) + " to " + most;
}

}  // namespace

std::span<const MachineKey> machine_keys() { return kKeys; }
std::span<const std::string_view> effect_names() { return kEffects; }
std::span<const std::string_view> monitor_names() { return kMonitors; }

std::vector<std::string> section_families(std::string_view section) {
  for (const PlainSection& plain : kPlainSections) {
    if (plain.name != section) continue;
    if (plain.special.empty()) return {std::string(plain.family)};
    return {std::string(plain.special), std::string(plain.family)};
  }
  constexpr std::string_view kMonitor = "monitor.";
  if (section.starts_with(kMonitor) && contains(kMonitors, section.substr(kMonitor.size()))) {
    std::vector<std::string> families = {std::string(section), "monitor"};
    for (const SharedKeys& shared : kSharedKeys)
      if (contains(shared.monitors, section.substr(kMonitor.size())))
        families.emplace_back(shared.family);
    return families;
  }
  if (const auto effect = effect_section(section)) {
    const auto channel = channel_from(effect->channel);
    if (!channel || !contains(kEffects, effect->name)) return {};
    const std::string family = "effect." + std::string(effect->name);
    if (turns(*channel)) return {family + ".turning", family, "effect"};
    return {family, "effect"};
  }
  return {};
}

const MachineKey* find_machine_key(std::string_view section, std::string_view key) {
  for (const std::string& family : section_families(section))
    for (const MachineKey& known : kKeys)
      if (known.family == family && known.name == key) return &known;
  return nullptr;
}

std::string nearest_section(std::string_view section) {
  if (const auto effect = effect_section(section)) {
    // Channel and name are corrected apart: the whole would be too far from every known one.
    const std::string_view channel = nearest_name(effect->channel, kChannelNames);
    return "effect." + std::string(channel) + "." +
           std::string(nearest_name(effect->name, kEffects));
  }
  std::vector<std::string> names;
  for (const PlainSection& plain : kPlainSections) names.emplace_back(plain.name);
  for (const std::string_view monitor : kMonitors)
    names.push_back("monitor." + std::string(monitor));
  const std::vector<std::string_view> views(names.begin(), names.end());
  return std::string(nearest_name(section, views));
}

std::string nearest_key(std::string_view section, std::string_view key) {
  std::vector<std::string_view> names;
  for (const std::string& family : section_families(section))
    for (const MachineKey& known : kKeys)
      if (known.family == family) names.push_back(known.name);
  return std::string(nearest_name(key, names));
}

std::string expectation(const MachineKey& key) {
  const std::string unit = key.unit.empty() ? "" : " [" + std::string(key.unit) + "]";
  switch (key.kind) {
    case KeyKind::number:
      return "a number" + range_text(key.range) + unit;
    case KeyKind::integer:
      return "a whole number" + range_text(key.range) + unit;
    case KeyKind::flag:
      return "yes or no";
    case KeyKind::word:
      return "one of: " + std::string(key.choices);
    case KeyKind::text:
      return "text";
    case KeyKind::list:
      return count_text(key.count) + "numbers" + range_text(key.range) + " between commas" + unit;
    case KeyKind::pairs:
      return "pairs '" + std::string(key.meaning) + "' with a comma between them" + unit;
    case KeyKind::triples:
      return "triples '" + std::string(key.meaning) + "' with a comma between them" + unit;
  }
  return {};
}

}  // namespace servosense
