#include "servosense/identify/idle_signs.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/identify/effort_sign.hpp"

namespace servosense {
namespace {

constexpr double kBraking = 0.02;  // of the hardest acceleration: what is less may be noise
constexpr double kAcceleration_s = 8e-3;
// Of what the values as they are leave unexplained: half is no chance.
constexpr double kBetter = 0.5;

double hardest_acceleration(const DriveRecord& record) {
  const auto span = std::max<std::size_t>(
      1, static_cast<std::size_t>(std::lround(kAcceleration_s / record.sample_period_s)));
  double hardest = 0, before = 0, sum = 0;
  std::size_t n = 0;
  bool have = false;
  for (const DriveSample<double>& s : record.samples) {
    if (has(s.quality, Quality::gap | Quality::restarted)) {
      have = false;
      sum = 0;
      n = 0;
      continue;
    }
    sum += s.increment;
    if (++n < span) continue;
    if (have) hardest = std::max(hardest, std::abs(sum - before));
    before = std::exchange(sum, 0);
    have = true;
    n = 0;
  }
  const double seconds = static_cast<double>(span) * record.sample_period_s;
  return hardest / (seconds * seconds);
}

struct Found {
  double sure_share = 1;
  double residual_share = 0;  // of the fit with these signs
};

Expected<Found> find(const DisturbanceObserverConfig& base, DriveRecord& record,
                     double unit_per_count, const IdleOptions& options) {
  EffortSignConfig config;
  config.sample_period_s = record.sample_period_s;
  config.braking = kBraking * hardest_acceleration(record);
  DriveRecord driving = record;
  resolve_signs(driving.samples, config, Quality::gap);
  auto found = identify_idle(base, driving, options);
  if (!found) return found.error();
  // Once more, with what the whole record says of the drive.
  double share = 1;
  for (int round = 0; round < 2; ++round) {
    config = effort_sign_config(identified_drive(base.drive, *found), record.sample_period_s,
                                unit_per_count);
    share = resolve_signs(record.samples, config);
    auto again = identify_idle(base, record, options);
    if (!again) return again.error();
    found = std::move(again);
  }
  return Found{share, found->residual_share};
}

}  // namespace

Expected<double> find_idle_signs(const DisturbanceObserverConfig& base, DriveRecord& record,
                                 double unit_per_count, const IdleOptions& options) {
  const auto found = find(base, record, unit_per_count, options);
  if (!found) return found.error();
  return found->sure_share;
}

std::optional<double> recognise_idle_signs(const DisturbanceObserverConfig& base,
                                           DriveRecord& record, double unit_per_count,
                                           const IdleOptions& options) {
  // An absolute power over the speed is along the motion, where that is no creeping.
  const bool negative =
      std::any_of(record.samples.begin(), record.samples.end(), [&](const DriveSample<double>& s) {
        if (!options.power) return s.effort < 0;
        return s.effort * s.increment < 0 && !has(s.quality, kUnusable | Quality::gap);
      });
  if (negative) return {};
  DriveRecord tried = record;
  const auto found = find(base, tried, unit_per_count, options);
  if (!found) return {};
  const auto as_is = identify_idle(base, record, options);
  if (as_is && !(found->residual_share < kBetter * as_is->residual_share)) return {};
  record = std::move(tried);
  return found->sure_share;
}

}  // namespace servosense
