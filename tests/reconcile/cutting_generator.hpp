// Cutting forces for tests, made another way than the program does it: the chip is the distance,
// along the ray from the tool axis through the tip, to the trochoid of every earlier tooth (found
// by Newton's method), layers are summed one by one, vibration and sensor are integrated in time.
// Includes nothing of model/, sim/ or reconcile/.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

namespace cutting_generator {

inline constexpr double kTau = 6.283185307179586;

/// SplitMix64 (Steele, Lea and Flood 2014), and normals by Box and Muller (1958).
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  double uniform(double low = 0, double high = 1) {
    state_ += 0x9E3779B97F4A7C15ULL;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBULL;
    z ^= z >> 31U;
    return low + (high - low) * static_cast<double>(z >> 11U) * 0x1.0p-53;
  }
  double log_uniform(double low, double high) {
    return std::exp(uniform(std::log(low), std::log(high)));
  }
  int whole(int low, int high) {
    return std::min(high, low + static_cast<int>(uniform() * (high - low + 1)));
  }
  double normal() {
    const double u = std::max(1e-300, uniform()), v = uniform();
    return std::sqrt(-2 * std::log(u)) * std::cos(kTau * v);
  }

 private:
  std::uint64_t state_;
};

struct Cut {
  double radius_m = 0.005;
  int teeth = 4;
  double helix_deg = 30;
  double depth_m = 0.003;
  double start_rad = 0, exit_rad = 1.2;  ///< engagement
  double kt = 7e8, kr = 2e8, kte = 0, kre = 0, size_exponent = 0;
  std::vector<double> reach_m;    ///< of each tooth, 0 nominal
  std::vector<double> broken;     ///< of the edge, from the tip
  std::vector<double> angle_rad;  ///< of each tooth ahead of tooth 1; empty: even
  double zero_rad = 0;
  double sensor_hz = 0, sensor_damping = 0;
  double mode_hz = 0, mode_damping = 0, mode_mass = 0;
  int mode_axis = 0;
  double wear = 0;  ///< growth of the edge force over the record, N/m
  double line_hz = 0, line_N = 0;
  double drift_N = 0;  ///< of the sensor, over the record
};

struct Program {
  std::vector<double> feeds_m = {1e-4};
  double speed_rad_s = 300;
  double rate_hz = 8000;
  double each_s = 2;  ///< at each feed
  double noise_N = 0;
  double zero_jump_rad = 0;  ///< of the encoder, for the last third
  std::uint64_t seed = 1;
};

struct Record {
  std::vector<double> t_s, angle_rad, feed_m, x_N, y_N;
};

/// Chip thickness of every tooth on an angular grid.
class Chips {
 public:
  static constexpr int kPoints = 1440;

  Chips(const Cut& cut, double feed_m, double height) {
    const double b = feed_m * cut.teeth / kTau;
    h_.assign(static_cast<std::size_t>(cut.teeth), std::vector<double>(kPoints + 1, 0.0));
    for (int i = 0; i < cut.teeth; ++i) {
      if (gone(cut, i, height)) continue;
      for (int k = 0; k <= kPoints; ++k) {
        const double theta = cut.start_rad + (cut.exit_rad - cut.start_rad) * k / kPoints;
        double least = 1e9;
        for (int j = 0; j < cut.teeth; ++j) {
          if (gone(cut, j, height)) continue;
          for (int turn = 0; turn < 3; ++turn) {
            double ahead = place(cut, j) - place(cut, i);
            while (ahead < 0) ahead += kTau;
            if (i == j) ahead = 0;
            ahead += kTau * turn;
            if (ahead == 0) continue;
            least = std::min(least, distance(cut, b, theta, ahead, i, j));
          }
        }
        h_[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)] = std::max(0.0, least);
      }
    }
  }
  static double at(const std::vector<double>& v, int i) {
    return v.empty() ? 0 : v[static_cast<std::size_t>(i)];
  }
  static double place(const Cut& cut, int i) {
    return cut.angle_rad.empty() ? kTau * i / cut.teeth : at(cut.angle_rad, i);
  }
  static bool gone(const Cut& cut, int tooth, double height) {
    return at(cut.broken, tooth) > height;
  }
  /// 0 outside the work.
  double operator()(const Cut& cut, int tooth, double theta) const {
    const double g = (theta - cut.start_rad) / (cut.exit_rad - cut.start_rad) * kPoints;
    if (g < 0 || g >= kPoints) return 0;
    const auto k = static_cast<std::size_t>(g);
    const auto& h = h_[static_cast<std::size_t>(tooth)];
    return h[k] + (g - static_cast<double>(k)) * (h[k + 1] - h[k]);
  }

 private:
  /// From the tip of tooth i at theta back to where tooth j had been on the same ray, about
  /// `ahead` earlier.
  static double distance(const Cut& cut, double b, double theta, double ahead, int i, int j) {
    const double ri = cut.radius_m + at(cut.reach_m, i), rj = cut.radius_m + at(cut.reach_m, j);
    const double s = std::sin(theta), c = std::cos(theta);
    // Tool turned by -u from now: axis at -b u, tooth j at angle theta + ahead - u.
    double u = ahead;
    for (int k = 0; k < 6; ++k) {
      const double p = theta + ahead - u;
      const double x = -b * u + rj * std::sin(p), y = rj * std::cos(p);
      const double across = x * c - y * s;
      const double slope = (-b - rj * std::cos(p)) * c - (rj * std::sin(p)) * s;
      u -= across / slope;
    }
    const double p = theta + ahead - u;
    const double x = -b * u + rj * std::sin(p), y = rj * std::cos(p);
    return ri - (x * s + y * c);
  }
  std::vector<std::vector<double>> h_;
};

/// Force on the work (what a dynamometer shows).
inline Record generate(const Cut& cut, const Program& program) {
  Record r;
  Random random(program.seed * 7919 + 13);
  const bool dynamic = cut.mode_hz > 0;
  const int layers = cut.helix_deg == 0 ? 1 : (dynamic ? 16 : 40);
  const int sub = dynamic ? 24 : 6;  // steps of a sample, which is their mean
  const double step_s = 1 / (program.rate_hz * sub);
  const double lag = std::tan(cut.helix_deg * kTau / 360) * cut.depth_m / cut.radius_m;
  const double total_s = program.each_s * static_cast<double>(program.feeds_m.size());

  double sx = 0, vx = 0, sy = 0, vy = 0;  // sensor
  double q = 0, vq = 0;                   // mode
  // Displacement over the last turns, for the chip.
  const auto turn_steps = static_cast<std::size_t>(kTau / program.speed_rad_s / step_s);
  std::vector<double> past(turn_steps + 2, 0.0);
  std::size_t now = 0;

  double angle = 0, t = 0;
  for (const double feed_m : program.feeds_m) {
    std::vector<Chips> chips;  // of layers; alike where the same teeth are there
    std::vector<int> of_layer;
    std::vector<double> ends = {0};
    for (const double f : cut.broken) ends.push_back(f);
    std::sort(ends.begin(), ends.end());
    for (const double e : ends) chips.emplace_back(cut, feed_m, e);
    for (int l = 0; l < layers; ++l) {
      const double height = (l + 0.5) / layers;
      int which = 0;
      for (std::size_t e = 0; e < ends.size(); ++e)
        if (ends[e] <= height) which = static_cast<int>(e);
      of_layer.push_back(which);
    }
    const auto force = [&](double turned, double time_s, double& x, double& y) {
      x = y = 0;
      const double kte = cut.kte + cut.wear * time_s / total_s;
      const double kre = cut.kre + 1.5 * cut.wear * time_s / total_s;
      for (int i = 0; i < cut.teeth; ++i)
        for (int l = 0; l < layers; ++l) {
          double theta = turned + cut.zero_rad + Chips::place(cut, i) - lag * (l + 0.5) / layers;
          theta -= kTau * std::floor((theta - cut.start_rad) / kTau);
          if (theta > cut.exit_rad) continue;
          double h =
              chips[static_cast<std::size_t>(of_layer[static_cast<std::size_t>(l)])](cut, i, theta);
          const double s = std::sin(theta), c = std::cos(theta);
          if (dynamic && h > 0) {
            const double pitch = kTau / cut.teeth / program.speed_rad_s / step_s;
            const auto back = static_cast<std::size_t>(pitch);
            const double before =
                past[(now + past.size() - std::min(back, past.size() - 1)) % past.size()];
            h = std::max(0.0, h + (q - before) * (cut.mode_axis == 0 ? s : c));
          }
          if (!(h > 0)) continue;
          const double dz = cut.depth_m / layers;
          double area = h * dz;
          if (cut.size_exponent != 0) area *= std::pow(h / 1e-4, -cut.size_exponent);
          const double ft = cut.kt * area + kte * dz, fr = cut.kr * area + kre * dz;
          x += ft * c + fr * s;
          y += -ft * s + fr * c;
        }
    };
    // A rigid tool repeats every turn: as a table of fine steps, at the first and the last wear.
    constexpr int kTurn = 5760;
    std::vector<std::array<double, 4>> table;
    for (int k = 0; k <= kTurn && !dynamic; ++k) {
      std::array<double, 4> f{};
      force(kTau * k / kTurn, 0, f[0], f[1]);
      if (cut.wear != 0) force(kTau * k / kTurn, total_s, f[2], f[3]);
      table.push_back(f);
    }
    const auto tabled = [&](double turned, double time_s, double& x, double& y) {
      const double g = (turned / kTau - std::floor(turned / kTau)) * kTurn;
      const auto k = std::min(static_cast<std::size_t>(g), static_cast<std::size_t>(kTurn - 1));
      std::array<double, 4> f{};
      for (std::size_t c = 0; c < 4; ++c)
        f[c] = table[k][c] + (g - static_cast<double>(k)) * (table[k + 1][c] - table[k][c]);
      const double worn = cut.wear != 0 ? time_s / total_s : 0;
      x = f[0] + worn * (f[2] - f[0]);
      y = f[1] + worn * (f[3] - f[1]);
    };
    const auto samples = static_cast<std::size_t>(program.each_s * program.rate_hz);
    for (std::size_t n = 0; n < samples; ++n) {
      double mean_x = 0, mean_y = 0, mean_angle = 0;
      for (int k = 0; k < sub; ++k) {
        angle += program.speed_rad_s * step_s;
        t += step_s;
        double x = 0, y = 0;
        if (dynamic)
          force(angle, t, x, y);
        else
          tabled(angle, t, x, y);
        if (dynamic) {
          // Semi-implicit Euler, the steps being a small part of the period.
          const double w = kTau * cut.mode_hz;
          const double on_tool = -(cut.mode_axis == 0 ? x : y);
          vq += step_s * (on_tool / cut.mode_mass - 2 * cut.mode_damping * w * vq - w * w * q);
          q += step_s * vq;
          now = (now + 1) % past.size();
          past[now] = q;
        }
        if (cut.sensor_hz > 0) {
          const double w = kTau * cut.sensor_hz;
          vx += step_s * (w * w * (x - sx) - 2 * cut.sensor_damping * w * vx);
          sx += step_s * vx;
          vy += step_s * (w * w * (y - sy) - 2 * cut.sensor_damping * w * vy);
          sy += step_s * vy;
          x = sx;
          y = sy;
        }
        mean_x += x / sub;
        mean_y += y / sub;
        mean_angle += angle / sub;
      }
      const double line = cut.line_N * std::sin(kTau * cut.line_hz * t);
      const double drift = cut.drift_N * t / total_s;
      r.t_s.push_back(t);
      r.angle_rad.push_back(mean_angle + (t > total_s * 2 / 3 ? program.zero_jump_rad : 0));
      r.feed_m.push_back(feed_m);
      r.x_N.push_back(mean_x + line + drift + program.noise_N * random.normal());
      r.y_N.push_back(mean_y + 0.7 * line + 0.5 * drift + program.noise_N * random.normal());
    }
  }
  return r;
}

}  // namespace cutting_generator
