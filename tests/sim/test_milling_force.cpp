// Forces of a rigid cut against closed forms and the reference values derived from Tarng 1988.
#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "check.hpp"
#include "servosense/sim/milling_simulator.hpp"

using namespace servosense;

namespace {

constexpr double kKt = 1500e6, kC = 0.5263, kFeed = 0.254e-3, kDepth = 1.27e-3;
constexpr int kStepsPerTooth = 2500;

// Table 4.1: 600 rpm, 101.6 mm, straight teeth; the step divides the tooth period of any count.
MillingSimulation face_mill(int teeth, double immersion, MillingDirection direction) {
  MillingSimulation s;
  s.tool.diameter_m = 101.6e-3;
  s.tool.teeth = teeth;
  s.tool.force.tangential_coefficient_N_per_m2 = kKt;
  s.tool.force.radial_ratio = kC;
  s.cut = {600, kFeed, kDepth, immersion * s.tool.diameter_m, direction};
  if (immersion == 1) s.cut.direction = MillingDirection::slot;
  s.step_s = 0.1 / teeth / kStepsPerTooth;
  return s;
}

MillingSimulator ready(const MillingSimulation& s) {
  auto simulator = MillingSimulator::create(s);
  if (!simulator) {
    check::fail(__FILE__, __LINE__) << simulator.error().sentence << '\n';
    std::exit(check::done());
  }
  return *std::move(simulator);
}

// Resultant of the mean force over each tooth period of one revolution (eq. 4-1 to 4-3).
std::vector<double> tooth_averages(MillingSimulator simulator, int teeth) {
  std::vector<double> averages;
  for (int j = 0; j < teeth; ++j) {
    double fx = 0, fy = 0;
    for (int i = 0; i < kStepsPerTooth; ++i) {
      const MillingStep& n = simulator.step();
      fx += n.fx_N / kStepsPerTooth;
      fy += n.fy_N / kStepsPerTooth;
    }
    averages.push_back(std::hypot(fx, fy));
  }
  return averages;
}

struct Extremes {
  double low = 1e9, high = -1e9;
};
Extremes differences(const std::vector<double>& a) {
  Extremes e;
  for (std::size_t j = 0; j < a.size(); ++j) {
    const double d = a[j] - a[(j + a.size() - 1) % a.size()];
    e.low = std::min(e.low, d);
    e.high = std::max(e.high, d);
  }
  return e;
}

double phi_of(double start, double exit) {  // Tarng 1988, eq. 5-17 to 5-21, integrated
  const auto part = [](double t) {
    const double a = t / 2 - std::sin(2 * t) / 4, s2 = std::sin(t) * std::sin(t) / 2;
    return std::array{s2 + kC * a, -a + kC * s2};
  };
  const auto e = part(exit), s = part(start);
  return std::hypot(e[0] - s[0], e[1] - s[1]);
}

void reference_forces() {
  struct Case {
    double immersion;
    MillingDirection direction;
    double intact, high, low;
    std::vector<double> broken;
  };
  const auto up = MillingDirection::up, down = MillingDirection::down;
  const Case cases[] = {
      {0.125, up, 171.5, 343.1, -171.5, {0, 343.1, 171.5}},
      {0.25, up, 337.4, 257.0, -193.7, {143.8, 400.8, 478.5, 337.4}},
      {0.5, up, 648.2, 722.2, -474.8, {480.1, 400.8, 1123.0, 648.2}},
      {0.75, up, 917.7, 530.7, -307.5, {785.3, 592.3, 1123.0, 1225.2, 917.7}},
      {1.0, up, 1093.6, 402.2, -263.9, {1009.4, 745.5, 1147.7, 1441.7, 1205.6, 1093.6}},
      {0.5, down, 648.2, 759.8, -447.8, {}},
  };
  for (const Case& c : cases) {
    MillingSimulation s = face_mill(8, c.immersion, c.direction);
    for (const double f : tooth_averages(ready(s), 8)) CHECK_NEAR(f, c.intact, 2e-3 * c.intact);
    s.tool.broken_fraction = {1, 0, 0, 0, 0, 0, 0, 0};
    const auto broken = tooth_averages(ready(s), 8);
    for (std::size_t j = 0; j < c.broken.size(); ++j)
      CHECK_NEAR(broken[j], c.broken[j], 2e-3 * c.intact);
    CHECK_NEAR(differences(broken).high, c.high, 2e-3 * c.intact);
    CHECK_NEAR(differences(broken).low, c.low, 2e-3 * c.intact);
  }
  const std::array<std::array<double, 3>, 4> by_teeth{
      {{4, 324.1, 648.2}, {6, 486.1, 248.0}, {8, 648.2, 722.2}, {10, 810.2, 475.7}}};
  for (const auto& [teeth, intact, high] : by_teeth) {
    MillingSimulation s = face_mill(static_cast<int>(teeth), 0.5, up);
    CHECK_NEAR(tooth_averages(ready(s), s.tool.teeth)[0], intact, 2e-3 * intact);
    s.tool.broken_fraction.assign(static_cast<std::size_t>(s.tool.teeth), 0.0);
    s.tool.broken_fraction[0] = 1;
    CHECK_NEAR(differences(tooth_averages(ready(s), s.tool.teeth)).high, high, 2e-3 * intact);
  }
  // A chip off the tip takes its share of the edge: the follower takes twice the chip there.
  const std::array<std::array<double, 2>, 5> chipped{
      {{0.2, 152.0}, {0.4, 301.4}, {0.6, 447.3}, {0.8, 588.1}, {1.0, 722.2}}};
  for (const auto& [fraction, high] : chipped) {
    MillingSimulation s = face_mill(8, 0.5, up);
    s.tool.broken_fraction = {fraction, 0, 0, 0, 0, 0, 0, 0};
    CHECK_NEAR(differences(tooth_averages(ready(s), 8)).high, high, 2e-3 * 648.2);
  }
  // Table 4.3, tooth 2 ahead of tooth 1.
  MillingSimulation s = face_mill(8, 0.5, up);
  s.tool.throw_m = {-20.3e-6, -4.2e-6, -16.0e-6, -8.0e-6, -25.2e-6, -2.9e-6, 0, -6.9e-6};
  CHECK_NEAR(differences(tooth_averages(ready(s), 8)).high, 50.2, 2e-3 * 648.2);
  CHECK_NEAR(differences(tooth_averages(ready(s), 8)).low, -51.7, 2e-3 * 648.2);
}

// Mean force m Kt a s Phi / 2 pi, for straight and helical teeth, up and down.
void mean_force() {
  for (const double helix : {0.0, 30.0}) {
    for (const double immersion : {0.1, 0.3, 0.6}) {
      for (const auto direction : {MillingDirection::up, MillingDirection::down}) {
        for (const int scale : {1, 2}) {
          MillingSimulation s = face_mill(4, immersion, direction);
          s.tool.diameter_m = 25.4e-3;
          s.tool.helix_deg = helix;
          s.cut.radial_immersion_m = immersion * s.tool.diameter_m;
          s.cut.axial_depth_m *= scale;
          s.cut.feed_per_tooth_m /= scale * scale;
          const Engagement e = engagement_of(s.tool, s.cut);
          const double expected = 4 * kKt * s.cut.axial_depth_m * s.cut.feed_per_tooth_m / kTwoPi *
                                  phi_of(e.start_rad, e.exit_rad);
          CHECK_NEAR(tooth_averages(ready(s), 4)[2], expected, 1e-4 * expected);
        }
      }
    }
  }
}

// Chips of single teeth with random throws: h = max(0, min_k (r_i - r_(i+k) + k s sin theta)),
// tooth i+k being k ahead (Tarng 1988, eq. 3-40), and nothing is lost over a revolution.
void run_out() {
  for (const unsigned seed : {11u, 12u, 13u, 14u}) {
    const int failures_before = check::failures;
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> draw(-1.5 * kFeed, 1.5 * kFeed);
    MillingSimulation s = face_mill(8, 0.125, MillingDirection::up);
    for (int i = 0; i < 8; ++i) s.tool.throw_m.push_back(draw(random));
    MillingSimulator simulator = ready(s);
    // Where the surface changes from one earlier tooth to another it has a kink, which the straight
    // line between two surface points cuts short: a quarter of the spacing times the change of
    // slope, at most m s.
    const double tolerance = kTwoPi / simulator.surface_points() / 4 * 8 * kFeed;
    const double radius = s.tool.radius_m();
    std::vector<double> taken(kStepsPerTooth, 0.0);
    double worst = 0;
    for (int n = 0; n < 8 * kStepsPerTooth; ++n) {
      const double chip = simulator.step().torque_Nm / (kKt * kDepth * radius);
      const double theta = kTwoPi / 8 * (n % kStepsPerTooth + 0.5) / kStepsPerTooth;
      if (theta > std::acos(1 - 0.25) - 0.01) continue;
      const int i = (8 - n / kStepsPerTooth) % 8;  // tooth 1, then the ones that follow it
      double expected = 1e9;
      for (int k = 1; k <= 8; ++k)
        expected = std::min(expected, s.tool.throw_m[static_cast<std::size_t>(i)] -
                                          s.tool.throw_m[static_cast<std::size_t>((i + k) % 8)] +
                                          k * kFeed * std::sin(theta));
      worst = std::max(worst, std::abs(chip - std::max(expected, 0.0)));
      taken[static_cast<std::size_t>(n % kStepsPerTooth)] += chip;
    }
    CHECK_NEAR(worst, 0, tolerance);
    for (int n = 100; n < 2200; n += 100) {
      const double theta = kTwoPi / 8 * (n + 0.5) / kStepsPerTooth;
      CHECK_NEAR(taken[static_cast<std::size_t>(n)], 8 * kFeed * std::sin(theta), tolerance);
    }
    if (check::failures > failures_before) std::cout << "  seed " << seed << '\n';
  }
  // The tooth after a missing one: exactly twice the chip, but for the straight line between two
  // surface points d apart: d^2/8 (2 s + 2 m s / 2 pi), chord and feed on the way.
  MillingSimulation s = face_mill(8, 0.125, MillingDirection::up);
  s.tool.broken_fraction = {1, 0, 0, 0, 0, 0, 0, 0};
  MillingSimulator simulator = ready(s);
  const double apart = kTwoPi / simulator.surface_points();
  const double chord = apart * apart / 8 * (2 + 2 * 8 / kTwoPi) * kFeed;
  for (int n = 0; n < 2 * kStepsPerTooth - 300; ++n) {
    const double chip = simulator.step().torque_Nm / (kKt * kDepth * s.tool.radius_m());
    const double theta = kTwoPi / 8 * (n % kStepsPerTooth + 0.5) / kStepsPerTooth;
    if (theta > std::acos(1 - 0.25) - 0.01) continue;
    const double expected = n < kStepsPerTooth ? 0 : 2 * kFeed * std::sin(theta);
    CHECK_NEAR(chip, expected, chord);
  }
}

// Chip of one straight tooth in a 2-tooth slot, from torque.
template <typename Expected>
double worst_chip(const MillingSimulation& s, Expected expected, double from = 0.05,
                  double to = kPi - 0.05) {
  MillingSimulator simulator = ready(s);
  double worst = 0;
  for (int n = 0; n < 2 * kStepsPerTooth; ++n) {
    const double chip = simulator.step().torque_Nm / (kKt * kDepth * s.tool.radius_m());
    const double theta = kPi * (n % kStepsPerTooth + 0.5) / kStepsPerTooth;
    if (theta > from && theta < to)
      worst = std::max(worst, std::abs(chip - expected(theta, n / kStepsPerTooth)));
  }
  return worst;
}

MillingSimulation slot_mill() {
  MillingSimulation s = face_mill(2, 1, MillingDirection::slot);
  s.tool.diameter_m = 10e-3;
  s.cut.feed_per_tooth_m = 0.1e-3;
  s.surface_points = 4096;  // the chord between two points is off by 3e-7 of the chip
  return s;
}

// Along the ray from the axis to where the tooth before, on its own trochoid, has been.
double trochoidal_chip(double radius, double feed, double theta) {
  const double per_rad = feed * 2 / kTwoPi;
  const auto miss = [&](double back) {  // the earlier tooth was at theta - back + pi, back ago
    const double x = -per_rad * back + radius * std::sin(theta + kPi - back);
    const double y = radius * std::cos(theta + kPi - back);
    return x * std::cos(theta) - y * std::sin(theta);
  };
  double low = kPi - 0.2, high = kPi + 0.2;
  for (int i = 0; i < 100; ++i) {
    const double middle = (low + high) / 2;
    ((miss(middle) > 0) == (miss(low) > 0) ? low : high) = middle;
  }
  const double x = -per_rad * low + radius * std::sin(theta + kPi - low);
  const double y = radius * std::cos(theta + kPi - low);
  return radius - (x * std::sin(theta) + y * std::cos(theta));
}

void tooth_paths() {
  MillingSimulation s = slot_mill();
  const double feed = s.cut.feed_per_tooth_m, radius = s.tool.radius_m();
  const auto exact = [&](double theta, int) { return trochoidal_chip(radius, feed, theta); };
  const double third_order = feed * feed * feed / radius / radius;
  CHECK_NEAR(worst_chip(s, [&](double theta, int) { return feed * std::sin(theta); }), 0,
             4e-7 * feed);
  CHECK(worst_chip(s, exact) > 10 * third_order);  // the circular arc is a second-order form
  s.trochoidal_path = true;
  const double worst = worst_chip(s, exact);
  check::figure("trochoidal path: worst chip error / feed per tooth", worst / feed);
  CHECK_NEAR(worst, 0, third_order);

  // Unequal pitch: a tooth takes the feed since the one ahead of it.
  s = slot_mill();
  s.tool.tooth_angle_rad = {0, rad_from_deg(170)};
  const auto uneven = [&](double theta, int tooth) {
    const double gap = tooth == 0 ? 170.0 : 190.0;
    return feed * gap / 180 * std::sin(theta);
  };
  MillingSimulator simulator = ready(s);
  double worst_uneven = 0;
  for (int n = 0; n < 2 * kStepsPerTooth; ++n) {
    const double chip = simulator.step().torque_Nm / (kKt * kDepth * radius);
    const double theta = kPi * (n + 0.5) / kStepsPerTooth;  // tooth 1; tooth 2 is 170 deg ahead
    if (theta > rad_from_deg(11) && theta < rad_from_deg(179))
      worst_uneven = std::max(worst_uneven, std::abs(chip - uneven(theta, 0)));
    if (theta > rad_from_deg(191) && theta < rad_from_deg(359))
      worst_uneven = std::max(worst_uneven, std::abs(chip - uneven(theta - rad_from_deg(190), 1)));
  }
  CHECK_NEAR(worst_uneven, 0, 4e-7 * 2 * feed);

  // Two teeth a degree apart and a surface asked to be coarser than that: the one behind takes what
  // one degree of feed has left, not a second chip.
  s = slot_mill();
  s.tool.tooth_angle_rad = {0, rad_from_deg(1)};
  s.surface_points = 64;
  MillingSimulator close = ready(s);
  CHECK(close.surface_points() >= 4 * 360);
  double worst_close = 0;
  for (int n = 0; n < 2 * kStepsPerTooth; ++n) {
    const double chip = close.step().torque_Nm / (kKt * kDepth * radius);
    const double theta = kPi * (n + 0.5) / kStepsPerTooth;
    if (theta < 0.05 || theta > kPi - 0.05) continue;
    const double expected =
        feed / 180 * (std::sin(theta) + 359 * std::sin(theta + rad_from_deg(1)));
    worst_close = std::max(worst_close, std::abs(chip - expected));
  }
  // The chord between two points d apart: d^2/8 of the chip.
  CHECK_NEAR(worst_close, 0, std::pow(rad_from_deg(0.25), 2) / 8 * 2.5 * feed);
}

// A helical tooth against the integral over its lag, by 4000 slices.
void helical_tooth() {
  MillingSimulation s = slot_mill();
  s.tool.helix_deg = 30;
  s.cut.axial_depth_m = 8e-3;
  s.cut.direction = MillingDirection::down;
  s.cut.radial_immersion_m = 1e-3;
  s.tool.force.tangential_edge_N_per_m = 2e4;
  s.tool.force.radial_edge_N_per_m = 3e4;
  const Engagement e = engagement_of(s.tool, s.cut);
  const double lag = s.cut.axial_depth_m * std::tan(rad_from_deg(30)) / s.tool.radius_m();
  MillingSimulator simulator = ready(s);
  double worst = 0, peak = 0;
  for (int n = 0; n < 2 * kStepsPerTooth; ++n) {
    const MillingStep& now = simulator.step();
    if (n % 10 != 0) continue;
    double fx = 0, fy = 0;
    constexpr int kSlices = 4000;
    for (int tooth = 0; tooth < 2; ++tooth) {
      for (int j = 0; j < kSlices; ++j) {
        double theta = kPi * (n + 0.5) / kStepsPerTooth + tooth * kPi - lag * (j + 0.5) / kSlices;
        theta -= kTwoPi * std::floor(theta / kTwoPi);
        if (theta < e.start_rad || theta > e.exit_rad) continue;
        const double h = s.cut.feed_per_tooth_m * std::sin(theta);
        const double dz = s.cut.axial_depth_m / kSlices;
        const double ft = (kKt * h + 2e4) * dz, fr = (kC * kKt * h + 3e4) * dz;
        fx -= ft * std::cos(theta) + fr * std::sin(theta);
        fy -= -ft * std::sin(theta) + fr * std::cos(theta);
      }
    }
    peak = std::max(peak, std::hypot(fx, fy));
    worst = std::max(worst, std::hypot(now.fx_N - fx, now.fy_N - fy));
  }
  check::figure("helix, 64 layers: worst force error / peak force", worst / peak);
  // A layer acts by its middle: width^2/24 of the force inside the arc, and at the wall, where the
  // chip ends at zero, a layer whose middle is past it has lost up to half its edge force.
  const double layer_rad = lag / 64;
  const double half_layer_edge = std::hypot(2e4, 3e4) * s.cut.axial_depth_m / 64 / 2;
  CHECK_NEAR(worst, 0, half_layer_edge + layer_rad * layer_rad * peak);

  // As the helix goes, so does the difference from straight teeth.
  MillingSimulation straight = slot_mill();
  MillingSimulation nearly = straight;
  nearly.tool.helix_deg = 1e-3;
  MillingSimulator a = ready(straight), b = ready(nearly);
  for (int n = 0; n < kStepsPerTooth; ++n) {
    const MillingStep &p = a.step(), &q = b.step();
    if (n < 2 || n > kStepsPerTooth - 3) continue;  // the step in which the slot changes teeth
    CHECK_NEAR(q.fx_N, p.fx_N, 1e-4 * 200);
    CHECK_NEAR(q.fy_N, p.fy_N, 1e-4 * 200);
  }
}

void force_law() {
  MillingSimulation s = slot_mill();
  const double radius = s.tool.radius_m();
  s.tool.force.size_effect_exponent = 0.26;
  const auto law = [&](double theta, int) {
    const double h = s.cut.feed_per_tooth_m * std::sin(theta);
    return h * std::pow(h / 1e-4, -0.26);
  };
  CHECK_NEAR(worst_chip(s, law), 0, 1e-6 * s.cut.feed_per_tooth_m);

  // Process damping is what the radial force has beyond its share of the tangential one.
  s = slot_mill();
  s.structure.x = {{300, 0.02, 0.5}};
  s.structure.y = {{340, 0.02, 0.5}};
  s.tool.force.process_damping_N_per_m = 4e4;
  MillingSimulator simulator = ready(s);
  double vx = 0, vy = 0, biggest = 0;
  for (int n = 0; n < kStepsPerTooth - 1; ++n) {
    const MillingStep& now = simulator.step();
    const double theta = kPi * (n + 0.5) / kStepsPerTooth;
    if (n > 1) {
      const double radial = -now.fx_N * std::sin(theta) - now.fy_N * std::cos(theta);
      const double damping = 4e4 * kDepth * (vx * std::sin(theta) + vy * std::cos(theta)) /
                             (rad_s_from_rpm(600) * radius);
      if (now.torque_Nm > 0) CHECK_NEAR(radial - kC * now.torque_Nm / radius, damping, 1e-5 * 100);
      biggest = std::max(biggest, std::abs(damping));
    }
    vx = now.vx_m_s;
    vy = now.vy_m_s;
  }
  CHECK(biggest > 1);
}

void wedge_and_ramp() {
  // One straight tooth in a wedge: the depth is that at the tip.
  MillingSimulation s = slot_mill();
  s.workpiece.length_m = 0.1;
  s.workpiece.front_depth_m = 1e-3;
  s.workpiece.far_depth_m = 5e-3;
  s.start_position_m = 0.03;
  MillingSimulator simulator = ready(s);
  for (int n = 0; n < 6 * kStepsPerTooth; ++n) {
    const double x = simulator.now().feed_m;
    const MillingStep& now = simulator.step();
    const double theta = kPi * (n % kStepsPerTooth + 0.5) / kStepsPerTooth;
    if (n % 50 != 7) continue;
    const double tip = (x + now.feed_m) / 2 + s.tool.radius_m() * std::sin(theta);
    const double depth = 1e-3 + 4e-3 * tip / 0.1;
    const double expected =
        kKt * depth * s.cut.feed_per_tooth_m * std::sin(theta) * s.tool.radius_m();
    CHECK_NEAR(now.torque_Nm, expected, 1e-6 * 10);
  }

  // Feed per tooth while the speed falls by 50 %/s: 1e-6, from the chip itself.
  s = slot_mill();
  s.step_s = 2e-6;
  s.speed = SpindleSpeedProfile::ramp(9000, 5400, 50, 7200);
  CHECK_NEAR(s.speed.speed_rpm(0.5), 7200, 1e-9);
  CHECK_NEAR(s.speed.speed_rpm(5.0), 5400, 1e-9);
  MillingSimulator ramp = ready(s);
  double worst = 0, before_rad = 0, before_m = 0;
  for (int n = 0; n < 500000; ++n) {
    const MillingStep& now = ramp.step();
    double theta = std::fmod((before_rad + now.angle_rad) / 2, kPi);
    if (n > 10 && theta > 0.5 && theta < 2.6) {
      const double chip = now.torque_Nm / (kKt * kDepth * s.tool.radius_m());
      worst = std::max(worst, std::abs(chip / std::sin(theta) / s.cut.feed_per_tooth_m - 1));
      const double fed = (now.feed_m - before_m) / (now.angle_rad - before_rad) * kPi;
      worst = std::max(worst, std::abs(fed / s.cut.feed_per_tooth_m - 1));
    }
    before_rad = now.angle_rad;
    before_m = now.feed_m;
  }
  check::figure("feed per tooth in a 50 %/s ramp: worst relative error", worst);
  CHECK_NEAR(worst, 0, 1e-6);
  CHECK_NEAR(ramp.now().angle_rad, rad_s_from_rpm(7200), 1e-6);  // 1 s at the mean speed
}

}  // namespace

int main() {
  reference_forces();
  mean_force();
  run_out();
  tooth_paths();
  helical_tooth();
  force_law();
  wedge_and_ramp();
  return check::done();
}
