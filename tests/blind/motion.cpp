#include "motion.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace blind {

std::size_t Program::samples(double seconds) const {
  return static_cast<std::size_t>(std::llround(seconds * rate_hz_));
}

void Program::dwell(double seconds) { path_.insert(path_.end(), samples(seconds), path_.back()); }

void Program::move(double target, double speed, double acceleration) {
  const double start = path_.back();
  const double distance = std::abs(target - start);
  if (distance == 0) return;
  const double direction = target > start ? 1.0 : -1.0;
  const double top = std::min(speed, std::sqrt(distance * acceleration));
  const double ramp = top / acceleration;
  const double total = distance / top + ramp;
  const std::size_t n = samples(total) + 1;
  for (std::size_t i = 1; i < n; ++i) {
    const double t = static_cast<double>(i) / rate_hz_;
    const double left = total - t;
    double s = top * (t - ramp / 2);
    if (t < ramp) s = acceleration * t * t / 2;
    if (left < ramp) s = distance - acceleration * left * left / 2;
    path_.push_back(start + direction * s);
  }
  path_.push_back(target);
}

void Program::sine(double amplitude, double frequency_hz, unsigned cycles) {
  const double start = path_.back();
  const double total = cycles / frequency_hz;
  const double fade = 0.5 / frequency_hz;
  const std::size_t n = samples(total);
  for (std::size_t i = 1; i <= n; ++i) {
    const double t = static_cast<double>(i) / rate_hz_;
    const double edge = std::clamp(std::min(t, total - t) / fade, 0.0, 1.0);
    const double window = edge * edge * (3 - 2 * edge);
    path_.push_back(start + amplitude * window * std::sin(2 * std::numbers::pi * frequency_hz * t));
  }
  path_.push_back(start);
}

void Program::to_and_fro(double distance, double speed, double acceleration, unsigned times) {
  const double start = path_.back();
  for (unsigned i = 0; i < times; ++i) {
    move(start + distance, speed, acceleration);
    move(start, speed, acceleration);
  }
}

std::vector<double> Program::smoothed(double seconds) const {
  const std::size_t width = std::max<std::size_t>(1, samples(seconds));
  std::vector<double> out(path_.size());
  // Sum of differences from the start: no cancellation at large positions.
  double sum = 0;
  const double start = path_.front();
  for (std::size_t i = 0; i < path_.size(); ++i) {
    sum += path_[i] - start;
    if (i >= width) sum -= path_[i - width] - start;
    out[i] = start + sum / static_cast<double>(width);
  }
  return out;
}

}  // namespace blind
