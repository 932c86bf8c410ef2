// servosense identify cutting on what is not the plain case: teeth that run out, a lathe, the
// second spindle, a pipe, friction that hides a force. Cuts from an integration of its own.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <random>

#include "cutting_rig.hpp"

using namespace program_test;
using namespace cutting_rig;

namespace {

/// Teeth that run out take chips from each other, and one that misses its chip has no edge force.
/// Two that are 20 um apart at feeds of 20 um and more: known to the file, and not.
void run_out() {
  double worst_chip = 0, worst_edge = 0, chip_unknown = 0, edge_unknown = 0;
  for (unsigned seed = 11; seed < 17; ++seed) {
    Rig r = Rig::random(seed);
    std::string throws = "throw_m = ";
    for (int t = 0; t < r.cut.teeth; ++t) {
      r.cut.throw_m.push_back(t % 2 == 0 ? 10e-6 : -10e-6);
      throws += std::string(t > 0 ? ", " : "") + (t % 2 == 0 ? "10e-6" : "-10e-6");
    }
    std::string machine = r.machine(kCurrent);
    put("m.ini", machine);
    write_current(r, "cut.csv", false);
    const Outcome unknown = run("identify cutting --machine m.ini --json cut.csv");
    that(contains(unknown.err, "[tool] has no run-out: with 5 um of it"), unknown, "says so",
         __LINE__);
    const Coefficients without(Json(unknown.out));
    chip_unknown = std::max(chip_unknown, without.ktc / r.cut.ktc - 1);
    edge_unknown = std::min(edge_unknown, without.kte / r.cut.kte - 1);
    machine.insert(machine.find("[cut]"), throws + "\n");
    put("thrown.ini", machine);
    const Outcome known = run("identify cutting --machine thrown.ini --json cut.csv");
    that(!contains(known.err, "run-out"), known, "nothing to say", __LINE__);
    const Coefficients c(Json(known.out));
    worst_chip = std::max(worst_chip, std::abs(c.ktc / r.cut.ktc - 1));
    worst_edge = std::max(worst_edge, std::abs(c.kte / r.cut.kte - 1));
  }
  check::figure("run-out not known: worst tangential coefficient", 100 * chip_unknown, "%");
  check::figure("run-out not known: worst edge coefficient", 100 * edge_unknown, "%");
  check::figure("run-out known: worst tangential coefficient", 100 * worst_chip, "%");
  check::figure("run-out known: worst edge coefficient", 100 * worst_edge, "%");
  CHECK(worst_chip < 0.005);
  CHECK(worst_edge < 0.02);
  CHECK(chip_unknown > 0.05 &&
        edge_unknown < -0.2);  // or there would be nothing to take account of
}

/// A lathe: the spindle carries the work, z feeds along it, the chip is as thick as the feed.
void turning() {
  constexpr double kRadius_m = 0.02, kDepth_m = 1e-3, kSpeed = 150, kKtc = 2000e6, kKte = 30e3;
  std::ofstream out(folder / "turned.csv");
  out << "t_s,spindle.angle_rad,spindle.current_A,x.position_m,x.current_A,z.position_m,z.current_"
         "A\n";
  std::mt19937_64 bits(6);
  std::normal_distribution<double> noise(0, 0.02);
  const double feeds[] = {0, 2e-4, 0, 1e-4, 0};
  double z = 0.1;
  char line[200];
  for (int n = 0; n < 5000; ++n) {
    const double feed = feeds[n / 1000], force = feed > 0 ? kDepth_m * (kKtc * feed + kKte) : 0;
    z -= (feed > 0 ? feed : 1e-4) * kSpeed / kTurn / 1000;
    std::snprintf(line, sizeof line, "%.3f,%.6f,%.5f,0.02,%.5f,%.9f,%.5f\n", n * 1e-3,
                  n * kSpeed * 1e-3, (force * kRadius_m + 0.15) / 0.6 + noise(bits),
                  0.3 * force / 300 + noise(bits), z, (-0.4 * force - 100) / 300 + noise(bits));
    out << line;
  }
  out.close();
  const std::string drives =
      "[spindle]\ntorque_constant_Nm_per_A = 0.6\ninertia_kg_m2 = 0.05\ncoulomb_friction_Nm = "
      "0.15\n"
      "[axis.x]\nlead_m = 0.01\nequivalent_mass_kg = 200\ncoulomb_friction_N = 100\n"
      "force_constant_N_per_A = 300\n[axis.z]\nlead_m = 0.01\nequivalent_mass_kg = 200\n"
      "coulomb_friction_N = 100\nforce_constant_N_per_A = 300\n";
  put("lathe.ini", drives + "[tool]\ndiameter_m = 0.04\n[cut]\naxial_depth_m = 1e-3\n");
  refused("identify cutting --machine lathe.ini turned.csv", 3,
          {"[tool] has no teeth", "not for turning"}, __LINE__);
  // Told that it is a slot of one tooth it is none.
  put("lathe.ini", drives +
                       "[tool]\ndiameter_m = 0.04\nteeth = 1\n[cut]\naxial_depth_m = 1e-3\n"
                       "direction = slot\nfeed_per_tooth_m = 1e-4\n");
  refused("identify cutting --machine lathe.ini turned.csv", 3,
          {"z moves in it", "turning follow another law"}, __LINE__);
}

/// The tool in the second spindle, and a record that comes through a pipe: the same.
void other_ways_in() {
  const Rig r = Rig::random(3);
  const std::string machine = r.machine(kCurrent);
  put("m.ini", machine);
  write_current(r, "cut.csv", true);
  const Outcome o = run("identify cutting --machine m.ini --json cut.csv");
  const Coefficients direct((Json(o.out)));
  that(o.status == 0 && direct.ktc > 0, o, "a file", __LINE__);
  const std::string feed_pipe =
      "cd '" + folder.string() + "' && mkfifo pipe.csv && (timeout 60 cat cut.csv > pipe.csv &)";
  CHECK(std::system(feed_pipe.c_str()) == 0);
  const Outcome piped = run("identify cutting --machine m.ini --json pipe.csv");
  const Coefficients through((Json(piped.out)));
  that(through.ktc == direct.ktc && through.kte_error == direct.kte_error, piped, "a pipe",
       __LINE__);
  std::string second = machine, trace = content(folder / "cut.csv");
  second.replace(second.find("[spindle]"), 9, "[spindle2]");
  second.insert(second.find("[cut]"), "spindle = spindle2\n");
  for (std::size_t at = 0; (at = trace.find("spindle.", at)) != std::string::npos; at += 9)
    trace.replace(at, 8, "spindle2.");
  put("second.ini", second);
  put("second.csv", trace);
  const Outcome other = run("identify cutting --machine second.ini --json second.csv");
  const Coefficients by_second((Json(other.out)));
  that(other.status == 0 && by_second.ktc == direct.ktc && by_second.ratio == direct.ratio, other,
       "the second spindle", __LINE__);
}

/// Friction that nobody has measured hides a radial force.
void hidden_by_friction() {
  Rig r = Rig::random(2);
  r.axis_viscous = 40000;
  for (auto& stretch : r.plan.stretches) stretch.moving = stretch.feed_m > 0;  // none in the air
  put("m.ini", r.machine(kCurrent));
  write_current(r, "cut.csv", true);
  const Outcome o = run("identify cutting --machine m.ini --json cut.csv");
  const Json json(o.out);
  that(o.status == 0 && json.text("radial_ratio") == "(absent)", o, "no radial ratio", __LINE__);
  that(contains(o.err, "friction of the axes hides them"), o, "says why", __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("cutting-inputs", [] {
    run_out();
    turning();
    other_ways_in();
    hidden_by_friction();
  });
}
