// Stability of tools whose teeth are not all alike: semi-discretisation over a whole revolution.
// Oracles: on equal teeth the map of a tooth period; with unequal pitch and process damping the
// linear equations integrated in time, by Runge-Kutta in steps twenty times as fine.
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/identify/semi_discretization.hpp"

using namespace servosense;

namespace {

// A thousandth by the phase of a step, and half as much again for what is held against it.
constexpr double kTolerance = 2e-3;

struct Case {
  Structure structure;
  MillingTool tool;
  MillingCut cut;
};

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_(seed) {}
  double between(double low, double high) {
    return low + (high - low) * static_cast<double>(random_() >> 11) * 0x1p-53;
  }
  int whole(int low, int high) {
    return low + static_cast<int>(random_() % static_cast<std::uint64_t>(high - low + 1));
  }

 private:
  std::mt19937_64 random_;
};

Case random_case(Draw& draw) {
  Case c;
  c.structure.x = {{draw.between(300, 1200), draw.between(0.01, 0.05), draw.between(0.1, 1)}};
  c.structure.y = {{draw.between(300, 1200), draw.between(0.01, 0.05), draw.between(0.1, 1)}};
  c.tool.teeth = draw.whole(2, 5);
  c.tool.diameter_m = draw.between(0.01, 0.03);
  c.tool.force.tangential_coefficient_N_per_m2 = draw.between(600e6, 2000e6);
  c.tool.force.radial_ratio = draw.between(0.1, 0.6);
  c.cut.direction = static_cast<MillingDirection>(draw.whole(0, 2));
  c.cut.radial_immersion_m = c.tool.diameter_m * draw.between(0.1, 0.9);
  c.cut.feed_per_tooth_m = 1e-4;
  c.cut.spindle_speed_rpm = draw.between(2000, 9000);
  return c;
}

void on_equal_teeth_as_the_tooth_period() {
  Draw draw(20);
  double worst = 0;
  for (int i = 0; i < 40; ++i) {
    Case c = random_case(draw);
    if (i % 2 == 1) c.tool.helix_deg = draw.between(10, 45);
    const auto period = *SemiDiscretization::create(c.structure, c.tool, c.cut);
    c.tool.force.process_damping_N_per_m = 1e-9;  // nothing, but it asks for the revolution
    const auto turn = *SemiDiscretization::create(c.structure, c.tool, c.cut);
    for (const double depth_m : {0.2e-3, 1e-3, 4e-3}) {
      const double a = period.spectral_radius(c.cut.spindle_speed_rpm, depth_m);
      const double b = turn.spectral_radius(c.cut.spindle_speed_rpm, depth_m);
      const double error = std::abs(a - b) / std::max(1.0, a);
      worst = std::max(worst, error);
      if (error > kTolerance) std::cout << "  draw " << i << ": " << a << " and " << b << '\n';
    }
  }
  std::cout << "  largest relative difference of |mu| on equal teeth " << worst << '\n';
  CHECK(worst < kTolerance);
}

// ---- the same equations in time ---------------------------------------------------------------

double growth_in_time(const Case& c, double depth_m) {
  const double turn_s = 60 / c.cut.spindle_speed_rpm, omega = kTwoPi / turn_s;
  constexpr std::size_t steps = 12000;
  const double h = turn_s / static_cast<double>(steps);
  const Engagement e = engagement_of(c.tool, c.cut);
  const StructuralMode& mx = c.structure.x[0];
  const StructuralMode& my = c.structure.y[0];
  const auto n = static_cast<std::size_t>(c.tool.teeth);
  std::vector<double> delay(n);  // in steps
  for (std::size_t j = 0; j < n; ++j) {
    double ahead = c.tool.tooth_angle_rad[(j + 1) % n] - c.tool.tooth_angle_rad[j];
    if (ahead <= 0) ahead += kTwoPi;
    delay[j] = ahead / kTwoPi * static_cast<double>(steps);
  }
  std::vector<std::array<double, 2>> past(steps + 3);
  const std::size_t ring = past.size();
  using State = std::array<double, 4>;  // x, y, vx, vy
  State s = {1e-6, -0.7e-6, 0, 0};
  for (auto& p : past) p = {1e-6, -0.7e-6};
  const double kt = c.tool.force.tangential_coefficient_N_per_m2, kr = c.tool.force.radial_ratio;
  const double speed = omega * c.tool.radius_m();
  // `at`: steps since the beginning, with fractions.
  const auto rate = [&](double at, const State& u) {
    double fx = 0, fy = 0;
    for (std::size_t j = 0; j < n; ++j) {
      double phi = std::fmod(omega * at * h + c.tool.tooth_angle_rad[j], kTwoPi);
      if (phi < e.start_rad || phi > e.exit_rad) continue;
      const double then = at - delay[j];
      const double whole = std::floor(then), x = then - whole;
      const auto i = static_cast<std::size_t>(std::llround(whole) + static_cast<long>(2 * ring));
      const auto& a = past[i % ring];
      const auto& b = past[(i + 1) % ring];
      const double si = std::sin(phi), co = std::cos(phi);
      // Chip: how much farther out the tooth is than the surface the one ahead has left.
      const double dx = u[0] - (a[0] + x * (b[0] - a[0])), dy = u[1] - (a[1] + x * (b[1] - a[1]));
      const double chip = dx * si + dy * co;
      const double normal = u[2] * si + u[3] * co;
      const double ft = depth_m * kt * chip;
      const double fr = kr * ft + depth_m * c.tool.force.process_damping_N_per_m * normal / speed;
      fx += -ft * co - fr * si;
      fy += ft * si - fr * co;
    }
    const double wx = mx.natural_frequency_rad_s(), wy = my.natural_frequency_rad_s();
    return State{u[2], u[3],
                 fx / mx.modal_mass_kg - 2 * mx.damping_ratio * wx * u[2] - wx * wx * u[0],
                 fy / my.modal_mass_kg - 2 * my.damping_ratio * wy * u[3] - wy * wy * u[1]};
  };
  const auto plus = [](const State& a, const State& b, double f) {
    return State{a[0] + f * b[0], a[1] + f * b[1], a[2] + f * b[2], a[3] + f * b[3]};
  };
  constexpr int kTurns = 60, kSettle = 20;
  double log_size = 0, at_settle = 0;
  for (int turn = 0; turn < kTurns; ++turn) {
    double size = 0;
    for (std::size_t i = 0; i < steps; ++i) {
      const double at = static_cast<double>(static_cast<std::size_t>(turn) * steps + i);
      past[static_cast<std::size_t>(at) % ring] = {s[0], s[1]};
      const State k1 = rate(at, s), k2 = rate(at + 0.5, plus(s, k1, h / 2));
      const State k3 = rate(at + 0.5, plus(s, k2, h / 2)), k4 = rate(at + 1, plus(s, k3, h));
      for (std::size_t k = 0; k < 4; ++k) s[k] += h / 6 * (k1[k] + 2 * k2[k] + 2 * k3[k] + k4[k]);
      size += s[0] * s[0] + s[1] * s[1];
    }
    // Kept at one size, so that neither growth nor decay runs out of numbers.
    const double scale = 1 / std::sqrt(size);
    log_size += std::log(std::sqrt(size));
    for (double& v : s) v *= scale;
    for (auto& p : past) p = {p[0] * scale, p[1] * scale};
    if (turn == kSettle) at_settle = log_size;
  }
  return std::exp((log_size - at_settle) / ((kTurns - 1 - kSettle) * c.tool.teeth));
}

void as_in_time(bool pitch, bool damped) {
  Draw draw(pitch ? (damped ? 33 : 31) : 32);
  double worst = 0;
  for (int i = 0; i < 6; ++i) {
    Case c = random_case(draw);
    const double even = kTwoPi / c.tool.teeth;
    for (int j = 0; j < c.tool.teeth; ++j)
      c.tool.tooth_angle_rad.push_back(even *
                                       (j + (pitch && j > 0 ? draw.between(-0.15, 0.15) : 0)));
    if (damped) c.tool.force.process_damping_N_per_m = draw.between(1e5, 1e6);
    const auto sd = *SemiDiscretization::create(c.structure, c.tool, c.cut);
    const double depth_m = draw.between(0.5e-3, 3e-3);
    const double map = sd.spectral_radius(c.cut.spindle_speed_rpm, depth_m);
    const double time = growth_in_time(c, depth_m);
    const double error = std::abs(map - time) / std::max(1.0, time);
    worst = std::max(worst, error);
    if (error > kTolerance)
      std::cout << "  draw " << i << ": map " << map << ", in time " << time << '\n';
  }
  std::cout << "  pitch " << pitch << ", process damping " << damped
            << ": largest relative difference of |mu| " << worst << '\n';
  CHECK(worst < kTolerance);
}

// Waves that come back out of step from tooth to tooth do not build up: the reason for such tools.
void unequal_pitch_deepens_the_cut() {
  Case c;
  c.structure.x = c.structure.y = {{600, 0.03, 0.3}};
  c.tool.teeth = 4;
  c.tool.diameter_m = 0.02;
  c.tool.force.tangential_coefficient_N_per_m2 = 800e6;
  c.tool.force.radial_ratio = 0.3;
  c.cut.direction = MillingDirection::slot;
  c.cut.feed_per_tooth_m = 1e-4;
  // The worst of the speeds between four and five waves in a pitch, for equal teeth.
  const auto even = *SemiDiscretization::create(c.structure, c.tool, c.cut);
  double even_m = 1, worst_waves = 0;
  for (double waves = 4; waves < 5; waves += 0.1) {
    const double depth_m = even.limit_at(60 * 640 / (4 * waves), 0.01).axial_depth_m;
    if (depth_m < even_m) even_m = depth_m, worst_waves = waves;
  }
  c.cut.spindle_speed_rpm = 60 * 640 / (4 * worst_waves);
  // Gaps that differ by half a wave in turn.
  const double quarter_wave = 0.25 * rad_from_deg(90) / worst_waves;
  c.tool.tooth_angle_rad = {0, rad_from_deg(90) + quarter_wave, rad_from_deg(180),
                            rad_from_deg(270) + quarter_wave};
  const auto uneven = *SemiDiscretization::create(c.structure, c.tool, c.cut);
  const double uneven_m = uneven.limit_at(c.cut.spindle_speed_rpm, 0.01).axial_depth_m;
  std::cout << "  limit depth " << 1e3 * even_m << " mm with equal, " << 1e3 * uneven_m
            << " mm with unequal pitch\n";
  CHECK(uneven_m > 1.5 * even_m);
  // And process damping does at low speed.
  c.tool.tooth_angle_rad.clear();
  c.tool.force.process_damping_N_per_m = 2e5;
  c.cut.spindle_speed_rpm = 400;
  const auto damped = *SemiDiscretization::create(c.structure, c.tool, c.cut);
  c.tool.force.process_damping_N_per_m = 0;
  const auto bare = *SemiDiscretization::create(c.structure, c.tool, c.cut);
  CHECK(damped.limit_at(400, 0.01, 20).axial_depth_m >
        1.3 * bare.limit_at(400, 0.01, 20).axial_depth_m);
}

}  // namespace

int main() {
  on_equal_teeth_as_the_tooth_period();
  as_in_time(true, false);
  as_in_time(false, true);
  as_in_time(true, true);
  unequal_pitch_deepens_the_cut();
  return check::done();
}
