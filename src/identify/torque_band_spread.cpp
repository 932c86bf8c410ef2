#include "torque_band_spread.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "servosense/core/units.hpp"
#include "torque_extremes.hpp"

namespace servosense {
namespace {

// Before anything is known, the level of a cut differs by 3 % from run to run (stock and edge of a
// tool in use); that counts for as much as four degrees of freedom.
constexpr double kAssumedDeviation = 0.03;
constexpr double kAssumedDegrees = 4;
// Air is a level at the foot of the section: within a tenth of its range, for a tenth of its
// points.
constexpr double kAirRange = 0.1;
constexpr double kAirLeast = 0.1;
constexpr double kAirRise = 0.2;  // of the section's level
constexpr double kFlat = 6;       // standard deviations; a range below it has no foot

/// Of the standard normal distribution (Abramowitz and Stegun 1964, 26.2.23, to 4.5e-4).
double normal_quantile(double upper_tail) {
  const double t = std::sqrt(-2 * std::log(upper_tail));
  return t - (2.515517 + t * (0.802853 + t * 0.010328)) /
                 (1 + t * (1.432788 + t * (0.189269 + t * 0.001308)));
}
/// Of Student's distribution (Abramowitz and Stegun 1964, 26.7.5).
double student_quantile(double upper_tail, double degrees) {
  const double z = normal_quantile(upper_tail), z2 = z * z, n = degrees;
  return z * (1 + (z2 + 1) / (4 * n) + ((5 * z2 + 16) * z2 + 3) / (96 * n * n) +
              (((3 * z2 + 19) * z2 + 17) * z2 - 15) / (384 * n * n * n));
}

/// Sums over one section.
struct Section {
  std::vector<double> mean;  // of the runs, where all have one
  double level = 0;          // rms of what the motor gives
  double between = 0;        // variance of a run's level
  double within = 0;         // variance of the torque about its run's level
};

// Each run against the mean of the others: that difference varies by R / (R - 1) more than a run.
Section summed(const AlignedSection& s, const SpreadOptions& o) {
  Section out;
  const std::size_t count = s.torque_Nm.size();
  std::vector<std::vector<double>> run(count);
  for (std::size_t i = 0; i < s.to - s.from; ++i) {
    double mean = 0;
    for (const auto& x : s.torque_Nm) mean += x[i] / static_cast<double>(count);
    if (!is_finite(mean)) continue;
    out.mean.push_back(mean);
    out.level += (mean + s.friction_Nm) * (mean + s.friction_Nm);
    for (std::size_t r = 0; r < count; ++r) run[r].push_back(s.torque_Nm[r][i]);
  }
  if (out.mean.empty()) return out;
  const auto n = static_cast<double>(out.mean.size());
  out.level = std::sqrt(out.level / n);
  if (count < 2) return out;
  const double others = static_cast<double>(count) - 1, runs = others + 1;
  for (const auto& own : run) {
    std::vector<double> rest(own.size());
    for (std::size_t i = 0; i < own.size(); ++i) rest[i] = (runs * out.mean[i] - own[i]) / others;
    const auto high = greatest_around(rest, o.behind, o.ahead);
    const auto low = smallest_around(rest, o.behind, o.ahead);
    double mean = 0, square = 0;
    for (std::size_t i = 0; i < own.size(); ++i) {
      const double off = own[i] > high[i] ? own[i] - high[i] : std::min(0.0, own[i] - low[i]);
      mean += off / n;
      square += off * off / n;
    }
    out.between += mean * mean * others / (runs * runs);
    out.within += std::max(0.0, square - mean * mean) * others / (runs * runs);
  }
  return out;
}

/// Variance of a section's level: absolute + share level^2.
struct Law {
  double absolute = 0, share = 0;
  [[nodiscard]] double at(double level) const { return absolute + share * level * level; }
};

/// Weighted least squares: a section counts by its length and by what the law says of it so far;
/// neither part is negative.
Law law_of(const std::vector<Section>& sections, double degrees_each) {
  const double assumed = kAssumedDeviation * kAssumedDeviation;
  Law law{0, assumed};
  for (int pass = 0; pass < 5; ++pass) {
    double ww = 0, wl = 0, ll = 0, we = 0, le = 0;
    for (const Section& s : sections) {
      if (s.mean.empty()) continue;
      const double x = s.level * s.level;
      const double w =
          static_cast<double>(s.mean.size()) / std::max(1e-300, law.at(s.level) * law.at(s.level));
      ww += w, wl += w * x, ll += w * x * x, we += w * s.between, le += w * s.between * x;
    }
    const double det = ww * ll - wl * wl;
    double a = 0, b = ll > 0 ? le / ll : 0;
    if (det > 1e-9 * ww * ll) {
      a = (we * ll - le * wl) / det;
      b = (le * ww - we * wl) / det;
    }
    if (a < 0) a = 0, b = ll > 0 ? le / ll : 0;
    if (b < 0) b = 0, a = ww > 0 ? we / ww : 0;
    law = {a, b};
  }
  double degrees = 0;
  for (const Section& s : sections)
    if (!s.mean.empty()) degrees += degrees_each;
  law.share = (kAssumedDegrees * assumed + degrees * law.share) / (kAssumedDegrees + degrees);
  return law;
}

double quantile(std::vector<double> x, double part) {
  const auto at = static_cast<std::ptrdiff_t>(part * static_cast<double>(x.size() - 1));
  std::nth_element(x.begin(), x.begin() + at, x.end());
  return x[static_cast<std::size_t>(at)];
}

/// Lowest level of the torque, taken in the sense of rotation, if the torque rises above it.
void find_air(const Section& s, double speed_rad_s, SectionSpread& out) {
  if (s.mean.size() < 10) return;
  double sum = 0;
  for (const double m : s.mean) sum += m;
  const double sense = (speed_rad_s != 0 ? speed_rad_s : sum) < 0 ? -1 : 1;
  std::vector<double> along;
  for (const double m : s.mean) along.push_back(sense * m);
  const double foot = quantile(along, 0.05), range = quantile(along, 0.95) - foot;
  if (!(range > kFlat * std::sqrt(s.within + s.between)) || !(range > kAirRise * s.level)) return;
  double level = 0, n = 0;
  for (const double m : along)
    if (std::abs(m - foot) <= kAirRange * range) level += m, n += 1;
  if (n < kAirLeast * static_cast<double>(along.size())) return;
  out.has_air = true;
  out.air_Nm = sense * level / n;
}

}  // namespace

RunSpread spread_of(std::span<const AlignedSection> sections, const SpreadOptions& options) {
  RunSpread out;
  std::vector<Section> sums;
  double count = 0, runs = 0;
  for (const AlignedSection& s : sections) {
    sums.push_back(s.matched ? summed(s, options) : Section{});
    if (!sums.back().mean.empty()) count += 1;
    runs = static_cast<double>(s.torque_Nm.size());
  }
  out.section.resize(sections.size());
  for (std::size_t i = 0; i < sums.size(); ++i)
    find_air(sums[i], sections[i].speed_rad_s, out.section[i]);
  if (!(runs >= 2 && count > 0 && options.false_alarms > 0)) return out;
  const double each = runs - 1, degrees = kAssumedDegrees + each * count;
  const double t = student_quantile(0.5 * options.false_alarms / count, degrees);
  const double further = std::sqrt(1 + 1 / runs);
  const Law law = law_of(sums, each);
  double level2 = 0, between = 0, air = 0, airs = 0;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const Section& s = sums[i];
    if (s.mean.empty()) continue;
    const double level =
        (kAssumedDegrees * law.at(s.level) + each * s.between) / (kAssumedDegrees + each);
    out.section[i].half_width_Nm = t * further * std::sqrt(level + s.within);
    level2 += s.level * s.level;
    between += level;
    if (out.section[i].has_air)
      air += law.at(std::abs(out.section[i].air_Nm + sections[i].friction_Nm)), airs += 1;
  }
  out.level_deviation = level2 > 0 ? std::sqrt(between / level2) : 0;
  out.air_limit_Nm = airs > 0 ? t * further * std::sqrt(air / airs) : 0;
  return out;
}

}  // namespace servosense
