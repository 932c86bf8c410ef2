// Milling programs for the cutting coefficients, by tooth forces summed over teeth and layers: a
// generator of its own, which shares no code with the library.
//
// A cutter of `teeth` teeth with helix and run-out goes in straight passes through a block, in at
// one edge and out at the other. At 8 kHz, four steps a sample: chip thickness s sin(phi) + what
// run-out moves from tooth to tooth; a tooth that has no chip does not cut. What is heard is what
// observers give: cutting torque and forces through two lags, noise, and the friction that they do
// not know.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "servosense/monitors/cutting_coefficients.hpp"

namespace milled {

using servosense::Quality;

inline constexpr double kPeriod_s = 125e-6, kPi = 3.14159265358979323846;

struct Material {
  double ktc = 1.9e9, kte = 25e3, krc = 0.6e9, kre = 20e3;
};

struct Shop {
  unsigned teeth = 4;
  double radius_m = 0.008, depth_m = 0.003, width_m = 0.008;
  bool up = false;
  double helix_rad = 0.5, runout_m = 4e-6;
  double lag_rad_s = 400;                             // of the observers, twice
  double torque_noise_Nm = 0.15, force_noise_N = 25;  // of a sample, white
  double torque_friction_Nm = 0;                      // that the observers do not know, at start
  double torque_friction_drift = 0;                   // random walk [Nm/sqrt s]
  std::array<double, 2> force_friction_N{};
  double coulomb_N = 100;  // where an axis stands it takes some of the force
};

struct Pass {
  double length_m = 0.1;
  double direction_rad = 0;
  double feed_per_tooth_m = 60e-6;
  double speed_rpm = 6000;
  double override_to = 1;  // of the feed, from half of the length on
};

/// engagement of the shop: from, to
inline std::array<double, 2> engaged(const Shop& shop) {
  const double swept = std::acos(1 - shop.width_m / shop.radius_m);
  return shop.up ? std::array<double, 2>{0, swept} : std::array<double, 2>{kPi - swept, kPi};
}

/// The averages of the file, by integration in small steps.
inline servosense::CuttingShares shares(const Shop& shop) {
  const auto [from, to] = engaged(shop);
  constexpr int kSteps = 200000;
  const double d = (to - from) / kSteps;
  const double edge = shop.teeth * shop.depth_m / (2 * kPi);
  servosense::CuttingShares s;
  for (int i = 0; i < kSteps; ++i) {
    const double phi = from + (i + 0.5) * d, sine = std::sin(phi), cosine = std::cos(phi);
    s.torque_chip_m3 += edge * shop.radius_m * sine * d;
    s.torque_edge_m2 += edge * shop.radius_m * d;
    s.x_tangential_chip_m2 -= edge * sine * cosine * d;
    s.x_tangential_edge_m -= edge * cosine * d;
    s.x_radial_chip_m2 -= edge * sine * sine * d;
    s.x_radial_edge_m -= edge * sine * d;
    s.y_tangential_chip_m2 += edge * sine * sine * d;
    s.y_tangential_edge_m += edge * sine * d;
    s.y_radial_chip_m2 -= edge * sine * cosine * d;
    s.y_radial_edge_m -= edge * cosine * d;
  }
  return s;
}

/// What the drives report before any observer.
struct Heard {
  double angle_rad = 0, torque_Nm = 0;
  std::array<double, 2> position_m{}, force_N{};
};

template <typename Real = double>
class Machine {
 public:
  servosense::CuttingCoefficients<Real> monitor;
  Shop shop;
  Material material;
  std::mt19937 random;
  /// Called after every sample.
  std::function<void()> after = [] {};
  /// Called with every sample.
  std::function<void(const Heard&)> heard = [](const Heard&) {};
  double turned_in_cut = 0;  ///< revolutions with a chip
  double torque_Nm = 0;      ///< of the cut, this sample
  Quality quality = Quality::good;

  Machine(const Shop& s, const Material& m, unsigned seed) : shop(s), material(m), random(seed) {
    throw_.resize(s.teeth);
    const double where = std::uniform_real_distribution<double>(0, 2 * kPi)(random);
    for (unsigned j = 0; j < s.teeth; ++j)
      throw_[j] = s.runout_m * std::cos(2 * kPi * j / s.teeth + where);
    friction_Nm_ = s.torque_friction_Nm;
  }

  /// Whether the whole tool is in the cut, or nothing of it.
  [[nodiscard]] bool inside() const {
    return in_block_ && way_ > shop.radius_m && way_ < block_m_ - shop.radius_m;
  }
  [[nodiscard]] bool outside() const { return !in_block_ || way_ <= -shop.radius_m; }

  /// Friction of the spindle changes at once.
  void add_friction(double more_Nm) { friction_Nm_ += more_Nm; }

  /// In the air at this speed.
  void air(double seconds, double rpm) {
    for (double t = 0; t < seconds; t += kPeriod_s) sample(rpm, 0, 0, false);
  }
  /// Back at rapid, then the pass with 5 mm of air before and behind it.
  void mill(const Pass& pass) {
    const double per_s = pass.speed_rpm / 60 * shop.teeth;
    feed_ = 0;
    rapid(pass);
    block_m_ = pass.length_m;
    way_ = -shop.radius_m - 0.002;
    while (way_ < pass.length_m + shop.radius_m + 0.002) {
      const double share = way_ > pass.length_m / 2 ? pass.override_to : 1;
      const double asked = pass.feed_per_tooth_m * share * per_s;
      feed_ += std::clamp(asked - feed_, -2 * kPeriod_s, 2 * kPeriod_s);
      way_ += feed_ * kPeriod_s;
      sample(pass.speed_rpm, feed_, pass.direction_rad, true);
    }
    feed_ = 0;
  }

 private:
  void rapid(const Pass& pass) {
    double v = 0;
    for (double t = 0; t < 0.4; t += kPeriod_s) {
      v = std::min({0.3, 2 * t, 2 * std::max(0.0, 0.4 - t)});
      sample(pass.speed_rpm, v, pass.direction_rad + kPi, false);
    }
  }
  void sample(double rpm, double feed, double direction, bool in_block) {
    constexpr int kSteps = 4, kLayers = 6;
    const double turn = rpm / 60 * 2 * kPi * kPeriod_s;
    const double chip = rpm > 0 ? feed / (rpm / 60 * shop.teeth) : 0;
    const auto [from, to] = engaged(shop);
    double torque = 0, fx = 0, fy = 0;
    bool cuts = false;
    in_block_ = in_block;
    if (in_block && way_ > -shop.radius_m && way_ < block_m_ + shop.radius_m) {
      for (int step = 0; step < kSteps; ++step)
        for (unsigned j = 0; j < shop.teeth; ++j)
          for (int layer = 0; layer < kLayers; ++layer) {
            const double height = (layer + 0.5) * shop.depth_m / kLayers;
            double phi = angle_ + turn * (step + 0.5) / kSteps - 2 * kPi * j / shop.teeth -
                         height * std::tan(shop.helix_rad) / shop.radius_m;
            phi = std::fmod(std::fmod(phi, 2 * kPi) + 2 * kPi, 2 * kPi);
            if (phi < from || phi > to) continue;
            const double sine = std::sin(phi), cosine = std::cos(phi);
            const double at = way_ + shop.radius_m * sine;
            if (at < 0 || at > block_m_) continue;
            const double h = chip * sine + throw_[j] - throw_[(j + shop.teeth - 1) % shop.teeth];
            if (h <= 0) continue;
            const double dz = shop.depth_m / kLayers / kSteps;
            const double ft = (material.ktc * h + material.kte) * dz;
            const double fr = (material.krc * h + material.kre) * dz;
            torque += ft * shop.radius_m;
            fx += -ft * cosine - fr * sine;
            fy += ft * sine - fr * cosine;
            cuts = true;
          }
    }
    angle_ = std::fmod(angle_ + turn, 2 * kPi);
    if (cuts) turned_in_cut += turn / (2 * kPi);
    torque_Nm = torque;
    friction_Nm_ += shop.torque_friction_drift * std::sqrt(kPeriod_s) * normal_(random);
    const double c = std::cos(direction), s = std::sin(direction);
    const std::array<double, 2> on_tool = {fx * c - fy * s, fx * s + fy * c};
    const std::array<double, 2> way = {feed * c * kPeriod_s, feed * s * kPeriod_s};
    std::array<double, 2> force{};
    for (std::size_t i = 0; i < 2; ++i) {
      force[i] = -on_tool[i] + shop.force_noise_N * normal_(random);
      const double v = way[i] / kPeriod_s;
      if (std::abs(v) > 1e-6)
        force[i] += v > 0 ? shop.force_friction_N[i] : -shop.force_friction_N[i];
      else
        force[i] -= std::clamp(force[i], -shop.coulomb_N, shop.coulomb_N);
    }
    const double reported = torque + friction_Nm_ + shop.torque_noise_Nm * normal_(random);
    const double a = 1 - std::exp(-shop.lag_rad_s * kPeriod_s);
    const std::array<double, 3> in = {reported, force[0], force[1]};
    for (std::size_t i = 0; i < 3; ++i) {
      lag_[i][0] += a * (in[i] - lag_[i][0]);
      lag_[i][1] += a * (lag_[i][0] - lag_[i][1]);
    }
    drives_.angle_rad += turn;
    drives_.torque_Nm = reported;
    for (std::size_t i = 0; i < 2; ++i) drives_.position_m[i] += way[i];
    drives_.force_N = force;
    heard(drives_);
    const auto real = [](double x) { return static_cast<Real>(x); };
    monitor.process(real(lag_[0][1]), real(turn), real(lag_[1][1]), real(way[0]), real(lag_[2][1]),
                    real(way[1]), Real(0), quality);
    after();
  }

  std::vector<double> throw_;
  std::normal_distribution<double> normal_;
  std::array<std::array<double, 2>, 3> lag_{};
  Heard drives_;
  bool in_block_ = false;
  double angle_ = 0, way_ = 0, feed_ = 0, block_m_ = 0, friction_Nm_ = 0;
};

}  // namespace milled
