// servosense init as a user runs it: from --set, from a terminal, with everything wrong at once;
// and the way on: an idling run replaces the guesses. The clauses on what a missing figure costs
// are held to what the planner of the monitors, the simulators and export do without it.
#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <sstream>
#include <string>
#include <vector>

#include "check.hpp"
#include "cli/init_questions.hpp"
#include "program.hpp"
#include "servosense/io/data_sheet.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace {

using namespace program_test;
using servosense::MachineFile;

double value(const char* file, const char* section, const char* key) {
  const auto machine = MachineFile::read((folder / file).string());
  CHECK(machine.has_value());
  return machine ? machine->number(section, key).value_or(std::nan("")) : std::nan("");
}

std::string part_between(const std::string& text, const std::string& from, const std::string& to) {
  const std::size_t begin = text.find(from);
  if (begin == std::string::npos) return "";
  const std::size_t at = begin + from.size();
  return text.substr(at, text.find(to, at) - at);
}

void the_example_of_the_page() {
  const std::string page = content("docs/init.md");
  const std::string command = part_between(page, "$ servosense ", "\n```");
  const std::size_t end = command.find("TRACE --out OUT2'");
  const std::size_t begin = command.find("\ngiven\n");
  CHECK(begin != std::string::npos && end != std::string::npos);
  if (begin == std::string::npos) return;
  std::string words = command.substr(0, begin);
  const Outcome o = run(words);
  that(o.status == 0, o, "works", __LINE__);
  CHECK_TEXT(o.out, command.substr(begin + 1) + "\n");
  CHECK_TEXT(content(folder / "mill.ini"), part_between(page, "```ini\n", "```"));
}

void as_json() {
  const Outcome o =
      run("init --out j.ini --json --class small-mill --set axis.x.lead_m=16mm --set "
          "'axis.x.table_mass=55 kg' "
          "--set 'axis.x.motor_inertia=10 kg cm2' --set axis.x.vertical=no");
  that(o.status == 0, o, "works", __LINE__);
  const Json json(o.out);
  that(json.ok && json.object, o, "one object", __LINE__);
  CHECK_TEXT(json.text("out"), "j.ini");
  CHECK_TEXT(json.text("class"), "small-mill");
  CHECK(json.sizes.at("given") == 4 && json.sizes.at("derived") == 2 &&
        json.sizes.at("guessed") == 11);
  CHECK_TEXT(json.text("given.0.key"), "axis.x.lead_m");
  CHECK_NEAR(json.number("given.0.value"), 0.016, 0);
  CHECK_TEXT(json.text("given.0.unit"), "m");
  CHECK_TEXT(json.text("given.0.given"), "16mm");
  CHECK_TEXT(json.text("given.3.value"), "no");
  CHECK_TEXT(json.text("given.3.unit"), "null");
  CHECK_TEXT(json.text("derived.0.key"), "axis.x.equivalent_mass_kg");
  const double pi = std::acos(-1.0);
  CHECK_NEAR(json.number("derived.0.value"), 55 + 1e-3 * std::pow(2 * pi / 0.016, 2), 1e-8);
  CHECK_TEXT(json.text("guessed.0.key"), "spindle.inertia_kg_m2");
  CHECK(contains(json.text("guessed.0.source"), "Koike 2016"));
  CHECK_TEXT(json.text("missing.0.key"), "machine.sample_rate_hz");
  CHECK(contains(json.text("missing.0.costs"), "8000 Hz"));
  CHECK(json.sizes.at("remarks") == 1);
  // And by itself, without a guess.
  const Json bare(run("init --out j.ini --json --set spindle.inertia_kg_m2=1").out);
  CHECK_TEXT(bare.text("class"), "null");
  CHECK(bare.sizes.at("guessed") == 0);
}

void refusals() {
  const std::string wrong =
      "init --out no.ini --set axis.x.lead_mm=10 --set axix.y.lead_m=1 --set 'axis.z.lead_m=10 kg' "
      "--set foo "
      "--set axis.z.torque_constant_Nm_per_A=1 --set axis.z.force_constant_N_per_A=1 --class mill";
  const Outcome o = run(wrong);
  that(o.status == 2 && o.out.empty(), o, "is refused", __LINE__);
  const std::vector<std::string> said = lines(o.err);
  CHECK(said.size() == 6);
  for (const std::string& line : said) CHECK(line.starts_with("servosense: "));
  for (const char* part : {"'lead_m'", "[axis.x]", "'10 kg'", "'foo'", "keep one", "small-mill"})
    that(contains(o.err, part), o, std::string("says ") + part, __LINE__);
  const Outcome as_object = run(wrong + " --json");
  const Json json(as_object.out);
  that(json.ok && json.number("error.status") == 2, as_object, "an object", __LINE__);
  for (const char* part : {"'lead_m'", "[axis.x]", "'10 kg'", "'foo'", "keep one", "small-mill"})
    CHECK(contains(json.text("error.message"), part));
  CHECK(!fs::exists(folder / "no.ini"));
  // From a pipe nothing is asked, so nothing is known.
  refused("init --out no.ini", 2, {"nothing is known of the machine"}, __LINE__);
  refused(
      "init --out no.ini --set effect.x.backlash.width_m=20um --set spindle.inertia_kg_m2=1 "
      "--set effect.spindle.stribeck-friction.extra_static_Nm=1",
      2, {"lacks stribeck_velocity_rad_per_s"}, __LINE__);
  refused("init --out nowhere/no.ini --class lathe", 4, {"nowhere"}, __LINE__);
  CHECK(!fs::exists(folder / "no.ini"));
}

// ---- questions ---------------------------------------------------------------------------------

const char* const kAnswers =
    "mill\n"          // no class
    "small-mill\n"    //
    "spindle, q\n"    // no drive
    "spindle, x\n"    //
    "bench mill 3\n"  // name
    "8\n"             // kHz
    "\n"              // torque constant: not known
    "70\n50 A\n"      // rated torque, current
    "17 bit\n"        // encoder
    "\n"              // motor's inertia
    "3.7\n"           // kW
    "10 kg\n"         // lead: no
    "16\n"            // mm
    "\n"              // gear
    "0.8 Nm/Arms\n"   //
    "5000 lines\n"    //
    "55\n10\n3.5\n"   // kg, kg cm2, kg cm2
    "4\n16\n";        // teeth, mm

void check_answers(const MachineFile& machine) {
  const double pi = std::acos(-1.0);
  const auto near = [&](const char* section, const char* key, double expected) {
    const double got = machine.number(section, key).value_or(std::nan(""));
    check::near(got, expected, 1e-9 * expected, key, __FILE__, __LINE__);
  };
  CHECK_TEXT(machine.text("machine", "name").value_or(""), "bench mill 3");
  near("machine", "sample_rate_hz", 8000);
  near("spindle", "torque_constant_Nm_per_A", 1.4);
  near("spindle", "encoder_counts_per_rev", 131072);
  near("spindle", "inertia_kg_m2", 0.0048);  // the guess
  near("spindle", "rated_power_W", 3700);
  near("axis.x", "lead_m", 0.016);
  near("axis.x", "torque_constant_Nm_per_A", 0.8);
  near("axis.x", "encoder_counts_per_rev", 20000);
  near("axis.x", "equivalent_mass_kg", 55 + 1.35e-3 * std::pow(2 * pi / 0.016, 2));
  near("tool", "teeth", 4);
  near("tool", "diameter_m", 0.016);
}

void questions() {
  std::istringstream in(kAnswers);
  std::ostringstream out;
  const auto sheet = servosense::cli::ask_sheet(in, out);
  const auto report = servosense::work_out(sheet.entries, sheet.machine_class, "asked.ini");
  CHECK(report.faults.empty());
  check_answers(report.machine);
  CHECK(contains(out.str(), "axis.x: lead of the screw, travel per turn [mm]: "));
  CHECK(contains(out.str(), "found '10 kg'; 'kg' measures something else"));
  CHECK(contains(out.str(), "'mill' is none of them") &&
        contains(out.str(), "'q' is none of them"));
  CHECK(!contains(out.str(), "axis.y") && !contains(out.str(), "load_inertia"));
  // The end of the input ends the questions, wherever it comes.
  const std::string answers = kAnswers;
  for (std::size_t n = 0; n <= answers.size(); n += 7) {
    std::istringstream part(answers.substr(0, n));
    std::ostringstream unread;
    CHECK(servosense::cli::ask_sheet(part, unread).entries.size() <= sheet.entries.size());
  }
}

/// The program with a terminal as standard input.
Outcome on_terminal(const std::string& arguments, const std::string& typed) {
  Outcome o;
  o.command = "servosense " + arguments + " on a terminal";
  const int ours = posix_openpt(O_RDWR | O_NOCTTY);
  CHECK(ours >= 0 && grantpt(ours) == 0 && unlockpt(ours) == 0);
  const std::string theirs = ptsname(ours);
  const int open_end = open(theirs.c_str(), O_RDWR | O_NOCTTY);
  CHECK(write(ours, typed.data(), typed.size()) == static_cast<ssize_t>(typed.size()));
  const std::string line = "cd '" + folder.string() + "' && timeout 60 '" + program + "' " +
                           arguments + " < " + theirs + " > out.txt 2> err.txt";
  const int raw = std::system(line.c_str());
  close(open_end);
  close(ours);
  o.status = WIFEXITED(raw) ? WEXITSTATUS(raw) : -1;
  o.out = content(folder / "out.txt");
  o.err = content(folder / "err.txt");
  return o;
}

void on_a_terminal() {
  const Outcome o = on_terminal("init --out asked.ini", kAnswers);
  that(o.status == 0 && contains(o.err, "rated power [kW]: "), o, "asks", __LINE__);
  // It says how to do the same without questions.
  const std::string same = part_between(o.err, "without questions: servosense ", "\n");
  const std::string made = content(folder / "asked.ini");
  const Outcome again = run(same);
  that(again.status == 0, again, "works", __LINE__);
  CHECK_TEXT(content(folder / "asked.ini"), made);
  const auto machine = MachineFile::read((folder / "asked.ini").string());
  CHECK(machine.has_value());
  if (machine) check_answers(*machine);
  // With --set, --json or --quiet it does not.
  for (const char* option :
       {"--set spindle.inertia_kg_m2=1", "--json --class lathe", "--quiet --class lathe"}) {
    const Outcome silent = on_terminal(std::string("init --out silent.ini ") + option, kAnswers);
    that(silent.status == 0 && !contains(silent.err, "rated power"), silent, "does not ask",
         __LINE__);
  }
}

// ---- what a missing figure costs ---------------------------------------------------------------

using namespace servosense;

std::vector<std::string> whole_sheet() {
  std::vector<std::string> all = {"machine.sample_rate_hz=8kHz",
                                  "spindle.torque_constant_Nm_per_A=0.5",
                                  "spindle.inertia_kg_m2=0.005",
                                  "spindle.viscous_friction_Nm_s_per_rad=0.001",
                                  "spindle.coulomb_friction_Nm=0.1",
                                  "spindle.encoder_counts_per_rev=17bit",
                                  "spindle.counter_bits=17",
                                  "spindle.rated_power_W=4kW",
                                  "tool.teeth=4",
                                  "tool.diameter_m=16mm",
                                  "axis.z.vertical=yes",
                                  "axis.z.moving_mass_kg=150",
                                  "monitor.chatter.chatter_threshold_Nm2=0.02",
                                  "monitor.collision.threshold_N_per_s=50000",
                                  "monitor.collision.cutting_torque_Nm=0.2",
                                  "monitor.ar-breakage.noise_Nm=0.01",
                                  "monitor.tooth-breakage.noise_Nm=0.01",
                                  "monitor.tooth-breakage.sample_noise_Nm=0.1"};
  for (const std::string axis : {"axis.x", "axis.y", "axis.z"})
    for (const char* key :
         {".lead_m=16mm", ".equivalent_mass_kg=200", ".viscous_friction_N_s_per_m=700",
          ".coulomb_friction_N=90", ".torque_constant_Nm_per_A=0.8",
          ".encoder_counts_per_rev=20bit", ".counter_bits=20"})
      all.push_back(axis + key);
  return all;
}

/// What a file without `left_out` plans for drives that report counts and currents (or efforts).
struct Planned {
  bool ok = false;
  std::string error;
  StackPlan plan;
  std::string costs;
  [[nodiscard]] const MonitorAvailability* monitor(MonitorId id, Channel channel) const {
    for (const MonitorAvailability& m : plan.monitors)
      if (m.monitor == id && m.channel == channel) return &m;
    return nullptr;
  }
  [[nodiscard]] bool runs(MonitorId id, Channel channel) const {
    const auto* const m = monitor(id, channel);
    return m != nullptr && m->runs;
  }
  [[nodiscard]] bool reason(MonitorId id, Channel channel, const char* part) const {
    const auto* const m = monitor(id, channel);
    return m != nullptr && contains(m->reason, part);
  }
};

Planned without(const std::string& left_out, EffortKind x_effort = EffortKind::current_A) {
  std::vector<SheetEntry> entries;
  for (const std::string& set : whole_sheet()) {
    // A torque constant without its lead is refused, a diameter is one key of two.
    const bool with_lead = left_out == "axis.x.lead_m" && set.starts_with("axis.x.torque_constant");
    if (left_out.empty() || !(set.starts_with(left_out + "=") || with_lead))
      entries.push_back(*sheet_entry_from(set));
  }
  const SheetReport report = work_out(entries, "", "sheet.ini");
  Planned p;
  CHECK(report.faults.empty());
  for (const auto& m : report.missing)
    if (m.section + "." + m.key == left_out) p.costs = m.costs;
  check::that(left_out.empty() || !p.costs.empty(), (left_out + " is told to be missing").c_str(),
              __FILE__, __LINE__);
  if (left_out.empty()) CHECK(report.missing.empty());
  StackSignals signals;
  signals.sample_period_s = 1.0 / 8000;
  signals.spindle = DriveSignal{MotionKind::counts, EffortKind::current_A};
  for (auto& axis : signals.axis) axis = DriveSignal{MotionKind::counts, EffortKind::current_A};
  signals.axis[0]->effort = x_effort;
  auto plan = plan_stack(report.machine, signals);
  p.ok = plan.has_value();
  if (plan)
    p.plan = std::move(*plan);
  else
    p.error = plan.error().sentence;
  check::that(p.ok, (left_out + ": " + p.error).c_str(), __FILE__, __LINE__);
  return p;
}

void costs_are_true() {
  using enum MonitorId;
  constexpr Channel x = Channel::x, z = Channel::z, spindle = Channel::spindle,
                    tool = Channel::tool;
  const Planned all = without("");
  CHECK(all.runs(chatter, spindle) && all.runs(collision, x) && all.runs(collision, z));
  CHECK(all.runs(ar_breakage, tool) && all.runs(tooth_breakage, tool));

  Planned p = without("spindle.torque_constant_Nm_per_A");
  CHECK(!p.plan.config.spindle.present &&
        p.reason(chatter, spindle, "needs torque_constant_Nm_per_A"));
  p = without("spindle.encoder_counts_per_rev");
  CHECK(!p.plan.config.spindle.present &&
        p.reason(chatter, spindle, "needs encoder_counts_per_rev"));
  p = without("spindle.inertia_kg_m2");
  CHECK(!p.runs(chatter, spindle) && p.reason(chatter, spindle, "every acceleration for a cut"));
  CHECK(p.plan.config.spindle.observer.drive.inertia == 0);
  CHECK(all.plan.config.spindle.observer.drive.viscous > 0 &&
        all.plan.config.spindle.observer.drive.coulomb > 0);
  CHECK(
      without("spindle.viscous_friction_Nm_s_per_rad").plan.config.spindle.observer.drive.viscous ==
      0);
  CHECK(without("spindle.coulomb_friction_Nm").plan.config.spindle.observer.drive.coulomb == 0);
  CHECK(all.plan.config.spindle.input.counter_bits == 17);
  CHECK(without("spindle.counter_bits").plan.config.spindle.input.counter_bits == 32);

  p = without("axis.x.torque_constant_Nm_per_A");
  CHECK(!p.plan.config.axis[0].present && p.reason(collision, x, "needs torque_constant_Nm_per_A"));
  p = without("axis.x.lead_m");
  CHECK(!p.plan.config.axis[0].present &&
        p.reason(collision, x, "needs lead_m to turn encoder counts"));
  p = without("axis.x.encoder_counts_per_rev");
  CHECK(!p.plan.config.axis[0].present && p.reason(collision, x, "needs encoder_counts_per_rev"));
  p = without("axis.x.equivalent_mass_kg");
  CHECK(!p.runs(collision, x) && p.reason(collision, x, "every acceleration for a contact"));
  CHECK(without("axis.x.viscous_friction_N_s_per_m").plan.config.axis[0].observer.drive.viscous ==
        0);
  CHECK(without("axis.x.coulomb_friction_N").plan.config.axis[0].observer.drive.coulomb == 0);
  CHECK(without("axis.x.counter_bits").plan.config.axis[0].input.counter_bits == 32);
  // Gravity: 150 kg; without the mass that it pulls at, the 200 kg; lying flat, nothing.
  const auto load = [](const Planned& planned) {
    return planned.plan.config.axis[2].observer.drive.constant_load;
  };
  CHECK_NEAR(std::abs(load(all)), 150 * 9.80665, 1e-6);
  CHECK_NEAR(std::abs(load(without("axis.z.moving_mass_kg"))), 200 * 9.80665, 1e-6);
  CHECK(load(without("axis.z.vertical")) == 0);
  p = without("tool.teeth");
  CHECK(!p.runs(ar_breakage, tool) && !p.runs(tooth_breakage, tool) &&
        p.reason(ar_breakage, tool, "teeth in [tool]"));
  CHECK(all.reason(collision, x, "torque cannot explain") &&
        !without("tool.diameter_m").reason(collision, x, "torque cannot explain"));
  without("spindle.rated_power_W");  // monitor's sentence: tests/cli/test_every_key.cpp changes it
  without("machine.sample_rate_hz");

  std::string sets;
  for (const std::string& set : whole_sheet())
    if (!set.starts_with("machine.sample_rate_hz")) sets += " --set " + set;
  const Outcome o = run("init --out norate.ini" + sets);
  that(o.status == 0, o, "works", __LINE__);
  refused("export --c norate.ini --out norate.h", 3, {"needs sample_rate_hz"}, __LINE__);
}

// ---- the way on --------------------------------------------------------------------------------

// A machine that is none of the class's, in its own file for the simulator; its data sheet says
// what data sheets say. What an idling run finds has to be the machine, not the guess.
const char* const kTruth = R"([machine]
sample_rate_hz = 8000
[spindle]
torque_constant_Nm_per_A = 0.62
inertia_kg_m2 = 0.0081
viscous_friction_Nm_s_per_rad = 9e-4
coulomb_friction_Nm = 0.21
encoder_counts_per_rev = 131072
[controller.spindle]
velocity_gain_A_s_per_rad = 2.5
velocity_integral_per_s = 20
current_limit_A = 80
current_noise_A = 0.02
[axis.x]
lead_m = 0.016
equivalent_mass_kg = 161
viscous_friction_N_s_per_m = 1240
coulomb_friction_N = 171
torque_constant_Nm_per_A = 0.8
encoder_counts_per_rev = 1048576
[controller.x]
position_gain_per_s = 40
velocity_gain_A_s_per_m = 150
velocity_integral_per_s = 60
current_limit_A = 40
current_noise_A = 0.02
)";

void an_idling_run_replaces_the_guesses() {
  put("truth.ini", kTruth);
  std::string moves = "x limits 0.5 3 100\nx start 0\nspindle limits 900 2000 1e6\n";
  for (int lap = 0; lap < 3; ++lap)
    moves +=
        "x move 0.3 0.3\nx dwell 0.2\nx move 0 0.1\nx dwell 0.2\nx move 0.2 0.02\nx move 0 0.2\n"
        "spindle cruise 300 1\nspindle cruise 800 1\nspindle cruise 100 1\n";
  put("moves.txt", moves);
  const Outcome simulated =
      run("simulate drive --machine truth.ini --motion moves.txt --out idle.csv");
  that(simulated.status == 0, simulated, "works", __LINE__);
  const Outcome o =
      run("init --out sheet.ini --class small-mill --set machine.sample_rate_hz=8kHz "
          "--set spindle.encoder_counts_per_rev=17bit --set 'spindle.torque_constant_Nm_per_A=62 "
          "Ncm/A' "
          "--set axis.x.lead_m=16mm --set axis.x.encoder_counts_per_rev=20bit "
          "--set 'axis.x.torque_constant_Nm_per_A=0.8 Nm/A'");
  that(o.status == 0, o, "works", __LINE__);
  CHECK(contains(content(folder / "sheet.ini"),
                 "equivalent_mass_kg = 227  # guess: typical of small-mill"));
  const Outcome idle = run("identify idle --machine sheet.ini --trace idle.csv --out known.ini");
  that(idle.status == 0, idle, "works", __LINE__);
  const struct {
    const char *section, *key;
    double truth, within;
  } found[] = {
      {"spindle", "inertia_kg_m2", 0.0081, 0.02},
      {"spindle", "viscous_friction_Nm_s_per_rad", 9e-4, 0.05},
      {"spindle", "coulomb_friction_Nm", 0.21, 0.05},
      {"axis.x", "equivalent_mass_kg", 161, 0.02},
      {"axis.x", "viscous_friction_N_s_per_m", 1240, 0.05},
      {"axis.x", "coulomb_friction_N", 171, 0.05},
  };
  for (const auto& f : found) {
    check::near(value("known.ini", f.section, f.key) / f.truth, 1, f.within, f.key, __FILE__,
                __LINE__);
    CHECK(std::abs(value("sheet.ini", f.section, f.key) / f.truth - 1) > 2 * f.within);
  }
  // Its comments go with the guess; y and z, which did not move, keep theirs.
  const std::string known = content(folder / "known.ini");
  CHECK(contains(known, "[axis.y]\nequivalent_mass_kg = 325  # guess"));
  CHECK(!contains(part_between(known, "[spindle]", "["), "guess"));
  CHECK(!contains(part_between(known, "[axis.x]", "["), "guess"));
  CHECK(contains(part_between(known, "[axis.x]", "["), "# given: 16mm"));
  for (const char* command :
       {"monitor --machine known.ini --trace idle.csv", "export --c known.ini --out known.h",
        "export --c sheet.ini --out sheet.h", "monitor --machine sheet.ini --trace idle.csv"}) {
    const Outcome next = run(command);
    that(next.status == 0, next, "reads the file", __LINE__);
  }
}

void tests() {
  the_example_of_the_page();
  as_json();
  refusals();
  questions();
  on_a_terminal();
  costs_are_true();
  an_idling_run_replaces_the_guesses();
}

}  // namespace

int main() { return program_test::in_own_folder("init", tests); }
