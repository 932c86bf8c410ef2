// A cut worked out tooth by tooth and slice by slice, and the signals of drives that carry it: an
// integration of its own, in no way the library's simulator.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

namespace oracle {

/// Coefficients in SI units; the cutter feeds along its x, a tooth at phi stands at R (sin phi, cos
/// phi).
struct MillingCut {
  int teeth = 2;
  double radius_m = 0.01, depth_m = 0.005, helix_deg = 0;
  double start_rad = 0, exit_rad = 3.14159265358979323846;  // a slot
  double ktc = 1040e6, kte = 9810, krc = 312e6, kre = 5000, kac = 120e6, kae = 1500;
  std::vector<double> throw_m;  ///< of each tooth

  struct Load {
    double torque = 0, x = 0, y = 0, z = 0;
  };
  /// Forces on the tool in its own frame at an angle of rotation.
  [[nodiscard]] Load at(double angle_rad, double feed_m, double depth_share = 1) const {
    constexpr double kTurn = 6.283185307179586;
    constexpr int kSlices = 24;
    Load load;
    const double dz = depth_m * depth_share / kSlices;
    const double lag = std::tan(helix_deg * kTurn / 360) / radius_m;
    for (int tooth = 0; tooth < teeth; ++tooth)
      for (int slice = 0; slice < kSlices; ++slice) {
        double phi = angle_rad + kTurn * tooth / teeth - lag * dz * (slice + 0.5);
        phi -= kTurn * std::floor(phi / kTurn);
        if (phi < start_rad || phi > exit_rad) continue;
        // What any of the teeth before has left (Kline and DeVor 1983).
        double chip = feed_m * std::sin(phi) * (throw_m.empty() ? 1 : teeth);
        const auto k = static_cast<std::size_t>(tooth), n = throw_m.size();
        for (std::size_t j = 1; j < n; ++j)
          chip = std::min(chip, static_cast<double>(j) * feed_m * std::sin(phi) + throw_m[k] -
                                    throw_m[(k + n - j) % n]);
        if (chip < 0) continue;  // it passes over
        const double t = (ktc * chip + kte) * dz, r = (krc * chip + kre) * dz;
        load.torque += radius_m * t;
        load.x += -t * std::cos(phi) - r * std::sin(phi);
        load.y += t * std::sin(phi) - r * std::cos(phi);
        load.z += (kac * chip + kae) * dz;
      }
    return load;
  }
};

/// What a record does: stretches at one feed each, 0 in the air. Between them the tool goes in and
/// out over its radius.
struct CutPlan {
  struct Stretch {
    double seconds = 1, feed_m = 0;  ///< feed per tooth; 0: air
    double direction_deg = 0;        ///< of the feed, from +x to +y
    bool moving = true;  ///< whether the axes move: in the air as in the cut that follows
  };
  std::vector<Stretch> stretches;
  double speed_rad_s = 500;

  struct Instant {
    double t_s = 0, angle_rad = 0;
    double feed_m = 0, axes_feed_m = 0;  ///< in the cut, and of the axes
    double direction_rad = 0;
    MillingCut::Load load;  ///< in the cutter's frame
    int block = 0;
  };
  /// Calls `row` at `rate_hz`, loads averaged over eight instants between.
  template <typename Row>
  void run(const MillingCut& cut, double rate_hz, Row row) const {
    constexpr int kBetween = 8;
    double begin = 0;
    long n = 0;
    for (std::size_t s = 0; s < stretches.size(); ++s) {
      const Stretch& p = stretches[s];
      const double pace = p.feed_m * cut.teeth * speed_rad_s / 6.283185307179586;
      const double entry_s = p.feed_m > 0 ? cut.radius_m / pace : 0;
      for (; static_cast<double>(n) / rate_hz < begin + p.seconds; ++n) {
        Instant i;
        i.t_s = static_cast<double>(n) / rate_hz;
        i.angle_rad = speed_rad_s * i.t_s;
        i.feed_m = p.feed_m;
        i.axes_feed_m = p.moving ? p.feed_m : 0;
        if (p.moving && p.feed_m == 0)
          i.axes_feed_m =
              s + 1 < stretches.size() ? stretches[s + 1].feed_m : stretches[s - 1].feed_m;
        i.direction_rad = p.direction_deg * 6.283185307179586 / 360;
        i.block = static_cast<int>(10 * (s + 1));
        if (p.feed_m > 0) {
          const bool first = s == 0 || stretches[s - 1].feed_m == 0;
          const bool last = s + 1 == stretches.size() || stretches[s + 1].feed_m == 0;
          double share = 1;
          if (first) share = std::min(share, (i.t_s - begin) / entry_s);
          if (last) share = std::min(share, (begin + p.seconds - i.t_s) / (0.05 * entry_s + 1e-9));
          for (int k = 0; k < kBetween; ++k) {
            const double angle = i.angle_rad - speed_rad_s / rate_hz * (k + 0.5) / kBetween;
            const MillingCut::Load l = cut.at(angle, p.feed_m, std::max(0.0, share));
            i.load.torque += l.torque / kBetween;
            i.load.x += l.x / kBetween;
            i.load.y += l.y / kBetween;
            i.load.z += l.z / kBetween;
          }
        }
        row(i);
      }
      begin += p.seconds;
    }
  }
};

}  // namespace oracle
