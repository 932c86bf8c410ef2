#include "servosense/monitors/collision_reach.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace servosense {
namespace {

constexpr double kUnseen = std::numeric_limits<double>::infinity();
// So many instants of a phase are kept; of more, every other one, and so on.
constexpr std::size_t kMost = 20000;

// Jerk of the monitor after a step of 1 N, until it has passed its peak and come down to a tenth.
std::vector<double> step_response(const HostAxisSlotConfig& axis, double filter_hz) {
  DisturbanceObserverConfig lags = axis.monitor_observer;
  lags.drive = DriveModelConfig{};
  DisturbanceObserver<double> observer;
  observer.configure(lags);
  DisturbanceJerk<double> jerk;
  jerk.configure(axis.collision);
  // Both start in the steady state of what they hear first.
  DriveSample<double> force;
  for (int i = 0; i < 4; ++i) jerk.process(observer.process(force));
  std::vector<double> response;
  double peak = 0;
  const double slowest = filter_hz > 0 ? std::min(axis.collision.cutoff_rad_s, kTwoPi * filter_hz)
                                       : axis.collision.cutoff_rad_s;
  const auto longest =
      static_cast<std::size_t>(20 / (slowest * axis.collision.sample_period_s) + 16);
  const double left =
      filter_hz > 0 ? std::exp(-kTwoPi * filter_hz * axis.collision.sample_period_s) : 0.0;
  while (response.size() < longest) {
    force.effort = 1 - left * (1 - force.effort);
    response.push_back(jerk.process(observer.process(force)));
    peak = std::max(peak, response.back());
    if (response.size() > axis.collision.consecutive_samples && response.back() < 0.1 * peak) break;
  }
  return response;
}

float median(std::vector<float> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

CollisionReach::CollisionReach(const HostAxisSlotConfig& axis, std::size_t index, bool grouped,
                               double filter_hz)
    : index_(index),
      group_(grouped ? 4 : 1),
      consecutive_(axis.collision.consecutive_samples),
      mean_(axis.collision.mean_N_per_s),
      response_(step_response(axis, filter_hz)) {
  window_.reserve(response_.size());
}

void CollisionReach::heard(const HostStack& stack) {
  if (stack.samples() % group_ != 0) return;
  const auto& monitor = stack.collision(index_);
  const auto& state = monitor.state();
  const double threshold = monitor.threshold_N_per_s();
  const MonitorState now = monitor.alarm().state().state;
  const bool armed = state.signal == SignalState::good && threshold > 0 &&
                     (now == MonitorState::armed || now == MonitorState::warning);
  window_.push_back({state.jerk_N_per_s - mean_, threshold, monitor.phase(), armed});
  if (window_.size() < response_.size()) return;
  judge();
  window_.clear();
}

void CollisionReach::judge() {
  if (!std::all_of(window_.begin(), window_.end(), [](const Instant& i) { return i.armed; }))
    return;
  const MotionPhase phase = window_[window_.size() / 2].phase;
  Phase& of = found_[static_cast<std::size_t>(phase)];
  if (of.instants++ % of.stride != 0) return;
  for (const double sign : {1.0, -1.0}) {
    Found smallest{std::numeric_limits<float>::infinity(), 0};
    for (std::size_t from = 0; from + consecutive_ <= window_.size(); ++from) {
      double needed = 0;
      for (std::size_t i = from; i < from + consecutive_; ++i) {
        const Instant& at = window_[i];
        const double lacks = at.threshold - sign * at.jerk;
        needed = std::max(needed, response_[i] > 0 ? lacks / response_[i] : kUnseen);
      }
      if (needed >= static_cast<double>(smallest.step_N)) continue;
      smallest = {static_cast<float>(needed), static_cast<float>(window_[from].threshold)};
    }
    of.found.push_back(smallest);
  }
  if (of.found.size() < 2 * kMost) return;
  for (std::size_t i = 0; i < kMost; ++i) of.found[i] = of.found[i / 2 * 4 + i % 2];
  of.found.resize(kMost);
  of.stride *= 2;
}

std::optional<CollisionReach::Result> CollisionReach::result() const {
  Result result;
  std::vector<float> steps, rates, standing_steps, standing_rates;
  for (std::size_t p = 0; p < found_.size(); ++p) {
    if (found_[p].found.empty()) continue;
    const bool stands = p == static_cast<std::size_t>(MotionPhase::standstill);
    std::vector<float> own;
    for (const Found& f : found_[p].found) {
      own.push_back(f.step_N);
      (stands ? standing_steps : steps).push_back(f.step_N);
      (stands ? standing_rates : rates).push_back(f.rate_N_per_s);
    }
    if (p < kMotionPhases) result.phase_N[p] = static_cast<double>(median(std::move(own)));
  }
  // Contacts happen while something moves: standing counts where there is hardly anything else.
  result.moving = 9 * steps.size() >= standing_steps.size() && !steps.empty();
  if (!result.moving) {
    steps = std::move(standing_steps);
    rates = std::move(standing_rates);
  }
  if (steps.empty()) return std::nullopt;
  result.step_N = static_cast<double>(median(std::move(steps)));
  result.rate_N_per_s = static_cast<double>(median(std::move(rates)));
  return result;
}

}  // namespace servosense
