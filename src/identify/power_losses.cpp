#include "servosense/identify/power_losses.hpp"

#include <algorithm>
#include <cmath>

#include "idle_design.hpp"
#include "servosense/io/drive_speed.hpp"

namespace servosense {
namespace {

constexpr double kKnownWithin = 0.05;  // of the largest torque
constexpr int kMostRounds = 12;        // four to eight settle it
constexpr double kSettled = 0.01;      // of a standard error

constexpr double kAllButFew = 0.99;  // quantile: a few may be off

/// That the motor gives in motion, low-passed.
double largest_torque(DisturbanceObserverConfig filters, const DriveRecord& record) {
  filters.drive = DriveModelConfig{};
  const idle_fit::Column torque = idle_fit::response(filters, record, false);
  const std::vector<bool> moving = samples_in_motion(filters, record);
  std::vector<double> sizes;
  for (std::size_t i = 0; i < torque.size(); ++i)
    if (moving[i]) sizes.push_back(std::abs(torque[i]));
  if (sizes.empty()) return 0;
  const auto at = static_cast<std::ptrdiff_t>(kAllButFew * static_cast<double>(sizes.size() - 1));
  std::nth_element(sizes.begin(), sizes.begin() + at, sizes.end());
  return sizes[static_cast<std::size_t>(at)];
}

/// [W]: what an observer reads of an idling run is the encoder's at any speed, and the power's over
/// the speed: r^2 = a + b / w^2, least squares.
double noise_of_power(const DisturbanceObserverConfig& observer, const DriveRecord& record) {
  const idle_fit::Column left = idle_fit::response(observer, record, false);
  const std::vector<bool> moving = samples_in_motion(observer, record);
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  DriveSpeed speed(record.sample_period_s, true);
  for (std::size_t i = 0; i < left.size(); ++i) {
    const double w = speed.process(record.samples[i].increment / record.sample_period_s);
    if (!moving[i]) continue;
    const double by = 1 / (w * w), square = left[i] * left[i];
    ++n;
    x += by;
    y += square;
    xx += by * by;
    xy += by * square;
  }
  const double spread = n * xx - x * x;
  return spread > 0 ? std::sqrt(std::max(0.0, (n * xy - x * y) / spread)) : 0;
}

/// A loss that is taken off round by round. After the first the step is the secant's, half a full
/// one at the least.
struct Taken {
  double value = 0;

  void take(double left) {
    constexpr double kShortest = 0.5;
    const double gone = value - before_;
    const double share = gone != 0 ? gone / (left_before_ - left) : 1;
    before_ = value;
    left_before_ = left;
    value = std::max(0.0, value + left * (share > 0 ? std::clamp(share, kShortest, 1.0) : 1));
  }

 private:
  double before_ = 0, left_before_ = 0;
};

template <typename Take>
void with_speed(std::vector<DriveSample<double>>& samples, double period_s, Take take) {
  DriveSpeed speed(period_s, true);
  for (DriveSample<double>& s : samples) take(s, speed.process(s.increment / period_s));
}

}  // namespace

void torque_of_load(std::vector<DriveSample<double>>& samples, double sample_period_s,
                    const DriveColumns& columns) {
  with_speed(samples, sample_period_s, [&](DriveSample<double>& s, double speed) {
    s.effort = columns.power ? columns.power->without_losses().torque_Nm(s.effort, speed)
                             : faded_torque(s.effort, speed, columns.rated_to_rad_s);
  });
}

void take_off_losses(std::vector<DriveSample<double>>& samples, double sample_period_s,
                     const PowerReading& power) {
  with_speed(samples, sample_period_s, [&](DriveSample<double>& s, double speed) {
    s.effort = power.with_losses_Nm(s.effort, speed);
  });
}

void mark_too_slow(std::vector<DriveSample<double>>& samples, double sample_period_s,
                   double known_from_rad_s, Quality mark) {
  with_speed(samples, sample_period_s, [&](DriveSample<double>& s, double speed) {
    if (std::abs(speed) < known_from_rad_s) s.quality |= mark;
  });
}

void bridge_too_slow(std::vector<DriveSample<double>>& samples, double sample_period_s,
                     double known_from_rad_s, Quality mark) {
  std::size_t from = 0, at = 0;  // of what is too slow
  const auto bridge = [&](std::size_t to) {
    const double first = samples[from > 0 ? from - 1 : std::min(to, samples.size() - 1)].effort;
    const double last = to < samples.size() ? samples[to].effort : first;
    const auto steps = static_cast<double>(to - from + 1);
    for (std::size_t k = from; k < to; ++k)
      samples[k].effort = first + (last - first) * static_cast<double>(k - from + 1) / steps;
  };
  with_speed(samples, sample_period_s, [&](DriveSample<double>& s, double speed) {
    if (std::abs(speed) < known_from_rad_s) {
      s.quality |= mark;
    } else {
      bridge(at);
      from = at + 1;
    }
    ++at;
  });
  if (from < at) bridge(at);
}

double slowest_of_power(const DriveRecord& record, double least_rad_s) {
  double highest = 0;
  DriveSpeed speed(record.sample_period_s, true);
  for (const DriveSample<double>& s : record.samples)
    highest = std::max(highest, std::abs(speed.process(s.increment / record.sample_period_s)));
  return std::max(least_rad_s, kSlowestShare * highest);
}

Expected<FoundLosses> find_power_losses(const DisturbanceObserverConfig& base, DriveRecord& record,
                                        double known_from_rad_s, const IdleOptions& options) {
  const DriveRecord without = record;
  DisturbanceObserverConfig filters = base;
  filters.sample_period_s = record.sample_period_s;
  for (double* cutoff : {&filters.disturbance_cutoff_rad_s, &filters.velocity_cutoff_rad_s})
    *cutoff = std::min(*cutoff, options.highest_cutoff_rad_s);
  IdleOptions with = options;
  if (!with.knees.empty()) with.knees.erase(with.knees.begin() + 1, with.knees.end());
  FoundLosses found;
  PowerReading power;
  std::optional<IdleIdentification> idle;
  double largest_Nm = 0;
  const auto take_off = [&] {
    record = without;
    take_off_losses(record.samples, record.sample_period_s, power);
    mark_too_slow(record.samples, record.sample_period_s, power.known_from_rad_s, Quality::gap);
    largest_Nm = largest_torque(filters, record);
  };
  power.known_from_rad_s = known_from_rad_s;
  take_off();
  // Each round takes off what the last one left. A watt more lost takes 1/(w + 2 k T) off the
  // torque where the fit has 1/w, half of that to twice, so that a full step may leap over.
  Taken constant, copper;
  bool settled = false;
  for (int round = 0; round < kMostRounds && !settled; ++round) {
    with.losses = power.losses;
    auto again = identify_idle(base, record, with);
    if (!again) {
      record = without;
      return again.error();
    }
    idle = std::move(*again);
    const auto step = [&](Estimate& loss, Taken& taken, const Estimate& left) {
      settled = settled && std::abs(left.value) <= kSettled * left.standard_error;
      taken.take(left.value);
      // What a round more would change is not known.
      loss = {taken.value, std::hypot(left.standard_error, left.value)};
    };
    settled = true;
    step(found.constant_W, constant, idle->constant_loss);
    step(found.copper_W_per_Nm2, copper, idle->copper_loss);
    power.losses = {constant.value, copper.value};
    power.known_from_rad_s =
        std::max(known_from_rad_s, kTellsTimesCopper * power.losses.copper_W_per_Nm2 * largest_Nm);
    take_off();
  }

  filters.drive = identified_drive(base.drive, *idle);
  const double noise_W = noise_of_power(filters, record);
  found.known_from_rad_s =
      std::max(power.known_from_rad_s, largest_Nm > 0 ? noise_W / (kKnownWithin * largest_Nm) : 0);
  return found;
}

}  // namespace servosense
