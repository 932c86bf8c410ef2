// Removed volume against closed forms, at the default spacing of the lines.
#include "cut_parts.hpp"

using namespace cut_parts;

namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kMm3 = 1e-9;

/// Within 0.05 %, and consistent with what is left.
void volume(const char* name, const Stock& stock, const CutterShape& shape,
            const std::string& program, double expected_mm3, int line) {
  CutOptions options;
  options.spacing_m = default_spacing_m(stock, shape.diameter_m / 2);
  const Cut c = cut(stock, {cutter_of(shape)}, program, options);
  if (!c.error.empty()) check::fail(__FILE__, line) << c.error << '\n';
  const double off = c.removed_m3 / (expected_mm3 * kMm3) - 1;
  ++check::checks;
  if (!(std::abs(off) <= 5e-4))
    check::fail(__FILE__, line) << name << ": " << c.removed_m3 / kMm3 << " mm3, expected "
                                << expected_mm3 << '\n';
  check::figure(std::string(name) + ": off", off * 100, "%");
  double sum = 0;
  for (const Engagement& e : c.steps) sum += e.removed_m3;
  CHECK_NEAR(sum, c.removed_m3, 1e-9 * c.removed_m3);
  // What the refinement says covers the truth, chords and floats apart.
  CHECK(std::abs(c.removed_m3 - expected_mm3 * kMm3) <= c.error_m3 + 2e-4 * c.removed_m3);
}

CutterShape flat(double d_mm) { return {CutterKind::flat, d_mm * 1e-3}; }

}  // namespace

int main() {
  const BoxStock block = box_mm(0, 0, -20, 60, 40, 0);
  // Slots across the block, along and askew; 3.3 mm deep, so that no layer ends there.
  volume("slot", block, flat(10), "G0 Z5\nG0 X-10 Y20\nG0 Z-3.3\nG1 X70", 60 * 10 * 3.3, __LINE__);
  // Askew the slot is a parallelogram.
  volume("slot askew", block, flat(8), "G0 Z5\nG0 X-10 Y10\nG0 Z-5.07\nG1 X70 Y30",
         60 * 8 * std::hypot(80, 20) / 80 * 5.07, __LINE__);
  volume("blind slot", block, flat(10), "G0 Z5\nG0 X15 Y20\nG1 Z-4\nG1 X45",
         (30 * 10 + kPi * 25) * 4, __LINE__);
  // A square pocket, overlapping passes, corners rounded with the radius.
  std::string pocket = "G0 Z5\nG0 X15 Y10\nG1 Z-6\n";
  for (int i = 0; i <= 8; ++i) {
    const double y = 10 + 2.5 * i;
    pocket += "G1 Y" + std::to_string(y) + "\nG1 X" + (i % 2 == 0 ? "45" : "15") + "\n";
  }
  pocket += "G1 X15 Y10\nG1 X45\nG1 Y30\nG1 X15\nG1 Y10";
  volume("pocket", block, flat(6), pocket, ((30 + 6) * (20 + 6) - (4 - kPi) * 9) * 6, __LINE__);
  volume("ring", block, flat(4), "G0 Z5\nG0 X42 Y20\nG1 Z-5\nG2 I-12\nG1 Z5",
         kPi * (14 * 14 - 10 * 10) * 5, __LINE__);
  volume("quarter arc", block, flat(6), "G0 Z5\nG0 X35 Y10\nG1 Z-2.5\nG3 X45 Y20 J10\nG1 Z5",
         (kPi / 4 * (13 * 13 - 7 * 7) + kPi * 9) * 2.5, __LINE__);
  // A helix down to 6 mm, and once round on the floor.
  volume("helix", block, flat(10), "G0 Z1\nG0 X36 Y20\nG2 I-6 Z-2\nG2 I-6 Z-4\nG2 I-6 Z-6\nG2 I-6",
         kPi * (11 * 11 - 1 * 1) * 6, __LINE__);
  // Blind holes with a flat, conical and spherical bottom.
  volume("plunge", block, flat(7), "G0 Z5\nG0 X30 Y20\nG1 Z-8.05\nG1 Z5", kPi * 3.5 * 3.5 * 8.05,
         __LINE__);
  const double cone = 4 / std::tan(59 * kPi / 180);
  volume("drill", block, {CutterKind::drill, 8e-3}, "G0 Z5\nG0 X30 Y20\nG81 Z-10 R1 F100\nG80",
         kPi * 16 * (10 - cone + cone / 3), __LINE__);
  volume("ball plunged", block, {CutterKind::ball, 12e-3}, "G0 Z5\nG0 X30 Y20\nG1 Z-6\nG1 Z5",
         2.0 / 3 * kPi * 216, __LINE__);
  volume("ball slot", block, {CutterKind::ball, 10e-3}, "G0 Z5\nG0 X-10 Y20\nG0 Z-5\nG1 X70\nG0 Z5",
         60 * kPi * 12.5, __LINE__);
  // A segment of the circle, 1 mm deep.
  const double half = std::acos(0.8);
  volume("ball shallow", block, {CutterKind::ball, 10e-3},
         "G0 Z5\nG0 X-10 Y20\nG0 Z-1\nG1 X70\nG0 Z5", 60 * 25 * (half - 0.8 * 0.6), __LINE__);
  // Across the whole block on a slope of 1:10: above its lower half the section is upright.
  {
    const double c = std::cos(std::atan(0.1));
    double sum = 0;
    const int n = 2000;
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < n; ++k) {
        const double x = 60 * (i + 0.5) / n, v = -5 + 10 * (k + 0.5) / n;
        sum += std::max(0.0, std::sqrt(25 - v * v) / c - (4 - 0.1 * x)) * 60 / n * 10 / n;
      }
    volume("ball ramp", block, {CutterKind::ball, 10e-3},
           "G0 Z9\nG0 X-20 Y20\nG0 Z1\nG1 X80 Z-9\nG0 Z9", sum, __LINE__);
  }
  volume(
      "flat ramp", block, flat(10),
      // From the surface at x = -5 on, floor z = -(x + 5) / 20 under the leading edge on the way
      // up: entering from the left the deepest edge is ahead.
      "G0 Z9\nG0 X75 Y20\nG1 Z0\nG1 X-5 Z-4\nG0 X-20\nG0 Z9",
      [] {
        // Lowest height over a place (x, v): the path where the rear of the disc leaves it.
        double sum = 0;
        const int n = 2000, m = 400;
        for (int k = 0; k < m; ++k) {
          const double v = -5 + 10 * (k + 0.5) / m, reach = std::sqrt(25 - v * v);
          for (int i = 0; i < n; ++i) {
            const double x = 60 * (i + 0.5) / n;
            // Tip at (p, z): z = -4 (75 - p) / 80; deepest of |p - x| <= reach is the least p;
            // the rapid that follows at z = -4 reaches back to -20.
            const double p = std::max(-5.0, x - reach);
            double depth = 4 * (75 - p) / 80;
            if (x - reach <= -5) depth = 4;
            sum += depth * 60 / n * 10 / m;
          }
        }
        return sum;
      }(),
      __LINE__);
  // A bull nose of 8 mm with corners of 2 mm: flat 4 mm wide, two quarter circles.
  volume("bull slot", block, {CutterKind::bull, 8e-3, 2e-3},
         "G0 Z5\nG0 X-10 Y20\nG0 Z-5\nG1 X70\nG0 Z5", 60 * (8 * 3 + 4 * 2 + kPi * 2), __LINE__);
  volume("bull plunge", block, {CutterKind::bull, 8e-3, 2e-3}, "G0 Z5\nG0 X30 Y20\nG1 Z-5\nG0 Z5",
         kPi * 16 * 3 + kPi * (8 + 4 * kPi + 16.0 / 3), __LINE__);
  CutterShape taper{CutterKind::taper, 4e-3};
  taper.taper_deg = 10, taper.flute_length_m = 15e-3;
  const double wider = std::tan(10 * kPi / 180);
  volume("taper slot", block, taper, "G0 Z5\nG0 X-20 Y20\nG0 Z-6\nG1 X80\nG0 Z5",
         60 * (4 * 6 + wider * 36), __LINE__);
  CutterShape face{CutterKind::face, 30e-3};
  face.entering_angle_deg = 45, face.flute_length_m = 6e-3;
  volume("face mill", block, face, "G0 Z5\nG0 X-30 Y20\nG0 Z-2\nG1 X90\nG0 Z5", 60 * (30 * 2 + 4),
         __LINE__);
  // Through a cylinder, across its axis: chord by chord.
  const CylinderStock round{0, 0, -0.03, 0, 0.02};
  const auto segment = [](double from, double to) {  // area of a disc of 20 between two chords
    const auto below = [](double y) {
      return y * std::sqrt(400 - y * y) + 400 * std::asin(y / 20);
    };
    return below(to) - below(from);
  };
  volume("slot in a cylinder", round, flat(10), "G0 Z5\nG0 X-30 Y3\nG0 Z-7\nG1 X30\nG0 Z5",
         segment(-2, 8) * 7, __LINE__);
  return check::done();
}
