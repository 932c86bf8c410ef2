// servosense compensate dynamometer: a dynamometer of the test's own (oracles/dynamometer.hpp) at
// two speeds, the angle by counts, angle, speed and not at all; every refusal in one sentence.
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "oracles/dynamometer.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

constexpr double kTurn = 6.283185307179586;
constexpr double kRate_hz = 20000;
const std::string kMachine =
    "[spindle]\nencoder_counts_per_rev = 4096\n[tool]\nteeth = 4\ndiameter_m = 0.016\n"
    "[dynamometer.x]\nmodes = 930 0.03 0.9\n[dynamometer.y]\nmodes = 1200 0.05 0.8\n";

enum class Told { angle, counts, speed, nothing };

/// What the two directions apply, [N].
struct Applied {
  std::vector<double> x, y;
};

/// A cut with `dyno.force_x_N` and `_y_N`; counts come every fourth row.
Applied write_cut(const std::string& name, double rpm, double seconds, Told told,
                  const std::string& above = "") {
  oracle::HelicalCut cut;
  cut.throw_m = {4e-6, -3e-6, 1e-6, -5e-6};
  const oracle::ForceOverTurn force(cut);
  oracle::SwingingDynamometer x({{930, 0.03, 0.9}}), y({{1200, 0.05, 0.8}});
  const double w = rpm * kTurn / 60;
  std::string text = above + "t_s,dyno.force_x_N,dyno.force_y_N";
  text += told == Told::angle    ? ",spindle.angle_rad\n"
          : told == Told::counts ? ",spindle.angle_counts\n"
          : told == Told::speed  ? ",spindle.speed_rad_s\n"
                                 : "\n";
  Applied applied;
  char field[64];
  const auto count = static_cast<int>(seconds * kRate_hz);
  for (int i = 1; i <= count; ++i) {
    const double t = i / kRate_hz;
    const auto along_x = [&](double at) { return force.at(w * at); };
    const auto along_y = [&](double at) { return 0.7 * force.at(w * at + 1.3); };
    const double fx = x.advance(t - 1 / kRate_hz, 1 / kRate_hz, along_x, 4);
    const double fy = y.advance(t - 1 / kRate_hz, 1 / kRate_hz, along_y, 4);
    applied.x.push_back(along_x(t));
    applied.y.push_back(along_y(t));
    std::snprintf(field, sizeof field, "%.9g,%.7g,%.7g", t, fx, fy);
    text += field;
    if (told == Told::angle) {
      std::snprintf(field, sizeof field, ",%.9g", std::fmod(w * t, kTurn));
      text += field;
    } else if (told == Told::counts) {
      text += i % 4 == 0 ? "," + std::to_string(std::llround(w * t / kTurn * 4096)) : ",";
    } else if (told == Told::speed) {
      std::snprintf(field, sizeof field, ",%.9g", w);
      text += field;
    }
    text += '\n';
  }
  put(name, text);
  return applied;
}

/// Column `at` of a table.
std::vector<double> column(const std::string& name, std::size_t at) {
  std::vector<double> values;
  for (const std::string& line : lines(content(folder / name))) {
    if (line.empty() || line[0] == '#' || line[0] == 't') continue;
    std::size_t from = 0;
    for (std::size_t i = 0; i < at; ++i) from = line.find(',', from) + 1;
    values.push_back(std::strtod(line.c_str() + from, nullptr));
  }
  return values;
}

/// Of the last quarter, over the change of what is applied.
double error_of(const std::vector<double>& found, const std::vector<double>& applied) {
  if (found.size() != applied.size()) return 1e9;
  double mean = 0, error = 0, change = 0;
  const std::size_t from = found.size() * 3 / 4;
  for (std::size_t i = from; i < found.size(); ++i)
    mean += applied[i] / static_cast<double>(found.size() - from);
  for (std::size_t i = from; i < found.size(); ++i) {
    error += (found[i] - applied[i]) * (found[i] - applied[i]);
    change += (applied[i] - mean) * (applied[i] - mean);
  }
  return std::sqrt(error / change);
}

void compensated_by_every_column() {
  put("m.ini", kMachine);
  for (const auto& [told, words] :
       {std::pair{Told::angle, "angle"}, std::pair{Told::counts, "counts"},
        std::pair{Told::speed, "speed"}, std::pair{Told::nothing, "[cut]"}}) {
    const Applied applied = write_cut("c.csv", 13950, 0.6, told);
    put("m.ini", kMachine + "[cut]\nspindle_speed_rpm = 13950\n");
    const Outcome o =
        run("compensate dynamometer --machine m.ini --trace c.csv --out d.csv --json --quiet");
    that(o.status == 0, o, "works", __LINE__);
    const Json json(o.out);
    that(json.ok && json.object, o, "prints one object", __LINE__);
    const double raw = error_of(column("c.csv", 1), applied.x);
    const double x = error_of(column("d.csv", 1), applied.x);
    const double y = error_of(column("d.csv", 2), applied.y);
    std::printf("13 950 rpm by %-6s: waveform error x %.3f (measured %.3f), y %.3f\n", words, x,
                raw, y);
    CHECK(raw > 3);
    CHECK_BETWEEN(x, 0, 0.25);  // harmonics beyond the twelfth
    CHECK_BETWEEN(y, 0, 0.25);
    CHECK(contains(o.out, "the speed of the spindle is that of [cut]") == (told == Told::nothing));
    CHECK(contains(content(folder / "d.csv"), "# dynamometer: compensated"));
    CHECK(column("d.csv", 0) == column("c.csv", 0));
  }
}

void what_it_says() {
  put("m.ini", kMachine);
  write_cut("c.csv", 13950, 0.6, Told::angle);
  Outcome o = run("compensate dynamometer --machine m.ini --trace c.csv --out d.csv");
  that(o.status == 0 && contains(o.out, "dyno.force_y_N"), o, "prints a table", __LINE__);
  that(contains(o.err, "reports one harmonic by a factor of 0.013 only"), o, "names a weak one",
       __LINE__);
  refused("compensate dynamometer --machine m.ini --trace d.csv --out e.csv", 3,
          {"compensated already"}, __LINE__);

  write_cut("c.csv", 50000, 0.3, Told::angle);
  o = run("compensate dynamometer --machine m.ini --trace c.csv --out d.csv");
  that(o.status == 0 && contains(o.err, "its rate carries 9 harmonics"), o, "names the rate",
       __LINE__);
  write_cut("c.csv", 750, 0.3, Told::angle);
  o = run("compensate dynamometer --machine m.ini --trace c.csv --out d.csv");
  that(o.status == 0 && contains(o.err, "shorter than the 15 turns"), o, "too short", __LINE__);

  write_cut("c.csv", 750, 0.1, Told::nothing);
  refused("compensate dynamometer --machine m.ini --trace c.csv --out d.csv", 3,
          {"no column tells the motion of the spindle"}, __LINE__);
  write_cut("c.csv", 750, 0.1, Told::counts);
  put("m.ini", "[dynamometer.x]\nmodes = 930 0.03 0.9\n");
  refused("compensate dynamometer --machine m.ini --trace c.csv --out d.csv", 3,
          {"encoder_counts_per_rev"}, __LINE__);
  write_cut("c.csv", 750, 0.1, Told::angle);
  o = run("compensate dynamometer --machine m.ini --trace c.csv --out d.csv");
  that(o.status == 0 && contains(o.err, "dyno.force_y_N: the machine file has no modes of it"), o,
       "one direction", __LINE__);
  put("m.ini", "[machine]\nname = a\n");
  refused("compensate dynamometer --machine m.ini --trace c.csv --out d.csv", 3,
          {"give [dynamometer.x] modes"}, __LINE__);
  put("m.ini", "[dynamometer.x]\nmodes = 15000 0.03 0.9\n");
  refused("compensate dynamometer --machine m.ini --trace c.csv --out d.csv", 3,
          {"below half the sample rate"}, __LINE__);
  put("m.ini", "[dynamometer.x]\nmodes = 930 1.5 0.9\n");
  refused("compensate dynamometer --machine m.ini --trace c.csv --out d.csv", 3, {"m.ini:2"},
          __LINE__);
  put("m.ini", kMachine);
  put("c.csv", "t_s,spindle.angle_rad\n0,0\n0.001,0.1\n");
  refused("compensate dynamometer --machine m.ini --trace c.csv --out d.csv", 3,
          {"there is no column dyno.force_x_N"}, __LINE__);
}

/// Hits of a hammer, their transfer function, the modes, and with them the force: all by commands.
void from_the_hammer_on() {
  oracle::SwingingDynamometer x({{930, 0.03, 0.9}});
  std::mt19937 random(91);
  std::normal_distribution<double> noise(0, 0.2);
  std::string text = "t_s,hammer.force_N,dyno.force_x_N\n";
  char row[80];
  const auto pulse = [](double t) {  // five a second, 0.4 ms of half a sine each
    const double at = t - 0.2 * std::floor(t / 0.2) - 0.05;
    return at > 0 && at < 0.4e-3 ? 500 * std::sin(kTurn / 2 * at / 0.4e-3) : 0;
  };
  for (int i = 1; i <= static_cast<int>(6 * kRate_hz); ++i) {
    const double t = i / kRate_hz;
    const double y = x.advance(t - 1 / kRate_hz, 1 / kRate_hz, pulse, 4);
    std::snprintf(row, sizeof row, "%.9g,%.6g,%.6g\n", t, pulse(t), y + noise(random));
    text += row;
  }
  put("hits.csv", text);
  Outcome o =
      run("identify transfer --trace hits.csv --input hammer.force_N --output dyno.force_x_N --out "
          "frf.csv --quiet");
  that(o.status == 0, o, "transfer", __LINE__);
  put("m.ini", "[spindle]\nencoder_counts_per_rev = 4096\n");
  o =
      run("identify dynamometer --machine m.ini --frf frf.csv --direction x --out m2.ini --to 3000 "
          "--json --quiet");
  that(o.status == 0, o, "fits", __LINE__);
  const Json json(o.out);
  std::printf("hammer: %s modes, first %.2f Hz, damping %.4f, share %.3f, misfit %.3f\n",
              std::to_string(json.sizes.at("modes")).c_str(),
              json.number("modes.0.natural_frequency_hz"), json.number("modes.0.damping_ratio"),
              json.number("modes.0.share"), json.number("misfit"));
  CHECK(json.sizes.at("modes") == 1);
  CHECK_NEAR(json.number("modes.0.natural_frequency_hz"), 930, 2);
  CHECK_NEAR(json.number("modes.0.damping_ratio"), 0.03, 0.002);
  CHECK_NEAR(json.number("modes.0.share"), 0.9, 0.02);
  const Applied applied = write_cut("c.csv", 13950, 0.6, Told::angle);
  o = run("compensate dynamometer --machine m2.ini --trace c.csv --out d.csv --quiet");
  that(o.status == 0, o, "compensates", __LINE__);
  const double error = error_of(column("d.csv", 1), applied.x);
  check::figure("waveform error by the modes that the hammer found", error);
  CHECK_BETWEEN(error, 0, 0.3);

  // Of the traces themselves: hits that begin in the record and swing out in it.
  text = "t_s,hammer.force_N,dyno.force_x_N\n";
  // A raised cosine: the corners of half a sine reach beyond half the sample rate.
  const auto blow = [](double t) {
    const double at = t - 0.2 * std::floor(t / 0.2) - 0.05;
    return at > 0 && at < 0.5e-3 ? 250 * (1 - std::cos(kTurn * at / 0.5e-3)) : 0;
  };
  oracle::SwingingDynamometer struck({{930, 0.03, 0.9}});
  for (int i = 1; i <= static_cast<int>(1.2 * kRate_hz); ++i) {
    const double t = i / kRate_hz;
    const double y = struck.advance(t - 1 / kRate_hz, 1 / kRate_hz, blow, 4);
    std::snprintf(row, sizeof row, "%.9g,%.6g,%.6g\n", t, blow(t) + noise(random),
                  y + noise(random));
    text += row;
  }
  put("five.csv", text);
  o = run(
      "identify dynamometer --machine m.ini --direction x --out m3.ini --json --quiet five.csv");
  that(o.status == 0, o, "fits hits", __LINE__);
  const Json hits(o.out);
  const auto within = [&](const char* key, double truth) {
    const double found = hits.number(key);
    const double its_error = hits.number(std::string(key) + "_standard_error");
    std::printf("hits: %s %.5g +- %.2g\n", key, found, its_error);
    // Of a pulse of 0.5 ms, 2e-3 is what lies beyond half the sample rate: samples do not tell it.
    CHECK_NEAR(found, truth, 3 * its_error + 2e-3 * truth);
    CHECK(its_error < 0.05 * truth);
  };
  CHECK(hits.sizes.at("modes") == 1);
  within("modes.0.natural_frequency_hz", 930);
  within("modes.0.damping_ratio", 0.03);
  within("modes.0.share", 0.9);
  refused("identify dynamometer --machine m.ini --direction y --out m3.ini five.csv", 3,
          {"five.csv: there is no column dyno.force_y_N", "beside hammer.force_N"}, __LINE__);
  refused("identify dynamometer --machine m.ini --direction x --out m3.ini", 2,
          {"give either traces"}, __LINE__);
  refused("identify dynamometer --machine m.ini --direction x --frf frf.csv --out m3.ini five.csv",
          2, {"give either traces"}, __LINE__);

  put("flat.csv", "frequency_hz,gain\n1,1\n");
  refused("identify dynamometer --machine m.ini --frf flat.csv --direction x --out m2.ini", 3,
          {"expected columns frequency_hz, gain and phase_rad"}, __LINE__);
  refused("identify dynamometer --machine m.ini --frf frf.csv --direction q --out m2.ini", 2,
          {"expected x, y or z"}, __LINE__);
  refused("identify dynamometer --machine m.ini --frf frf.csv --direction x --to 30 --out m2.ini",
          3, {"frf.csv: fewer than 20 lines"}, __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("compensate_dynamometer", [] {
    compensated_by_every_column();
    what_it_says();
    from_the_hammer_on();
  });
}
