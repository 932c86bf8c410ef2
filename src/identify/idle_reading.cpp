// What an observer reads of an idling run, and where the drive moves in it.
#include <algorithm>
#include <cmath>

#include "idle_design.hpp"
#include "servosense/dsp/first_order.hpp"
#include "servosense/identify/idle.hpp"

namespace servosense {
namespace {

constexpr double kStandstill_s =
    0.05;  // slower than the least speed for longer than this: standing
constexpr double kLeastSpeedShare = 0.01;  // of the highest speed

constexpr double kDetectionQuantile = 2.326;  // standard normal, 99 %

}  // namespace

std::vector<bool> samples_in_motion(const DisturbanceObserverConfig& observer,
                                    const DriveRecord& record) {
  PseudoDerivative<double> velocity;
  velocity.configure(
      {observer.velocity_cutoff_rad_s, record.sample_period_s, observer.discretisation});
  std::vector<double> speed;
  speed.reserve(record.samples.size());
  double highest = 0;
  for (const DriveSample<double>& sample : record.samples) {
    speed.push_back(std::abs(velocity.process(sample.increment)));
    highest = std::max(highest, speed.back());
  }
  const double least = kLeastSpeedShare * highest;
  const auto standstill = static_cast<std::size_t>(kStandstill_s / record.sample_period_s) + 1;
  const auto settle = static_cast<std::size_t>(
      10 * (1 / observer.disturbance_cutoff_rad_s + 1 / observer.velocity_cutoff_rad_s) /
      record.sample_period_s);
  std::vector<bool> moving(speed.size(), false);
  std::size_t slow = standstill;  // samples in a row below the least speed
  std::size_t since = 0;          // samples since motion began or a fault ended
  for (std::size_t i = 0; i < speed.size(); ++i) {
    slow = speed[i] > least ? 0 : slow + 1;
    const bool faulty =
        has(record.samples[i].quality, kUnusable | Quality::gap | Quality::restarted);
    since = slow >= standstill || faulty ? 0 : since + 1;
    moving[i] = since > settle && slow == 0;
  }
  return moving;
}

double idle_reading(const DisturbanceObserverConfig& observer, const DriveRecord& record,
                    std::size_t from) {
  const std::vector<double> estimate = idle_fit::response(observer, record, false);
  const std::vector<bool> moving = samples_in_motion(observer, record);
  double square = 0, n = 0;
  for (std::size_t i = from; i < estimate.size(); ++i) {
    if (!moving[i]) continue;
    square += estimate[i] * estimate[i];
    ++n;
  }
  return n > 0 ? std::sqrt(square / n) : 0;
}

bool load_helps(const DisturbanceObserverConfig& base, const DriveRecord& record,
                const IdleIdentification& found, const IdleOptions& options) {
  const std::size_t split = 2 * record.samples.size() / 3;
  DriveRecord first{record.channel, record.sample_period_s, {}};
  first.samples.assign(record.samples.begin(),
                       record.samples.begin() + static_cast<std::ptrdiff_t>(split));
  IdleOptions same = options;
  same.knees = {found.friction_knee};
  same.seek_field_weakening = false;  // it is in `base`
  const auto fit = identify_idle(base, first, same);
  DisturbanceObserverConfig with = base;
  with.sample_period_s = record.sample_period_s;
  with.drive = identified_drive(base.drive, found);
  if (fit && fit->constant_load_fitted) with.drive.constant_load = fit->constant_load.value;
  DisturbanceObserverConfig without = with;
  without.drive.constant_load = 0;
  return idle_reading(with, record, split) < idle_reading(without, record, split);
}

RunningEffort running_effort(const DriveRecord& record, double above) {
  double highest = 0, n = 0;
  RunningEffort mean;
  for (const auto& s : record.samples) highest = std::max(highest, std::abs(s.increment));
  for (const auto& s : record.samples) {
    if (!(std::abs(s.increment) > above * highest)) continue;
    ++n;
    mean.speed += (std::abs(s.increment) / record.sample_period_s - mean.speed) / n;
    mean.effort += ((s.increment > 0 ? s.effort : -s.effort) - mean.effort) / n;
  }
  return mean;
}

DetectabilityFloor idle_fit::floor_of(const DisturbanceObserverConfig& observer,
                                      const DriveRecord& record, double false_alarm_rate_per_hour) {
  const std::vector<double> estimate = response(observer, record, false);
  const std::vector<bool> moving = samples_in_motion(observer, record);
  DetectabilityFloor floor;
  floor.false_alarm_rate_per_hour = false_alarm_rate_per_hour;
  double sum = 0;
  std::size_t n = 0;
  for (std::size_t i = 0; i < estimate.size(); ++i)
    if (moving[i]) {
      sum += estimate[i];
      ++n;
    }
  if (n == 0) return floor;
  const double mean = sum / static_cast<double>(n);
  double square = 0;
  std::size_t crossings = 0;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    if (!moving[i]) continue;
    const double d = estimate[i] - mean;
    square += d * d;
    floor.noise_peak = std::max(floor.noise_peak, std::abs(d));
    if (i > 0 && moving[i - 1] && (estimate[i - 1] - mean) * d < 0) ++crossings;
  }
  floor.noise_rms = std::sqrt(square / static_cast<double>(n));
  const double seconds = static_cast<double>(n) * record.sample_period_s;
  floor.crossing_rate_hz = static_cast<double>(std::max<std::size_t>(crossings, 1)) / seconds;
  // Rice (1944): a Gaussian signal leaves the band mean +- h at the rate of its mean crossings
  // times exp(-h^2 / 2 sigma^2). Friction leaves peaks that no Gaussian has: what the idle run
  // itself reached is the least threshold.
  const double allowed_hz = false_alarm_rate_per_hour / 3600;
  const double rice = std::sqrt(2 * std::max(0.0, std::log(floor.crossing_rate_hz / allowed_hz)));
  floor.threshold = std::max(floor.noise_rms * rice, floor.noise_peak);
  floor.smallest_step = floor.threshold + kDetectionQuantile * floor.noise_rms;
  return floor;
}

}  // namespace servosense
