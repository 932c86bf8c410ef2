// What the columns of a foreign table become: by their headings, by the other columns, by answers.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/io/import_plan.hpp"
#include "servosense/io/trace.hpp"

using namespace servosense;

namespace {

ImportMap answers(const std::vector<std::string>& texts) {
  ImportMap map;
  for (const std::string& text : texts) {
    auto entry = import_entry_from(text);
    CHECK(entry.has_value());
    if (entry) map.entries.push_back(*entry);
  }
  return map;
}

Expected<ImportPlan> plan_of(const std::string& text, const ImportMap& map = {}) {
  auto file = TableFile::from_stream(std::make_unique<std::istringstream>(text), "drive.csv",
                                     {map.separator, map.mark});
  if (!file) return file.error();
  return plan_import(*file, map);
}

/// "t_s x.current_A - ?", a question as a question mark.
std::string map_of(const ImportPlan& plan) {
  std::string text;
  for (const ImportColumn& c : plan.columns)
    text += (text.empty() ? "" : " ") + (c.is_open   ? "?"
                                         : c.is_time ? "t_s"
                                         : c.signal  ? column_name(*c.signal)
                                                     : "-");
  return text;
}

/// A table of `columns` whose rows a function makes.
std::string table(const std::string& heading, std::size_t rows,
                  const std::function<std::vector<double>(std::size_t)>& row) {
  std::ostringstream out;
  out.precision(12);
  out << heading << '\n';
  for (std::size_t i = 0; i < rows; ++i) {
    const auto fields = row(i);
    for (std::size_t k = 0; k < fields.size(); ++k) out << (k > 0 ? ";" : "") << fields[k];
    out << '\n';
  }
  return out.str();
}

std::string still(const std::string& heading) {
  const auto columns = 1 + std::count(heading.begin(), heading.end(), ';');
  return table(heading, 5, [&](std::size_t i) {
    std::vector<double> row(static_cast<std::size_t>(columns), 1.25);
    row[0] = static_cast<double>(i);
    return row;
  });
}

void maps(const std::string& heading, const std::string& expected) {
  const auto plan = plan_of(still("Zeit [ms];" + heading));
  CHECK(plan.has_value());
  if (!plan) return;
  CHECK_TEXT(map_of(*plan), "t_s " + expected);
  const bool asked = expected.find('?') != std::string::npos;
  CHECK(plan->questions.empty() != asked);
  if (plan->questions.empty() == asked) std::cout << "  " << heading << '\n';
}

void test_headings() {
  maps("Spindle speed [1/min]", "spindle.speed_rad_s");
  maps("I_q X (A)", "x.current_A");
  maps("Strom Z/A", "z.current_A");
  maps("X1_ActualVelocity [mm/s]", "x.velocity_m_s");
  maps("SpindleCurrent [A]", "spindle.current_A");
  maps("Frässpindel Drehmomentistwert [Nm]", "spindle.torque_Nm");
  maps("Lageistwert X [mm];Lagesollwert X [mm];Schleppfehler X [mm]",
       "x.position_m x.command_position_m -");
  maps("s actual X [mm];s nominal X [mm];I nominal X [A]",
       "x.position_m x.command_position_m x.command_current_A");
  maps("Gegenspindel Leistung [kW];S2 current [A]", "spindle2.power_W spindle2.current_A");
  maps(
      "Strom B-Achse [A];Temperatur [\xC2\xB0"
      "C]",
      "b.current_A -");
  maps("Kistler Fx [N];Hammer [N]", "dyno.force_x_N hammer.force_N");
  maps("Vorschub-Override [%];Satznummer;Spindle override [%]",
       "machine.feed_override machine.nc_block -");
  maps("Current position X [mm];X motor current [A]", "x.position_m x.current_A");
  maps("Id_X [A];Zwischenkreisspannung [V];X torque limit [Nm];Iq_X [A]", "- - - x.current_A");
  maps("B axis angle [deg];X encoder [inc]", "b.angle_rad ?");  // counts are whole
}

void test_questions() {
  maps("Strom [A]", "?");
  maps("Strom X", "?");
  maps("Strom X [LSB]", "?");
  maps("Strom X [mm]", "?");
  maps("Strom X [A];X current [A]", "? ?");
  maps("Axis 1 current [A];X2 current [A]", "? ?");
  maps("X frobnicated current [A]", "?");
  maps("X current RMS [A]", "?");
  maps("Fx [N];Kraft Y [N]", "? ?");
  maps("Spindle position [mm]", "?");
  maps("vel [deg/s]", "?");
  // Time without a unit, that stands, without a column.
  const auto unit = plan_of(still("t;Strom X [A]"));
  CHECK(unit && unit->questions.size() == 1);
  CHECK(unit && unit->questions[0].find("--column t_s=t:") != std::string::npos);
  const auto stands = plan_of("t [s];Strom X [A]\n0;1\n0.1;1\n0.1;1\n0.2;1\n");
  CHECK(stands && stands->questions.size() == 1);
  CHECK(stands && stands->questions[0].find("line 4") != std::string::npos);
  const auto none = plan_of("Strom X [A];Strom Y [A]\n1;2\n3;4\n");
  CHECK(none && none->questions.size() == 1);
  CHECK(none && none->questions[0].find("--rate") != std::string::npos);
  const auto fast = plan_of("t [us];Strom X [A]\n0;1\n0.001;1\n0.002;1\n");
  CHECK(fast && fast->questions.size() == 1);
}

/// A position in mm and its velocity, with the factors and headings given.
std::string moving(const std::string& heading, double per_mm, double per_mm_s, double per_s) {
  return table(heading, 400, [&](std::size_t i) {
    const double t = 0.002 * static_cast<double>(i);
    return std::vector{t * per_s, per_mm * (20 + 5 * std::sin(7 * t)),
                       per_mm_s * 35 * std::cos(7 * t)};
  });
}

void test_agreement() {
  const auto expect = [](const std::string& text, const std::string& map, std::size_t column,
                         const std::string& unit, std::size_t questions) {
    const auto plan = plan_of(text);
    CHECK(plan.has_value());
    if (!plan) return;
    CHECK_TEXT(map_of(*plan), map);
    CHECK_TEXT(plan->columns[column].unit, unit);
    CHECK(plan->questions.size() == questions);
    if (plan->questions.size() != questions) std::cout << "  " << text.substr(0, 60) << '\n';
    if (plan->questions.size() != questions)
      for (const std::string& question : plan->questions) std::cout << "  " << question << '\n';
  };
  const std::string both = "t_s x.position_m x.velocity_m_s";
  expect(moving("t [s];X pos [mm];X vel", 1, 60, 1), both, 2, "mm/min", 0);
  expect(moving("t [s];X pos;X vel [m/min]", 1e-3, 0.06, 1), both, 1, "m", 0);
  expect(moving("t;X pos [mm];X vel [mm/s]", 1, 1, 1000), both, 0, "ms", 0);
  // Neither is known; the headings contradict; a motor speed needs a lead.
  expect(moving("t [s];X pos;X vel", 1, 60, 1), "t_s ? ?", 1, "", 2);
  expect(moving("t [s];X pos [mm];X vel [mm/s]", 1, 60, 1), both, 2, "mm/s", 1);
  expect(moving("t [s];X pos [m];X vel [mm/s]", 1, 1, 1), both, 1, "m", 1);
  expect(moving("t [s];X pos;X speed [rpm]", 1, 6, 1), "t_s ? x.speed_rad_s", 1, "", 1);
  // An angle that begins anew with every turn, and the speed in rpm.
  const auto turning = [](const std::string& heading) {
    return table(heading, 600, [](std::size_t i) {
      const double t = 0.001 * static_cast<double>(i);
      const double rpm = 900 + 300 * std::sin(5 * t);
      const double turns = (900 * t - 60 * (std::cos(5 * t) - 1)) / 60;
      return std::vector{t, 360 * (turns - std::floor(turns)), rpm};
    });
  };
  expect(turning("t [s];Spindle angle [deg];Spindle speed"),
         "t_s spindle.angle_rad spindle.speed_rad_s", 2, "rpm", 0);
  expect(turning("t [s];Spindle angle;Spindle speed [rpm]"),
         "t_s spindle.angle_rad spindle.speed_rad_s", 1, "deg", 0);
  expect(turning("t [s];Spindle angle [deg];Spindle speed [rad/s]"),
         "t_s spindle.angle_rad spindle.speed_rad_s", 2, "rad/s", 1);
}

void test_ranges() {
  const auto plan = plan_of("t [s];Strom X [A]\n0;1500\n0.1;12000\n0.2;800\n");
  CHECK(plan && plan->questions.size() == 1);
  CHECK(plan && plan->questions[0].find("12000 A") != std::string::npos);
  CHECK(plan && plan->questions[0].find(":mA") != std::string::npos);
  // Said outright, it is a remark.
  const auto said = plan_of("t [s];Strom X [A]\n0;1500\n0.1;12000\n0.2;800\n",
                            answers({"x.current_A=Strom X:A"}));
  CHECK(said && said->questions.empty() && said->remarks.size() == 1);
  for (std::size_t i = 0; i < kQuantityNames.size(); ++i) {
    const QuantityRange range = range_of(static_cast<Quantity>(i));
    CHECK(range.least < range.greatest && *range.kind != '\0' && *range.source != '\0');
  }
}

void test_answers() {
  const std::string text = still("Zeit;Strom [A];Strom [A];A:B;X pos");
  ImportMap map = answers(
      {"t_s=Zeit:ms", "x.current_A=#2", "spindle.current_A=#3:mA", "-=X pos", "y.current_A=A:B:A"});
  const auto plan = plan_of(text, map);
  CHECK(plan.has_value());
  if (plan) {
    CHECK_TEXT(map_of(*plan), "t_s x.current_A spindle.current_A y.current_A -");
    CHECK(plan->questions.empty());
    CHECK_NEAR(plan->columns[2].greatest, 1.25e-3, 1e-18);
    // The map that is written gives the same again.
    const auto again = plan_of(text, plan->map);
    CHECK(again && map_of(*again) == map_of(*plan) && again->questions.empty());
  }
  const auto refused = [&](const std::vector<std::string>& said, const std::string& part) {
    const auto fault = plan_of(text, answers(said));
    CHECK(!fault);
    if (!fault && fault.error().sentence.find(part) == std::string::npos)
      CHECK_TEXT(fault.error().sentence, part);
  };
  refused({"x.current_A=Strim:A"}, "nearest one is 'Strom'");
  refused({"x.current_A=Strom:A"}, "#2 or #3");
  refused({"x.current_A=#9:A"}, "no column '#9'");
  refused({"x.current_A=#2:mm"}, "is no unit of x.current_A");
  refused({"x.current_A=#2:frob"}, "is no unit that is known");
  refused({"t_s=Zeit:mm"}, "no unit of time");
  refused({"x.current_A=#2:A", "x.current_A=#3:A"}, "given twice");
  for (const char* bad : {"x.curent_A=Strom", "q.current_A=Strom", "Strom", "x.current_A=", "=a"})
    CHECK(!import_entry_from(bad));
  CHECK(import_entry_from("x.curent_A=S").error().sentence.find("current_A") != std::string::npos);
  // A map that names what is not there says all of it.
  for (ImportEntry& entry : map.entries) entry.in_map = true;
  map.entries[0].from = "Time : ms";
  map.entries[4].from = "Last : %";
  const auto missing = plan_of(text, map);
  CHECK(!missing && missing.error().kind == ErrorKind::data);
  CHECK(!missing && missing.error().sentence.find("'Time', 'Last'") != std::string::npos);
}

void test_times() {
  const auto plan = [](const std::string& text) {
    auto found = plan_of(text);
    CHECK(found.has_value());
    return found ? *found : ImportPlan{};
  };
  // Since 1970, to the nanosecond; milliseconds by name; a clock over midnight, with its date.
  const ImportPlan epoch =
      plan("timestamp [ns];X current [A]\n1714564800123456789;1\n1714564800124456789;1\n");
  CHECK(epoch.questions.empty() && epoch.time.origin_ns == 1714564800123456789);
  CHECK_TEXT(epoch.time.origin, "2024-05-01T12:00:00.123456789Z");
  const ImportPlan by_name =
      plan("timestamp;X current [A]\n1714564800123;1\n1714564800124;1\n1714564800125;1\n");
  CHECK(by_name.questions.empty() && by_name.columns[0].unit == "ms");
  const ImportPlan midnight =
      plan("Uhrzeit;Strom X [A]\n23:59:59,9;1,5\n00:00:00,0;1,5\n00:00:00,1;1,5\n");
  CHECK(midnight.questions.empty());
  CHECK_NEAR(midnight.columns[0].greatest, 0.2, 1e-12);
  const ImportPlan beside =
      plan("Datum;Uhrzeit;Strom X [A]\n30.04.2024;23:59:59,9;1,5\n01.05.2024;00:00:00,0;1,5\n");
  CHECK(beside.questions.empty() && beside.time.origin == "2024-04-30T23:59:59.9");
  // A relative time stays as it is.
  const ImportPlan relative = plan("t [s];X current [A]\n-0.5;1\n0.5;1\n");
  CHECK(!relative.time.from_first && relative.columns[0].least == -0.5);
}

void test_map_text() {
  ImportMap map = answers({"x.current_A=Strom X [A] : A", "-=Strom Y"});
  map.separator = ';';
  map.mark = DecimalMark::comma;
  map.rate_hz = 8000;
  const std::string path = "/tmp/servosense_import_map_" + std::to_string(::getpid());
  std::ofstream(path) << import_map_text(map, "drive.csv");
  const auto again = read_import_map(path);
  CHECK(again.has_value());
  if (again) {
    CHECK(again->separator == ';' && again->mark == DecimalMark::comma && again->rate_hz == 8000.0);
    CHECK(again->entries.size() == 2 && again->entries[0].from == "Strom X [A] : A");
  }
  std::ofstream(path) << "separator = ;\nx.curent_A = Strom : A\n";
  const auto bad = read_import_map(path);
  CHECK(!bad && bad.error().sentence.find(":2: ") != std::string::npos);
  std::remove(path.c_str());
}

}  // namespace

int main() {
  test_headings();
  test_questions();
  test_agreement();
  test_ranges();
  test_answers();
  test_times();
  test_map_text();
  return check::done();
}
