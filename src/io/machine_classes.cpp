#include "servosense/io/machine_classes.hpp"

#include <array>

namespace servosense {
namespace {

constexpr auto kClasses = std::to_array<MachineClass>({
    {"small-mill", "milling and tapping centre with a 30 taper, screws of 16 mm lead"},
    {"machining-centre", "vertical machining centre with a 40 taper, tables of half a ton"},
    {"lathe", "slant-bed lathe with a chuck of 200 mm"},
    {"router", "light gantry with a high-frequency spindle"},
});

// Identified values where there are some. Else inertia is that of parts of steel of the size named,
// and friction follows mass as on the small mill: 0.41 to 0.63 N and 3.2 to 5.2 N s/m per kg, here
// 0.45 and 3.5. Nothing is here that must not be guessed: what scales a signal (encoder, lead,
// torque constant), what depends on how the machine is built (vertical), and thresholds, which are
// the noise of one machine.
constexpr const char* kX = "Koike 2016, table 3-4, TC-S2C";
constexpr const char* kY = "Koike 2016, table 3-5, TC-S2C";
constexpr const char* kZ = "Koike 2016, table 3-6, TC-S2C";
constexpr const char* kSpindle = "Koike 2016, table 3-7, TC-S2C";
constexpr const char* kAsMass = "as its mass, by the small mill";
constexpr const char* kCentre = "table 600 kg, motor 30 kg cm2, screw 40 mm x 1 m, lead 12 mm";
constexpr const char* kCentreSpindle = "convention: some 1.5 kW idling at 10000 rpm";
constexpr const char* kCross = "slide 150 kg, motor 20 kg cm2, screw 25 mm x 0.5 m, lead 6 mm";
constexpr const char* kCarriage = "carriage 400 kg, motor 30 kg cm2, screw 32 mm x 1 m, lead 10 mm";
constexpr const char* kLatheSpindle = "convention: some 1 kW idling at 4000 rpm";
constexpr const char* kGantry = "gantry 80 kg, motor 1 kg cm2, screw 25 mm x 1.3 m, lead 20 mm";
constexpr const char* kHead = "head 15 kg, motor 1 kg cm2, screw 20 mm x 0.4 m, lead 10 mm";
constexpr const char* kRouterSpindle = "convention: some 0.3 kW idling at 24000 rpm";

constexpr auto kTypical = std::to_array<TypicalValue>({
    {"small-mill", "spindle", "inertia_kg_m2", 0.0048, kSpindle},
    {"small-mill", "spindle", "viscous_friction_Nm_s_per_rad", 4.8e-4, kSpindle},
    {"small-mill", "spindle", "coulomb_friction_Nm", 0.11, kSpindle},
    {"small-mill", "axis.x", "equivalent_mass_kg", 227, kX},
    {"small-mill", "axis.x", "viscous_friction_N_s_per_m", 732, kX},
    {"small-mill", "axis.x", "coulomb_friction_N", 94, kX},
    {"small-mill", "axis.y", "equivalent_mass_kg", 325, kY},
    {"small-mill", "axis.y", "viscous_friction_N_s_per_m", 1025, kY},
    {"small-mill", "axis.y", "coulomb_friction_N", 151, kY},
    {"small-mill", "axis.z", "equivalent_mass_kg", 380, kZ},
    {"small-mill", "axis.z", "viscous_friction_N_s_per_m", 1968, kZ},
    {"small-mill", "axis.z", "coulomb_friction_N", 240, kZ},

    {"machining-centre", "spindle", "inertia_kg_m2", 0.045, "rotor of 110 mm x 400 mm"},
    {"machining-centre", "spindle", "viscous_friction_Nm_s_per_rad", 1e-3, kCentreSpindle},
    {"machining-centre", "spindle", "coulomb_friction_Nm", 0.4, kCentreSpindle},
    {"machining-centre", "axis.x", "equivalent_mass_kg", 2000, kCentre},
    {"machining-centre", "axis.x", "viscous_friction_N_s_per_m", 7000, kAsMass},
    {"machining-centre", "axis.x", "coulomb_friction_N", 900, kAsMass},
    {"machining-centre", "axis.y", "equivalent_mass_kg", 2000, kCentre},
    {"machining-centre", "axis.y", "viscous_friction_N_s_per_m", 7000, kAsMass},
    {"machining-centre", "axis.y", "coulomb_friction_N", 900, kAsMass},
    {"machining-centre", "axis.z", "equivalent_mass_kg", 2000, kCentre},
    {"machining-centre", "axis.z", "viscous_friction_N_s_per_m", 7000, kAsMass},
    {"machining-centre", "axis.z", "coulomb_friction_N", 900, kAsMass},

    {"lathe", "spindle", "inertia_kg_m2", 0.18,
     "chuck of 200 mm x 80 mm, rotor of 120 mm x 500 mm"},
    {"lathe", "spindle", "viscous_friction_Nm_s_per_rad", 3.3e-3, kLatheSpindle},
    {"lathe", "spindle", "coulomb_friction_Nm", 1, kLatheSpindle},
    {"lathe", "axis.x", "equivalent_mass_kg", 2500, kCross},
    {"lathe", "axis.x", "viscous_friction_N_s_per_m", 8700, kAsMass},
    {"lathe", "axis.x", "coulomb_friction_N", 1100, kAsMass},
    {"lathe", "axis.z", "equivalent_mass_kg", 1900, kCarriage},
    {"lathe", "axis.z", "viscous_friction_N_s_per_m", 6700, kAsMass},
    {"lathe", "axis.z", "coulomb_friction_N", 860, kAsMass},

    {"router", "spindle", "inertia_kg_m2", 7.2e-4, "rotor of 50 mm x 150 mm"},
    {"router", "spindle", "viscous_friction_Nm_s_per_rad", 3e-5, kRouterSpindle},
    {"router", "spindle", "coulomb_friction_Nm", 0.04, kRouterSpindle},
    {"router", "axis.x", "equivalent_mass_kg", 130, kGantry},
    {"router", "axis.x", "viscous_friction_N_s_per_m", 460, kAsMass},
    {"router", "axis.x", "coulomb_friction_N", 58, kAsMass},
    {"router", "axis.y", "equivalent_mass_kg", 130, kGantry},
    {"router", "axis.y", "viscous_friction_N_s_per_m", 460, kAsMass},
    {"router", "axis.y", "coulomb_friction_N", 58, kAsMass},
    {"router", "axis.z", "equivalent_mass_kg", 75, kHead},
    {"router", "axis.z", "viscous_friction_N_s_per_m", 260, kAsMass},
    {"router", "axis.z", "coulomb_friction_N", 34, kAsMass},
});

}  // namespace

std::span<const MachineClass> machine_classes() { return kClasses; }
std::span<const TypicalValue> typical_values() { return kTypical; }

}  // namespace servosense
