#include "impact_contacts.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/dsp/quantile.hpp"

namespace servosense::impact {
namespace {

constexpr double kBaseline_s = 0.04;    // blocks whose medians a pulse of some ms does not move
constexpr double kNormal = 1.4826;      // of a median absolute deviation, to a standard deviation
constexpr double kAboveNoise = 8;       // standard deviations: not once in a record by chance
constexpr double kLeastContact = 0.03;  // of the highest: below lies the ringing of a hammer
constexpr double kPull = 0.5;           // of a top: what swings back as far is no contact
// Nobody strikes twice on purpose within the first; a weaker contact within the second is a bounce.
constexpr double kTwice_s = 0.12, kBounce_s = 0.25, kBounceShare = 0.5;

/// Means of `width` samples about each; at the ends of what there is.
std::vector<double> smoothed(const std::vector<double>& x, std::size_t width) {
  std::vector<double> sum(x.size() + 1, 0.0), y(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) sum[i + 1] = sum[i] + x[i];
  for (std::size_t i = 0; i < x.size(); ++i) {
    const std::size_t from = i > width / 2 ? i - width / 2 : 0;
    const std::size_t to = std::min(x.size(), i + width / 2 + 1);
    y[i] = (sum[to] - sum[from]) / static_cast<double>(to - from);
  }
  return y;
}

double deviation_of(const std::vector<double>& x) {
  std::vector<double> away;
  away.reserve(x.size());
  for (const double v : x) away.push_back(std::abs(v));
  return kNormal * median(away);
}

/// Highest samples of the stretches above a level.
void add_tops(const std::vector<double>& x, double level, std::vector<std::size_t>& tops) {
  bool above = false;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (x[i] > level && !above) tops.push_back(i);
    above = x[i] > level;
    if (above && x[i] > x[tops.back()]) tops.back() = i;
  }
}

/// Whether what stands out there also goes the other way: no contact does.
bool pulls(const std::vector<double>& mean, std::size_t top, std::size_t width) {
  const std::size_t from = top > width ? top - width : 0, to = std::min(mean.size(), top + width);
  return *std::min_element(mean.begin() + static_cast<std::ptrdiff_t>(from),
                           mean.begin() + static_cast<std::ptrdiff_t>(to)) < -kPull * mean[top];
}

/// Contacts, each with its own pulse, in the order of time.
std::vector<ForcePulse> find_contacts(const std::vector<double>& force, double noise, double rate) {
  const std::size_t highest =
      static_cast<std::size_t>(std::max_element(force.begin(), force.end()) - force.begin());
  const ForcePulse first = pulse_about(force, highest);
  const std::size_t width = std::max<std::size_t>(1, first.before + first.after);
  // Under a triangle as wide as a pulse.
  const std::vector<double> mean = smoothed(smoothed(force, width / 2), width / 2);
  const double mean_noise = std::max(deviation_of(mean), noise / std::sqrt(double(width)));
  const double mean_top = *std::max_element(mean.begin(), mean.end());
  std::vector<std::size_t> tops;
  add_tops(force, std::max(kAboveNoise * noise, kLeastContact * first.peak_N), tops);
  add_tops(mean, std::max(kAboveNoise * mean_noise, kLeastContact * mean_top), tops);
  std::sort(tops.begin(), tops.end(),
            [&](std::size_t a, std::size_t b) { return force[a] > force[b]; });
  std::vector<ForcePulse> contacts;
  const auto bounce = static_cast<std::size_t>(kBounce_s * rate);
  for (const std::size_t top : tops) {
    bool own = true;
    for (const ForcePulse& c : contacts) {
      const std::size_t away = top > c.peak ? top - c.peak : c.peak - top;
      // Within the pulse of a stronger one, or what a hammer's ringing or a solenoid adds to it.
      own = own && away > (top > c.peak ? c.after : c.before);
      if (away < bounce)
        own = own && mean[top] > std::max(kAboveNoise * mean_noise, kLeastContact * mean[c.peak]) &&
              !pulls(mean, top, width);
    }
    if (own) contacts.push_back(pulse_about(force, top));
  }
  std::sort(contacts.begin(), contacts.end(),
            [](const ForcePulse& a, const ForcePulse& b) { return a.peak < b.peak; });
  return contacts;
}

}  // namespace

ForceRecord force_record(std::span<const double> measured_N, double sample_rate_hz) {
  ForceRecord record;
  const std::size_t n = measured_N.size();
  const auto block = static_cast<std::size_t>(
      std::max(64.0, std::min(kBaseline_s * sample_rate_hz, static_cast<double>(n))));
  const std::size_t blocks = std::max<std::size_t>(1, n / block);
  std::vector<double> at, level;
  for (std::size_t b = 0; b < blocks; ++b) {
    const std::size_t from = b * n / blocks, to = (b + 1) * n / blocks;
    std::vector<double> values;
    for (std::size_t i = from; i < to; ++i)
      if (std::isfinite(measured_N[i])) values.push_back(measured_N[i]);
    if (values.empty()) continue;
    at.push_back(0.5 * static_cast<double>(from + to));
    level.push_back(median(values));
  }
  record.force_N.resize(n, 0.0);
  record.known.resize(n, false);
  std::vector<double> quiet;
  for (std::size_t i = 0, k = 0; i < n; ++i) {
    if (!std::isfinite(measured_N[i])) continue;
    const auto x = static_cast<double>(i);
    while (k + 1 < at.size() && at[k + 1] < x) ++k;
    double base = level[k];
    if (x > at[k] && k + 1 < at.size())
      base += (level[k + 1] - level[k]) * (x - at[k]) / (at[k + 1] - at[k]);
    record.force_N[i] = measured_N[i] - base;
    record.known[i] = true;
    quiet.push_back(record.force_N[i]);
  }
  record.noise_N = deviation_of(quiet);
  return record;
}

std::vector<Blow> find_blows(const ForceRecord& record, double sample_rate_hz) {
  std::vector<double> force = record.force_N;
  const auto strongest = std::max_element(
      force.begin(), force.end(), [](double a, double b) { return std::abs(a) < std::abs(b); });
  if (strongest == force.end() || !(std::abs(*strongest) > kAboveNoise * record.noise_N)) return {};
  const double sign = *strongest < 0 ? -1 : 1;
  for (double& f : force) f *= sign;
  std::vector<Blow> blows;
  const ForcePulse* last = nullptr;
  const std::vector<ForcePulse> contacts = find_contacts(force, record.noise_N, sample_rate_hz);
  for (const ForcePulse& c : contacts) {
    const double apart_s =
        last == nullptr ? kBounce_s : static_cast<double>(c.peak - last->peak) / sample_rate_hz;
    const bool together =
        apart_s < kTwice_s ||
        (apart_s < kBounce_s && c.peak_N < kBounceShare * blows.back().pulse.peak_N);
    last = &c;
    if (!together) {
      blows.push_back({c, false, {}});
      continue;
    }
    Blow& blow = blows.back();
    const bool stronger = c.peak_N > blow.pulse.peak_N;
    const ForcePulse& weaker = stronger ? blow.pulse : c;
    if (!blow.doubled || weaker.peak_N > blow.second.peak_N) blow.second = weaker;
    if (stronger) blow.pulse = c;
    blow.doubled = true;
  }
  for (Blow& blow : blows)
    for (ForcePulse* p : {&blow.pulse, &blow.second}) p->peak_N *= sign;
  return blows;
}

}  // namespace servosense::impact
