// Semi-discretisation against two independent forms of the same delay equation: the exact
// characteristic equation det(Phi(mu) - mu I) = 0 solved by Runge-Kutta and a secant iteration, and
// plain integration in time with growth measured from tooth to tooth.
#include <algorithm>
#include <array>
#include <complex>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/identify/semi_discretization.hpp"

using namespace servosense;
using Complex = std::complex<double>;

namespace {

struct Case {
  const char* name;
  Structure structure;
  MillingTool tool;
  MillingCut cut;
  double speed_rpm;
  double depth_m;
};

/// Insperger & Stepan 2004: one mode in the feed direction, two teeth, down milling.
Case benchmark(double immersion, double speed_rpm, double depth_m) {
  Case c{"benchmark", {}, {}, {}, speed_rpm, depth_m};
  c.structure.x = {{922, 0.011, 0.03993}};
  c.tool.teeth = 2;
  c.tool.diameter_m = 0.010;
  c.tool.force = {.tangential_coefficient_N_per_m2 = 6e8, .radial_ratio = 2.0 / 6.0};
  c.cut.radial_immersion_m = immersion * c.tool.diameter_m;
  c.cut.direction = MillingDirection::down;
  return c;
}

std::vector<Case> cases() {
  std::vector<Case> all;
  for (const double immersion : {0.05, 0.1, 0.5, 1.0})
    for (const double depth : {0.4e-3, 1.5e-3}) all.push_back(benchmark(immersion, 9000, depth));
  Case both = benchmark(0.3, 11000, 1e-3);
  both.name = "two directions";
  both.structure.y = {{870, 0.02, 0.05}};
  all.push_back(both);
  Case normal = benchmark(0.3, 11000, 1e-3);
  normal.name = "normal direction, up milling";
  normal.structure = {{}, {{922, 0.011, 0.03993}}};
  normal.cut.direction = MillingDirection::up;
  all.push_back(normal);
  Case many = benchmark(0.7, 6000, 0.8e-3);
  many.name = "four teeth, four modes";
  many.tool.teeth = 4;
  many.structure.x.push_back({1700, 0.03, 0.1});
  many.structure.y = {{800, 0.02, 0.06}, {1500, 0.03, 0.2}};
  all.push_back(many);
  Case helical = both;
  helical.name = "helix 30 degrees";
  helical.tool.helix_deg = 30;
  helical.depth_m = 2e-3;
  all.push_back(helical);
  Case steep = many;
  steep.name = "helix 45 degrees over more than one pitch";
  steep.tool.helix_deg = 45;
  steep.depth_m = 9e-3;
  steep.tool.force.tangential_coefficient_N_per_m2 = 1e8;
  all.push_back(steep);
  return all;
}

// --- the physics again, slowly: force per deflection from the geometry of one slice after another

struct Stiffness {
  double xx = 0, xy = 0, yx = 0, yy = 0;
};

/// `side` > 0 looks just after `phi`, < 0 just before, so that an entry or exit is on one side.
Stiffness cutting_stiffness(const Case& c, double phi, double side, int slices) {
  const Engagement e = engagement_of(c.tool, c.cut);
  const double lag = c.depth_m * std::tan(rad_from_deg(c.tool.helix_deg)) / c.tool.radius_m();
  const int n = c.tool.helix_deg > 0 ? slices : 1;
  Stiffness sum;
  for (int tooth = 0; tooth < c.tool.teeth; ++tooth)
    for (int slice = 0; slice < n; ++slice) {
      double angle = phi + tooth * kTwoPi / c.tool.teeth - lag * (slice + 0.5) / n;
      angle -= kTwoPi * std::floor((angle + side * 1e-9) / kTwoPi);
      if (angle + side * 1e-9 < e.start_rad || angle + side * 1e-9 > e.exit_rad) continue;
      const double s = std::sin(angle);
      const double co = std::cos(angle);
      const double kt = c.tool.force.tangential_coefficient_N_per_m2 * c.depth_m / n;
      const double r = c.tool.force.radial_ratio;
      sum.xx += kt * (-co - r * s) * s;
      sum.xy += kt * (-co - r * s) * co;
      sum.yx += kt * (s - r * co) * s;
      sum.yy += kt * (s - r * co) * co;
    }
  return sum;
}

struct Mode {
  double wn, zeta, mass;
  bool feed;
};

std::vector<Mode> modes_of(const Case& c) {
  std::vector<Mode> modes;
  for (const auto& m : c.structure.x)
    modes.push_back({m.natural_frequency_rad_s(), m.damping_ratio, m.modal_mass_kg, true});
  for (const auto& m : c.structure.y)
    modes.push_back({m.natural_frequency_rad_s(), m.damping_ratio, m.modal_mass_kg, false});
  return modes;
}

/// Derivative of (q, q') of all modes when the chip differs by (dx, dy).
template <typename T>
void derivative(const std::vector<Mode>& modes, const Stiffness& k, const std::vector<T>& state,
                T dx, T dy, std::vector<T>& rate) {
  const T fx = k.xx * dx + k.xy * dy;
  const T fy = k.yx * dx + k.yy * dy;
  for (std::size_t m = 0; m < modes.size(); ++m) {
    const Mode& mode = modes[m];
    rate[2 * m] = state[2 * m + 1];
    rate[2 * m + 1] = (mode.feed ? fx : fy) / mode.mass - mode.wn * mode.wn * state[2 * m] -
                      2 * mode.zeta * mode.wn * state[2 * m + 1];
  }
}

template <typename T>
std::array<T, 2> tip(const std::vector<Mode>& modes, const std::vector<T>& state) {
  std::array<T, 2> u{};
  for (std::size_t m = 0; m < modes.size(); ++m) u[modes[m].feed ? 0 : 1] += state[2 * m];
  return u;
}

/// Phases within one pitch at which a tooth (or its upper end) enters or leaves.
std::vector<double> phase_breaks(const Case& c) {
  const Engagement e = engagement_of(c.tool, c.cut);
  const double pitch = kTwoPi / c.tool.teeth;
  const double lag = c.depth_m * std::tan(rad_from_deg(c.tool.helix_deg)) / c.tool.radius_m();
  std::vector<double> phases = {0, pitch};
  for (double edge : {e.start_rad, e.exit_rad, e.start_rad + lag, e.exit_rad + lag})
    phases.push_back(std::fmod(edge, pitch));
  std::sort(phases.begin(), phases.end());
  return phases;
}

/// det(Phi(mu) - mu I): on an eigenfunction the deflection a tooth ago is that of now over mu, so
/// the delay equation becomes an ordinary one, integrated here from break to break.
Complex characteristic(const Case& c, Complex mu, int steps, int slices) {
  const auto modes = modes_of(c);
  const std::size_t n = 2 * modes.size();
  const double spin = rad_s_from_rpm(c.speed_rpm);
  const auto breaks = phase_breaks(c);
  const double pitch = kTwoPi / c.tool.teeth;
  std::vector<std::vector<Complex>> columns(n, std::vector<Complex>(n));
  for (std::size_t i = 0; i < n; ++i) columns[i][i] = 1;
  std::vector<Complex> k1(n), k2(n), k3(n), k4(n), probe(n);
  for (std::size_t b = 0; b + 1 < breaks.size(); ++b) {
    const double width = breaks[b + 1] - breaks[b];
    if (width < 1e-12) continue;
    const int count = 1 + static_cast<int>(steps * width / pitch);
    const double h = width / spin / count;
    for (int s = 0; s < count; ++s) {
      const double phi = breaks[b] + width * s / count;
      const double dphi = width / count;
      const Stiffness a = cutting_stiffness(c, phi, 1, slices);
      const Stiffness m = cutting_stiffness(c, phi + dphi / 2, 1, slices);
      const Stiffness z = cutting_stiffness(c, phi + dphi, -1, slices);
      for (auto& x : columns) {
        const auto rate = [&](const Stiffness& k, const std::vector<Complex>& at,
                              std::vector<Complex>& out) {
          const auto u = tip(modes, at);
          derivative(modes, k, at, (1.0 - 1.0 / mu) * u[0], (1.0 - 1.0 / mu) * u[1], out);
        };
        rate(a, x, k1);
        for (std::size_t i = 0; i < n; ++i) probe[i] = x[i] + h / 2 * k1[i];
        rate(m, probe, k2);
        for (std::size_t i = 0; i < n; ++i) probe[i] = x[i] + h / 2 * k2[i];
        rate(m, probe, k3);
        for (std::size_t i = 0; i < n; ++i) probe[i] = x[i] + h * k3[i];
        rate(z, probe, k4);
        for (std::size_t i = 0; i < n; ++i)
          x[i] += h / 6 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
      }
    }
  }
  // Gaussian elimination with pivoting; velocities scaled to displacements.
  std::vector<std::vector<Complex>> a(n, std::vector<Complex>(n));
  for (std::size_t r = 0; r < n; ++r)
    for (std::size_t col = 0; col < n; ++col) {
      const double row_scale = r % 2 ? 1 / modes[r / 2].wn : 1;
      const double col_scale = col % 2 ? modes[col / 2].wn : 1;
      a[r][col] = row_scale * columns[col][r] * col_scale - (r == col ? mu : 0.0);
    }
  Complex det = 1;
  for (std::size_t i = 0; i < n; ++i) {
    std::size_t p = i;
    for (std::size_t r = i + 1; r < n; ++r)
      if (std::abs(a[r][i]) > std::abs(a[p][i])) p = r;
    if (p != i) {
      std::swap(a[p], a[i]);
      det = -det;
    }
    det *= a[i][i];
    for (std::size_t r = i + 1; r < n; ++r) {
      const Complex f = a[r][i] / a[i][i];
      for (std::size_t col = i; col < n; ++col) a[r][col] -= f * a[i][col];
    }
  }
  return det;
}

/// The exact multiplier next to `guess`.
Complex exact_multiplier(const Case& c, Complex guess, int steps = 1500, int slices = 400) {
  Complex a = guess * Complex(1.001, 0.0005);
  Complex b = guess;
  Complex fa = characteristic(c, a, steps, slices);
  Complex fb = characteristic(c, b, steps, slices);
  for (int i = 0; i < 20 && std::abs(b - a) > 1e-12 && fb != fa; ++i) {
    const Complex next = b - fb * (b - a) / (fb - fa);
    a = b;
    fa = fb;
    b = next;
    fb = characteristic(c, b, steps, slices);
  }
  return b;
}

/// |mu| from integration in time: classical Runge-Kutta, the deflection a tooth ago interpolated by
/// cubic Hermite polynomials, growth over the second half of the run.
double growth_in_time(const Case& c, int passes = 240, int per_pass = 1200) {
  const auto modes = modes_of(c);
  const std::size_t n = 2 * modes.size();
  const double pitch = kTwoPi / c.tool.teeth;
  const double h = pitch / rad_s_from_rpm(c.speed_rpm) / per_pass;
  const auto size = static_cast<std::size_t>(per_pass);
  std::vector<std::array<double, 4>> history(size + 1, {0, 0, 0, 0});  // x, y, x', y'
  std::vector<double> state(n, 0.0), k1(n), k2(n), k3(n), k4(n), probe(n);
  for (std::size_t m = 0; m < modes.size(); ++m) state[2 * m] = 1e-6 * (1 + 0.3 * double(m));
  std::vector<double> log_size;
  double log_scale = 0;
  for (int pass = 0; pass < passes; ++pass) {
    std::vector<std::array<double, 4>> record(size + 1);
    const auto note = [&](std::size_t i) {
      record[i] = {};
      for (std::size_t m = 0; m < modes.size(); ++m) {
        record[i][modes[m].feed ? 0 : 1] += state[2 * m];
        record[i][modes[m].feed ? 2 : 3] += state[2 * m + 1];
      }
    };
    note(0);
    for (std::size_t i = 0; i < size; ++i) {
      const double phi = pitch * static_cast<double>(i) / per_pass;
      const auto& l = history[i];
      const auto& r = history[i + 1];
      const auto middle = [&](std::size_t d) {
        return 0.5 * (l[d] + r[d]) + h / 8 * (l[d + 2] - r[d + 2]);
      };
      const auto rate = [&](double at, double old_x, double old_y, double side,
                            const std::vector<double>& x, std::vector<double>& out) {
        const auto u = tip(modes, x);
        derivative(modes, cutting_stiffness(c, at, side, 60), x, u[0] - old_x, u[1] - old_y, out);
      };
      const double step = pitch / per_pass;
      rate(phi, l[0], l[1], 1, state, k1);
      for (std::size_t j = 0; j < n; ++j) probe[j] = state[j] + h / 2 * k1[j];
      rate(phi + step / 2, middle(0), middle(1), 1, probe, k2);
      for (std::size_t j = 0; j < n; ++j) probe[j] = state[j] + h / 2 * k2[j];
      rate(phi + step / 2, middle(0), middle(1), 1, probe, k3);
      for (std::size_t j = 0; j < n; ++j) probe[j] = state[j] + h * k3[j];
      rate(phi + step, r[0], r[1], -1, probe, k4);
      for (std::size_t j = 0; j < n; ++j)
        state[j] += h / 6 * (k1[j] + 2 * k2[j] + 2 * k3[j] + k4[j]);
      note(i + 1);
    }
    history = record;
    double energy = 0;
    for (const auto& u : record) energy += u[0] * u[0] + u[1] * u[1];
    const double size_now = std::sqrt(energy);
    log_size.push_back(log_scale + std::log(size_now));
    log_scale += std::log(size_now);  // the equation is linear: back to size 1 before it overflows
    for (auto& u : history)
      for (double& value : u) value /= size_now;
    for (double& value : state) value /= size_now;
  }
  // Least-squares slope: the beat of a complex pair averages out.
  const std::size_t from = log_size.size() / 2;
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  const double count = static_cast<double>(log_size.size() - from);
  for (std::size_t i = from; i < log_size.size(); ++i) {
    const double x = static_cast<double>(i);
    sx += x;
    sy += log_size[i];
    sxx += x * x;
    sxy += x * log_size[i];
  }
  return std::exp((count * sxy - sx * sy) / (count * sxx - sx * sx));
}

SemiDiscretization method_of(const Case& c, const SemiDiscretizationConfig& config = {}) {
  return *SemiDiscretization::create(c.structure, c.tool, c.cut, config);
}

void exact_characteristic_equation() {
  for (const Case& c : cases()) {
    const auto found = method_of(c).critical_multiplier(c.speed_rpm, c.depth_m).multiplier;
    const Complex exact = exact_multiplier(c, found);
    const double error = std::abs(found - exact) / std::abs(exact);
    check::figure(std::string("error of the multiplier: ") + c.name, error);
    // Degree 4 over 1.5 rad; with a helix the reference is a sum of 400 slices, good to 2e-5.
    CHECK(error < 5e-5);
  }
}

void order_of_convergence() {
  const Case c = benchmark(1.0, 5000, 0.5e-3);
  const auto start = method_of(c, {6, 0.5}).critical_multiplier(c.speed_rpm, c.depth_m).multiplier;
  const Complex exact = exact_multiplier(c, start, 12000);  // (34.8/12000)^4: below 1e-10
  for (int degree = 1; degree <= 4; ++degree) {
    std::array<double, 2> error{};
    // Halved intervals; coarse for high degrees, which reach rounding early.
    const double coarse = degree <= 2 ? 0.4 : 1.2;
    for (std::size_t i = 0; i < 2; ++i)
      error[i] = std::abs(method_of(c, {degree, coarse / (i == 0 ? 1 : 2)})
                              .critical_multiplier(c.speed_rpm, c.depth_m)
                              .multiplier -
                          exact);
    const double order = std::log2(error[0] / error[1]);
    check::figure("observed order with hold degree " + std::to_string(degree), order);
    // As with Newton-Cotes rules, an even degree gains one order by symmetry.
    CHECK_NEAR(order, degree % 2 ? degree + 1 : degree + 2, 0.15);
  }
}

void growth_and_decay_in_time() {
  for (const Case& c : cases()) {
    const double slow = growth_in_time(c);
    const double mu = method_of(c).spectral_radius(c.speed_rpm, c.depth_m);
    // The entry falls between two time steps (1/1200 of a pass), and a second mode may still ring.
    CHECK_NEAR(mu, slow, 0.005 * slow);
  }
  for (const double immersion : {0.05, 0.5, 1.0}) {
    Case c = benchmark(immersion, 12000, 0);
    const double limit = method_of(c).limit_at(c.speed_rpm, 10e-3).axial_depth_m;
    c.depth_m = 0.95 * limit;
    CHECK(growth_in_time(c) < 1);
    c.depth_m = 1.05 * limit;
    CHECK(growth_in_time(c) > 1);
  }
}

void same_as_zeroth_order_when_the_cut_is_constant() {
  // A slot with four teeth: the directional coefficients of two teeth a quarter turn apart add to a
  // constant, so averaging loses nothing and both methods have the same exact answer.
  Case c = benchmark(1.0, 0, 0);
  c.tool.teeth = 4;
  c.cut.direction = MillingDirection::slot;
  c.structure.y = {{870, 0.02, 0.05}};
  const auto lobes = *StabilityLobes::from_modes(c.structure, c.tool, c.cut);
  const auto method = method_of(c);
  for (const double speed : {4000.0, 5200.0, 7000.0, 9100.0, 12500.0}) {
    const LobePoint zeroth = lobes.limit_at(speed);
    const LobePoint found = method.limit_at(speed, 3 * zeroth.axial_depth_m, 60);
    CHECK_NEAR(found.axial_depth_m, zeroth.axial_depth_m, 1e-4 * zeroth.axial_depth_m);
    CHECK_NEAR(found.chatter_frequency_hz, zeroth.chatter_frequency_hz, 0.5);
  }
}

void flip_lobes_at_small_immersion() {
  const double speed = 18000;
  const Case c = benchmark(0.05, speed, 0);
  const auto method = method_of(c);
  const LobePoint limit = method.limit_at(speed, 10e-3);
  const auto critical = method.critical_multiplier(speed, limit.axial_depth_m);
  CHECK(critical.loss == StabilityLoss::flip);
  CHECK_NEAR(critical.multiplier.real(), -1, 1e-5);
  // Half-integer multiple of the tooth passing frequency of 600 Hz.
  CHECK_NEAR(limit.chatter_frequency_hz, 900, 1e-6);
  const auto lobes = *StabilityLobes::from_modes(c.structure, c.tool, c.cut);
  const double zeroth = lobes.limit_at(speed).axial_depth_m;
  CHECK(zeroth > 2 * limit.axial_depth_m);
  check::figure("flip limit at a/D 0.05, 18000 rpm", limit.axial_depth_m * 1e3, "mm");
  check::figure("zeroth-order limit there", zeroth * 1e3, "mm");

  // At full immersion the benchmark loses stability by a complex pair, at the flexible frequency.
  const Case full = benchmark(1.0, speed, 0);
  const auto wide = method_of(full);
  const auto hopf = wide.critical_multiplier(speed, wide.limit_at(speed, 10e-3).axial_depth_m);
  CHECK(hopf.loss == StabilityLoss::hopf);
  CHECK_NEAR(std::abs(hopf.multiplier), 1, 1e-5);
}

void without_a_cut_the_modes_decay() {
  const Case c = benchmark(0.5, 8000, 0);
  const double period = 60.0 / (2 * 8000);
  CHECK_NEAR(method_of(c).spectral_radius(8000, 0), std::exp(-0.011 * kTwoPi * 922 * period), 1e-9);
}

void chart_does_not_depend_on_threads() {
  const Case c = benchmark(0.1, 0, 0);
  const auto method = method_of(c);
  std::vector<double> speeds, depths;
  for (int i = 0; i < 11; ++i) speeds.push_back(6000 + 1500.0 * i);
  for (int i = 1; i <= 16; ++i) depths.push_back(0.25e-3 * i);
  const auto one = method.chart(speeds, depths, 1);
  const auto three = method.chart(speeds, depths, 3);
  CHECK(one.has_value() && three.has_value());
  CHECK(one->spectral_radius == three->spectral_radius);
  for (std::size_t s = 0; s < speeds.size(); ++s) {
    const LobePoint& limit = one->limit[s];
    CHECK(limit.axial_depth_m == three->limit[s].axial_depth_m);
    for (std::size_t d = 0; d < depths.size(); ++d)
      if (depths[d] < limit.axial_depth_m) CHECK(one->at(s, d) < 1);
    if (std::isfinite(limit.axial_depth_m))
      CHECK_NEAR(method.spectral_radius(speeds[s], limit.axial_depth_m), 1, 1e-5);
  }
}

template <typename T>
void refused(const Expected<T>& result, const std::string& about) {
  CHECK(!result.has_value());
  if (result.has_value()) return;
  CHECK(result.error().sentence.find(about) != std::string::npos);
}

void errors() {
  const auto attempt = [](auto change, const SemiDiscretizationConfig& config = {}) {
    Case c = benchmark(0.5, 0, 0);
    change(c);
    return SemiDiscretization::create(c.structure, c.tool, c.cut, config);
  };
  refused(attempt([](Case& c) { c.structure.x[0].modal_mass_kg = -1; }), "modal mass");
  refused(attempt([](Case& c) { c.structure = {}; }), "no modes");
  refused(attempt([](Case& c) { c.tool.teeth = 0; }), "0 teeth");
  refused(attempt([](Case& c) { c.cut.radial_immersion_m = 0.02; }), "above the tool diameter");
  refused(attempt([](Case&) {}, {0, 1.0}), "hold order");
  refused(attempt([](Case&) {}, {4, 0.0}), "phase per interval");
  const auto method = method_of(benchmark(0.5, 0, 0));
  const std::vector<double> one = {1e-3};
  const std::vector<double> falling = {2e-3, 1e-3};
  const std::vector<double> speed = {8000};
  refused(method.chart({}, one), "No spindle speed");
  refused(method.chart(speed, {}), "No axial depth");
  refused(method.chart(speed, falling), "must rise");
}

}  // namespace

int main() {
  exact_characteristic_equation();
  order_of_convergence();
  growth_and_decay_in_time();
  same_as_zeroth_order_when_the_cut_is_constant();
  flip_lobes_at_small_immersion();
  without_a_cut_the_modes_decay();
  chart_does_not_depend_on_threads();
  errors();
  return check::done();
}
