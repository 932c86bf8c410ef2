// Drives whose signals come in pairs: a motor and the load behind play and spring, and a gantry of
// two sides that a beam joins. Semi-implicit Euler in steps of 20 us; knows nothing of model/,
// observer/, sim/ and monitors/.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <vector>

#include "oracles/drive_plant.hpp"

namespace oracle {

inline constexpr double kEulerStep_s = 2e-5;

/// Friction that holds up to `coulomb`, by a bristle of `knee`.
struct Rubbing {
  double coulomb = 0, viscous = 0, knee = 5e-6;
  double z = 0;
  double force(double v, double h) {
    z = std::clamp(z + v * h, -knee, knee);
    return viscous * v + coulomb * z / knee;
  }
};

/// u = D (w + I integral of w), w = Kv (r - x) - v, through a lag of the current loop and its
/// limit.
struct CascadeLoop {
  double gain_per_s = 40, damping = 4e4;
  double integral_per_s = 0, lag_s = 0, limit = 1e9;
  double effort = 0, integral = 0;
  [[nodiscard]] double told(double command, double x, double v) const {
    return damping * (gain_per_s * (command - x) - v + integral_per_s * integral);
  }
  double step(double command, double x, double v, double h) {
    integral += h * (gain_per_s * (command - x) - v);
    const double wanted = std::clamp(told(command, x, v), -limit, limit);
    effort = lag_s > 0 ? wanted + (effort - wanted) * std::exp(-h / lag_s) : wanted;
    return effort;
  }
};

/// One row of a record.
struct PairRow {
  double command = 0, motor = 0, load = 0, effort = 0, told = 0;
};

struct LoadedDrive {
  double motor_kg = 120, load_kg = 100, stiffness = 4e7, damping = 8e3, play = 0;
  Rubbing at_motor{60, 300, 5e-6}, at_load{40, 200, 5e-6};
  CascadeLoop loop;

  [[nodiscard]] double mass() const { return motor_kg + load_kg; }
  /// `load(t)` opposes positive motion, at the load.
  std::vector<PairRow> run(double seconds, double period_s,
                           const std::function<double(double)>& command,
                           const std::function<double(double)>& load) {
    std::vector<PairRow> rows;
    double x1 = command(0), v1 = 0, x2 = x1, v2 = 0;
    const auto steps = static_cast<std::size_t>(std::lround(period_s / kEulerStep_s));
    for (std::size_t i = 0; i < static_cast<std::size_t>(seconds / period_s); ++i) {
      const double t0 = static_cast<double>(i) * period_s;
      rows.push_back({command(t0), x1, x2, loop.effort, loop.told(command(t0), x1, v1)});
      for (std::size_t k = 0; k < steps; ++k) {
        const double t = t0 + static_cast<double>(k) * kEulerStep_s;
        const double u = loop.step(command(t), x1, v1, kEulerStep_s);
        const double d = x1 - x2, side = d < 0 ? -1 : 1;
        const double pressed = std::abs(d) - play / 2;
        const double push = stiffness * pressed + damping * (v1 - v2) * side;
        const double passed = pressed > 0 && push > 0 ? side * push : 0;
        v1 += kEulerStep_s / motor_kg * (u - at_motor.force(v1, kEulerStep_s) - passed);
        v2 += kEulerStep_s / load_kg * (passed - at_load.force(v2, kEulerStep_s) - load(t));
        x1 += kEulerStep_s * v1;
        x2 += kEulerStep_s * v2;
      }
    }
    return rows;
  }
};

/// One row of a gantry: what both motors report.
struct GantryRow {
  double x[2] = {0, 0}, effort[2] = {0, 0};
};

struct Gantry {
  double side_kg = 150, beam_stiffness = 3e6, beam_damping = 3e3;
  double crooked_m = 20e-6;  ///< of the guides, over 0.8 m
  Rubbing at_side[2] = {{70, 300, 5e-6}, {50, 350, 5e-6}};
  CascadeLoop loop[2];
  std::function<double(double)> load[2] = {[](double) { return 0.0; }, [](double) { return 0.0; }};
  /// Friction of a guide that binds, and what an encoder is off.
  std::function<double(double)> binds[2] = {[](double) { return 0.0; }, [](double) { return 0.0; }};
  std::function<double(double)> drift[2] = {[](double) { return 0.0; }, [](double) { return 0.0; }};

  std::vector<GantryRow> run(double seconds, double period_s,
                             const std::function<double(double)>& command) {
    std::vector<GantryRow> rows;
    double x[2] = {command(0), command(0)}, v[2] = {0, 0};
    double held[2] = {0, 0};
    const auto steps = static_cast<std::size_t>(std::lround(period_s / kEulerStep_s));
    for (std::size_t i = 0; i < static_cast<std::size_t>(seconds / period_s); ++i) {
      const double t0 = static_cast<double>(i) * period_s;
      GantryRow row;
      for (int s = 0; s < 2; ++s) {
        row.x[s] = x[s] + drift[s](t0);
        row.effort[s] = loop[s].effort;
      }
      rows.push_back(row);
      for (std::size_t k = 0; k < steps; ++k) {
        const double t = t0 + static_cast<double>(k) * kEulerStep_s;
        const double bent = x[0] - x[1] - crooked_m * std::sin(2 * kPi * x[0] / 0.8);
        const double beam = beam_stiffness * bent + beam_damping * (v[0] - v[1]);
        for (int s = 0; s < 2; ++s) {
          const double u = loop[s].step(command(t), x[s] + drift[s](t), v[s], kEulerStep_s);
          held[s] = std::clamp(held[s] + v[s] * kEulerStep_s, -5e-6, 5e-6);
          const double rubs = at_side[s].force(v[s], kEulerStep_s) + binds[s](t) * held[s] / 5e-6;
          v[s] += kEulerStep_s / side_kg * (u - rubs - load[s](t) - (s == 0 ? beam : -beam));
        }
        for (int s = 0; s < 2; ++s) x[s] += kEulerStep_s * v[s];
      }
    }
    return rows;
  }
};

}  // namespace oracle
