// From the machine file to drives and observers: every number in its place, what is left out, and
// what is refused.
#include <cmath>
#include <string>
#include <utility>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/observer/machine_config.hpp"

namespace {

using namespace servosense;

MachineFile file_of(const std::string& text) {
  Expected<MachineFile> file = MachineFile::parse(text, "m.ini");
  CHECK(file.has_value());
  if (!file) std::cout << "    " << file.error().sentence << '\n';
  return file ? *file : *MachineFile::parse("", "empty");
}

/// A number without a unit may be anything; an ampere, a Nm and a N may not.
void ratios_have_no_limit() {
  const DriveSignal current{MotionKind::velocity, EffortKind::current_A};
  const auto limit = [&](const std::string& spindle, const std::string& axis) {
    const MachineFile file = file_of("[spindle]\ntorque_constant_Nm_per_A = 1\n" + spindle +
                                     "[axis.x]\nforce_constant_N_per_A = 1\n" + axis);
    const auto s = spindle_config(file);
    const auto x = axis_config(file, Channel::x);
    CHECK(s.has_value() && x.has_value());
    return s && x
               ? std::pair{s->input(current, 1e-3).max_effort, x->input(current, 1e-3).max_effort}
               : std::pair{-1.0, -1.0};
  };
  CHECK((limit("", "") == std::pair{2000.0, 2000.0}));
  CHECK(
      (limit("current_is_ratio = yes\n", "effort_column = x.voltage_V\n") == std::pair{0.0, 0.0}));
  CHECK((limit("effort_column = spindle.load_percent\n", "current_is_ratio = yes\n") ==
         std::pair{0.0, 0.0}));
}

void spindle_in_full() {
  const auto c = spindle_config(file_of(
      "[spindle]\ntorque_constant_Nm_per_A = 0.53\ninertia_kg_m2 = 0.0048\n"
      "viscous_friction_Nm_s_per_rad = 4.775e-4\ncoulomb_friction_Nm = 0.1062\n"
      "friction_knee_rad = 0.002\nencoder_counts_per_rev = 131072\ncounter_bits = 17\n"
      "[observer.spindle]\ndisturbance_cutoff_rad_s = 3500\nvelocity_cutoff_rad_s = 3000\n"));
  CHECK(c.has_value());
  if (!c) return;
  CHECK(c->counter_bits == 17);
  const DisturbanceObserverConfig o = c->disturbance_observer(125e-6, c->observer);
  CHECK(o.sample_period_s == 125e-6);
  CHECK(o.disturbance_cutoff_rad_s == 3500 && o.velocity_cutoff_rad_s == 3000);
  CHECK(o.drive.inertia == 0.0048 && o.drive.viscous == 4.775e-4 && o.drive.coulomb == 0.1062);
  CHECK(o.drive.constant_load == 0 && o.drive.friction_knee == 0.002);
  CHECK(DisturbanceObserver<double>::validate(o).ok());
  const DriveInputConfig current = c->input({MotionKind::counts, EffortKind::current_A}, 125e-6);
  CHECK(current.effort_per_unit == 0.53 && current.counter_bits == 17);
  CHECK_NEAR(current.unit_per_count, 4.793689962142629e-5, 1e-18);  // 2 pi / 2^17
  CHECK(c->input({MotionKind::position, EffortKind::torque_Nm}, 125e-6).effort_per_unit == 1);
}

// Koike 2016, table 3-6 and section 1: lead 16 mm is 2.54648e-3 m/rad.
void axis_in_full() {
  const auto c = axis_config(
      file_of("[axis.z]\nlead_m = 0.016\nequivalent_mass_kg = 380\nmoving_mass_kg = 175\n"
              "vertical = yes\nviscous_friction_N_s_per_m = 1968\ncoulomb_friction_N = 240\n"
              "torque_constant_Nm_per_A = 0.5\nencoder_counts_per_rev = 1048576\n"
              "[observer.z]\ndisturbance_cutoff_rad_s = 335\nvelocity_cutoff_rad_s = 400\n"
              "[axis.x]\nequivalent_mass_kg = 1\n"),
      Channel::z);
  CHECK(c.has_value());
  if (!c) return;
  CHECK_NEAR(c->force_per_ampere(), 0.5 / 2.54648e-3, 1e-3);
  const DisturbanceObserverConfig o = c->disturbance_observer(125e-6, c->observer);
  CHECK(o.disturbance_cutoff_rad_s == 335 && o.velocity_cutoff_rad_s == 400);
  CHECK(o.drive.inertia == 380 && o.drive.viscous == 1968 && o.drive.coulomb == 240);
  CHECK_NEAR(o.drive.constant_load, 1716.16375, 1e-9);  // 175 kg, motor carries it
  CHECK(o.drive.unit_per_turn == 0.016);
  CHECK_NEAR(o.drive.load_inertia_share, 175.0 / 380, 1e-12);
  CHECK(DisturbanceObserver<double>::validate(o).ok());
  const DriveInputConfig counts = c->input({MotionKind::counts, EffortKind::current_A}, 125e-6);
  CHECK_NEAR(counts.unit_per_count, 1.52587890625e-8, 1e-20);
  CHECK(counts.counter_bits == 32);
  CHECK_NEAR(counts.effort_per_unit, 0.5 / 2.54648e-3, 1e-3);
  CHECK_NEAR(c->input({MotionKind::position, EffortKind::torque_Nm}, 1e-3).effort_per_unit,
             1 / 2.54648e-3, 1e-3);
  CHECK(c->input({MotionKind::position, EffortKind::force_N}, 1e-3).effort_per_unit == 1);
}

// A machine that is yet to be identified can be read.
void defaults() {
  const MachineFile empty = file_of("");
  const auto spindle = spindle_config(empty);
  CHECK(spindle && spindle->inertia_kg_m2 == 0 && spindle->effects.count == 0);
  CHECK(spindle && spindle->torque_constant_Nm_per_A == 1 && spindle->friction_knee_rad == 1e-3);
  const auto axis = axis_config(empty, Channel::y);
  CHECK(axis && axis->equivalent_mass_kg == 0 && axis->force_per_ampere() == 1);
  CHECK(axis && axis->friction_knee_m == 5e-6 && axis->observer.disturbance_cutoff_rad_s == 500);

  // Without a moving mass, all of it hangs on a vertical axis.
  const auto hanging =
      axis_config(file_of("[axis.z]\nequivalent_mass_kg = 100\nvertical = yes\n"), Channel::z);
  CHECK(hanging.has_value());
  if (hanging)
    CHECK_NEAR(hanging->disturbance_observer(1e-3, {}).drive.constant_load, 980.665, 1e-9);
  const auto lying =
      axis_config(file_of("[axis.z]\nequivalent_mass_kg = 100\nvertical = no\n"), Channel::z);
  CHECK(lying && lying->disturbance_observer(1e-3, {}).drive.constant_load == 0);
  const auto linear = axis_config(file_of("[axis.x]\nforce_constant_N_per_A = 120\n"), Channel::x);
  CHECK(linear && linear->force_per_ampere() == 120);
}

// A coarse encoder widens the knee to four counts; one that is written stands.
void knee_and_encoder() {
  const std::string coarse = "[axis.x]\nlead_m = 0.016\nencoder_counts_per_rev = 4000\n";
  const auto widened = axis_config(file_of(coarse), Channel::x);
  CHECK(widened.has_value());
  if (widened) CHECK_NEAR(widened->friction_knee_m, 16e-6, 1e-15);
  const auto written = axis_config(file_of(coarse + "friction_knee_m = 6e-6\n"), Channel::x);
  CHECK(written && written->friction_knee_m == 6e-6);
  const auto spindle = spindle_config(file_of("[spindle]\nencoder_counts_per_rev = 1024\n"));
  CHECK(spindle.has_value());
  if (spindle) CHECK_NEAR(spindle->friction_knee_rad, 4 * kTwoPi / 1024, 1e-12);
}

void effects() {
  const MachineFile machine = file_of(
      "[effect.x.stribeck-friction]\nextra_static_N = 25\nstribeck_velocity_m_per_s = 0.004\n"
      "[effect.y.constant-load]\nforce_N = -60\n"
      "[effect.x.torque-ripple]\norder = 1, 6\namplitude_N = 8, 3.5\nphase_rad = 0.2, -1.1\n"
      "[effect.x.position-dependent-friction]\nprofile = 0 12, 0.1 14.5\n"
      "provenance = lap 3\n"
      "[effect.x.extra-mode]\nnatural_frequency_hz = 410\ndamping_ratio = 0.02\n"
      "modal_mass_kg = 6\n"
      "[effect.tool.runout]\nthrow_m = 5e-6\nangle_rad = 0.4\n"
      "[effect.spindle.coulomb-friction]\ntorque_Nm = 0.4\n");
  const auto x = drive_effects_config(machine, Channel::x);
  CHECK(x.has_value());
  if (!x) {
    std::cout << x.error().sentence << '\n';
    return;
  }
  // What another channel has, and what is only reported, is passed over.
  CHECK(x->count == 3);
  const EffectSetting* stribeck = x->find("stribeck-friction");
  CHECK(stribeck && stribeck->scalar(0) == 25 && stribeck->scalar(1) == 0.004);
  const EffectSetting* ripple = x->find("torque-ripple");
  CHECK(ripple && ripple->parameters[0].count == 2 && ripple->parameters[0].value[1] == 6);
  CHECK(ripple && ripple->parameters[1].value[0] == 8 && ripple->parameters[1].value[1] == 3.5);
  CHECK(ripple && ripple->parameters[2].value[1] == -1.1);
  const EffectSetting* profile = x->find("position-dependent-friction");
  CHECK(profile && profile->parameters[0].count == 4);
  if (profile) {
    const auto& v = profile->parameters[0].value;
    CHECK(v[0] == 0 && v[1] == 12 && v[2] == 0.1 && v[3] == 14.5);
  }
  CHECK(!x->find("constant-load"));
  const auto y = drive_effects_config(machine, Channel::y);
  CHECK(y && y->count == 1 && y->find("constant-load") &&
        y->find("constant-load")->scalar(0) == -60);
  // A spindle's effects are written in torque.
  const auto spindle = spindle_config(machine);
  CHECK(spindle && spindle->effects.count == 1 && spindle->effects.find("coulomb-friction") &&
        spindle->effects.find("coulomb-friction")->scalar(0) == 0.4);
  // They reach the observer.
  const auto axis = axis_config(machine, Channel::x);
  CHECK(axis && axis->disturbance_observer(125e-6, {}).drive.effects.count == 3);
  const auto none = drive_effects_config(machine, Channel::z);
  CHECK(none && none->count == 0);
}

// Every effect that a drive can carry, one at a time, as the file with every key has it.
void every_effect() {
  const auto complete = MachineFile::read("tests/data/machine/complete.ini");
  CHECK(complete.has_value());
  if (!complete) return;
  std::size_t carried = 0;
  for (const EffectInfo& info : kDriveEffects) {
    for (const Channel channel : {Channel::x, Channel::y, Channel::z, Channel::spindle}) {
      const std::string section =
          "effect." + std::string(name_of(channel)) + "." + std::string(info.name);
      if (!complete->has_section(section)) continue;
      MachineFile one = *complete;
      for (const std::string& other : complete->sections())
        if (other.starts_with("effect.") && other != section) one.remove_section(other);
      const auto c = drive_effects_config(one, channel);
      CHECK(c && c->count == 1 && c->find(info.name));
      if (!c) std::cout << "    " << c.error().sentence << '\n';
      ++carried;
      break;
    }
  }
  CHECK(carried == kDriveEffectCount);
}

// One motor of two: the constants are those of the whole effort, and the reader is told.
void one_motor_of_two() {
  const MachineFile file = file_of(
      "[axis.x]\nforce_constant_N_per_A = 120\neffort_share = 0.6\neffort_share_error = 0.03\n"
      "[axis.y]\nforce_constant_N_per_A = 120\neffort_share = 0.5\n");
  const auto x = axis_config(file, Channel::x);
  CHECK(x.has_value());
  if (x) CHECK_NEAR(x->force_per_ampere(), 200, 1e-9);
  const EffortShare share = effort_share(file, Channel::x);
  CHECK_NEAR(share.relative_error, 0.05, 1e-12);
  CHECK(share.said.starts_with("x: its motor is taken to carry 0.6 +- 0.03 of the effort"));
  CHECK(share.said.find("no better known than to 5 %") != std::string::npos);
  CHECK(share.said.find("up to 1.67 times") != std::string::npos);
  CHECK_NEAR(effort_share(file, Channel::y).relative_error, 0.1, 1e-12);  // not measured
  CHECK(effort_share(file, Channel::z).said.empty());
}

// A drive of either kind, by its channel; a table has a knee of its own.
void either_kind() {
  const MachineFile file = file_of(
      "[axis.c]\ntorque_constant_Nm_per_A = 0.8\nencoder_counts_per_rev = 1048576\n"
      "gear_ratio = 90\ncounter_bits = 24\n"
      "[axis.x]\nforce_constant_N_per_A = 120\nencoder_counts_per_rev = 8192\nlead_m = 0.01\n"
      "[tool]\nspindle = spindle2\n");
  const auto table = drive_config(file, Channel::c);
  CHECK(table.has_value());
  if (table) {
    CHECK_NEAR(table->effort_per_ampere(), 72, 1e-9);
    CHECK(table->encoder_counts_per_rev() == 90.0 * 1048576 && table->counter_bits() == 24);
  }
  const auto knee = spindle_config(file, Channel::c);
  CHECK(knee && knee->friction_knee_rad != spindle_config(file)->friction_knee_rad);
  const auto linear = drive_config(file, Channel::x);
  CHECK(linear.has_value());
  if (linear) {
    CHECK_NEAR(linear->effort_per_ampere(), 120, 1e-9);
    CHECK(linear->encoder_counts_per_rev() == 8192 && linear->counter_bits() == 32);
  }
  CHECK(tool_spindle(file) == Channel::spindle2);
  CHECK(tool_spindle(file_of("")) == Channel::spindle);
  // What is wrong with one is said of it through either door.
  const MachineFile bad = file_of("[effect.c.backlash]\nprovenance = run 7\n");
  CHECK(!drive_config(bad, Channel::c));
  CHECK(!drive_config(file_of("[effect.x.backlash]\nprovenance = run 7\n"), Channel::x));
}

void refused(const std::string& text, const std::string& where, const std::string& part) {
  const auto c = axis_config(file_of(text), Channel::x);
  CHECK(!c.has_value());
  if (c) return;
  CHECK(c.error().kind == ErrorKind::data);
  CHECK_TEXT(c.error().sentence.substr(0, where.size()), where);
  CHECK(c.error().sentence.find(part) != std::string::npos);
  std::cout << "  " << c.error().sentence << '\n';
}

void errors() {
  refused("\n[effect.x.backlash]\nprovenance = run 7\n", "m.ini:2", "width_m");
  refused("[axis.x]\ntorque_constant_Nm_per_A = 0.5\n", "m.ini:1", "lead_m");
  std::string ripple = "[effect.x.torque-ripple]\norder = 1";
  for (int i = 2; i <= 17; ++i) ripple += ", " + std::to_string(i);
  refused(ripple + "\namplitude_N = 1\n", "m.ini:2", "at most 16");
  refused("[effect.x.torque-ripple]\norder = 1, 2\namplitude_N = 8\n", "m.ini", "");
  refused("[axis.x]\ngantry = yes\neffort_share = 0.5\n", "m.ini:3", "leave one of the two");
  // Nine effects on one drive.
  const auto complete = MachineFile::read("tests/data/machine/complete.ini");
  CHECK(complete.has_value());
  if (!complete) return;
  const auto crowded = drive_effects_config(*complete, Channel::x);
  CHECK(!crowded && crowded.error().sentence.find("at most 8 effects") != std::string::npos);
  if (!crowded) CHECK(crowded.error().sentence.starts_with("tests/data/machine/complete.ini:"));
}

}  // namespace

int main() {
  ratios_have_no_limit();
  spindle_in_full();
  axis_in_full();
  defaults();
  knee_and_encoder();
  effects();
  every_effect();
  one_motor_of_two();
  either_kind();
  errors();
  return check::done();
}
