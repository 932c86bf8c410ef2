// The structure under the cut: closed forms, energy, convergence, stability limits, refusals.
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstring>
#include <functional>
#include <vector>

#include "check.hpp"
#include "servosense/sim/milling_simulator.hpp"
#include "servosense/sim/run_parallel.hpp"

using namespace servosense;

namespace {

MillingSimulator ready(const MillingSimulation& s) {
  auto simulator = MillingSimulator::create(s);
  if (!simulator) {
    check::fail(__FILE__, __LINE__) << simulator.error().sentence << '\n';
    std::exit(check::done());
  }
  return *std::move(simulator);
}

// Koike 2016, fig. 2-22: m 10, c 50, k 39478.6; 10 kN during one step of 0.1 ms.
void one_degree_of_freedom() {
  const double m = 10, c = 50, k = 39478.6, dt = 1e-4;
  const double wn = std::sqrt(k / m), zeta = c / (2 * std::sqrt(k * m));
  Structure structure;
  structure.x = {{wn / kTwoPi, zeta, m}};
  ModalResponse response(structure, dt);
  const double wd = wn * std::sqrt(1 - zeta * zeta);
  const auto step_response = [&](double t) {
    return t <= 0 ? 0.0
                  : 1e4 / k *
                        (1 - std::exp(-zeta * wn * t) *
                                 (std::cos(wd * t) + zeta * wn / wd * std::sin(wd * t)));
  };
  double peak = 0, worst = 0;
  int at = 0;
  for (int i = 0; i < 5000; ++i) {
    const double x = response.advance(i == 1000 ? 1e4 : 0, 0).x_m;
    worst = std::max(worst,
                     std::abs(x - step_response((i - 999) * dt) + step_response((i - 1000) * dt)));
    if (x > peak) {
      peak = x;
      at = i;
    }
  }
  CHECK_NEAR(worst, 0, 1e-14);
  // The source's semi-implicit Euler peaks at 1.4976 mm in step 1243; it applies the impulse up to
  // a step early and is off by w dt = 0.6 % at most.
  CHECK_NEAR(peak, 1.4976e-3, wn * dt * 1.4976e-3);
  CHECK_BETWEEN(at, 1242, 1245);
  check::figure("one degree of freedom: peak, exact", peak * 1e3, "mm");
}

// Four straight teeth in a slot load the tool with a constant force: an exactly linear,
// time-invariant cut.
MillingSimulation constant_slot() {
  MillingSimulation s;
  s.tool.diameter_m = 20e-3;
  s.tool.teeth = 4;
  s.tool.force.tangential_coefficient_N_per_m2 = 600e6;
  s.tool.force.radial_ratio = 0.3;
  s.structure.x = {{600, 0.03, 0.4}};
  s.structure.y = {{660, 0.03, 0.4}};
  s.cut = {3000, 50e-6, 0.2e-3, 0, MillingDirection::slot};
  s.step_s = 1e-5;
  return s;
}

void static_deflection() {
  MillingSimulation s = constant_slot();
  // Tarng 1988, table 5.1: five modes, static compliance 4.775e-9 m/N.
  s.structure.x = {{274, 0.047, 680.0},
                   {396, 0.140, 90.9},
                   {474, 0.027, 80.3},
                   {633, 0.037, 260.6},
                   {855, 0.028, 40.5}};
  s.structure.y = s.structure.x;
  MillingSimulator simulator = ready(s);
  while (simulator.now().t_s < 0.5) simulator.step();
  const double force = 600e6 * 0.2e-3 * 50e-6;  // sum of sin^2 over two teeth a right angle apart
  MillingStep n;                                // mean over a revolution
  for (int i = 0; i < 2000; ++i) {
    simulator.step();
    n.fx_N += simulator.now().fx_N / 2000;
    n.fy_N += simulator.now().fy_N / 2000;
    n.x_m += simulator.now().x_m / 2000;
    n.y_m += simulator.now().y_m / 2000;
  }
  CHECK_NEAR(n.fx_N, -0.3 * force, 1e-4 * force);
  CHECK_NEAR(n.fy_N, force, 1e-4 * force);
  CHECK_NEAR(n.x_m, -0.3 * force * 4.775e-9, 1e-3 * force * 4.775e-9);
  CHECK_NEAR(n.y_m, force * 4.775e-9, 1e-3 * force * 4.775e-9);
}

MillingSimulation helical_cut() {
  MillingSimulation s = constant_slot();
  s.tool.teeth = 2;
  s.tool.helix_deg = 30;
  s.cut = {3000, 50e-6, 5e-3, 1.5e-3, MillingDirection::down};
  s.layers = 32;
  s.surface_points = 2000;
  return s;
}

// The work of the cutting force goes into motion, springs and dampers, and nowhere else.
void energy_balance() {
  MillingSimulation s = helical_cut();
  s.step_s = 2e-6;
  MillingSimulator simulator = ready(s);
  const StructuralMode modes[] = {s.structure.x[0], s.structure.y[0]};
  double work = 0, lost = 0, x = 0, y = 0;
  const auto drag = [&](const MillingStep& n) {
    const double v[] = {n.vx_m_s, n.vy_m_s};
    double power = 0;
    for (int i = 0; i < 2; ++i)
      power += 2 * modes[i].damping_ratio * modes[i].natural_frequency_rad_s() *
               modes[i].modal_mass_kg * v[i] * v[i];
    return power;
  };
  double before = 0;
  while (simulator.now().t_s < 0.1) {
    const MillingStep& n = simulator.step();
    work += n.fx_N * (n.x_m - x) + n.fy_N * (n.y_m - y);
    lost += (before + drag(n)) / 2 * s.step_s;
    before = drag(n);
    x = n.x_m;
    y = n.y_m;
  }
  const MillingStep& n = simulator.now();
  const double stored =
      (modes[0].modal_mass_kg * n.vx_m_s * n.vx_m_s + modes[0].stiffness_N_per_m() * x * x +
       modes[1].modal_mass_kg * n.vy_m_s * n.vy_m_s + modes[1].stiffness_N_per_m() * y * y) /
      2;
  check::figure("work of the force on the tool", work, "J");
  CHECK(work > 1e-4);
  // The trapezium over v^2: (2 w h)^2/12 = 2.3e-5 of what is lost.
  CHECK_NEAR(work, stored + lost, 3e-5 * lost);
}

void convergence() {
  std::vector<std::vector<double>> y;
  for (const double step : {16e-6, 8e-6, 4e-6, 2e-6}) {
    MillingSimulation s = helical_cut();
    s.step_s = step;
    s.surface_points = 1000;
    MillingSimulator simulator = ready(s);
    const int stride = static_cast<int>(std::lround(16e-6 / step));
    y.emplace_back();
    for (int i = 1; i <= 3000 * stride; ++i)
      if (simulator.step(); i % stride == 0) y.back().push_back(simulator.now().y_m);
  }
  const auto difference = [&](std::size_t a) {
    double sum = 0;
    for (std::size_t i = 0; i < y[a].size(); ++i)
      sum += (y[a][i] - y[a + 1][i]) * (y[a][i] - y[a + 1][i]);
    return std::sqrt(sum / static_cast<double>(y[a].size()));
  };
  double level = 0;
  for (const double v : y.back()) level += v * v / static_cast<double>(y.back().size());
  level = std::sqrt(level);
  check::figure("16 -> 8 us: rms change / rms", difference(0) / level);
  check::figure("8 -> 4 us", difference(1) / level);
  check::figure("4 -> 2 us", difference(2) / level);
  CHECK(difference(2) / level < 1e-4);
  // Second order, a quarter each time, once a step is shorter than a surface spacing (20 us here).
  CHECK_BETWEEN(difference(1) / difference(2), 3, 5.5);
  CHECK(difference(0) < 0.01 * level);
}

// Zeroth-order stability (Koike 2016, 2-90 to 2-100, as repaired), exact for the constant slot.
double limit_depth(const MillingSimulation& s) {
  const double kr = s.tool.force.radial_ratio, n = s.tool.teeth;
  const double xx = -kr * kPi, xy = -kPi, yx = kPi, yy = -kr * kPi;
  const double period = 60 / (n * s.cut.spindle_speed_rpm);
  double best = 1e9;
  std::complex<double> last_root[2];
  double last_miss[2] = {0, 0}, last_depth[2] = {0, 0};
  for (double f = 300; f < 1500; f += 0.01) {
    const double w = kTwoPi * f;
    const auto gx = s.structure.x[0].receptance(w), gy = s.structure.y[0].receptance(w);
    const auto c0 = gx * gy * (xx * yy - xy * yx), c1 = xx * gx + yy * gy;
    const auto root = std::sqrt(c1 * c1 - 4.0 * c0);
    std::complex<double> lambda[2] = {(-c1 + root) / (2.0 * c0), (-c1 - root) / (2.0 * c0)};
    if (std::abs(lambda[0] - last_root[0]) > std::abs(lambda[1] - last_root[0]))
      std::swap(lambda[0], lambda[1]);
    for (int i = 0; i < 2; ++i) {
      const double kappa = lambda[i].imag() / lambda[i].real();
      const double depth = -kTwoPi * lambda[i].real() /
                           (n * s.tool.force.tangential_coefficient_N_per_m2) * (1 + kappa * kappa);
      double miss = w * period - (kPi - 2 * std::atan(kappa));
      miss -= kTwoPi * std::round(miss / kTwoPi);
      if (depth > 0 && last_depth[i] > 0 && miss * last_miss[i] <= 0 && std::abs(miss) < 1)
        best = std::min(best, depth);
      last_miss[i] = miss;
      last_depth[i] = depth;
      last_root[i] = lambda[i];
    }
  }
  return best;
}

// Growth of the vibration about its constant deflection, per tooth.
double growth(const MillingSimulation& s) {
  MillingSimulator simulator = ready(s);
  const double tooth = 60 / (s.cut.spindle_speed_rpm * s.tool.teeth);
  const auto level = [&](double until) {
    std::vector<double> x, y;
    while (simulator.now().t_s < until) {
      simulator.step();
      x.push_back(simulator.now().x_m);
      y.push_back(simulator.now().y_m);
    }
    double sum = 0;
    for (const auto& v : {x, y}) {
      double mean = 0;
      for (const double e : v) mean += e / static_cast<double>(v.size());
      for (const double e : v) sum += (e - mean) * (e - mean);
    }
    return std::sqrt(sum);
  };
  level(150 * tooth);
  const double early = level(200 * tooth);
  level(300 * tooth);
  const double late = level(350 * tooth);
  return std::pow(late / early, 1.0 / 150);
}

void stability_limit() {
  for (const double speed : {2600.0, 3000.0, 3300.0}) {
    MillingSimulation s = constant_slot();
    s.cut.spindle_speed_rpm = speed;
    const double limit = limit_depth(s);
    // Teeth leave the cut near phi = 0 and pi as soon as they vibrate by a few % of the feed, and
    // the cut is not linear then. Below the limit all vibration dies out, so the decay there is
    // linear: parabola through log mu at three depths, followed to where it is zero.
    const double at[] = {0.92, 0.95, 0.98};
    double log_mu[3];
    for (int i = 0; i < 3; ++i) {
      s.cut.axial_depth_m = at[i] * limit;
      log_mu[i] = std::log(growth(s));
    }
    double found = at[2];
    for (; found < 1.5; found += 1e-4) {
      double value = 0;
      for (int i = 0; i < 3; ++i) {
        double term = log_mu[i];
        for (int j = 0; j < 3; ++j)
          if (j != i) term *= (found - at[j]) / (at[i] - at[j]);
        value += term;
      }
      if (value >= 0) break;
    }
    check::figure("limit depth, exact", limit * 1e3, "mm");
    check::figure("limit depth, simulated / exact", found);
    CHECK_NEAR(found, 1, 0.02);  // the parabola's reach: about its last interval
    s.cut.axial_depth_m = 1.3 * limit;
    CHECK(growth(s) > 0.999);  // does not die out
  }
}

// Tables 4.1 and 4.2 of Tarng 1988.
MillingSimulation face_mill(double depth_m) {
  MillingSimulation s;
  s.tool.diameter_m = 101.6e-3;
  s.tool.teeth = 8;
  s.tool.force.tangential_coefficient_N_per_m2 = 1500e6;
  s.tool.force.radial_ratio = 0.5263;
  s.cut = {600, 0.254e-3, depth_m, 50.8e-3, MillingDirection::up};
  s.structure.x = {{468, 0.04, 18.6}};
  s.structure.y = {{515, 0.04, 19.2}};
  s.step_s = 1e-5;
  return s;
}

struct Vibration {
  double normal = 0, early = 0, late = 0, mean_torque = 0;
};
Vibration vibration(const MillingSimulation& s) {
  MillingSimulator simulator = ready(s);
  Vibration v;
  int counted = 0;
  while (simulator.now().t_s < 2) {
    const MillingStep& n = simulator.step();
    const double theta = std::fmod(n.angle_rad, kPi / 4);
    if (n.t_s > 0.1)
      for (const double t : {theta, theta + kPi / 4})
        v.normal = std::max(v.normal, std::abs(n.x_m * std::sin(t) + n.y_m * std::cos(t)));
    double& peak = n.t_s < 0.2 ? v.early : v.late;
    if (n.t_s < 0.2 || n.t_s > 1.5) peak = std::max(peak, std::hypot(n.x_m, n.y_m));
    if (n.t_s > 1) {
      v.mean_torque += n.torque_Nm;
      ++counted;
    }
  }
  v.mean_torque /= counted;
  return v;
}

void chatter_onset() {
  const Vibration thin = vibration(face_mill(1.27e-3));
  CHECK_NEAR(thin.normal, 4.2e-6, 0.1e-6);  // digest: about 4.2 um
  const Vibration stable = vibration(face_mill(5e-3)), chatter = vibration(face_mill(8e-3));
  // Amplitude for each mm of depth, against the thin cut: 1 would be a rigid process.
  const double at_5 = stable.late / 5 / (thin.late / 1.27);
  const double at_8 = chatter.late / 8 / (thin.late / 1.27);
  check::figure("amplitude per depth, 5 mm against 1.27 mm", at_5);
  check::figure("amplitude per depth, 8 mm against 1.27 mm", at_8);
  CHECK(at_5 < 1.25);
  CHECK(at_8 > 2);
  // Teeth leave the cut and others take what they left: over time nothing is lost.
  const double mean = 8 * 1500e6 * 8e-3 * 0.254e-3 * 50.8e-3 / kTwoPi;
  CHECK_NEAR(chatter.mean_torque, mean, 0.01 * mean);

  // Regeneration hardly changes a stable cut: averages of tooth periods, tooth 1 missing.
  MillingSimulation flexible = face_mill(1.27e-3);
  flexible.tool.broken_fraction = {1, 0, 0, 0, 0, 0, 0, 0};
  MillingSimulation rigid = flexible;
  rigid.structure = {};
  std::vector<double> averages[2];
  for (const bool moves : {false, true}) {
    MillingSimulator simulator = ready(moves ? flexible : rigid);
    for (int j = 0; j < 24; ++j) {
      double fx = 0, fy = 0;
      for (int i = 0; i < 1250; ++i) {
        simulator.step();
        fx += simulator.now().fx_N / 1250;
        fy += simulator.now().fy_N / 1250;
      }
      averages[moves].push_back(std::hypot(fx, fy));
    }
  }
  for (std::size_t j = 16; j < 24; ++j)
    CHECK_NEAR(averages[1][j], averages[0][j], 0.01 * averages[0][j]);
}

// Regeneration over several teeth with teeth leaving the cut, against the plain closed form over
// all earlier passes, on a fine step with the integrator of the sources (semi-implicit Euler).
void multiple_regeneration() {
  MillingSimulation s = constant_slot();
  s.tool.teeth = 2;
  s.cut = {6000, 30e-6, 4e-3, 10e-3, MillingDirection::up};
  s.step_s = 2e-6;
  MillingSimulator simulator = ready(s);

  constexpr int kPerTooth = 20000;  // steps of 0.25 us
  const double h = 0.005 / kPerTooth, kt = 600e6, c = 0.3;
  double q[2] = {0, 0}, v[2] = {0, 0};
  std::vector<std::array<double, 2>> past;
  double peak = 0, worst = 0;
  int jumped = 0;
  for (int n = 0; n < 10 * kPerTooth; ++n) {
    const double theta = kPi * (n % kPerTooth) / kPerTooth, st = std::sin(theta),
                 ct = std::cos(theta);
    double force[2] = {0, 0};
    if (theta < kPi / 2) {
      double chip = 1e9;
      for (int k = 1; k <= 40; ++k) {
        const int then = n - k * kPerTooth;
        const double z = then < 0 ? 0.0
                                  : past[static_cast<std::size_t>(then)][0] * st +
                                        past[static_cast<std::size_t>(then)][1] * ct;
        chip = std::min(chip, k * 30e-6 * st + q[0] * st + q[1] * ct - z);
      }
      jumped += chip < 0;
      const double ft = kt * 4e-3 * std::max(chip, 0.0);
      force[0] = -ft * ct - c * ft * st;
      force[1] = ft * st - c * ft * ct;
    }
    past.push_back({q[0], q[1]});
    const StructuralMode modes[] = {s.structure.x[0], s.structure.y[0]};
    for (int i = 0; i < 2; ++i) {
      const double w = modes[i].natural_frequency_rad_s();
      v[i] += h * (force[i] / modes[i].modal_mass_kg - 2 * modes[i].damping_ratio * w * v[i] -
                   w * w * q[i]);
      q[i] += h * v[i];
    }
    if ((n + 1) % 8 == 0) {
      const MillingStep& now = simulator.step();
      worst = std::max(worst, std::hypot(now.x_m - q[0], now.y_m - q[1]));
      peak = std::max(peak, std::hypot(q[0], q[1]));
    }
  }
  check::figure("steps out of the cut in the reference", jumped);
  check::figure("largest difference / peak amplitude", worst / peak);
  CHECK(jumped > kPerTooth / 20);
  CHECK_NEAR(worst, 0, 0.01 * peak);
}

// A cut that does not remember: four straight teeth in a slot are a spring K of the cut, h = f
// sin(theta) + n.u, so that the structure rests where (k + K) u = F of the rigid tool; with memory,
// where k u = F.
void forced_vibration() {
  for (const bool regeneration : {false, true}) {
    MillingSimulation s = constant_slot();
    s.cut.regeneration = regeneration;
    MillingSimulator simulator = ready(s);
    while (simulator.now().t_s < 0.3) simulator.step();
    // Two teeth a right angle apart: sums of sin^2 and cos^2 are 1, of sin cos 0.
    const double kt = 600e6 * 0.2e-3, kr = 0.3 * kt, feed = 50e-6;
    const double kx = s.structure.x[0].stiffness_N_per_m();
    const double ky = s.structure.y[0].stiffness_N_per_m();
    // Force on the tool for a chip c.n: (-kr cx - kt cy, kt cx - kr cy), c = (f, 0) + u.
    const double a = regeneration ? 0 : 1;
    const double m11 = kx + a * kr, m12 = a * kt, m21 = -a * kt, m22 = ky + a * kr;
    const double fx = -kr * feed, fy = kt * feed, det = m11 * m22 - m12 * m21;
    double x = 0, y = 0;  // means over a revolution
    for (int i = 0; i < 2000; ++i) {
      simulator.step();
      x += simulator.now().x_m / 2000;
      y += simulator.now().y_m / 2000;
    }
    // Teeth that deflect away from the wall leave it for some degrees: some thousandths.
    CHECK_NEAR(x, (fx * m22 - m12 * fy) / det, 0.01 * std::abs(y));
    CHECK_NEAR(y, (m11 * fy - m21 * fx) / det, 0.01 * std::abs(y));
  }
}

// Whole cuts of every kind, as a sweep runs them: the same bytes on any number of threads.
void same_bytes() {
  constexpr std::size_t kCuts = 8;
  const auto cut = [](std::size_t i) {
    MillingSimulation s = helical_cut();
    s.cut.axial_depth_m *= 1 + 0.25 * static_cast<double>(i);
    s.cut.spindle_speed_rpm += 150 * static_cast<double>(i);
    if (i == 1) s.tool.force.tangential_edge_N_per_m = 2e4;
    if (i == 2) s.trochoidal_path = true;
    if (i == 3) s.tool.force.process_damping_N_per_m = 1e4;
    if (i == 4) s.breaks = {{0.02, 2, 0.4}};
    if (i == 5) s.start = MillingStart::entry;
    if (i == 6) s.speed = SpindleSpeedProfile::ramp(3600, 3000, 50, 3300);
    if (i == 7) s.workpiece = {0.1, 1e-3, 8e-3, {}, {}};
    return s;
  };
  const auto sweep = [&](unsigned threads) {
    std::vector<std::vector<double>> results(kCuts);
    run_parallel(
        kCuts,
        [&](std::size_t i) {
          MillingSimulator simulator = ready(cut(i));
          std::vector<double>& all = results[i];
          const auto done =
              simulator.run(0.05, 8000, Decimation::average, [&](const MillingStep& n) {
                all.insert(all.end(), {n.t_s, n.angle_rad, n.spindle_speed_rad_s, n.feed_m, n.fx_N,
                                       n.fy_N, n.torque_Nm, n.x_m, n.y_m, n.vx_m_s, n.vy_m_s,
                                       static_cast<double>(n.teeth_in_cut)});
              });
          if (!done) all.clear();
          const std::vector<double>& wall = simulator.surface().wall(0).height_m;
          all.insert(all.end(), wall.begin(), wall.end());
        },
        threads);
    return results;
  };
  const auto alone = sweep(1);
  for (const unsigned threads : {2u, 5u}) {
    const auto crew = sweep(threads);
    for (std::size_t i = 0; i < kCuts; ++i) {
      CHECK(alone[i].size() > 400 * 12);
      CHECK(alone[i].size() == crew[i].size());
      CHECK(std::memcmp(alone[i].data(), crew[i].data(),
                        std::min(alone[i].size(), crew[i].size()) * sizeof(double)) == 0);
    }
  }
  // The cuts are not one and the same.
  for (std::size_t i = 1; i < kCuts; ++i) CHECK(alone[i] != alone[0]);

  // Decimation by averaging keeps the mean, and samples arrive when they are due.
  MillingSimulation s = helical_cut();
  s.step_s = 2e-6;
  const auto fine = ready(s).run(0.02, 1e9), coarse = ready(s).run(0.02, 8000);
  CHECK(fine && coarse && fine->size() == 10000 && coarse->size() == 160);
  double a = 0, b = 0;
  for (const auto& n : *fine) a += n.torque_Nm / 10000;
  for (std::size_t i = 0; i < coarse->size(); ++i) {
    b += (*coarse)[i].torque_Nm / 160;
    CHECK_NEAR((*coarse)[i].t_s, static_cast<double>(i + 1) / 8000, 2e-6);
  }
  CHECK_NEAR(a, b, 0.01 * a);  // 62 or 63 steps a sample: weights differ by 1/63
}

void refusals() {
  const auto refused = [](const std::function<void(MillingSimulation&)>& spoil, const char* word) {
    MillingSimulation s = helical_cut();
    spoil(s);
    const auto simulator = MillingSimulator::create(s);
    CHECK(!simulator.has_value());
    if (!simulator && simulator.error().sentence.find(word) == std::string::npos)
      check::fail(__FILE__, __LINE__)
          << "\"" << simulator.error().sentence << "\" lacks " << word << '\n';
  };
  using S = MillingSimulation;
  const double nan = std::nan("");
  refused([](S& s) { s.tool.teeth = 0; }, "no teeth");
  refused([](S& s) { s.tool.diameter_m = -1; }, "diameter");
  refused([](S& s) { s.tool.helix_deg = 90; }, "helix");
  refused([](S& s) { s.tool.throw_m = {1e-6}; }, "each of the 2 teeth");
  refused([](S& s) { s.tool.broken_fraction = {0, 1.5}; }, "broken fraction");
  refused([](S& s) { s.tool.tooth_angle_rad = {0, 7}; }, "tooth angles");
  refused([](S& s) { s.tool.tooth_angle_rad = {0, 1e-3}; }, "0.1 degrees");
  refused([](S& s) { s.tool.force.tangential_coefficient_N_per_m2 = 0; }, "tangential");
  refused([](S& s) { s.cut.radial_immersion_m = 21e-3; }, "above the diameter");
  refused([](S& s) { s.cut.axial_depth_m = 0; }, "axial depth");
  refused([](S& s) { s.cut.feed_per_tooth_m = 0; }, "feed per tooth");
  refused([&](S& s) { s.cut.spindle_speed_rpm = nan; }, "spindle speed");
  refused([](S& s) { s.structure.x[0].modal_mass_kg = -0.4; }, "modal mass");
  refused([](S& s) { s.structure.y[0].natural_frequency_hz = 0; }, "natural frequency");
  refused([](S& s) { s.structure.y[0].damping_ratio = 1.2; }, "damping ratio");
  refused([](S& s) { s.step_s = 1e-3; }, "too long");
  refused([&](S& s) { s.step_s = nan; }, "step");
  refused([](S& s) { s.layers = 0; }, "layers");
  refused([](S& s) { s.surface_points = 3; }, "surface points");
  refused([](S& s) { s.speed.points = {{0, 3000}, {0, 2000}}; }, "ascend");
  refused([](S& s) { s.speed.points = {{0, -3000}}; }, "speed");
  refused([](S& s) { s.workpiece.length_m = 0; }, "length");
  refused([](S& s) { s.workpiece.far_depth_m = 1e-3; }, "wedge");
  refused([](S& s) { s.workpiece.holes = {{0, 0, 0}}; }, "hole");
  refused([](S& s) { s.breaks = {{0.1, 3, 1}}; }, "tooth break");
  // A cut far beyond its limit in a wide slot throws the tool about: said, not simulated on.
  MillingSimulation s = constant_slot();
  s.cut.axial_depth_m = 40e-3;
  s.tool.helix_deg = 30;
  MillingSimulator simulator = ready(s);
  const auto run = simulator.run(2, 8000);
  CHECK(!run && simulator.lost());
  CHECK(std::isfinite(simulator.now().x_m));
}

}  // namespace

int main() {
  one_degree_of_freedom();
  static_deflection();
  energy_balance();
  convergence();
  stability_limit();
  chatter_onset();
  multiple_regeneration();
  forced_vibration();
  same_bytes();
  refusals();
  return check::done();
}
