// servosense program predict: its table, its options, its refusals.
#include <cmath>
#include <string>

#include "check.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

std::vector<std::string> fields(const std::string& row) {
  std::vector<std::string> f;
  std::stringstream in(row);
  for (std::string field; std::getline(in, field, ',');) f.push_back(field);
  return f;
}

void table() {
  put("mill.ini",
      "[tool.3]\nkind = flat\ndiameter_m = 0.01\nteeth = 4\n[axis.x]\nmax_velocity_m_s = 0.5\n"
      "[axis.y]\nmax_velocity_m_s = 0.5\n[axis.z]\nmax_velocity_m_s = 0.5\n");
  // A quarter of the diameter on the left of the feed.
  put("side.ngc",
      "G21 G90 G17\nT3 M6\nS6000 M3\nG0 Z5\nG0 X-10 Y-2.5\nG0 Z-3\nG1 X50 F1200\nG0 Z5\nM2\n");
  const std::string command =
      "program predict side.ngc --machine mill.ini --stock box:0,0,-0.01,0.04,0.03,0";
  const Outcome o = run(command + " --out side.csv --json");
  that(o.status == 0 &&
           contains(o.err, "torque of tool 3 is not predicted: give [tool.3] torque_equation"),
       o, "says what it leaves out", __LINE__);
  const Json json(o.out);
  CHECK_NEAR(json.number("removed_volume_m3"), 2.5 * 3 * 40e-9, 1e-3 * 300e-9);
  CHECK(json.number("removed_volume_error_m3") < 1e-3 * 300e-9);
  CHECK_TEXT(json.text("tools.0"), "3");
  CHECK_NEAR(json.number("greatest_axial_depth_m"), 0.003, 1e-7);

  const std::vector<std::string> rows = lines(content(folder / "side.csv"));
  CHECK(rows.size() > 30);
  CHECK(
      rows[0].starts_with("line,t_s,removed_m3,axial_depth_m,radial_immersion_m,entry_deg,"
                          "exit_deg,contact_m2,spindle.torque_Nm,low_Nm,high_Nm,"));
  double removed = 0, before_s = 0;
  int steady = 0;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const auto f = fields(rows[i] + " ");
    CHECK(f.size() == 38);
    if (f.size() != 38) continue;
    const double t_s = std::stod(f[1]);
    CHECK(t_s >= before_s);
    before_s = t_s;
    removed += std::stod(f[2]);
    if (f[0] != "7" || !(std::stod(f[2]) > 0)) continue;
    CHECK(f[8] == "nan" && f[9] == "nan" && f[10] == "nan");
    if (t_s < 1 || t_s > 2) continue;  // 60 mm at 20 mm/s
    ++steady;
    CHECK_NEAR(std::stod(f[3]), 0.003, 1e-7);
    CHECK_NEAR(std::stod(f[4]), 0.0025, 1e-6);
    CHECK_NEAR(std::stod(f[5]), 0, 0.5);
    CHECK_NEAR(std::stod(f[6]), 60, 0.5);
    CHECK_NEAR(std::stod(f[7]) * 1e6, 5 * 3.14159265 / 3 * 3, 0.3);       // r acos(1 - a / r) b
    CHECK_NEAR(std::stod(f[13]), 5e-5 * std::sin(3.14159265 / 3), 1e-6);  // 20 mm/s, 400 teeth/s
    CHECK(f[14] == "3");
  }
  CHECK(steady > 10);
  CHECK_NEAR(removed, json.number("removed_volume_m3"), 1e-15);

  // A changed feed changes times and chips, nothing else; a spindle that turns the other way
  // enters where it left.
  put("slow.ngc",
      "G21 G90 G17\nT3 M6\nS6000 M4\nG0 Z5\nG0 X-10 Y-2.5\nG0 Z-3\nG1 X50 F600\nG0 Z5\nM2\n");
  const Outcome slow = run(
      "program predict slow.ngc --machine mill.ini --stock box:0,0,-0.01,0.04,0.03,0 --quiet --out "
      "slow.csv");
  that(slow.status == 0 && slow.err.empty(), slow, "works", __LINE__);
  const auto slow_rows = lines(content(folder / "slow.csv"));
  CHECK(slow_rows.size() == rows.size());
  for (std::size_t i = 1; i < std::min(rows.size(), slow_rows.size()); ++i) {
    const auto a = fields(rows[i] + " "), b = fields(slow_rows[i] + " ");
    for (const std::size_t k : {0U, 2U, 3U, 4U, 7U, 15U}) CHECK_TEXT(b[k], a[k]);
    CHECK_TEXT(b[5], a[6]);
    CHECK_TEXT(b[6], a[5]);
  }
}

void what_was_cut_before() {
  const std::string stock = " --machine mill.ini --stock box:0,0,-0.01,0.04,0.03,0 --quiet --json";
  const Outcome o = run("program predict side.ngc --after side.ngc" + stock);
  that(o.status == 0, o, "cuts after another program", __LINE__);
  CHECK_NEAR(Json(o.out).number("removed_volume_m3"), 0, 1e-15);
}

void what_collides() {
  put("short.ini",
      "[tool]\ndiameter_m = 0.01\nflute_length_m = 0.004\nstick_out_m = 0.006\nholder_diameter_m = "
      "0.03\n");
  put("deep.ngc", "G21 G90\nG0 Z5\nG0 X-30 Y15\nG0 Z-8\nG0 X10\nG1 X20 F100\nG0 Z5\nM2\n");
  const Outcome o =
      run("program predict deep.ngc --machine short.ini --stock box:0,0,-0.01,0.04,0.03,0 --quiet "
          "--json");
  const Json json(o.out);
  CHECK_TEXT(json.text("rapid_lines.0"), "5");
  CHECK_TEXT(json.text("holder_lines.0"), "5");
  CHECK_TEXT(json.text("holder_lines.1"), "6");
}

void refusals() {
  const std::string stock = " --stock box:0,0,-0.01,0.04,0.03,0";
  const std::string mill = " --machine mill.ini";
  put("a.ngc", "G21 G90\nT3 M6\nG0 Z5\nG1 A90 F100\nM2\n");
  refused("program predict a.ngc" + mill + stock, 3, {"a.ngc", "line 4", "axis a"}, __LINE__);
  put("g55.ngc", "G21 G90\nT3 M6\nG0 Z5\nG10 L2 P2 X10\nG55 G0 X0\nM2\n");
  refused("program predict g55.ngc" + mill + stock, 3, {"line 5", "work offset"}, __LINE__);
  put("t1.ngc", "G21 G90\nT1 M6\nG0 Z5\nM2\n");
  refused("program predict t1.ngc" + mill + stock, 3, {"[tool.1]", "diameter_m"}, __LINE__);
  put("bull.ini", "[tool]\nkind = bull\ndiameter_m = 0.01\n");
  refused("program predict t1.ngc --machine bull.ini" + stock, 3, {"bull.ini:1", "corner_radius_m"},
          __LINE__);
  refused("program predict side.ngc" + mill + " --stock box:0,0,1", 2, {"box:X0"}, __LINE__);
  refused("program predict side.ngc" + mill + " --stock cylinder:0,0,1,0,2", 2, {"Z0 is below"},
          __LINE__);
  refused("program predict side.ngc" + mill + " --stock absent.stl", 4, {"absent.stl"}, __LINE__);
  refused("program predict side.ngc" + mill + stock + " --tolerance 1e-7", 2, {"finest"}, __LINE__);
  refused("program predict side.ngc" + mill, 2, {"--stock"}, __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("program_predict", [] {
    table();
    what_was_cut_before();
    what_collides();
    refusals();
  });
}
