#include "impact_response.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace servosense::impact {
namespace {

constexpr std::size_t kFewest = 16;  // samples that tell an offset
constexpr double kBlock_s = 0.002;   // of which an envelope is made
constexpr double kDied = 0.01;       // of the strongest block
constexpr double kStill = 0.1;       // of it: the tail then tells where zero is
constexpr double kWorst = 3;         // a swing at its worst, and slower ones below it
constexpr double kUnsureSquare = 3;  // standard deviations of a mean square

double mean_of(std::span<const double> x) {
  double sum = 0;
  for (const double v : x) sum += v;
  return x.empty() ? 0 : sum / static_cast<double>(x.size());
}

double square_about(std::span<const double> x, double mean) {
  double sum = 0;
  for (const double v : x) sum += (v - mean) * (v - mean);
  return x.empty() ? 0 : sum / static_cast<double>(x.size());
}

/// The last tenth, but two blocks at least: less may be where a slow swing crosses zero.
std::span<const double> last_tenth(std::span<const double> x, std::size_t block) {
  return x.subspan(x.size() - std::min(x.size(), std::max(2 * block, x.size() / 10)));
}

}  // namespace

double Response::left(std::size_t length, double noise) const {
  const auto end = last_tenth(std::span(x).first(std::min(length, x.size())), block);
  const double square = square_about(end, 0) - noise * noise - wander * wander;
  const double unsure =
      kUnsureSquare * noise * noise * std::sqrt(2.0 / static_cast<double>(end.size()));
  return square > unsure && highest > 0 ? std::sqrt(square) / highest : 0;
}

double Response::beyond(std::size_t length, double noise) const {
  const auto end = last_tenth(std::span(x).first(std::min(length, x.size())), block);
  const double rms = left(length, noise) * highest;
  double change = 0;
  for (std::size_t i = 1; i < end.size(); ++i)
    change += (end[i] - end[i - 1]) * (end[i] - end[i - 1]) / static_cast<double>(end.size() - 1);
  const double turn = std::sqrt(std::max(change - 2 * noise * noise, 0.0));
  return turn > 0 ? kWorst * rms * rms / turn : 0;
}

Response response_of(std::span<const double> before, std::span<const double> after,
                     double sample_rate_hz) {
  Response r;
  const bool rests = before.size() >= kFewest;
  const auto n = static_cast<double>(after.size());
  r.block =
      static_cast<std::size_t>(std::clamp(kBlock_s * sample_rate_hz, 8.0, std::max(8.0, n / 4)));
  const auto tail = last_tenth(after, r.block);
  const double tail_mean = mean_of(tail);
  const double zero = rests ? mean_of(before) : tail_mean;
  r.quiet =
      rests ? std::sqrt(square_about(before, zero)) : std::numeric_limits<double>::quiet_NaN();
  r.tail = std::sqrt(square_about(tail, tail_mean));
  r.x.assign(after.begin(), after.end());
  for (double& v : r.x) v -= zero;
  std::vector<double> level;
  const auto measure = [&] {
    level.clear();
    for (std::size_t i = 0; i + r.block <= r.x.size(); i += r.block)
      level.push_back(std::sqrt(square_about(std::span(r.x).subspan(i, r.block), 0)));
    r.highest = level.empty() ? 0 : *std::max_element(level.begin(), level.end());
  };
  measure();
  if (rests && r.tail < kStill * r.highest) {
    // A line from the middle of the rest to the middle of the tail.
    const double slope = (tail_mean - zero) / (n - 0.5 * static_cast<double>(tail.size() + 1) +
                                               0.5 * static_cast<double>(before.size() + 1));
    const double begin = slope * 0.5 * static_cast<double>(before.size() + 1);
    for (std::size_t i = 0; i < r.x.size(); ++i) r.x[i] -= begin + slope * static_cast<double>(i);
    measure();
  }
  const double noise = rests ? std::min(r.quiet, r.tail) : r.tail;
  const double died = std::max(kDied * r.highest, 1.5 * noise);
  for (std::size_t b = 0; b < level.size(); ++b)
    if (level[b] > died) r.lasts = (b + 1) * r.block;
  std::vector<double> means;
  const std::size_t tenth = r.x.size() / 10;
  for (std::size_t k = tenth > 0 ? r.lasts / tenth + 1 : 10; k < 10; ++k)
    means.push_back(mean_of(std::span(r.x).subspan(k * tenth, tenth)));
  r.wander = std::sqrt(std::max(
      0.0, square_about(means, 0) - r.tail * r.tail / std::max(static_cast<double>(tenth), 1.0)));
  return r;
}

}  // namespace servosense::impact
