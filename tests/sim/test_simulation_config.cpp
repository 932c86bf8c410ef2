// The machine file as the simulators read it, value by value, and what is refused.
#include <algorithm>
#include <string>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/sim/simulation_config.hpp"

using namespace servosense;

namespace {

const std::string kTool =
    "[tool]\ndiameter_m = 0.02\nteeth = 4\ntangential_coefficient_N_per_m2 = 7e8\n"
    "radial_ratio = 0.4\n";
const std::string kCut =
    "[cut]\nspindle_speed_rpm = 6000\nfeed_per_tooth_m = 1e-4\naxial_depth_m = 0.002\n"
    "radial_immersion_m = 0.01\ndirection = up\n";

MachineFile file(const std::string& text) {
  auto machine = MachineFile::parse(text, "m.ini");
  if (!machine) check::fail(__FILE__, __LINE__) << machine.error().sentence << '\n';
  return machine ? *machine : *MachineFile::parse("", "m.ini");
}

template <typename Result>
void refused(const Result& result, const std::string& part) {
  CHECK(!result);
  if (!result && result.error().sentence.find(part) == std::string::npos)
    CHECK_TEXT(result.error().sentence, part);
}

void test_tool() {
  const auto plain = milling_tool(file(kTool + "helix_deg = 30\nrunout_m = 1e-5\n"));
  CHECK(plain.has_value());
  if (!plain) return;
  CHECK_NEAR(plain->diameter_m, 0.02, 0);
  CHECK(plain->teeth == 4);
  CHECK_NEAR(plain->helix_deg, 30, 0);
  CHECK_NEAR(plain->force.tangential_coefficient_N_per_m2, 7e8, 0);
  CHECK_NEAR(plain->force.radial_ratio, 0.4, 0);
  // An offset of the tool axis toward tooth 1 throws tooth 3 in and leaves 2 and 4 where they are.
  CHECK(plain->throw_m.size() == 4);
  const double expected[] = {1e-5, 0, -1e-5, 0};
  for (std::size_t i = 0; i < 4; ++i) CHECK_NEAR(plain->throw_m[i], expected[i], 1e-20);

  const auto changed = milling_tool(file(
      kTool +
      "throw_m = 1e-6, 2e-6, 3e-6, 4e-6\nbroken_teeth = 0, 0.5, 0, 0\ntangential_edge_N_per_m "
      "= 1000\n[effect.tool.edge-force]\ntangential_edge_N_per_m = 9000\nradial_edge_N_per_m "
      "= 7000\n[effect.tool.size-effect]\nexponent = 0.25\n[effect.tool.helix-lag]\nhelix_deg "
      "= 38\n[effect.tool.missing-tooth]\ntooth = 4\n[effect.tool.runout]\nthrow_m = "
      "2e-6\nangle_rad = 3.141592653589793\n[effect.tool.process-damping]\ncoefficient = 3e4\n"));
  CHECK(changed.has_value());
  if (!changed) return;
  const double thrown[] = {-1e-6, 2e-6, 5e-6, 4e-6};
  const double broken[] = {0, 0.5, 0, 1};
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK_NEAR(changed->throw_m[i], thrown[i], 1e-20);
    CHECK_NEAR(changed->broken_fraction[i], broken[i], 0);
  }
  CHECK_NEAR(changed->force.tangential_edge_N_per_m, 10000, 0);
  CHECK_NEAR(changed->force.radial_edge_N_per_m, 7000, 0);
  CHECK_NEAR(changed->force.size_effect_exponent, 0.25, 0);
  CHECK_NEAR(changed->helix_deg, 38, 0);

  // The run-out acts where the teeth stand, wherever the sections are.
  const auto pitch = milling_tool(
      file(kTool + "runout_m = 1e-5\n[effect.tool.pitch-error]\nangle_rad = 0, 0.1, 0, -0.1\n"));
  CHECK(pitch.has_value());
  if (!pitch) return;
  CHECK_NEAR(pitch->tooth_angle_rad[1], kPi / 2 + 0.1, 1e-15);
  CHECK_NEAR(pitch->throw_m[1], 1e-5 * std::cos(kPi / 2 + 0.1), 1e-20);

  refused(milling_tool(file(kCut)), "[tool]");
  refused(milling_tool(file("[tool]\ndiameter_m = 0.02\nteeth = 2\n")),
          "tangential_coefficient_N_per_m2");
  refused(milling_tool(file(kTool + "throw_m = 1e-6, 2e-6\n")),
          "m.ini:6: throw_m needs one number");
  refused(milling_tool(file(kTool + "broken_teeth = 1, 0, 0, 0, 0\n")), "4 teeth, not 5");
  refused(milling_tool(file(kTool + "[effect.tool.missing-tooth]\ntooth = 5\n")),
          "from 1 to the 4");
}

void test_cut_and_structure() {
  const auto cut = milling_cut(file(kCut));
  CHECK(cut && cut->direction == MillingDirection::up);
  if (cut) CHECK_NEAR(cut->radial_immersion_m, 0.01, 0);
  const auto slot = milling_cut(file(
      "[cut]\nspindle_speed_rpm = 1\nfeed_per_tooth_m = 1e-4\naxial_depth_m = 0.1\ndirection = "
      "slot\n"));
  CHECK(slot && slot->direction == MillingDirection::slot);
  refused(milling_cut(file("[cut]\nspindle_speed_rpm = 1\nfeed_per_tooth_m = 1e-4\naxial_depth_m = "
                           "0.1\n")),
          "radial_immersion_m");
  const auto regenerates = [](const std::string& more) {
    const auto read = milling_cut(file(kCut + more));
    return read && read->regeneration;
  };
  CHECK(regenerates(""));
  CHECK(!regenerates("regeneration = no\n"));
  CHECK(regenerates("regeneration = no\n[effect.tool.regeneration]\nprovenance = run 9\n"));
  const std::string modes = "[structure.x]\nmodes = 600 0.03 12, 910.5 0.02 7\n";
  const auto one = structure_modes(file(modes));
  CHECK(one && one->x.size() == 2 && one->y.empty());
  const std::string extra = "natural_frequency_hz = 410\ndamping_ratio = 0.02\nmodal_mass_kg = 6\n";
  const auto in_y = structure_modes(file(modes + "[effect.y.extra-mode]\n" + extra));
  CHECK(in_y && in_y->x.size() == 2 && in_y->y.size() == 1);
  const auto in_both = structure_modes(file(modes + "[effect.tool.extra-mode]\n" + extra));
  CHECK(in_both && in_both->x.size() == 3 && in_both->y.size() == 1);
  if (in_both) CHECK_NEAR(in_both->y[0].modal_mass_kg, 6, 0);
  refused(structure_modes(file("[structure.y]\nfrf = y.csv\n")), "modes are needed");
}

Expected<MillingSimulation> simulation(const std::string& keys, double duration_s = 2) {
  return milling_simulation(file(kTool + kCut + "[simulation]\n" + keys), duration_s);
}

void test_simulation() {
  const auto plain =
      simulation("layers = 20\nstep_s = 1e-5\nstart = entry\nsurface_points = 100\n");
  CHECK(plain && plain->layers == 20 && plain->start == MillingStart::entry &&
        plain->surface_points == 100 && !plain->workpiece.is_endless());
  if (plain) CHECK_NEAR(plain->step_s, 1e-5, 0);

  // 100 turns/s, 4 teeth, 0.1 mm: 40 mm/s, so 80 mm in 2 s.
  const auto wedge = simulation("workpiece = triangle 0.001 0.006\n");
  CHECK(wedge && wedge->workpiece.is_wedge());
  if (wedge) {
    CHECK_NEAR(wedge->workpiece.length_m, 0.08, 1e-15);
    CHECK_NEAR(wedge->workpiece.far_depth_m, 0.006, 0);
  }
  const auto block = simulation("workpiece = block 0.1, hole 0.03 0 0.005, slot 0.05 0.06\n");
  CHECK(block && block->workpiece.holes.size() == 1 && block->workpiece.slots.size() == 1);
  if (block) {
    CHECK_NEAR(block->workpiece.length_m, 0.1, 0);
    CHECK_NEAR(block->workpiece.holes[0].radius_m, 0.005, 0);
    CHECK_NEAR(block->workpiece.slots[0].to_m, 0.06, 0);
  }
  refused(simulation("workpiece = hole 0.1 0.2\n"), "m.ini:13: workpiece: expected 'block");
  refused(simulation("workpiece = block 0.1,\n"), "hole");
  refused(simulation("workpiece = triangle a b\n"), "expected a number, not 'a'");
  refused(simulation("workpiece = no_such_file.txt\n"), "no_such_file.txt");

  const auto ramp = simulation("spindle_speed_profile = -2 %/s\n");
  CHECK(ramp.has_value());
  if (ramp) {
    CHECK_NEAR(ramp->speed.speed_rpm(0), 6000, 1e-9);
    CHECK_NEAR(ramp->speed.speed_rpm(1), 6000 - 120, 1e-9);
    CHECK_NEAR(ramp->speed.speed_rpm(9), 6000 - 240, 1e-9);
  }
  // Koike 2016, ch. 8: from 9000 to 5400 rpm at 50 %/s of 7200 takes one second.
  const auto koike = simulation("spindle_speed_profile = -50%/s of 7200 from 9000 to 5400\n");
  CHECK(koike.has_value());
  if (koike) {
    CHECK_NEAR(koike->speed.speed_rpm(0.5), 7200, 1e-9);
    CHECK_NEAR(koike->speed.speed_rpm(1), 5400, 1e-9);
    CHECK_NEAR(koike->speed.speed_rpm(1.5), 5400, 1e-9);
  }
  const auto breaks = simulation("tooth_breaks = 0.5 3 1, 0.8 1 0.25\n");
  CHECK(breaks && breaks->breaks.size() == 2 && breaks->breaks[0].tooth == 3 &&
        breaks->breaks[1].fraction == 0.25 && breaks->breaks[1].time_s == 0.8);
  refused(simulation("tooth_breaks = 0.5 5 1\n"), "teeth 1 to 4");
  refused(simulation("spindle_speed_profile = 5 %/s to 3000\n"), "leads away");
  refused(simulation("spindle_speed_profile = 0 %/s\n"), "no number other than zero");
  refused(simulation("spindle_speed_profile = -5 %/s until 3000\n"), "'until'");
  refused(simulation("spindle_speed_profile = -5 %/s to\n"), "is neither");
  refused(simulation("spindle_speed_profile = -5 %/s to -3000\n"), "no positive speed");
  refused(simulation("spindle_speed_profile = no_such_trace.csv\n"), "no_such_trace.csv");
}

void test_drives() {
  const std::string spindle =
      "[machine]\nsample_rate_hz = 4000\n[spindle]\ntorque_constant_Nm_per_A = 0.5\ninertia_kg_m2 "
      "= 0.01\nencoder_counts_per_rev = 4096\ncounter_bits = 16\ncurrent_update_hz = "
      "2000\nviscous_friction_Nm_s_per_rad = 0.001\ncoulomb_friction_Nm = 0.2\n";
  const std::string controller =
      "[controller.spindle]\nvelocity_gain_A_s_per_rad = 2\nvelocity_integral_per_s = "
      "20\ncurrent_bandwidth_hz = 900\ncurrent_limit_A = 30\ndelay_s = 0.0005\ncurrent_noise_A = "
      "0.01\n";
  const auto c = drive_simulation(
      file(spindle + controller +
           "[effect.spindle.time-locked-vibration]\nfrequency_hz = 49.7\namplitude_Nm = 0.3\n"
           "[effect.spindle.constant-load]\ntorque_Nm = 0.1\n"),
      Channel::spindle);
  CHECK(c.has_value());
  if (!c) return;
  CHECK(c->loop == DriveLoop::velocity);
  CHECK_NEAR(c->sample_period_s, 1.0 / 4000, 0);
  CHECK_NEAR(c->drive.inertia, 0.01, 0);
  CHECK_NEAR(c->drive.viscous, 0.001, 0);
  CHECK_NEAR(c->drive.coulomb, 0.2, 0);
  CHECK_NEAR(c->drive.unit_per_turn, kTwoPi, 0);
  CHECK_NEAR(c->effort_per_A, 0.5, 0);
  CHECK_NEAR(c->controller.velocity_gain_A_s, 2, 0);
  CHECK_NEAR(c->controller.velocity_integral_per_s, 20, 0);
  CHECK_NEAR(c->controller.current_limit_A, 30, 0);
  CHECK_NEAR(c->controller.current_bandwidth_hz, 900, 0);
  CHECK_NEAR(c->controller.delay_s, 0.0005, 0);
  CHECK_NEAR(c->current_noise_A, 0.01, 0);
  CHECK_NEAR(c->current_update_hz, 2000, 0);
  CHECK(c->encoder.counter_bits == 16);
  CHECK_NEAR(c->encoder.counts_per_turn, 4096, 0);
  CHECK(c->vibrations.size() == 1 && c->vibrations[0].amplitude == 0.3);
  CHECK(c->drive.effects.count == 1);

  refused(drive_simulation(file(spindle), Channel::spindle), "[controller.spindle]");
  refused(drive_simulation(file(controller), Channel::spindle), "[spindle]");
  refused(
      drive_simulation(file("[spindle]\ncoulomb_friction_Nm = 1\n" + controller), Channel::spindle),
      "inertia_kg_m2");
  const std::string x =
      "[axis.x]\nlead_m = 0.016\nequivalent_mass_kg = 227\ntorque_constant_Nm_per_A = 0.8\n";
  refused(drive_simulation(file(x + "[controller.x]\nvelocity_gain_A_s_per_m = 200\n"), Channel::x),
          "position_gain_per_s");
  const auto axis = drive_simulation(
      file(x + "[controller.x]\nvelocity_gain_A_s_per_m = 200\nposition_gain_per_s = 40\n"),
      Channel::x);
  CHECK(axis && axis->loop == DriveLoop::position);
  // 2 pi / lead times the motor's torque.
  if (axis) CHECK_NEAR(axis->effort_per_A, 0.8 * kTwoPi / 0.016, 1e-9);

  const std::string talk = "[effect.x.cross-talk]\ncoefficient = 12\nother_channel = ";
  const auto heard = cross_talk_of(file(x + talk + "y\n"), Channel::x);
  CHECK(heard && heard->size() == 1 && heard->front().from == Channel::y &&
        heard->front().coefficient == 12);
  CHECK(heard && heard->front().of == CrossTalkOf::acceleration);
  const auto share = cross_talk_of(file(x + talk + "y\nof = effort\n"), Channel::x);
  CHECK(share && share->size() == 1 && share->front().of == CrossTalkOf::effort);
  const auto silent = cross_talk_of(file(x), Channel::x);
  CHECK(silent && silent->empty());
  refused(cross_talk_of(file(x + talk + "x\n"), Channel::x), "another drive");
}

/// The documented example and the file that has every key.
void test_files() {
  const auto koike = MachineFile::read("examples/machines/koike_cut.ini");
  CHECK(koike.has_value());
  if (!koike) return;
  const auto s = milling_simulation(*koike, 1.2);
  CHECK(s.has_value());
  if (s) {
    CHECK(s->tool.teeth == 2 && s->structure.x.size() == 1);
    CHECK_NEAR(s->structure.y[0].natural_frequency_hz, 2082, 0);
    CHECK_NEAR(s->speed.speed_rpm(0.25), 8100, 1e-9);
  }
  CHECK(drive_simulation(*koike, Channel::spindle).has_value());
  CHECK(drive_simulation(*koike, Channel::x).has_value());
  refused(drive_simulation(*koike, Channel::y), "[axis.y]");
  auto complete = MachineFile::read("tests/data/machine/complete.ini");
  CHECK(complete.has_value());
  if (!complete) return;
  complete->remove("tool", "coefficients");  // it has their keys itself
  const auto tool = milling_tool(*complete);
  CHECK(tool && tool->helix_deg == 38 && tool->tooth_angle_rad.size() == 4);
}

}  // namespace

int main() {
  test_tool();
  test_cut_and_structure();
  test_simulation();
  test_drives();
  test_files();
  return check::done();
}
