// servosense identify modes by the program alone: the numbers of receptances that this test makes,
// the machine file it writes, and what it refuses.
#include <cmath>
#include <complex>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "program.hpp"
#include "ringing_trace.hpp"
#include "run_up_trace.hpp"
#include "servosense/io/machine_file.hpp"

namespace {

using namespace program_test;
using servosense::MachineFile;

struct True {
  double f_hz, zeta, mass_kg;
};

/// A receptance file: modal sum at s = window + jw, with noise.
std::string receptance(const std::vector<True>& modes, double step_hz, double noise, unsigned seed,
                       double window_per_s = 0, double sign = 1) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, noise);
  std::string text;
  if (window_per_s > 0) text = "# exponential_window_per_s: " + std::to_string(window_per_s) + "\n";
  text += "frequency_hz,receptance_re_m_per_N,receptance_im_m_per_N\n";
  for (double f = 200; f <= 1500; f += step_hz) {
    const std::complex<double> s(window_per_s, 2 * M_PI * f);
    std::complex<double> g = 5e-9;
    for (const True& m : modes) {
      const double w = 2 * M_PI * m.f_hz;
      g += 1. / (m.mass_kg * (s * s + 2 * m.zeta * w * s + w * w));
    }
    char row[120];
    const double re = normal(random), im = normal(random);
    std::snprintf(row, sizeof row, "%.6g,%.10e,%.10e\n", f, sign * g.real() + re,
                  sign * g.imag() + im);
    text += row;
  }
  return text;
}

const std::vector<True> kOfX = {{600, 0.03, 2}, {1000, 0.025, 1.2}};
const std::vector<True> kOfY = {{700, 0.04, 3}};
constexpr double kNoise = 8e-9;  // 1 to 4 % of the peaks

void mode_is(const Json& json, const std::string& path, const std::string& axis, const True& t) {
  CHECK_TEXT(json.text(path + ".axis"), axis);
  CHECK_NEAR(json.number(path + ".natural_frequency_hz"), t.f_hz, 1e-3 * t.f_hz);
  CHECK_NEAR(json.number(path + ".damping_ratio"), t.zeta, 0.05 * t.zeta);
  CHECK_NEAR(json.number(path + ".modal_mass_kg"), t.mass_kg, 0.05 * t.mass_kg);
  CHECK_BETWEEN(json.number(path + ".natural_frequency_hz_standard_error"), 1e-5 * t.f_hz,
                1e-3 * t.f_hz);
  CHECK_BETWEEN(json.number(path + ".damping_ratio_standard_error"), 1e-3 * t.zeta, 0.05 * t.zeta);
  CHECK_BETWEEN(json.number(path + ".modal_mass_kg_standard_error"), 1e-3 * t.mass_kg,
                0.05 * t.mass_kg);
}

void found() {
  put("x.csv", receptance(kOfX, 1, kNoise, 1));
  put("y.csv", receptance(kOfY, 1, kNoise, 2, 12));
  const Outcome one = run("identify modes --frf x.csv --json");
  that(one.status == 0 && contains(one.err, "x.csv is taken as the receptance of x"), one,
       "says which axis it takes", __LINE__);
  const Json json(one.out);
  that(json.ok && json.sizes.at("modes") == 2, one, "two modes", __LINE__);
  mode_is(json, "modes.0", "x", kOfX[0]);
  mode_is(json, "modes.1", "x", kOfX[1]);
  const Outcome two =
      run("identify modes --frf x.csv y.csv --axis y=y.csv --axis x=x.csv --json --quiet");
  const Json both(two.out);
  that(two.status == 0 && both.ok && both.sizes.at("modes") == 3, two, "three modes", __LINE__);
  mode_is(both, "modes.1", "x", kOfX[1]);
  mode_is(both, "modes.2", "y", kOfY[0]);  // without the damping of its window
  const Outcome text = run("identify modes --frf x.csv --report page.html");
  that(text.status == 0 && contains(text.out, "frequency, Hz"), text, "a table", __LINE__);
  CHECK(contains(content(folder / "page.html"), "Stabilisation diagram"));
}

void written() {
  const std::string kept =
      "[machine]\nname = mill  # keep me\n[structure.x]\nfrf = old.csv\n[tool]\nteeth = 4\n";
  put("m.ini", kept);
  const Outcome o = run(
      "identify modes --frf x.csv --frf y.csv --axis x=x.csv --axis y=y.csv --machine m.ini --out "
      "m2.ini");
  that(o.status == 0 && contains(o.err, "frf = old.csv is replaced"), o, "works", __LINE__);
  const std::string text = content(folder / "m2.ini");
  CHECK(contains(text, "name = mill  # keep me") && contains(text, "teeth = 4"));
  CHECK(!contains(text, "frf ="));
  const auto file = MachineFile::read((folder / "m2.ini").string());
  CHECK(file);
  if (!file) return;
  for (const auto& [section, modes] : {std::pair{"structure.x", &kOfX}, {"structure.y", &kOfY}}) {
    const auto values = file->triples(section, "modes");
    const auto errors = file->triples(section, "modes_relative_error");
    CHECK(values && errors && values->size() == modes->size() && errors->size() == modes->size());
    if (!values || !errors) continue;
    CHECK_NEAR(values->front()[0], modes->front().f_hz, 1e-3 * modes->front().f_hz);
    CHECK_NEAR(values->front()[2], modes->front().mass_kg, 0.05 * modes->front().mass_kg);
    CHECK_BETWEEN(errors->front()[0], 1e-5, 1e-3);
    CHECK_BETWEEN(errors->front()[1], 1e-3, 0.05);
    CHECK_BETWEEN(errors->front()[2], 1e-3, 0.05);
  }
  // Without a machine file the modes go into what is there, or into a file of their own.
  put("there.ini", kept);
  CHECK(run("identify modes --frf x.csv --out there.ini").status == 0);
  CHECK(contains(content(folder / "there.ini"), "teeth = 4") &&
        contains(content(folder / "there.ini"), "modes_relative_error = "));
  CHECK(run("identify modes --frf x.csv --out new.ini").status == 0);
  CHECK(contains(content(folder / "new.ini"), "[structure.x]\nmodes = "));
}

void said() {
  put("coarse.csv", receptance(kOfY, 25, kNoise, 3));  // 56 Hz are its half-power band
  const Outcome coarse = run("identify modes --frf coarse.csv --json");
  that(coarse.status == 0 && contains(coarse.err, "lines, and damping and mass hang on them"),
       coarse, "says that lines are too coarse", __LINE__);
}

void refusals() {
  put("noise.csv", receptance({}, 2, 1e-7, 4));
  put("turned.csv", receptance(kOfX, 1, kNoise, 5, 0, -1));
  refused("identify modes --frf noise.csv --json", 3, {"noise.csv", "no mode is found"}, __LINE__);
  refused("identify modes --frf turned.csv", 3, {"turned.csv"}, __LINE__);
  refused("identify modes", 2, {"--frf"}, __LINE__);
  refused("identify modes --frf x.csv --frf x.csv", 2, {"twice"}, __LINE__);
  refused("identify modes --frf x.csv --axis z=x.csv", 2, {"x=FILE or y=FILE"}, __LINE__);
  refused("identify modes --frf x.csv --axis x=y.csv", 2, {"as --frf, too"}, __LINE__);
  refused("identify modes --frf x.csv --from 900 --to 300", 2, {"--from"}, __LINE__);
  refused("identify modes --frf x.csv --from 2000", 3, {"fewer than 8"}, __LINE__);
  refused("identify modes --frf absent.csv", 4, {"absent.csv"}, __LINE__);
}

void without_a_hammer() {
  put("rings.csv", ringing_test::trace());
  put("rings2.csv", ringing_test::trace(true, false));
  put("still.csv", ringing_test::trace(false));
  const Outcome o = run("identify modes --trace rings.csv --json --report decays.html");
  const Json json(o.out);
  that(o.status == 0 && json.ok && json.sizes.at("modes") == 2, o, "two modes", __LINE__);
  for (int m = 0; m < 2; ++m) {
    const std::string path = "modes." + std::to_string(m) + ".";
    const double f_hz = ringing_test::kFrequencyHz[m], zeta = ringing_test::kDamping[m];
    CHECK_NEAR(json.number(path + "natural_frequency_hz"), f_hz, 5e-3 * f_hz);
    CHECK_NEAR(json.number(path + "damping_ratio"), zeta, 0.1 * zeta);
    CHECK_BETWEEN(json.number(path + "damping_ratio_standard_error"), 1e-3 * zeta, 0.1 * zeta);
    CHECK(json.number(path + "decays") == 2);
  }
  that(contains(o.out, "\"modal_mass_kg\": null") && contains(o.out, "modal mass is unknown") &&
           contains(o.err, "modal mass is unknown"),
       o, "says that it does not tell modal mass", __LINE__);
  CHECK(contains(content(folder / "decays.html"), "Modes from free decays"));
  // What no column tells: which one, and the rotation, which a machine file may say.
  const Outcome unknown = run("identify modes --trace rings2.csv");
  that(unknown.status == 0 && contains(unknown.err, "the rotation is unknown") &&
           contains(unknown.err, "dyno.force_x_N is taken"),
       unknown, "says what it lacks", __LINE__);
  put("speed.ini", "[cut]\nspindle_speed_rpm = 1800\n");
  const Outcome told = run("identify modes --trace rings2.csv --machine speed.ini --json");
  that(told.status == 0 && !contains(told.err, "the rotation is unknown"), told, "knows it",
       __LINE__);
  CHECK_NEAR(Json(told.out).number("decays.0.rotation_hz"), 30, 1e-6);
  refused("identify modes --trace still.csv", 3, {"still.csv", "nothing rings"}, __LINE__);
  refused("identify modes --trace rings.csv --column x.force_N", 3, {"no column x.force_N"},
          __LINE__);
  refused("identify modes --trace rings.csv --out m.ini", 2, {"--out", "mass"}, __LINE__);
  refused("identify modes --trace rings.csv --frf x.csv", 2, {"--frf"}, __LINE__);
  refused("identify modes --column x.force_N --frf x.csv", 2, {"--trace"}, __LINE__);
}

void from_run_ups() {
  put("run_up.csv", run_up_test::trace());
  put("fast.csv", run_up_test::trace(1));
  put("quiet.csv", run_up_test::trace(5, false));
  const Outcome o = run("identify modes --run-ups --trace run_up.csv --json --report run.html");
  const Json json(o.out);
  that(o.status == 0 && json.ok && json.sizes.at("modes") == 1, o, "one mode", __LINE__);
  CHECK_NEAR(json.number("modes.0.natural_frequency_hz"), run_up_test::kModeHz, 0.3);
  CHECK_NEAR(json.number("modes.0.damping_ratio"), run_up_test::kModeDamping, 0.003);
  CHECK(json.number("modes.0.crossings.0.order") == 1 && json.number("sweeps") == 1);
  that(contains(o.out, "\"modal_mass_kg\": null") && contains(o.err, "modal mass is unknown") &&
           contains(o.err, "no order of the rotation reaches them") &&
           contains(o.err, "nothing confirms it"),
       o, "says what it does not tell", __LINE__);
  CHECK(contains(content(folder / "run.html"), "Modes from run-ups"));
  that(contains(run("identify modes --run-ups --trace run_up.csv").out, "1 up at "), o,
       "says which order", __LINE__);
  refused("identify modes --run-ups --trace quiet.csv", 3, {"quiet.csv", "no mode answers"},
          __LINE__);
  refused("identify modes --run-ups --trace fast.csv", 3, {"fast.csv", "Hz/s of the rotation"},
          __LINE__);
  refused("identify modes --run-ups --trace rings.csv", 3, {"the speed rises or falls nowhere"},
          __LINE__);
  refused("identify modes --run-ups --trace rings2.csv", 3, {"angle of the spindle"}, __LINE__);
  refused("identify modes --run-ups --frf x.csv", 2, {"--run-ups", "--trace"}, __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("modes_command", [] {
    found();
    written();
    said();
    refusals();
    without_a_hammer();
    from_run_ups();
  });
}
