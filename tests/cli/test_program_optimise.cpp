// servosense program optimise: what it gains and keeps, against cuts worked out by hand and in a
// grid of its own; words, modes and refusals.
#include <array>
#include <cmath>
#include <functional>
#include <random>
#include <regex>
#include <string>
#include <vector>

#include "check.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

constexpr double kPi = 3.14159265358979323846;
/// Steel of Bertok 1984, and limits.
constexpr double kK1 = 1.39, kK2 = 0.36, kK3 = 0.00316;
constexpr double kTorque_Nm = 12, kPower_W = 3000, kTooth_mm = 0.15;
constexpr double kRadius_mm = 8;
constexpr int kTeeth = 4;

const std::string kMill =
    "[tool]\nkind = flat\ndiameter_m = 0.016\nteeth = 4\ntorque_equation = 1.39 0.36 0.00316\n"
    "[limits]\ntorque_Nm = 12\npower_W = 3000\nfeed_per_tooth_m = 0.00015\nfeed_m_s = 0.1\n";
const std::string kAxes =
    "[axis.x]\nmax_velocity_m_s = 0.2\nmax_acceleration_m_s2 = 2\n[axis.y]\nmax_velocity_m_s = "
    "0.2\nmax_acceleration_m_s2 = 2\n[axis.z]\nmax_velocity_m_s = 0.2\nmax_acceleration_m_s2 = "
    "2\n";

/// Of V and S in mm2, f in mm a tooth.
double torque(double v, double s, double f) { return kK1 * v * f + (kK2 * f + kK3) * s; }
bool allowed(double v, double s, double feed_mm_min, double rpm) {
  const double f = feed_mm_min / (rpm * kTeeth), m = torque(v, s, f);
  return m <= kTorque_Nm && m * rpm * kPi / 30 <= kPower_W && f <= kTooth_mm;
}

std::string without_feeds(const std::string& text) {
  return std::regex_replace(text, std::regex("F[0-9.]+"), "");
}

/// Feeds in force at each line of a program without loops.
std::vector<double> feeds_of(const std::string& text) {
  std::vector<double> feeds;
  double feed = 0;
  for (const std::string& line : lines(text)) {
    std::smatch found;
    if (std::regex_search(line, found, std::regex("F([0-9.]+)"))) feed = std::stod(found[1]);
    feeds.push_back(feed);
  }
  return feeds;
}

/// Passes along x: slots, and side cuts that widen them, each a line.
void against_all_feeds(std::uint64_t first, int programs) {
  double least_share = 1e9, most = 0;
  for (int n = 0; n < programs; ++n) {
    std::mt19937_64 random(first + static_cast<std::uint64_t>(n));
    const auto between = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    const double rpm = std::round(between(1500, 5000));
    struct Pass {
      std::size_t line;
      double v, s, length;
    };
    std::vector<Pass> passes;
    std::string text =
        "G21 G90 G17 G61\nS" + std::to_string(static_cast<int>(rpm)) + " M3\nG0 Z5\n";
    std::size_t line = 3;
    const int count = 3;
    for (int i = 0; i < count; ++i) {
      const double depth = std::round(between(1, 9) * 100) / 100;
      const double y = 30 * i + 15, aside = std::round(between(0.5, 6) * 100) / 100;
      const auto pass = [&](double at, double v, double s) {
        char block[160];
        std::snprintf(block, sizeof block, "G0 X-10 Y%.2f\nG0 Z-%.2f\nG1 X70 F%.0f\nG0 Z5\n", at,
                      depth, between(100, 900));
        text += block;
        passes.push_back({line + 3, v, s, 80});
        line += 4;
      };
      pass(y, 2 * kRadius_mm * depth, kPi * kRadius_mm * depth);
      pass(y + aside, aside * depth, kRadius_mm * std::acos(1 - aside / kRadius_mm) * depth);
    }
    text += "M2\n";
    put("passes.ngc", text);
    put("plain.ini", kMill);
    const Outcome o = run(
        "program optimise passes.ngc --machine plain.ini --stock box:0,0,-0.02,0.06,0.09,0 --out "
        "faster.ngc --json --quiet --tolerance 0.0002");
    that(o.status == 0, o, "works", __LINE__);
    const Json json(o.out);
    const std::string faster = content(folder / "faster.ngc");
    CHECK_TEXT(without_feeds(faster), without_feeds(text));
    const auto before = feeds_of(text), after = feeds_of(faster);
    double before_s = 0, best_s = 0;
    for (const Pass& p : passes) {
      CHECK(allowed(p.v, p.s, after[p.line - 1], rpm));
      most = std::max(most, torque(p.v, p.s, after[p.line - 1] / (rpm * kTeeth)) / kTorque_Nm);
      double best = 1;
      for (double feed = 1; feed < 4000; feed += 1)
        if (allowed(p.v, p.s, feed, rpm)) best = feed;
      before_s += p.length / before[p.line - 1] * 60, best_s += p.length / best * 60;
    }
    CHECK_NEAR(json.number("time_before_s"), before_s, 1e-6 * before_s);
    // Against every whole feed for every block: what is gained, or what keeping the limits costs.
    const double gain = before_s - json.number("time_after_s"), gain_of_best = before_s - best_s;
    if (gain_of_best > 0)
      least_share = std::min(least_share, gain / gain_of_best);
    else
      CHECK_NEAR(gain, gain_of_best, 0.05 * std::abs(gain_of_best) + 0.01);
    CHECK(json.number("greatest_torque_Nm.value") <= kTorque_Nm * (1 + 1e-9));
  }
  check::figure("least share of the gain of trying every feed", 100 * least_share, "%");
  check::figure("greatest torque, of the limit", 100 * most, "%");
  CHECK(least_share > 0.95);
  CHECK(least_share < 1.01);
}

/// A pocket with an inner corner, cut in a grid of 0.1 mm: torque over each tenth of the radius
/// and more.
void independent_cut() {
  const std::string text =
      "G21 G90 G17 G61\nS3000 M3\nG0 Z5\nG0 X-10 Y15\nG0 Z-6\nG1 X45 F400\nG1 Y50\nG1 X20\nG1 "
      "Y22\nG1 X38\nG0 Z5\nM2\n";
  put("corner.ngc", text);
  put("mill.ini", kMill + kAxes);
  const Outcome o =
      run("program optimise corner.ngc --machine mill.ini --stock box:0,0,-0.02,0.06,0.07,0 --out "
          "quick.ngc --quiet --json");
  that(o.status == 0 && contains(o.out, "\"findings\": []"), o, "works, and finds nothing",
       __LINE__);
  const Json json(o.out);
  CHECK(json.number("time_after_s") < json.number("time_before_s"));
  const std::string quick = content(folder / "quick.ngc");
  CHECK_TEXT(without_feeds(quick), without_feeds(text));
  const auto feeds = feeds_of(quick);
  constexpr double cell = 0.1, depth = 6, rpm = 3000, step = 1.2;
  constexpr int nx = 600, ny = 700;
  std::vector<char> part(static_cast<std::size_t>(nx * ny), 1);
  const auto solid = [&](double x, double y) {
    const int i = static_cast<int>(std::floor(x / cell)),
              j = static_cast<int>(std::floor(y / cell));
    return i >= 0 && j >= 0 && i < nx && j < ny && part[static_cast<std::size_t>(i + nx * j)] != 0;
  };
  const double way[][2] = {{-10, 15}, {45, 15}, {45, 50}, {20, 50}, {20, 22}, {38, 22}};
  double worst = 0;
  for (std::size_t leg = 0; leg + 1 < std::size(way); ++leg) {
    const double dx = way[leg + 1][0] - way[leg][0], dy = way[leg + 1][1] - way[leg][1];
    const double length = std::hypot(dx, dy), f = feeds[5 + leg] / (rpm * kTeeth);
    for (double at = 0; at < length; at += step) {
      const double to = std::min(length, at + step);
      double contact = 0;
      const double mx = way[leg][0] + dx * (at + to) / 2 / length,
                   my = way[leg][1] + dy * (at + to) / 2 / length;
      for (double a = 0; a < 2 * kPi; a += 0.002)
        if (std::cos(a) * dx + std::sin(a) * dy > 0 &&
            solid(mx + (kRadius_mm + 0.05) * std::cos(a), my + (kRadius_mm + 0.05) * std::sin(a)))
          contact += 0.002 * kRadius_mm;
      int removed = 0;
      for (double s = at; s <= to + 1e-9; s += 0.1) {
        const double x = way[leg][0] + dx * s / length, y = way[leg][1] + dy * s / length;
        for (int j = std::max(0, static_cast<int>((y - 8) / cell));
             j < std::min(ny, static_cast<int>((y + 8) / cell) + 1); ++j)
          for (int i = std::max(0, static_cast<int>((x - 8) / cell));
               i < std::min(nx, static_cast<int>((x + 8) / cell) + 1); ++i) {
            char& c = part[static_cast<std::size_t>(i + nx * j)];
            if (c != 0 && std::hypot((i + 0.5) * cell - x, (j + 0.5) * cell - y) < kRadius_mm)
              c = 0, ++removed;
          }
      }
      const double v = removed * cell * cell * depth / (to - at);
      const double m = torque(v, contact * depth, f);
      worst = std::max({worst, m / kTorque_Nm, m * rpm * kPi / 30 / kPower_W, f / kTooth_mm});
    }
  }
  check::figure("highest use of a limit, in a grid", 100 * worst, "%");
  // A grid of 0.1 mm sees a slot of 16 mm to 2 %.
  CHECK_BETWEEN(worst, 0.9, 1.02);
}

/// What feeds of the new program are, by `program motion`, at its moves of a kind.
std::vector<double> motion_feeds(const std::string& file) {
  const Outcome o = run("program motion " + file + " --quiet --out motion.csv");
  that(o.status == 0, o, "reads the new program", __LINE__);
  std::vector<double> feeds;
  for (const std::string& row : lines(content(folder / "motion.csv"))) {
    std::vector<std::string> f;
    std::stringstream in(row);
    for (std::string field; std::getline(in, field, ',');) f.push_back(field);
    if (f.size() > 6 && (f[2] == "feed" || f[2] == "arc")) feeds.push_back(std::stod(f[6]) * 60000);
  }
  return feeds;
}

void modes() {
  // F stays in force: where a line changes it, the next needs its own. Threads keep theirs.
  const std::string text =
      "%\nG21 G90 G17 G61\nT1 M6 S1000 M3\nF120\nG0 X-12 Y10 Z2\nG0 Z-2\nG1 X70 (in air behind "
      "it)\n"
      "G0 Z2\nG0 X-12 Y30\nG0 Z-2\nG1 X10\nX70 ; on\nG0 Z5\nT2 M6 S300 M3\nG0 X30 Y50\nG84 Z-8 R2 "
      "F450\nG80\nG20\nT1 M6 S1000 M3\nG0 X-0.5 Y2\nG0 Z-0.1\nG1 X2.5 F5\n%\n";
  put("modes.ngc", text);
  put("modes.ini",
      "[tool]\ndiameter_m = 0.016\nteeth = 4\ntorque_equation = 1.39 0.36 0.00316\n[tool.2]\nkind "
      "= tap\ndiameter_m = 0.008\n[limits]\nfeed_per_tooth_m = 0.0001\n");
  const Outcome o =
      run("program optimise modes.ngc --machine modes.ini --stock box:0,0,-0.02,0.06,0.06,0 --out "
          "modes2.ngc --quiet --json");
  that(o.status == 0, o, "works", __LINE__);
  const std::string better = content(folder / "modes2.ngc");
  CHECK_TEXT(without_feeds(better), without_feeds(text));
  const auto feeds = motion_feeds("modes2.ngc");
  const std::vector<double> expected = {400, 400, 400, 450, 450, 400};  // 0.1 mm x 4 x 1000 rpm
  CHECK(feeds.size() == expected.size());
  for (std::size_t i = 0; i < std::min(feeds.size(), expected.size()); ++i)
    CHECK_NEAR(feeds[i], expected[i], 1e-4 * expected[i]);
  CHECK(contains(o.out, "its thread sets the feed"));

  // A loop: one line, one feed, that of its worst turn; G95 counts a revolution.
  put("loop.ngc",
      "G21 G90 G17 G61\nS1000 M3\nG0 X-12 Y10 Z2\n#1=2\nO1 while [#1 LT 9]\nG0 Z-#1\nG1 X70 "
      "F50\nG0 "
      "Z2\nG0 X-12\n#1=[#1+2]\nO1 endwhile\nG95\nG0 X-12 Y35\nG0 Z-2\nG1 X70 F0.1\nM2\n");
  put("loop.ini", kMill);
  const Outcome l =
      run("program optimise loop.ngc --machine loop.ini --stock box:0,0,-0.02,0.06,0.06,0 --out "
          "loop2.ngc --quiet --json");
  that(l.status == 0, l, "works", __LINE__);
  const auto turns = motion_feeds("loop2.ngc");
  CHECK(turns.size() == 5);
  for (std::size_t i = 1; i < 4 && i < turns.size(); ++i) CHECK_NEAR(turns[i], turns[0], 1e-9);
  // Each turn goes 2 mm deeper into a slot: 12 Nm at all feeds up to 0.15 mm a tooth.
  const double v = 32, s = 2 * kPi * kRadius_mm;
  const double f = std::min(kTooth_mm, (kTorque_Nm - kK3 * s) / (kK1 * v + kK2 * s));
  if (!turns.empty()) CHECK_NEAR(turns[0], f * 4000, 0.02 * f * 4000);
  if (turns.size() > 4) CHECK_NEAR(turns[4], f * 4000, 0.02 * f * 4000);
}

void short_moves() {
  // Moves of 1 mm from stop to stop: 2 m/s2 reach 45 mm/s at most, whatever F says.
  std::string text = "G21 G90 G17 G61.1\nS6000 M3\nG0 X-20 Y-20 Z5\n";
  for (int i = 0; i < 20; ++i)
    text += "G1 X" + std::to_string(-20 + (i % 2 == 0 ? 1 : 0)) + " Y" + std::to_string(-20 + i) +
            " F1000\n";
  text += "M2\n";
  put("short.ngc", text);
  put("short.ini", kMill + kAxes);
  const std::string rest = " --machine short.ini --stock box:0,0,-0.02,0.06,0.06,0 ";
  const Outcome o = run("program optimise short.ngc" + rest + "--out short2.ngc --quiet --json");
  that(o.status == 0 && contains(o.out, "\"acceleration\""), o, "says that more is not reached",
       __LINE__);
  const double time_s = Json(o.out).number("time_after_s");
  CHECK(time_s < Json(o.out).number("time_before_s"));
  for (const double feed : feeds_of(content(folder / "short2.ngc"))) CHECK(feed < 4000);
  // All at the limit of 6000 mm/min gain nothing more.
  put("all.ngc", std::regex_replace(text, std::regex("F1000"), "F6000"));
  const Outcome all = run("program motion all.ngc --machine short.ini --quiet --json");
  CHECK_NEAR(time_s, Json(all.out).number("duration_s"), 1e-3 * time_s);
  // What is as fast as it can be stays byte for byte.
  const Outcome again =
      run("program optimise short2.ngc" + rest + "--out short3.ngc --quiet --json");
  that(again.status == 0, again, "works", __LINE__);
  CHECK_TEXT(content(folder / "short3.ngc"), content(folder / "short2.ngc"));
}

void refusals() {
  put("free.ini", "[tool]\ndiameter_m = 0.016\nteeth = 4\n");
  put("one.ngc", "G21 G90\nS1000 M3\nG0 X-20 Y10 Z5\nG0 Z-2\nG1 X70 F100\nM2\n");
  const std::string rest = " --stock box:0,0,-0.02,0.06,0.06,0 --out x.ngc";
  refused("program optimise one.ngc --machine free.ini" + rest, 3,
          {"free.ini", "nothing limits a cut", "torque_Nm"}, __LINE__);
  put("unknown.ini", "[tool]\ndiameter_m = 0.016\nteeth = 4\n[limits]\ntorque_Nm = 5\n");
  const Outcome o = run("program optimise one.ngc --machine unknown.ini" + rest + " --quiet");
  that(o.status == 0 &&
           contains(o.out, "line 5: stays at 100 mm/min: the torque of its tool is not"),
       o, "leaves alone what it cannot tell", __LINE__);
  CHECK_TEXT(content(folder / "x.ngc"), content(folder / "one.ngc"));
  put("call.ngc", "G21 G90\nS1000 M3\nG0 X-20 Y10 Z5\nO<way> call\nM2\n");
  put("way.ngc", "O<way> sub\nG1 X70 F100\nO<way> endsub\n");
  refused("program optimise call.ngc --machine unknown.ini" + rest, 3,
          {"call.ngc:4", "subroutine in a file of its own"}, __LINE__);
  put("weak.ini", kMill + "");
  put("hard.ngc", "G21 G90\nS1000 M3\nG0 X-20 Y10 Z5\nG0 Z-2\nG1 X70 F100\nM2\n");
  put("weak.ini",
      "[tool]\ndiameter_m = 0.016\nteeth = 4\ntorque_equation = 1.39 0.36 0.1\n[limits]\ntorque_Nm "
      "= 1\n");
  const Outcome weak = run("program optimise hard.ngc --machine weak.ini" + rest + " --quiet");
  that(weak.status == 0 && contains(weak.out, "its torque is above the limit at any feed"), weak,
       "says what no feed can mend", __LINE__);
}

}  // namespace

int main(int argc, char** argv) {
  const bool night = check::nightly(argc, argv);
  return in_own_folder("program_optimise", [&] {
    against_all_feeds(30400, 3);
    if (night) against_all_feeds(8700000, 60);
    independent_cut();
    modes();
    short_moves();
    refusals();
  });
}
