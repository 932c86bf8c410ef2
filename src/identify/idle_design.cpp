#include "idle_design.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/io/drive_speed.hpp"

namespace servosense::idle_fit {
namespace {

constexpr double kHacLag_s = 0.1;
constexpr double kNoSpeed = 1e-3;  // rad/s: keeps a division finite

}  // namespace

Column response(const DisturbanceObserverConfig& config, const DriveRecord& record,
                bool motion_only) {
  DisturbanceObserver<double> observer;
  observer.configure(config);
  Column out;
  out.reserve(record.samples.size());
  for (DriveSample<double> sample : record.samples) {
    if (motion_only) sample.effort = 0;
    out.push_back(observer.process(sample));
  }
  return out;
}

IdleDesign::IdleDesign(const DisturbanceObserverConfig& config, const DriveRecord& record,
                       const IdleOptions& options)
    : config_(config), record_(record) {
  const std::vector<bool> moving = samples_in_motion(config, record);
  // Samples closer than the filters' memory tell nothing new: take means over blocks of them. To
  // pick one of each block instead would turn the encoder's pattern at some speeds into an offset.
  block_ = std::max<std::size_t>(
      1,
      static_cast<std::size_t>(0.25 / (config.disturbance_cutoff_rad_s * record.sample_period_s)));
  for (std::size_t i = 0; i + block_ <= moving.size(); i += block_) {
    const auto from = moving.begin() + static_cast<std::ptrdiff_t>(i);
    if (std::all_of(from, from + static_cast<std::ptrdiff_t>(block_), [](bool b) { return b; }))
      rows_.push_back(i);
  }
  const double knee = config.drive.friction_knee;
  speed = unit_response(&DriveModelConfig::viscous, knee);
  if (options.power) {
    double square = 0;
    for (const double v : speed) square += v * v / static_cast<double>(speed.size());
    for (const double v : speed) weights_.push_back(std::abs(v) / std::sqrt(square));
  }
  output = in_motion(response(config, record, false));
  inertia = unit_response(&DriveModelConfig::inertia, knee);
  viscous = unit_response(&DriveModelConfig::viscous, knee);
  load = unit_response(&DriveModelConfig::constant_load, knee);
  if (options.losses) add_losses();
}

void IdleDesign::add_losses() {
  DisturbanceObserverConfig filters = config_;
  filters.drive = DriveModelConfig{};
  const Column torque = response(filters, record_, false);
  DriveSpeed smooth(record_.sample_period_s, true);
  DriveRecord one = record_, squared = record_;
  for (std::size_t i = 0; i < torque.size(); ++i) {
    const double w = smooth.process(record_.samples[i].increment / record_.sample_period_s);
    // What is too slow is no row.
    one.samples[i].effort = w / (w * w + kNoSpeed * kNoSpeed);
    squared.samples[i].effort = torque[i] * torque[i] * one.samples[i].effort;
  }
  for (const DriveRecord* lost : {&one, &squared})
    losses.push_back(in_motion(response(filters, *lost, false)));
}

Column IdleDesign::in_motion(const Column& all) const {
  Column means;
  means.reserve(rows_.size());
  for (const std::size_t i : rows_) {
    double sum = 0;
    for (std::size_t j = i; j < i + block_; ++j) sum += all[j];
    const double weight = weights_.empty() ? 1 : weights_[means.size()];
    means.push_back(weight * sum / static_cast<double>(block_));
  }
  return means;
}

// One observer a parameter: with the effort left out, each reads minus its own term.
Column IdleDesign::unit_response(double DriveModelConfig::*parameter, double knee) const {
  DisturbanceObserverConfig c = config_;
  c.drive.effects.count = 0;
  c.drive.*parameter = 1;
  c.drive.friction_knee = knee;
  Column y = in_motion(response(c, record_, true));
  for (double& value : y) value = -value;
  return y;
}

Column IdleDesign::coulomb(double knee) const {
  return unit_response(&DriveModelConfig::coulomb, knee);
}

Columns IdleDesign::columns(const Column& coulomb, bool with_load) const {
  Columns all = {&inertia, &viscous, &coulomb};
  if (with_load) all.push_back(&load);
  for (const Column& loss : losses) all.push_back(&loss);
  return all;
}

Column IdleDesign::efforts() const {
  Column all;
  for (const DriveSample<double>& sample : record_.samples) all.push_back(sample.effort);
  return all;
}

Column IdleDesign::reading(const Column& effort) const {
  DisturbanceObserverConfig filters = config_;
  filters.drive = DriveModelConfig{};
  DriveEffectsConfig& effects = filters.drive.effects;
  for (const char* name : {"transport-delay", "current-loop-lag", "field-weakening"})
    if (const EffectSetting* effect = config_.drive.effects.find(name))
      effects.settings[effects.count++] = *effect;
  filters.drive.effort_per_ampere = config_.drive.effort_per_ampere;
  DriveRecord other = record_;
  for (std::size_t i = 0; i < effort.size(); ++i) other.samples[i].effort = effort[i];
  return in_motion(response(filters, other, false));
}

Column IdleDesign::delay(double inertia_value, double viscous_value) const {
  DisturbanceObserverConfig c = config_;
  c.drive.effects.count = 0;
  c.drive.inertia = inertia_value;
  c.drive.viscous = viscous_value;
  const Column effort = response(c, record_, true);
  Column rate(effort.size(), 0.0);
  for (std::size_t i = 1; i + 1 < effort.size(); ++i)
    rate[i] = (effort[i - 1] - effort[i + 1]) / (2 * record_.sample_period_s);
  return in_motion(rate);
}

double IdleDesign::motion_s() const {
  return static_cast<double>(rows_.size() * block_) * record_.sample_period_s;
}

std::size_t IdleDesign::lag() const {
  return static_cast<std::size_t>(kHacLag_s /
                                  (static_cast<double>(block_) * record_.sample_period_s));
}

double IdleDesign::forward_share() const {
  const auto forward = std::count_if(speed.begin(), speed.end(), [](double v) { return v > 0; });
  return static_cast<double>(forward) / static_cast<double>(speed.size());
}

}  // namespace servosense::idle_fit
