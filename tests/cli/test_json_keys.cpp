// What --json prints is what docs/json.md says: every key of every command has its line there, and
// every line there is a key that was printed, unless the line says when it comes ("when ...").
#include <algorithm>
#include <cmath>
#include <map>
#include <regex>
#include <set>
#include <string>

#include "check.hpp"
#include "cli/hammer_trace.hpp"
#include "cli/pushed_drive.hpp"
#include "program.hpp"
#include "ringing_trace.hpp"
#include "run_up_trace.hpp"
#include "tetrahedron.hpp"

namespace {

using namespace program_test;

struct Line {
  bool conditional = false;  // says when it comes
  bool printed = false;
};
using Page = std::map<std::string, std::map<std::string, Line>>;  // command, key

Page read_page() {
  Page page;
  std::string command;
  const std::regex key(R"(`([^`]+)`)");
  for (const std::string& row : lines(content("docs/json.md"))) {
    if (row.starts_with("## ")) command = row.substr(3);
    if (!row.starts_with("| `")) continue;
    const std::size_t meaning = row.find(" | ", 2);
    const std::string keys = row.substr(0, meaning);
    const bool conditional = contains(row.substr(meaning), "when ");
    for (std::sregex_iterator at(keys.begin(), keys.end(), key), end; at != end; ++at)
      page[command][(*at)[1].str()].conditional = conditional;
  }
  return page;
}

/// "events.0.state" is "events[].state" on the page.
std::string on_page(const std::string& path) {
  std::string out = std::regex_replace(path, std::regex(R"(\.[0-9]+(?=\.|$))"), "[]");
  return out;
}

/// A line that ends in ".*" stands for keys that are names.
Line* find(std::map<std::string, Line>& documented, const std::string& key) {
  if (const auto at = documented.find(key); at != documented.end()) return &at->second;
  for (auto& [line, state] : documented)
    if (line.ends_with(".*") && key.starts_with(line.substr(0, line.size() - 1))) return &state;
  return nullptr;
}

void compare(Page& page, const std::string& command, const std::string& arguments) {
  const Outcome o = run(command + " " + arguments + " --json --quiet");
  that(o.status == 0, o, "works", __LINE__);
  const Json json(o.out);
  that(json.ok && json.object, o, "prints one object", __LINE__);
  auto& documented = page[command];
  const auto seen = [&](const std::string& path) {
    const std::string key = on_page(path);
    Line* const line = find(documented, key);
    if (line != nullptr) line->printed = true;
    return line != nullptr;
  };
  for (const auto& [path, value] : json.scalars)
    that(seen(path), o, "docs/json.md has `" + on_page(path) + "`", __LINE__);
  // An empty list or object shows no key of its own.
  for (const auto& [path, size] : json.sizes) {
    if (size > 0 || path.empty()) continue;
    const std::string key = on_page(path);
    const bool known = std::any_of(documented.begin(), documented.end(),
                                   [&](const auto& line) { return line.first.starts_with(key); });
    that(known, o, "docs/json.md has `" + key + "`", __LINE__);
  }
}

const char* const kThresholds =
    "\n[monitor.chatter]\nchatter_threshold_Nm2 = 0.01\n"
    "[monitor.collision]\nthreshold_x_N_per_s = 1e6\ncutting_torque_Nm = 0.05\n";

void tests() {
  const fs::path source = fs::current_path();
  put("cut.ini", content("examples/machines/koike_cut.ini"));
  put("watched.ini", content("examples/machines/koike_cut.ini") + kThresholds);
  std::string moves = "x limits 0.5 3 100\nx start 0\nspindle limits 900 2000 1e6\n";
  for (int lap = 0; lap < 3; ++lap)
    moves +=
        "x move 0.3 0.3\nx dwell 0.2\nx move 0 0.1\nx dwell 0.2\nx move 0.2 0.02\nx move 0 0.2\n"
        "spindle cruise 300 1\nspindle cruise 800 1\nspindle cruise 100 1\n";
  put("moves.txt", moves);

  Page page = read_page();
  put("part.ngc", "T1 M6\nG0 X1 Y2 Z3\nG1 X5 F100\nM2\n");
  compare(page, "program motion", "part.ngc --out part.csv");
  put("tool.ini", "[tool]\ndiameter_m = 0.002\nstick_out_m = 0.001\nholder_diameter_m = 0.01\n");
  put("deep.ngc", "T1 M6\nG0 Z9\nG0 X1 Y1\nG0 Z-2\nM2\n");
  compare(page, "program predict",
          "deep.ngc --machine tool.ini --stock box:0,0,-0.01,0.01,0.01,0 --out deep.csv");
  put("bound.ini",
      "[tool]\ndiameter_m = 0.002\nteeth = 2\nstick_out_m = 0.001\nholder_diameter_m = 0.01\n"
      "tangential_coefficient_N_per_m2 = 8e8\nradial_ratio = 0.3\n[tool.2]\ndiameter_m = 0.002\n"
      "[limits]\nfeed_per_tooth_m = 1e-4\n[structure.x]\nmodes = 600 0.03 12\n[structure.y]\nmodes "
      "= 700 0.03 12\n");
  put("slow.ngc",
      "T1 M6\nS900 M3\nG0 Z9\nG0 X-2 Y5\nG0 Z-2\nG1 X5 F100\nG1 Y9\nT2 M6\nS900 M3\nG1 X8 "
      "F100\nM2\n");
  for (const char* command : {"program predict", "program optimise"})
    compare(page, command,
            "slow.ngc --machine bound.ini --stock box:0,0,-0.01,0.01,0.01,0 --out slow.out");
  put("quick.ini",
      "[tool]\ndiameter_m = 0.002\nteeth = 2\ncutting_speed_m_s = 0.05 0.2\n"
      "tangential_coefficient_N_per_m2 = 8e8\nradial_ratio = 0.3\n"
      "[limits]\nfeed_per_tooth_m = 1e-5\n[structure.x]\nmodes = 600 0.03 12\n[structure.y]\n"
      "modes = 700 0.03 12\n");
  put("fixed.ngc", "S900 M3\nG0 Z9\nG0 X-2 Y5\nG0 Z-2\nG1 X5 F10\n#1=900\nS#1\nG1 Y9\nG0 Z9\nM2\n");
  compare(page, "program optimise",
          "fixed.ngc --machine quick.ini --stock box:0,0,-0.01,0.01,0.01,0 --out slow.out");
  put("torques.csv",
      "removed_m2,contact_m2,feed_per_tooth_m,spindle.torque_Nm\n1e-5,4e-5,4e-5,1.1\n1e-5,4e-5,"
      "9e-5,1.9\n5e-5,9e-5,4e-5,4.1\n5e-5,9e-5,9e-5,9\n");
  compare(page, "identify torque-equation", "--machine bound.ini torques.csv");
  put("corner.stl", tetrahedron::kStl);
  put("there.ngc",
      "T1 M6\nS900 M3\nG0 Z9\nG0 X-2 Y0\nG0 Z-2\nG1 X5 F100\nG1 Y0.5\nG1 X-2\nG0 Z9\nM2\n");
  compare(page, "program check",
          "there.ngc --machine tool.ini --stock box:0,0,-0.01,0.01,0.01,0 --target corner.stl");
  compare(page, "simulate drive", "--machine cut.ini --motion moves.txt --out idle.csv");
  compare(page, "simulate milling", "--machine cut.ini --out milling.csv");
  compare(page, "simulate milling", "--machine watched.ini --out alone.csv --duration 0.3");
  compare(page, "identify idle", "--machine cut.ini --trace idle.csv --out learned.ini");
  // The same with a microphone that hears a fan.
  std::string with_sound;
  for (const std::string& row : lines(content(folder / "idle.csv"))) {
    with_sound += row;
    if (!row.starts_with("#"))
      with_sound += row.starts_with("t_s")
                        ? ",microphone.sound_Pa"
                        : "," + std::to_string(std::sin(4882 * std::strtod(row.c_str(), nullptr)));
    with_sound += '\n';
  }
  put("sound.csv", with_sound);
  compare(page, "identify idle", "--machine cut.ini --trace sound.csv --out heard.ini");
  // Every eighth row: a slow record, in which lines are learned.
  put("slow_moves.txt", moves + "spindle cruise 400 3\n");
  run("simulate drive --machine cut.ini --motion slow_moves.txt --out long.csv");
  std::string slow, slow_machine = content(source / "examples/machines/koike_cut.ini");
  std::size_t row = 0;
  for (const std::string& line : lines(content(folder / "long.csv")))
    if (line.starts_with("#") || line.starts_with("t_s") || row++ % 8 == 0) slow += line + "\n";
  put("slow.csv", slow);
  slow_machine.replace(slow_machine.find("sample_rate_hz = 8000"), 21, "sample_rate_hz = 1000");
  put("slow.ini", slow_machine);
  compare(page, "identify idle", "--machine slow.ini --trace slow.csv --out slow_learned.ini");
  compare(page, "monitor", "--machine learned.ini --trace milling.csv --events events.jsonl");
  compare(page, "monitor", "--machine watched.ini --trace milling.csv");  // chatter is heard
  put("pushed.csv", pushed::trace());
  put("pushed.ini", std::string(pushed::kMachine) + "coulomb_friction_Nm = 0.014\n");
  compare(page, "identify presliding", "--machine pushed.ini --trace pushed.csv --out slow.ini");
  compare(page, "monitor", "--machine learned.ini --trace idle.csv");  // accelerates
  compare(page, "identify collision", "--machine learned.ini --out taught.ini milling.csv");
  compare(page, "identify torque-band", "--machine learned.ini --out band.csv milling.csv");
  put("steps.csv", "line,t_s,spindle.torque_Nm,low_Nm,high_Nm\n1,9,1,-1e6,1e6\n2,99,1,-1e6,1e6\n");
  compare(page, "identify torque-tolerance",
          "--machine learned.ini --prediction steps.csv milling.csv");
  std::string cuts = "t_s,spindle.speed_rad_s,spindle.torque_Nm,tool.feed_per_tooth_m\n";
  for (int n = 0; n < 5000; ++n) {
    const int feed = n / 1000 % 2 * (n < 2000 ? 2 : 1);  // air, cut, air, at half the feed, air
    cuts += std::to_string(n * 1e-3) + ",500," + std::to_string(0.01 * (n % 3) + feed) + "," +
            std::to_string(5e-5 * feed) + "\n";
  }
  put("cuts.csv", cuts);
  put("cutter.ini",
      "[spindle]\n[tool]\ndiameter_m = 0.02\nteeth = 2\n[cut]\naxial_depth_m = 0.005\n"
      "direction = slot\n");
  compare(page, "identify cutting", "--machine cutter.ini --out known.ini cuts.csv");
  std::string loads = "t_s,spindle.speed_rad_s,spindle.load_V,tool.torque_Nm\n";
  for (int n = 0; n < 4000; ++n) {
    const double w = n < 2000 ? 300 : 600, torque = n / 1000 % 2 * 3 + 0.001 * (n % 3);
    loads += std::to_string(n * 0.005) + "," + std::to_string(w) + "," +
             std::to_string(4e-4 * w * (torque + 4e-4 * w)) + "," + std::to_string(torque) + "\n";
  }
  put("loads.csv", loads);
  compare(page, "identify load-meter", "--machine cutter.ini --out meter.ini loads.csv");
  std::string tip = "frequency_hz,receptance_re_m_per_N,receptance_im_m_per_N\n";
  for (int f = 100; f < 1000; ++f) {  // f / 500, damping 0.03
    const double r = f / 500., re = 1 - r * r, im = -0.06 * r, d = 1e7 * (re * re + im * im);
    char line_of_tip[90];
    std::snprintf(line_of_tip, sizeof line_of_tip, "%d,%.6e,%.6e\n", f,
                  re / d + 1e-9 * (f * 7919 % 13), im / d);
    tip += line_of_tip;
  }
  put("tip.csv", tip);
  compare(page, "identify modes", "--frf tip.csv --out modes.ini");
  put("rings.csv", ringing_test::trace());
  compare(page, "identify modes --trace", "rings.csv");
  put("run_up.csv", run_up_test::trace());
  compare(page, "identify modes --run-ups --trace", "run_up.csv");
  // One speed, so that windows are alike.
  std::string even = content(source / "examples/machines/koike_cut.ini");
  even.replace(even.find("spindle_speed_profile"), 1, "# s");
  put("even.ini", even + "\n[monitor.reference]\nreference = sound.txt\n");
  compare(page, "simulate milling", "--machine even.ini --out even.csv --duration 1.5");
  compare(page, "identify reference", "--machine even.ini --out sound.txt even.csv");
  compare(page, "monitor", "--machine even.ini --trace even.csv");
  std::string noise = "t_s,dyno.torque_Nm,spindle.current_A\n";
  unsigned random = 1;
  for (int i = 0; i < 4000; ++i) {
    random = random * 1664525 + 1013904223;
    const std::string x = std::to_string(random >> 16);
    noise += std::to_string(i) + "e-3," + x + ",-" + x + "\n";
  }
  put("noise.csv", noise);
  compare(page, "identify transfer",
          "--trace noise.csv --input dyno.torque_Nm --output spindle.current_A");
  put("hit.csv", hammer_test::trace({{0.01, 300, 0.0006}}));
  compare(page, "identify impact", "--out hit.frf --offset-m 0.01 --stick-out-m 0.05 hit.csv");
  put("dyno.ini", "[dynamometer.x]\nmodes = 930 0.03 0.9\n");
  std::string dyno = "t_s,spindle.speed_rad_s,dyno.force_x_N,dyno.force_y_N\n";
  for (int i = 0; i < 3000; ++i) dyno += std::to_string(i * 1e-4) + ",600,5,4\n";
  put("dyno.csv", dyno);
  std::string frf = "frequency_hz,gain,phase_rad\n";
  for (int hz = 10; hz < 900; hz += 10)
    frf += std::to_string(hz) + "," + std::to_string(0.9 / (1 - hz * hz / 1e6)) + ",0\n";
  put("frf.csv", frf);
  compare(page, "identify dynamometer",
          "--machine dyno.ini --frf frf.csv --direction x --modes 1 --out found.ini");
  compare(page, "compensate dynamometer", "--machine dyno.ini --trace dyno.csv --out applied.csv");
  compare(page, "study encoder", "--machine cut.ini");
  compare(page, "study cutoff", "");
  compare(page, "study order", "");
  std::string laps = "x limits 0.5 3 100\nx start 0\n";
  for (int lap = 0; lap < 6; ++lap) laps += "x move 0.1 0.2\nx move 0 0.2\n";
  put("laps.txt", laps);
  compare(page, "simulate drive", "--machine cut.ini --motion laps.txt --out laps.csv");
  compare(page, "study warm-up", "--machine cut.ini --trace laps.csv --parts 6");
  compare(page, "report", "--out report.html events.jsonl");
  compare(page, "lobes", "--machine cut.ini");
  compare(page, "recommend", "--machine cut.ini");
  compare(page, "pockets", "--machine cut.ini --trace milling.csv");
  compare(page, "init",
          "--out new.ini --class small-mill --set axis.x.lead_m=16mm --set axis.x.table_mass=55kg "
          "--set 'axis.x.motor_inertia=10 kg cm2'");
  put("lathe.csv", content("tests/data/import/lathe.csv"));
  compare(page, "import", "lathe.csv --out lathe.trace");
  compare(page, "export", "--c learned.ini --out machine.h");
  compare(page, "reconcile", "--machine cut.ini --trace idle.csv --out found");

  for (const auto& [command, documented] : page)
    for (const auto& [key, line] : documented)
      if (!line.conditional)
        check::that(line.printed, ("servosense " + command + " prints `" + key + "`").c_str(),
                    __FILE__, __LINE__);
}

}  // namespace

int main() { return program_test::in_own_folder("json_keys", tests); }
