// From data sheets to machine files. Oracle: units and equations worked out here by hand, never the
// ones under test; random sheets are written with factors of their own and have to come back.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/io/data_sheet.hpp"
#include "servosense/io/machine_classes.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/io/sheet_figures.hpp"

using namespace servosense;

namespace {

const double kPiHere = std::acos(-1.0);

SheetReport report_of(const std::vector<std::string>& sets, const std::string& machine_class = {}) {
  std::vector<SheetEntry> entries;
  for (const std::string& text : sets) {
    auto entry = sheet_entry_from(text);
    CHECK(entry.has_value());
    if (entry) entries.push_back(*entry);
  }
  return work_out(entries, machine_class, "new.ini");
}

SheetReport sound(const std::vector<std::string>& sets, const std::string& machine_class = {}) {
  SheetReport report = report_of(sets, machine_class);
  for (const std::string& fault : report.faults)
    check::that(false, fault.c_str(), __FILE__, __LINE__);
  return report;
}

double number(const SheetReport& report, const char* section, const char* key) {
  return report.machine.number(section, key).value_or(std::nan(""));
}

bool says(const std::vector<std::string>& all, const std::string& part) {
  return std::any_of(all.begin(), all.end(), [&](const std::string& sentence) {
    return sentence.find(part) != std::string::npos;
  });
}

bool is_missing(const SheetReport& report, const std::string& key) {
  return std::any_of(report.missing.begin(), report.missing.end(),
                     [&](const auto& m) { return m.section + "." + m.key == key; });
}

void what_is_worked_out() {
  // A table of 180 kg, motor 10 kg cm2, screw 3.5 kg cm2, lead 10 mm: (2 pi / 0.01)^2 = 394784.176.
  const SheetReport a =
      sound({"axis.x.lead_m=10 mm", "axis.x.table_mass=180", "axis.x.motor_inertia=10 kg cm2",
             "axis.x.screw_inertia=3.5 kg cm2", "axis.x.rated_torque=2.3 Nm",
             "axis.x.rated_current=3.1 A", "axis.x.encoder_resolution=0.1 um"});
  CHECK_NEAR(number(a, "axis.x", "equivalent_mass_kg"), 180 + 1.35e-3 * 394784.1760435743, 1e-8);
  CHECK_NEAR(number(a, "axis.x", "moving_mass_kg"), 180, 0);
  CHECK_NEAR(number(a, "axis.x", "torque_constant_Nm_per_A"), 2.3 / 3.1, 1e-11);
  CHECK_NEAR(number(a, "axis.x", "encoder_counts_per_rev"), 100000, 1e-6);
  CHECK(a.derived.size() == 4);
  CHECK(says(a.remarks, "effective (rms) amperes"));
  CHECK(says(a.remarks, "rated point"));
  CHECK(!a.machine.has("axis.x", "motor_inertia"));
  // A belt of 2 to 1: the motor makes two turns for one of the screw, so the rotor counts
  // four times as much, the screw as before, and a turn of the motor has half the counts of a
  // scale.
  const SheetReport belt =
      sound({"axis.x.lead_m=10 mm", "axis.x.gear_ratio=2", "axis.x.table_mass=180",
             "axis.x.motor_inertia=10 kg cm2", "axis.x.screw_inertia=3.5 kg cm2",
             "axis.x.encoder_resolution=0.1 um"});
  CHECK_NEAR(number(belt, "axis.x", "lead_m"), 0.01, 0);
  CHECK_NEAR(number(belt, "axis.x", "gear_ratio"), 2, 0);
  CHECK_NEAR(number(belt, "axis.x", "encoder_counts_per_rev"), 50000, 1e-6);
  CHECK_NEAR(number(belt, "axis.x", "equivalent_mass_kg"),
             180 + (4 * 1e-3 + 3.5e-4) * 394784.1760435743, 1e-8);
  // Without its rotor a mass would be a fraction of what the motor feels: it is not worked out.
  const SheetReport bare = sound({"axis.x.lead_m=10 mm", "axis.x.table_mass=180"});
  CHECK(is_missing(bare, "axis.x.equivalent_mass_kg"));
  CHECK(says(
      sound({"axis.x.lead_m=10 mm", "axis.x.table_mass=180", "axis.x.motor_inertia=1e-3"}).remarks,
      "without the screw"));
  CHECK(says(sound({"axis.x.lead_m=10mm", "axis.x.screw_inertia=1e-3"}).remarks,
             "screw_inertia is not used"));

  // A spindle on a belt of 1.5: J = 0.02 + 0.004 * 2.25, Kt = 1.5 * 70 Nm / 50 A, 5000 lines * 4
  // * 1.5.
  const SheetReport spindle = sound({"spindle.gear_ratio=1.5", "spindle.motor_inertia=40 kg cm2",
                                     "spindle.load_inertia=0.02", "spindle.rated_torque=70 Nm",
                                     "spindle.rated_current=50 A", "spindle.rated_speed=1500 rpm",
                                     "spindle.encoder_counts_per_rev=5000 lines"});
  CHECK_NEAR(number(spindle, "spindle", "inertia_kg_m2"), 0.029, 1e-13);
  CHECK_NEAR(number(spindle, "spindle", "torque_constant_Nm_per_A"), 1.4, 1e-11);
  CHECK_NEAR(number(spindle, "spindle", "encoder_counts_per_rev"), 20000, 0);
  CHECK_NEAR(number(spindle, "spindle", "rated_power_W"), 70 * 50 * kPiHere, 1e-7);
  // A rotary table behind a worm of 90: 0.5 + 2e-4 * 8100.
  const SheetReport table = sound({"axis.a.gear_ratio=90", "axis.a.motor_inertia=2 kg cm2",
                                   "axis.a.load_inertia=0.5", "spindle2.rated_power=3 kW"});
  CHECK_NEAR(number(table, "axis.a", "inertia_kg_m2"), 2.12, 1e-11);
  CHECK_NEAR(number(table, "spindle2", "rated_power_W"), 3000, 0);
  CHECK(is_missing(table, "axis.a.torque_constant_Nm_per_A"));
  // The torque out of power and speed: 11 kW at 1500 rpm are 70.028 Nm.
  const SheetReport power = sound(
      {"spindle.rated_power=11 kW", "spindle.rated_speed=1500 rpm", "spindle.rated_current=50 A"});
  CHECK_NEAR(number(power, "spindle", "torque_constant_Nm_per_A"), 11000 / (50 * kPiHere) / 50,
             1e-10);
  CHECK_NEAR(number(power, "spindle", "rated_power_W"), 11000, 0);
  // 47 V effective between phases at 1000 rpm: 3 (E / root 3) I = T w, so T / I = root 3 * E / w.
  const std::vector<std::string> volts = {"axis.x.lead_m=10mm",
                                          "axis.x.voltage_constant=47 V/1000rpm"};
  const double constant = std::sqrt(3.0) * 47 * 60 / (2000 * kPiHere);
  CHECK_NEAR(number(sound(volts), "axis.x", "torque_constant_Nm_per_A"), constant, 1e-11);
  // The same, told by its peak.
  CHECK_NEAR(number(sound({"axis.x.lead_m=10mm", "axis.x.voltage_constant=47 Vpk/krpm"}), "axis.x",
                    "torque_constant_Nm_per_A"),
             constant / std::sqrt(2.0), 1e-11);
  CHECK_NEAR(
      number(sound({"spindle.encoder_resolution=0.001 deg"}), "spindle", "encoder_counts_per_rev"),
      360000, 1e-5);
}

void effective_and_peak() {
  const double root = std::sqrt(2.0);
  const std::string lead = "axis.x.lead_m=10mm";
  const auto constant = [&](std::vector<std::string> more) {
    more.push_back(lead);
    return number(sound(more), "axis.x", "torque_constant_Nm_per_A");
  };
  CHECK_NEAR(constant({"axis.x.torque_constant_Nm_per_A=0.8 Nm/Arms"}), 0.8, 0);
  CHECK_NEAR(
      constant({"axis.x.torque_constant_Nm_per_A=0.8 Nm/Arms", "axis.x.reported_current=rms"}), 0.8,
      0);
  // The peak of a current is root 2 of it, so that there is less torque to one ampere of it.
  CHECK_NEAR(
      constant({"axis.x.torque_constant_Nm_per_A=0.8 Nm/Arms", "axis.x.reported_current=peak"}),
      0.8 / root, 1e-11);
  CHECK_NEAR(
      constant({"axis.x.torque_constant_Nm_per_A=0.8 Nm/Apk", "axis.x.reported_current=rms"}),
      0.8 * root, 1e-11);
  CHECK_NEAR(
      constant({"axis.x.rated_torque=2", "axis.x.rated_current=4", "axis.x.reported_current=peak"}),
      0.5 / root, 1e-11);
  const SheetReport limit =
      sound({lead, "controller.x.current_limit_A=12 Arms", "axis.x.reported_current=peak"});
  CHECK_NEAR(number(limit, "controller.x", "current_limit_A"), 12 * root, 1e-10);
  CHECK(limit.remarks.empty());
  CHECK(says(sound({lead, "controller.x.current_limit_A=12 Arms"}).remarks, "effective (rms)"));
  CHECK(sound({lead, "controller.x.current_limit_A=12 A"}).remarks.empty());
}

// Every fault, and one by one.
void all_faults_at_once() {
  const std::vector<std::pair<std::string, std::string>> wrong = {
      {"axix.x.lead_m=3mm", "nearest known one is [axis.x]"},
      {"axis.x.lead_mm=10", "nearest known one is 'lead_m'"},
      {"axis.x.motor_inertial=1", "nearest known one is 'motor_inertia'"},
      {"axis.y.lead_m=10kg", "[m], or another unit of that kind, found '10kg'"},
      {"spindle.inertia_kg_m2=-3", "check the sign"},
      {"axis.z.lead_m=10", "at most 1 [m]"},
      {"axis.z.vertical=maybe", "expected yes or no"},
      {"tool.teeth=2.5", "expected a whole number"},
      {"cut.direction=sideways", "the nearest is"},
      {"machine.name=a # b", "'#' begins a comment"},
      {"spindle.rated_current=", "has no value"},
      {"tool.throw_m=1um, 2kg", "found '2kg'"},
      {"monitor.collision.notch_hz=1kHz, 2kHz, 3kHz", "expected 1 to 2 numbers"},
      {"structure.x.modes=600 0.03", "expected triples"},
  };
  std::vector<std::string> all;
  for (const auto& [set, part] : wrong) {
    const SheetReport one = report_of({set, "axis.a1.x=1"});
    CHECK(one.faults.size() == 2);
    check::that(says(one.faults, part), (set + ": says " + part).c_str(), __FILE__, __LINE__);
    check::that(sheet_fault(*sheet_entry_from(set)) == one.faults[0], set.c_str(), __FILE__,
                __LINE__);
    CHECK(one.machine.text().empty());
    all.push_back(set);
  }
  CHECK(report_of(all).faults.size() == wrong.size());

  const std::vector<std::pair<std::vector<std::string>, std::string>> contradict = {
      {{"axis.x.lead_m=1mm", "axis.x.lead_m=2mm"}, "is given twice"},
      {{"axis.x.lead_m=1mm", "axis.x.torque_constant_Nm_per_A=1",
        "axis.x.force_constant_N_per_A=1"},
       "keep one"},
      {{"axis.x.torque_constant_Nm_per_A=1"}, "needs axis.x.lead_m"},
      {{"axis.x.lead_m=10mm", "axis.x.torque_constant_Nm_per_A=1", "axis.x.rated_torque=2",
        "axis.x.rated_current=3"},
       "gives 0.6667"},
      {{"axis.x.lead_m=10mm", "axis.x.force_constant_N_per_A=1000", "axis.x.rated_torque=2",
        "axis.x.rated_current=3"},
       "gives 418.9"},
      {{"axis.x.rated_torque=2", "axis.x.rated_power=1kW", "axis.x.rated_speed=3000rpm"},
       "gives 3.183"},
      {{"spindle.inertia_kg_m2=1", "spindle.motor_inertia=2"}, "gives 2"},
      {{"spindle.encoder_counts_per_rev=1000", "spindle.encoder_resolution=0.3 deg"}, "gives 1200"},
  };
  for (const auto& [sets, part] : contradict) {
    const SheetReport one = report_of(sets);
    CHECK(one.faults.size() == 1);
    check::that(says(one.faults, part), (sets[0] + ": says " + part).c_str(), __FILE__, __LINE__);
  }
  // 20 per cent are a rated point; just inside, nothing is said.
  CHECK(report_of({"axis.x.lead_m=10mm", "axis.x.torque_constant_Nm_per_A=0.79",
                   "axis.x.rated_torque=2", "axis.x.rated_current=3"})
            .faults.empty());
  CHECK(report_of({"axis.x.lead_m=10mm", "axis.x.torque_constant_Nm_per_A=0.81",
                   "axis.x.rated_torque=2", "axis.x.rated_current=3"})
            .faults.size() == 1);
  CHECK(says(report_of({}).faults, "nothing is known"));
  CHECK(says(sound({"tool.teeth=4"}).remarks, "no drive is known"));
  CHECK(report_of({"spindle.inertia_kg_m2=1"}, "mill").faults.size() == 1);
  CHECK(!sheet_entry_from("lead_m=3").has_value());
  CHECK(!sheet_entry_from("axis.x.lead_m").has_value());
  CHECK(!sheet_entry_from("=3").has_value());
  CHECK(!sheet_entry_from("axis.=3").has_value());
}

/// One entry a file, and what its sentence says: expected.txt.
void malformed_entries() {
  const std::string folder = "tests/data/malformed/sheet_value/";
  std::ifstream expected(folder + "expected.txt");
  std::size_t looked_at = 0;
  for (std::string row; std::getline(expected, row);) {
    if (row.starts_with('#')) continue;
    const std::string name = row.substr(0, row.find(" | "));
    const std::string part = row.substr(row.find(" | ") + 3);
    std::ifstream in(folder + name, std::ios::binary);
    const auto entry = sheet_entry_from(std::string(std::istreambuf_iterator<char>(in), {}));
    const std::string fault = entry ? sheet_fault(*entry) : entry.error().sentence;
    check::that(fault.find(part) != std::string::npos, (name + ": " + fault).c_str(), __FILE__,
                __LINE__);
    CHECK(fault.find('\n') == std::string::npos);
    ++looked_at;
  }
  CHECK(looked_at == 15);
}

// ---- random sheets -----------------------------------------------------------------------------

struct Way {
  const char* unit;
  double factor;
};
struct Figure {
  const char* section;
  const char* key;
  double low, high;  // in SI
  std::vector<Way> ways;
};

std::vector<Figure> figures() {
  const double rpm = 2 * kPiHere / 60;
  const std::vector<Way> mass = {{"", 1}, {"kg", 1}, {"g", 1e-3}, {"lb", 0.45359237}};
  const std::vector<Way> length = {
      {"", 1}, {"mm", 1e-3}, {"cm", 1e-2}, {"in", 0.0254}, {"um", 1e-6}};
  const std::vector<Way> friction = {{"", 1}, {"N s/m", 1}, {"kN/(m/s)", 1e3}, {"N/(m/min)", 60}};
  std::vector<Figure> all = {
      {"machine", "sample_rate_hz", 500, 20000, {{"", 1}, {"Hz", 1}, {"kHz", 1e3}}},
      {"spindle",
       "torque_constant_Nm_per_A",
       0.1,
       3,
       {{"", 1}, {"Nm/A", 1}, {"Ncm/A", 1e-2}, {"mNm/mA", 1}}},
      {"spindle",
       "inertia_kg_m2",
       1e-4,
       1,
       {{"", 1},
        {"kg cm2", 1e-4},
        {"g cm2", 1e-7},
        {"kgm2", 1},
        {"lb-in2", 0.45359237 * 0.0254 * 0.0254}}},
      {"spindle",
       "viscous_friction_Nm_s_per_rad",
       1e-5,
       1e-2,
       {{"", 1}, {"Nm/krpm", 1 / (1000 * rpm)}, {"mNm/rpm", 1e-3 / rpm}}},
      {"spindle",
       "coulomb_friction_Nm",
       0.01,
       3,
       {{"", 1}, {"Ncm", 1e-2}, {"oz-in", 0.45359237 / 16 * 9.80665 * 0.0254}}},
      {"spindle", "rated_power_W", 100, 30000, {{"", 1}, {"kW", 1e3}, {"PS", 75 * 9.80665}}},
      {"spindle",
       "max_speed_rpm",
       1000,
       30000,
       {{"", 1}, {"1/min", 1}, {"rad/s", 1 / rpm}, {"krpm", 1000}}},
      {"tool", "diameter_m", 0.002, 0.1, length},
      {"tool", "helix_deg", -45, 45, {{"", 1}, {"deg", 1}, {"rad", 180 / kPiHere}}},
      {"tool",
       "tangential_coefficient_N_per_m2",
       1e8,
       3e9,
       {{"", 1}, {"N/mm2", 1e6}, {"kN/mm2", 1e9}}},
      {"controller.spindle", "current_limit_A", 1, 100, {{"", 1}, {"A", 1}, {"mA", 1e-3}}},
      {"controller.spindle", "delay_s", 1e-5, 1e-3, {{"", 1}, {"us", 1e-6}, {"ms", 1e-3}}},
  };
  for (const char* axis : {"axis.x", "axis.y", "axis.z"}) {
    all.push_back({axis, "lead_m", 0.002, 0.05, length});
    all.push_back({axis, "equivalent_mass_kg", 20, 3000, mass});
    all.push_back({axis, "moving_mass_kg", 10, 2000, mass});
    all.push_back({axis, "viscous_friction_N_s_per_m", 10, 9000, friction});
    all.push_back({axis, "coulomb_friction_N", 1, 2000, {{"", 1}, {"kN", 1e3}, {"daN", 10}}});
    all.push_back(
        {axis, "torque_constant_Nm_per_A", 0.1, 3, {{"", 1}, {"Nm/A", 1}, {"kN mm/A", 1}}});
    all.push_back(
        {axis, "max_velocity_m_s", 0.1, 3, {{"", 1}, {"m/min", 1.0 / 60}, {"mm/s", 1e-3}}});
  }
  return all;
}

void random_sheets() {
  const unsigned seed = 20250611;
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const std::vector<Figure> all = figures();
  double worst = 0;
  std::size_t read = 0;
  for (int sheet = 0; sheet < 200; ++sheet) {
    std::vector<std::string> sets;
    std::vector<std::pair<const Figure*, double>> expected;
    for (const Figure& figure : all) {
      const bool needed = std::string(figure.key) == "lead_m";
      if (!needed && uniform(0, 1) < 0.3) continue;
      const Way& way = figure.ways[static_cast<std::size_t>(
          uniform(0, 0.999) * static_cast<double>(figure.ways.size()))];
      char digits[40];
      std::snprintf(digits, sizeof digits, "%.12g", uniform(figure.low, figure.high) / way.factor);
      const std::string gap = uniform(0, 1) < 0.5 ? " " : "";
      sets.push_back(std::string(figure.section) + "." + figure.key + "=" + digits + gap +
                     way.unit);
      expected.emplace_back(&figure, std::strtod(digits, nullptr) * way.factor);
    }
    std::shuffle(sets.begin(), sets.end(), random);
    const SheetReport report = sound(sets);
    CHECK(report.given.size() == sets.size() && report.guessed.empty() && report.derived.empty());
    const auto again = MachineFile::parse(report.machine.text(), "again.ini");
    CHECK(again.has_value());
    if (!again) continue;
    for (const auto& [figure, value] : expected) {
      const double got = again->number(figure->section, figure->key).value_or(std::nan(""));
      const double off = std::abs(got / value - 1);
      if (!(off < 1e-9))
        std::cout << "  seed " << seed << ", sheet " << sheet << ": " << figure->key << '\n';
      CHECK(off < 1e-9);
      worst = std::max(worst, off);
      ++read;
    }
  }
  CHECK(read > 4000);
  check::figure("worst relative error of a figure", worst);
}

// ---- classes, order, what is missing ------------------------------------------------------------

void classes() {
  std::set<std::string> seen;
  for (const MachineClass& c : machine_classes()) {
    const std::string name(c.name);
    const SheetReport report = sound({}, name);
    CHECK(!report.guessed.empty() && report.given.empty());
    for (const auto& guess : report.guessed) {
      CHECK(!guess.from.empty());
      seen.insert(guess.name);
      const std::string line = guess.name + " = " + guess.value + "  # guess: typical of " + name +
                               "; 'servosense identify idle' replaces it\n";
      check::that(report.machine.text().find(line) != std::string::npos, line.c_str(), __FILE__,
                  __LINE__);
    }
  }
  // What 'identify idle' writes, and nothing that scales a signal.
  CHECK(seen == (std::set<std::string>{"inertia_kg_m2", "viscous_friction_Nm_s_per_rad",
                                       "coulomb_friction_Nm", "equivalent_mass_kg",
                                       "viscous_friction_N_s_per_m", "coulomb_friction_N"}));
  // What is given or worked out is not guessed.
  const SheetReport report = sound({"spindle.inertia_kg_m2=0.5", "axis.x.lead_m=10mm",
                                    "axis.x.table_mass=50", "axis.x.motor_inertia=1e-3"},
                                   "small-mill");
  CHECK_NEAR(number(report, "spindle", "inertia_kg_m2"), 0.5, 0);
  CHECK_NEAR(number(report, "axis.x", "equivalent_mass_kg"), 50 + 394.7841760435743, 1e-8);
  CHECK_NEAR(number(report, "axis.y", "equivalent_mass_kg"), 325, 0);  // Koike 2016, table 3-5
  CHECK(report.guessed.size() == 10);
  // The parts that the other classes name: m + (J + pi/32 rho d^4 l) (2 pi / lead)^2, steel of
  // 7850.
  const auto of_parts = [](double table, double motor, double d, double length, double lead) {
    return table + (motor + kPiHere / 32 * 7850 * std::pow(d, 4) * length) *
                       std::pow(2 * kPiHere / lead, 2);
  };
  const auto typical = [](const char* machine_class, const char* section, const char* key) {
    for (const TypicalValue& t : typical_values())
      if (t.machine_class == machine_class && t.section == section && t.key == key) return t.value;
    return std::nan("");
  };
  const char* const mass = "equivalent_mass_kg";
  // Written to two digits.
  CHECK_NEAR(typical("machining-centre", "axis.x", mass) / of_parts(600, 30e-4, 0.04, 1, 0.012), 1,
             0.025);
  CHECK_NEAR(typical("lathe", "axis.x", mass) / of_parts(150, 20e-4, 0.025, 0.5, 0.006), 1, 0.025);
  CHECK_NEAR(typical("lathe", "axis.z", mass) / of_parts(400, 30e-4, 0.032, 1, 0.01), 1, 0.025);
  CHECK_NEAR(typical("router", "axis.x", mass) / of_parts(80, 1e-4, 0.025, 1.3, 0.02), 1, 0.025);
  CHECK_NEAR(typical("router", "axis.z", mass) / of_parts(15, 1e-4, 0.02, 0.4, 0.01), 1, 0.025);
}

void order_and_comments() {
  const SheetReport report = sound({"tool.teeth=4", "axis.x.encoder_counts_per_rev=20bit",
                                    "axis.x.lead_m=10mm", "spindle.inertia_kg_m2=12 kg cm2",
                                    "machine.name=mill 3", "machine.sample_rate_hz=8000"});
  CHECK_TEXT(report.machine.text(),
             "# From a data sheet, by 'servosense init'.\n\n"
             "[machine]\nname = mill 3  # given\nsample_rate_hz = 8000  # given\n\n"
             "[spindle]\ninertia_kg_m2 = 0.0012  # given: 12 kg cm2\n\n"
             "[axis.x]\nlead_m = 0.01  # given: 10mm\nencoder_counts_per_rev = 1048576  # given: "
             "20bit (2 to the power of 20)\n\n"
             "[tool]\nteeth = 4  # given\n");
}

/// Every key of the table can be set, whoever added it.
void every_key_of_the_table() {
  const auto machine = MachineFile::read("tests/data/machine/complete.ini");
  CHECK(machine.has_value());
  if (!machine) return;
  std::size_t set = 0;
  for (const std::string& section : machine->sections())
    for (const MachineKey& key : machine_keys()) {
      const auto value = machine->text(section, key.name);
      if (find_machine_key(section, key.name) != &key || !value) continue;
      const std::string fault = sheet_fault({section, std::string(key.name), *value});
      check::that(fault.empty(), fault.c_str(), __FILE__, __LINE__);
      ++set;
    }
  CHECK(set > 250);
}

void missing_ends() {
  SheetReport report = sound({"axis.z.vertical=yes"});
  CHECK(is_missing(report, "axis.z.moving_mass_kg") && !is_missing(report, "axis.z.vertical"));
  CHECK(!is_missing(report, "axis.z.counter_bits") && !is_missing(report, "tool.teeth"));
  // Each is told until it is given.
  std::vector<std::string> sets = {"axis.z.vertical=yes", "spindle.encoder_counts_per_rev=20bit",
                                   "axis.z.lead_m=10mm", "axis.z.encoder_counts_per_rev=20bit"};
  report = sound(sets);
  CHECK(report.missing.size() > 10);
  for (const auto& m : report.missing)
    sets.push_back(m.section + "." + m.key + "=" +
                   (m.key == "counter_bits" ? "20"
                    : m.key == "diameter_m" ? "0.01"
                                            : "2"));
  CHECK(sound(sets).missing.empty());
}

}  // namespace

int main() {
  what_is_worked_out();
  effective_and_peak();
  all_faults_at_once();
  malformed_entries();
  random_sheets();
  classes();
  order_and_comments();
  every_key_of_the_table();
  missing_ends();
  return check::done();
}
