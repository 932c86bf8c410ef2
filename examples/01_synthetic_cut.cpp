// A machine that exists only here, so that everybody has an 8 kHz trace to try servosense on.
//
//   synthetic_cut --idle FILE   moves in the air, for `servosense identify idle`
//   synthetic_cut --cut FILE    a milling cut at 7700 rpm that starts to chatter, and then a rapid
//   move
//                               that runs the tool into a clamp
//
// The machine has the parameters that Koike (2016, tables 3-1, 3-4, 3-7) gives for a TC-S2C:
// spindle encoder of 17 bits with a current updated at 2 kHz, X axis of 20 bits. Each drive is one
// mass with viscous and Coulomb friction under PI speed control, integrated in steps of 12.5 us.
// The cut is not milling physics (for that see sim/milling_simulator.hpp) but the torque it would
// leave: tooth passing and its third harmonic at 770 Hz, and chatter at 862 Hz that belongs to no
// harmonic.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "servosense/core/units.hpp"
#include "servosense/io/trace.hpp"

using namespace servosense;

namespace {

constexpr double kPeriod_s = 125e-6;
constexpr int kSubsteps = 10;
constexpr int kCurrentEvery = 4;  // the spindle's current arrives at 2 kHz
constexpr double kLead_m = 0.016;

/// One mass, friction, PI speed control with a position loop around it; units kg m N or kg m2 rad
/// Nm.
struct Drive {
  double inertia, viscous, coulomb, knee;
  double effort_per_A;
  double speed_gain, integral_gain, position_gain;  // N s/m, N/m (or Nm s/rad, ...), 1/s
  double noise_A;                                   // of the current that is reported

  double position = 0, speed = 0, deflection = 0, integral = 0, current_A = 0;

  /// A new current for the speed and position wanted now.
  void control(double wanted_speed, double wanted_position) {
    const double error = wanted_speed + position_gain * (wanted_position - position) - speed;
    integral += integral_gain * error * kPeriod_s;
    current_A = (speed_gain * error + integral) / effort_per_A;
  }
  double reported_current_A(std::mt19937_64& random) const {
    return current_A + noise_A * std::normal_distribution<double>()(random);
  }
  /// One servo period with a load that opposes motion.
  void move(const std::function<double(double)>& load) {
    const double h = kPeriod_s / kSubsteps;
    for (int i = 0; i < kSubsteps; ++i) {
      const double friction = coulomb * deflection + viscous * speed;
      speed += h / inertia * (current_A * effort_per_A - friction - load(i * h));
      position += h * speed;
      deflection = std::clamp(deflection + h * speed / knee, -1.0, 1.0);
    }
  }
};

Drive spindle_drive() { return {0.0048, 4.775e-4, 0.1062, 1e-3, 0.5, 0.6, 15, 0, 0.02}; }
// The noise of the X current gives the disturbance jerk the spread of Koike's axis, 2.43 kN/s.
Drive x_drive() { return {227, 732, 94, 5e-6, 0.8 / m_per_rad(kLead_m), 3e4, 1.5e6, 60, 0.44}; }

/// Where X is wanted: stretches of constant acceleration.
struct Motion {
  double position = 0, speed = 0;
  double limit_m_s2 = 10;
  void toward(double target_speed) {
    const double step = limit_m_s2 * kPeriod_s;
    speed += std::clamp(target_speed - speed, -step, step);
    position += speed * kPeriod_s;
  }
};

/// What the machine does at time t.
struct Program {
  double duration_s;
  std::function<double(double)> spindle_rpm;
  std::function<double(double)> x_speed_m_s;
  std::function<double(double)> cutting_torque_Nm;
  std::function<double(double)> cutting_force_N;
  double clamp_at_m;  // the tool meets something hard here
};

Program idle_program() {
  // Back and forth at five feeds; the spindle steps through its speeds.
  auto x = [](double t) {
    const double feeds_mm_min[] = {2000, 5000, 12000, 25000, 50000};
    const double feed = m_s_from_mm_min(feeds_mm_min[static_cast<int>(t / 2.0) % 5]);
    return std::fmod(t, 1.0) < 0.5 ? feed : -feed;
  };
  auto rpm = [](double t) { return 3000.0 + 1500.0 * (static_cast<int>(t / 2.0) % 5); };
  auto none = [](double) { return 0.0; };
  return {20, rpm, x, none, none, 1e9};
}

Program cut_program() {
  auto rpm = [](double) { return 7700.0; };
  // In the air, cut from 1 s to 5.5 s, away at 5.7 s, rapid move into the clamp at about 6.6 s.
  auto x = [](double t) {
    if (t < 0.3) return 0.0;
    if (t < 5.7) return m_s_from_mm_min(1348);  // 0.0875 mm a tooth, two teeth
    if (t < 6.2) return 0.0;
    return t < 6.9 ? m_s_from_mm_min(25000) : 0.0;
  };
  auto engaged = [](double t) {  // 1.5 revolutions to enter, as many to leave
    return std::clamp((t - 1.0) / 0.012, 0.0, 1.0) * std::clamp((5.5 - t) / 0.012, 0.0, 1.0);
  };
  auto chatter =
      [](double t) {  // grows from the first moment, tenfold in a second, until the tool jumps
        return std::min(0.002 * std::pow(10.0, t - 1.0), 3.0) * std::sin(kTwoPi * 862.0 * t);
      };
  auto torque = [=](double t) {
    const double tooth = kTwoPi * 2 * 7700 / 60 * t;
    return engaged(t) * (2.0 + 0.8 * std::cos(tooth) + 0.4 * std::cos(3 * tooth) + 3 * chatter(t));
  };
  auto force = [=](double t) {
    const double tooth = kTwoPi * 2 * 7700 / 60 * t;
    return engaged(t) * (120 + 40 * std::cos(tooth) + 60 * chatter(t));
  };
  return {7.5, rpm, x, torque, force, 0.300};
}

/// Contact with the clamp: a spring until the tool breaks.
struct Contact {
  double stiffness_N_per_m = 2e6;
  double strength_N = 1800;
  bool broken = false;
  double force(double depth_m) {
    if (depth_m <= 0 || broken) return 0;
    const double f = stiffness_N_per_m * depth_m;
    broken = f > strength_N;
    return f;
  }
};

bool write(const Program& program, const std::string& path, const std::string& content) {
  const std::vector<Signal> signals = {{Channel::spindle, Quantity::angle_counts},
                                       {Channel::spindle, Quantity::current_A},
                                       {Channel::x, Quantity::angle_counts},
                                       {Channel::x, Quantity::current_A},
                                       {Channel::x, Quantity::command_position_m}};
  auto writer = TraceWriter::create(path, signals, {{"content", content}});
  if (!writer) {
    std::fprintf(stderr, "%s\n", writer.error().sentence.c_str());
    return false;
  }
  std::mt19937_64 random(20161);
  Drive spindle = spindle_drive();
  Drive x = x_drive();
  Motion wanted;
  Contact contact;
  double spindle_wanted = rad_s_from_rpm(program.spindle_rpm(0));
  spindle.speed = spindle_wanted;
  spindle.deflection = 1;
  spindle.integral = spindle.coulomb + spindle.viscous * spindle.speed;
  const auto samples = static_cast<long>(program.duration_s / kPeriod_s);
  for (long n = 0; n < samples; ++n) {
    const double t = static_cast<double>(n) * kPeriod_s;
    // 400 rad/s2 is what the spindle can do.
    const double target = rad_s_from_rpm(program.spindle_rpm(t));
    spindle_wanted += std::clamp(target - spindle_wanted, -400 * kPeriod_s, 400 * kPeriod_s);
    wanted.toward(program.x_speed_m_s(t));
    const bool new_current = n % kCurrentEvery == 0;
    if (new_current) spindle.control(spindle_wanted, 0);
    x.control(wanted.speed, wanted.position);

    const std::vector<TraceField> row = {
        TraceField::of_counts(static_cast<std::int32_t>(
            static_cast<std::int64_t>(std::floor(spindle.position / kTwoPi * 131072)))),
        new_current ? TraceField::of(spindle.reported_current_A(random)) : TraceField::none(),
        TraceField::of_counts(
            static_cast<std::int64_t>(std::floor(x.position / kLead_m * 1048576))),
        TraceField::of(x.reported_current_A(random)), TraceField::of(wanted.position)};
    if (auto done = writer->write(nanoseconds_from(t), row); !done) {
      std::fprintf(stderr, "%s\n", done.error().sentence.c_str());
      return false;
    }
    spindle.move([&](double dt) { return program.cutting_torque_Nm(t + dt); });
    x.move([&](double dt) {
      return program.cutting_force_N(t + dt) + contact.force(x.position - program.clamp_at_m);
    });
  }
  if (auto done = writer->close(); !done) {
    std::fprintf(stderr, "%s\n", done.error().sentence.c_str());
    return false;
  }
  std::printf("%s: %.1f s at 8 kHz, %s\n", path.c_str(), program.duration_s, content.c_str());
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3 && std::strcmp(argv[1], "--idle") == 0)
    return write(idle_program(), argv[2], "moves in the air at five feeds and spindle speeds") ? 0
                                                                                               : 1;
  if (argc == 3 && std::strcmp(argv[1], "--cut") == 0)
    return write(cut_program(), argv[2],
                 "a cut from 1.0 s to 5.5 s that grows into chatter, then a collision of X at "
                 "about 6.7 s")
               ? 0
               : 1;
  std::fprintf(stderr, "usage: synthetic_cut --idle FILE | --cut FILE\n");
  return 2;
}
