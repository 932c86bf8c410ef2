// Zeroth-order lobes against the published parameter sets of Koike 2016 and Dunwoody 2010, the
// characteristic equation, and a brute-force scan of the quadratic in Lambda.
#include <algorithm>
#include <array>
#include <complex>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/identify/stability_lobes.hpp"

using namespace servosense;
using Complex = std::complex<double>;

namespace {

struct Case {
  Structure structure;
  MillingTool tool;
  MillingCut cut;
};

/// Koike 2016, tables 8-10 and 8-11: simulation of pocket identification.
Case koike_simulation() {
  Case c;
  c.structure.x = c.structure.y = {{2082, 0.018, 0.043}};
  c.tool.teeth = 2;
  c.tool.diameter_m = 0.010;
  c.tool.force = {.tangential_coefficient_N_per_m2 = 1500e6, .radial_ratio = 500.0 / 1500.0};
  c.cut.radial_immersion_m = 0.5e-3;
  c.cut.direction = MillingDirection::down;
  return c;
}

/// Koike 2016, tables 8-1 and 8-2.
Case koike_machine() {
  Case c = koike_simulation();
  c.structure.x = {{2080, 0.01, 0.050}};
  c.structure.y = {{2090, 0.01, 0.040}};
  c.tool.force.radial_ratio = 450.0 / 1500.0;
  return c;
}

/// Dunwoody 2010, ch. 6: slot, four flutes, symmetrical tool, stiffness 20 MN/m.
Case dunwoody_slot(double radial_ratio) {
  Case c;
  const double wn = kTwoPi * 1000;
  c.structure.x = c.structure.y = {{1000, 0.03, 20e6 / (wn * wn)}};
  c.tool.teeth = 4;
  c.tool.diameter_m = 0.020;
  c.tool.force = {.tangential_coefficient_N_per_m2 = 1040e6, .radial_ratio = radial_ratio};
  c.cut.direction = MillingDirection::slot;
  return c;
}

StabilityLobes lobes_of(const Case& c) {
  return *StabilityLobes::from_modes(c.structure, c.tool, c.cut);
}

/// Engagement integral by Simpson's rule from the force on a tooth, not its antiderivative.
std::array<double, 4> integral_by_quadrature(const Engagement& e, double ratio) {
  std::array<double, 4> sum{};
  const int n = 2000;
  for (int i = 0; i <= n; ++i) {
    const double phi = e.start_rad + e.swept_rad() * i / n;
    const double weight = (i == 0 || i == n ? 1 : i % 2 == 1 ? 4 : 2) * e.swept_rad() / n / 3;
    // h = dx sin + dy cos; Fx = -Ft cos - Fr sin; Fy = Ft sin - Fr cos; per Kt a / 2.
    const double s = std::sin(phi);
    const double c = std::cos(phi);
    sum[0] += weight * 2 * (-c - ratio * s) * s;
    sum[1] += weight * 2 * (-c - ratio * s) * c;
    sum[2] += weight * 2 * (s - ratio * c) * s;
    sum[3] += weight * 2 * (s - ratio * c) * c;
  }
  return sum;
}

using Receptances = std::array<Complex, 4>;  // xx, xy, yx, yy

Receptances receptance_of(const Structure& s, double frequency_hz) {
  Receptances g{};
  for (const auto& m : s.x) g[0] += m.receptance(kTwoPi * frequency_hz);
  for (const auto& m : s.y) g[3] += m.receptance(kTwoPi * frequency_hz);
  return g;
}

/// |det[I - (a Kt / 2)(1 - exp(-j w T)) A0 G]| (Dunwoody 2010, eq. 6.10).
double residual(const LobePoint& p, const Case& c, const Receptances& g) {
  const auto alpha =
      integral_by_quadrature(engagement_of(c.tool, c.cut), c.tool.force.radial_ratio);
  const double period = 60 / (c.tool.teeth * p.spindle_speed_rpm);
  const Complex turn = std::polar(1.0, -kTwoPi * p.chatter_frequency_hz * period);
  const Complex f = 0.5 * p.axial_depth_m * c.tool.force.tangential_coefficient_N_per_m2 *
                    (1.0 - turn) * static_cast<double>(c.tool.teeth) / kTwoPi;
  const Complex m00 = 1.0 - f * (alpha[0] * g[0] + alpha[1] * g[2]);
  const Complex m01 = -f * (alpha[0] * g[1] + alpha[1] * g[3]);
  const Complex m10 = -f * (alpha[2] * g[0] + alpha[3] * g[2]);
  const Complex m11 = 1.0 - f * (alpha[2] * g[1] + alpha[3] * g[3]);
  return std::abs(m00 * m11 - m01 * m10);
}

double residual(const LobePoint& p, const Case& c) {
  return residual(p, c, receptance_of(c.structure, p.chatter_frequency_hz));
}

/// Lowest limit depth at one speed: scan of c0 L^2 + c1 L + 1 = 0 with both roots and all k
/// (Koike 2016, eq. 2-92 to 2-100), crossings interpolated linearly.
double limit_by_scan(const Case& c, double speed_rpm, double step_hz, double highest_hz) {
  const auto a = integral_by_quadrature(engagement_of(c.tool, c.cut), c.tool.force.radial_ratio);
  const double period = 60 / (c.tool.teeth * speed_rpm);
  const double kt = c.tool.force.tangential_coefficient_N_per_m2;
  struct At {
    double mismatch, depth;
  };
  std::array<At, 2> before{};
  double lowest = HUGE_VAL;
  for (double f = step_hz; f < highest_hz; f += step_hz) {
    const Receptances g = receptance_of(c.structure, f);
    const Complex c0 = g[0] * g[3] * (a[0] * a[3] - a[1] * a[2]);
    const Complex c1 = a[0] * g[0] + a[3] * g[3];
    const Complex root = std::sqrt(c1 * c1 - 4.0 * c0);
    std::array<Complex, 2> lambda = {(-c1 + root) / (2.0 * c0), (-c1 - root) / (2.0 * c0)};
    if (lambda[0].imag() < lambda[1].imag()) std::swap(lambda[0], lambda[1]);
    for (std::size_t r = 0; r < 2; ++r) {
      const double kappa = lambda[r].imag() / lambda[r].real();
      const double depth = -kTwoPi * lambda[r].real() / (c.tool.teeth * kt) * (1 + kappa * kappa);
      const double phase = kPi - 2 * std::atan(kappa);
      const double mismatch = std::remainder(kTwoPi * f * period - phase, kTwoPi);
      const At now{mismatch, lambda[r].real() < 0 ? depth : -1.0};
      const bool crossed = (now.mismatch > 0) != (before[r].mismatch > 0) &&
                           std::abs(now.mismatch - before[r].mismatch) < 1;
      if (crossed && now.depth > 0 && before[r].depth > 0) {
        const double share = before[r].mismatch / (before[r].mismatch - now.mismatch);
        lowest = std::min(lowest, before[r].depth + share * (now.depth - before[r].depth));
      }
      before[r] = now;
    }
  }
  return lowest;
}

void coefficients() {
  for (const auto& e :
       {Engagement{0, 0.4}, Engagement{2.69, kPi}, Engagement{0, kPi}, Engagement{0.3, 1.7}})
    for (const double ratio : {0.0, 0.3, 1.1}) {
      const auto alpha = engagement_integral(e, ratio);
      const auto slow = integral_by_quadrature(e, ratio);
      CHECK_NEAR(alpha.xx, slow[0], 1e-11);  // Simpson's error at 2000 steps is below 1e-12
      CHECK_NEAR(alpha.xy, slow[1], 1e-11);
      CHECK_NEAR(alpha.yx, slow[2], 1e-11);
      CHECK_NEAR(alpha.yy, slow[3], 1e-11);
    }
  const auto slot = engagement_integral({0, kPi}, 0.3);  // Dunwoody 2010: pi [-Kr -1; 1 -Kr]
  CHECK_NEAR(slot.xx, -0.3 * kPi, 1e-14);
  CHECK_NEAR(slot.xy, -kPi, 1e-14);
  CHECK_NEAR(slot.yx, kPi, 1e-14);
  CHECK_NEAR(slot.yy, -0.3 * kPi, 1e-14);
}

struct PublishedPocket {
  double rpm, mm;
};

void published_set(const Case& c, double minimum_mm, double frequency_hz,
                   const std::vector<double>& minimum_rpm,
                   const std::vector<PublishedPocket>& published) {
  const auto lobes = lobes_of(c);
  const auto lowest = lobes.minimum();
  CHECK_NEAR(lowest.axial_depth_m * 1e3, minimum_mm, 0.01 * minimum_mm);
  CHECK_NEAR(lowest.chatter_frequency_hz, frequency_hz, 1);
  check::figure("lowest limit depth", lowest.axial_depth_m * 1e3, "mm");
  for (std::size_t i = 0; i < minimum_rpm.size(); ++i)
    CHECK_NEAR(lobes.minimum(static_cast<int>(minimum_rpm.size() + 5 - i)).spindle_speed_rpm,
               minimum_rpm[i], 10);

  const auto pockets = lobes.pockets(published.front().rpm - 30, published.back().rpm + 30);
  CHECK(pockets.size() == published.size());
  for (std::size_t i = 0; i < std::min(pockets.size(), published.size()); ++i) {
    const auto& p = pockets[i];
    CHECK_NEAR(p.spindle_speed_rpm, published[i].rpm, 10);
    CHECK_NEAR(p.axial_depth_m * 1e3, published[i].mm, 0.01 * published[i].mm);
    CHECK(p.chatter_frequency_above_hz < p.chatter_frequency_below_hz);
    // Two lobes meet: both frequencies are on the border at the same depth.
    CHECK(residual({p.spindle_speed_rpm, p.axial_depth_m, p.chatter_frequency_below_hz}, c) < 1e-9);
    CHECK(residual({p.spindle_speed_rpm, p.axial_depth_m, p.chatter_frequency_above_hz}, c) < 1e-9);
  }
}

void published() {
  const Case simulation = koike_simulation();
  published_set(simulation, 4.748, 2119, {5409, 5912, 6519, 7263, 8200, 9414},
                {{5747, 9.55},
                 {6321, 10.17},
                 {7023, 10.93},
                 {7900, 11.89},
                 {9027, 13.14},
                 {10530, 14.83},
                 {12633, 17.23}});
  published_set(koike_machine(), 2.095, 2113, {},
                {{5265, 6.12},
                 {5743, 6.55},
                 {6318, 7.09},
                 {7019, 7.74},
                 {7896, 8.56},
                 {9024, 9.63},
                 {10527, 11.07},
                 {12631, 13.12}});
  // Four pockets within 5400..9000 rpm (Koike 2016, fig. 8-30); the frequency falls 2256 -> 2090 Hz
  // across the one at 7900 rpm.
  const auto four = lobes_of(simulation).pockets(5400, 9000);
  CHECK(four.size() == 4);
  CHECK_NEAR(four.back().chatter_frequency_below_hz, 2256, 2);
  CHECK_NEAR(four.back().chatter_frequency_above_hz, 2090, 2);
}

void every_point_is_on_the_border() {
  double worst = 0;
  for (const Case& c : {koike_simulation(), koike_machine(), dunwoody_slot(0.3)}) {
    const auto lobes = lobes_of(c);
    std::vector<double> speeds;
    for (int i = 0; i < 400; ++i) speeds.push_back(2000 + 45.0 * i);
    const auto envelope = lobes.envelope(speeds);
    CHECK(envelope && envelope->size() == speeds.size());
    for (const LobePoint& p : *envelope) worst = std::max(worst, residual(p, c));
    std::size_t points = 0;
    for (const LobeCurve& curve : lobes.lobes(0, 12))
      for (const LobePoint& p : curve.points) {
        // Far off resonance the limit depth runs away and the matrix loses its scale.
        if (p.axial_depth_m > 0.1) continue;
        worst = std::max(worst, residual(p, c));
        ++points;
        // No point of a lobe lies below the envelope.
        CHECK(p.axial_depth_m >= lobes.limit_at(p.spindle_speed_rpm).axial_depth_m * (1 - 1e-9));
      }
    CHECK(points > 1000);
  }
  CHECK(worst < 1e-9);
  check::figure("largest residual of the characteristic equation", worst);
}

void envelope_by_scan() {
  const unsigned seed = 20260731;
  std::mt19937 random(seed);
  const auto draw = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  double worst = 0;
  for (int trial = 0; trial < 8; ++trial) {
    Case c;
    for (auto* modes : {&c.structure.x, &c.structure.y})
      for (int m = 0; m < 2; ++m)
        modes->push_back({draw(400, 2500), draw(0.01, 0.05), draw(0.05, 1)});
    c.tool.teeth = 2 + trial % 4;
    c.tool.diameter_m = 0.016;
    c.tool.force = {.tangential_coefficient_N_per_m2 = draw(5e8, 2e9),
                    .radial_ratio = draw(0.1, 0.6)};
    c.cut.radial_immersion_m = draw(0.1, 1.0) * c.tool.diameter_m;
    c.cut.direction = trial % 3 == 0   ? MillingDirection::up
                      : trial % 3 == 1 ? MillingDirection::down
                                       : MillingDirection::slot;
    const auto lobes = lobes_of(c);
    for (int i = 0; i < 5; ++i) {
      const double speed = draw(3000, 20000);
      const double slow = limit_by_scan(c, speed, 0.02, 8000);
      const double error = std::abs(lobes.limit_at(speed).axial_depth_m / slow - 1);
      worst = std::max(worst, error);
      if (!(error < 1e-5)) std::cout << "seed " << seed << " trial " << trial << '\n';
      CHECK(error < 1e-5);  // the scan steps 0.02 Hz through peaks 8 Hz wide or more
    }
  }
  check::figure("largest difference to a brute-force scan", worst);
}

void dunwoody() {
  const std::array<std::array<double, 2>, 3> scanned = {
      {{0.25, 0.5702}, {0.3, 0.5669}, {0.5, 0.5485}}};
  for (const auto& [ratio, mm] : scanned) {
    const double limit = lobes_of(dunwoody_slot(ratio)).minimum().axial_depth_m * 1e3;
    CHECK_NEAR(limit, mm, 1e-4);  // printed to four digits
    const double closed = 8 * 20e6 * 0.03 / (4 * 1040e6 * (1 + std::sqrt(1 + ratio * ratio))) * 1e3;
    CHECK_NEAR(limit, closed, 0.01 * closed);  // the closed form is for light damping
  }
  const auto lobes = lobes_of(dunwoody_slot(0.3));
  CHECK_NEAR(lobes.minimum(1).spindle_speed_rpm, 9706, 10);
  CHECK_NEAR(lobes.minimum(2).spindle_speed_rpm, 5902, 10);
  CHECK_NEAR(lobes.minimum(3).spindle_speed_rpm, 4240, 10);
}

ReceptanceTable sampled(const std::vector<std::pair<double, StructuralMode>>& parts) {
  ReceptanceTable table;
  for (double f = 100; f <= 4000; f += 0.25) {
    Complex sum = 0;
    for (const auto& [weight, mode] : parts) sum += weight * mode.receptance(kTwoPi * f);
    table.frequency_hz.push_back(f);
    table.receptance_m_per_N.push_back(sum);
  }
  return table;
}

void measured_receptance() {
  const Case c = koike_machine();
  const StructuralMode u = c.structure.x[0];
  const StructuralMode v = c.structure.y[0];
  const auto modal = lobes_of(c);
  const auto tables = StabilityLobes::from_receptance(
      {sampled({{1, u}}), sampled({{1, v}}), {}, {}}, c.tool, c.cut);
  CHECK(tables.has_value());
  for (const double speed : {5300.0, 6100.0, 7896.0, 9500.0, 12000.0}) {
    const double expected = modal.limit_at(speed).axial_depth_m;
    // Linear interpolation over 0.25 Hz in a peak 42 Hz wide: (0.25/42)^2/8 of curvature.
    CHECK_NEAR(tables->limit_at(speed).axial_depth_m, expected, 1e-4 * expected);
  }
  // The same two modes at 30 degrees to the feed: cross receptances appear.
  const double cc = 0.75;
  const double ss = 0.25;
  const double cs = std::sqrt(cc * ss);
  const auto cross = sampled({{cs, u}, {-cs, v}});
  const auto turned = StabilityLobes::from_receptance(
      {sampled({{cc, u}, {ss, v}}), sampled({{ss, u}, {cc, v}}), cross, cross}, c.tool, c.cut);
  CHECK(turned.has_value());
  double largest_change = 0;
  for (const double speed : {5300.0, 6100.0, 7896.0, 9500.0, 12000.0}) {
    const LobePoint p = turned->limit_at(speed);
    const Complex gu = u.receptance(kTwoPi * p.chatter_frequency_hz);
    const Complex gv = v.receptance(kTwoPi * p.chatter_frequency_hz);
    const Complex gc = cs * (gu - gv);
    CHECK(residual(p, c, {cc * gu + ss * gv, gc, gc, ss * gu + cc * gv}) < 1e-3);
    const double change = p.axial_depth_m / modal.limit_at(speed).axial_depth_m - 1;
    largest_change = std::max(largest_change, std::abs(change));
  }
  CHECK(largest_change > 0.05);  // the cross receptances matter, so they were not dropped
}

void one_direction() {
  for (const bool feed : {true, false}) {
    Case c = koike_simulation();
    (feed ? c.structure.y : c.structure.x).clear();
    c.cut.direction = MillingDirection::slot;
    // One direction, slot: lambda = -pi Kr G, so a = 2 / (N Kt Kr max(-Re G)); light damping or
    // not, max(-Re G) = 1 / (4 k zeta (1 + zeta)).
    const StructuralMode m{2082, 0.018, 0.043};
    const double flexible = 1 / (4 * m.stiffness_N_per_m() * 0.018 * 1.018);
    const double closed = 2 / (2 * 1500e6 * (500.0 / 1500.0) * flexible);
    CHECK_NEAR(lobes_of(c).minimum().axial_depth_m, closed, 1e-9 * closed);
  }
}

void unknown_radial_ratio() {
  Case c = dunwoody_slot(0.3);
  const double low = 0.25;
  const double high = 0.5;
  std::vector<double> speeds;
  for (int i = 0; i < 60; ++i) speeds.push_back(3000 + 150.0 * i);
  const auto band = limit_depth_band(c.structure, c.tool, c.cut, low, high, speeds);
  CHECK(band.has_value());
  const double depth = 1.2e-3;
  const auto safe = safe_speeds(c.structure, c.tool, c.cut, low, high, depth, 3000, 12000);
  CHECK(safe.has_value() && !safe->empty());

  const unsigned seed = 7;
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> draw(low, high);
  for (int trial = 0; trial < 25; ++trial) {
    c.tool.force.radial_ratio = draw(random);
    const auto lobes = lobes_of(c);
    for (std::size_t i = 0; i < speeds.size(); ++i) {
      const double limit = lobes.limit_at(speeds[i]).axial_depth_m;
      // 33 ratios over the range leave 1e-3 of the smooth lower bound, and more of the upper one,
      // which has a corner where two lobes meet.
      CHECK(limit >= band->lowest_depth_m[i] * (1 - 1e-3));
      CHECK(limit <= band->highest_depth_m[i] * (1 + 5e-3));
    }
    for (const SpeedInterval& s : *safe)
      for (const double share : {0.01, 0.5, 0.99})
        CHECK(lobes.limit_at(s.from_rpm + share * (s.to_rpm - s.from_rpm)).axial_depth_m > depth);
  }
  // The intervals are as wide as they can be: just outside, some ratio of the range chatters.
  for (const SpeedInterval& s : *safe)
    for (const double outside : {s.from_rpm * 0.999, s.to_rpm * 1.001}) {
      if (outside < 3000 || outside > 12000) continue;
      double lowest = HUGE_VAL;
      for (int i = 0; i <= 100; ++i) {
        c.tool.force.radial_ratio = low + (high - low) * i / 100;
        lowest = std::min(lowest, lobes_of(c).limit_at(outside).axial_depth_m);
      }
      CHECK(lowest < depth);
    }
  const auto lobes = lobes_of(dunwoody_slot(0.3));
  for (const SpeedInterval& s : lobes.unstable_speeds(1e-3, 3000, 12000))
    for (const double edge : {s.from_rpm, s.to_rpm})
      if (edge > 3000 && edge < 12000) CHECK_NEAR(lobes.limit_at(edge).axial_depth_m, 1e-3, 1e-9);
}

template <typename T>
void refused(const Expected<T>& result, const std::string& about) {
  CHECK(!result.has_value());
  if (result.has_value()) return;
  CHECK(result.error().sentence.find(about) != std::string::npos);
}

void errors() {
  const auto attempt = [](auto change) {
    Case c = koike_simulation();
    change(c);
    return StabilityLobes::from_modes(c.structure, c.tool, c.cut);
  };
  refused(attempt([](Case& c) { c.structure.y[0].modal_mass_kg = -0.1; }), "modal mass of -0.1 kg");
  refused(attempt([](Case& c) { c.structure.x[0].damping_ratio = 0; }), "damping ratio of 0");
  refused(attempt([](Case& c) { c.structure.x[0].natural_frequency_hz = 0; }), "frequency");
  refused(attempt([](Case& c) { c.structure = {}; }), "no modes");
  refused(attempt([](Case& c) { c.tool.teeth = 0; }), "0 teeth");
  refused(attempt([](Case& c) { c.cut.radial_immersion_m = 0.011; }), "11 mm is above");
  refused(attempt([](Case& c) { c.cut.radial_immersion_m = 0; }), "radial immersion");
  refused(attempt([](Case& c) {
            c.tool.tooth_angle_rad = {0, 3.0};
          }),
          "semi-discretisation (--method sd)");
  refused(attempt([](Case& c) { c.tool.force.tangential_coefficient_N_per_m2 = 0; }), "tangential");
  refused(lobes_of(koike_simulation()).envelope({}), "No spindle speed");
  const std::vector<double> zero = {5000, 0};
  refused(lobes_of(koike_simulation()).envelope(zero), "spindle speed of 0 rpm");
  const Case c = koike_simulation();
  refused(StabilityLobes::from_receptance({}, c.tool, c.cut), "no receptance");
  ReceptanceTable falling{{10, 5}, {1.0, 1.0}};
  refused(StabilityLobes::from_receptance({falling, {}, {}, {}}, c.tool, c.cut), "rising");
  ReceptanceTable low{{1, 2}, {1.0, 1.0}};
  ReceptanceTable high{{3, 4}, {1.0, 1.0}};
  refused(StabilityLobes::from_receptance({low, high, {}, {}}, c.tool, c.cut), "in common");
}

}  // namespace

int main() {
  coefficients();
  published();
  every_point_is_on_the_border();
  envelope_by_scan();
  dunwoody();
  measured_receptance();
  one_direction();
  unknown_radial_ratio();
  errors();
  return check::done();
}
