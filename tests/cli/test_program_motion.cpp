// servosense program motion: its table, its options, its refusals.
#include <string>

#include "check.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

void table() {
  put("part.ngc",
      "%\nG21 G90 G17\nT1 M6\nS1200 M3\nG0 X10 Y20 Z5\nG1 Z-1 F300\n/G1 X10\nG2 X20 Y30 I10 J0\nG4 "
      "P0.5\n"
      "G33.1 Z-3 K1\n%\n");
  put("tool.tbl", "T1 P1 D6 Z50 ;end mill\n");
  put("mill.ini",
      "[axis.x]\nmax_velocity_m_s = 0.1\n[axis.y]\nmax_velocity_m_s = "
      "0.1\n[axis.z]\nmax_velocity_m_s = 0.1\n");
  const Outcome o = run(
      "program motion part.ngc --tools tool.tbl --machine mill.ini --block-delete --out part.csv");
  that(o.status == 0 && o.err.empty(), o, "works without a remark", __LINE__);
  // Worked out by hand: 20 mm of y at 0.1 m/s, 6 mm at 5 mm/s, a quarter of 62.8 mm at 5 mm/s.
  struct Row {
    const char *line, *kind;
    double t_s, x, y, z, feed, rpm;
  };
  const double arc_s = 1.4 + 3.14159265358979;
  const Row expected[] = {{"3", "tool", 0, 0, 0, 0, 0, 0},
                          {"5", "rapid", 0.2, 0.01, 0.02, 0.005, 0, 1200},
                          {"6", "feed", 1.4, 0.01, 0.02, -0.001, 0.005, 1200},
                          {"8", "arc", arc_s, 0.02, 0.03, -0.001, 0.005, 1200},
                          {"9", "dwell", arc_s + 0.5, 0.02, 0.03, -0.001, 0, 1200},
                          {"10", "feed", arc_s + 0.6, 0.02, 0.03, -0.003, 0.02, 1200},
                          {"10", "feed", arc_s + 0.7, 0.02, 0.03, -0.001, 0.02, -1200}};
  const std::vector<std::string> rows = lines(content(folder / "part.csv"));
  CHECK(rows.size() == 8);
  CHECK_TEXT(rows[0], "line,t_s,kind,x_m,y_m,z_m,feed_m_s,spindle_rpm,tool");
  for (std::size_t i = 0; i + 1 < rows.size() && i < std::size(expected); ++i) {
    std::vector<std::string> f;
    std::stringstream in(rows[i + 1]);
    for (std::string field; std::getline(in, field, ',');) f.push_back(field);
    const Row& e = expected[i];
    CHECK(f.size() == 9 && f[0] == e.line && f[2] == e.kind && f[8] == "1");
    if (f.size() != 9) continue;
    const double values[] = {e.t_s, e.x, e.y, e.z, e.feed, e.rpm};
    const std::size_t at[] = {1, 3, 4, 5, 6, 7};
    for (std::size_t k = 0; k < 6; ++k) CHECK_NEAR(std::stod(f[at[k]]), values[k], 1e-12);
  }
  const Outcome all = run("program motion part.ngc --json");
  that(all.status == 0, all, "works", __LINE__);
  that(contains(all.err, "no tool table") && contains(all.err, "how fast xyz can go"), all,
       "says what it does not know", __LINE__);
  const Json json(all.out);
  CHECK(json.ok && json.number("moves") == 8 && json.text("tools.0") == "1");
  CHECK_NEAR(json.number("x_m.1"), 0.02, 1e-15);
}

void with_acceleration() {
  put("way.ngc", "G61.1\nT1 M6\nG1 X100 F3000\nG0 X0\nM2\n");
  std::string limits = "[machine]\ntool_change_s = 3\n";
  for (const char* axis : {"x", "y", "z"})
    limits +=
        std::string("[axis.") + axis + "]\nmax_velocity_m_s = 0.1\nmax_acceleration_m_s2 = 0.5\n";
  put("quick.ini", limits);
  const auto seconds = [](const std::string& rest) {
    const Outcome o = run("program motion way.ngc --quiet --json " + rest);
    that(o.status == 0 && contains(o.out, "\"accelerated\": true"), o, "works", __LINE__);
    return Json(o.out).number("duration_s");
  };
  // 100 mm at 50 mm/s with 0.1 s for the ramps, back at 100 mm/s with 0.2 s; half of a servo period
  // at each of two stops.
  const double stops = 0.001;
  CHECK_NEAR(seconds("--machine quick.ini"), 3 + 2.1 + 1.2 + stops, 1e-9);
  CHECK_NEAR(seconds("--machine quick.ini --feed-override 50 --rapid-override 50"),
             3 + 4.05 + 2.1 + stops, 1e-9);
  // A spindle that starts takes time where feeds wait for it, from M3 on.
  put("turn.ngc", "G61.1\nS1000 M3\nG1 X100 F3000\nG0 X0\nM2\n");
  const std::string start = "spindle_start_s = 2.5\n";
  const auto turned = [&](const std::string& keys) {
    put("turn.ini", "[machine]\n" + keys + limits.substr(limits.find("[axis")));
    const Outcome o = run("program motion turn.ngc --quiet --json --machine turn.ini");
    return Json(o.out).number("duration_s");
  };
  CHECK_NEAR(turned("waits_for_spindle = yes\n" + start), 2.5 + 2.1 + 1.2 + stops, 1e-9);
  CHECK_NEAR(turned(start), 2.1 + 1.2 + stops, 1e-9);
  put("turn.ini", "[machine]\nwaits_for_spindle = yes\n");
  const Outcome unknown = run("program motion turn.ngc --machine turn.ini");
  that(contains(unknown.err, "feeds wait for the spindle, but how long is not known"), unknown,
       "says that waiting takes no time", __LINE__);
  std::string soft = limits;
  for (std::size_t at = 0; (at = soft.find("= 0.5\n", at)) != std::string::npos; at += 6)
    soft.insert(at + 6, "max_jerk_m_s3 = 10\n");
  put("soft.ini", soft);
  // A ramp takes a/j longer.
  CHECK_NEAR(seconds("--machine soft.ini"), 3 + 2.15 + 1.25 + stops, 1e-9);
  const Outcome out = run("program motion way.ngc --machine quick.ini --out way.csv --quiet");
  that(out.status == 0, out, "writes the table", __LINE__);
  const auto rows = lines(content(folder / "way.csv"));
  CHECK(rows.size() == 4);
  const double ends[] = {3, 5.1, 6.3005};
  for (std::size_t i = 0; i + 1 < rows.size() && i < std::size(ends); ++i)
    CHECK_NEAR(std::stod(rows[i + 1].substr(rows[i + 1].find(',') + 1)), ends[i], 1e-9);
  put("half.ini", "[axis.x]\nmax_velocity_m_s = 0.1\nmax_acceleration_m_s2 = 0.5\n");
  const Outcome half = run("program motion way.ngc --machine half.ini --json");
  that(half.status == 0 && contains(half.err, "how hard yz can accelerate is not known") &&
           contains(half.out, "\"accelerated\": false"),
       half, "says that times are without acceleration", __LINE__);
  refused("program motion way.ngc --feed-override 0", 2, {"--feed-override"}, __LINE__);
}

void offsets_and_dialect() {
  put("offset.ngc", "G53 G0 X0 Y0 Z0\nM2\n");
  put("mill.var", "5221 100\n5222 -50\n");
  const Outcome o = run("program motion offset.ngc --parameters mill.var --quiet --json");
  CHECK_NEAR(Json(o.out).number("x_m.0"), -0.1, 1e-15);
  put("fanuc.nc", "%\nO100\n#1=0\nWHILE[#1LT3]DO1\n#1=[#1+1]\nG0X#1\nEND1\nM30\n%\n");
  const Outcome f = run("program motion fanuc.nc --dialect fanuc --quiet --json");
  CHECK(Json(f.out).number("moves") == 3);
  put("cut.ngc", "O<slot> call [7]\nM2\n");
  put("slot.ngc", "O<slot> sub\nG0 X#1\nO<slot> endsub\n");
  const Outcome s = run("program motion cut.ngc --quiet --out cut.csv");
  that(s.status == 0, s, "finds the subroutine in its file", __LINE__);
  CHECK(contains(content(folder / "cut.csv"), "\n1,0,rapid,0.007,0,0,0,0,0\n"));
}

void refusals() {
  put("probe.ngc", "G0 X1\nG38.2 Z-5 F100\nM2\n");
  refused("program motion probe.ngc --out none.csv", 3, {"probe.ngc:2: ", "take probing out"},
          __LINE__);
  CHECK(!fs::exists(folder / "none.csv"));
  refused("program motion probe.ngc --json", 3, {"probe.ngc:2: "}, __LINE__);
  refused("program motion absent.ngc", 4, {"absent.ngc"}, __LINE__);
  refused("program motion probe.ngc --dialect iso", 2, {"linuxcnc or fanuc"}, __LINE__);
  refused("program motion", 2, {"program"}, __LINE__);
  put("bad.tbl", "T1\nT1\n");
  refused("program motion probe.ngc --tools bad.tbl", 3, {"bad.tbl:2: ", "twice"}, __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("program_motion", [] {
    table();
    with_acceleration();
    offsets_and_dialect();
    refusals();
  });
}
