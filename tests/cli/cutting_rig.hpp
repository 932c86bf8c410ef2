// Records of test cuts on a machine of a known spindle and two axes, as its drives report them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <random>
#include <string>

#include "oracles/milling_cut.hpp"
#include "program.hpp"

namespace cutting_rig {

using oracle::CutPlan;
using oracle::MillingCut;
using program_test::folder;

constexpr double kTurn = 6.283185307179586;

/// A spindle and two axes, as they are and as the machine file has them.
struct Rig {
  MillingCut cut;
  CutPlan plan;
  double rate_hz = 2000;
  double inertia = 0.005, viscous = 3.7e-4, coulomb = 0.1;  // of the spindle
  double constant = 0.6, noise_A = 0.05, quantum_A = 0.01;
  double friction_wrong = 1;  // of the file
  double axis_coulomb = 100, axis_viscous = 800, axis_mass = 200, axis_force_N_per_A = 300;
  double axis_noise_A = 0.02, axis_wrong = 1;
  double feed_m = 1e-4;  // the highest
  unsigned seed = 1;

  static Rig random(unsigned seed) {
    std::mt19937_64 bits(seed + 5000);
    const auto between = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(bits);
    };
    Rig r;
    r.seed = seed;
    r.cut.teeth = 2 + static_cast<int>(seed % 3);
    r.cut.radius_m = between(0.006, 0.012);
    r.cut.depth_m = between(0.002, 0.005);
    r.cut.helix_deg = between(0, 40);
    r.cut.ktc = between(600e6, 2200e6);
    r.cut.kte = between(8e3, 25e3);
    r.cut.krc = between(0.2, 0.5) * r.cut.ktc;
    r.cut.kre = between(5e3, 2e4);
    if (seed % 2 == 1) {  // down milling
      r.cut.start_rad = kTurn / 2 - std::acos(1 - 2 * between(0.3, 0.8));
      r.cut.exit_rad = kTurn / 2;
    }
    r.plan.speed_rad_s = between(300, 900);
    r.friction_wrong = between(0.8, 1.2);
    const double feed = between(0.08e-3, 0.15e-3);
    r.feed_m = feed;
    for (const double share : {1.0, 0.25, 0.5, 1.0, 0.25}) {
      r.plan.stretches.push_back({0.8, 0});
      r.plan.stretches.push_back({1.5 + 2 * r.entry_s(share * feed), share * feed});
    }
    r.plan.stretches.push_back({0.8, 0});
    return r;
  }
  [[nodiscard]] double entry_s(double feed) const {
    return cut.radius_m / (feed * cut.teeth * plan.speed_rad_s / kTurn);
  }

  [[nodiscard]] std::string machine(const std::string& spindle) const {
    char text[1500];
    const double immersion = cut.radius_m * 2 * (1 - std::cos(cut.exit_rad - cut.start_rad)) / 2;
    const bool slot = cut.start_rad == 0;
    std::snprintf(text, sizeof text,
                  "[spindle]\n%sinertia_kg_m2 = %.9g\nviscous_friction_Nm_s_per_rad = %.9g\n"
                  "coulomb_friction_Nm = %.9g\nencoder_counts_per_rev = 65536\n"
                  "[axis.x]\nlead_m = 0.01\nequivalent_mass_kg = %.9g\n"
                  "viscous_friction_N_s_per_m = %.9g\ncoulomb_friction_N = %.9g\n"
                  "force_constant_N_per_A = %.9g\nencoder_counts_per_rev = 1048576\n"
                  "[axis.y]\nlead_m = 0.01\nequivalent_mass_kg = %.9g\n"
                  "viscous_friction_N_s_per_m = %.9g\ncoulomb_friction_N = %.9g\n"
                  "force_constant_N_per_A = %.9g\nencoder_counts_per_rev = 1048576\n"
                  "[tool]\ndiameter_m = %.12g\nteeth = %d\nmaterial = steel C45\n"
                  "[cut]\naxial_depth_m = %.12g\ndirection = %s\n",
                  spindle.c_str(), inertia, friction_wrong * viscous, friction_wrong * coulomb,
                  axis_mass, axis_wrong * axis_viscous, axis_wrong * axis_coulomb,
                  axis_force_N_per_A, axis_mass, axis_wrong * axis_viscous,
                  axis_wrong * axis_coulomb, axis_force_N_per_A, 2 * cut.radius_m, cut.teeth,
                  cut.depth_m, slot ? "slot" : "down");
    std::string all = text;
    if (!slot) {
      std::snprintf(text, sizeof text, "radial_immersion_m = %.12g\n", immersion);
      all += text;
    }
    return all;
  }

  [[nodiscard]] double torque(const CutPlan::Instant& i) const {
    return i.load.torque + viscous * plan.speed_rad_s + coulomb;
  }
};

inline double rounded_to(double value, double quantum) {
  return quantum > 0 ? quantum * std::round(value / quantum) : value;
}

/// Spindle by its current; feeds from the axes or from a column.
inline void write_current(const Rig& r, const std::string& name, bool axes) {
  std::ofstream out(folder / name);
  out << "t_s,spindle.angle_counts,spindle.current_A,"
      << (axes ? "x.position_m,x.current_A,y.position_m,y.current_A\n" : "tool.feed_per_tooth_m\n");
  std::mt19937_64 bits(r.seed + 99);
  std::normal_distribution<double> noise(0, 1);
  double position[2] = {0, 0};
  char line[200];
  r.plan.run(r.cut, r.rate_hz, [&](const CutPlan::Instant& i) {
    const double current =
        rounded_to(r.torque(i) / r.constant + r.noise_A * noise(bits), r.quantum_A);
    const long counts = std::lround(std::floor(i.angle_rad / kTurn * 65536));
    int n = std::snprintf(line, sizeof line, "%.6f,%ld,%.6g,", i.t_s, counts, current);
    const auto rest = [&](const char* format, auto... values) {
      std::snprintf(line + n, sizeof line - static_cast<std::size_t>(n), format, values...);
    };
    if (!axes) {
      rest("%.9g\n", i.axes_feed_m);
    } else {
      const double pace = i.axes_feed_m * r.cut.teeth * r.plan.speed_rad_s / kTurn;
      const double u[2] = {std::cos(i.direction_rad), std::sin(i.direction_rad)};
      // The cutter's left is (-uy, ux); what opposes the motion of an axis is minus the force on
      // the tool.
      const double on_tool[2] = {i.load.x * u[0] - i.load.y * u[1],
                                 i.load.x * u[1] + i.load.y * u[0]};
      double current_A[2];
      for (int a = 0; a < 2; ++a) {
        const double v = pace * u[a];
        position[a] += v / r.rate_hz;
        const double sign = std::abs(v) < 1e-9 ? 0 : v > 0 ? 1 : -1;
        double force = -on_tool[a] + r.axis_viscous * v + r.axis_coulomb * sign;
        // At rest friction takes what it can.
        if (sign == 0)
          force = std::copysign(std::max(0.0, std::abs(force) - r.axis_coulomb), force);
        current_A[a] =
            rounded_to(force / r.axis_force_N_per_A + r.axis_noise_A * noise(bits), 1e-3);
      }
      rest("%.9f,%.6g,%.9f,%.6g\n", position[0], current_A[0], position[1], current_A[1]);
    }
    out << line;
  });
}

/// What the command prints.
struct Coefficients {
  double ktc = 0, ktc_error = 0, kte = 0, kte_error = 0, ratio = 0, ratio_error = 0;
  explicit Coefficients(const program_test::Json& j)
      : ktc(j.number("tangential_coefficient_N_per_m2")),
        ktc_error(j.number("tangential_coefficient_N_per_m2_standard_error")),
        kte(j.number("tangential_edge_N_per_m")),
        kte_error(j.number("tangential_edge_N_per_m_standard_error")),
        ratio(j.number("radial_ratio")),
        ratio_error(j.number("radial_ratio_standard_error")) {}
};

inline constexpr const char* kCurrent = "torque_constant_Nm_per_A = 0.6\n";

}  // namespace cutting_rig
