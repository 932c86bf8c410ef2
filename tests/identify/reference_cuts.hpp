// Milling cuts with spindle and feed currents for the comparison with a sound reference, from the
// forces of each tooth in closed form: nothing of the library's simulator. What sound cuts differ
// by stands in Sound, what is broken in Fault; a damaged cut has the first, too.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <random>
#include <string>
#include <vector>

namespace reference_cuts {

inline constexpr double kPi = 3.14159265358979323846;

/// A job: tool, machine and how it is recorded.
struct Job {
  int teeth = 3;
  double speed_rpm = 3000, feed_m = 60e-6, depth_m = 2e-3, engaged_rad = 1.4;
  double pressure_Pa = 900e6, edge_N_per_m = 14e3, radius_m = 6e-3;
  std::vector<double> throw_m;  ///< of each tooth
  double rate_hz = 4000, cut_s = 2.4, air_s = 0.5;
  double spindle_Nm_per_A = 0.5, idle_Nm = 0.35, feed_N_per_A = 900, friction_N = 110;
  double noise_A = 0.03, feed_noise_A = 0.03;
  double second_depth = 1.3;  ///< of the first, in the second half of the section
  double chatter_hz = 410;
  bool speed_column = true;  ///< else the machine file tells the speed
};

inline Job any_job(std::mt19937& random) {
  const auto within = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  Job j;
  j.teeth = std::uniform_int_distribution<int>(2, 5)(random);
  j.speed_rpm = within(1500, 4500);
  j.feed_m = within(40e-6, 90e-6);
  j.depth_m = within(1.5e-3, 4e-3);
  j.engaged_rad = within(0.9, 2.4);
  j.edge_N_per_m = within(8e3, 20e3);
  j.rate_hz = std::bernoulli_distribution(0.5)(random) ? 2000 : 5000;
  j.noise_A = within(0.02, 0.06);
  j.feed_noise_A = within(0.02, 0.06);
  j.second_depth = within(0.8, 1.4);
  j.chatter_hz = within(250, 0.4 * j.rate_hz);
  for (int i = 0; i < j.teeth; ++i) j.throw_m.push_back(within(-4e-6, 4e-6));
  return j;
}

/// What sound cuts of one job differ by.
struct Sound {
  double feed = 1, depth = 1, speed = 1, friction = 1, pressure = 1, noise = 1, begins_s = 0;
};
inline Sound any_sound(std::mt19937& random) {
  const auto around = [&](double share) {
    return std::uniform_real_distribution<double>(1 - share, 1 + share)(random);
  };
  Sound s;
  s.feed = around(0.04);
  s.depth = around(0.06);
  s.speed = around(0.015);
  s.friction = around(0.15);
  s.pressure = around(0.03);
  s.noise = around(0.15);
  s.begins_s = std::uniform_real_distribution<double>(-0.1, 0.1)(random);
  return s;
}

enum class Fault { none, broken, chipped, worn, chatter };
inline const char* name_of(Fault f) {
  const char* const names[] = {"none", "broken tooth", "chipped tooth", "worn tool", "chatter"};
  return names[static_cast<int>(f)];
}

/// Writes the trace. `fault_from`: part of the cut.
inline void record(const std::string& path, const Job& j, const Sound& s, Fault fault,
                   double fault_from, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::FILE* out = std::fopen(path.c_str(), "w");
  std::fprintf(out, "t_s,%sspindle.current_A,x.position_m,x.current_A\n",
               j.speed_column ? "spindle.angle_rad," : "");
  const double speed = j.speed_rpm * s.speed * 2 * kPi / 60;
  const double feed_m_s = j.feed_m * s.feed * j.teeth * speed / (2 * kPi);
  const double begins = j.air_s + s.begins_s, ends = begins + j.cut_s;
  const double phase = 2 * kPi * std::uniform_real_distribution<double>()(random);
  double drift_A = 0, swing = 0;
  const auto rows = static_cast<long>((ends + j.air_s) * j.rate_hz);
  for (long n = 0; n < rows; ++n) {
    const double t = static_cast<double>(n) / j.rate_hz, angle = speed * t + phase;
    const double part = (t - begins) / j.cut_s;
    const bool faulty = fault != Fault::none && part >= fault_from && part <= 1;
    const double entry = std::clamp(std::min(t - begins, ends - t) / 0.05, 0.0, 1.0);
    const double depth = j.depth_m * s.depth * entry * (part > 0.5 ? j.second_depth : 1);
    double torque = 0, push = 0;
    double left = 0;  // chip that the tooth before has left
    std::vector<double> chip(static_cast<std::size_t>(j.teeth));
    for (int pass = 0; pass < 2; ++pass)  // the first chip of a turn is the last tooth's business
      for (std::size_t i = 0; i < chip.size(); ++i) {
        const std::size_t before = (i + chip.size() - 1) % chip.size();
        double whole = j.feed_m * s.feed + j.throw_m[i] - j.throw_m[before] + left;
        const double keeps = faulty && i == 0 && fault == Fault::broken    ? 0
                             : faulty && i == 0 && fault == Fault::chipped ? 0.55
                                                                           : 1;
        chip[i] = std::max(0.0, whole * keeps);
        left = whole * (1 - keeps);
      }
    const double pressure = j.pressure_Pa * s.pressure * (faulty && fault == Fault::worn ? 1.1 : 1);
    const double edge = j.edge_N_per_m * (faulty && fault == Fault::worn ? 3 : 1);
    for (std::size_t i = 0; i < chip.size(); ++i) {
      const double phi = std::fmod(angle + 2 * kPi * static_cast<double>(i) / j.teeth, 2 * kPi);
      if (phi > j.engaged_rad || !(chip[i] > 0)) continue;
      const double tangential = depth * (pressure * chip[i] * std::sin(phi) + edge);
      const double radial = depth * (0.35 * pressure * chip[i] * std::sin(phi) +
                                     edge * (faulty && fault == Fault::worn ? 1.3 : 1));
      torque += j.radius_m * tangential;
      push += tangential * std::cos(phi) + radial * std::sin(phi);
    }
    swing = faulty && fault == Fault::chatter ? std::min(1.0, swing + 20 / j.rate_hz) : 0;
    const double mean_Nm = j.radius_m * depth * (j.pressure_Pa * j.feed_m + j.edge_N_per_m) *
                           j.teeth * j.engaged_rad / (2 * kPi);
    const double chatter =
        swing * std::sin(2 * kPi * j.chatter_hz * t) * (1 + 0.3 * std::sin(2 * kPi * 3 * t));
    torque += 0.6 * mean_Nm * chatter;
    push += 0.6 * mean_Nm / j.radius_m * chatter;
    drift_A += 0.002 * normal(random) - 0.002 * drift_A;
    const double current = (torque + j.idle_Nm * s.friction) / j.spindle_Nm_per_A + drift_A +
                           j.noise_A * s.noise * normal(random);
    const double feed_current = (push + j.friction_N * s.friction) / j.feed_N_per_A +
                                j.feed_noise_A * s.noise * normal(random);
    const double moved = feed_m_s * std::max(0.0, t - begins + 0.2);
    std::fprintf(out, "%.6f,", t);
    if (j.speed_column) std::fprintf(out, "%.6f,", angle);
    std::fprintf(out, "%.5g,%.8f,%.5g\n", current, moved, feed_current);
  }
  std::fclose(out);
}

inline void machine(const std::string& path, const Job& j, const std::string& more = "") {
  std::ofstream out(path);
  out << "[machine]\nname = test bed\n\n[tool]\nteeth = " << j.teeth
      << "\ndiameter_m = " << 2 * j.radius_m
      << "\n\n[spindle]\ntorque_constant_Nm_per_A = 0.5\ninertia_kg_m2 = 0.003\n";
  if (!j.speed_column) out << "constant_speed_rpm = " << j.speed_rpm << "\n";
  out << more;
}

}  // namespace reference_cuts
