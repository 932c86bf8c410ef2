// What the program does to files: every command that writes, every file that it writes, against
// every file that it reads; folders that cannot be written to, full disks, and the program killed
// in the middle. No input is lost, no half file is left, and the exit status is not 0.
#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <regex>
#include <set>
#include <sstream>
#include <thread>

#include "cli/hammer_trace.hpp"
#include "cli/pushed_drive.hpp"
#include "program.hpp"
#include "ringing_trace.hpp"
#include "run_up_trace.hpp"
#include "tetrahedron.hpp"

namespace {

using namespace program_test;

struct Named {
  std::string option;  // empty: an operand
  std::string file;
};

struct Case {
  std::string command;
  std::vector<Named> in, out;
  std::string rest;
  std::vector<std::string> in_folder;  // of an output that is a folder
  std::string named;                   // a file that an input names
};

const std::vector<Case> kCases = {
    {"monitor",
     {{"--machine", "band.ini"}, {"--trace", "cut.csv"}},
     {{"--events", "o.jsonl"},
      {"--estimates", "o.csv"},
      {"--report", "o.html"},
      {"--record", "o2.csv"},
      {"--shdr-device", "o.xml"}},
     "--quiet",
     {},
     "band.csv"},
    {"monitor",
     {{"--machine", "followed.ini"}, {"--trace", "followed.csv"}},
     {{"--coefficients-out", "o.ini"}, {"--cuts", "o.jsonl"}},
     "--quiet",
     {},
     {}},
    {"monitor",
     {{"--machine", "loaded.ini"}, {"--trace", "cut.csv"}},
     {{"--commands", "o.jsonl"}},
     "--quiet --cnc simulated",
     {},
     {}},
    {"monitor",
     {{"--machine", "band.ini"}, {"--candump", "log.txt"}, {"--map", "can.map"}},
     {{"--record", "o.csv"}},
     "",
     {},
     "drive.dbc"},
    {"identify idle",
     {{"--machine", "axis.ini"}, {"--trace", "axis.csv"}},
     {{"--out", "o.ini"}},
     "--quiet",
     {},
     {}},
    {"identify presliding",
     {{"--machine", "pushed.ini"}, {"--trace", "pushed.csv"}},
     {{"--out", "o.ini"}},
     "--quiet",
     {},
     {}},
    {"identify collision",
     {{"--machine", "cut.ini"}, {"", "cut.csv"}},
     {{"--out", "o.ini"}},
     "--quiet",
     {},
     {}},
    {"identify reference",
     {{"--machine", "even.ini"}, {"", "even.csv"}},
     {{"--out", "o.txt"}},
     "--quiet",
     {},
     {}},
    {"identify torque-band",
     {{"--machine", "cut.ini"}, {"", "cut.csv"}},
     {{"--out", "o.csv"}},
     "--quiet",
     {},
     {}},
    {"identify torque-tolerance",
     {{"--machine", "cut.ini"}, {"--prediction", "steps.csv"}, {"", "cut.csv"}},
     {{"--out", "o.ini"}},
     "--quiet",
     {},
     {}},
    {"identify torque-equation",
     {{"--machine", "torques.ini"}, {"--prediction", "areas.csv"}, {"", "blocks.csv"}},
     {{"--out", "o.ini"}},
     "--quiet",
     {},
     {}},
    {"identify torque-equation",
     {{"--machine", "torques.ini"}, {"", "torques.csv"}},
     {{"--out", "o.ini"}},
     "--quiet",
     {},
     {}},
    {"identify cutting",
     {{"--machine", "milled.ini"}, {"", "milled.csv"}},
     {{"--out", "o.ini"}, {"--coefficients", "o.tool.ini"}},
     "--quiet",
     {},
     {}},
    {"identify load-meter",
     {{"--machine", "milled.ini"}, {"", "milled.csv"}},
     {{"--out", "o.ini"}},
     "--quiet",
     {},
     {}},
    {"identify modes",
     {{"--frf", "tip.csv"}, {"--machine", "cut.ini"}},
     {{"--out", "o.ini"}, {"--report", "o.html"}},
     "--quiet",
     {},
     {}},
    {"identify modes",
     {{"--trace", "rings.csv"}, {"--machine", "cut.ini"}},
     {{"--report", "o.html"}},
     "--quiet",
     {},
     {}},
    {"identify modes",
     {{"--trace", "run_up.csv"}, {"--machine", "cut.ini"}},
     {{"--report", "o.html"}},
     "--quiet --run-ups",
     {},
     {}},
    {"identify transfer",
     {{"--trace", "noise.csv"}, {"--estimates", "estimates.csv"}},
     {{"--out", "o.csv"}, {"--report", "o.html"}},
     "--quiet --input dyno.torque_Nm --output spindle.torque_Nm",
     {},
     {}},
    {"identify impact",
     {{"", "hit.csv"}},
     {{"--out", "o.csv"}, {"--report", "o.html"}},
     "--quiet",
     {},
     {}},
    {"identify dynamometer",
     {{"--machine", "dyno.ini"}, {"--frf", "frf.csv"}},
     {{"--out", "o.ini"}},
     "--quiet --direction x --modes 1",
     {},
     {}},
    {"compensate dynamometer",
     {{"--machine", "dyno.ini"}, {"--trace", "dyno.csv"}},
     {{"--out", "o.csv"}},
     "--quiet",
     {},
     {}},
    {"study encoder",
     {{"--machine", "axis.ini"}, {"--trace", "axis.csv"}},
     {{"--report", "o.html"}},
     "--quiet",
     {},
     {}},
    {"study cutoff",
     {{"--machine", "axis.ini"}, {"--trace", "axis.csv"}},
     {{"--report", "o.html"}},
     "--quiet",
     {},
     {}},
    {"study order",
     {{"--machine", "cut.ini"}, {"--trace", "noise.csv"}},
     {{"--report", "o.html"}},
     "--quiet",
     {},
     {}},
    {"study warm-up",
     {{"--machine", "axis.ini"}, {"--trace", "laps.csv"}},
     {{"--report", "o.html"}},
     "--quiet --parts 6",
     {},
     {}},
    {"lobes",
     {{"--machine", "cut.ini"}},
     {{"--out", "o.csv"}, {"--report", "o.html"}},
     "--quiet --speeds 20",
     {},
     {}},
    {"recommend",
     {{"--machine", "cut.ini"}, {"--cuts", "cuts.jsonl"}},
     {{"--report", "o.html"}},
     "--quiet",
     {},
     {}},
    {"pockets",
     {{"--machine", "cut.ini"}, {"--trace", "cut.csv"}, {"--trace2", "cut.csv"}},
     {{"--report", "o.html"}},
     "--quiet",
     {},
     {}},
    {"pockets",
     {{"--machine", "cut.ini"}, {"--trace", "cut.csv"}},
     {{"--cuts", "o.jsonl"}},
     "--quiet",
     {},
     {}},
    {"reconcile",
     {{"--machine", "axis.ini"}, {"--trace", "axis.csv"}, {"--proof-trace", "axis2.csv"}},
     {{"--out", "o"}},
     "--quiet",
     {"reconcile.json", "machine.ini", "report.html"},
     {}},
    {"reconcile",
     {{"--machine", "axis.ini"}, {"--trace", "axis.csv"}, {"--changed-since", "axis2.csv"}},
     {{"--out", "o"}},
     "--quiet",
     {"reconcile.json", "machine.ini", "report.html"},
     {}},
    {"simulate drive",
     {{"--machine", "axis.ini"}, {"--motion", "moves.txt"}},
     {{"--out", "o.csv"}},
     "--quiet",
     {},
     {}},
    {"simulate milling",
     {{"--machine", "cut.ini"}},
     {{"--out", "o.csv"}},
     "--quiet --duration 0.4",
     {},
     {}},
    {"import",
     {{"", "lathe.csv"}, {"--map", "lathe.map"}},
     {{"--out", "o.csv"}},
     "--quiet",
     {},
     {}},
    {"init", {}, {{"--out", "o.ini"}}, "--quiet --class lathe", {}, {}},
    {"export", {{"--c", "cut.ini"}}, {{"--out", "o.h"}}, "", {}, {}},
    {"program motion",
     {{"", "part.ngc"},
      {"--tools", "tools.tbl"},
      {"--parameters", "offsets.var"},
      {"--machine", "axis.ini"}},
     {{"--out", "o.csv"}},
     "--quiet",
     {},
     {}},
    {"program predict",
     {{"", "part.ngc"},
      {"--tools", "tools.tbl"},
      {"--parameters", "offsets.var"},
      {"--after", "before.ngc"},
      {"--machine", "tools.ini"}},
     {{"--out", "o.csv"}},
     "--quiet --stock box:0,0,-0.001,0.002,0.002,0",
     {},
     {}},
    {"program optimise",
     {{"", "part.ngc"},
      {"--tools", "tools.tbl"},
      {"--parameters", "offsets.var"},
      {"--after", "before.ngc"},
      {"--machine", "bounds.ini"}},
     {{"--out", "o.ngc"}},
     "--quiet --stock box:0,0,-0.001,0.002,0.002,0",
     {},
     {}},
    {"program check",
     {{"", "part.ngc"},
      {"--tools", "tools.tbl"},
      {"--parameters", "offsets.var"},
      {"--after", "before.ngc"},
      {"--target", "corner.stl"},
      {"--fixture", "corner.stl"},
      {"--machine", "tools.ini"}},
     {{"--report", "o.html"}},
     "--quiet --tolerance 0.001 --stock box:0,0,-0.001,0.002,0.002,0",
     {},
     {}},
    {"report", {{"", "events.jsonl"}}, {{"--out", "o.html"}}, "--quiet", {}, {}}};

std::string words(const Case& c, const std::vector<Named>& out) {
  std::string text = c.command + " " + c.rest;
  for (const auto* all : {&c.in, &out})
    for (const Named& n : *all) text += " " + n.option + " " + n.file;
  return text;
}

/// Air and cuts at two speeds and two feeds: a load meter beside a torque sensor.
std::string milled() {
  std::string text =
      "t_s,spindle.speed_rad_s,spindle.load_V,tool.torque_Nm,tool.feed_per_tooth_m\n";
  char row[120];
  unsigned random = 1, n = 0;
  for (const double speed : {300.0, 607.0})
    for (const double feed : {1e-4, 4e-5})
      for (const bool cut : {false, true, false})
        for (int k = 0; k < 400; ++k, ++n) {
          random = random * 1664525 + 1013904223;
          const double noise = static_cast<int>(random >> 16) / 32768.0 - 1;
          const double torque = (cut ? 1 + 2e4 * feed : 0) + 0.01 * noise;
          std::snprintf(row, sizeof row, "%.3f,%g,%.5f,%.5f,%g\n", 0.005 * n, speed,
                        4e-4 * speed * (torque + 4e-4 * speed), torque, feed);
          text += row;
        }
  return text;
}

/// The required outputs, with `changed` instead of the one of its option, or beside them.
std::vector<Named> with(const Case& c, const Named& changed) {
  const std::set<std::string> all_optional = {
      "monitor", "lobes", "pockets", "recommend", "identify transfer", "identify modes"};
  std::vector<Named> out = {changed};
  if (!all_optional.contains(c.command))
    for (const Named& n : c.out)
      if (n.option != changed.option) out.push_back(n);
  return out;
}

std::string file_of(const Case& c, const Named& out, std::size_t i) {
  return c.in_folder.empty() ? out.file : out.file + "/" + c.in_folder[i];
}

void write_inputs() {
  put("axis.ini",
      "[machine]\nsample_rate_hz = 8000\n[axis.x]\nlead_m = 0.016\nequivalent_mass_kg = 200\n"
      "torque_constant_Nm_per_A = 0.8\ncoulomb_friction_N = 90\nencoder_counts_per_rev = 1048576\n"
      "current_update_hz = 2000\n[controller.x]\nposition_gain_per_s = 40\n"
      "velocity_gain_A_s_per_m = 200\nvelocity_integral_per_s = 60\n");
  put("dyno.ini", "[dynamometer.x]\nmodes = 930 0.03 0.9\n");
  std::string dyno = "t_s,spindle.speed_rad_s,dyno.force_x_N\n";
  for (int n = 0; n < 200; ++n) dyno += std::to_string(n * 1e-4) + ",600,5\n";
  put("dyno.csv", dyno);
  std::string frf = "frequency_hz,gain,phase_rad\n";
  for (int hz = 10; hz < 900; hz += 10)
    frf += std::to_string(hz) + "," + std::to_string(1 / (1 - hz * hz / 1e6)) + ",0\n";
  put("frf.csv", frf);
  std::string laps = "x limits 0.5 5 100\n";
  for (int lap = 0; lap < 6; ++lap) laps += "x move 0.1 0.2\nx move 0 0.2\n";
  put("laps.txt", laps);
  put("moves.txt",
      "x limits 0.5 5 100\nx move 0.1 0.2\nx move 0 0.2\nx move 0.05 0.05\nx move 0 0.05\n"
      "x move 0.1 0.2\nx move 0 0.2\n");
  const std::string cut = content(fs::current_path() / "examples/machines/koike_cut.ini");
  put("cut.ini", cut + "\n[monitor.collision]\ncutting_torque_Nm = 0.1\n");
  put("loaded.ini", cut + "\n[limits]\ntorque_Nm = 0.01\n[override]\nfeed_ratio = 0.5 1\n");
  put("cuts.jsonl", R"({"spindle_speed_rpm": 3000, "axial_depth_m": 0.001, "stable": true})"
                    "\n");
  std::string even = cut;  // one speed, so that windows are alike
  even.replace(even.find("spindle_speed_profile"), 1, "# s");
  put("even.ini", even);
  // With an axis y beside x, whose feeds the coefficients need.
  const std::size_t axes = even.find("[axis.x]");
  std::string y = even.substr(axes, even.find("[observer.spindle]") - axes);
  for (std::size_t at = 0; (at = y.find(".x]", at)) != std::string::npos;) y[at + 1] = 'y';
  put("followed.ini", even + y +
                          "\n[monitor.collision]\ncutting_torque_Nm = 0.1\n"
                          "[monitor.cutting-coefficients]\n");
  put("lathe.csv", content(fs::current_path() / "tests/data/import/lathe.csv"));
  put("pushed.ini", pushed::kMachine);
  put("pushed.csv", pushed::trace());
  put("milled.csv", milled());
  put("milled.ini",
      "[machine]\nsample_rate_hz = 200\n[spindle]\nload_meter_V_per_W = 4e-4\n"
      "viscous_friction_Nm_s_per_rad = 4e-4\n[tool]\ndiameter_m = 0.016\nteeth = 2\n"
      "[cut]\naxial_depth_m = 0.002\ndirection = slot\n");
  std::string noise = "t_s,dyno.torque_Nm\n", estimates = "t_s,spindle.torque_Nm\n";
  unsigned random = 1;
  for (int i = 0; i < 2000; ++i) {
    random = random * 1664525 + 1013904223;
    const std::string x = std::to_string(static_cast<int>(random >> 16) - 32768);
    noise += std::to_string(i) + "e-3," + x + "\n";
    estimates += std::to_string(i) + "e-3," + x + "\n";
  }
  put("noise.csv", noise);
  put("rings.csv", ringing_test::trace());
  put("run_up.csv", run_up_test::trace());
  put("hit.csv", hammer_test::trace({{0.01, 300, 0.0006}}));
  std::string tip = "frequency_hz,receptance_re_m_per_N,receptance_im_m_per_N\n";
  for (int f = 100; f < 1000; ++f) {  // f / 500, damping 0.03
    const double r = f / 500., re = 1 - r * r, im = -0.06 * r, d = 1e7 * (re * re + im * im);
    char row[90];
    std::snprintf(row, sizeof row, "%d,%.6e,%.6e\n", f, re / d, im / d);
    tip += row;
  }
  put("tip.csv", tip);
  put("estimates.csv", estimates);
  put("part.ngc", "G21 G90 T1 M6 G0 X1\nM2\n");
  put("corner.stl", tetrahedron::kStl);
  put("before.ngc", "G21 G90 G0 X2\nM2\n");
  put("tools.ini", "[tool]\ndiameter_m = 0.003\n");
  put("steps.csv", "line,t_s,spindle.torque_Nm,low_Nm,high_Nm\n1,9,1,-1e6,1e6\n2,99,1,-1e6,1e6\n");
  put("bounds.ini", "[tool]\ndiameter_m = 0.003\n[limits]\nfeed_per_tooth_m = 1e-4\n");
  put("torques.ini", "[spindle]\n[tool]\ndiameter_m = 0.003\n");
  put("areas.csv",
      "line,t_s,removed_m2,contact_m2,bottom_m2,feed_per_tooth_m\n1,2,1e-5,4e-5,0,4e-5\n2,4,1e-5,"
      "4e-5,0,9e-5\n3,6,5e-5,9e-5,0,4e-5\n4,8,5e-5,9e-5,0,9e-5\n");
  std::string blocks = "t_s,spindle.speed_rad_s,spindle.torque_Nm,machine.nc_block\n";
  for (int n = 0; n < 4000; ++n) {
    const double block_Nm[] = {1.1, 1.9, 4.1, 9};
    blocks += std::to_string(n * 2e-3) + ",300," + std::to_string(block_Nm[n / 1000]) + "," +
              std::to_string(n / 1000 + 1) + "\n";
  }
  put("blocks.csv", blocks);
  put("torques.csv",
      "removed_m2,contact_m2,feed_per_tooth_m,spindle.torque_Nm\n1e-5,4e-5,4e-5,1.1\n1e-5,4e-5,"
      "9e-5,1.9\n5e-5,9e-5,4e-5,4.1\n5e-5,9e-5,9e-5,9\n");
  put("tools.tbl", "T1 P1 D3 Z10\n");
  put("offsets.var", "5161 0\n5220 1\n");
  put("log.txt", "(0.000000) can0 181#0000000000000000\n");
  put("can.map", "dbc = drive.dbc\n");
  put("drive.dbc", "VERSION \"\"\n");
  for (const char* line :
       {"import lathe.csv --quiet --out lathe.trace --map lathe.map",
        "simulate drive --quiet --machine axis.ini --motion moves.txt --out axis.csv",
        "simulate drive --quiet --machine axis.ini --motion moves.txt --out axis2.csv",
        "simulate drive --quiet --machine axis.ini --motion laps.txt --out laps.csv",
        "simulate milling --quiet --machine cut.ini --duration 0.4 --out cut.csv",
        "simulate milling --quiet --machine even.ini --duration 1.5 --out even.csv",
        "simulate milling --quiet --machine followed.ini --duration 1.5 --out followed.csv",
        "identify torque-band --quiet --machine cut.ini --out band.csv cut.csv"}) {
    const Outcome o = run(line);
    that(o.status == 0, o, "makes the inputs", __LINE__);
  }
  put("band.ini", content(folder / "cut.ini") + "\n[monitor.torque-band]\nreference = band.csv\n");
  const Outcome o = run("monitor --quiet --machine band.ini --trace cut.csv --events events.jsonl");
  that(o.status == 0, o, "makes the inputs", __LINE__);
}

/// Standard output is an output, too; a dash is no file; what is read twice is no pipe.
void streams() {
  const auto shell = [](const std::string& before, const std::string& arguments,
                        const std::string& after) {
    const std::string line = "cd '" + folder.string() + "' && " + before + " '" + program + "' " +
                             arguments + " " + after + " 2> err.txt";
    const int raw = std::system(line.c_str());
    return Outcome{line, content(folder / "out.txt"), content(folder / "err.txt"),
                   WIFEXITED(raw) ? WEXITSTATUS(raw) : -1};
  };
  const std::string before = content(folder / "axis.csv");
  for (const char* to : {">> axis.csv", "1<> axis.csv"}) {
    const Outcome o =
        shell("", "monitor --quiet --machine axis.ini --trace axis.csv --events -", to);
    that(o.status == 2 && contains(o.err, "standard output would write into --trace axis.csv"), o,
         "refuses", __LINE__);
    CHECK(content(folder / "axis.csv") == before);
  }
  // A replay at its own pace ends as a live run does.
  const Outcome paced =
      shell("timeout --preserve-status -s INT 2",
            "monitor --quiet --machine axis.ini --trace axis.csv --pace 0.05 --events paced.jsonl",
            "> out.txt");
  that(paced.status == 0 && contains(paced.out, "Verdict: "), paced, "in good order", __LINE__);
  CHECK(fs::exists(folder / "paced.jsonl"));
  for (const char* line :
       {"monitor --machine axis.ini --trace -", "lobes --machine cut.ini --out -",
        "monitor --machine axis.ini --trace axis.csv --estimates -", "report e.jsonl --out -"})
    refused(line, 2, {"-"}, __LINE__);
  CHECK(!fs::exists(folder / "-"));
  refused("report events.jsonl --out ''", 2, {"--out", "needs a value"}, __LINE__);
  const Outcome direct = run("pockets --json --machine cut.ini --trace cut.csv");
  const Outcome pockets = shell("cat cut.csv | timeout 60",
                                "pockets --json --machine cut.ini --trace /dev/stdin", "> out.txt");
  that(pockets.status == direct.status && pockets.out == direct.out, pockets, "reads a pipe",
       __LINE__);
  for (const char* line : {"identify torque-band --machine cut.ini --out o.csv /dev/stdin",
                           "identify reference --machine cut.ini --out o.csv /dev/stdin",
                           "reconcile --machine axis.ini --trace /dev/stdin --out o"}) {
    const Outcome twice = shell("cat axis.csv | timeout 60", line, "> out.txt");
    that(twice.status == 2 && one_sentence(twice.err) && contains(twice.err, "read more than once"),
         twice, "is not waited for", __LINE__);
  }
}

/// Every command, and every option of it that takes a file, is in the table above.
void table_is_whole() {
  std::set<std::string> known;
  for (const Case& c : kCases)
    for (const auto* all : {&c.in, &c.out})
      for (const Named& n : *all) known.insert(c.command + " " + n.option);
  const std::regex command(R"(^  ([a-z]+( [a-z-]+)?)  .*)"), option(R"(^  (--[a-z0-9-]+) (\S+).*)");
  const std::set<std::string> files = {"FILE", "FILE|-", "TRACE", "CSV", "HTML", "HEADER", "DIR"};
  std::smatch found;
  unsigned options = 0;
  for (const std::string& line : lines(run("--help").out)) {
    if (!std::regex_match(line, found, command)) continue;
    const std::string name = found[1];
    for (const std::string& of : lines(run("help " + name).out))
      if (std::regex_match(of, found, option) && files.contains(found[2])) {
        ++options;
        const std::string whole = name + " " + found[1].str();
        check::that(known.contains(whole), whole.c_str(), __FILE__, __LINE__);
      }
  }
  CHECK(options >= 35);
}

/// `to` as another name of `from`.
void link(const std::string& kind, const std::string& from, const std::string& to) {
  fs::remove(folder / to);
  if (kind == "symbolic")
    fs::create_symlink(from, folder / to);
  else
    fs::create_hard_link(folder / from, folder / to);
}

void refused_as_same(const Case& c, const std::vector<Named>& out, const std::string& input,
                     int line) {
  const std::string before = content(folder / input);
  const Outcome o = run(words(c, out));
  that(o.status == 2 && contains(o.err, "the same file") && one_sentence(o.err), o,
       "refuses by identity", line);
  that(o.out.empty() && content(folder / input) == before, o, "leaves it alone", line);
}

void outputs_are_no_inputs() {
  unsigned pairs = 0;
  for (const Case& c : kCases) {
    std::vector<std::string> inputs;
    for (const Named& n : c.in) inputs.push_back(n.file);
    if (!c.named.empty()) inputs.push_back(c.named);
    for (const Named& out : c.out)
      for (const std::string& input : inputs) {
        if (!c.in_folder.empty()) {
          for (const std::string& name : c.in_folder) {
            fs::create_directory(folder / "links");
            for (const char* kind : {"symbolic", "hard"}) {
              link(kind, kind == std::string("hard") ? input : "../" + input, "links/" + name);
              refused_as_same(c, {{out.option, "links"}}, input, __LINE__);
            }
            fs::remove_all(folder / "links");
            ++pairs;
          }
          continue;
        }
        ++pairs;
        refused_as_same(c, with(c, {out.option, input}), input, __LINE__);
        refused_as_same(c, with(c, {out.option, "././" + input}), input, __LINE__);
        for (const char* kind : {"symbolic", "hard"}) {
          link(kind, input, "link");
          refused_as_same(c, with(c, {out.option, "link"}), input, __LINE__);
        }
        fs::remove(folder / "link");
      }
    for (const Named& a : c.out)
      for (const Named& b : c.out)
        if (a.option < b.option) {
          ++pairs;
          // Neither is there yet; then one is a link to where the other will be.
          for (const char* name : {"new", "./new"})
            refused_as_same(c, {{a.option, "new"}, {b.option, name}}, "cut.csv", __LINE__);
          fs::create_symlink("new", folder / "link");
          refused_as_same(c, {{a.option, "link"}, {b.option, "new"}}, "cut.csv", __LINE__);
          CHECK(!fs::exists(folder / "new") && fs::is_symlink(folder / "link"));
          fs::remove(folder / "link");
        }
  }
  check::figure("pairs of files that are kept apart", pairs);
}

/// Files that were not finished.
std::vector<fs::path> parts() {
  std::vector<fs::path> all;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (contains(entry.path().filename().string(), ".part")) all.push_back(entry.path());
  return all;
}
bool tidy() { return parts().empty(); }

using Clock = std::chrono::steady_clock;

/// The run's outputs when all is well, by name, and how long it took.
std::map<std::string, std::string> reference(const Case& c, Clock::duration& took) {
  std::map<std::string, std::string> all;
  fs::remove_all(folder / "o");
  const Clock::time_point began = Clock::now();
  const Outcome o = run(words(c, c.out));
  took = Clock::now() - began;
  that(o.status == 0 && tidy(), o, "works", __LINE__);
  for (const Named& out : c.out)
    for (std::size_t i = 0; i < std::max<std::size_t>(1, c.in_folder.size()); ++i) {
      const std::string file = file_of(c, out, i);
      all[file] = content(folder / file);
      that(!all[file].empty(), o, file + " is there", __LINE__);
    }
  return all;
}

const std::string kOld = "what was there before\n";

void put_old(const std::map<std::string, std::string>& files) {
  for (const auto& [name, text] : files) put(name, kOld);
}

void cannot_be_written(const Case& c) {
  put("plain.txt", kOld);
  fs::create_directory(folder / "folder");
  for (const Named& out : c.out) {
    std::vector<std::string> bad = {"absent/o", "plain.txt/o", "/proc/o", "folder"};
    if (!c.in_folder.empty()) bad = {"plain.txt", "/proc/o/o"};
    for (const std::string& path : bad) {
      const Outcome o = run(words(c, with(c, {out.option, path})));
      that(o.status == 4 && one_sentence(o.err) && contains(o.err, path), o,
           "says what cannot be written", __LINE__);
      if (c.in_folder.empty()) that(o.out.empty(), o, "before the work", __LINE__);
    }
  }
  CHECK(content(folder / "plain.txt") == kOld && fs::is_empty(folder / "folder"));
}

void full_disk(const Case& c, const std::map<std::string, std::string>& whole) {
  if (c.in_folder.empty())
    for (const Named& out : c.out) {
      const Outcome o = run(words(c, with(c, {out.option, "/dev/full"})));
      that(o.status == 4 && contains(o.err, "/dev/full: ") && contains(o.err, "No space left"), o,
           "a full device", __LINE__);
    }
  // A limit of the size of a file, as `ulimit -f` sets it, is a disk that fills up on the way.
  for (const rlim_t bytes : {rlim_t{700}, rlim_t{20000}})
    for (const Named& out : c.out) {
      put_old(whole);
      rlimit before{};
      getrlimit(RLIMIT_FSIZE, &before);
      const rlimit small{bytes, before.rlim_max};
      setrlimit(RLIMIT_FSIZE, &small);
      const std::string line = "cd '" + folder.string() + "' && '" + program + "' " +
                               words(c, with(c, out)) + " > /dev/null 2> err.txt < /dev/null";
      const int raw = std::system(line.c_str());
      setrlimit(RLIMIT_FSIZE, &before);
      const Outcome o{line, "", content(folder / "err.txt"),
                      WIFEXITED(raw) ? WEXITSTATUS(raw) : -1};
      bool fits = true;
      for (std::size_t i = 0; i < std::max<std::size_t>(1, c.in_folder.size()); ++i) {
        const std::string file = file_of(c, out, i);
        const bool small_enough = whole.at(file).size() <= bytes;
        const std::string now = content(folder / file);
        that(now == (small_enough && fits ? whole.at(file) : kOld), o,
             file + " is whole or what it was", __LINE__);
        fits = fits && small_enough;
        if (!small_enough) that(contains(o.err, "File too large"), o, "says so", __LINE__);
      }
      that(o.status == (fits ? 0 : 4) && tidy(), o, "status", __LINE__);
    }
}

/// A result that nobody can read is an error.
void full_standard_output(const Case& c) {
  for (const char* json : {"--json", ""}) {
    std::string text = words(c, c.out);
    if (const std::size_t quiet = text.find("--quiet"); quiet != std::string::npos)
      text.erase(quiet, 7);  // some print nothing then
    const std::string line = "cd '" + folder.string() + "' && '" + program + "' " + text + " " +
                             json + " > /dev/full 2> err.txt < /dev/null";
    const int raw = std::system(line.c_str());
    const Outcome o{line, "", content(folder / "err.txt"), WIFEXITED(raw) ? WEXITSTATUS(raw) : -1};
    that(o.status == 4 && contains(o.err, "standard output"), o, "is an error", __LINE__);
  }
}

/// At the beginning, and again and again towards the end, where files are written.
void killed(const Case& c, const std::map<std::string, std::string>& whole, Clock::duration took) {
  for (const int share : {5, 60, 80, 90, 95, 100}) {
    put_old(whole);
    std::fflush(nullptr);
    const pid_t pid = fork();
    if (pid == 0) {
      const int nowhere = ::open("/dev/null", O_RDWR);
      for (const int fd : {0, 1, 2}) dup2(nowhere, fd);
      if (chdir(folder.c_str()) != 0) _exit(1);
      std::vector<std::string> split = {program};
      std::stringstream in(words(c, c.out));
      for (std::string word; in >> word;) split.push_back(word);
      std::vector<char*> argv;
      for (std::string& word : split) argv.push_back(word.data());
      argv.push_back(nullptr);
      execv(program, argv.data());
      _exit(127);
    }
    std::this_thread::sleep_for(took * share / 100);
    kill(pid, SIGKILL);
    int status = 0;
    waitpid(pid, &status, 0);
    for (const auto& [name, text] : whole) {
      const std::string now = content(folder / name);
      check::that(now == kOld || now == text, (c.command + " killed: " + name).c_str(), __FILE__,
                  __LINE__);
    }
    // What was being written stays behind, under its own name: nobody was left to take it away.
    for (const fs::path& part : parts()) fs::remove(part);
  }
}

/// What a file is stays: its permissions, and that it is a link. Standard output is no file to be
/// replaced.
void kept_as_it_is() {
  put("kept.ini", kOld);
  fs::permissions(folder / "kept.ini", fs::perms::owner_read | fs::perms::owner_write);
  fs::create_directory(folder / "place");
  fs::create_symlink("../kept.ini", folder / "place/link.ini");
  const std::string idle = "identify idle --quiet --machine axis.ini --trace axis.csv --out ";
  const Outcome o = run(idle + "place/link.ini");
  that(o.status == 0 && fs::is_symlink(folder / "place/link.ini"), o, "a link", __LINE__);
  CHECK(contains(content(folder / "kept.ini"), "equivalent_mass_kg"));
  CHECK((fs::status(folder / "kept.ini").permissions() & fs::perms::all) ==
        (fs::perms::owner_read | fs::perms::owner_write));
  const Outcome shown = run("lobes --quiet --machine cut.ini --speeds 20 --out /dev/stdout");
  that(shown.status == 0 && contains(shown.out, "spindle_speed_rpm,") &&
           contains(shown.out, "pocket at"),
       shown, "standard output has both", __LINE__);
  const std::string piped = "cd '" + folder.string() + "' && '" + program +
                            "' lobes --quiet --machine cut.ini --speeds 20 --out /dev/stdout | "
                            "cat > piped.txt";
  CHECK(std::system(piped.c_str()) == 0);
  CHECK(contains(content(folder / "piped.txt"), "spindle_speed_rpm,"));
  // A band may be taught anew under the name that the machine file knows.
  const Outcome anew =
      run("identify torque-band --quiet --machine band.ini --out band.csv cut.csv");
  that(anew.status == 0, anew, "a reference made anew", __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("outputs", [] {
    write_inputs();
    table_is_whole();
    streams();
    outputs_are_no_inputs();
    std::set<std::string> done;
    for (const Case& c : kCases) {
      // Once a command.
      if (!done.insert(c.command).second) continue;
      cannot_be_written(c);
      Clock::duration took{};
      const auto whole = reference(c, took);
      full_disk(c, whole);
      full_standard_output(c);
      killed(c, whole, took);
    }
    kept_as_it_is();
  });
}
