// How much of a tooth period does a tooth cut, and how large is then the pattern of a broken one?
//
// Purpose: a threshold for tooth breakage that follows the radial immersion without being told it,
// which Tarng (1988, sec. 7.2) leaves open. The pattern of a missing tooth, divided by the mean
// force, falls from 2 to a few tenths between a narrow cut and a slot; so does that of run-out.
// Shape: u = |mean force|^2 / mean of |force|^2 of the mean tooth: 1 when the force is constant (a
// slot), the smaller the shorter the pulse of a tooth. With straight teeth
// each leaves the pulse h(phi) (1 + j c) e^(-j phi), h = s sin(phi), 0 < phi < swept (eq. 3-2 to
// 3-6): material, depth, feed per tooth, radial ratio c and the directions of feed and axes cancel
// in u and in every ratio below, up and down milling are mirror images, and only the number of
// teeth m and the swept angle are left.
//   u(swept)  = |C(0, swept)|^2 / (p (E(0) + 2 sum_k cos(k p) E(k p))),   p = 2 pi / m,
//   C(a, b)   = integral of sin t e^(-j t),  E(d) = integral of sin t sin(t + d), 0 .. swept - d
// (torque: the same without e^(-j t) and cos(k p)). It falls strictly, so it can be turned round.
// A pulse that helix or the sensor widen gives the u of a wider cut, and its pattern is that of
// one. Size of a pattern: greatest min(-2 Delta(i), Delta(j)), i at most kReach tooth periods
// before j, Delta = difference of tooth-period averages a tooth apart, divided by their mean.
//   broken(swept): one tooth cuts nothing and the next twice (Tarng 1988, sec. 4.1)
//   throw(swept):  one tooth stands out or back by the tolerated throw, chips by eq. 3-38 to 3-44
//   threshold = max(sqrt(broken throw), broken / 3): as far from the one as from the other; and
//   what breaks off less than a third of an edge is not looked for, which leaves room for all else
// Both are equal at swept = arcsin(throw / feed per tooth), 5.74 degrees for a tenth (sec. 7.2).
// Below, no ratio separates them: the threshold stays as it is at 6 degrees.
// Cost: configure() some 40 000 multiplications and sines in double; a look-up 25 instructions.
// Bad at: a force signal with its own dynamics between 0.3 and 2 times the tooth frequency, which
// makes the shape its own (displacement at a resonance): give the angle then.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

struct ToothImmersionConfig {
  unsigned teeth = 4;            ///< m, 2 up to the capacity
  double tolerated_throw = 0.1;  ///< of a tooth, as a part of the feed per tooth; above 0, below 1
  bool torque = false;           ///< the signal is a torque, not the two forces
};

template <RealNumber Real, std::size_t MaxTeeth, unsigned PartsPerTooth>
class ToothImmersion {
 public:
  using Config = ToothImmersionConfig;
  static constexpr std::uint32_t kAngles = 30;  ///< 6, 12 ... 180 degrees
  static constexpr unsigned kReach = 3;
  struct Found {
    Real swept_rad;
    Real threshold;
  };
  struct Row {
    double shape = 0;   ///< u
    double broken = 0;  ///< size of the pattern of a missing tooth
    double thrown = 0;  ///< of the tolerated throw
    [[nodiscard]] double threshold() const noexcept {
      return std::fmax(std::sqrt(broken * thrown), broken / 3);
    }
  };

  void configure(const Config& c) noexcept {
    for (std::uint32_t i = 0; i < kAngles; ++i) {
      const Row r = row(c, kStep * (i + 1));
      shape_[i] = static_cast<Real>(r.shape);
      threshold_[i] = static_cast<Real>(r.threshold());
    }
  }
  [[nodiscard]] Found from_shape(Real u) const SERVOSENSE_NONBLOCKING {
    std::uint32_t low = 0;
    std::uint32_t high = kAngles - 1;
    if (!(u > shape_[low])) return found(0, 0);
    if (u >= shape_[high]) return found(high, 0);
    while (high - low > 1) {
      const std::uint32_t middle = (low + high) / 2;
      (u < shape_[middle] ? high : low) = middle;
    }
    return found(low, (u - shape_[low]) / (shape_[high] - shape_[low]));
  }
  [[nodiscard]] Found from_angle(Real swept_rad) const SERVOSENSE_NONBLOCKING {
    const Real steps = swept_rad * static_cast<Real>(1 / kStep) - Real(1);
    if (!(steps > 0)) return found(0, 0);
    if (steps >= static_cast<Real>(kAngles - 1)) return found(kAngles - 1, 0);
    const auto low = static_cast<std::uint32_t>(steps);
    return found(low, steps - static_cast<Real>(low));
  }

  /// Exact figures at one swept angle, the parts of the turn lying as unluckily as they can.
  [[nodiscard]] static Row row(const Config& c, double swept_rad) noexcept {
    Row r;
    r.shape = shape(c, swept_rad);
    r.broken = 1e9;
    for (const double offset : {0.0, 0.25, 0.5, 0.75}) {
      const double broken = size(c, swept_rad, offset, Pattern::broken);
      const double out = size(c, swept_rad, offset, Pattern::stands_out);
      const double back = size(c, swept_rad, offset, Pattern::stands_back);
      if (broken < r.broken) r.broken = broken;
      if (out > r.thrown) r.thrown = out;
      if (back > r.thrown) r.thrown = back;
    }
    return r;
  }

 private:
  static constexpr double kStep = kPi / kAngles;
  static constexpr unsigned kPoints = 64;  // of a tooth's pulse
  enum class Pattern { broken, stands_out, stands_back };

  [[nodiscard]] Found found(std::uint32_t i, Real part) const noexcept {
    const std::uint32_t next = i + 1 < kAngles ? i + 1 : i;
    return {static_cast<Real>(kStep) * (static_cast<Real>(i + 1) + part),
            threshold_[i] + part * (threshold_[next] - threshold_[i])};
  }

  static double shape(const Config& c, double swept) noexcept {
    const double pitch = kTwoPi / c.teeth;
    const double x = 0.5 * std::sin(swept) * std::sin(swept);
    const double y = 0.5 * swept - 0.25 * std::sin(2 * swept);
    const double t = 1 - std::cos(swept);
    double power = 0;
    for (unsigned k = 0; k * pitch < swept; ++k) {
      const double d = k * pitch;
      const double over = swept - d;
      const double overlap =
          0.5 * (over * std::cos(d) - 0.5 * (std::sin(2 * over + d) - std::sin(d)));
      power += (k == 0 ? 1 : 2) * (c.torque ? 1 : std::cos(d)) * overlap;
    }
    return (c.torque ? t * t : x * x + y * y) / (pitch * power);
  }

  // Chip of tooth i when tooth 0 stands out by `t`, all in feeds per tooth; s = sin(phi). Least of
  // what it finds over the paths of the teeth before it (eq. 3-40); those not named are never that.
  static double chip(unsigned teeth, unsigned i, double t, double s) noexcept {
    double h = s;
    if (i == 0) {
      h = std::fmin(s + t, teeth * s);
    } else if (i == 1) {
      h = std::fmin(s - t, 2 * s);
    } else {
      h = std::fmin(s, i * s - t);
    }
    return h > 0 ? h : 0;
  }

  static double size(const Config& c, double swept, double offset, Pattern pattern) noexcept {
    constexpr unsigned q = PartsPerTooth;
    const unsigned parts = c.teeth * q;
    std::array<double, MaxTeeth * PartsPerTooth> x{};
    std::array<double, MaxTeeth * PartsPerTooth> y{};
    const double part = kTwoPi / parts;
    for (unsigned n = 0; n < kPoints; ++n) {
      const double angle = (n + 0.5) * swept / kPoints;
      const double s = std::sin(angle);
      const double along = c.torque ? 1 : std::cos(angle);
      const double across = c.torque ? 0 : s;
      const auto at = static_cast<unsigned>(angle / part + offset);
      for (unsigned i = 0; i < c.teeth; ++i) {
        double h = 0;
        if (pattern == Pattern::broken) {
          h = i == 0 ? 0 : i == 1 ? 2 * s : s;
        } else {
          h = chip(c.teeth, i,
                   pattern == Pattern::stands_out ? c.tolerated_throw : -c.tolerated_throw, s);
        }
        const unsigned in = (at + i * q) % parts;
        x[in] += h * along;
        y[in] += h * across;
      }
    }
    std::array<double, MaxTeeth * PartsPerTooth> level{};
    double mean = 0;
    for (unsigned n = 0; n < parts; ++n) {
      double ax = 0;
      double ay = 0;
      for (unsigned l = 0; l < q; ++l) {
        ax += x[(n + parts - l) % parts];
        ay += y[(n + parts - l) % parts];
      }
      level[n] = std::sqrt(ax * ax + ay * ay);
      mean += level[n] / parts;
    }
    double most = 0;
    for (unsigned n = 0; n < parts; ++n) {
      const auto difference = [&](unsigned teeth_back) {
        const unsigned a = (n + (kReach + 2) * parts - teeth_back * q) % parts;
        return level[a] - level[(a + parts - q) % parts];
      };
      for (unsigned k = 1; k <= kReach; ++k)
        most = std::fmax(most, std::fmin(-2 * difference(k), difference(0)));
    }
    return most / mean;
  }

  std::array<Real, kAngles> shape_{};
  std::array<Real, kAngles> threshold_{};
};

}  // namespace servosense
