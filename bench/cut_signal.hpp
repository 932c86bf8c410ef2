// Drive signals of a machine at work, for measuring what the blocks cost: a spindle in a cut, three
// axes that reverse, noise, encoder steps, chatter that comes and goes, a bump and, on request,
// faults. Written without library calls, so that firmware can make the same signals.
#pragma once

#include <cstdint>

#include "servosense/core/fast_math.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/observer/disturbance_observer.hpp"
#include "servosense/observer/drive_config.hpp"

namespace bench {

using namespace servosense;

inline constexpr double kPeriod_s = 125e-6;
inline constexpr double kCountsPerTurn = 1 << 20;
inline constexpr ObserverCutoffs kReported{500, 500};
inline constexpr ObserverCutoffs kForChatter{3500, 3500};  // Koike 2016, table 3-3
inline constexpr ObserverCutoffs kForCollision{335, 335};  // the same

inline constexpr DriveSignal kSignal{MotionKind::counts, EffortKind::current_A};

inline SpindleConfig spindle_config() noexcept {
  SpindleConfig c;
  c.torque_constant_Nm_per_A = 0.5;
  c.inertia_kg_m2 = 0.01;
  c.viscous_friction_Nm_s_per_rad = 0.002;
  c.coulomb_friction_Nm = 0.3;
  c.encoder_counts_per_rev = kCountsPerTurn;
  c.counter_bits = 20;  // single turn: its reading repeats
  return c;
}

inline AxisConfig axis_config() noexcept {
  AxisConfig c;
  c.lead_m = 0.016;
  c.equivalent_mass_kg = 227;
  c.viscous_friction_N_s_per_m = 2000;
  c.coulomb_friction_N = 100;
  c.torque_constant_Nm_per_A = 0.8;
  c.encoder_counts_per_rev = kCountsPerTurn;
  return c;
}

/// One servo instant, raw and at every stage that some block starts from.
template <RealNumber Real>
struct Sample {
  ServoSample<Real> servo;
  DriveSample<Real> spindle;
  DriveSample<Real> x;
  Real torque_Nm = 0;  ///< cutting torque that the chatter monitor listens to
  Real force_N = 0;    ///< cutting force that the collision monitor listens to
  Quality torque_quality = Quality::good;
  Quality force_quality = Quality::good;
};

/// Repeats after `samples` samples without a seam.
template <RealNumber Real>
class CutSignal {
 public:
  CutSignal(std::uint32_t samples, bool faults) noexcept : samples_(samples), faults_(faults) {
    const double seconds = samples * kPeriod_s;
    turns_ = static_cast<std::uint32_t>(7700.0 / 60.0 * seconds + 0.5);
    strokes_ = static_cast<std::uint32_t>(2 * seconds) + 1;
    chatter_cycles_ = static_cast<std::uint32_t>(2004 * seconds);
    const SpindleConfig spindle = spindle_config();
    const AxisConfig axis = axis_config();
    spindle_input_.configure(spindle.input(kSignal, kPeriod_s));
    x_input_.configure(axis.input(kSignal, kPeriod_s));
    spindle_observer_.configure(spindle.disturbance_observer(kPeriod_s, kForChatter));
    x_observer_.configure(axis.disturbance_observer(kPeriod_s, kForCollision));
  }

  Sample<Real> next() noexcept {
    Sample<Real> s;
    s.servo.t_ns = static_cast<Nanoseconds>(at_) * 125'000;
    move_spindle(s.servo.spindle);
    for (std::uint32_t i = 0; i < kAxes; ++i) move_axis(i, s.servo.axis[i]);
    if (faults_) spoil(s.servo);
    s.spindle = spindle_input_.process(s.servo.spindle);
    s.torque_Nm = spindle_observer_.process(s.spindle);
    s.torque_quality = spindle_observer_.state().quality;
    s.x = x_input_.process(s.servo.axis[0]);
    s.force_N = x_observer_.process(s.x);
    s.force_quality = x_observer_.state().quality;
    if (++at_ == samples_) at_ = 0;
    return s;
  }

 private:
  // Phase of a wave that has `cycles` periods in the whole signal; exact, whatever its length.
  [[nodiscard]] SineCosine<double> wave(std::uint64_t cycles) const noexcept {
    return sine_cosine(kTwoPi * static_cast<double>(cycles * at_ % samples_) / samples_);
  }
  // About normal, sigma 1: twelve uniform numbers (xorshift, Marsaglia 2003).
  double noise() noexcept {
    double sum = -6;
    for (int i = 0; i < 12; ++i) {
      random_ ^= random_ << 13U;
      random_ ^= random_ >> 17U;
      random_ ^= random_ << 5U;
      sum += random_ * (1.0 / 4294967296.0);
    }
    return sum;
  }
  [[nodiscard]] bool within(double from, double to) const noexcept {
    return at_ >= from * samples_ && at_ < to * samples_;
  }
  static std::int64_t floor_counts(double counts) noexcept {
    const auto whole = static_cast<std::int64_t>(counts);
    return whole - (static_cast<double>(whole) > counts ? 1 : 0);
  }

  void move_spindle(RawDriveSample<Real>& out) noexcept {
    const SpindleConfig c = spindle_config();
    const double t_s = samples_ * kPeriod_s;
    // Speed swings by 1 %, so that the chatter window has to follow it.
    const SineCosine<double> swing = wave(1);
    const double mean_speed = turns_ * kTwoPi / t_s;
    const double speed = mean_speed * (1 + 0.01 * swing.sine);
    const double acceleration = mean_speed * 0.01 * swing.cosine * kTwoPi / t_s;
    const double turned = turns_ * (at_ + 0.01 * samples_ / kTwoPi * (1 - swing.cosine)) / samples_;
    const double angle = kTwoPi * (turned - static_cast<double>(floor_counts(turned)));
    const SineCosine<double> tooth = triple(sine_cosine(angle));  // three teeth
    double torque = 2 + 0.6 * tooth.sine + 0.3 * (2 * tooth.sine * tooth.cosine);
    if (within(0.3, 0.45)) torque += 0.8 * wave(chatter_cycles_).sine;
    torque += c.coulomb_friction_Nm + c.viscous_friction_Nm_s_per_rad * speed +
              c.inertia_kg_m2 * acceleration + 0.05 * noise();
    out.counts = floor_counts(turned * kCountsPerTurn) & ((1 << 20) - 1);
    out.effort = static_cast<Real>(torque / c.torque_constant_Nm_per_A);
  }

  void move_axis(std::uint32_t i, RawDriveSample<Real>& out) noexcept {
    const AxisConfig c = axis_config();
    const double rate = strokes_ * (i + 1) * kTwoPi / (samples_ * kPeriod_s);
    const SineCosine<double> stroke = wave(strokes_ * (i + 1));
    const double amplitude_m = 0.01 / (i + 1);
    const double velocity = amplitude_m * rate * stroke.cosine;
    const double position = amplitude_m * stroke.sine;
    double force = -c.equivalent_mass_kg * rate * rate * position +
                   c.viscous_friction_N_s_per_m * velocity +
                   (velocity < 0 ? -1 : 1) * c.coulomb_friction_N + 200 + 5 * noise();
    if (within(0.2, 0.21)) force += 2000;  // runs into something
    out.counts = floor_counts(position / c.lead_m * kCountsPerTurn);
    out.effort = static_cast<Real>(force / c.force_per_ampere());
  }

  // A NaN, a short interruption that is bridged, a long one that is not.
  void spoil(ServoSample<Real>& s) noexcept {
    const bool nan = at_ == samples_ / 2;
    const std::uint32_t short_one = at_ - samples_ / 8 * 5;
    const std::uint32_t long_one = at_ - samples_ / 4 * 3;
    const bool missing = short_one < 3 || long_one < 20;
    for (std::uint32_t i = 0; i <= kAxes; ++i) {
      RawDriveSample<Real>& drive = i == 0 ? s.spindle : s.axis[i - 1];
      if (nan) drive.effort = Real(0) * (drive.effort / Real(0));
      if (missing) drive.motion_quality = drive.effort_quality = Quality::missing;
    }
  }

  static SineCosine<double> triple(const SineCosine<double>& a) noexcept {
    return {a.sine * (3 - 4 * a.sine * a.sine), a.cosine * (4 * a.cosine * a.cosine - 3)};
  }

  std::uint32_t samples_;
  bool faults_;
  std::uint32_t at_ = 0;
  std::uint32_t turns_ = 0;
  std::uint32_t strokes_ = 0;
  std::uint32_t chatter_cycles_ = 0;
  std::uint32_t random_ = 2463534242;
  DriveInput<Real> spindle_input_;
  DriveInput<Real> x_input_;
  DisturbanceObserver<Real> spindle_observer_;
  DisturbanceObserver<Real> x_observer_;
};

}  // namespace bench
