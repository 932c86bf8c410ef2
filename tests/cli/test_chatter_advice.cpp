// A cut that chatters, simulated between its drives, through the program: the frequency that an
// alarm tells and the speeds that it advises, against the simulated structure.
#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdio>
#include <string>
#include <vector>

#include "check.hpp"
#include "cli/chattering_machine.hpp"
#include "program.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/semi_discretization.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/sim/milling_simulator.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace {

using namespace program_test;
using namespace servosense;

using chattering_machine::Given;
using chattering_machine::machine_of;
using chattering_machine::replaced;

/// Strongest line of the displacement off the harmonics of the rotation, over the second half of
/// the cut; 1 Hz and less apart. The truth, from the simulated cut alone.
double swings_at_hz(const MachineFile& machine) {
  auto m = *milling_simulation(machine, 1.2);
  const double rotation_hz = m.cut.spindle_speed_rpm / 60;
  auto cut = *MillingSimulator::create(m);
  const double period_s = 125e-6;
  std::vector<double> x, y;
  const int per_sample = static_cast<int>(std::lround(period_s / m.step_s));
  for (int i = 0; i < 9600; ++i) {
    MillingStep s;
    for (int k = 0; k < per_sample; ++k) s = cut.step();
    if (i >= 4800) x.push_back(s.x_m), y.push_back(s.y_m);
  }
  double most = 0, at_hz = 0;
  const auto n = static_cast<double>(x.size());
  for (double hz = 100; hz < 3000; hz += 0.5) {
    if (std::abs(std::remainder(hz, rotation_hz)) < 3 / (n * period_s)) continue;
    std::complex<double> sx, sy;
    const auto turn = std::polar(1.0, -kTwoPi * hz * period_s);
    std::complex<double> w = 1;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double taper = 1 - std::cos(kTwoPi * (static_cast<double>(i) + 0.5) / n);
      sx += taper * x[i] * w;
      sy += taper * y[i] * w;
      w *= turn;
    }
    const double power = std::norm(sx) + std::norm(sy);
    if (power > most) most = power, at_hz = hz;
  }
  return at_hz;
}

/// Place of the alarm in the list of events; its size when there is none.
std::size_t alarm_of(const Json& json) {
  const std::size_t all = json.sizes.at("events");
  for (std::size_t i = 0; i < all; ++i) {
    const std::string event = "events." + std::to_string(i);
    if (json.text(event + ".monitor") == "chatter" && json.text(event + ".state") == "alarm")
      return i;
  }
  return all;
}

Outcome monitored(const std::string& machine) {
  chattering_machine::learn(machine);
  Outcome o = run("simulate milling --machine " + machine + " --out cut.csv");
  that(o.status == 0, o, "cuts", __LINE__);
  o = run("monitor --machine learned.ini --trace cut.csv --report cut.html --json --quiet");
  that(o.status == 0, o, "monitors", __LINE__);
  return o;
}

void tests(bool nightly) {
  int told = 0, advised = 0;
  std::vector<Given> cuts{{4, 3700, 0.0006, 620}, {5, 4100, 0.0006, 835}, {4, 2800, 0.0007, 835}};
  if (nightly)
    cuts.insert(cuts.begin(),
                {{4, 3700, 0.0004, 620}, {3, 3300, 0.0006, 620}, {2, 7200, 0.001, 620}});
  for (const Given& g : cuts) {
    const std::string text = machine_of(g);
    put("cut.ini", text);
    const Outcome o = monitored("cut.ini");
    const Json json(o.out);
    // What has alarmed was watched, and is not called deaf.
    that(json.text("verdict") == "alarm" && json.text("monitors.0.name") == "chatter" &&
             json.text("monitors.0.sees_from.blind") != "true",
         o, "chatter was watched", __LINE__);
    that(json.ok, o, "prints JSON", __LINE__);
    if (!json.ok) continue;
    const std::size_t alarm = alarm_of(json);
    that(alarm < json.sizes.at("events"), o, "hears the chatter", __LINE__);
    if (alarm == json.sizes.at("events")) continue;
    const std::string advice = "events." + std::to_string(alarm) + ".advice";
    for (const char* key : {"chatter_hz", "chatter_standard_error_hz", "speeds_uncertainty_rpm"})
      that(json.text(advice + "." + key) != "(absent)" &&
               json.text(std::string("advice.") + key) != "(absent)",
           o, std::string("has ") + key, __LINE__);
    const MachineFile machine = *MachineFile::parse(text, "cut.ini");
    const std::string hz = json.text(advice + ".chatter_hz");
    const double true_hz = swings_at_hz(machine);
    std::printf("  %d teeth, %.0f rpm, %.1f mm: %s Hz, swings at %.1f Hz\n", g.teeth, g.rpm,
                1e3 * g.depth_m, hz.c_str(), true_hz);
    if (hz != "null") {
      ++told;
      CHECK_NEAR(json.number(advice + ".chatter_hz"), true_hz, 0.01 * true_hz);
      that(contains(content(folder / "cut.html"), ">chatter<"), o, "the report marks it", __LINE__);
    }
    const auto m = *milling_simulation(machine, 1);
    const auto exact = *SemiDiscretization::create(m.structure, m.tool, m.cut);
    const std::size_t speeds = json.sizes.at(advice + ".speeds_rpm");
    for (std::size_t i = 0; i < speeds; ++i) {
      ++advised;
      const double rpm = json.number(advice + ".speeds_rpm." + std::to_string(i));
      CHECK(std::abs(rpm / g.rpm - 1) > 0.02);
      CHECK(exact.spectral_radius(rpm, g.depth_m) < 1);
    }
    const std::string reason = json.text("events." + std::to_string(alarm) + ".reason");
    that(contains(reason, speeds > 0 ? "; stable at the depth" : "; no speed is known"), o,
         "says what is known of speeds", __LINE__);
  }
  check::figure("cuts", static_cast<double>(cuts.size()));
  check::figure("of these, frequency told", told);
  check::figure("speeds advised", advised);
  CHECK(told >= (nightly ? 3 : 2) && advised >= 6);

  // Without its structure a file knows no speeds, and says so.
  std::string text = content(folder / "learned.ini");
  const auto from = text.find("[structure.x]"), to = text.find("[simulation]");
  CHECK(from < to && to != std::string::npos);
  put("bare.ini", text.erase(from, to - from));
  const Outcome o = run("monitor --machine bare.ini --trace cut.csv --json --quiet");
  const Json json(o.out);
  const std::size_t alarm = alarm_of(json);
  that(alarm < json.sizes.at("events"), o, "hears the chatter", __LINE__);
  that(json.sizes.contains("advice.speeds_rpm") && json.sizes.at("advice.speeds_rpm") == 0, o,
       "advises nothing", __LINE__);
  that(contains(json.text("events." + std::to_string(alarm) + ".reason"),
                "no speed is known to be stable: the file has no modes in [structure.x]"),
       o, "says why", __LINE__);

  // A file by which the present speed is stable is not of this cut.
  put("flat.ini", replaced(content(folder / "learned.ini"), "axial_depth_m = 0.000700",
                           "axial_depth_m = 0.000010"));
  const Outcome p = run("monitor --machine flat.ini --trace cut.csv --json --quiet");
  that(contains(p.out, "so they are not those of this cut"), p, "says why", __LINE__);
}

}  // namespace

int main(int argc, char** argv) {
  return program_test::in_own_folder("chatter_advice", [&] { tests(check::nightly(argc, argv)); });
}
