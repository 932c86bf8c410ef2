// The milling simulator against the stability charts. Two runs of the simulator that differ by a
// hammer blow too weak to lift a tooth out of the cut show the growth of a small vibration; its
// largest multiplier per tooth period is fitted to the difference and laid beside
// semi-discretisation, at random machines, cuts and speeds, 5 % below and above the limit depth.
// `--nightly` runs the whole set.
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/identify/growth_ratio.hpp"
#include "servosense/identify/semi_discretization.hpp"
#include "servosense/identify/stability_lobes.hpp"
#include "servosense/sim/milling_simulator.hpp"

using namespace servosense;

namespace {

struct Case {
  Structure structure;
  MillingTool tool;
  MillingCut cut;  // speed and feed; the depth varies
};

MillingSimulator ready(const MillingSimulation& s) {
  auto simulator = MillingSimulator::create(s);
  if (!simulator) {
    check::fail(__FILE__, __LINE__) << simulator.error().sentence << '\n';
    std::exit(check::done());
  }
  return *std::move(simulator);
}

/// Steps in a tooth period, so that the fastest mode, stiffened by the cut, has `per_vibration` of
/// them and the arc of a tooth as many.
int steps_per_tooth(const Case& c, double depth_m, double per_vibration) {
  const double period = 60 / (c.cut.spindle_speed_rpm * c.tool.teeth);
  double fastest = 0;
  for (const auto* axis : {&c.structure.x, &c.structure.y})
    for (const StructuralMode& m : *axis) {
      const double stiffness =
          m.stiffness_N_per_m() + c.tool.force.tangential_coefficient_N_per_m2 *
                                      (1 + c.tool.force.radial_ratio) * depth_m * c.tool.teeth;
      fastest = std::max(fastest, std::sqrt(stiffness / m.modal_mass_kg) / kTwoPi);
    }
  const double arc = engagement_of(c.tool, c.cut).swept_rad() * c.tool.teeth / kTwoPi;
  // Even: no step has its middle where a chip ends at zero.
  return 2 * static_cast<int>(
                 std::ceil(per_vibration / 2 * std::max({fastest * period, 1 / arc, 1.0})));
}

/// Helix of deep cuts runs around the tool: layers this thin resolve the arc and the wave on it.
constexpr double kLagPerLayer = 0.04;  // rad

/// |mu| of the simulated cut: how much a vibration grows in a tooth period. A rigid tool's force,
/// reversed, and a damper that only sees the undisturbed run hold that run still, on its periodic
/// solution. The disturbed run bears the same loads from outside: they are no part of its
/// stability.
double simulated_growth(const Case& c, double depth_m, double per_vibration) {
  const int steps = steps_per_tooth(c, depth_m, per_vibration);
  MillingSimulation s;
  s.tool = c.tool;
  s.cut = c.cut;
  s.cut.axial_depth_m = depth_m;
  s.step_s = 60 / (c.cut.spindle_speed_rpm * c.tool.teeth) / steps;
  const double lag = depth_m * std::tan(rad_from_deg(c.tool.helix_deg)) / c.tool.radius_m();
  s.layers = std::max(32, static_cast<int>(std::ceil(lag / kLagPerLayer)));
  s.surface_points = steps * c.tool.teeth;  // a tooth passes a point a step
  const double h = s.step_s;

  std::vector<std::array<double, 2>> rigid;
  MillingSimulator stiff = ready(s);
  for (int i = 0; i < steps; ++i) {
    const MillingStep& n = stiff.step();
    rigid.push_back({n.fx_N, n.fy_N});
  }

  s.structure = c.structure;
  MillingSimulator quiet = ready(s);
  MillingSimulator struck = quiet;
  double slowest = 1e300;
  std::array<double, 2> mass{};  // that a blow on the tool meets
  for (std::size_t d = 0; d < 2; ++d) {
    for (const StructuralMode& m : d == 0 ? c.structure.x : c.structure.y) {
      mass[d] += 1 / m.modal_mass_kg;
      slowest = std::min(slowest, m.natural_frequency_rad_s());
    }
    mass[d] = 1 / mass[d];
  }
  // At first a ten-millionth of the feed, at last a thousandth: far above rounding, far below the
  // chip.
  const double feed = c.cut.feed_per_tooth_m;
  struck.strike(1e-7 * feed * slowest * mass[0], -0.7e-7 * feed * slowest * mass[1]);

  constexpr int kLooks = 16;  // a tooth period
  constexpr int kFewest = 12, kMost = 90;
  constexpr double kDamper = 0.2;  // share of the velocity that a step takes
  std::vector<Eigen::VectorXd> periods;
  double moved = 0;
  double x = 0, y = 0;  // impulse from outside
  for (int tooth = 0; tooth < kMost; ++tooth) {
    Eigen::VectorXd z(4 * kLooks);
    int look = 0;
    for (int i = 0; i < steps; ++i) {
      const auto& f = rigid[static_cast<std::size_t>(i)];
      // The state reported lacks the second half of the last impulse.
      x = -f[0] * h - kDamper * (mass[0] * quiet.now().vx_m_s + x / 2);
      y = -f[1] * h - kDamper * (mass[1] * quiet.now().vy_m_s + y / 2);
      for (MillingSimulator* m : {&quiet, &struck}) {
        m->strike(x / 2, y / 2);
        m->step();
        m->strike(x / 2, y / 2);
      }
      const MillingStep &a = quiet.now(), &b = struck.now();
      moved = std::max({moved, std::abs(b.x_m), std::abs(b.y_m)});
      if (i < look * steps / kLooks) continue;
      z.segment<4>(4 * look++) << b.x_m - a.x_m, b.y_m - a.y_m, (b.vx_m_s - a.vx_m_s) / slowest,
          (b.vy_m_s - a.vy_m_s) / slowest;
    }
    periods.push_back(z);
    const double grown = z.norm() / periods.front().norm();
    if (tooth >= kFewest && (grown > 1e3 || grown < 1e-2)) break;
  }
  // Where a tooth comes in or goes out without a chip (phi 0 or pi) the wall keeps the farthest
  // reach for ever. That offset is no vibration; the change from period to period is free of it.
  for (std::size_t k = 0; k + 1 < periods.size(); ++k) periods[k] -= periods[k + 1];
  periods.pop_back();

  // Dynamic mode decomposition: the linear map of one period to the next, on the space they span.
  const std::size_t skip = std::min<std::size_t>(10, periods.size() / 3);  // what dies out at once
  const auto count = static_cast<Eigen::Index>(periods.size() - skip - 1);
  Eigen::MatrixXd before(4 * kLooks, count), after(4 * kLooks, count);
  for (Eigen::Index k = 0; k < count; ++k) {
    const std::size_t at = skip + static_cast<std::size_t>(k);
    const double scale = 1 / periods[at].norm();  // each period counts alike
    before.col(k) = scale * periods[at];
    after.col(k) = scale * periods[at + 1];
  }
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(before, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const Eigen::VectorXd& spread = svd.singularValues();
  const auto rank =
      std::count_if(spread.begin(), spread.end(), [&](double v) { return v > 1e-5 * spread[0]; });
  const Eigen::MatrixXd map = svd.matrixU().leftCols(rank).transpose() * after *
                              svd.matrixV().leftCols(rank) *
                              spread.head(rank).cwiseInverse().asDiagonal();
  // Only what is still there in the last period: rounding has multipliers of its own.
  const Eigen::EigenSolver<Eigen::MatrixXd> modes(map);
  const Eigen::VectorXd last = svd.matrixU().leftCols(rank).transpose() * before.col(count - 1);
  const Eigen::VectorXd strength =
      modes.eigenvectors().partialPivLu().solve(last.cast<std::complex<double>>()).cwiseAbs();
  double largest = 0;
  for (Eigen::Index i = 0; i < rank; ++i)
    if (strength[i] > 0.01 * strength.maxCoeff())
      largest = std::max(largest, std::abs(modes.eigenvalues()[i]));
  // Linear to the end, or the figure is none.
  if (!(moved < 0.02 * feed))
    check::fail(__FILE__, __LINE__) << "the struck tool vibrates by " << moved / feed << " feeds\n";
  return largest;
}

/// Draws that are the same on every machine.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_(seed) {}
  double between(double low, double high) {
    return low + (high - low) * static_cast<double>(random_() >> 11) * 0x1p-53;
  }
  double log_between(double low, double high) {
    return std::exp(between(std::log(low), std::log(high)));
  }
  int whole(int low, int high) {
    return low + static_cast<int>(random_() % static_cast<std::uint64_t>(high - low + 1));
  }

 private:
  std::mt19937_64 random_;
};

Case random_case(Draw& draw, bool helical) {
  Case c;
  const auto modes = [&] {
    std::vector<StructuralMode> axis;
    for (int n = draw.whole(1, 2); n > 0; --n)
      axis.push_back(
          {draw.between(300, 2000), draw.log_between(0.01, 0.05), draw.log_between(0.05, 2)});
    return axis;
  };
  c.structure = {modes(), modes()};
  c.tool.teeth = draw.whole(1, 6);
  c.tool.diameter_m = draw.log_between(8e-3, 50e-3);
  c.tool.force.tangential_coefficient_N_per_m2 = draw.log_between(400e6, 2500e6);
  c.tool.force.radial_ratio = draw.between(0.1, 0.7);
  if (helical) c.tool.helix_deg = draw.between(10, 45);
  c.cut.direction = static_cast<MillingDirection>(draw.whole(0, 2));
  c.cut.radial_immersion_m = c.tool.diameter_m * draw.log_between(0.05, 1);
  c.cut.feed_per_tooth_m = 0.1e-3;
  // The vibrations of one of the modes from tooth to tooth: whole numbers and all between.
  const auto& axis = draw.whole(0, 1) == 0 ? c.structure.x : c.structure.y;
  const double frequency =
      axis[static_cast<std::size_t>(draw.whole(0, static_cast<int>(axis.size()) - 1))]
          .natural_frequency_hz;
  c.cut.spindle_speed_rpm = 60 * frequency / (c.tool.teeth * draw.log_between(0.4, 8));
  return c;
}

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

/// Seeds differ between straight and helical teeth; every point that disagrees is printed with its.
void random_cuts(std::uint64_t seed, int points, bool helical, double per_vibration) {
  Draw draw(seed);
  int agree = 0, islands = 0, drawn = 0, damped = 0, unlimited = 0;
  std::vector<double> depth_errors, multiplier_errors;
  while (drawn < points) {
    const Case c = random_case(draw, helical);
    const double lowest =
        StabilityLobes::from_modes(c.structure, c.tool, c.cut)->minimum().axial_depth_m;
    damped += !std::isfinite(lowest);
    if (!std::isfinite(lowest)) continue;  // an arc that damps every mode
    const auto method = *SemiDiscretization::create(c.structure, c.tool, c.cut);
    const double speed = c.cut.spindle_speed_rpm;
    const double limit = method.limit_at(speed, 20 * lowest, 200).axial_depth_m;
    unlimited += !std::isfinite(limit);
    if (!std::isfinite(limit)) continue;  // a pocket deeper than twenty times the lowest limit
    ++drawn;
    double excess = 0;
    std::array<double, 2> simulated{}, predicted{};
    for (const std::size_t i : {0U, 1U}) {
      const double depth = (i == 0 ? 0.95 : 1.05) * limit;
      simulated[i] = simulated_growth(c, depth, per_vibration);
      predicted[i] = method.spectral_radius(speed, depth);
      excess += simulated[i] - predicted[i];
      multiplier_errors.push_back(std::abs(simulated[i] - predicted[i]));
    }
    const bool same = simulated[0] < 1 && simulated[1] > 1;
    agree += same;
    // Stable again 5 % above the limit: a thin island of instability, known to the chart.
    islands += predicted[1] < 1 && simulated[0] < 1 && simulated[1] < 1;
    // Both multipliers are off by an amount that this much depth makes.
    depth_errors.push_back(0.05 * std::abs(excess / (predicted[1] - predicted[0])));
    if (!same)
      std::printf(
          "  seed %llu point %d: %d teeth, %s, a/D %.3f, %.0f rpm, limit %.4g mm: simulated %.5f "
          "and %.5f, predicted %.5f and %.5f\n",
          static_cast<unsigned long long>(seed), drawn, c.tool.teeth,
          std::array{"up", "down", "slot"}[static_cast<std::size_t>(c.cut.direction)],
          c.cut.radial_immersion_m / c.tool.diameter_m, speed, limit * 1e3, simulated[0],
          simulated[1], predicted[0], predicted[1]);
  }
  check::figure(helical ? "random cuts, helical teeth" : "random cuts, straight teeth", points);
  check::figure("drawn and left out: no lobe at all", damped);
  check::figure("drawn and left out: no limit within 20 times the lowest", unlimited);
  check::figure("stable 5 % below the limit and unstable 5 % above", 100.0 * agree / points, "%");
  check::figure("of the rest: in both stable again above a thin island", islands);
  for (const double share : {0.5, 0.95, 1.0}) {
    const std::string of = ", " + std::to_string(static_cast<int>(100 * share)) + " % of the cuts";
    check::figure("difference in limit depth" + of, 100 * quantile(depth_errors, share), "%");
    check::figure("difference in multiplier" + of, quantile(multiplier_errors, share));
  }
  CHECK(agree >= 0.97 * points);
  CHECK(quantile(depth_errors, 0.95) < 0.05);
}

/// Ranks, the mean of their places where values are equal.
std::vector<double> ranks(const std::vector<double>& values) {
  std::vector<double> result;
  for (const double v : values) {
    const auto less = std::count_if(values.begin(), values.end(), [&](double u) { return u < v; });
    const auto same = std::count(values.begin(), values.end(), v);
    result.push_back(static_cast<double>(less) + 0.5 * static_cast<double>(same + 1));
  }
  return result;
}

double spearman(const std::vector<double>& a, const std::vector<double>& b) {
  const std::vector<double> p = ranks(a), q = ranks(b);
  const double mean = 0.5 * static_cast<double>(a.size() + 1);
  double pq = 0, pp = 0, qq = 0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    pq += (p[i] - mean) * (q[i] - mean);
    pp += (p[i] - mean) * (p[i] - mean);
    qq += (q[i] - mean) * (q[i] - mean);
  }
  return pq / std::sqrt(pp * qq);
}

/// Koike 2016, tables 8-10 and 8-11: growth in the simulator against the map of eq. 8-1.
void growth_follows_the_map(int points, double per_vibration) {
  constexpr std::uint64_t kSeed = 8510;
  Draw draw(kSeed);
  Case c;
  c.structure.x = c.structure.y = {{2082, 0.018, 0.043}};
  c.tool.teeth = 2;
  c.tool.diameter_m = 0.010;
  c.tool.force = {.tangential_coefficient_N_per_m2 = 1500e6, .radial_ratio = 500.0 / 1500.0};
  c.cut.radial_immersion_m = 0.5e-3;
  c.cut.direction = MillingDirection::down;
  c.cut.feed_per_tooth_m = 0.1e-3;
  const auto method = *SemiDiscretization::create(c.structure, c.tool, c.cut);
  std::vector<double> map, simulated, exact;
  for (int i = 0; i < points; ++i) {
    const double speed = c.cut.spindle_speed_rpm = draw.between(5400, 9000);
    const double depth = draw.between(1e-3, 15e-3);
    map.push_back(
        growth_map(c.structure, c.tool, c.cut, {&speed, 1}, {&depth, 1})->amplitude_ratio[0]);
    simulated.push_back(simulated_growth(c, depth, per_vibration));
    exact.push_back(method.spectral_radius(speed, depth));
  }
  const double by_map = spearman(map, simulated), by_multiplier = spearman(exact, simulated);
  check::figure("growth: rank correlation, simulator and map of eq. 8-1", by_map);
  check::figure("growth: rank correlation, simulator and semi-discretisation", by_multiplier);
  CHECK(by_map >= 0.9);
  CHECK(by_multiplier >= 0.9);
  if (check::failures > 0) std::printf("  seed %llu\n", static_cast<unsigned long long>(kSeed));
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  // Forty steps a vibration, four times the fewest that the simulator takes.
  random_cuts(20261, nightly ? 400 : 40, false, 40);
  if (nightly) random_cuts(20262, 200, true, 40);
  growth_follows_the_map(nightly ? 400 : 80, 40);
  return check::done();
}
