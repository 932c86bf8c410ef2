// servosense identify transfer: a drive of known lag from its trace, its table and its page; an
// observer from force to estimate; every refusal in one sentence.
#include <cmath>
#include <complex>
#include <cstdio>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "program.hpp"
#include "servosense/core/units.hpp"

namespace {

using namespace program_test;
using servosense::kTwoPi;

constexpr double kRate_hz = 1000, kLag_s = 0.008, kGain = 0.05;

/// Torque and current, made line by line: `change` may spoil a line.
void write_cut(const std::string& name, double duration_s, unsigned seed,
               const std::function<std::string(int, double, double)>& line,
               const std::function<double(double, double)>& torque = {}) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::string text = "t_s,dyno.torque_Nm,spindle.current_A\n";
  const double keep = std::exp(-1 / (kRate_hz * kLag_s));
  double y = 0;
  for (int i = 0; i < static_cast<int>(duration_s * kRate_hz); ++i) {
    const double x = torque ? torque(i / kRate_hz, normal(random)) : 10 + 3 * normal(random);
    text += line(i, x, y + 2e-4 * normal(random));
    y = keep * y + (1 - keep) * kGain * x;
  }
  put(name, text);
}

std::string plain(int i, double x, double y) {
  char text[80];
  std::snprintf(text, sizeof text, "%.6f,%.8g,%.8g\n", i / kRate_hz, x, y);
  return text;
}

const std::string kColumns = " --input dyno.torque_Nm --output spindle.current_A";

void known_lag() {
  write_cut("a.csv", 40, 41001, plain);
  write_cut("b.csv", 20, 41002, plain);
  const Outcome o = run("identify transfer --trace a.csv --trace b.csv" + kColumns +
                        " --out h.csv --report h.html --json --quiet");
  that(o.status == 0, o, "works", __LINE__);
  const Json json(o.out);
  that(json.ok && json.object, o, "prints one object", __LINE__);
  const std::size_t n = json.sizes.at("frequency_hz");
  const auto rows = lines(content(folder / "h.csv"));
  CHECK(rows.size() == n + 1);
  CHECK_TEXT(rows[0],
             "frequency_hz,gain,gain_low,gain_high,phase_rad,phase_low,phase_high,coherence");
  CHECK(json.number("usable_to_hz") > 400);
  CHECK_TEXT(json.text("gain_unit"), "A/Nm");
  const double a = std::exp(-1 / (kRate_hz * kLag_s));
  std::size_t coherent = 0;
  for (std::size_t m = 0; m < n; ++m) {
    const auto at = [&](const char* name) {
      return json.number(std::string(name) + "." + std::to_string(m));
    };
    CHECK(std::stod(rows[m + 1]) == at("frequency_hz"));
    if (!(at("coherence") > 0.9)) continue;
    ++coherent;
    const auto back = std::polar(1.0, -kTwoPi * at("frequency_hz") / kRate_hz);
    const auto truth = kGain * (1 - a) * back / (1.0 - a * back);
    CHECK_NEAR(at("gain"), std::abs(truth), 0.01 * std::abs(truth));
    CHECK_NEAR(std::remainder(at("phase_rad") - std::arg(truth), kTwoPi), 0, kTwoPi / 360);
    CHECK(at("gain_low") < at("gain") && at("gain") < at("gain_high"));
    CHECK(at("phase_low") < at("phase_rad") && at("phase_rad") < at("phase_high"));
  }
  CHECK(coherent > 50);
  const std::string page = content(folder / "h.html");
  CHECK(contains(page, "Transfer function from dyno.torque_Nm to spindle.current_A"));
  CHECK(contains(page, "<svg"));
  const Outcome words = run("identify transfer --trace a.csv" + kColumns);
  that(words.status == 0 && contains(words.out, "usable from"), words, "says the band", __LINE__);
}

// Force on an axis to what the observer makes of it: 1 / (1 + s / g)^2 (Koike 2016, eq. 2-22).
void observer() {
  constexpr double kCutoff = 500, kServo_hz = 4000, kForcePerAmpere = 200, kSpeed = 0.02;
  put("axis.ini",
      "[machine]\nname = oracle\nsample_rate_hz = 4000\n[axis.x]\nlead_m = 0.016\n"
      "equivalent_mass_kg = 227\nviscous_friction_N_s_per_m = 732\ncoulomb_friction_N = 94\n"
      "force_constant_N_per_A = 200\n[observer.x]\ndisturbance_cutoff_rad_s = 500\n"
      "velocity_cutoff_rad_s = 500\n");
  std::mt19937_64 random(41003);
  std::normal_distribution<double> normal;
  std::string text = "t_s,x.position_m,x.current_A,tool.force_x_N\n";
  double force = 0;
  for (int i = 0; i < 80000; ++i) {
    force += 0.2 * (300 * normal(random) - force);
    char line[120];
    std::snprintf(line, sizeof line, "%.6f,%.9f,%.8g,%.8g\n", i / kServo_hz, kSpeed * i / kServo_hz,
                  (force + 732 * kSpeed + 94) / kForcePerAmpere, force);
    text += line;
  }
  put("axis.csv", text);
  const Outcome watched =
      run("monitor --machine axis.ini --trace axis.csv --estimates estimates.csv --json");
  that(watched.status == 0, watched, "estimates", __LINE__);
  const Outcome o =
      run("identify transfer --trace axis.csv --estimates estimates.csv --input tool.force_x_N "
          "--output x.force_N --json --quiet");
  that(o.status == 0, o, "works", __LINE__);
  const Json json(o.out);
  CHECK(json.number("usable_to_hz") > 300);
  for (std::size_t m = 0; m < json.sizes.at("frequency_hz"); ++m) {
    const auto at = [&](const char* name) {
      return json.number(std::string(name) + "." + std::to_string(m));
    };
    if (at("frequency_hz") > 200) break;
    // Tustin: the frequency that the filters see.
    const double w = 2 * kServo_hz * std::tan(kTwoPi * at("frequency_hz") / (2 * kServo_hz));
    CHECK_NEAR(at("gain"), 1 / (1 + w * w / kCutoff / kCutoff), 0.01);
    CHECK_NEAR(at("phase_rad"), -2 * std::atan(w / kCutoff), kTwoPi / 360);
  }
  refused(
      "identify transfer --trace axis.csv --trace axis.csv --estimates estimates.csv --input "
      "tool.force_x_N --output x.force_N",
      2, {"one --estimates for each --trace"}, __LINE__);
  refused(
      "identify transfer --trace a.csv --estimates estimates.csv --input dyno.torque_Nm "
      "--output x.force_N",
      3, {"its times are not those of a.csv"}, __LINE__);
}

void refusals() {
  const std::string command = "identify transfer --trace ";
  refused(command + "a.csv --input dyno.torque_Nm --output spindle.torque_Nm", 3,
          {"a.csv", "no column spindle.torque_Nm", "dyno.torque_Nm, spindle.current_A"}, __LINE__);
  refused(command + "a.csv --input dyno.torque_Nm --output dyno.torque_Nm --json", 2,
          {"same column"}, __LINE__);
  refused(command + "a.csv --segment-s 100" + kColumns + " --json", 3,
          {"a.csv", "coherence is 1 whatever it holds"}, __LINE__);
  write_cut(
      "unsigned.csv", 20, 41004, [](int i, double x, double y) { return plain(i, x, std::abs(y)); },
      [](double, double noise) { return 3 * noise; });
  refused(command + "unsigned.csv" + kColumns, 3,
          {"unsigned.csv", "spindle.current_A is an absolute value"}, __LINE__);
  write_cut("teeth.csv", 20, 41005, plain,
            [](double t, double) { return 20 + 5 * std::cos(kTwoPi * 25 * t); });
  refused(command + "teeth.csv" + kColumns, 3, {"dyno.torque_Nm excites a single line, at 25 Hz"},
          __LINE__);
  write_cut("hole.csv", 20, 41006, [](int i, double x, double y) {
    return i > 5000 && i < 5100 ? std::string() : plain(i, x, y);
  });
  refused(command + "hole.csv" + kColumns, 3, {"hole.csv", "missing or late at 5.1 s"}, __LINE__);
  write_cut("nan.csv", 20, 41007,
            [](int i, double x, double y) { return i == 7000 ? "7,nan,1\n" : plain(i, x, y); });
  refused(command + "nan.csv" + kColumns, 3, {"nan.csv", "dyno.torque_Nm is no number at 7 s"},
          __LINE__);
  write_cut("rates.csv", 20, 41008, [](int i, double x, double y) {
    std::string line = plain(i, x, y);
    if (i % 4 != 0) line = line.substr(0, line.rfind(',') + 1) + "\n";
    return line;
  });
  refused(command + "rates.csv" + kColumns, 3,
          {"dyno.torque_Nm has 20000 values and spindle.current_A has 5000", "at one rate"},
          __LINE__);
  write_cut("half.csv", 20, 41009,
            [](int i, double x, double y) { return i % 2 ? std::string() : plain(i, x, y); });
  refused(command + "a.csv --trace half.csv" + kColumns, 3, {"half.csv", "of one rate"}, __LINE__);
  // Both at the same slower rate: those rows are the record.
  write_cut("slow.csv", 20, 41010, [](int i, double x, double y) {
    return i % 2 ? plain(i, 0, 0).substr(0, 8) + ",,\n" : plain(i, x, y);
  });
  const Outcome slow = run(command + "slow.csv" + kColumns + " --json --quiet");
  that(slow.status == 0 && Json(slow.out).number("usable_to_hz") <= 250, slow, "reads the rows",
       __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("transfer", [] {
    known_lag();
    observer();
    refusals();
  });
}
