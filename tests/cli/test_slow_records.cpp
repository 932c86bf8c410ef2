// What each rate of a record allows, by the program: every monitor runs with a reach that is said,
// or says which rate it needs; the table is that of docs/slow-records.md. Stamps that jitter or are
// rounded to milliseconds cost neither rate nor estimates. Chatter in a current of 1 kHz is found,
// with the frequencies that it may have, and where the drive's filter hides it, that is said.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <map>
#include <random>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "program.hpp"
#include "servosense/core/units.hpp"

namespace {

using namespace program_test;
using servosense::kTwoPi;

constexpr std::array kRates = {50, 100, 250, 500, 1000, 2000, 4000, 8000};
constexpr std::array kMonitors = {"chatter",        "collision",      "ar-breakage",
                                  "tooth-breakage", "drill-fracture", "wear"};

const char* const kSpindle = R"([spindle]
torque_constant_Nm_per_A = 0.5
inertia_kg_m2 = 0.004
viscous_friction_Nm_s_per_rad = 0.001
coulomb_friction_Nm = 0.1
encoder_counts_per_rev = 65536
)";

void put_machine(int rate) {
  std::string text = "[machine]\nsample_rate_hz = " + std::to_string(rate) + "\n" + kSpindle;
  for (const char* axis : {"x", "y", "z"})
    text += std::string("[axis.") + axis +
            "]\nlead_m = 0.01\nequivalent_mass_kg = 200\ntorque_constant_Nm_per_A = 0.8\n";
  put("machine.ini", text + R"([tool]
teeth = 4
[cut]
spindle_speed_rpm = 3000
[monitor.chatter]
chatter_threshold_Nm2 = 0.02
line_threshold_Nm2 = 0.01
[monitor.collision]
threshold_x_N_per_s = 50000
threshold_y_N_per_s = 50000
threshold_z_N_per_s = 50000
[monitor.ar-breakage]
noise_Nm = 0.01
[monitor.tooth-breakage]
noise_Nm = 0.01
sample_noise_Nm = 0.02
[monitor.drill-fracture]
threshold_N = 100
drilling_thrust_N = 100
[monitor.wear]
cutting_thrust_N = 100
thrust_limit_N = 900
)");
}

enum class Stamps { exact, jitter, milliseconds };

/// 3000 rpm, a steady current, axes that swing; what is measured is the same whatever the stamps.
void put_trace(int rate, double seconds, Stamps stamps) {
  std::mt19937_64 bits(3);
  std::normal_distribution<double> noise;
  std::uniform_real_distribution<double> early(-0.2, 0.2);
  std::ofstream out(folder / "trace.csv");
  out << "t_s,spindle.angle_counts,spindle.current_A";
  for (const char* axis : {"x", "y", "z"})
    out << ',' << axis << ".position_m," << axis << ".current_A";
  out << '\n';
  char text[64];
  for (int i = 0; i < static_cast<int>(seconds * rate); ++i) {
    const double t = static_cast<double>(i) / rate;
    const double stamp = stamps == Stamps::jitter ? t + early(bits) / rate : t;
    std::snprintf(text, sizeof text, stamps == Stamps::milliseconds ? "%.3f" : "%.6f", stamp);
    out << text << ',' << static_cast<long long>(t * 50 * 65536);
    std::snprintf(text, sizeof text, ",%.4f", 2 + 0.05 * noise(bits));
    out << text;
    for (int k = 0; k < 3; ++k) {
      std::snprintf(text, sizeof text, ",%.7f,%.4f", 0.05 * std::sin(1.5 * t + k),
                    1 + 0.05 * noise(bits));
      out << text;
    }
    out << '\n';
  }
}

/// A cell of the table for each monitor, of its first line in the summary.
std::map<std::string, std::string> cells(const Outcome& o) {
  std::map<std::string, std::string> found;
  const std::regex line(R"(^  ([a-z-]+) +on ([a-z0-9]+) +(runs|does not run): (.*)$)");
  const std::regex needs(R"(needs at least ([0-9.e+]+) Hz)");
  for (const std::string& text : lines(o.out)) {
    std::smatch m;
    if (!std::regex_match(text, m, line) || found.count(m[1])) continue;
    if (std::find(kMonitors.begin(), kMonitors.end(), m.str(1)) == kMonitors.end()) continue;
    if (m[3] == "runs") {
      found[m[1]] = "runs";
      continue;
    }
    const std::string reason = m[4];
    std::smatch rate;
    that(std::regex_search(reason, rate, needs), o, "says which rate it needs: " + m.str(1),
         __LINE__);
    found[m[1]] = rate.empty() ? "?" : "needs " + rate.str(1);
  }
  return found;
}

void the_table() {
  std::map<std::string, std::string> row;
  for (const char* monitor : kMonitors) row[monitor] = std::string("| ") + monitor + " |";
  for (const int rate : kRates) {
    put_machine(rate);
    put_trace(rate, 3, Stamps::exact);
    const Outcome o = run("monitor --machine machine.ini --trace trace.csv --quiet");
    that(o.status == 0, o, "runs at this rate", __LINE__);
    auto found = cells(o);
    for (const char* monitor : kMonitors) row[monitor] += " " + found[monitor] + " |";
  }
  std::ifstream in("docs/slow-records.md");
  std::stringstream page;
  page << in.rdbuf();
  for (const char* monitor : kMonitors) {
    std::printf("%s\n", row[monitor].c_str());
    CHECK(contains(page.str(), row[monitor]));
  }
}

struct Estimate {
  double rate = 0, mean = 0;
  std::size_t rows = 0;
};
Estimate estimate_of(int rate, Stamps stamps) {
  put_trace(rate, 4, stamps);
  const Outcome o =
      run("monitor --machine machine.ini --trace trace.csv --quiet --json --estimates e.csv");
  that(o.status == 0, o, "takes the stamps", __LINE__);
  Estimate e;
  std::smatch m;
  if (std::regex_search(o.out, m, std::regex("\"sample_rate_hz\": ([0-9.]+)")))
    e.rate = std::stod(m[1]);
  that(contains(o.out, "\"missing_samples\": 0"), o, "misses nothing", __LINE__);
  for (const std::string& line : lines(content(folder / "e.csv"))) {
    if (line.empty() || line[0] == '#' || line[0] == 't') continue;
    std::istringstream fields(line);
    std::string field;
    std::getline(fields, field, ',');
    std::getline(fields, field, ',');
    if (field.empty() || field == "nan") continue;
    e.mean += std::stod(field);
    ++e.rows;
  }
  e.mean /= static_cast<double>(std::max<std::size_t>(e.rows, 1));
  return e;
}

void stamps() {
  for (const int rate : {50, 64, 128, 400, 1000}) {
    put_machine(rate);
    const Estimate exact = estimate_of(rate, Stamps::exact);
    // 1 A at 0.5 Nm/A and 3000 rpm: 2 A less friction of 0.1 Nm and 0.001 * 314.
    CHECK_NEAR(exact.mean, 1 - 0.1 - 0.314, 0.03);
    for (const Stamps kind : {Stamps::jitter, Stamps::milliseconds}) {
      const Estimate other = estimate_of(rate, kind);
      CHECK_NEAR(other.rate / rate, 1, 0.002);
      CHECK(other.rows == exact.rows);
      CHECK_NEAR(other.mean, exact.mean, 0.01);
    }
  }
}

/// A spindle of 1 kHz whose torque is told behind a first order filter: idle, or a cut of four
/// teeth that chatters.
void put_current(const std::string& name, double seconds, double filter_hz, bool idle,
                 double chatter_Nm, double chatter_hz, unsigned seed) {
  std::mt19937_64 bits(seed);
  std::normal_distribution<double> noise;
  std::ofstream out(folder / name);
  out << "t_s,spindle.angle_counts,spindle.current_A\n";
  constexpr double h = 2e-5, kInertia = 0.004, kConstant = 0.5;
  double angle = 0, w = 0, told = 0, integral = 0;
  char text[80];
  for (long i = 0; static_cast<double>(i) * h < seconds; ++i) {
    const double t = static_cast<double>(i) * h;
    constexpr std::array kSpeeds = {200.0, 600.0, 300.0, -250.0, -500.0, 400.0, 640.0, 350.0};
    const double aim = idle ? kSpeeds[static_cast<std::size_t>(t / 1.5313) % 8] : 377.0;
    double load = 0;
    if (!idle && t > 0.8 && t < seconds - 0.5)
      load = 2 + std::cos(4 * angle) + 0.4 * std::cos(8 * angle) + 0.3 * std::cos(angle) +
             chatter_Nm * std::sin(kTwoPi * chatter_hz * t);
    const double gain = kInertia * kTwoPi * 40;
    const double error = aim - w;
    const double asked = std::clamp(gain * error + integral, -6.0, 6.0);
    if (asked == gain * error + integral) integral += gain * 40 * h * error;
    // The stiffest of controllers: what is cut is answered at once.
    const double motor = asked + load;
    w += h * (asked - 0.001 * w - 0.1 * std::tanh(w / 0.3)) / kInertia;
    angle += h * w;
    told += (motor - told) * -std::expm1(-kTwoPi * filter_hz * h);
    if (i % 50 != 0) continue;
    std::snprintf(text, sizeof text, "%.3f,%lld,%.5f\n", t,
                  static_cast<long long>(std::floor(angle / kTwoPi * 65536)),
                  (told + 0.01 * noise(bits)) / kConstant);
    out << text;
  }
}

void chatter_at_1_khz() {
  put("start.ini",
      "[machine]\nsample_rate_hz = 1000\n[spindle]\ntorque_constant_Nm_per_A = 0.5\n"
      "encoder_counts_per_rev = 65536\n[tool]\nteeth = 4\n");
  put_current("idle.csv", 25, 90, true, 0, 0, 11);
  const Outcome learned =
      run("identify idle --machine start.ini --trace idle.csv --out m.ini --json");
  that(learned.status == 0, learned, "learns", __LINE__);
  std::smatch m;
  const std::string json = learned.out;
  if (std::regex_search(json, m, std::regex("\"current_filter_hz\": \\{\\s*\"value\": ([0-9.]+)")))
    // Soft speed loops do not tell a lag from a moving average: stated is the slower.
    CHECK_BETWEEN(std::stod(m[1]), 0.63 * 90, 1.1 * 90);
  else
    that(false, learned, "finds the drive's filter", __LINE__);
  that(contains(json, "\"line_threshold_Nm2\""), learned, "learns the threshold of a line",
       __LINE__);
  that(contains(content(folder / "m.ini"), "current_filter_hz"), learned, "writes the filter",
       __LINE__);

  // Revolutions are heard as long as their threshold is known, and how to hear lines is said.
  const Outcome turns = run("monitor --machine m.ini --trace idle.csv --json");
  that(contains(turns.out, "with chatter_threshold_Nm2 taken out of [monitor.chatter]"), turns,
       "says how to hear lines", __LINE__);
  put("m.ini", std::regex_replace(content(folder / "m.ini"),
                                  std::regex("chatter_threshold_Nm2 = [^\n]*\n"), ""));
  put_current("sound.csv", 8, 90, false, 0, 0, 12);
  const Outcome sound = run("monitor --machine m.ini --trace sound.csv --json");
  that(sound.status == 0 && contains(sound.out, "\"alarms\": 0"), sound, "no alarm", __LINE__);

  // 730 Hz, of which the filter leaves 0.12.
  put_current("chatter.csv", 8, 90, false, 1.5, 730, 13);
  const Outcome found = run("monitor --machine m.ini --trace chatter.csv --json");
  that(!contains(found.out, "\"alarms\": 0"), found, "alarms", __LINE__);
  that(contains(found.out, "frequency unknown: one of 2") && contains(found.out, ", 73"), found,
       "names the folded frequencies", __LINE__);

  // A filter of 2 Hz hides whatever there is: that is no clear verdict.
  std::string deaf = content(folder / "m.ini");
  deaf =
      std::regex_replace(deaf, std::regex("current_filter_hz = [0-9.]+"), "current_filter_hz = 2");
  deaf = std::regex_replace(deaf, std::regex("teeth = 4"), "teeth = 1");
  put("deaf.ini", deaf);
  put_current("hidden.csv", 8, 2, false, 1.5, 730, 14);
  const Outcome hidden =
      run("monitor --machine deaf.ini --trace hidden.csv --json --fail-on-alarm");
  that(hidden.status == 1 && contains(hidden.out, "cannot see chatter here") &&
           contains(hidden.out, "\"not-watched\""),
       hidden, "says that it sees nothing", __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("slow_records", [] {
    the_table();
    stamps();
    chatter_at_1_khz();
  });
}
