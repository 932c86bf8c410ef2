#include "reconcile/drive/limit_cycle.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <iterator>
#include <vector>

#include "dsp/fourier.hpp"
#include "reconcile/drive/raw_columns.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/quantile.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kStretch_s = 0.12;         // programs change their speed in some tenths
constexpr std::size_t kShortestCycle = 32;  // samples: eight frequencies in the upper half
constexpr std::size_t kFewestCycles = 8;    // stretches
constexpr double kMedianOfPower = 0.6931;   // median of an exponential over its mean: ln 2
constexpr double kSameFrequency = 0.15;

/// Mean square per line of every stretch, power of two long, in which the signal moves; from fourth
/// differences, so no smooth motion leaks.
struct Stretches {
  std::size_t samples = 0;
  std::vector<std::vector<double>> power;
};

Stretches stretches_of(const Column& x, double period_s, double moving) {
  Stretches s;
  s.samples = kShortestCycle;
  while (static_cast<double>(s.samples) * period_s < kStretch_s) s.samples *= 2;
  const std::size_t n = s.samples;
  const auto length = static_cast<double>(n);
  FourierTransform fft;
  std::vector<double> tapered(n);
  std::vector<std::complex<double>> lines;
  for (std::size_t at = 0; at + n + 4 <= x.size(); at += n) {
    if (std::abs(x[at + n] - x[at]) < moving * length) continue;
    for (std::size_t k = 0; k < n; ++k) {
      const std::size_t i = at + k + 4;
      const double window = 0.5 - 0.5 * std::cos(kTwoPi * static_cast<double>(k) / length);
      tapered[k] = window * (x[i] - 4 * x[i - 1] + 6 * x[i - 2] - 4 * x[i - 3] + x[i - 4]);
    }
    fft.forward(tapered, lines);
    std::vector<double> power(n / 2, 0);
    for (std::size_t line = 1; line < n / 2; ++line) {
      const double step = 2 * std::sin(0.5 * kTwoPi * static_cast<double>(line) / length);
      // Hann: mean square 3/8.
      power[line] = 2 * std::norm(lines[line]) / (0.375 * length * length) / std::pow(step, 8);
    }
    s.power.push_back(std::move(power));
  }
  return s;
}

/// The strongest line above `lowest`, with its neighbours; its frequency in lines. Nothing where
/// others are as strong.
struct Line {
  double at = 0, power = 0;
};

Line line_of(const std::vector<double>& power, std::size_t lowest, const Criteria& criteria) {
  constexpr std::size_t kWide = 2;  // a Hann window's main lobe, either side
  if (lowest + kWide >= power.size()) return {};
  const auto begin = power.begin() + static_cast<long>(lowest);
  const auto peak = static_cast<std::size_t>(std::max_element(begin, power.end()) - power.begin());
  double all = 0, near = 0, weighted = 0;
  for (std::size_t k = lowest; k < power.size(); ++k) {
    all += power[k];
    if (k + kWide < peak || k > peak + kWide) continue;
    near += power[k];
    weighted += power[k] * static_cast<double>(k);
  }
  return near > criteria.limit_cycle_share * all ? Line{weighted / near, near} : Line{};
}

}  // namespace

std::string advice_on(const LimitCycle& limit_cycle, bool turns) {
  return "the drive swings all the time, at " + printed(limit_cycle.frequency_hz, 3) + " Hz by " +
         (turns ? printed(limit_cycle.amplitude, 2) + " rad"
                : printed(1e6 * limit_cycle.amplitude, 2) + " um") +
         ": what friction does under that is no law of friction, and backlash hides in it. A loop "
         "set too high does that, or one with backlash in it: lower its gain and record again";
}

std::string unnameable_under(const LimitCycle& limit_cycle, const std::string& effect) {
  constexpr const char* kUnsafe[] = {"stribeck-friction", "presliding-hysteresis", "quadratic-drag",
                                     "load-dependent-friction", "flexible-coupling"};
  if (!(limit_cycle.frequency_hz > 0) ||
      std::find(std::begin(kUnsafe), std::end(kUnsafe), effect) == std::end(kUnsafe))
    return {};
  return "the drive swings at " + printed(limit_cycle.frequency_hz, 3) +
         " Hz all the time: that alone makes friction and mass look otherwise";
}

double noise_beside_limit_cycle(const Column& x, double period_s, double moving) {
  const Stretches s = stretches_of(x, period_s, moving);
  if (s.power.size() < kFewestCycles) return 0;
  std::vector<double> levels;
  for (std::size_t line = s.samples / 4; line < s.samples / 2; ++line) {
    std::vector<double> here;
    for (const auto& power : s.power) here.push_back(power[line]);
    levels.push_back(median(std::move(here)) / kMedianOfPower);
  }
  return std::sqrt(0.5 * static_cast<double>(s.samples) * median(std::move(levels)));
}

LimitCycle find_limit_cycle(const DriveData& data, const Criteria& criteria) {
  double fastest = 0;
  for (const auto& sample : data.samples) fastest = std::max(fastest, std::abs(sample.increment));
  const Stretches s =
      stretches_of(raw_position(data), data.sample_period_s, criteria.slow_speed * fastest);
  const double line_hz = 1 / (static_cast<double>(s.samples) * data.sample_period_s);
  const auto lowest = static_cast<std::size_t>(std::ceil(criteria.limit_cycle_hz / line_hz));
  std::vector<Line> swinging;
  std::vector<double> frequencies;
  for (const auto& power : s.power) {
    const Line line = line_of(power, lowest, criteria);
    const double speed = kTwoPi * line.at * line_hz * std::sqrt(2 * line.power);
    if (!(speed * data.sample_period_s > criteria.slow_speed * fastest)) continue;
    swinging.push_back(line);
    frequencies.push_back(line.at);
  }
  if (swinging.size() < kFewestCycles || 2 * swinging.size() < s.power.size()) return {};
  const double frequency = median(frequencies);
  std::vector<double> powers;
  for (const Line& line : swinging)
    if (std::abs(line.at - frequency) < kSameFrequency * frequency) powers.push_back(line.power);
  if (2 * powers.size() < s.power.size()) return {};
  return {frequency * line_hz, std::sqrt(2 * median(std::move(powers)))};
}

}  // namespace servosense::reconcile
