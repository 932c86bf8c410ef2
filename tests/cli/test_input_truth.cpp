// Every column of motion and effort is used or named; units that cannot be are refused; a trace at
// another rate than the machine file states is refused with the remedy.
#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

constexpr double kRate_hz = 2000;
constexpr double kLead_m = 0.01;

struct Column {
  std::string name;
  std::function<double(double)> at;  ///< of the time [s]
};

// The machine: spindle at 3000 rpm after a run-up of half a second, x to and fro over 200 mm.
double spindle_rad(double t) {
  const double full = 3000 * 2 * M_PI / 60;
  return t < 0.5 ? full * t * t : full * (t - 0.25);
}
double spindle_rad_s(double t) { return 3000 * 2 * M_PI / 60 * std::min(1.0, 2 * t); }
double x_m(double t) { return 0.1 * std::sin(2 * t); }
double x_m_s(double t) { return 0.2 * std::cos(2 * t); }
double wrapped(double angle) { return angle - 2 * M_PI * std::floor(angle / (2 * M_PI)); }

std::function<double(double)> noise(double sigma) {
  auto random = std::make_shared<std::mt19937>(5);
  return [random, sigma](double) { return std::normal_distribution<double>(0, sigma)(*random); };
}

void record(const std::string& name, const std::vector<Column>& columns, double time_unit = 1,
            double rate_hz = kRate_hz) {
  std::string text = "t_s";
  for (const Column& c : columns) text += "," + c.name;
  text += "\n";
  for (int n = 0; n < 3 * rate_hz; ++n) {
    const double t = n / rate_hz;
    char part[64];
    std::snprintf(part, sizeof part, "%.9g", t * time_unit);
    text += part;
    for (const Column& c : columns) {
      std::snprintf(part, sizeof part, ",%.12g", c.at(t));
      text += part;
    }
    text += "\n";
  }
  put(name, text);
}

const std::string kMachine =
    "[machine]\nname = bed\n\n[spindle]\ninertia_kg_m2 = 0.001\n\n"
    "[axis.x]\nlead_m = 0.01\nequivalent_mass_kg = 100\n\n"
    "[monitor.chatter]\nchatter_threshold_Nm2 = 1\n\n[monitor.collision]\nthreshold_N_per_s = "
    "1e6\n";
const std::string kStated = "[machine]\nname = bed\nsample_rate_hz = 2000\n" + kMachine.substr(21);

// Whatever tells the motion of a drive makes it watchable.
void every_motion() {
  const Column torque{"spindle.torque_Nm", noise(0.01)}, force{"x.force_N", noise(10)};
  const Column still{"spindle.angle_rad", spindle_rad};
  for (const Column& spindle :
       {still, Column{"spindle.speed_rad_s", spindle_rad_s},
        // Begun anew with every turn.
        Column{"spindle.angle_rad", [](double t) { return wrapped(spindle_rad(t)); }},
        Column{"spindle.angle_rad", [](double t) { return wrapped(spindle_rad(t)) - M_PI; }}})
    for (const Column& x :
         {Column{"x.position_m", x_m}, Column{"x.velocity_m_s", x_m_s},
          Column{"x.angle_rad", [](double t) { return 2 * M_PI / kLead_m * x_m(t); }},
          Column{"x.angle_rad", [](double t) { return wrapped(2 * M_PI / kLead_m * x_m(t)); }},
          Column{"x.speed_rad_s", [](double t) { return 2 * M_PI / kLead_m * x_m_s(t); }}}) {
      put("m.ini", kStated);
      record("t.csv", {spindle, torque, x, force});
      const Outcome o = run("monitor --json --quiet --machine m.ini --trace t.csv");
      const Json json(o.out);
      that(json.text("verdict") == "clear", o,
           spindle.name + " with " + x.name + ": " + json.text("verdict_sentence"), __LINE__);
      that(!contains(o.out, "not used") && !contains(o.out, "not watched:"), o,
           "nothing is left over", __LINE__);
    }
}

// What is not used is named, with what would make use of it.
void unused_columns() {
  const Column angle{"spindle.angle_rad", spindle_rad}, torque{"spindle.torque_Nm", noise(0.01)};
  const Column x{"x.position_m", x_m}, force{"x.force_N", noise(10)};
  struct Case {
    std::vector<Column> columns;
    std::string machine;
    std::vector<std::string> says;
  };
  const std::vector<Case> cases = {
      {{angle, {"spindle.load_percent", noise(1)}, x, force},
       kStated,
       {"effort_column = spindle.load_percent in [spindle]", "spindle.angle_rad"}},
      {{angle, torque, {"x.angle_rad", x_m}, force},
       "[machine]\nname = bed\n[spindle]\ninertia_kg_m2 = 0.001\n[axis.x]\n"
       "equivalent_mass_kg = 100\n",
       {"x.angle_rad needs lead_m in [axis.x]"}},
      {{angle, torque, x}, kStated, {"x.position_m but no current, torque or force"}},
      {{angle, torque, force}, kStated, {"it has x.force_N but no motion"}},
      {{angle,
        torque,
        x,
        force,
        {"spindle.load_V", noise(1)},
        {"spindle2.current_A", noise(1)},
        {"y.torque_percent", noise(1)},
        {"z.current_percent", noise(1)},
        {"tool.force_x_N", noise(1)},
        {"dyno.force_z_N", noise(1)}},
       kStated,
       {"not used by this command: spindle.load_V, spindle2.current_A, y.torque_percent, "
        "z.current_percent, tool.force_x_N, dyno.force_z_N"}},
  };
  for (const Case& c : cases) {
    put("m.ini", c.machine);
    record("t.csv", c.columns);
    const Outcome o = run("monitor --machine m.ini --trace t.csv");
    that(o.status == 0, o, "runs", __LINE__);
    const Json json(run("monitor --json --quiet --machine m.ini --trace t.csv").out);
    for (const std::string& part : c.says) {
      that(contains(o.err, part), o, "says " + part, __LINE__);
      bool remarked = false;
      for (const auto& [path, text] : json.scalars)
        remarked = remarked || (path.starts_with("remarks.") && contains(text, part));
      that(remarked, o, "JSON says " + part, __LINE__);
    }
  }
}

// Commands that move a simulated drive say it, too.
void simulated() {
  put("m.ini", kStated +
                   "[controller.x]\nposition_gain_per_s = 50\nvelocity_gain_A_s_per_m = 10\n"
                   "velocity_integral_per_s = 20\ncurrent_limit_A = 100\n");
  record("t.csv", {{"x.command_position_m", x_m},
                   {"y.angle_rad", x_m},
                   {"spindle.angle_counts", [](double) { return 1.0; }}});
  const Outcome o = run("simulate drive --machine m.ini --motion t.csv --out s.csv");
  that(contains(o.err, "not used by this command: y.angle_rad, spindle.angle_counts"), o,
       "names what is left over", __LINE__);
}

void impossible_units() {
  const Column torque{"spindle.torque_Nm", noise(0.01)}, force{"x.force_N", noise(10)};
  const Column angle{"spindle.angle_rad", spindle_rad}, x{"x.position_m", x_m};
  const auto times = [](double factor, double (*of)(double)) {
    return [factor, of](double t) { return factor * of(t); };
  };
  struct Case {
    const char* name;
    std::vector<Column> columns;
    double time_unit;
    std::vector<std::string> says;  // empty: nothing is wrong
  };
  const double deg = 180 / M_PI;
  const std::vector<Case> cases = {
      {"as it should be", {angle, torque, x, force}, 1, {}},
      {"ms", {angle, torque, x, force}, 1e3, {"t_s looks like ms", "convert"}},
      {"us", {angle, torque, x, force}, 1e6, {"t_s looks like us"}},
      {"mm",
       {angle, torque, {"x.position_m", times(1e3, x_m)}, force},
       1,
       {"x.position_m looks like mm"}},
      {"slow, mm", {angle, torque, {"x.position_m", times(10, x_m)}, force}, 1, {}},
      {"mm/min",
       {angle, torque, {"x.velocity_m_s", times(6e4, x_m_s)}, force},
       1,
       {"x.velocity_m_s looks like mm/s or mm/min"}},
      {"degrees",
       {{"spindle.angle_rad", times(deg, spindle_rad)}, torque, x, force},
       1,
       {"spindle.angle_rad looks like degrees"}},
      {"rpm",
       {{"spindle.speed_rad_s", [](double t) { return 2.57 * 3000 * std::min(1.0, t); }},
        torque,
        x,
        force},
       1,
       {"spindle.speed_rad_s looks like rpm", "max_speed_rpm in [spindle]"}},
      {"mA", {angle, torque, x, {"x.current_A", noise(20000)}}, 1, {"x.current_A goes to"}},
      {"mN", {angle, torque, x, {"x.force_N", noise(1e6)}}, 1, {"x.force_N goes to"}},
      // All at once: everything is said that the first rows show.
      {"ms and mm",
       {{"spindle.speed_rad_s", [](double) { return 7700.0; }},
        torque,
        {"x.position_m", times(1e3, x_m)},
        force},
       1e3,
       {"t_s looks like ms", "spindle.speed_rad_s looks like rpm", "x.position_m looks like mm"}},
  };
  for (const Case& c : cases)
    for (const std::string& machine : {kMachine, kStated}) {
      put("m.ini", machine);
      record("t.csv", c.columns, c.time_unit);
      if (c.says.empty()) {
        const Outcome o = run("monitor --quiet --machine m.ini --trace t.csv");
        that(o.status == 0, o, std::string(c.name) + " runs", __LINE__);
        continue;
      }
      refused("monitor --quiet --machine m.ini --trace t.csv", 3, c.says, __LINE__);
      refused("identify idle --quiet --machine m.ini --trace t.csv --out o.ini", 3, c.says,
              __LINE__);
      refused("identify torque-band --quiet --machine m.ini --out o.csv t.csv", 3, c.says,
              __LINE__);
    }
  // Desk commands that read the whole trace.
  put("m.ini", kStated);
  record("t.csv", {{"spindle.speed_rad_s", [](double) { return 7700.0; }},
                   torque,
                   {"x.position_m", times(1e3, x_m)},
                   force});
  put("m.ini", kStated + "[tool]\nteeth = 2\n");
  refused("pockets --quiet --machine m.ini --trace t.csv", 3, {"looks like rpm"}, __LINE__);
  const Outcome o = run("reconcile --quiet --machine m.ini --trace t.csv --out r");
  that(o.status == 3 && contains(o.err, "x.position_m looks like mm"), o, "refuses mm", __LINE__);
  // A clock in ms on a file for another rate: both are said.
  std::string other = kStated;
  other.replace(other.find("2000"), 4, "8000");
  put("other.ini", other);
  record("t.csv", {angle, torque, {"x.position_m", times(1e3, x_m)}, force}, 2e3);
  refused(
      "monitor --quiet --machine other.ini --trace t.csv", 3,
      {"t_s looks like ms", "in s it would have 1000 Hz, not sample_rate_hz = 8000 of other.ini",
       "x.position_m looks like mm"},
      __LINE__);
  // A machine that does turn so fast says so.
  put("fast.ini", kStated + "[axis.y]\nlead_m = 0.01\n");
  std::string fast = kStated;
  fast.insert(fast.find("inertia"), "max_speed_rpm = 100000\n");
  put("fast.ini", fast);
  record("t.csv", {{"spindle.speed_rad_s", [](double) { return 7700.0; }}, torque, x, force});
  const Outcome high = run("monitor --quiet --machine fast.ini --trace t.csv");
  that(high.status == 0, high, "a fast spindle is believed", __LINE__);
}

void rates() {
  const std::vector<Column> all = {{"spindle.angle_rad", spindle_rad},
                                   {"spindle.torque_Nm", noise(0.01)},
                                   {"x.position_m", x_m},
                                   {"x.force_N", noise(10)}};
  put("m.ini", kStated);
  for (const double rate_hz : {1000.0, 1940.0, 2060.0, 8000.0}) {
    record("t.csv", all, 1, rate_hz);
    refused("monitor --quiet --machine m.ini --trace t.csv", 3,
            {"sample_rate_hz = 2000 in m.ini", "identify idle"}, __LINE__);
  }
  for (const double rate_hz : {1970.0, 2000.0, 2030.0}) {
    record("t.csv", all, 1, rate_hz);
    const Outcome o = run("monitor --quiet --machine m.ini --trace t.csv");
    that(o.status == 0, o, "two clocks", __LINE__);
  }
  // Times rounded so far that the median step is none that ever was: 3 kHz to 0.1 ms.
  std::string text = "t_s,x.position_m,x.force_N\n";
  for (int n = 0; n < 6000; ++n) {
    char line[80];
    std::snprintf(line, sizeof line, "%.4f,%.9g,%d\n", n / 3000.0, x_m(n / 3000.0), n * 7919 % 13);
    text += line;
  }
  put("t.csv", text);
  std::string machine = kStated;
  machine.replace(machine.find("2000"), 4, "3000");
  put("m.ini", machine);
  const Json json(run("monitor --quiet --json --machine m.ini --trace t.csv").out);
  CHECK_NEAR(json.number("sample_rate_hz"), 3000, 30);
}

}  // namespace

int main() {
  return in_own_folder("input_truth", [] {
    every_motion();
    unused_columns();
    simulated();
    impossible_units();
    rates();
  });
}
