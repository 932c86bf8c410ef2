// The commands of the desk, as a user meets them: lobes, simulate drive, simulate milling, pockets.
#include <cmath>
#include <cstdlib>
#include <sstream>
#include <string>
#include <vector>

#include "check.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

// Koike 2016, tables 8-10 and 8-11; a spindle and an axis with made-up gains.
const std::string kTool =
    "[tool]\ndiameter_m = 0.010\nteeth = 2\ntangential_coefficient_N_per_m2 = 1500e6\nradial_ratio "
    "= 0.3333333333\n[cut]\nspindle_speed_rpm = 7200\nfeed_per_tooth_m = 87.5e-6\naxial_depth_m = "
    "0.002\nradial_immersion_m = 0.0005\ndirection = down\n";
const std::string kModes =
    "[structure.x]\nmodes = 2082 0.018 0.043\n[structure.y]\nmodes = 2082 0.018 0.043\n";
const std::string kAxis =
    "[axis.x]\nlead_m = 0.016\nequivalent_mass_kg = 200\ntorque_constant_Nm_per_A = "
    "0.8\ncoulomb_friction_N = 90\nencoder_counts_per_rev = 1048576\ncurrent_update_hz = "
    "2000\n[controller.x]\nposition_gain_per_s = 40\nvelocity_gain_A_s_per_m = "
    "200\nvelocity_integral_per_s = 60\n";

std::vector<double> numbers(const std::string& line) {
  std::vector<double> all;
  std::stringstream in(line);
  for (std::string field; std::getline(in, field, ',');)
    all.push_back(field.empty() ? std::nan("") : std::strtod(field.c_str(), nullptr));
  return all;
}

void lobes() {
  put("cut.ini", kTool + kModes);
  const Outcome o = run("lobes --quiet --machine cut.ini --from 5400 --to 9000 --out l.csv --json");
  that(o.status == 0 && o.err.empty(), o, "silent success", __LINE__);
  const Json json(o.out);
  that(json.ok && json.object, o, "one JSON object", __LINE__);
  // Koike 2016, ch. 8, as derived in the digest: minimum to 1 %, pockets to 10 rpm.
  CHECK_NEAR(json.number("minimum_axial_depth_m"), 4.748e-3, 0.01 * 4.748e-3);
  const double pockets[] = {5747, 6321, 7023, 7900};
  CHECK(json.sizes.at("pockets") == 4);
  for (std::size_t i = 0; i < 4; ++i)
    CHECK_NEAR(json.number("pockets." + std::to_string(i) + ".spindle_speed_rpm"), pockets[i], 10);
  const std::vector<std::string> rows = lines(content(folder / "l.csv"));
  CHECK(rows.size() == 401);
  CHECK_TEXT(rows[0], "spindle_speed_rpm,axial_depth_m,chatter_frequency_hz");
  CHECK_NEAR(numbers(rows[1])[0], 5400, 0);
  CHECK_NEAR(numbers(rows[400])[0], 9000, 1e-9);
  double lowest = 1;
  for (std::size_t i = 1; i < rows.size(); ++i) lowest = std::min(lowest, numbers(rows[i])[1]);
  CHECK_NEAR(lowest, 4.748e-3, 0.01 * 4.748e-3);

  // A receptance sampled from the same modes gives the same answer.
  std::string frf = "frequency_hz,receptance_re_m_per_N,receptance_im_m_per_N\n";
  for (int hz = 1000; hz <= 4000; ++hz) {
    const double r = hz / 2082.0, k = 0.043 * std::pow(2 * M_PI * 2082, 2);
    const double re = 1 - r * r, im = 2 * 0.018 * r, size = k * (re * re + im * im);
    char row[120];
    std::snprintf(row, sizeof row, "%d,%.12g,%.12g\n", hz, re / size, -im / size);
    frf += row;
  }
  put("tip.csv", frf);
  put("frf.ini", kTool + "[structure.x]\nfrf = tip.csv\n[structure.y]\nfrf = tip.csv\n");
  const Outcome m = run("lobes --machine frf.ini --from 5400 --to 9000 --json");
  that(m.status == 0, m, "success", __LINE__);
  const Json measured(m.out);
  CHECK_NEAR(measured.number("minimum_axial_depth_m"), json.number("minimum_axial_depth_m"), 1e-6);
  for (std::size_t i = 0; i < 4; ++i)
    CHECK_NEAR(measured.number("pockets." + std::to_string(i) + ".spindle_speed_rpm"), pockets[i],
               10);

  // Small immersion: semi-discretisation allows more at the bottoms, and sees the same pockets.
  const Outcome s =
      run("lobes --machine cut.ini --method sd --from 6000 --to 8500 --speeds 60 --report sd.html "
          "--out sd.csv");
  that(s.status == 0 && contains(s.out, "pocket at"), s, "success", __LINE__);
  CHECK(lines(content(folder / "sd.csv")).size() == 61);
  CHECK(contains(content(folder / "sd.html"), "Growth from tooth to tooth"));
  const Outcome band = run(
      "lobes --machine cut.ini --radial-ratio 0.2,0.5 --report band.html --from 5400 --to 9000");
  that(band.status == 0 && contains(band.out, "safe at 2 mm for every radial ratio: 5400 to 9000"),
       band, "a cut below every lobe is safe everywhere", __LINE__);

  // Half a millimetre of a 10 mm cutter: an interrupted cut, and it is said what that does.
  const Outcome said = run("lobes --machine cut.ini --from 5400 --to 9000 --json");
  const Json interrupted(said.out);
  that(contains(said.err, "the cut is interrupted") && contains(said.err, "--method sd"), said,
       "says that zeroth order errs", __LINE__);
  const double sd_m = interrupted.number("semi_discretization.axial_depth_m");
  that(sd_m > 1e-3 && sd_m < 0.1, said, "and what the other method gives", __LINE__);

  // Unequal pitch and process damping are used, or refused by the method that cannot; run-out and
  // broken teeth are said.
  const std::string machine = content(folder / "cut.ini");
  put("uneven.ini", machine + "\n[effect.tool.pitch-error]\nangle_rad = 0, 0.3\n");
  put("damped.ini", machine + "\n[effect.tool.process-damping]\ncoefficient = 2e4\n");
  refused("lobes --machine uneven.ini", 3, {"tooth 2", "--method sd"}, __LINE__);
  refused("lobes --machine damped.ini", 3, {"process damping", "--method sd"}, __LINE__);
  double limit_m[3];
  int i = 0;
  for (const char* file : {"cut.ini", "uneven.ini", "damped.ini"}) {
    const Outcome sd = run("lobes --quiet --method sd --from 6000 --to 7000 --speeds 8 --machine " +
                           std::string(file) + " --json");
    limit_m[i++] = Json(sd.out).number("limit.4.axial_depth_m");
    that(limit_m[i - 1] > 0, sd, "a limit", __LINE__);
  }
  CHECK(std::abs(limit_m[1] - limit_m[0]) > 0.05 * limit_m[0]);
  CHECK(limit_m[2] > 1.02 * limit_m[0]);
  put("thrown.ini", machine + "\n[effect.tool.runout]\nthrow_m = 0, 5e-6\nangle_rad = 0\n");
  that(contains(run("lobes --machine thrown.ini").err, "run-out does not move the limit"), said,
       "says that run-out is not used", __LINE__);
  put("far_out.ini", machine + "\n[effect.tool.runout]\nthrow_m = 0, 5e-4\nangle_rad = 0\n");
  refused("lobes --machine far_out.ini", 3, {"run-out", "feed per tooth"}, __LINE__);
  // Slow lobes are too close to gain anything between them, and to be worked out one by one.
  const Outcome slow = run("lobes --machine cut.ini --from 1 --to 9000 --json");
  const Outcome usual = run("lobes --machine cut.ini --from 2000 --to 9000 --json");
  const std::size_t found = Json(slow.out).sizes["pockets"];
  that(slow.status == 0 && found >= Json(usual.out).sizes["pockets"] && found < 2000, slow,
       "the pockets from 1 rpm on are few", __LINE__);
  refused("lobes --machine cut.ini --method sd --from 1", 2, {"1000 vibrations", "begin at"},
          __LINE__);
  refused("lobes --machine cut.ini --method fast", 2, {"zoa", "'fast'"}, __LINE__);
  refused("lobes --machine cut.ini --from 9000 --to 5000", 2, {"--to must be above --from"},
          __LINE__);
  refused("lobes --machine cut.ini --speeds 2.5", 2, {"whole number"}, __LINE__);
  refused("lobes --machine cut.ini --radial-ratio 0.5", 2, {"LOW,HIGH"}, __LINE__);
  refused("lobes --machine frf.ini --method sd", 3, {"frf.ini", "modes are needed"}, __LINE__);
  put("rigid.ini", kTool);
  refused("lobes --machine rigid.ini", 3, {"no modes"}, __LINE__);
  put("no_tool.ini", kModes);
  refused("lobes --machine no_tool.ini", 3, {"no_tool.ini", "[tool]"}, __LINE__);
  refused("lobes --quiet --machine cut.ini --out no/such/folder.csv", 4, {"no/such/folder.csv"},
          __LINE__);
}

void simulate_drive() {
  put("axis.ini", kAxis);
  put("moves.txt", "x limits 0.5 5 100\nx move 0.1\nx load 300 0.6 0.8\nx dwell 0.5\n");
  const Outcome o =
      run("simulate drive --machine axis.ini --motion moves.txt --out axis.csv --truth --json");
  that(o.status == 0 && o.err.empty(), o, "silent success", __LINE__);
  const Json json(o.out);
  CHECK_TEXT(json.text("drives.0.channel"), "x");
  const std::vector<std::string> rows = lines(content(folder / "axis.csv"));
  CHECK_TEXT(rows[1],
             "t_s,x.command_position_m,x.angle_counts,x.current_A,x.position_m,x.velocity_m_s,"
             "x.force_N");
  CHECK(rows.size() == 2 + static_cast<std::size_t>(json.number("rows")));
  // Held against 300 N after 0.75 s: the motor gives 300 N, less or more by the friction that has
  // not let go.
  const std::vector<double> loaded = numbers(rows[2 + 6200]);
  CHECK_NEAR(loaded[6], 300, 90 + 1);
  CHECK_NEAR(loaded[4], 0.1, 1e-4);
  CHECK_NEAR(loaded[2], loaded[4] / 0.016 * 1048576, 1);
  // The current arrives at 2 kHz, one row in four.
  CHECK(!std::isnan(numbers(rows[2])[3]) && std::isnan(numbers(rows[3])[3]) &&
        !std::isnan(numbers(rows[6])[3]));

  // Its own recording is a motion: the same again.
  put("plain.txt", "x limits 0.5 5 100\nx move 0.1\n");
  const Outcome first = run("simulate drive --machine axis.ini --motion plain.txt --out a.csv");
  const Outcome second = run("simulate drive --machine axis.ini --motion a.csv --out b.csv");
  that(first.status == 0 && second.status == 0, second, "success", __LINE__);
  const std::vector<std::string> a = lines(content(folder / "a.csv"));
  const std::vector<std::string> b = lines(content(folder / "b.csv"));
  CHECK(a.size() == b.size() && a.size() > 1000);
  double commands = 0, counts = 0;
  for (std::size_t i = 2; i < std::min(a.size(), b.size()); ++i) {
    const std::vector<double> was = numbers(a[i]), is = numbers(b[i]);
    commands = std::max(commands, std::abs(was[1] - is[1]));
    counts = std::max(counts, std::abs(was[2] - is[2]));
  }
  CHECK_NEAR(commands, 0, 1e-12);  // times are rounded to the nanosecond
  CHECK_NEAR(counts, 0, 1);

  // What it writes is what the main command reads.
  const Outcome identified =
      run("identify idle --machine axis.ini --trace a.csv --out found.ini --quiet");
  that(identified.status == 0 || identified.status == 3, identified, "an answer", __LINE__);

  refused("simulate drive --machine axis.ini --motion moves.txt", 2, {"--out"}, __LINE__);
  put("bad.txt", "x limits 0.5 5 100\nx mvoe 0.1\n");
  refused("simulate drive --machine axis.ini --motion bad.txt --out c.csv", 3,
          {"bad.txt:2", "'mvoe'"}, __LINE__);
  put("y.txt", "y limits 0.5 5 100\ny move 0.1\n");
  refused("simulate drive --machine axis.ini --motion y.txt --out c.csv", 3, {"[axis.y]"},
          __LINE__);
  put("empty.txt", "# nothing\n");
  refused("simulate drive --machine axis.ini --motion empty.txt --out c.csv", 3, {"empty"},
          __LINE__);
}

void simulate_milling() {
  put("mill.ini", kTool + kModes + "[simulation]\nlayers = 4\nstep_s = 1e-5\n");
  const Outcome o = run("simulate milling --machine mill.ini --out m.csv --duration 0.2");
  that(o.status == 0, o, "success", __LINE__);
  const Outcome again = run("simulate milling --machine mill.ini --out m2.csv --duration 0.2");
  that(again.status == 0, again, "success", __LINE__);
  CHECK(content(folder / "m.csv") == content(folder / "m2.csv"));
  const std::vector<std::string> rows = lines(content(folder / "m.csv"));
  CHECK(rows.size() >= 1600 && rows.size() <= 1603);
  // Mean torque = Kt b a_e s N / 2 pi: the chip volume of a turn does the work.
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t i = 2 + 800; i < rows.size(); ++i, ++count) sum += numbers(rows[i])[3];
  const double expected = 1500e6 * 0.002 * 0.0005 * 87.5e-6 * 2 / (2 * M_PI);
  CHECK_NEAR(sum / static_cast<double>(count), expected, 0.01 * expected);

  put("negative.ini", kTool + "[structure.x]\nmodes = 2082 0.018 -1\n");
  refused("simulate milling --machine negative.ini --out x.csv", 3, {"negative.ini", "modes"},
          __LINE__);
  put("wide.ini", kTool + kModes + "[simulation]\nstep_s = 0.01\n");
  refused("simulate milling --machine wide.ini --out x.csv", 2, {"step"}, __LINE__);
  // More samples than steps would be stamped as what they are not.
  put("dense.ini",
      "[machine]\nsample_rate_hz = 4e6\n" + kTool + kModes + "[simulation]\nstep_s = 1e-5\n");
  refused("simulate milling --machine dense.ini --out x.csv", 3,
          {"dense.ini:2", "sample_rate_hz", "step_s"}, __LINE__);
}

void pockets() {
  // Koike 2016, tables 8-10 and 8-11: 15 mm deep, slowing down by half of 7200 rpm in a second.
  const std::string ramp =
      "[simulation]\nlayers = 1\nstep_s = 5e-6\nspindle_speed_profile = -50 %/s of 7200 from 9000 "
      "to 5400\n";
  std::string deep = kTool;
  deep.replace(deep.find("0.002"), 5, "0.015");
  put("ramp.ini", deep + kModes + ramp);
  put("shallow.ini", kTool + kModes + ramp);
  for (const char* name : {"ramp", "shallow"}) {
    const std::string n = name;
    const Outcome o =
        run("simulate milling --machine " + n + ".ini --out " + n + ".csv --duration 1");
    that(o.status == 0, o, "success", __LINE__);
  }
  const Outcome o = run("pockets --machine ramp.ini --trace ramp.csv --json --report pockets.html");
  that(o.status == 0, o, "success", __LINE__);
  const Json json(o.out);
  that(json.ok && json.object, o, "one JSON object", __LINE__);
  CHECK_TEXT(json.text("verdict"), "found");
  const double expected[] = {5747, 6321, 7023, 7900};
  CHECK(json.sizes.at("stable_speeds") == 4);
  // 30 rpm is what the method is held to (test_identify stable_speeds); the trace rounds a little.
  for (std::size_t i = 0; i < 4; ++i)
    CHECK_NEAR(json.number("stable_speeds." + std::to_string(i) + ".spindle_speed_rpm"),
               expected[i], 40);
  CHECK(contains(content(folder / "pockets.html"), "Spectrogram"));

  // The same cut twice is one cut.
  const Outcome twice = run("pockets --machine ramp.ini --trace ramp.csv --trace2 ramp.csv --json");
  that(twice.status == 0, twice, "success", __LINE__);
  CHECK_NEAR(Json(twice.out).number("stable_speeds.0.spindle_speed_rpm"),
             json.number("stable_speeds.0.spindle_speed_rpm"), 1e-6);

  const Outcome stable = run("pockets --machine ramp.ini --trace shallow.csv --json");
  that(stable.status == 0, stable, "success", __LINE__);
  CHECK_TEXT(Json(stable.out).text("verdict"), "insufficient-chatter");
  put("no_torque.csv", "t_s,spindle.speed_rad_s\n0,1\n1,1\n2,1\n");
  refused("pockets --machine ramp.ini --trace no_torque.csv", 3, {"no_torque.csv"}, __LINE__);
  put("one.csv", "t_s,spindle.speed_rad_s,spindle.torque_Nm\n0,1,1\n");
  refused("pockets --machine ramp.ini --trace one.csv", 3, {"one.csv"}, __LINE__);
}

/// From a simulated machine to an alarm: idle run, learning, a cut in which a tooth breaks.
void broken_tooth() {
  put("tooth.ini",
      "[machine]\n"
      "name = tooth test\n"
      "sample_rate_hz = 8000\n"
      "[tool]\n"
      "diameter_m = 0.016\n"
      "teeth = 4\n"
      "tangential_coefficient_N_per_m2 = 8e8\n"
      "radial_ratio = 0.3\n"
      "helix_deg = 30\n"
      "runout_m = 5e-6\n"
      "[cut]\n"
      "spindle_speed_rpm = 6000\n"
      "feed_per_tooth_m = 8e-5\n"
      "axial_depth_m = 2e-3\n"
      "radial_immersion_m = 0.008\n"
      "direction = down\n"
      "[structure.x]\n"
      "modes = 900 0.03 0.5\n"
      "[structure.y]\n"
      "modes = 900 0.03 0.5\n"
      "[simulation]\n"
      "step_s = 12.5e-6\n"
      "layers = 8\n"
      "duration_s = 1.5\n"
      "tooth_breaks = 1 2 1\n"
      "start = entry\n"
      "[spindle]\n"
      "torque_constant_Nm_per_A = 0.5\n"
      "inertia_kg_m2 = 0.0048\n"
      "viscous_friction_Nm_s_per_rad = 4.775e-4\n"
      "coulomb_friction_Nm = 0.1062\n"
      "encoder_counts_per_rev = 1048576\n"
      "[controller.spindle]\n"
      "velocity_gain_A_s_per_rad = 2\n"
      "velocity_integral_per_s = 40\n"
      "current_bandwidth_hz = 1000\n"
      "current_noise_A = 0.05\n");
  put("spin.txt", "spindle limits 800 4000 1e5\nspindle cruise 628 4\nspindle cruise 200 3\n");
  for (const std::string command :
       {"simulate drive --machine tooth.ini --motion spin.txt --out spin.csv --quiet",
        "identify idle --machine tooth.ini --trace spin.csv --out tooth2.ini --quiet",
        "simulate milling --machine tooth.ini --out tooth.csv --json"}) {
    const Outcome o = run(command);
    that(o.status == 0, o, "success", __LINE__);
    if (command.starts_with("simulate milling")) {
      const Json json(o.out);
      CHECK_TEXT(json.text("drives"), "true");
      CHECK_BETWEEN(json.number("cut_from_s"), 0.3, 0.8);
      CHECK_NEAR(json.number("cut_to_s") - json.number("cut_from_s"), 1.5, 1e-3);
      const Outcome m =
          run("monitor --machine tooth2.ini --trace tooth.csv --events tooth.jsonl --quiet");
      that(m.status == 0, m, "success", __LINE__);
      // The break, a second into the cut; four teeth at 6000 rpm: 2.5 ms a tooth.
      const double broke_s = json.number("cut_from_s") + 1;
      double tooth_s = 0, ar_s = 0;
      for (const std::string& line : lines(content(folder / "tooth.jsonl"))) {
        const Json event(line);
        if (event.text("state") != "alarm" || event.text("channel") != "tool") continue;
        double& at = event.text("monitor") == "tooth-breakage" ? tooth_s : ar_s;
        if (at == 0) at = event.number("t_s");
      }
      check::figure("break to alarm, tooth-breakage", 1e3 * (tooth_s - broke_s), "ms");
      check::figure("break to alarm, ar-breakage", 1e3 * (ar_s - broke_s), "ms");
      // m + 3 tooth periods, and three turns.
      CHECK_BETWEEN(tooth_s - broke_s, 0.0, 7 * 2.5e-3);
      CHECK_BETWEEN(ar_s - broke_s, 0.0, 3 * 10e-3);
    }
  }
}

}  // namespace

int main() {
  return in_own_folder("desk", [] {
    lobes();
    simulate_drive();
    simulate_milling();
    pockets();
    broken_tooth();
  });
}
