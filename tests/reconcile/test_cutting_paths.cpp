// Cuts as simulations make them: teeth on circles that are moved on by the feed, h = f sin(phi),
// and teeth without a helix, which enter the work between two samples. And one whose force goes up
// and down with a period of its own.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <numbers>
#include <string>
#include <vector>

#include "check.hpp"
#include "cutting_record.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/reconcile/cutting.hpp"

namespace {

namespace reconcile = servosense::reconcile;
using servosense::Channel;
using servosense::Quantity;

constexpr double kPi = std::numbers::pi;
constexpr double kRadius = 5e-3, kDepth = 3e-3, kSwept = 1.1, kKt = 1.6e9, kKr = 0.5e9;
constexpr int kTeeth = 3;
constexpr double kNoise = 3, kShort = 6e-6;

struct Made {
  double helix_rad = 0, exponent = 0;
  bool down = false;
  double wrong_immersion = 1;  // of the file
  double edge_N_per_m = 0;     // tangential and radial
  double modulated = 0;        // of the force, up and down once in so many turns
  double modulated_turns = 2.7;
  bool gradually = false;
  double shaken_N = 0;  // near 523 Hz, of a phase that wanders
  double late_rad = 0;  // second of four teeth in a slot, at one feed; the third is short
};

/// Uniform noise of a fixed row of numbers.
double noise(std::uint64_t& state) {
  state = state * 6364136223846793005u + 1442695040888963407u;
  const double unit = static_cast<double>(state >> 11) * 0x1.0p-53;
  return kNoise * std::sqrt(12.0) * (unit - 0.5);
}

servosense::Trace cut(const Made& made) {
  constexpr double kRate_hz = 4000, kSpeed = 2 * kPi * 43.7, kLevel_s = 1.4;
  const double feeds[]{4e-5, 1.6e-4, 8e-5};
  const int layers = made.helix_rad > 0 ? 64 : 1;
  const bool slot = made.late_rad != 0;
  const double start = made.down ? kPi - kSwept : 0, exit = slot ? kPi : start + kSwept;
  const int teeth = slot ? 4 : kTeeth;
  std::vector<double> t_s, angle_rad, feed_m, x_N, y_N;
  std::uint64_t state = 7;
  double phase = 0;
  for (int i = 0; i < 3 * kLevel_s * kRate_hz; ++i) {
    const double t = i / kRate_hz, feed = feeds[slot ? 1 : static_cast<int>(t / kLevel_s)];
    double x = 0, y = 0;
    for (int j = 0; j < teeth; ++j) {
      // A tooth that comes late cuts more, and leaves less to the next.
      const double late = j == 1 ? made.late_rad : 0;
      const double more = (j == 1 ? 1 : j == 2 ? -1 : 0) * made.late_rad * teeth / (2 * kPi);
      const double longer_m = (j == 2 ? -1 : j == 3 ? 1 : 0) * (slot ? kShort : 0);
      for (int k = 0; k < layers; ++k) {
        const double lag = (k + 0.5) / layers * kDepth * std::tan(made.helix_rad) / kRadius;
        double phi = kSpeed * t - 2 * kPi * j / teeth - late - lag;
        phi -= 2 * kPi * std::floor(phi / (2 * kPi));
        if (phi < start || phi > exit) continue;
        const double s = std::sin(phi), c = std::cos(phi);
        const double h = std::max(0.0, feed * (1 + more) * s + longer_m);
        const double area = h * std::pow(h / 1e-4, -made.exponent) * kDepth / layers;
        const double edge = made.edge_N_per_m * kDepth / layers;
        x += (kKt * area + edge) * c + (kKr * area + edge) * s;
        y += -(kKt * area + edge) * s + (kKr * area + edge) * c;
      }
    }
    t_s.push_back(t);
    angle_rad.push_back(kSpeed * t + 1.3);
    feed_m.push_back(feed);
    const double wave = std::sin(kSpeed * t / made.modulated_turns);
    const double as_much = 1 + (made.gradually ? wave : wave > 0 ? 1 : -1) * made.modulated;
    if (made.shaken_N > 0) phase += 2 * kPi * 523 / kRate_hz + 0.06 * noise(state);
    x += made.shaken_N * std::sin(phase);
    x_N.push_back(as_much * x + noise(state));
    y_N.push_back(as_much * y + noise(state));
  }
  servosense::Trace trace;
  trace.t_s.assign(t_s.begin(), t_s.end());
  const auto add = [&](Channel channel, Quantity quantity, const std::vector<double>& values) {
    trace.signals.push_back({channel, quantity});
    trace.columns.push_back(values);
  };
  add(Channel::spindle, Quantity::angle_rad, angle_rad);
  add(Channel::tool, Quantity::feed_per_tooth_m, feed_m);
  add(Channel::dyno, Quantity::force_x_N, x_N);
  add(Channel::dyno, Quantity::force_y_N, y_N);
  return trace;
}

reconcile::Report report_of(const Made& made) {
  char text[400];
  std::snprintf(text, sizeof text,
                "[tool]\ndiameter_m = %g\nteeth = %d\nhelix_deg = "
                "%.9g\ntangential_coefficient_N_per_m2 = 1.5e9\nradial_ratio = "
                "0.33\n[cut]\naxial_depth_m = %g\nradial_immersion_m = %.9g\ndirection = %s\n",
                2 * kRadius, made.late_rad != 0 ? 4 : kTeeth, made.helix_rad * 180 / kPi, kDepth,
                made.wrong_immersion * kRadius * (1 - std::cos(kSwept)),
                made.late_rad != 0 ? "slot"
                : made.down        ? "down"
                                   : "up");
  auto machine = servosense::MachineFile::parse(text, "machine.ini");
  CHECK(machine.has_value());
  auto data = reconcile::read_cutting(*machine, cut(made));
  CHECK(data.has_value());
  auto outcome = reconcile::reconcile_cutting(*data, {});
  CHECK(outcome.has_value());
  return outcome->report;
}

bool on_circles(const reconcile::Report& r) {
  return std::ranges::any_of(
      r.remarks, [](const std::string& s) { return s.find("circles") != std::string::npos; });
}

/// Nothing is missing, and the gap is the noise.
void circles_are_no_effect() {
  const reconcile::Report r = report_of({30 * kPi / 180});
  CHECK_TEXT(reconcile::name_of(r.verdict), "agrees");
  CHECK(on_circles(r));
  CHECK_NEAR(r.gap_before, kNoise, 0.02 * kNoise);
}

/// Beside an effect of some hundredths of the force, the path is found again.
void size_effect_on_circles() {
  const reconcile::Report r = report_of({30 * kPi / 180, 0.12});
  CHECK(r.effects.size() == 1 && r.effects[0].name == "size-effect");
  CHECK(on_circles(r));
  if (r.effects.empty()) return;
  CHECK_NEAR(r.effects[0].parameters[0].values[0], 0.12, 0.12 * 0.02);
}

/// The first of two effects makes trochoids fit, which they do no more beside both.
void two_effects_on_circles() {
  for (const bool down : {true, false}) {
    const reconcile::Report r = report_of(
        {.helix_rad = 30 * kPi / 180, .exponent = 0.15, .down = down, .edge_N_per_m = 1e4});
    CHECK(r.effects.size() == 2);
    for (const reconcile::FoundEffect& e : r.effects)
      for (const auto& p : e.parameters) {
        const double truth = e.name == "size-effect" ? 0.15 : 1e4;
        std::printf("%s %g, is %g\n", p.key.c_str(), p.values[0], truth);
        CHECK_NEAR(p.values[0], truth, 0.03 * truth);
      }
  }
}

/// A step between two points of a curve was read as a ramp: samples there were off by half of the
/// force, and the noise from turn to turn came out several times too large. A step within a bin was
/// lost, so that zero and immersion, which hold it together, were 4 % off.
void straight_teeth() {
  for (const bool down : {true, false}) {
    const reconcile::Report r = report_of({0, 0, down, 1.05});
    CHECK(r.effects.empty());
    for (const auto& c : r.recalibrated)
      if (c.parameter == "radial_immersion_m")
        CHECK_NEAR(c.to, kRadius * (1 - std::cos(kSwept)), 0.002 * c.to);
    // Teeth enter between two samples: one that falls on the wrong side costs 60 times the noise.
    CHECK_BETWEEN(r.floors.lap, 0.95 * kNoise, 1.3 * kNoise);
    CHECK_BETWEEN(r.gap_before, 0.95 * kNoise, 1.3 * kNoise);
  }
}

/// The scatter over turns holds it, so that it passed for noise and the cut for sound.
void modulated_cut() {
  const reconcile::Report r = report_of({.helix_rad = 30 * kPi / 180, .modulated = 0.1});
  CHECK(r.effects.empty());
  CHECK_TEXT(reconcile::name_of(r.verdict), "unexplained");
  CHECK(r.residual_detail.find("once in 2.7 turns (16.2 Hz)") != std::string::npos);
  CHECK(r.summary.find(r.residual_detail) != std::string::npos);
  // The means over turns leave less than is worth a name, and no candidate explains half of that.
  for (const auto& candidate : r.ranking) CHECK_BETWEEN(candidate.explained, 0, 0.5);
}

/// Its lines lie beside those of the teeth, where a mode driven there can stand in for half of it.
void no_mode_for_a_modulated_cut() {
  for (const double helix_deg : {0.0, 20.0}) {
    const reconcile::Report r = report_of({.helix_rad = helix_deg * kPi / 180,
                                           .modulated = 0.15,
                                           .modulated_turns = 4.3,
                                           .gradually = true});
    CHECK(r.effects.empty());
    CHECK_TEXT(reconcile::name_of(r.verdict), "unexplained");
    CHECK(r.residual_detail.find("rises and falls by 15 % once in 4.3 turns") != std::string::npos);
  }
}

/// The same for what shakes the work with no line and no period: a third of the force, and more
/// than the noise.
void unsteady_cut() {
  const reconcile::Report r = report_of({.helix_rad = 30 * kPi / 180, .shaken_N = 40});
  CHECK(r.effects.empty());
  CHECK_TEXT(reconcile::name_of(r.verdict), "unexplained");
  CHECK(r.residual_detail.find("N neither turn with the tool nor are noise") != std::string::npos);
  std::printf("%s\n", r.residual_detail.c_str());
}

/// Four straight teeth in a slot make a constant force, which is as well an offset of the sensor
/// with other coefficients: both ran away together, and nothing was named.
void even_force() {
  const reconcile::Report r = report_of({.late_rad = 0.03});
  CHECK(r.effects.size() == 2);
  CHECK(std::ranges::any_of(r.effects, [](const auto& e) { return e.name == "pitch-error"; }));
  CHECK(std::ranges::none_of(
      r.remarks, [](const std::string& s) { return s.find("offset") != std::string::npos; }));
  CHECK_NEAR(r.recalibrated[0].to, kKt, 0.01 * kKt);
  CHECK(
      std::ranges::any_of(r.not_testable, [](const auto& n) { return n.name == "sensor-offset"; }));
}

/// On trochoids. Beside the first of the two circles fit better, on an arc that is 12 % too wide,
/// and beside those the second explains a quarter of what is left: it was not named.
void runout_beside_edges() {
  cutting_generator::Cut made;
  made.radius_m = 4e-3;
  made.teeth = 5;
  made.helix_deg = 0;
  made.depth_m = 1.18e-3;
  made.start_rad = kPi - 0.938;
  made.exit_rad = kPi;
  made.kt = 7.5e8;
  made.kr = 2.56e8;
  made.kte = 8053;
  made.kre = 5074;
  for (int j = 0; j < made.teeth; ++j)
    made.reach_m.push_back(4.1e-5 * std::cos(2 * kPi * j / made.teeth + 1.47));
  const cutting_generator::Program program{.feeds_m = {1.4e-4, 2.42e-4, 1.06e-4, 1.87e-4},
                                           .speed_rad_s = 254.1,
                                           .rate_hz = 20000,
                                           .each_s = 0.57,
                                           .noise_N = 2.4};
  servosense::MillingTool tool;
  tool.diameter_m = 2 * made.radius_m;
  tool.teeth = made.teeth;
  tool.helix_deg = 0;
  tool.force.tangential_coefficient_N_per_m2 = made.kt;
  tool.force.radial_ratio = made.kr / made.kt;
  servosense::MillingCut given;
  given.spindle_speed_rpm = program.speed_rad_s * 30 / kPi;
  given.feed_per_tooth_m = 1.4e-4;
  given.axial_depth_m = made.depth_m;
  given.radial_immersion_m = made.radius_m * (1 - std::cos(0.938));
  given.direction = servosense::MillingDirection::down;
  const auto outcome = reconcile::reconcile_cutting(
      data_of(cutting_generator::generate(made, program), tool, given), {});
  CHECK(outcome.has_value());
  if (!outcome) return;
  const reconcile::Report& r = outcome->report;
  CHECK(!on_circles(r));
  CHECK(r.effects.size() == 2);
  for (const char* name : {"runout", "edge-force"})
    CHECK(std::ranges::any_of(r.effects, [&](const auto& e) { return e.name == name; }));
  for (const reconcile::FoundEffect& e : r.effects)
    if (e.name == "runout") CHECK_NEAR(e.parameters[0].values[0], 4.1e-5, 0.02 * 4.1e-5);
}

}  // namespace

int main(int argc, char** argv) {
  circles_are_no_effect();
  two_effects_on_circles();
  modulated_cut();
  even_force();
  if (check::nightly(argc, argv)) {
    runout_beside_edges();
    size_effect_on_circles();
    straight_teeth();
    no_mode_for_a_modulated_cut();
    unsteady_cut();
  }
  return check::done();
}
