#include "cutting_turns.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "servosense/core/units.hpp"

namespace servosense::cutting_turns {
namespace {

constexpr double kMemory = 5;  // time constants of a sensor after which it has forgotten
constexpr std::size_t kBatches = 20, kFewestBatches = 8;

/// Standard error of the mean of what a quantum leaves: with noise of several quanta it is shaken
/// out (Widrow 1956).
double quantum_error(const CuttingSignal& signal, double from, double to, double speed_rad_s) {
  if (!(signal.quantum > 0) || signal.raw.empty()) return 0;
  double n = 0, sum = 0, squares = 0;
  const auto end = std::min(static_cast<std::size_t>(to), signal.raw.size());
  for (auto i = static_cast<std::size_t>(from); i < end; ++i) {
    const double off = signal.raw[i] - signal.raw[static_cast<std::size_t>(from)];
    if (!std::isfinite(off)) continue;
    ++n;
    sum += off;
    squares += off * off;
  }
  if (n < 1) return 0;
  const double variance = std::max(0.0, squares / n - sum / n * sum / n);
  const double ratio = kTwoPi * kTwoPi / 2 * variance / (signal.quantum * signal.quantum);
  const double scale = signal.unit_per_raw / (signal.over_speed ? std::abs(speed_rad_s) : 1);
  return signal.quantum / std::sqrt(12.0) * std::exp(-ratio) * std::abs(scale);
}

}  // namespace

std::vector<Turns> turns_of(const CuttingRecord& record) {
  const std::vector<double>& w = record.speed_rad_s;
  const double period = record.sample_period_s;
  std::vector<Turns> all;
  double angle = 0, from = 0, whole = 0;  // of the turns that are under way
  bool turning = false;
  for (std::size_t i = 0; i < w.size(); ++i) {
    const double speed = std::abs(w[i]);
    if (!(speed > kSlowest_rad_s)) {
      turning = false;
      continue;
    }
    if (!turning) {
      turning = true;
      from = static_cast<double>(i);
      angle = whole = 0;
    }
    const double step = speed * period;
    // Every whole turn that ends within this sample.
    const double before = angle;
    angle += step;
    const double least = std::max(kLeast_s, static_cast<double>(kLeastSamples) * period);
    const double turns = std::floor(angle / kTwoPi);
    if (turns <= whole) continue;
    whole = turns;
    const double to = static_cast<double>(i) + (turns * kTwoPi - before) / step;
    if ((to - from) * period < least) continue;
    all.push_back({from, to, std::copysign(turns * kTwoPi / ((to - from) * period), w[i])});
    from = to;
    angle -= turns * kTwoPi;
    whole = 0;
  }
  return all;
}

Means::Means(const std::vector<double>& values) : sum_{0}, invalid_{0} {
  for (const double value : values) {
    sum_.push_back(sum_.back() + (std::isfinite(value) ? value : 0));
    invalid_.push_back(invalid_.back() + (std::isfinite(value) ? 0 : 1));
  }
}

double Means::at(double instant) const {
  const auto whole = std::min(static_cast<std::size_t>(std::max(0.0, instant)), sum_.size() - 1);
  if (whole + 1 >= sum_.size()) return sum_.back();
  return sum_[whole] + (instant - static_cast<double>(whole)) * (sum_[whole + 1] - sum_[whole]);
}

double Means::operator()(double from, double to) const {
  const auto first = std::min(static_cast<std::size_t>(std::max(0.0, from)), invalid_.size() - 1);
  const auto last = std::min(static_cast<std::size_t>(std::ceil(to)), invalid_.size() - 1);
  if (!(to > from) || invalid_[last] != invalid_[first])
    return std::numeric_limits<double>::quiet_NaN();
  return (at(to) - at(from)) / (to - from);
}

CutMean mean_over(const CuttingSignal& signal, const Means& means, const std::vector<Turns>& turns,
                  std::size_t first, std::size_t last, double sample_period_s) {
  const double from = turns[first].from, to = turns[last - 1].to;
  CutMean mean{means(from, to), std::numeric_limits<double>::quiet_NaN()};
  const std::size_t count = last - first;
  if (!std::isfinite(mean.value) || count < 2) return mean;
  const double each_s = (to - from) * sample_period_s / static_cast<double>(count);
  const auto memory = static_cast<std::size_t>(std::ceil(kMemory * signal.lag_s / each_s));
  // Turns that are sampled here and there differ, and make up for it: batches of many tell better.
  const std::size_t size = std::max<std::size_t>(
      1, std::min(std::max(memory, count / kBatches), count / kFewestBatches));
  std::vector<double> off;
  for (std::size_t k = first; k + size <= last; k += size)
    off.push_back(means(turns[k].from, turns[k + size - 1].to) - mean.value);
  const auto n = static_cast<double>(off.size());
  double squares = 0, neighbours = 0;
  for (std::size_t k = 0; k < off.size(); ++k) {
    squares += off[k] * off[k];
    if (k > 0) neighbours += off[k] * off[k - 1];
  }
  double correlation = squares > 0 ? std::min(neighbours / squares, 0.9) : 0;
  if (correlation < 2 / std::sqrt(n)) correlation = 0;             // as white noise has it
  const double inflation = (1 + correlation) / (1 - correlation);  // of an AR(1)
  const double speed = turns[first].speed_rad_s;
  mean.standard_error = std::hypot(std::sqrt(squares / std::max(1.0, n - 1) / n * inflation),
                                   quantum_error(signal, from, to, speed));
  return mean;
}

}  // namespace servosense::cutting_turns
