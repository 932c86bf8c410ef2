#include "servosense/io/sheet_figures.hpp"

#include <array>

#include "servosense/io/text.hpp"

namespace servosense {
namespace {

using enum KeyKind;
constexpr KeyRange kAboveZero{0, KeyRange{}.high, true};

constexpr auto kFigures = std::to_array<MachineKey>({
    {"drive", "motor_inertia", number, kAboveZero, "kg m2",
     "rotor of the motor, with brake and coupling"},
    {"linear", "screw_inertia", number, kAboveZero, "kg m2", "of the screw"},
    {"linear", "table_mass", number, kAboveZero, "kg", "of all that the screw moves"},
    {"turning", "load_inertia", number, kAboveZero, "kg m2", "of all that turns besides the motor"},
    {"linear",
     "encoder_resolution",
     number,
     {0, 0.01, true},
     "m",
     "travel of one count, of a linear encoder"},
    {"turning",
     "encoder_resolution",
     number,
     {0, 1, true},
     "rad",
     "angle of one count, of an encoder on the motor"},
    {"drive", "rated_torque", number, kAboveZero, "Nm", "of the motor"},
    {"drive", "rated_current", number, kAboveZero, "A", "of the motor, at the rated torque"},
    {"drive", "rated_power", number, {0, 1e7, true}, "W", "of the motor"},
    {"drive", "rated_speed", number, {0, 1e6, true}, "rpm", "of the motor, at the rated power"},
    {"drive", "voltage_constant", number, kAboveZero, "V s/rad",
     "of a synchronous motor, between two phases, effective"},
    {"drive",
     "reported_current",
     word,
     {},
     "",
     "what the current in a trace is: of an alternating current the effective value or the peak",
     "rms peak"},
});

// What plan_stack(), axis_config(), the simulators and export do without the key.
// tests/cli/test_init.cpp holds each clause to them.
constexpr auto kNeeded = std::to_array<NeededKey>({
    {"machine", "sample_rate_hz",
     "export refuses the file, simulators take 8000 Hz, and the rate of a trace is not held "
     "against it"},
    {"turning", "torque_constant_Nm_per_A",
     "the current of {drive} cannot be turned into a torque: a trace with it watches nothing "
     "there"},
    {"turning", "encoder_counts_per_rev",
     "encoder counts of {drive} cannot be read; angles and speeds can"},
    {"turning", "counter_bits",
     "the counter of {drive} is taken to have 32 bits; of a narrower one each overflow reads as a "
     "jump"},
    {"spindle", "inertia_kg_m2",
     "every acceleration of {drive} reads as the torque of a cut, and no chatter is watched for, "
     "until 'servosense identify idle' has found it"},
    {"turning", "inertia_kg_m2",
     "every acceleration of {drive} reads as the torque of a cut until 'servosense identify idle' "
     "has found it"},
    {"turning", "viscous_friction_Nm_s_per_rad",
     "friction of {drive} that grows with speed reads as cutting torque until 'servosense identify "
     "idle' has found it"},
    {"turning", "coulomb_friction_Nm",
     "friction of {drive} reads as cutting torque until 'servosense identify idle' has found it"},
    {"spindle", "rated_power_W",
     "monitor does not say so where chatter would have to exceed the spindle's rated torque to be "
     "seen"},
    {"linear", "lead_m",
     "encoder counts, motor angles and motor torques of {drive} cannot be turned into metres and "
     "newtons"},
    {"linear", "torque_constant_Nm_per_A",
     "the current of {drive} cannot be turned into a force: a trace with it watches nothing there"},
    {"linear", "encoder_counts_per_rev",
     "encoder counts of {drive} cannot be read; positions and velocities can"},
    {"linear", "counter_bits",
     "the counter of {drive} is taken to have 32 bits; of a narrower one each overflow reads as a "
     "jump"},
    {"linear", "equivalent_mass_kg",
     "every acceleration of {drive} reads as a cutting force, and no collision is watched for "
     "there, until 'servosense identify idle' has found it"},
    {"linear", "viscous_friction_N_s_per_m",
     "friction of {drive} that grows with speed reads as cutting force until 'servosense identify "
     "idle' has found it"},
    {"linear", "coulomb_friction_N",
     "friction of {drive} reads as cutting force until 'servosense identify idle' has found it"},
    {"axis.z", "vertical",
     "z is taken to lie flat; if it does not, its weight reads as a cutting force"},
    {"linear", "moving_mass_kg",
     "gravity is taken to pull at the equivalent mass of {drive}, screw and motor included, until "
     "'servosense identify idle' has found it"},
    {"tool", "teeth", "AR breakage and tooth breakage do not run"},
    {"tool", "diameter_m",
     "while the tool cuts, collision cannot hold the forces of x and y against the torque of the "
     "spindle"},
});

constexpr auto kQuestions = std::to_array<SheetQuestion>({
    {"machine", "name", "", "name of the machine"},
    {"machine", "sample_rate_hz", "kHz", "servo rate"},
    {"turning", "torque_constant_Nm_per_A", "Nm/A", "torque constant"},
    {"turning", "rated_torque", "Nm", "rated torque of the motor", "torque_constant_Nm_per_A"},
    {"turning", "rated_current", "A", "rated current of the motor, effective",
     "torque_constant_Nm_per_A", "rated_torque"},
    {"turning", "encoder_counts_per_rev", "counts",
     "encoder, per turn; also '20 bit' or '5000 lines'"},
    {"turning", "motor_inertia", "kg cm2", "inertia of the motor", "inertia_kg_m2"},
    {"turning", "load_inertia", "kg cm2", "inertia of what else turns", "", "motor_inertia"},
    {"turning", "gear_ratio", "", "gear, turns of the motor per turn of the drive", "",
     "motor_inertia"},
    {"spindle", "rated_power_W", "kW", "rated power"},
    {"linear", "lead_m", "mm", "lead of the screw, travel per turn"},
    {"linear", "gear_ratio", "", "gear, turns of the motor per turn of the screw", "", "lead_m"},
    {"linear", "torque_constant_Nm_per_A", "Nm/A", "torque constant of the motor",
     "force_constant_N_per_A", "lead_m"},
    {"linear", "rated_torque", "Nm", "rated torque of the motor", "torque_constant_Nm_per_A",
     "lead_m"},
    {"linear", "rated_current", "A", "rated current of the motor, effective",
     "torque_constant_Nm_per_A", "rated_torque"},
    {"linear", "encoder_counts_per_rev", "counts",
     "encoder, per turn; also '20 bit' or '5000 lines'"},
    {"linear", "table_mass", "kg", "mass of all that the screw moves", "equivalent_mass_kg"},
    {"linear", "motor_inertia", "kg cm2", "inertia of the motor", "equivalent_mass_kg",
     "table_mass"},
    {"linear", "screw_inertia", "kg cm2", "inertia of the screw", "", "motor_inertia"},
    {"axis.z", "vertical", "", "does gravity pull along z (yes or no)"},
    {"tool", "teeth", "", "number of teeth of the tool"},
    {"tool", "diameter_m", "mm", "diameter of the tool"},
});

bool is_of(std::string_view family, DriveKind kind) {
  return kind != DriveKind::none &&
         (family == "drive" || family == (kind == DriveKind::linear ? "linear" : "turning"));
}

}  // namespace

DriveKind drive_kind(std::string_view section) {
  if (find_machine_key(section, "equivalent_mass_kg") != nullptr) return DriveKind::linear;
  if (find_machine_key(section, "inertia_kg_m2") != nullptr) return DriveKind::turning;
  return DriveKind::none;
}

std::span<const MachineKey> sheet_figures() { return kFigures; }

const MachineKey* find_sheet_figure(std::string_view section, std::string_view name) {
  for (const MachineKey& figure : kFigures)
    if (figure.name == name && is_of(figure.family, drive_kind(section))) return &figure;
  return nullptr;
}

const MachineKey* find_sheet_key(std::string_view section, std::string_view name) {
  const MachineKey* const key = find_machine_key(section, name);
  return key != nullptr ? key : find_sheet_figure(section, name);
}

std::string nearest_sheet_key(std::string_view section, std::string_view name) {
  const std::string key = nearest_key(section, name);
  std::vector<std::string_view> names = {key};
  for (const MachineKey& figure : kFigures)
    if (is_of(figure.family, drive_kind(section))) names.push_back(figure.name);
  return std::string(nearest_name(name, names));
}

bool is_per_turn(const MachineKey& key) {
  return key.name == "lead_m" || key.name.ends_with("_per_rev");
}

std::span<const NeededKey> needed_keys() { return kNeeded; }
std::span<const SheetQuestion> sheet_questions() { return kQuestions; }

bool means_section(std::string_view stated, std::string_view section) {
  return stated == section || is_of(stated, drive_kind(section));
}

std::string_view drive_of(std::string_view section) {
  return section.substr(section.find('.') + 1);
}

}  // namespace servosense
