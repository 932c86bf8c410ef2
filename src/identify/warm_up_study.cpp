#include "servosense/identify/warm_up_study.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

namespace servosense {
namespace {

constexpr double kWarmUpEvidence = 4;      // standard errors
constexpr double kFrictionOfSpeed = 0.05;  // friction goes with speed at most as speed does
constexpr double kShortestPart_s = 1;      // shorter, a part holds less than one move
constexpr double kNearHighest = 0.95;      // ramps, and an effort that acts late, are left out
constexpr int kTimeConstants = 60;
constexpr double kShortestOfParts = 0.5, kLongestOfRecord = 3;  // limits of the grid

double middle(const WarmUpPart& part) { return (part.from_s + part.to_s) / 2; }

/// Least squares of end and drop at a time constant; mean square that is left.
struct Curve {
  double end = 0, drop = 0, left = std::numeric_limits<double>::infinity();
  double drop_variance_of_left = 0;
};

Curve curve_of(const std::vector<WarmUpPart>& parts, double tau_s) {
  double n = 0, x = 0, xx = 0, y = 0, xy = 0;
  for (const WarmUpPart& p : parts) {
    const double e = std::exp(-middle(p) / tau_s);
    n += 1, x += e, xx += e * e, y += p.friction, xy += e * p.friction;
  }
  Curve c;
  const double spread = xx - x * x / n;
  if (!(spread > 1e-12 * n)) return c;
  c.drop = (xy - x * y / n) / spread;
  c.end = (y - c.drop * x) / n;
  c.left = 0;
  for (const WarmUpPart& p : parts) {
    const double r = p.friction - c.end - c.drop * std::exp(-middle(p) / tau_s);
    c.left += r * r / (n - 3);  // the time constant is the third
  }
  c.drop_variance_of_left = 1 / spread;
  return c;
}

}  // namespace

double WarmUpStudy::at(double t_s) const { return end + drop * std::exp(-t_s / time_constant_s); }

Expected<WarmUpStudy> study_warm_up(const DisturbanceObserverConfig& base,
                                    const DriveRecord& record, std::size_t parts) {
  const std::string name(name_of(record.channel));
  const std::size_t length = record.samples.size() / std::max<std::size_t>(parts, 1);
  const double part_s = static_cast<double>(length) * record.sample_period_s;
  if (parts < kFewestWarmUpParts || parts > kMostWarmUpParts || part_s < kShortestPart_s)
    return data_error(name + ": the record gives " + std::to_string(parts) + " parts of " +
                      std::to_string(part_s) + " s; take " + std::to_string(kFewestWarmUpParts) +
                      " to " + std::to_string(kMostWarmUpParts) +
                      ", a second each or longer, or record more");
  DisturbanceObserverConfig config = base;
  config.sample_period_s = record.sample_period_s;
  WarmUpStudy study;
  std::vector<double> speeds;
  for (std::size_t k = 0; k < parts; ++k) {
    const auto from = record.samples.begin() + static_cast<std::ptrdiff_t>(k * length);
    DriveRecord part{
        record.channel, record.sample_period_s, {from, from + static_cast<std::ptrdiff_t>(length)}};
    part.samples.front().quality |= Quality::restarted;
    const RunningEffort running = running_effort(part, kNearHighest);
    WarmUpPart found;
    found.from_s = static_cast<double>(k) * part_s;
    found.to_s = found.from_s + part_s;
    found.friction = running.effort;
    if (const auto idle = identify_idle(config, part)) {
      found.viscous = idle->viscous;
      found.coulomb = idle->coulomb;
    }
    speeds.push_back(running.speed);
    study.parts.push_back(found);
  }
  study.speed = speeds.front();
  for (std::size_t k = 0; k < parts; ++k)
    if (!(std::abs(speeds[k] - study.speed) <= kFrictionOfSpeed * study.speed && study.speed > 0))
      return data_error(name + ": moves at " + std::to_string(study.speed) + " at first, and at " +
                        std::to_string(speeds[k]) + " from " +
                        std::to_string(study.parts[k].from_s) +
                        " s on; record one motion, again and again, or take longer parts");

  const double whole_s = study.parts.back().to_s;
  const double least = kShortestOfParts * part_s, most = kLongestOfRecord * whole_s;
  Curve best;
  for (int i = 0; i <= kTimeConstants; ++i) {
    const double tau = least * std::pow(most / least, i / double{kTimeConstants});
    if (const Curve c = curve_of(study.parts, tau); c.left < best.left) {
      best = c;
      study.time_constant_s = tau;
    }
  }
  study.end = best.end;
  study.drop = best.drop;
  const double first = middle(study.parts.front()), last = middle(study.parts.back());
  const double share =
      std::exp(-last / study.time_constant_s) - std::exp(-first / study.time_constant_s);
  study.change = {best.drop * share,
                  std::abs(share) * std::sqrt(best.left * best.drop_variance_of_left)};
  study.changes = std::abs(study.change.value) > kWarmUpEvidence * study.change.standard_error;
  study.settles = study.changes && study.time_constant_s < whole_s;
  return study;
}

}  // namespace servosense
