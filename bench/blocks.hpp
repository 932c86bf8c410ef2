// Every real-time block, set up as on a machine: what the benchmark times, what the firmware counts
// and what the allocation trap and the real-time sanitizer watch.
//
// To add a block: write its struct here (the name is that of the tables, the struct's name the same
// in capitals with `Case` behind) and put it in the list at the end.
#pragma once

#include <array>
#include <cstddef>
#include <initializer_list>
#include <tuple>

#include "cut_signal.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/core/fast_math.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/dsp/angle_sampler.hpp"
#include "servosense/dsp/biquad.hpp"
#include "servosense/dsp/first_order.hpp"
#include "servosense/dsp/moving_average.hpp"
#include "servosense/dsp/moving_fourier.hpp"
#include "servosense/dsp/moving_variance.hpp"
#include "servosense/dsp/notch.hpp"
#include "servosense/monitors/ar_breakage.hpp"
#include "servosense/monitors/chatter.hpp"
#include "servosense/monitors/collision.hpp"
#include "servosense/monitors/cutting_coefficients.hpp"
#include "servosense/monitors/drill_fracture.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/monitors/monitor_stack.hpp"
#include "servosense/monitors/override_control.hpp"
#include "servosense/monitors/signal_health.hpp"
#include "servosense/monitors/tooth_breakage.hpp"
#include "servosense/monitors/torque_band.hpp"
#include "servosense/monitors/wear.hpp"
#include "servosense/observer/acceleration_force.hpp"
#include "servosense/observer/disturbance_observer.hpp"
#include "servosense/observer/dynamometer_filter.hpp"

namespace bench {

inline constexpr std::size_t kWindow = 512;    // of the moving blocks
inline constexpr std::size_t kHarmonics = 10;  // of moving Fourier and chatter

template <typename Block, typename Config = typename Block::Config>
Status set_up(Block& block, const Config& config) noexcept {
  const Status status = Block::validate(config);
  if (status.ok()) block.configure(config);
  return status;
}

/// Costs what all blocks cost here besides themselves: the call, one number in, one out.
template <RealNumber Real>
struct EmptyCase {
  static constexpr const char* name = "empty";
  Status configure() noexcept { return {}; }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING { return in.torque_Nm; }
};

template <RealNumber Real>
struct SineCosineCase {
  static constexpr const char* name = "sine_cosine";
  Status configure() noexcept { return {}; }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    const SineCosine<Real> turn = sine_cosine(in.spindle.turn_angle_rad);
    return turn.sine + turn.cosine;
  }
};

template <RealNumber Real>
struct DriveInputCase {
  static constexpr const char* name = "drive_input";
  DriveInput<Real> block;
  Status configure() noexcept { return set_up(block, axis_config().input(kSignal, kPeriod_s)); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return block.process(in.servo.axis[0]).effort;
  }
};

template <RealNumber Real>
struct LowPassCase {
  static constexpr const char* name = "low_pass";
  LowPass<Real> block;
  Status configure() noexcept { return set_up(block, {.cutoff_rad_s = 500}); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING { return block.process(in.torque_Nm); }
};

template <RealNumber Real>
struct PseudoDerivativeCase {
  static constexpr const char* name = "pseudo_derivative";
  PseudoDerivative<Real> block;
  Status configure() noexcept { return set_up(block, {.cutoff_rad_s = 500}); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING { return block.process(in.x.increment); }
};

template <RealNumber Real>
struct BiquadCase {
  static constexpr const char* name = "biquad";
  Biquad<Real> block;
  // Butterworth low-pass at a tenth of the sample rate.
  Status configure() noexcept {
    return set_up(block, {0.0674552738890719, 0.134910547778144, 0.0674552738890719,
                          -1.14298050253990, 0.412801598096189});
  }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING { return block.process(in.torque_Nm); }
};

template <RealNumber Real>
struct NotchCase {
  static constexpr const char* name = "notch";
  Notch<Real> block;
  Status configure() noexcept { return set_up(block, {.frequency_hz = 1000}); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING { return block.process(in.torque_Nm); }
};

template <RealNumber Real>
struct MovingAverageCase {
  static constexpr const char* name = "moving_average";
  MovingAverage<Real, 2> block;
  Status configure() noexcept {
    block.reset();
    return {};
  }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING { return block.process(in.torque_Nm); }
};

template <RealNumber Real>
struct MovingVarianceCase {
  static constexpr const char* name = "moving_variance";
  MovingVariance<Real, kWindow> block;
  Status configure() noexcept { return set_up(block, {kWindow}); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING { return block.process(in.torque_Nm); }
};

template <RealNumber Real>
struct MovingFourierCase {
  static constexpr const char* name = "moving_fourier";
  MovingFourier<Real, kWindow, kHarmonics> block;
  Status configure() noexcept { return set_up(block, {kWindow, kHarmonics}); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    block.process(in.torque_Nm, in.spindle.turn_angle_rad);
    return block.cosine_sum(1);
  }
};

template <RealNumber Real>
struct DisturbanceObserverCase {
  static constexpr const char* name = "disturbance_observer";
  DisturbanceObserver<Real> block;
  Status configure() noexcept {
    return set_up(block, axis_config().disturbance_observer(kPeriod_s, kForCollision));
  }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING { return block.process(in.x); }
};

/// With what a reconciled machine file may hold: Stribeck friction, friction that differs by
/// direction, and torque ripple of two orders.
template <RealNumber Real>
struct DisturbanceObserverEffectsCase {
  static constexpr const char* name = "disturbance_observer_effects";
  DisturbanceObserver<Real> block;
  Status configure() noexcept {
    DisturbanceObserverConfig c = axis_config().disturbance_observer(kPeriod_s, kForCollision);
    DriveEffectsConfig& on = c.drive.effects;
    const auto switch_on = [&](const char* effect, std::initializer_list<double> values) {
      EffectSetting& setting = on.settings[on.count++];
      setting.effect = drive_effect_index(effect);
      std::size_t p = 0;
      for (const double value : values) setting.parameters[p++] = {{value}, 1};
    };
    switch_on("stribeck-friction", {20, 0.002});
    switch_on("asymmetric-friction", {50, 5});
    switch_on("torque-ripple", {6, 10, 0.5});
    EffectSetting::Values* ripple = on.settings[2].parameters.data();
    ripple[0] = {{6, 12}, 2};  // orders
    ripple[1] = {{10, 4}, 2};  // [N]
    ripple[2] = {{0.5, 1}, 2};
    return set_up(block, c);
  }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING { return block.process(in.x); }
};

/// Five modes and twelve harmonics, with gains of one speed: the dearer way.
template <RealNumber Real>
struct DynamometerFilterCase {
  static constexpr const char* name = "dynamometer_filter";
  DynamometerFilter<Real, 5, 12> block;
  Status configure() noexcept {
    DynamometerFilterConfig c;
    c.sample_period_s = kPeriod_s;
    c.modes = 5;
    c.mode = {{{930, 0.03, 0.5},
               {1450, 0.02, 0.1},
               {1900, 0.03, 0.1},
               {2600, 0.03, 0.1},
               {3400, 0.04, 0.1}}};
    const Status status = DynamometerFilter<Real, 5, 12>::validate(c);
    DynamometerGain gain;
    gain.from_rad_s = 1;
    gain.to_rad_s = 5000;
    for (auto& g : gain.harmonic) g = {1, 0};
    for (auto& g : gain.ringing) g = {0.01, 0};
    if (status.ok()) block.configure(c, gain);
    return status;
  }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return block.process(in.force_N, in.spindle.turn_angle_rad, in.spindle.increment,
                         in.force_quality);
  }
};

template <RealNumber Real>
struct AccelerationForceCase {
  static constexpr const char* name = "acceleration_force";
  AccelerationForce<Real> block;
  Status configure() noexcept { return set_up(block, {kPeriod_s, 600, 0.04, 1, 10}); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return block.process(in.force_N, in.force_quality);
  }
};

template <RealNumber Real>
struct AlarmLogicCase {
  static constexpr const char* name = "alarm_logic";
  AlarmLogic<Real> block;
  Status configure() noexcept { return set_up(block, {.threshold = 2.2}); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return static_cast<Real>(block.process(in.torque_Nm, SignalState::good));
  }
};

inline ChatterConfig chatter_config() noexcept {
  ChatterConfig c;
  c.sample_period_s = kPeriod_s;
  c.harmonics = kHarmonics;
  c.chatter_threshold_Nm2 = 0.02;
  c.forced_threshold_Nm2 = 1;
  c.lines = {21.6, 5e-3, 131072, 3500, 3500};
  return c;
}

template <RealNumber Real>
struct ChatterCase {
  static constexpr const char* name = "chatter";
  ChatterMonitor<Real, 8, kHarmonics, 2 * kWindow> block;
  Status configure() noexcept { return set_up(block, chatter_config()); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return static_cast<Real>(block.process(in.torque_Nm, in.spindle.turn_angle_rad,
                                           in.spindle.increment, in.torque_quality));
  }
};

inline CollisionConfig collision_config() noexcept {
  CollisionConfig c;
  c.sample_period_s = kPeriod_s;
  c.threshold_N_per_s = 14.58e3;  // Koike 2016, sec. 5.3
  return c;
}

template <RealNumber Real>
struct CollisionCase {
  static constexpr const char* name = "collision";
  CollisionMonitor<Real> block;
  Status configure() noexcept { return set_up(block, collision_config()); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return static_cast<Real>(block.process(in.force_N, in.x.increment, in.force_quality));
  }
};

template <RealNumber Real>
struct SignalHealthCase {
  static constexpr const char* name = "signal_health";
  SignalHealthMonitor<Real> block;
  Status configure() noexcept { return set_up(block, {}); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return static_cast<Real>(block.process(in.x));
  }
};

template <RealNumber Real>
struct AngleSamplerCase {
  static constexpr const char* name = "angle_sampler";
  AngleSampler<Real> block;
  Status configure() noexcept { return set_up(block, {.samples_per_turn = 12}); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return static_cast<Real>(
        block.process(in.torque_Nm, in.spindle.turn_angle_rad, in.torque_quality));
  }
};

// Three teeth, as in the signal.
inline ArBreakageConfig ar_breakage_config() noexcept {
  ArBreakageConfig c;
  c.sample_period_s = kPeriod_s;
  c.teeth = 3;
  c.noise_Nm = 0.02;
  return c;
}
inline ToothBreakageConfig tooth_breakage_config() noexcept {
  ToothBreakageConfig c;
  c.sample_period_s = kPeriod_s;
  c.teeth = 3;
  c.torque = true;
  c.noise = 0.02;
  c.sample_noise = 0.1;
  return c;
}
inline DrillFractureConfig drill_fracture_config() noexcept {
  DrillFractureConfig c;
  c.sample_period_s = kPeriod_s;
  c.threshold_N = 20;
  return c;
}
inline WearConfig wear_config() noexcept {
  WearConfig c = WearConfig::drill_6mm();
  c.sample_period_s = kPeriod_s;
  return c;
}

inline TorqueBandConfig torque_band_config() noexcept {
  TorqueBandConfig c;
  c.spacing = 0.01;
  c.step = 0.02;
  c.max_shift = 0.2;
  c.shift_step = 0.01;
  return c;
}

template <RealNumber Real>
struct ArBreakageCase {
  static constexpr const char* name = "ar_breakage";
  ArBreakageMonitor<Real, 8> block;
  Status configure() noexcept { return set_up(block, ar_breakage_config()); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return static_cast<Real>(block.process(in.torque_Nm, in.spindle.turn_angle_rad,
                                           in.spindle.increment, in.torque_quality));
  }
};

template <RealNumber Real>
struct ToothBreakageCase {
  static constexpr const char* name = "tooth_breakage";
  ToothBreakageMonitor<Real, 8> block;
  Status configure() noexcept { return set_up(block, tooth_breakage_config()); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return static_cast<Real>(block.process(in.torque_Nm, in.spindle.turn_angle_rad,
                                           in.spindle.increment, in.torque_quality));
  }
};

template <RealNumber Real>
struct DrillFractureCase {
  static constexpr const char* name = "drill_fracture";
  DrillFractureMonitor<Real, 512, 1280> block;
  Status configure() noexcept { return set_up(block, drill_fracture_config()); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return static_cast<Real>(block.process(in.force_N, in.torque_Nm, in.force_N,
                                           in.spindle.turn_angle_rad, in.spindle.increment,
                                           in.torque_quality | in.force_quality));
  }
};

template <RealNumber Real>
struct WearCase {
  static constexpr const char* name = "wear";
  WearMonitor<Real> block;
  Status configure() noexcept { return set_up(block, wear_config()); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return static_cast<Real>(block.process(in.force_N, in.x.increment, in.torque_Nm,
                                           in.spindle.increment,
                                           in.torque_quality | in.force_quality));
  }
};

inline CuttingCoefficientsConfig cutting_coefficients_config() noexcept {
  CuttingCoefficientsConfig c;
  c.turns.sample_period_s = kPeriod_s;
  c.turns.cutting_torque_Nm = 0.3;
  c.turns.radius_m = 0.005;
  c.turns.teeth = 4;
  // A slot, 3 mm deep.
  const double edge = 4 * 0.003 / kTwoPi, arc = kPi / 2;
  c.shares = {0.005 * edge * 2, 0.005 * edge * kPi, 0,        0,          -edge * arc,
              -edge * 2,        edge * arc,         edge * 2, -edge * 0., 0};
  c.tangential = {1.9e9, 0.6e9};
  c.tangential_edge = {25e3, 8e3};
  c.radial = {0.6e9, 0.2e9};
  c.radial_edge = {20e3, 6e3};
  c.feed_per_tooth_m = 80e-6;
  c.torque_friction_error_Nm = 0.05;
  c.force_friction_error_N = {10, 10};
  return c;
}

/// A pass without end on a slant, so that every slot is heard of all three drives.
template <RealNumber Real>
struct CuttingCoefficientsCase {
  static constexpr const char* name = "cutting_coefficients";
  CuttingCoefficients<Real> block;
  Status configure() noexcept { return set_up(block, cutting_coefficients_config()); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return static_cast<Real>(block.process(Real(3) + Real(0.01) * in.torque_Nm,
                                           in.spindle.increment, Real(100), Real(5e-6), Real(200),
                                           Real(3e-6), Real(0), in.torque_quality));
  }
};

/// A reference of 4 s that the signal stays within, 41 shifts, a verdict every 20 ms.
template <RealNumber Real>
struct TorqueBandCase {
  static constexpr const char* name = "torque_band";
  TorqueBandMonitor<Real> block;
  std::array<TorqueBandPoint<Real>, 401> reference{};
  Status configure() noexcept {
    const Status status = set_up(block, torque_band_config());
    for (auto& point : reference) point = {Real(2), Real(1), Real(3)};
    block.set_reference(reference);
    block.start();
    return status;
  }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return static_cast<Real>(block.process(in.torque_Nm, in.spindle.increment,
                                           static_cast<Real>(kPeriod_s), Real(1),
                                           in.torque_quality));
  }
};

/// While the speed varies, which costs most.
template <RealNumber Real>
struct OverrideControlCase {
  static constexpr const char* name = "override_control";
  OverrideControl<Real> block;
  Status configure() noexcept {
    OverrideConfig c;
    c.sample_period_s = kPeriod_s;
    c.least_speed = 0.7;
    c.greatest_speed = 1.2;
    c.least_feed = 0.5;
    c.variation_amplitude = 0.05;
    const Status status = set_up(block, c);
    OverrideInput<Real> chatter;
    chatter.chatter = true;
    block.process(chatter);
    return status;
  }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    OverrideInput<Real> input;
    input.load = in.torque_Nm;
    const auto& told = block.process(input);
    return told.speed_ratio + told.feed_ratio;
  }
};

/// A spindle and three axes with chatter, collision and signal health. `reported`: whether the
/// estimates that are reported come from observers of their own, with other cutoffs than the
/// monitors' (Koike 2016, table 3-3).
inline HostStackConfig stack_config(bool reported) noexcept {
  HostStackConfig c;
  const SpindleConfig spindle = spindle_config();
  c.spindle.present = true;
  c.spindle.input = spindle.input(kSignal, kPeriod_s);
  c.spindle.observer = spindle.disturbance_observer(kPeriod_s, reported ? kReported : kForChatter);
  c.spindle.monitor_observer = spindle.disturbance_observer(kPeriod_s, kForChatter);
  c.spindle.chatter = chatter_config();
  const AxisConfig axis = axis_config();
  for (std::size_t i = 0; i < kAxes; ++i) {
    HostAxisSlotConfig& slot = c.axis[i];
    slot.present = true;
    slot.input = axis.input(kSignal, kPeriod_s);
    slot.observer = axis.disturbance_observer(kPeriod_s, reported ? kReported : kForCollision);
    slot.monitor_observer = axis.disturbance_observer(kPeriod_s, kForCollision);
    slot.collision = collision_config();
  }
  return c;
}

template <RealNumber Real>
struct MonitorStackCase {
  static constexpr const char* name = "monitor_stack";
  MonitorStack<Real> block;
  Status configure() noexcept { return set_up(block, stack_config(false)); }
  Real step(const Sample<Real>& in) SERVOSENSE_NONBLOCKING {
    return static_cast<Real>(block.process(in.servo).size());
  }
};

template <RealNumber Real>
struct MonitorStackTwoObserversCase : MonitorStackCase<Real> {
  static constexpr const char* name = "monitor_stack_two_observers";
  Status configure() noexcept { return set_up(this->block, stack_config(true)); }
};

/// Observers and monitors hear of two servo periods of the spindle and four of an axis as of one.
template <RealNumber Real>
struct MonitorStackGroupedCase : MonitorStackCase<Real> {
  static constexpr const char* name = "monitor_stack_grouped";
  Status configure() noexcept { return set_up(this->block, in_groups(stack_config(false))); }
};

/// The monitors of the tool as well; those that may, at half the rate, as a machine runs them.
inline HostStackConfig tool_stack_config() noexcept {
  HostStackConfig c = stack_config(false);
  c.tool.ar_breakage_on = c.tool.tooth_breakage_on = c.tool.drill_fracture_on = c.tool.wear_on =
      true;
  c.tool.ar_breakage = ar_breakage_config();
  c.tool.tooth_breakage = tooth_breakage_config();
  c.tool.drill_fracture = drill_fracture_config();
  c.tool.wear = wear_config();
  c.tool.half_rate = true;
  c.tool.drill_fracture.sample_period_s = c.tool.wear.sample_period_s = 2 * kPeriod_s;
  c.tool.drill_fracture.window_samples /= 2;
  for (std::size_t i = 0; i < 2; ++i)
    c.axis[i].tool_observer = axis_config().disturbance_observer(2 * kPeriod_s, kForChatter);
  c.tool.torque_band_on = true;
  c.tool.torque_band = torque_band_config();
  c.tool.torque_band_advance = 2 * kPeriod_s;
  return c;
}

template <RealNumber Real>
struct MonitorStackToolCase : MonitorStackCase<Real> {
  static constexpr const char* name = "monitor_stack_tool";
  std::array<TorqueBandPoint<Real>, 401> reference{};
  Status configure() noexcept { return configure(tool_stack_config()); }

 protected:
  Status configure(const HostStackConfig& c) noexcept {
    const Status status = set_up(this->block, c);
    for (auto& point : reference) point = {Real(2), Real(1), Real(3)};
    this->block.tool().torque_band().set_reference(reference);
    this->block.tool().torque_band().start();
    return status;
  }
};

template <RealNumber Real>
struct MonitorStackToolGroupedCase : MonitorStackToolCase<Real> {
  static constexpr const char* name = "monitor_stack_tool_grouped";
  Status configure() noexcept {
    return MonitorStackToolCase<Real>::configure(in_groups(tool_stack_config()));
  }
};

template <RealNumber Real>
using Blocks = std::tuple<
    SineCosineCase<Real>, DriveInputCase<Real>, LowPassCase<Real>, PseudoDerivativeCase<Real>,
    BiquadCase<Real>, NotchCase<Real>, MovingAverageCase<Real>, MovingVarianceCase<Real>,
    MovingFourierCase<Real>, DisturbanceObserverCase<Real>, DisturbanceObserverEffectsCase<Real>,
    DynamometerFilterCase<Real>, AccelerationForceCase<Real>, AlarmLogicCase<Real>,
    AngleSamplerCase<Real>, ChatterCase<Real>, CollisionCase<Real>, SignalHealthCase<Real>,
    ArBreakageCase<Real>, ToothBreakageCase<Real>, DrillFractureCase<Real>, WearCase<Real>,
    CuttingCoefficientsCase<Real>, TorqueBandCase<Real>, OverrideControlCase<Real>,
    MonitorStackCase<Real>, MonitorStackTwoObserversCase<Real>, MonitorStackToolCase<Real>,
    MonitorStackGroupedCase<Real>, MonitorStackToolGroupedCase<Real>>;

}  // namespace bench
