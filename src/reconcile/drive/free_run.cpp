#include "reconcile/drive/free_run.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <utility>

#include "reconcile/drive/raw_columns.hpp"
#include "servosense/core/units.hpp"
#include "servosense/sim/drive_simulator.hpp"
#include "servosense/sim/gaussian_noise.hpp"

namespace servosense::reconcile {
namespace {

constexpr std::array kHorizons_s = {0.05, 0.1, 0.2, 0.5};
constexpr std::size_t kMostStarts = 64;
constexpr std::size_t kFewestStarts = 8;
constexpr double kNoiseBandwidth = 1.0645;  // of a Gaussian filter, in half-power corners
constexpr double kFitReach = 0.4;           // of the local cubic, in periods of the corner

/// Slope in the middle of a window by a cubic, exact for constant jerk (Savitzky and Golay 1964).
class LocalSlope {
 public:
  LocalSlope(std::size_t reach, double period_s) : reach_(reach) {
    double s2 = 0, s4 = 0, s6 = 0;
    const auto n = static_cast<long>(reach);
    for (long j = -n; j <= n; ++j) {
      const double jj = static_cast<double>(j * j);
      s2 += jj;
      s4 += jj * jj;
      s6 += jj * jj * jj;
    }
    double power = 0;
    for (long j = -n; j <= n; ++j) {
      const auto x = static_cast<double>(j);
      weight_.push_back((s6 * x - s4 * x * x * x) / (s2 * s6 - s4 * s4) / period_s);
      power += weight_.back() * weight_.back();
    }
    noise_gain_ = std::sqrt(power);
  }
  [[nodiscard]] std::size_t reach() const { return reach_; }
  /// Noise of the slope for white noise of 1.
  [[nodiscard]] double noise_gain() const { return noise_gain_; }
  [[nodiscard]] double operator()(const Column& x, std::size_t i) const {
    double sum = 0;
    for (std::size_t k = 0; k < weight_.size(); ++k) sum += weight_[k] * x[i + k - reach_];
    return sum;
  }

 private:
  std::size_t reach_;
  Column weight_;
  double noise_gain_ = 0;
};

/// White noise of a signal around each of `at`, from its fourth differences, in which motion has
/// hardly a share.
double noise_around(const Column& x, const std::vector<std::size_t>& at, std::size_t reach) {
  Column d;
  for (const std::size_t middle : at)
    for (std::size_t i = middle - reach + 2; i + 2 <= middle + reach; ++i)
      d.push_back(std::abs(x[i - 2] - 4 * x[i - 1] + 6 * x[i] - 4 * x[i + 1] + x[i + 2]));
  if (d.empty()) return 0;
  const auto middle = d.begin() + static_cast<long>(d.size() / 2);
  std::nth_element(d.begin(), middle, d.end());
  return *middle / 0.6745 / std::sqrt(70.0);
}

/// The drive in motion: led along a path, or pushed by an effort.
class Plant {
 public:
  Plant(const FreeModel& m, const DriveSignals& s, unsigned substeps)
      : signals_(&s), late_(m.late_s / s.work_period_s), substeps_(substeps) {
    DriveModelConfig c = m.drive;
    step_s_ = s.work_period_s / substeps;
    c.effects.sample_period_s = step_s_;
    model_.configure(c);
    if (!m.constant_ratio.empty())
      constant_ratio_ = std::make_shared<const Column>(s.to_work(m.constant_ratio));
    rad_per_unit_ = kTwoPi / (c.unit_per_turn > 0 ? c.unit_per_turn : kTwoPi);
    motion_.turn_angle_rad = s.turn_angle[0];
  }

  /// From sample `i` to the next, `from` to `to`.
  void follow(std::size_t i, double from, double to) {
    motion_.velocity = signals_->smooth_velocity[i];
    motion_.acceleration = acceleration_ = signals_->smooth_acceleration[i];
    for (unsigned k = 0; k < substeps_; ++k) {
      const double share = (k + 0.5) / substeps_;
      move_to(from + share * (to - from));
      motion_.effort = effort(i, share);
      (void)model_.resistance(motion_);
    }
  }
  void start(double position, double velocity) {
    position_ = position;
    velocity_ = velocity;
  }
  /// From sample `i` to the next, under the effort there and `more`.
  void run(std::size_t i, double more) {
    const double h = step_s_;
    const double rate = model_.inertia() / h, half_viscous = model_.viscous() / 2;
    for (unsigned k = 0; k < substeps_; ++k) {
      const double middle = position_ + h / 2 * velocity_;
      move_to(middle);
      motion_.velocity = velocity_ + h / 2 * acceleration_;
      motion_.acceleration = acceleration_;
      motion_.effort = effort(i, (k + 0.5) / substeps_) + more;
      const double driving = motion_.effort - model_.resistance(motion_);
      const double before = velocity_;
      velocity_ = (before * (rate - half_viscous) + driving) / (rate + half_viscous);
      acceleration_ = (velocity_ - before) / h;
      position_ = middle + h / 2 * velocity_;
    }
  }
  /// What an encoder reads where the drive is now.
  double reading() {
    MotionState<double> m = motion_;
    m.turn_angle_rad += (position_ - m.position) * rad_per_unit_;
    m.position = position_;
    m.velocity = velocity_;
    return position_ + model_.position_error(m);
  }

 private:
  double effort(std::size_t i, double share) {
    double reported = between_samples(signals_->effort, static_cast<double>(i) + share - late_);
    if (constant_ratio_) reported *= (*constant_ratio_)[i];
    return model_.acting_effort(reported, motion_);
  }
  void move_to(double x) {
    motion_.increment = x - motion_.position;
    motion_.position = x;
    double& angle = motion_.turn_angle_rad;
    angle += motion_.increment * rad_per_unit_;
    if (angle >= kTwoPi || angle < 0) angle -= kTwoPi * std::floor(angle / kTwoPi);
  }

  const DriveSignals* signals_;
  double late_;  // samples
  std::shared_ptr<const Column> constant_ratio_;
  unsigned substeps_;
  double step_s_ = 0, rad_per_unit_ = 0;
  DriveModel<double> model_;
  MotionState<double> motion_;  // at the middle of the last step
  double position_ = 0, velocity_ = 0, acceleration_ = 0;
};

/// A run: where it begins, in working samples, and with which speed.
struct Start {
  std::size_t at = 0;
  double speed = 0;  // as measured
};

/// What noise alone does to a run.
struct Disturbance {
  GaussianNoise random;
  double force = 0;                // of each working sample
  double position = 0, speed = 0;  // of a start
};

/// Measured less true position along the record.
Column encoder_error(const DriveModelConfig& drive, const DriveSignals& s, std::size_t n) {
  DriveModelConfig c = drive;
  c.effects.sample_period_s = s.work_period_s;
  auto model = std::make_unique<DriveModel<double>>();  // a delay line is large
  model->configure(c);
  Column error(n);
  MotionState<double> m;
  for (std::size_t i = 0; i < n; ++i) {
    m.position = s.position[i];
    m.velocity = s.velocity[i];
    m.increment = s.increment[i];
    m.turn_angle_rad = s.turn_angle[i];
    error[i] = model->position_error(m);
  }
  return error;
}

/// What the encoder reads along a run of `length` samples from each start.
std::vector<Column> readings(const FreeModel& model, unsigned substeps, const DriveSignals& s,
                             const std::vector<Start>& starts, std::size_t length,
                             Disturbance* noise) {
  const std::size_t last = starts.back().at;
  const Column error = encoder_error(model.drive, s, last + 2);
  auto led = std::make_unique<Plant>(model, s, substeps);
  auto free = std::make_unique<Plant>(*led);
  std::vector<Column> out;
  for (std::size_t i = 0; i <= last; ++i) {
    const double from = s.position[i] - error[i];
    while (out.size() < starts.size() && i == starts[out.size()].at) {
      *free = *led;
      const double slip = (error[i + 1] - error[i - 1]) / (2 * s.work_period_s);
      double position = from, speed = starts[out.size()].speed - slip;
      if (noise != nullptr) {
        position += noise->position * noise->random.next();
        speed += noise->speed * noise->random.next();
      }
      free->start(position, speed);
      Column read = {free->reading()};
      for (std::size_t k = 0; k < length; ++k) {
        free->run(i + k, noise != nullptr ? noise->force * noise->random.next() : 0);
        read.push_back(free->reading());
      }
      out.push_back(std::move(read));
    }
    led->follow(i, from, s.position[i + 1] - error[i + 1]);
  }
  return out;
}

/// Integration steps a working sample, as many as the simulator takes; 0: it cannot follow.
unsigned substeps_of(const DriveModelConfig& drive, const DriveSignals& s) {
  DriveSimulatorConfig c;
  c.sample_period_s = s.work_period_s;
  c.drive = drive;
  const auto simulator = DriveSimulator::create(c);
  return simulator ? simulator->substeps() : 0;
}

/// Where a run of `length` samples may begin: in motion, and clear of faults.
std::vector<std::size_t> possible_starts(const DriveSignals& s, const FreeRunConditions& c,
                                         std::size_t reach, std::size_t length) {
  std::vector<std::size_t> out;
  std::size_t clear = 0;  // samples without fault up to here
  for (std::size_t end = 0; end + reach < s.position.size() && s.time_s[end] <= c.to_s; ++end) {
    clear = s.faulty[end] ? 0 : clear + 1;
    if (clear <= length + reach || end < length + reach) continue;
    const std::size_t i = end - length;
    if (s.time_s[i] >= c.from_s && std::abs(s.smooth_velocity[i]) > c.least_speed) out.push_back(i);
  }
  return out;
}

double rms(const Column& x) {
  double square = 0;
  for (const double v : x) square += v * v;
  return std::sqrt(square / static_cast<double>(std::max<std::size_t>(1, x.size())));
}

}  // namespace

FreeRun free_run(const DriveData& data, const DriveSignals& s, const FreeModel& before,
                 const FreeModel& after, const FreeRunConditions& c) {
  FreeRun out;
  const double period = s.work_period_s;
  const auto samples = [&](double seconds) {
    return static_cast<std::size_t>(std::max(1L, std::lround(seconds / period)));
  };
  const unsigned steps_before = substeps_of(before.drive, s);
  const unsigned steps_after = substeps_of(after.drive, s);
  const double steps = static_cast<double>(s.position.size()) * (steps_before + 2 * steps_after);
  if (steps_before == 0 || steps_after == 0 || steps > kMostSteps) {
    out.not_shown = "the model is too stiff to be integrated along this record";
    return out;
  }

  // Starts, measured at the rate of the record.
  const auto raw_stride =
      static_cast<std::size_t>(std::max(1L, std::lround(period / data.sample_period_s)));
  const auto fit = static_cast<std::size_t>(
      std::max(4.0, std::round(kFitReach / (s.corner_hz * data.sample_period_s))));
  const std::size_t reach = fit / raw_stride + 2;
  std::size_t horizons = kHorizons_s.size();
  std::vector<std::size_t> possible;
  for (; horizons > 0; --horizons) {
    possible = possible_starts(s, c, reach, samples(kHorizons_s[horizons - 1]) + 1);
    if (possible.size() >= kFewestStarts) break;
  }
  if (horizons == 0) {
    out.not_shown = "the held-out part has no stretch of 50 ms in motion and without fault";
    return out;
  }
  Disturbance noise{GaussianNoise(c.seed)};
  const std::size_t count = std::min(possible.size(), kMostStarts);
  std::vector<std::size_t> middles;
  std::vector<Start> starts;
  for (std::size_t j = 0; j < count; ++j) {
    // One in each of equal parts.
    const double part =
        (static_cast<double>(j) + noise.random.uniform()) / static_cast<double>(count);
    starts.push_back(
        {possible[static_cast<std::size_t>(part * static_cast<double>(possible.size()))]});
    middles.push_back(starts.back().at * raw_stride);
  }
  const Column raw = raw_position(data);
  const LocalSlope slope(fit, data.sample_period_s);
  for (Start& start : starts) start.speed = slope(raw, start.at * raw_stride);

  // Noise: of the comparison's force, white; of a position, at its own rate.
  noise.force = c.force_noise / std::sqrt(2 * kNoiseBandwidth * s.corner_hz * period);
  const double position_noise =
      std::max(std::abs(data.unit_per_count) / std::sqrt(12.0), noise_around(raw, middles, fit));
  noise.position = position_noise / std::sqrt(static_cast<double>(raw_stride));
  noise.speed = position_noise * slope.noise_gain();

  const std::size_t length = samples(kHorizons_s[horizons - 1]) + 1;
  const auto run = [&](const FreeModel& model, unsigned substeps, Disturbance* disturbance) {
    return readings(model, substeps, s, starts, length, disturbance);
  };
  const std::vector<Column> first = run(before, steps_before, nullptr);
  const std::vector<Column> second = run(after, steps_after, nullptr);
  const std::vector<Column> disturbed = run(after, steps_after, &noise);

  out.starts = count;
  for (std::size_t h = 0; h < horizons; ++h) {
    const std::size_t k = samples(kHorizons_s[h]);
    Column position[3], speed[3];
    const auto rate = [&](const Column& x) { return (x[k + 1] - x[k - 1]) / (2 * period); };
    for (std::size_t j = 0; j < count; ++j) {
      const std::size_t i = starts[j].at + k;
      position[0].push_back(first[j][k] - s.position[i]);
      position[1].push_back(second[j][k] - s.position[i]);
      position[2].push_back(disturbed[j][k] - second[j][k] + noise.position * noise.random.next());
      speed[0].push_back(rate(first[j]) - s.smooth_velocity[i]);
      speed[1].push_back(rate(second[j]) - s.smooth_velocity[i]);
      speed[2].push_back(rate(disturbed[j]) - rate(second[j]) + noise.speed * noise.random.next());
    }
    out.horizons.push_back({kHorizons_s[h],
                            {rms(position[0]), rms(position[1]), rms(position[2])},
                            {rms(speed[0]), rms(speed[1]), rms(speed[2])}});
  }

  // The run that is drawn departs, without the effects, neither most nor least.
  std::vector<std::pair<double, std::size_t>> order;
  for (std::size_t j = 0; j < count; ++j)
    order.emplace_back(std::abs(first[j][length - 1] - s.position[starts[j].at + length - 1]), j);
  std::nth_element(order.begin(), order.begin() + static_cast<long>(count / 2), order.end());
  const std::size_t drawn = order[count / 2].second;
  for (std::size_t k = 0; k < length; ++k) {
    const std::size_t i = starts[drawn].at + k;
    out.time_s.push_back(s.time_s[i]);
    out.measured.push_back(s.position[i]);
    out.before.push_back(first[drawn][k]);
    out.after.push_back(second[drawn][k]);
  }
  return out;
}

}  // namespace servosense::reconcile
