#include "torque_band_spread.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "servosense/core/units.hpp"
#include "student_quantile.hpp"
#include "torque_extremes.hpp"

namespace servosense {
namespace {

// Before anything is known, the level of a cut differs by 3 % from run to run (stock and edge of a
// tool in use); that counts for as much as four degrees of freedom. One run shows nothing that
// could mend it: then it is taken for as sure as twelve make it, 0.045 at most at 95 %.
constexpr double kAssumedDeviation = 0.03;
constexpr double kAssumedDegrees = 4;
constexpr double kDegreesOfOne = 12;
// Air is a level at the foot of the section: within a tenth of its range, for a tenth of its
// points.
constexpr double kAirRange = 0.1;
constexpr double kAirLeast = 0.1;
constexpr double kAirRise = 0.2;  // of the section's level
// Median of the size of a standard normal number; and the variance of a bend, of three steps
// between which points are interpolated (two thirds of a step's variance on average).
constexpr double kMedianOfNormal = 0.6745;
// Of single steps 0.5 % may lie outside by noise, to either side of the normal distribution: in the
// monitor's memory of 200 steps that is one, a third of an alarm.
constexpr double kStepQuantile = 2.81;
constexpr double kBendVariance = 1.5 * 2 / 3;
// A cut begins where the torque rises by so much of the highest in its section.
constexpr double kCutRise = 0.2;
constexpr double kFlat = 6;  // standard deviations; a range below it has no foot

/// One section's points, where all runs have one.
struct Section {
  std::vector<double> mean;      // of the runs
  std::vector<double> size2;     // square of what the motor gives
  std::vector<double> variance;  // of a run, of what the tolerance in time does not explain
  double own = 0;                // mean of that
};

// Each run against the mean of the others: that difference varies by R / (R - 1) more than a run.
Section looked_at(const AlignedSection& s, const SpreadOptions& o) {
  Section out;
  const std::size_t count = s.torque_Nm.size();
  std::vector<std::vector<double>> run(count);
  for (std::size_t i = 0; i < s.to - s.from; ++i) {
    double mean = 0;
    for (const auto& x : s.torque_Nm) mean += x[i] / static_cast<double>(count);
    if (!is_finite(mean)) continue;
    out.mean.push_back(mean);
    out.size2.push_back((mean + s.friction_Nm) * (mean + s.friction_Nm));
    for (std::size_t r = 0; r < count; ++r) run[r].push_back(s.torque_Nm[r][i]);
  }
  if (out.mean.empty()) return out;
  out.variance.assign(out.mean.size(), 0.0);
  if (count < 2) return out;
  const double others = static_cast<double>(count) - 1, runs = others + 1;
  for (const auto& own : run) {
    std::vector<double> rest(own.size());
    for (std::size_t i = 0; i < own.size(); ++i) rest[i] = (runs * out.mean[i] - own[i]) / others;
    const auto high = greatest_around(rest, o.behind, o.ahead);
    const auto low = smallest_around(rest, o.behind, o.ahead);
    for (std::size_t i = 0; i < own.size(); ++i) {
      const double off = own[i] > high[i] ? own[i] - high[i] : std::min(0.0, own[i] - low[i]);
      out.variance[i] += off * off * others / (runs * runs);
    }
  }
  for (const double v : out.variance) out.own += v / static_cast<double>(out.variance.size());
  return out;
}

/// The value below which a part of them lies.
double share_below(std::vector<double> x, double part) {
  const auto at = static_cast<std::ptrdiff_t>(part * static_cast<double>(x.size() - 1));
  std::nth_element(x.begin(), x.begin() + at, x.end());
  return x[static_cast<std::size_t>(at)];
}

double level_of(const Section& s) {
  double sum = 0;
  for (const double x : s.size2) sum += x / static_cast<double>(s.size2.size());
  return std::sqrt(sum);
}

/// Noise of a run's steps: how far its difference from the mean of all (with one run, its torque)
/// lies off the middle of its neighbours a step away. Where the course is steep, times that differ
/// look like noise: it is read off the fifth of the points that lies flattest.
double noise_of(std::span<const AlignedSection> sections, std::size_t step) {
  struct Bend {
    double slope, size;
  };
  std::vector<Bend> bends;
  double count = 1;
  for (const AlignedSection& s : sections) {
    count = static_cast<double>(s.torque_Nm.size());
    const auto mean = [&](std::size_t i) {
      double sum = 0;
      for (const auto& x : s.torque_Nm) sum += x[i] / count;
      return sum;
    };
    const auto off = [&](std::size_t i) { return s.torque_Nm[0][i] - (count < 2 ? 0.0 : mean(i)); };
    for (std::size_t i = step; s.matched && i + step < s.to - s.from; ++i) {
      const double size = std::abs(off(i) - 0.5 * (off(i - step) + off(i + step)));
      if (is_finite(size)) bends.push_back({std::abs(mean(i + step) - mean(i - step)), size});
    }
  }
  if (bends.empty()) return 0;
  const std::size_t flat = (bends.size() + 4) / 5;
  std::nth_element(bends.begin(), bends.begin() + static_cast<std::ptrdiff_t>(flat - 1),
                   bends.end(), [](const Bend& a, const Bend& b) { return a.slope < b.slope; });
  std::vector<double> sizes;
  for (std::size_t i = 0; i < flat; ++i) sizes.push_back(bends[i].size);
  const double part = count < 2 ? 1 : (count - 1) / count;  // of a run's variance in the difference
  return share_below(sizes, 0.5) / kMedianOfNormal / std::sqrt(part * kBendVariance);
}

/// Weighted least squares: a point counts by what the law says of it so far; neither part is
/// negative.
VarianceLaw law_of(const std::vector<Section>& sections, double degrees) {
  const double assumed = kAssumedDeviation * kAssumedDeviation;
  VarianceLaw law{0, assumed};
  double size2 = 0, points = 0;
  for (const Section& s : sections)
    for (const double x : s.size2) size2 += x, points += 1;
  if (!(degrees > 0 && size2 > 0)) return law;
  const double least = 1e-6 * assumed * size2 / points;  // runs that repeat to the last digit
  for (int pass = 0; pass < 5; ++pass) {
    double ww = 0, wl = 0, ll = 0, we = 0, le = 0;
    for (const Section& s : sections)
      for (std::size_t i = 0; i < s.size2.size(); ++i) {
        const double x = s.size2[i], e = s.variance[i];
        const double v = law.absolute + law.share * x;
        const double w = 1 / ((v + least) * (v + least));
        ww += w, wl += w * x, ll += w * x * x, we += w * e, le += w * e * x;
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
  law.share = (kAssumedDegrees * assumed + degrees * law.share) / (kAssumedDegrees + degrees);
  return law;
}

/// Cuts of a section, one at least: each may differ from run to run on its own.
double cuts_in(const Section& s) {
  const double rise = kCutRise * std::sqrt(*std::max_element(s.size2.begin(), s.size2.end()));
  double cuts = 0, valley = 1e300, peak = 0;
  bool up = false;
  for (const double x : s.size2) {
    const double size = std::sqrt(x);
    valley = std::min(valley, size);
    peak = std::max(peak, size);
    if (!up && size > valley + rise) {
      up = true;
      cuts += 1;
      peak = size;
    } else if (up && size < peak - rise) {
      up = false;
      valley = size;
    }
  }
  return std::max(1.0, cuts);
}

/// Lowest level of the torque, taken in the sense of rotation, if the torque rises above it.
void find_air(const Section& s, double speed_rad_s, SectionSpread& out) {
  if (s.mean.size() < 10) return;
  double sum = 0;
  for (const double m : s.mean) sum += m;
  const double sense = (speed_rad_s != 0 ? speed_rad_s : sum) < 0 ? -1 : 1;
  std::vector<double> along;
  for (const double m : s.mean) along.push_back(sense * m);
  const double foot = share_below(along, 0.05), range = share_below(along, 0.95) - foot;
  if (!(range > kFlat * std::sqrt(s.own)) || !(range > kAirRise * level_of(s))) return;
  double level = 0, n = 0;
  for (const double m : along)
    if (std::abs(m - foot) <= kAirRange * range) level += m, n += 1;
  if (n < kAirLeast * static_cast<double>(along.size())) return;
  out.has_air = true;
  out.air_Nm = sense * level / n;
}

}  // namespace

double SectionSpread::half_width_Nm(double size_Nm) const {
  return width * std::sqrt(law.at(size_Nm));
}

RunSpread spread_of(std::span<const AlignedSection> sections, const SpreadOptions& options) {
  RunSpread out;
  std::vector<Section> looked;
  double count = 0, cuts = 0, runs = 0;
  for (const AlignedSection& s : sections) {
    looked.push_back(s.matched ? looked_at(s, options) : Section{});
    if (!looked.back().mean.empty()) count += 1, cuts += cuts_in(looked.back());
    runs = static_cast<double>(s.torque_Nm.size());
  }
  out.section.resize(sections.size());
  for (std::size_t i = 0; i < looked.size(); ++i)
    find_air(looked[i], sections[i].speed_rad_s, out.section[i]);
  if (!(count > 0 && options.false_alarms > 0)) return out;
  const double each = runs - 1, degrees = each * count;
  const double quantile = student_quantile(0.5 * options.false_alarms / cuts,
                                           each > 0 ? kAssumedDegrees + degrees : kDegreesOfOne);
  const double t = quantile * std::sqrt(1 + 1 / runs);
  const VarianceLaw law = law_of(looked, degrees);
  double noise = noise_of(sections, options.step);
  if (!(each > 0)) {
    // One run does not tell its noise from its course: no more than what is assumed of its level.
    double squares = 0, points = 0;
    for (const Section& s : looked)
      for (const double x : s.size2) squares += x, points += 1;
    noise = std::min(noise, kAssumedDeviation * std::sqrt(squares / points));
  }
  double squares = 0, share = 0, air = 0, airs = 0;
  for (std::size_t i = 0; i < looked.size(); ++i) {
    const Section& s = looked[i];
    if (s.mean.empty()) continue;
    SectionSpread& spread = out.section[i];
    spread.law = law;
    spread.width = t;
    if (each > 0) {
      // A section's runs may show that it varies more than the law of all says. That it varies less
      // they are too few to show: the quantile is that of all sections' degrees of freedom.
      double expected = 0;
      for (const double x : s.size2)
        expected += (law.absolute + law.share * x) / static_cast<double>(s.size2.size());
      const double own = expected > 0 ? std::max(1.0, s.own / expected) : 1;
      spread.width *= std::sqrt((kAssumedDegrees + each * own) / (kAssumedDegrees + each));
    }
    // What the tolerance in time has explained of the noise is there all the same.
    const double floor = kStepQuantile / quantile * noise;
    spread.law.absolute = std::max(spread.law.absolute, floor * floor);
    for (const double x : s.size2) squares += x, share += law.share * x;
    if (spread.has_air) {
      air += spread.law.at(spread.air_Nm + sections[i].friction_Nm);
      airs += 1;
    }
  }
  out.level_deviation = squares > 0 ? std::sqrt(share / squares) : 0;
  out.air_limit_Nm = airs > 0 ? t * std::sqrt(air / airs) : 0;
  return out;
}

}  // namespace servosense
