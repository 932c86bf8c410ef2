#include "servosense/identify/learn_thresholds.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

namespace servosense {
namespace {

constexpr double kSigmas = 6;
constexpr double kPeakMargin = 1.5;

/// Mean and spread (Welford 1962).
class Running {
 public:
  void add(double x) {
    ++n_;
    const double d = x - mean_;
    mean_ += d / static_cast<double>(n_);
    squares_ += d * (x - mean_);
    peak_ = std::max(peak_, std::abs(x));
  }
  [[nodiscard]] LearnedThreshold result() const {
    LearnedThreshold t;
    t.mean = mean_;
    t.sigma = n_ > 1 ? std::sqrt(squares_ / static_cast<double>(n_ - 1)) : 0;
    t.peak = peak_;
    t.samples = n_;
    return t;
  }

 private:
  std::uint64_t n_ = 0;
  double mean_ = 0, squares_ = 0, peak_ = 0;
};

}  // namespace

LearnedThreshold learn_collision(const DisturbanceObserverConfig& observer,
                                 const CollisionConfig& collision, const DriveRecord& record) {
  DisturbanceObserver<double> force;
  force.configure(observer);
  CollisionConfig silent = collision;
  silent.threshold_N_per_s = 0;
  CollisionMonitor<double> monitor;
  monitor.configure(silent);
  Running running;
  for (const DriveSample<double>& sample : record.samples) {
    const double f = force.process(sample);
    monitor.process(f, force.state().quality);
    if (monitor.state().signal == SignalState::good) running.add(monitor.state().jerk_N_per_s);
  }
  LearnedThreshold t = running.result();
  t.threshold = std::abs(t.mean) + kSigmas * t.sigma;
  return t;
}

LearnedChatter learn_chatter(const DisturbanceObserverConfig& observer,
                             const ChatterConfig& chatter, const DriveRecord& record) {
  DisturbanceObserver<double> torque;
  torque.configure(observer);
  ChatterConfig silent = chatter;
  silent.chatter_threshold_Nm2 = silent.forced_threshold_Nm2 = 0;
  auto monitor = std::make_unique<HostStack::Chatter>();
  monitor->configure(silent);
  Running off_harmonics;
  Running on_harmonics;
  for (const DriveSample<double>& sample : record.samples) {
    const double t = torque.process(sample);
    monitor->process(t, sample.turn_angle_rad, sample.increment, torque.state().quality);
    if (monitor->state().signal != SignalState::good) continue;
    off_harmonics.add(monitor->state().chatter_Nm2);
    on_harmonics.add(monitor->state().forced_Nm2);
  }
  auto threshold = [](const Running& running) {
    LearnedThreshold t = running.result();
    t.threshold = std::max(t.mean + kSigmas * t.sigma, kPeakMargin * t.peak);
    return t;
  };
  return {threshold(off_harmonics), threshold(on_harmonics)};
}

}  // namespace servosense
