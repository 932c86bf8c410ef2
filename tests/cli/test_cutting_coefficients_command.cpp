// What `monitor` says of the coefficients of a cut: found, changed, not to be told, not asked for.
// The trace is of the generator of tests/monitors/milled_program.hpp.
#include <array>
#include <cmath>
#include <cstdio>
#include <string>

#include "check.hpp"
#include "cli/program.hpp"
#include "monitors/milled_program.hpp"

namespace {

using namespace program_test;

constexpr double kMass_kg = 50;

/// Two kinds of passes with two feeds; from the fourth on `share` more force.
std::string trace(double feed, double other_feed, double share, milled::Machine<>& m) {
  std::string text =
      "t_s,spindle.angle_rad,spindle.torque_Nm,x.position_m,x.force_N,y.position_m,"
      "y.force_N\n";
  long sample = 0;
  std::array<std::array<double, 2>, 2> before{};  // position and speed of each axis
  m.heard = [&](const milled::Heard& h) {
    // The generator's axes weigh nothing.
    std::array<double, 2> mass_N{};
    for (std::size_t i = 0; i < 2; ++i) {
      const double speed = (h.position_m[i] - before[i][0]) / milled::kPeriod_s;
      mass_N[i] = kMass_kg * (speed - before[i][1]) / milled::kPeriod_s;
      before[i] = {h.position_m[i], speed};
    }
    char row[200];
    std::snprintf(row, sizeof row, "%.6f,%.7f,%.5f,%.9f,%.3f,%.9f,%.3f\n",
                  static_cast<double>(sample++) * milled::kPeriod_s, h.angle_rad, h.torque_Nm,
                  h.position_m[0], h.force_N[0] + mass_N[0], h.position_m[1],
                  h.force_N[1] + mass_N[1]);
    text += row;
  };
  m.air(0.5, 6000);
  const milled::Material first = m.material;
  for (int pass = 0; pass < 6; ++pass) {
    const double more = pass < 3 ? 1 : 1 + share;
    m.material = {more * first.ktc, more * first.kte, more * first.krc, more * first.kre};
    milled::Pass p;
    p.length_m = 0.05;
    p.direction_rad = pass % 2 == 0 ? 0.6 : 0.6 + milled::kPi;
    p.feed_per_tooth_m = pass % 2 == 0 ? feed : other_feed;
    m.mill(p);
  }
  m.air(0.2, 6000);
  return text;
}

std::string machine(const std::string& own, const std::string& cut) {
  return "[machine]\nsample_rate_hz = 8000\n"
         "[spindle]\ninertia_kg_m2 = 0.001\nencoder_counts_per_rev = 65536\n"
         "[axis.x]\nequivalent_mass_kg = 50\n[axis.y]\nequivalent_mass_kg = 50\n"
         "[monitor.chatter]\nchatter_threshold_Nm2 = 100\n"
         "[monitor.collision]\nthreshold_N_per_s = 1e9\ncutting_torque_Nm = 0.3\n"
         "[tool]\ndiameter_m = 0.016\nteeth = 4\ntangential_coefficient_N_per_m2 = 1.7e9\n"
         "tangential_edge_N_per_m = 3e4\nradial_ratio = 0.3\nradial_edge_N_per_m = 2e4\n" +
         cut + own;
}
const char* const kCut =
    "[cut]\nspindle_speed_rpm = 6000\nfeed_per_tooth_m = 60e-6\naxial_depth_m = 0.003\n"
    "radial_immersion_m = 0.008\ndirection = down\n";
const char* const kOwn = "[monitor.cutting-coefficients]\nteach_slots = 100\n";

/// Of a coefficient: its place in the list.
std::string at(int i, const char* key) { return "coefficients." + std::to_string(i) + "." + key; }

void tests() {
  put("m.ini", machine(kOwn, kCut));
  put("off.ini", machine("", kCut));
  put("untold.ini", machine(kOwn, "[cut]\nfeed_per_tooth_m = 60e-6\n"));
  milled::Shop shop;
  const milled::Material truth;
  {
    milled::Machine<> m(shop, truth, 5);
    put("sound.csv", trace(45e-6, 90e-6, 0, m));
  }
  {
    milled::Machine<> m(shop, truth, 6);
    put("changed.csv", trace(45e-6, 90e-6, 0.25, m));
  }
  {
    milled::Machine<> m(shop, truth, 7);
    put("one.csv", trace(60e-6, 60e-6, 0, m));
  }

  const Outcome sound = run("monitor --machine m.ini --trace sound.csv --json --quiet");
  that(sound.status == 0, sound, "watches", __LINE__);
  const Json j(sound.out);
  const auto s = milled::shares(shop);
  const double edge = s.torque_edge_m2 / (s.torque_chip_m3 * 60e-6);
  CHECK_TEXT(j.text(at(0, "name")), "specific_force");
  CHECK_NEAR(j.number(at(0, "value")) / (truth.ktc + truth.kte * edge), 1, 0.02);
  CHECK_NEAR(j.number(at(1, "value")), 1, 0.03);
  CHECK_NEAR(j.number(at(2, "value")) / truth.ktc, 1, 0.03);
  CHECK(j.number(at(2, "low")) < truth.ktc && j.number(at(2, "high")) > truth.ktc);
  CHECK_NEAR(j.number(at(6, "value")) / (truth.krc / truth.ktc), 1, 0.08);
  // The generator's axes stop at once behind a pass, and signal health says so.
  CHECK(j.number("alarms") == 0 && !contains(sound.out, "has changed at once"));
  CHECK(contains(sound.out, "cutting-coefficients") && contains(sound.out, "sees_from"));

  // Run-out of the file beyond what the errors hold is said; throws are one a tooth.
  const auto with_tool = [&](const std::string& line) {
    std::string text = machine(kOwn, kCut);
    text.insert(text.find("[cut]"), line);
    put("thrown.ini", text);
  };
  with_tool("runout_m = 12e-6\n");
  const Outcome thrown = run("monitor --machine thrown.ini --trace one.csv --json --quiet");
  that(thrown.status == 0 && contains(thrown.out, "run-out up to 5 um, [tool] has 12 um"), thrown,
       "says what its errors hold", __LINE__);
  with_tool("throw_m = 1e-6, -1e-6\n");
  refused("monitor --machine thrown.ini --trace one.csv", 3,
          {"throw_m needs one number for each of the 4 teeth"}, __LINE__);

  // What was found is a file that other commands read.
  std::string told = machine(kOwn, kCut);
  told += "[structure.x]\nmodes = 600 0.03 12\n[structure.y]\nmodes = 700 0.03 12\n";
  put("told.ini", told);
  const Outcome wrote =
      run("monitor --machine told.ini --trace sound.csv --coefficients-out found.ini");
  that(wrote.status == 0 && !contains(wrote.err, "not written"), wrote, "writes them", __LINE__);
  const std::string found = content(folder / "found.ini");
  CHECK(contains(found, "provenance = servosense monitor: sound.csv (") &&
        contains(found, "revolutions of cut)") && contains(found, "radial_ratio = "));
  for (const char* key : {"tangential_coefficient_N_per_m2", "tangential_edge_N_per_m",
                          "radial_ratio", "radial_edge_N_per_m"}) {
    const std::size_t at = told.find(std::string(key) + " =");
    told.erase(at, told.find('\n', at) + 1 - at);
  }
  told.insert(told.find("[cut]"), "coefficients = found.ini\n");
  put("named.ini", told);
  const Outcome lobes = run("lobes --machine named.ini --json");
  that(lobes.status == 0, lobes, "are read", __LINE__);
  const Outcome without =
      run("monitor --machine off.ini --trace one.csv --quiet --coefficients-out none.ini");
  that(without.status != 0 && contains(without.err, "[monitor.cutting-coefficients]") &&
           !fs::exists(folder / "none.ini"),
       without, "says why there is no file", __LINE__);

  const Outcome changed =
      run("monitor --machine m.ini --trace changed.csv --quiet --report changed.html");
  const std::string page = content(folder / "changed.html");
  CHECK(contains(page, "Specific cutting force") && contains(page, "Radial ratio") &&
        contains(page, "changed by ") && contains(page, "of the new tool"));
  that(changed.status == 0, changed, "watches", __LINE__);
  that(contains(changed.out, "warning") && contains(changed.out, "has changed at once"), changed,
       "tells the change", __LINE__);

  // A tool that asks for a quarter more is worn, where the wear monitor has a rule for it.
  put("wear.ini", machine(kOwn, kCut) + "[monitor.wear]\nspecific_force_ratio = 1.15\n");
  const Outcome worn = run("monitor --machine wear.ini --trace changed.csv --quiet");
  that(contains(worn.out, "the specific cutting force is that of a worn tool") &&
           contains(worn.out, "and a worn tool from 1.15 times that of the new one on"),
       worn, "calls it worn", __LINE__);
  const Outcome sharp = run("monitor --machine wear.ini --trace sound.csv --quiet --json");
  that(sharp.status == 0 && Json(sharp.out).number("alarms") == 0, sharp, "leaves a sharp one",
       __LINE__);
  put("deaf.ini", machine("", kCut) + "[monitor.wear]\nspecific_force_ratio = 1.15\n");
  const Outcome deaf = run("monitor --machine deaf.ini --trace one.csv --quiet");
  that(contains(deaf.out, "write [monitor.cutting-coefficients] and what it needs"), deaf,
       "says that nothing tells the specific force", __LINE__);
  // Still being taught: how far it is.
  put("taught.ini", machine("[monitor.cutting-coefficients]\nteach_slots = 100000\n", kCut));
  const Outcome taught = run("monitor --machine taught.ini --trace one.csv --quiet");
  that(contains(taught.out, "cutting-coefficients (still being taught: ") &&
           contains(taught.out, " of 100000 stretches of cut") &&
           !contains(taught.out, "no cut of its kind"),
       taught, "says that it is being taught", __LINE__);

  const Outcome one = run("monitor --machine m.ini --trace one.csv --quiet");
  that(contains(one.out, "K_te           not told: the feed per tooth has varied too little"), one,
       "says what one feed cannot tell", __LINE__);
  that(contains(one.out, "specific_force") && !contains(one.out, "specific_force not told"), one,
       "tells the specific force", __LINE__);

  const Outcome off = run("monitor --machine off.ini --trace one.csv --json --quiet");
  that(off.status == 0 && !contains(off.out, "coefficients"), off, "is silent", __LINE__);
  const Outcome untold = run("monitor --machine untold.ini --trace one.csv --quiet");
  that(contains(untold.out, "does not run: needs the engagement of every cut; write axial_depth_m"),
       untold, "says what is missing", __LINE__);
}

}  // namespace

int main() { return in_own_folder("cutting_coefficients_command", tests); }
