#include "presliding_pushes.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace servosense::presliding {
namespace {

// Each limit with its kind.
constexpr double kSmoothTo = 0.005;   // chosen: noise of the effort that smoothing leaves
constexpr double kWidestMean = 0.04;  // chosen: of a push, over which its effort is smoothed
constexpr std::size_t kPoints = 100;  // numerical: of a push, means of neighbours

}  // namespace

std::vector<Push> pushes_of(const Column& effort, double reversal) {
  std::vector<Push> pushes;
  std::size_t least = 0, most = 0;
  for (std::size_t i = 0; i < effort.size(); ++i) {
    if (pushes.empty()) {
      if (effort[i] < effort[least]) least = i;
      if (effort[i] > effort[most]) most = i;
      if (effort[i] - effort[least] > reversal)
        pushes.push_back({least, i, 1});
      else if (effort[most] - effort[i] > reversal)
        pushes.push_back({most, i, -1});
      continue;
    }
    Push& push = pushes.back();
    const double ahead = push.sense * (effort[i] - effort[push.to]);
    if (ahead >= 0)
      push.to = i;
    else if (-ahead > reversal)
      pushes.push_back({push.to, i, -push.sense});
  }
  return pushes;
}

namespace {

Column smoothed(const Column& values, std::size_t half) {
  if (half == 0) return values;
  std::vector<double> sum(values.size() + 1, 0);
  for (std::size_t i = 0; i < values.size(); ++i) sum[i + 1] = sum[i] + values[i];
  Column mean(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t h = std::min({half, i, values.size() - 1 - i});
    mean[i] = (sum[i + h + 1] - sum[i - h]) / static_cast<double>(2 * h + 1);
  }
  return mean;
}

/// White noise of a slow signal, from its second differences.
double noise_of(const Column& values) {
  double square = 0;
  for (std::size_t i = 2; i < values.size(); ++i) {
    const double bend = values[i] - 2 * values[i - 1] + values[i - 2];
    square += bend * bend;
  }
  return std::sqrt(square / (6 * static_cast<double>(std::max<std::size_t>(values.size(), 3) - 2)));
}

double range_of(const Column& values) {
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  return *most - *least;
}

}  // namespace

Pushed read_pushed(const DriveRecord& record, double load) {
  Pushed r;
  Column effort;
  double at = 0;
  for (const DriveSample<double>& sample : record.samples) {
    if (has(sample.quality, kUnusable | Quality::gap)) continue;
    at += r.position.empty() ? 0 : sample.increment;
    r.position.push_back(at);
    effort.push_back(sample.effort - load);
  }
  if (effort.empty()) return r;
  const double noise = noise_of(effort);
  const double range = range_of(effort);
  // As wide as the noise asks for, as narrow as the pushes allow.
  const double needed = range > 0 ? std::pow(noise / (kSmoothTo * range), 2) : 0;
  const std::size_t rough =
      pushes_of(smoothed(effort, effort.size() / 400), kReversal * range).size();
  const double widest = kWidestMean * static_cast<double>(effort.size()) /
                        static_cast<double>(std::max<std::size_t>(rough, 1));
  r.half_mean = static_cast<std::size_t>(std::min(needed, widest) / 2);
  r.effort = smoothed(effort, r.half_mean);
  r.range = range_of(r.effort);
  r.noise = noise / std::sqrt(static_cast<double>(2 * r.half_mean + 1));
  return r;
}

namespace {

/// Where the reading changes within `push`, but next to a reversal, where a mean of the effort is
/// not that of the instant; the effort `late` samples before.
Points points_in(const Pushed& record, const Push& push, double late) {
  Points all;
  all.sense = push.sense;
  const auto whole = static_cast<std::size_t>(late);
  const double part = late - static_cast<double>(whole);
  const std::size_t from = push.from + record.half_mean + whole + 2;
  for (std::size_t i = from; i + record.half_mean <= push.to; ++i) {
    if (record.position[i] == record.position[i - 1]) continue;
    const Column& e = record.effort;
    const std::size_t k = i - whole;
    const double now = e[k] + part * (e[k - 1] - e[k]);
    const double before = e[k - 1] + part * (e[k - 2] - e[k - 1]);
    all.motion.push_back((record.position[i] + record.position[i - 1]) / 2);
    all.effort.push_back((now + before) / 2);
  }
  const std::size_t together = (all.motion.size() + kPoints - 1) / kPoints;
  if (together < 2) return all;
  Points means;
  means.sense = push.sense;
  for (std::size_t i = 0; i + together <= all.motion.size(); i += together) {
    double motion = 0, effort = 0;
    for (std::size_t k = i; k < i + together; ++k) {
      motion += all.motion[k] / static_cast<double>(together);
      effort += all.effort[k] / static_cast<double>(together);
    }
    means.motion.push_back(motion);
    means.effort.push_back(effort);
  }
  return means;
}

constexpr std::size_t kLeastPoints = 3;  // of a push, else it shows no curvature

}  // namespace

std::vector<Points> points_of(const Pushed& record, const std::vector<Push>& pushes, double late) {
  std::vector<Points> all;
  for (const Push& push : pushes) {
    Points of = points_in(record, push, late);
    if (of.motion.size() >= kLeastPoints) all.push_back(std::move(of));
  }
  return all;
}

}  // namespace servosense::presliding
