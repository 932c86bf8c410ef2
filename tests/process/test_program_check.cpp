// Faults planted in sound programs, one at a time: each is found at its line and nothing else is;
// the sound programs have no finding. Sound programs are drawn: facing, slots, pockets on a helical
// ramp, contours with arcs, drilled holes, each with another stock, tool and feed.
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/process/motion/plain_time.hpp"
#include "servosense/process/program/program_reader.hpp"
#include "servosense/process/verification/program_check.hpp"
#include "servosense/process/verification/remainder.hpp"

namespace {

using namespace servosense::process;
using servosense::MachineFile;

constexpr const char* kMachine = R"([machine]
spindle_start_s = 0.5
[axis.x]
max_velocity_m_s = 0.4
[axis.y]
max_velocity_m_s = 0.4
[axis.z]
max_velocity_m_s = 0.3
[limits]
travel_x_m = -0.3 0.3
travel_y_m = -0.3 0.3
travel_z_m = -0.4 0.2
spindle_speed_rpm = 100 12000
feed_per_tooth_m = 0.0002
axial_depth_m = 0.006
[tool.1]
kind = flat
diameter_m = 0.01
flute_length_m = 0.022
stick_out_m = 0.035
holder_diameter_m = 0.04
teeth = 3
[tool.2]
kind = drill
diameter_m = 0.006
flute_length_m = 0.04
stick_out_m = 0.06
holder_diameter_m = 0.03
teeth = 2
[tool.3]
kind = face
diameter_m = 0.05
stick_out_m = 0.05
holder_diameter_m = 0.045
flute_length_m = 0.012
teeth = 5
[tool.4]
kind = ball
diameter_m = 0.006
flute_length_m = 0.015
stick_out_m = 0.03
holder_diameter_m = 0.02
teeth = 2
)";

constexpr const char* kTable = "T1 P1 Z80 D10\nT2 P2 Z110 D6\nT3 P3 Z60 D50\nT4 P4 Z70 D6\n";

struct Program {
  std::vector<std::string> lines;
  std::size_t add(const std::string& line) {
    lines.push_back(line);
    return lines.size();
  }
  [[nodiscard]] std::string text() const {
    std::string all;
    for (const std::string& line : lines) all += line + "\n";
    return all;
  }
};

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4f", value);
  return text;
}

/// 100 x 80 x 40 mm with its top at z = 0, tools of kMachine. What changes when a fault is planted.
struct Plan {
  double feed = 900, depth = 3, rpm = 6000, clearance = 5;
  std::mt19937_64 bits;
  explicit Plan(unsigned seed) : bits(seed) {
    feed = between(400, 1500), depth = between(1, 4), rpm = between(4000, 9000);
  }
  double between(double low, double high) {
    return std::uniform_real_distribution(low, high)(bits);
  }
};

/// Lines that a fault changes or stands before, by what happens there.
struct Places {
  std::size_t rapid_down = 0, spindle = 0, length = 0, cut = 0, plunge = 0;
};

Places tool(Program& p, int t, double rpm) {
  Places at;
  p.add("T" + std::to_string(t) + " M6");
  at.length = p.add("G43 H" + std::to_string(t));
  at.spindle = p.add("S" + number(rpm) + " M3");
  return at;
}

void head(Program& p) {
  p.add("(a sound program)");
  p.add("G21 G90 G17 G94");
}
void away(Program& p, double clearance) { p.add("G0 Z" + number(clearance + 40)); }
void end(Program& p, double clearance) {
  away(p, clearance);
  p.add("M2");
}

/// Slots along x from beside the part.
Places slots(Program& p, Plan& plan) {
  head(p);
  Places at = tool(p, 1, plan.rpm);
  const double y0 = plan.between(10, 25);
  for (int k = 0; k < 3; ++k) {
    const double y = y0 + 18 * k;
    p.add("G0 X-10 Y" + number(y));
    at.rapid_down = p.add("G0 Z" + number(plan.clearance));
    p.add("G1 Z" + number(-plan.depth) + " F" + number(plan.feed));
    at.cut = p.add("G1 X110");
    p.add("G0 Z" + number(plan.clearance));
  }
  end(p, plan.clearance);
  return at;
}

/// A pocket on a helical ramp, in rings.
Places pocket(Program& p, Plan& plan) {
  head(p);
  Places at = tool(p, 1, plan.rpm);
  const double x = plan.between(35, 65), y = plan.between(30, 50);
  p.add("G0 X" + number(x + 6) + " Y" + number(y));
  at.rapid_down = p.add("G0 Z" + number(plan.clearance));
  p.add("G1 Z0.5 F" + number(plan.feed));
  at.plunge =
      p.add("G3 X" + number(x + 6) + " Y" + number(y) + " I-6 J0 P3 Z" + number(-plan.depth));
  p.add("G3 X" + number(x + 6) + " Y" + number(y) + " I-6 J0");
  for (double r = 10; r < 19; r += 4) {
    p.add("G1 X" + number(x + r));
    at.cut = p.add("G3 X" + number(x + r) + " Y" + number(y) + " I" + number(-r) + " J0");
  }
  p.add("G0 Z" + number(plan.clearance));
  end(p, plan.clearance);
  return at;
}

/// Facing in one direction, around the part on the way back.
Places facing(Program& p, Plan& plan) {
  head(p);
  Places at = tool(p, 3, plan.rpm * 0.3);
  const double step = plan.between(20, 30);
  for (double y = 0; y < 80 + step; y += step) {
    p.add("G0 X-40 Y" + number(y));
    at.rapid_down = p.add("G0 Z" + number(plan.clearance));
    p.add("G1 Z" + number(-0.5 * plan.depth) + " F" + number(0.5 * plan.feed));
    const std::size_t cut = p.add("G1 X140");
    if (at.cut == 0) at.cut = cut;
    p.add("G0 Z" + number(plan.clearance));
  }
  end(p, plan.clearance);
  return at;
}

/// Holes on a grid with G81, then a groove by the ball end mill along a ramp.
Places holes(Program& p, Plan& plan) {
  head(p);
  tool(p, 2, plan.rpm * 0.5);
  p.add("G0 X10 Y10");
  p.add("G0 Z" + number(plan.clearance));
  for (int k = 0; k < 6; ++k)
    p.add("G81 X" + number(10 + 15 * k) + " Y" + number(plan.between(8, 30)) + " Z-15 R2 F" +
          number(0.3 * plan.feed));
  p.add("G80");
  away(p, plan.clearance);
  Places at = tool(p, 4, plan.rpm);
  p.add("G0 X15 Y60");
  at.rapid_down = p.add("G0 Z2");
  p.add("G1 Z0.5 F" + number(0.5 * plan.feed));
  at.plunge = p.add("G1 X80 Z-2");
  at.cut = p.add("G1 X15");
  p.add("G0 Z" + number(plan.clearance));
  end(p, plan.clearance);
  return at;
}

/// A contour around a boss: lines and quarter circles, in two depths, from beside the part.
Places contour(Program& p, Plan& plan) {
  head(p);
  Places at = tool(p, 1, plan.rpm);
  const double r = plan.between(4, 12);
  for (int k = 1; k <= 2; ++k) {
    p.add("G0 X-12 Y-12");
    at.rapid_down = p.add("G0 Z" + number(plan.clearance));
    p.add("G1 Z" + number(-plan.depth * k) + " F" + number(plan.feed));
    p.add("G1 X2 Y" + number(5 + r));
    p.add("G1 Y" + number(75 - r));
    p.add("G2 X" + number(2 + r) + " Y75 I" + number(r) + " J0");
    at.cut = p.add("G1 X" + number(98 - r));
    p.add("G2 X98 Y" + number(75 - r) + " I0 J" + number(-r));
    p.add("G1 Y" + number(5 + r));
    p.add("G2 X" + number(98 - r) + " Y5 I" + number(-r) + " J0");
    p.add("G1 X-12");
    p.add("G0 Z" + number(plan.clearance));
  }
  end(p, plan.clearance);
  return at;
}

struct Verdict {
  std::vector<Finding> findings;
  std::string error;
  double removed_m3 = 0;
};

struct Setting {
  std::string machine = kMachine;
  std::vector<BoxStock> fixtures;
  const Stock* target = nullptr;
};

Verdict verdict_on(const std::string& text, const Setting& setting = {}) {
  Verdict verdict;
  const auto machine = MachineFile::parse(setting.machine, "mill.ini");
  if (!machine) {
    verdict.error = machine.error().sentence;
    return verdict;
  }
  const auto limits = CheckLimits::from(*machine);
  if (!limits) {
    verdict.error = limits.error().sentence;
    return verdict;
  }
  MachineTools tools(*machine);
  constexpr double kSpacing = 4e-4;
  auto workpiece = *Workpiece::of(BoxStock{{0, 0, -0.04}, {0.1, 0.08, 0}}, kSpacing);
  ProgramCheck check(workpiece, tools, *limits);
  std::vector<Workpiece> solids;
  solids.reserve(setting.fixtures.size() + 1);
  for (const BoxStock& box : setting.fixtures) {
    solids.push_back(*Workpiece::of(box, kSpacing, Workpiece::Lines::upright));
    check.add_fixture(solids.back());
  }
  if (setting.target != nullptr) {
    solids.push_back(*Workpiece::of(*setting.target, kSpacing, Workpiece::Lines::upright));
    check.set_target(solids.back(), kTargetTolerance);
  }
  ProgramOptions options;
  options.tools = *tool_table_of(kTable, "tool.tbl");
  check.set_tool_table(*options.tools);
  std::vector<double> ends_s;
  PlainTime time(machine_motion(*machine).limits,
                 [&](const CanonicalMove&, double end_s) { ends_s.push_back(end_s); });
  (void)run_program(ProgramText::from(text, "part.ngc"), options,
                    [&](const CanonicalMove& move) { time.put(move); });
  check.set_times(std::move(ends_s));
  const auto read =
      run_program(ProgramText::from(text, "part.ngc"), options, [&](const CanonicalMove& move) {
        if (!verdict.error.empty()) return;
        if (const auto put = check.put(move); !put) verdict.error = put.error().sentence;
      });
  check.finish();
  if (!read) verdict.error = read.error().sentence;
  verdict.findings = check.findings();
  verdict.removed_m3 = check.removed_m3();
  if (setting.target != nullptr) {
    const auto whole = *Workpiece::of(*setting.target, kSpacing, Workpiece::Lines::upright);
    if (auto left = finding_of(remainder_of(workpiece, whole, kTargetTolerance), kTargetTolerance))
      verdict.findings.push_back(*left);
  }
  return verdict;
}

using Make = Places (*)(Program&, Plan&);
constexpr Make kMakes[] = {slots, pocket, facing, holes, contour};

void said(const Verdict& verdict) {
  for (const Finding& f : verdict.findings)
    std::printf("    line %zu to %zu: %s: %s\n", f.line, f.last_line,
                std::string(finding_name(f.kind)).c_str(), f.message.c_str());
}

int sound_programs(unsigned from, unsigned count) {
  int silent = 0;
  for (unsigned seed = from; seed < from + count; ++seed) {
    Program p;
    Plan plan(seed);
    kMakes[seed % std::size(kMakes)](p, plan);
    const Verdict verdict = verdict_on(p.text());
    CHECK_TEXT(verdict.error, "");
    CHECK(verdict.removed_m3 > 1e-8);
    CHECK(verdict.findings.empty());
    if (!verdict.findings.empty()) {
      std::printf("  sound program %u:\n", seed);
      said(verdict);
    }
    silent += verdict.findings.empty();
  }
  return silent;
}

/// A fault of a kind in a sound program: at which line it is found.
struct Planted {
  FindingKind kind;
  Make make;
  std::function<std::size_t(Program&, const Places&, Setting&)> plant;
};

std::string& line_of(Program& p, std::size_t line) { return p.lines[line - 1]; }

void replace(std::string& text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  CHECK(at != std::string::npos);
  if (at != std::string::npos) text.replace(at, from.size(), to);
}

std::vector<Planted> faults() {
  using enum FindingKind;
  const auto rapid_cut = [](Program& p, const Places& at, Setting& /*s*/) {
    std::string& line = line_of(p, at.cut);
    line = "G0" + line.substr(2);
    return at.cut;
  };
  const auto standing = [](Program& p, const Places& at, Setting& /*s*/) {
    replace(line_of(p, at.spindle), "M3", "M5");
    return std::size_t{0};
  };
  const auto backwards = [](Program& p, const Places& at, Setting& /*s*/) {
    replace(line_of(p, at.spindle), "M3", "M4");
    return std::size_t{0};
  };
  const auto no_length = [](Program& p, const Places& at, Setting& /*s*/) {
    line_of(p, at.length) = "G49";
    return std::size_t{0};
  };
  const auto other_length = [](Program& p, const Places& at, Setting& /*s*/) {
    line_of(p, at.length) = "G43 H2";
    return std::size_t{0};
  };
  const auto fixture = [](Program& /*p*/, const Places& /*at*/, Setting& s) {
    s.fixtures.push_back({{-0.03, 0, -0.02}, {-0.001, 0.08, 0.003}});
    return std::size_t{0};
  };
  const auto chip = [](Program& /*p*/, const Places& /*at*/, Setting& s) {
    replace(s.machine, "feed_per_tooth_m = 0.0002", "feed_per_tooth_m = 0.000005");
    return std::size_t{0};
  };
  const auto deep = [](Program& /*p*/, const Places& /*at*/, Setting& s) {
    replace(s.machine, "axial_depth_m = 0.006", "axial_depth_m = 0.0002");
    return std::size_t{0};
  };
  const auto fast = [](Program& /*p*/, const Places& /*at*/, Setting& s) {
    replace(s.machine, "spindle_speed_rpm = 100 12000", "spindle_speed_rpm = 100 1000");
    return std::size_t{0};
  };
  const auto narrow = [](Program& /*p*/, const Places& /*at*/, Setting& s) {
    replace(s.machine, "travel_x_m = -0.3 0.3", "travel_x_m = -0.3 0.055");
    return std::size_t{0};
  };
  const auto straight_down = [](Program& p, const Places& at, Setting& s) {
    // The end mill has no edges below its middle.
    replace(s.machine, "kind = flat", "ramp_angle_deg = 10\nkind = flat");
    line_of(p, at.plunge) = "G1 Z-1";
    return at.plunge;
  };
  const auto face_down = [](Program& p, const Places& at, Setting& /*s*/) {
    std::string& line = line_of(p, at.cut);
    line = "G1 X50";
    p.lines.insert(p.lines.begin() + static_cast<std::ptrdiff_t>(at.cut), "G1 Z-3");
    return at.cut + 1;
  };
  const auto short_flutes = [](Program& /*p*/, const Places& /*at*/, Setting& s) {
    replace(s.machine, "flute_length_m = 0.022", "flute_length_m = 0.0007");
    return std::size_t{0};
  };
  const auto short_tool = [](Program& /*p*/, const Places& /*at*/, Setting& s) {
    replace(s.machine, "flute_length_m = 0.022\nstick_out_m = 0.035",
            "flute_length_m = 0.0009\nstick_out_m = 0.00095");
    return std::size_t{0};
  };
  const auto sideways = [](Program& p, const Places& at, Setting& /*s*/) {
    // In place of the ball end mill.
    replace(line_of(p, at.length - 1), "T4", "T2");
    replace(line_of(p, at.length), "H4", "H2");
    return at.plunge;
  };
  const auto before_start = [](Program& p, const Places& at, Setting& /*s*/) {
    line_of(p, at.rapid_down) = "M5 G1" + line_of(p, at.rapid_down).substr(2) + " F500";
    p.lines.insert(p.lines.begin() + static_cast<std::ptrdiff_t>(at.rapid_down), "M3");
    return at.rapid_down;
  };
  const auto slow_start = [](Program& /*p*/, const Places& at, Setting& s) {
    replace(s.machine, "spindle_start_s = 0.5", "spindle_start_s = 600");
    return at.cut;
  };
  return {{rapid_into_material, slots, rapid_cut},
          {rapid_into_material, facing, rapid_cut},
          {spindle_stopped, slots, standing},
          {spindle_stopped, pocket, standing},
          {spindle_stopped, facing, standing},
          {spindle_stopped, contour, standing},
          {spindle_stopped, holes, standing},
          {spindle_wrong_way, slots, backwards},
          {spindle_wrong_way, pocket, backwards},
          {spindle_wrong_way, facing, backwards},
          {spindle_wrong_way, contour, backwards},
          {spindle_wrong_way, holes, backwards},
          {wrong_tool_length, slots, no_length},
          {wrong_tool_length, pocket, no_length},
          {wrong_tool_length, facing, other_length},
          {wrong_tool_length, contour, other_length},
          {wrong_tool_length, holes, no_length},
          {fixture_contact, slots, fixture},
          {fixture_contact, facing, fixture},
          {fixture_contact, contour, fixture},
          {chip_load, slots, chip},
          {chip_load, pocket, chip},
          {chip_load, facing, chip},
          {chip_load, contour, chip},
          {chip_load, holes, chip},
          {depth, slots, deep},
          {depth, pocket, deep},
          {depth, facing, deep},
          {depth, contour, deep},
          {spindle_speed, slots, fast},
          {spindle_speed, holes, fast},
          {overtravel, slots, narrow},
          {overtravel, pocket, narrow},
          {overtravel, facing, narrow},
          {overtravel, contour, narrow},
          {plunge, pocket, straight_down},
          {plunge, facing, face_down},
          {shank_contact, slots, short_flutes},
          {shank_contact, pocket, short_flutes},
          {holder_contact, slots, short_tool},
          {holder_contact, contour, short_tool},
          {drill_sideways, holes, sideways},
          {feed_before_spindle, slots, before_start},
          {feed_before_spindle, facing, before_start},
          {spindle_not_at_speed, facing, slow_start},
          {spindle_not_at_speed, pocket, slow_start}};
}

void planted(unsigned seed) {
  int found = 0, at_line = 0;
  const auto all = faults();
  for (std::size_t i = 0; i < all.size(); ++i) {
    Program p;
    Plan plan(seed + static_cast<unsigned>(i));
    const Places at = all[i].make(p, plan);
    Setting setting;
    const std::size_t line = all[i].plant(p, at, setting);
    const Verdict verdict = verdict_on(p.text(), setting);
    CHECK_TEXT(verdict.error, "");
    const auto hit = std::ranges::find(verdict.findings, all[i].kind, &Finding::kind);
    CHECK(hit != verdict.findings.end());
    const bool there = hit != verdict.findings.end() &&
                       (line == 0 || (hit->line <= line && line <= hit->last_line));
    CHECK(there);
    found += hit != verdict.findings.end(), at_line += there;
    if (!there) {
      std::printf("  %s, program %zu, line %zu:\n", std::string(finding_name(all[i].kind)).c_str(),
                  i, line);
      said(verdict);
    }
  }
  check::figure("faults planted", static_cast<double>(all.size()));
  check::figure("found", found);
  check::figure("at their line", at_line);
}

/// A slot of 10 x 3 mm in a box: the target of another depth is gouged, or something is left on it.
void targets() {
  Program p;
  Plan plan(1);
  plan.depth = 3;
  head(p);
  tool(p, 1, plan.rpm);
  p.add("G0 X-10 Y40");
  p.add("G0 Z5");
  p.add("G1 Z-3 F500");
  const std::size_t cut = p.add("G1 X110");
  p.add("G0 Z50");
  p.add("M2");
  // Two boxes on a floor, as one closed surface: the section, drawn along x.
  const auto target_of = [](double floor_mm, double half_mm) {
    const double y[] = {0, 0.04 - half_mm / 1e3, 0.04 + half_mm / 1e3, 0.08};
    const double f = -floor_mm / 1e3, low = -0.04;
    // Outline seen along x, counterclockwise.
    const std::array<std::array<double, 2>, 8> outline = {{{y[0], low},
                                                           {y[3], low},
                                                           {y[3], 0},
                                                           {y[2], 0},
                                                           {y[2], f},
                                                           {y[1], f},
                                                           {y[1], 0},
                                                           {y[0], 0}}};
    Mesh mesh;
    for (const double x : {0.0, 0.1})
      for (const auto& [py, pz] : outline) mesh.corners.push_back({x, py, pz});
    for (std::uint32_t i = 0; i < 8; ++i) {
      const std::uint32_t j = (i + 1) % 8;
      mesh.triangles.push_back({i, j, 8 + j});
      mesh.triangles.push_back({i, 8 + j, 8 + i});
    }
    // Ends: the U as three fans.
    const std::array<std::array<std::uint32_t, 3>, 6> end = {
        {{0, 5, 6}, {0, 6, 7}, {0, 1, 4}, {0, 4, 5}, {1, 2, 3}, {1, 3, 4}}};
    for (const auto& t : end) {
      mesh.triangles.push_back({8 + t[0], 8 + t[1], 8 + t[2]});
      mesh.triangles.push_back({t[0], t[2], t[1]});
    }
    return mesh;
  };
  const auto kinds = [&](const Mesh& mesh) {
    const Stock stock = mesh;
    Setting setting;
    setting.target = &stock;
    return verdict_on(p.text(), setting);
  };
  const Mesh same = target_of(3, 5);
  CHECK_NEAR(volume_of(same), 0.1 * 0.08 * 0.04 - 0.1 * 0.01 * 0.003, 1e-12);
  const Verdict right = kinds(same);
  CHECK_TEXT(right.error, "");
  CHECK(right.findings.empty());
  said(right);
  const Verdict gouged = kinds(target_of(2.9, 5));
  CHECK(gouged.findings.size() == 1);
  if (!gouged.findings.empty()) {
    CHECK(gouged.findings[0].kind == FindingKind::gouge);
    CHECK(gouged.findings[0].line == cut);
  }
  const Verdict narrow = kinds(target_of(3, 4.8));
  CHECK(narrow.findings.size() == 1 && narrow.findings[0].kind == FindingKind::gouge);
  const Verdict left = kinds(target_of(3.2, 5));
  CHECK(left.findings.size() == 1);
  if (!left.findings.empty()) {
    CHECK(left.findings[0].kind == FindingKind::uncut_remainder);
    // 0.2 mm less the tolerance, on the floor of the slot but for two lines beside its walls.
    CHECK_BETWEEN(left.findings[0].size, 0.1 * 0.0092 * 0.00015, 0.1 * 0.01 * 0.00015);
  }
  // Within the tolerance there is neither.
  CHECK(kinds(target_of(3.03, 5)).findings.empty());
  CHECK(kinds(target_of(2.97, 5)).findings.empty());
}

/// Side cuts in both directions: climb where the part is on the right of the feed, under M3.
void direction() {
  const auto changes = [](const std::string& cut) {
    const auto machine = MachineFile::parse(kMachine, "mill.ini");
    MachineTools tools(*machine);
    auto workpiece = *Workpiece::of(BoxStock{{0, 0, -0.04}, {0.1, 0.08, 0}}, 4e-4);
    ProgramCheck check(workpiece, tools, {});
    const std::string text =
        "G21 G90 G17\nT1 M6\nS5000 M3\nG0 X-10 Y-3\nG0 Z5\nG1 Z-2 F500\n" + cut + "G0 Z5\nM2\n";
    CHECK(run_program(ProgramText::from(text, "part.ngc"), {}, [&](const CanonicalMove& move) {
            CHECK(check.put(move).has_value());
          }).has_value());
    check.finish();
    return check.direction_changes();
  };
  CHECK(changes("G1 X110\n").empty());
  // There along the edge, and back one step further in: the other way.
  const auto back = changes("G1 X60\nG1 Y0\nG1 X-10\n");
  // On the way in already, where most of what stands around it is on its right.
  CHECK(back.size() == 1 && back[0] == 8);
  // Round a corner of the part it stays what it is.
  CHECK(changes("G1 X103\nG1 Y90\n").empty());
}

/// A slot of 3 mm by a tool whose length is not that in force: as deep as the tip then goes.
void lengths() {
  const auto slot = [](const std::string& offset, const std::string& measured) {
    Setting setting;
    if (!measured.empty()) replace(setting.machine, "[tool.1]", "[tool.1]\nlength_m = " + measured);
    return verdict_on("G21 G90 G17 G49\nT1 M6\nS5000 M3\nG0 X-10 Y40 Z100\n" + offset +
                          "\nG0 Z5\nG1 Z-3 F300\nG1 X110\nG0 Z50\nM2\n",
                      setting);
  };
  const Verdict right = slot("G43 H1", "");
  CHECK_TEXT(right.error, "");
  CHECK(right.findings.empty());
  CHECK_NEAR(right.removed_m3, 0.1 * 0.01 * 0.003, 2e-9);
  said(right);
  const auto deep = [&](const char* offset, const char* measured, double depth_mm) {
    const Verdict v = slot(offset, measured);
    CHECK_TEXT(v.error, "");
    CHECK_NEAR(v.removed_m3, 0.1 * 0.01 * depth_mm * 1e-3, 2e-9);
    const auto hit = std::ranges::find(v.findings, FindingKind::wrong_tool_length, &Finding::kind);
    CHECK(hit != v.findings.end());
    if (hit == v.findings.end()) return;
    CHECK_NEAR(hit->size * 1e3, std::abs(depth_mm > 0 ? depth_mm - 3 : 30), 1e-9);
    // In place on the whole cut: it tells the height of the tip there.
    CHECK(hit->line == 7 && hit->last_line == 8);
  };
  deep("G43.1 Z79", "", 4);
  deep("G43.1 Z82", "", 1);
  deep("G43 H1", "0.0805", 3.5);
  deep("G43 H2", "", 0);  // 30 mm above
  CHECK(slot("G43.1 Z80.5", "0.0805").findings.empty());
  // Without an offset the tip is 80 mm lower than programmed, and the holder beside the part.
  const Verdict none = slot("G4 P0", "");
  CHECK(std::ranges::find(none.findings, FindingKind::holder_contact, &Finding::kind) !=
        none.findings.end());
}

void refusals() {
  const auto machine = MachineFile::parse("[limits]\ntravel_x_m = 0.2 -0.1\n", "mill.ini");
  CHECK(machine.has_value());
  const auto limits = CheckLimits::from(*machine);
  CHECK(!limits);
  if (!limits) CHECK(limits.error().sentence.find("the least comes first") != std::string::npos);
}

}  // namespace

int main(int argc, char** argv) {
  // --nightly SEED: other programs; those of 1 to 10 and 5000 to 5099 were read one by one.
  const bool nightly = check::nightly(argc, argv);
  const unsigned seed = argc > 2 ? static_cast<unsigned>(std::strtoul(argv[2], nullptr, 10)) : 5000;
  const unsigned from = nightly ? seed : 1, count = nightly ? 100 : 10;
  check::figure("sound programs", count);
  check::figure("without a finding", sound_programs(from, count));
  planted(from);
  targets();
  direction();
  lengths();
  refusals();
  return check::done();
}
