#include "servosense/sim/drive_simulator.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "servosense/core/units.hpp"

namespace servosense {
namespace {

constexpr double kResolved = 0.2;  // w h of the stiffest part when steps are chosen here
constexpr double kStable = 1.0;    // and at most, when they are given; leapfrog ends at 2
constexpr unsigned kFewestSubsteps = 4;
constexpr unsigned kMostSubsteps = 4096;

double parameter(const DriveEffectsConfig& effects, const char* name, std::size_t index) {
  const EffectSetting* setting = effects.find(name);
  return setting != nullptr ? std::abs(setting->scalar(index)) : 0;
}

double largest_friction(const EffectSetting* profile) {
  double largest = 0;
  if (profile != nullptr)
    for (std::size_t i = 1; i < profile->parameters[0].count; i += 2)
      largest = std::max(largest, std::abs(profile->parameters[0].value[i]));
  return largest;
}

// Highest natural frequency of the plant [rad/s]: the friction below its knee is a spring.
double stiffest_rad_s(const DriveModelConfig& c) {
  const DriveEffectsConfig& e = c.effects;
  const EffectSetting* coupling = e.find("flexible-coupling");
  const bool play = e.find("backlash") != nullptr;
  const double share = coupling != nullptr ? coupling->scalar(2) : play ? c.load_inertia_share : 0;
  const double pair_rad_s = coupling != nullptr ? kTwoPi * coupling->scalar(0)
                            : play ? kTwoPi * Backlash<double>::kFlank_hz / std::sqrt(1 - share)
                                   : 0;
  const double coulomb =
      c.coulomb + parameter(e, "coulomb-friction", 0) + parameter(e, "stribeck-friction", 0) +
      parameter(e, "asymmetric-friction", 1) / 2 + parameter(e, "thermal-friction-drift", 0) +
      parameter(e, "presliding-hysteresis", 1) +
      largest_friction(e.find("position-dependent-friction"));
  const double stiffness = coulomb / c.friction_knee + parameter(e, "presliding-hysteresis", 0) +
                           parameter(e, "spring-load", 0);
  return std::sqrt(stiffness / (c.inertia * (1 - share)) + pair_rad_s * pair_rad_s);
}

Expected<Done> check(const DriveSimulatorConfig& c) {
  const auto wrong = [](const std::string& what) {
    return usage_error("drive simulator: " + what);
  };
  const auto not_negative = [](double x) { return x >= 0 && std::isfinite(x); };
  if (!(c.sample_period_s > 0 && std::isfinite(c.sample_period_s)))
    return wrong("sample_period_s must be positive");
  if (!(c.drive.inertia > 0 && std::isfinite(c.drive.inertia)))
    return wrong("the inertia (equivalent_mass_kg or inertia_kg_m2) must be positive");
  if (!std::isfinite(c.effort_per_A) || c.effort_per_A == 0)
    return wrong("effort_per_A must be a number other than zero");
  const CascadeConfig& k = c.controller;
  if (!not_negative(k.position_gain_per_s))
    return wrong("position_gain_per_s must not be negative");
  if (!not_negative(k.velocity_gain_A_s)) return wrong("velocity_gain_A_s must not be negative");
  if (!not_negative(k.velocity_integral_per_s))
    return wrong("velocity_integral_per_s must not be negative");
  if (!(k.current_limit_A > 0)) return wrong("current_limit_A must be positive");
  if (!not_negative(k.current_bandwidth_hz))
    return wrong("current_bandwidth_hz must not be negative; 0 is a perfect current loop");
  if (!(not_negative(k.delay_s) && k.delay_s <= 1)) return wrong("delay_s must be within 0 and 1");
  if (!not_negative(c.encoder.counts_per_turn))
    return wrong("counts_per_turn must not be negative; 0 is a perfect encoder");
  if (c.encoder.counter_bits < 1 || c.encoder.counter_bits > 64)
    return wrong("counter_bits must be within 1 and 64");
  if (c.encoder.counts_per_turn > 0 && !(c.drive.unit_per_turn > 0))
    return wrong("an encoder needs unit_per_turn, the lead of the screw or 2 pi");
  if (!std::isfinite(c.initial_position)) return wrong("initial_position must be a number");
  if (!not_negative(c.current_update_hz)) return wrong("current_update_hz must not be negative");
  if (c.current_update_hz * c.sample_period_s > 1 + 1e-9)
    return wrong("current_update_hz must not be above the servo rate");
  if (!not_negative(c.current_noise_A)) return wrong("current_noise_A must not be negative");
  for (const TimeLockedVibration& v : c.vibrations)
    if (!(not_negative(v.frequency_hz) && std::isfinite(v.amplitude) && std::isfinite(v.phase_rad)))
      return wrong("a vibration needs a frequency that is not negative and a finite amplitude");
  return Done{};
}

}  // namespace

Expected<DriveSimulator> DriveSimulator::create(const Config& config) {
  if (auto checked = check(config); !checked) return checked.error();
  Config c = config;
  c.drive.effects.sample_period_s = c.sample_period_s;
  c.drive.effort_per_ampere = std::abs(c.effort_per_A);
  // Values first: the number of steps follows from them, and what effects accept from the steps.
  const auto refuse = [](const Status& s) {
    return usage_error("drive simulator: " + std::string(s.parameter()) + " " + s.reason());
  };
  DriveModelConfig plain = c.drive;
  plain.effects.count = 0;
  if (const Status s = DriveModel<double>::validate(plain); !s.ok()) return refuse(s);
  if (const Status s = DriveEffects<double>::validate(c.drive.effects); !s.ok()) return refuse(s);
  const double angle = stiffest_rad_s(c.drive) * c.sample_period_s;
  const unsigned needed = static_cast<unsigned>(
      std::ceil(std::min(angle / kResolved, static_cast<double>(kMostSubsteps) + 1)));
  const unsigned substeps = c.substeps != 0 ? c.substeps : std::max(kFewestSubsteps, needed);
  if (substeps > kMostSubsteps || angle / substeps > kStable)
    return usage_error(
        "drive simulator: " + std::to_string(substeps) +
        " integration steps per sample cannot follow the stiffest part of the drive; lengthen the "
        "friction knee, soften a spring, or ask for " +
        std::to_string(needed) + " steps");
  c.drive.effects.sample_period_s = c.sample_period_s / substeps;
  if (const Status s = DriveModel<double>::validate(c.drive); !s.ok()) return refuse(s);
  return DriveSimulator(c, substeps);
}

DriveSimulator::DriveSimulator(const Config& config, unsigned substeps)
    : config_(config), substeps_(substeps), noise_(config.seed) {
  const CascadeConfig& k = config_.controller;
  model_.configure(config_.drive);
  step_s_ = config_.sample_period_s / substeps_;
  if (config_.drive.unit_per_turn > 0) rad_per_unit_ = kTwoPi / config_.drive.unit_per_turn;
  position_ = motion_.position = config_.initial_position;
  double turns = position_ * rad_per_unit_ / kTwoPi;
  const double counts = config_.encoder.counts_per_turn;
  if (counts > 0) {
    unit_per_count_ = config_.drive.unit_per_turn / counts;
    turns += static_cast<double>(config_.encoder.initial_counts) / counts;
  }
  motion_.turn_angle_rad = kTwoPi * (turns - std::floor(turns));
  if (k.current_bandwidth_hz > 0) {
    const double wh = kTwoPi * k.current_bandwidth_hz * step_s_;
    current_stays_ = std::exp(-wh);
    current_mean_ = -std::expm1(-wh) / wh;
  }
  const double periods = k.delay_s / config_.sample_period_s;
  const double whole = std::floor(periods);
  switch_step_ = (periods - whole) * substeps_;

  // Equilibrium: what the model demands of a motor that stands.
  DriveModel<double> standing = model_;
  MotionState<double> rest = motion_;
  integral_A_ = standing.resistance(rest) / config_.effort_per_A;
  current_A_ = earlier_A_ = later_A_ = reported_A_ = integral_A_;
  delay_A_.assign(static_cast<std::size_t>(whole), integral_A_);
  double measured = 0;
  (void)read_encoder(measured);
  last_measured_ = measured;
}

std::int64_t DriveSimulator::read_encoder(double& measured) {
  MotionState<double> m = motion_;
  m.position = position_;
  m.turn_angle_rad += (position_ - motion_.position) * rad_per_unit_;
  m.velocity = velocity_;
  measured = position_ + model_.position_error(m);
  if (!(unit_per_count_ > 0)) return 0;
  const auto counts = static_cast<std::int64_t>(std::floor(measured / unit_per_count_ + 0.5));
  measured = static_cast<double>(counts) * unit_per_count_;
  const auto reading = static_cast<std::uint64_t>(counts) +
                       static_cast<std::uint64_t>(config_.encoder.initial_counts);
  const unsigned bits = config_.encoder.counter_bits;
  return static_cast<std::int64_t>(bits == 64 ? reading
                                              : reading & ((std::uint64_t{1} << bits) - 1));
}

double DriveSimulator::control(double reference, double measured) {
  const CascadeConfig& k = config_.controller;
  const double velocity = (measured - last_measured_) / config_.sample_period_s;
  last_measured_ = measured;
  const double wanted = config_.loop == DriveLoop::position
                            ? k.position_gain_per_s * (reference - measured)
                            : reference;
  const double error = wanted - velocity;
  const double grown = integral_A_ + k.velocity_gain_A_s * k.velocity_integral_per_s *
                                         config_.sample_period_s * error;
  const double asked = k.velocity_gain_A_s * error + grown;
  const double given = std::clamp(asked, -k.current_limit_A, k.current_limit_A);
  if (given == asked || (asked - given) * error < 0) integral_A_ = grown;
  return given;
}

// Sends a reference on its way and sets those that arrive in this period.
void DriveSimulator::send(double reference_A) {
  earlier_A_ = later_A_;
  later_A_ = reference_A;
  if (delay_A_.empty()) return;
  std::swap(later_A_, delay_A_[oldest_]);
  oldest_ = (oldest_ + 1) % delay_A_.size();
}

void DriveSimulator::report_current(DriveSimSample& sample, double reference_A) {
  const double per_sample = config_.current_update_hz * config_.sample_period_s;
  if (per_sample > 0 && per_sample < 1 && sample_ > 0) {
    // Rounding must not move an update that falls on a sample.
    const auto due = [&](std::uint64_t n) {
      return std::floor(static_cast<double>(n) * per_sample + 1e-9);
    };
    sample.current_is_new = due(sample_) != due(sample_ - 1);
  }
  if (sample.current_is_new) {
    const bool ideal = !(config_.controller.current_bandwidth_hz > 0);
    const double actual = ideal && switch_step_ == 0 ? later_A_ : current_A_;
    reported_A_ = config_.reported == ReportedCurrent::actual ? actual : reference_A;
    if (config_.current_noise_A > 0) reported_A_ += config_.current_noise_A * noise_.next();
  }
  sample.current_A = reported_A_;
}

void DriveSimulator::advance_turn(double increment) {
  double& angle = motion_.turn_angle_rad;
  angle += increment * rad_per_unit_;
  if (angle >= kTwoPi || angle < 0) angle -= kTwoPi * std::floor(angle / kTwoPi);
}

void DriveSimulator::integrate(DriveSimSample& sample) {
  const double h = step_s_;
  const double inertia_rate = model_.inertia() / h;
  const double half_viscous = model_.viscous() / 2;
  const bool direct = !model_.has_load();
  const bool lagging = config_.controller.current_bandwidth_hz > 0;
  double effort_sum = 0;
  double resistance_sum = 0;
  for (unsigned i = 0; i < substeps_; ++i) {
    const double arrived = std::clamp(static_cast<double>(i + 1) - switch_step_, 0.0, 1.0);
    const double reference_A = earlier_A_ + arrived * (later_A_ - earlier_A_);
    double mean_A = reference_A;
    if (lagging) {
      const double behind = current_A_ - reference_A;
      mean_A += behind * current_mean_;
      current_A_ = reference_A + behind * current_stays_;
    } else {
      current_A_ = reference_A;
    }

    const double middle = position_ + h / 2 * velocity_;
    motion_.increment = middle - motion_.position;
    motion_.position = middle;
    advance_turn(motion_.increment);
    motion_.velocity = velocity_ + h / 2 * acceleration_;
    motion_.acceleration = acceleration_;
    // The load moves from middle to middle, so its first step of a period has half the old force.
    motion_.cutting = i == 0 ? (held_cutting_ + sample.cutting) / 2 : sample.cutting;
    const double effort =
        model_.acting_effort(mean_A * config_.effort_per_A * constant_ratio_, motion_);
    motion_.effort = effort;
    double resistance = model_.resistance(motion_);
    if (!config_.vibrations.empty()) {
      const double t = sample.t_s + (i + 0.5) * h;
      for (const TimeLockedVibration& v : config_.vibrations)
        resistance += v.amplitude * std::sin(kTwoPi * v.frequency_hz * t + v.phase_rad);
    }
    const double driving = effort - resistance - (direct ? sample.cutting : 0);
    const double before = velocity_;
    velocity_ = (before * (inertia_rate - half_viscous) + driving) / (inertia_rate + half_viscous);
    acceleration_ = (velocity_ - before) / h;
    position_ = middle + h / 2 * velocity_;
    effort_sum += effort;
    resistance_sum += resistance + half_viscous * (before + velocity_);
  }
  held_cutting_ = sample.cutting;
  sample.effort = effort_sum / substeps_;
  sample.resistance = resistance_sum / substeps_;
}

DriveSimSample DriveSimulator::step(double reference, double cutting) {
  if (std::isfinite(reference)) last_reference_ = reference;
  if (std::isfinite(cutting)) last_cutting_ = cutting;
  DriveSimSample s;
  s.t_s = static_cast<double>(sample_) * config_.sample_period_s;
  s.reference = last_reference_;
  s.cutting = last_cutting_;
  s.position = position_;
  s.velocity = velocity_;
  s.load_position = position_ - model_.deflection();
  double measured = 0;
  s.angle_counts = read_encoder(measured);
  const double reference_A = control(last_reference_, measured);
  send(reference_A);
  report_current(s, reference_A);
  integrate(s);
  ++sample_;
  return s;
}

std::vector<DriveSimSample> DriveSimulator::run(double duration_s,
                                                const std::function<double(double)>& reference,
                                                const std::function<double(double)>& cutting) {
  std::vector<DriveSimSample> samples;
  const double count = std::max(0.0, std::floor(duration_s / config_.sample_period_s + 1e-9));
  samples.reserve(static_cast<std::size_t>(count) + 1);
  for (std::size_t n = 0; static_cast<double>(n) <= count; ++n) {
    const double t = static_cast<double>(sample_) * config_.sample_period_s;
    samples.push_back(step(reference(t), cutting ? cutting(t) : 0.0));
  }
  return samples;
}

}  // namespace servosense
