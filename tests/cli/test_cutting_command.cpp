// servosense identify cutting by the program alone, on cuts from an integration of its own: what it
// finds and how sure it is of it, by every sensor; what it refuses; that what it writes serves the
// other commands.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <random>

#include "cutting_rig.hpp"

using namespace program_test;
using namespace cutting_rig;

namespace {

void by_current(unsigned first, unsigned count) {
  unsigned chip_inside = 0, edge_inside = 0;
  double worst_chip = 0, worst_edge = 0;
  for (unsigned seed = first; seed < first + count; ++seed) {
    const Rig r = Rig::random(seed);
    put("m.ini", r.machine(kCurrent));
    write_current(r, "cut.csv", false);
    const Outcome o = run("identify cutting --machine m.ini --json cut.csv");
    that(o.status == 0, o, "seed " + std::to_string(seed), __LINE__);
    if (o.status != 0) continue;
    const Json json(o.out);
    that(json.ok && json.sizes.at("cuts") == 5, o, "five cuts", __LINE__);
    const Coefficients c(json);
    chip_inside += std::abs(c.ktc - r.cut.ktc) <= 1.96 * c.ktc_error ? 1 : 0;
    edge_inside += std::abs(c.kte - r.cut.kte) <= 1.96 * c.kte_error ? 1 : 0;
    worst_chip = std::max(worst_chip, std::abs(c.ktc / r.cut.ktc - 1));
    worst_edge = std::max(worst_edge, std::abs(c.kte / r.cut.kte - 1));
  }
  check::figure("current: worst tangential coefficient", 100 * worst_chip, "%");
  check::figure("current: worst edge coefficient", 100 * worst_edge, "%");
  check::figure("current: chip within its 95 % interval, of 100", 100.0 * chip_inside / count);
  check::figure("current: edge within its 95 % interval, of 100", 100.0 * edge_inside / count);
  CHECK(worst_chip < 0.02);
  CHECK(worst_edge < 0.05);
  if (count < 100) return;
  CHECK_BETWEEN(chip_inside, 90, 99);
  CHECK_BETWEEN(edge_inside, 90, 99);
}

/// Levels of torque as eq. 3.19 of Dunwoody 2010 has them, by two sensors.
constexpr double kThesis_m = 0.01, kThesisDepth_m = 0.005;
double slot_torque(double ktc, double kte, double feed_m) {
  return kThesis_m * 2 * kThesisDepth_m * (ktc * feed_m / (kTurn / 2) + kte / 2);
}

constexpr const char* kThesisTool =
    "[tool]\ndiameter_m = 0.02\nteeth = 2\n[cut]\naxial_depth_m = 0.005\ndirection = slot\n";

void thesis_torques() {
  std::ofstream out(folder / "thesis.csv");
  out << "t_s,spindle.speed_rad_s,spindle.torque_Nm,tool.torque_Nm,tool.feed_per_tooth_m\n";
  char line[160];
  const double feeds[] = {0, 5e-5, 0, 1e-4, 0, 1.5e-4, 0};
  for (int n = 0; n < 14000; ++n) {
    const double feed = feeds[n / 2000];
    std::snprintf(line, sizeof line, "%.4f,500,%.17g,%.17g,%.17g\n", n * 5e-4,
                  feed > 0 ? slot_torque(1040e6, 9810, feed) : 0.0,
                  feed > 0 ? slot_torque(936e6, 13900, feed) : 0.0, feed);
    out << line;
  }
  out.close();
  put("thesis.ini", std::string("[spindle]\n") + kThesisTool);
  const Outcome o = run("identify cutting --machine thesis.ini --json thesis.csv");
  const Json json(o.out);
  that(o.status == 0 && json.text("sensor") == "tool.torque_Nm", o, "a dynamometer first",
       __LINE__);
  CHECK_NEAR(json.number("sensors.0.tangential_coefficient_N_per_m2") / 936e6, 1, 1e-6);
  CHECK_NEAR(json.number("sensors.0.tangential_edge_N_per_m") / 13900, 1, 1e-6);
  CHECK_NEAR(json.number("sensors.1.tangential_coefficient_N_per_m2") / 1040e6, 1, 1e-6);
  CHECK_NEAR(json.number("sensors.1.tangential_edge_N_per_m") / 9810, 1, 1e-6);
  that(contains(o.err, "tangential coefficient +11.1 %, edge -29.4 %"), o, "their difference",
       __LINE__);
}

/// A load meter is calibrated by air and reference cuts, and then reads the torque of a cut.
void load_meter_calibration() {
  constexpr double kMeter = 3.88e-4, kViscous = 1.43e-7 / kMeter, kCoulomb = -2.51e-5 / kMeter;
  std::ofstream out(folder / "calibration.csv");
  out << "t_s,spindle.speed_rad_s,spindle.load_V,tool.torque_Nm\n";
  std::mt19937_64 bits(77);
  std::normal_distribution<double> noise(0, 1);
  const double gain = 1 - std::exp(-kTurn * 7 / 200);
  double shown = 0;
  long n = 0;
  for (int rpm = 1000; rpm <= 20000; rpm += 1000)
    for (int part = 0; part < 3; ++part)
      for (int k = 0; k < 400; ++k, ++n) {
        const double w = rpm * kTurn / 60, torque = part == 1 ? 2.5 : 0;
        // Where friction is no line any more it is nothing.
        const double friction = rpm >= 2000 ? kViscous * w + kCoulomb : 0;
        const double volts = kMeter * w * (torque + friction);
        shown = k == 0 && part == 0 ? volts : shown + gain * (volts - shown);
        out << static_cast<double>(n) * 0.005 << ',' << w << ','
            << rounded_to(shown + 6e-4 * noise(bits), 3e-4) << ',' << torque + 0.02 * noise(bits)
            << '\n';
      }
  out.close();
  put("bare.ini", std::string("[spindle]\n") + kThesisTool);
  const Outcome o =
      run("identify load-meter --machine bare.ini --out meter.ini --json calibration.csv");
  const Json json(o.out);
  that(o.status == 0 && json.ok, o, "calibrates", __LINE__);
  const double k = json.number("load_meter_V_per_W.value"),
               b = json.number("viscous_friction_Nm_s_per_rad.value"),
               c = json.number("constant_Nm.value");
  CHECK_NEAR(k / kMeter, 1, 0.01);
  CHECK_NEAR(k * b / 1.43e-7, 1, 0.02);
  CHECK_NEAR(c, kCoulomb, 0.005);
  CHECK(contains(content(folder / "meter.ini"), "[effect.spindle.constant-load]"));
  CHECK(contains(content(folder / "meter.ini"), "power_known_from_rpm = 2000"));
  // Reference points of the work: volts in the air.
  const double reference[][2] = {
      {2000, 0.001016}, {5000, 0.02606}, {10000, 0.13053}, {20000, 0.5747}};
  for (const auto& [rpm, volts] : reference) {
    const double w = rpm * kTurn / 60;
    CHECK_NEAR(k * w * (b * w + c), volts, 2e-4 + 0.005 * volts);
  }
  // Slow cuts are not believed.
  const Outcome slow = run("identify load-meter --machine bare.ini --out none.ini thesis.csv");
  that(slow.status == 3 && contains(slow.err, "spindle.load_V"), slow, "no load", __LINE__);
}

/// The load meter of the thesis: its constants, 7 Hz, its quantum, and noise of three quanta.
void load_meter(unsigned first, unsigned count) {
  constexpr double kMeter = 3.88e-4, kViscous = 3.7e-4, kCoulomb = -0.0647, kQuantum = 3e-4;
  unsigned chip_inside = 0, edge_inside = 0;
  double worst_chip = 0, worst_edge = 0;
  for (unsigned seed = first; seed < first + count; ++seed) {
    std::mt19937_64 bits(seed + 31);
    std::normal_distribution<double> noise(0, 3 * kQuantum);
    MillingCut cut;
    cut.helix_deg = 30;
    CutPlan plan;
    plan.speed_rad_s = std::uniform_real_distribution<double>(700, 2000)(bits);
    for (const double feed : {1e-4, 2.5e-5, 5e-5, 1e-4, 2.5e-5}) {
      plan.stretches.push_back({1.5, 0});
      plan.stretches.push_back({2.5 + 0.02 * kTurn / (feed * 2 * plan.speed_rad_s), feed});
    }
    plan.stretches.push_back({1.5, 0});
    std::ofstream out(folder / "load.csv");
    out << "t_s,spindle.speed_rad_s,spindle.load_V,tool.feed_per_tooth_m,machine.nc_block\n";
    const double rate_hz = 500, gain = 1 - std::exp(-kTurn * 7 / rate_hz);
    double shown = 0;
    bool started = false;
    char line[160];
    plan.run(cut, rate_hz, [&](const CutPlan::Instant& i) {
      const double w = plan.speed_rad_s;
      const double volts = kMeter * w * (i.load.torque + kViscous * w + kCoulomb);
      shown = started ? shown + gain * (volts - shown) : volts;
      started = true;
      std::snprintf(line, sizeof line, "%.4f,%.9g,%.6g,%.9g,%d\n", i.t_s, w,
                    rounded_to(shown + noise(bits), kQuantum), i.axes_feed_m, i.block);
      out << line;
    });
    out.close();
    put("load.ini", std::string("[spindle]\nload_meter_V_per_W = 3.88e-4\n"
                                "viscous_friction_Nm_s_per_rad = 3.7e-4\n") +
                        kThesisTool);
    const Outcome o = run("identify cutting --machine load.ini --json load.csv");
    const Json json(o.out);
    that(o.status == 0 && json.ok && json.sizes.at("cuts") == 5, o, "five cuts by a load meter",
         __LINE__);
    const Coefficients c(json);
    chip_inside += std::abs(c.ktc - cut.ktc) <= 1.96 * c.ktc_error ? 1 : 0;
    edge_inside += std::abs(c.kte - cut.kte) <= 1.96 * c.kte_error ? 1 : 0;
    worst_chip = std::max(worst_chip, std::abs(c.ktc / cut.ktc - 1));
    worst_edge = std::max(worst_edge, std::abs(c.kte / cut.kte - 1));
  }
  check::figure("load meter: worst tangential coefficient", 100 * worst_chip, "%");
  check::figure("load meter: worst edge coefficient", 100 * worst_edge, "%");
  check::figure("load meter: chip within its 95 % interval, of 100", 100.0 * chip_inside / count);
  check::figure("load meter: edge within its 95 % interval, of 100", 100.0 * edge_inside / count);
  CHECK(worst_chip < 0.02);
  CHECK(worst_edge < 0.05);
  if (count < 100) return;
  CHECK_BETWEEN(chip_inside, 90, 99);
  CHECK_BETWEEN(edge_inside, 90, 99);
}

/// Radial coefficients from the axes: 300 N of force, 100 N of friction.
void radial(unsigned first, unsigned count) {
  unsigned inside = 0;
  double worst = 0;
  for (unsigned seed = first; seed < first + count; ++seed) {
    Rig r = Rig::random(seed);
    r.axis_wrong = 0.9;  // the air in the record corrects it
    for (auto& stretch : r.plan.stretches)
      stretch.direction_deg = seed % 3 == 0 ? 0 : 30 + seed % 7;
    // The force of the strongest cut is 300 N.
    double force = 0;
    for (int i = 0; i < 360; ++i) {
      const auto l = r.cut.at(i * kTurn / 360, r.feed_m);
      force += std::hypot(l.x, l.y) / 360;
    }
    r.cut.depth_m *= 300 / force;
    put("m.ini", r.machine(kCurrent));
    write_current(r, "cut.csv", true);
    const Outcome o = run("identify cutting --machine m.ini --json cut.csv");
    const Json json(o.out);
    that(o.status == 0 && json.ok, o, "seed " + std::to_string(seed), __LINE__);
    const Coefficients c(json);
    const double truth = r.cut.krc / r.cut.ktc;
    inside += std::abs(c.ratio - truth) <= 1.96 * c.ratio_error ? 1 : 0;
    worst = std::max(worst, std::abs(c.ratio / truth - 1));
  }
  check::figure("axes: worst radial ratio", 100 * worst, "%");
  check::figure("axes: radial ratio within its 95 % interval, of 100", 100.0 * inside / count);
  CHECK(worst < 0.05);
  if (count < 100) return;
  CHECK_BETWEEN(inside, 90, 99);
}

/// A dynamometer under the work tells all six, whatever its drift is.
void dynamometer() {
  Rig r = Rig::random(21);  // down milling
  std::ofstream out(folder / "dyno.csv");
  out << "t_s,spindle.speed_rad_s,dyno.force_x_N,dyno.force_y_N,dyno.force_z_N,"
         "tool.feed_per_tooth_m\n";
  std::mt19937_64 bits(4);
  std::normal_distribution<double> noise(0, 2);
  char line[200];
  r.plan.run(r.cut, r.rate_hz, [&](const CutPlan::Instant& i) {
    std::snprintf(line, sizeof line, "%.6f,%.9g,%.6g,%.6g,%.6g,%.9g\n", i.t_s, r.plan.speed_rad_s,
                  -i.load.x + 7 + noise(bits), -i.load.y - 4 + noise(bits),
                  -i.load.z + 11 + noise(bits), i.feed_m);
    out << line;
  });
  out.close();
  put("dyno.ini", r.machine(kCurrent));
  const Outcome o = run("identify cutting --machine dyno.ini --json dyno.csv");
  const Json json(o.out);
  that(o.status == 0 && json.ok, o, "all six", __LINE__);
  const struct {
    const char* key;
    double truth, within;
  } expected[] = {{"tangential_coefficient_N_per_m2", r.cut.ktc, 0.01},
                  {"tangential_edge_N_per_m", r.cut.kte, 0.03},
                  {"radial_ratio", r.cut.krc / r.cut.ktc, 0.02},
                  {"radial_edge_N_per_m", r.cut.kre, 0.05},
                  {"axial_coefficient_N_per_m2", r.cut.kac, 0.02},
                  {"axial_edge_N_per_m", r.cut.kae, 0.05}};
  for (const auto& e : expected) {
    CHECK_NEAR(json.number(e.key) / e.truth, 1, e.within);
    CHECK(std::abs(json.number(e.key) - e.truth) <
          4 * json.number(std::string(e.key) + "_standard_error"));
  }
}

/// Rows of torque at levels, a second each.
void write_levels(const std::string& name, const std::vector<double>& torques,
                  const std::vector<double>& feeds, double speed = 500, int rows = 1000) {
  std::ofstream out(folder / name);
  out << "t_s,spindle.speed_rad_s,spindle.torque_Nm,tool.feed_per_tooth_m\n";
  std::mt19937_64 bits(8);
  std::normal_distribution<double> noise(0, 0.02);
  int n = 0;
  for (std::size_t s = 0; s < torques.size(); ++s)
    for (int k = 0; k < rows; ++k, ++n)
      out << n * 1e-3 << ',' << speed << ',' << torques[s] + noise(bits) << ',' << feeds[s] << '\n';
}

void refusals_and_files() {
  const auto torque = [](double feed) { return slot_torque(1040e6, 9810, feed); };
  put("t.ini", std::string("[spindle]\n") + kThesisTool);
  const std::string command = "identify cutting --machine t.ini ";

  write_levels("one.csv", {0, torque(1e-4), 0, torque(1e-4), 0}, {0, 1e-4, 0, 1e-4, 0});
  refused(command + "--json one.csv", 3,
          {"one feed, 0.1 mm a tooth", "add a cut at half the feed, 0.05 mm"}, __LINE__);
  std::string known = content(folder / "t.ini");
  known.insert(known.find("[cut]"), "tangential_edge_N_per_m = 9810\n");
  put("known.ini", known);
  const Json held(run("identify cutting --machine known.ini --json one.csv").out);
  CHECK_NEAR(held.number("tangential_coefficient_N_per_m2") / 1040e6, 1, 0.01);
  CHECK_TEXT(held.text("tangential_edge_held"), "true");

  write_levels("stands.csv", {0, 3, 0}, {0, 1e-4, 0}, 0);
  refused(command + "stands.csv", 3, {"stands.csv", "the spindle stands"}, __LINE__);
  write_levels("air.csv", {0, 0, 0}, {1e-4, 1e-4, 1e-4});
  refused(command + "air.csv", 3, {"no cut was found"}, __LINE__);
  write_levels("short.csv", {0, torque(1e-4), 0, torque(5e-5), 0}, {0, 1e-4, 0, 5e-5, 0}, 500, 100);
  refused(command + "short.csv", 3, {"too short", "at least"}, __LINE__);
  refused(command, 2, {"give one trace or more"}, __LINE__);
  put("bare.ini", "[spindle]\n[tool]\nteeth = 2\n[cut]\ndirection = slot\n");
  refused("identify cutting --machine bare.ini one.csv", 3, {"diameter_m"}, __LINE__);

  // 9549.3 rpm of two teeth are 318.31 Hz: at that rate every tooth is seen at one angle.
  {
    std::ofstream out(folder / "step.csv");
    out.precision(12);
    out << "t_s,spindle.speed_rad_s,spindle.torque_Nm,tool.feed_per_tooth_m\n";
    const double feeds[] = {0, 5e-5, 0, 1e-4, 0};
    for (int n = 0; n < 5000; ++n) {
      const double feed = feeds[n / 1000];
      const double t = n * kTurn / 2000;
      out << t << ",1000," << (feed > 0 ? torque(feed) : 0) << ',' << feed << '\n';
    }
  }
  refused(command + "step.csv", 3, {"in step with the", "cut at another speed"}, __LINE__);

  // A meter that stops at its end: the heavy cut is not used.
  {
    std::ofstream out(folder / "limit.csv");
    out << "t_s,spindle.speed_rad_s,spindle.torque_Nm,tool.feed_per_tooth_m\n";
    std::mt19937_64 bits(9);
    std::normal_distribution<double> noise(0, 0.1);
    const double feeds[] = {0, 5e-5, 0, 1e-4, 0, 2e-4, 0};
    for (int n = 0; n < 7000; ++n) {
      const double feed = feeds[n / 1000];
      out << n * 1e-3 << ",500," << std::min(5.0, (feed > 0 ? torque(feed) : 0) + noise(bits))
          << ',' << feed << '\n';
    }
  }
  const Outcome limit = run(command + "--json limit.csv");
  const Json limited(limit.out);
  that(limit.status == 0 && limited.text("cuts.2.used") == "false", limit, "a cut at the limit",
       __LINE__);
  that(contains(limited.text("cuts.2.reason"), "at its limit"), limit, "and why", __LINE__);
  CHECK_NEAR(limited.number("tangential_coefficient_N_per_m2") / 1040e6, 1, 0.02);

  // Into the machine file, and into a file of its own that it names.
  write_levels("two.csv", {0, torque(1e-4), 0, torque(5e-5), 0}, {0, 1e-4, 0, 5e-5, 0});
  std::string full = std::string("[spindle]\n") + kThesisTool;
  full.insert(full.find("[cut]"), "material = steel C45  # from the rack\n");
  full +=
      "spindle_speed_rpm = 4775\nfeed_per_tooth_m = 1e-4\n[structure.x]\nmodes = 600 0.03 12\n"
      "[structure.y]\nmodes = 700 0.03 12\n";
  put("full.ini", full);
  const Outcome in_place = run("identify cutting --machine full.ini --out in.ini two.csv");
  that(in_place.status == 0, in_place, "writes", __LINE__);
  const std::string written = content(folder / "in.ini");
  CHECK(contains(written, "tangential_coefficient_N_per_m2 = ") &&
        contains(written, "tangential_coefficient_relative_error = ") &&
        contains(written,
                 "provenance = servosense identify cutting: two.csv (2 cuts), by "
                 "spindle.torque_Nm"));
  fs::create_directories(folder / "tools");
  const Outcome apart = run(
      "identify cutting --machine full.ini --out apart.ini --coefficients tools/c45.ini two.csv");
  that(apart.status == 0, apart, "writes both", __LINE__);
  CHECK(contains(content(folder / "apart.ini"), "coefficients = tools/c45.ini"));
  CHECK(!contains(content(folder / "apart.ini"), "tangential"));
  CHECK(contains(content(folder / "tools/c45.ini"), "material = steel C45"));
  const Outcome lobes = run("lobes --machine apart.ini --json"),
                same = run("lobes --machine in.ini --json");
  that(lobes.status == 0 && lobes.out == same.out, lobes, "as with the keys in place", __LINE__);
  std::string twice = content(folder / "in.ini");
  twice.insert(twice.find("[cut]"), "coefficients = tools/c45.ini\n");
  put("twice.ini", twice);
  refused("lobes --machine twice.ini", 3, {"tangential_coefficient_N_per_m2 stands in", "c45.ini"},
          __LINE__);
  put("empty.ini", "[tool]\nteeth = 2\n");
  std::string empty = full;
  empty.insert(empty.find("[cut]"), "coefficients = empty.ini\n");
  put("hollow.ini", empty);
  refused("lobes --machine hollow.ini", 3, {"empty.ini", "no coefficients"}, __LINE__);
}

}  // namespace

// `--nightly`: the figures of docs/cutting-coefficients.md.
int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  return in_own_folder("cutting", [&] {
    by_current(nightly ? 95000 : 1, nightly ? 100 : 4);
    dynamometer();
    refusals_and_files();
    thesis_torques();
    load_meter_calibration();
    load_meter(nightly ? 95000 : 1, nightly ? 100 : 3);
    radial(nightly ? 95000 : 1, nightly ? 100 : 4);
  });
}
