#include "servosense/identify/torque_band_reference.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

#include "servosense/core/units.hpp"
#include "torque_band_alignment.hpp"
#include "torque_band_spread.hpp"
#include "torque_extremes.hpp"

namespace servosense {
namespace {

bool same_spacing(double a, double b) { return std::abs(a - b) <= 1e-9 * std::abs(a); }

Expected<Done> check_run(const TorqueRun& run, const std::string& name) {
  if (!(run.spacing > 0 && is_finite(run.spacing)))
    return usage_error(name + " has no positive spacing; give the distance of its points");
  if (run.torque_Nm.size() < 2)
    return data_error(name + " has fewer than two points; record the whole program");
  for (std::size_t i = 0; i < run.torque_Nm.size() && run.sections.empty(); ++i)
    if (!is_finite(run.torque_Nm[i]))
      return data_error(name + " holds no number at point " + std::to_string(i) +
                        "; leave faulty runs out");
  return Done{};
}

std::size_t points_in(double length, double spacing) {
  return static_cast<std::size_t>(std::ceil(length / spacing - 1e-9));
}

/// The same within [from, to) alone: what lies beyond is another cut. What is no number counts for
/// nothing.
template <typename Around>
void dilate(std::vector<double>& x, std::size_t from, std::size_t to, std::size_t behind,
            std::size_t ahead, double nothing, Around around) {
  std::vector<double> part(x.begin() + static_cast<std::ptrdiff_t>(from),
                           x.begin() + static_cast<std::ptrdiff_t>(to));
  for (double& v : part)
    if (!is_finite(v)) v = nothing;
  part = around(part, behind, ahead);
  std::copy(part.begin(), part.end(), x.begin() + static_cast<std::ptrdiff_t>(from));
}

/// Ratio of two feeds, as far as the torque is taken to follow it.
double feed_ratio(double feed, double first) {
  return first > 0 ? std::clamp(feed / first, 0.5, 2.0) : 1.0;
}

/// Over path the runs may differ in feed. A torque that follows the feed in part (Bertok 1984, eq.
/// 4.1) is M (1 + share (o - 1)) at o times the feed: the share by least squares over all runs,
/// then all are as at the feed of the first.
void bring_to_one_feed(std::vector<AlignedSection>& sections) {
  double square = 0, product = 0;
  const auto each = [&sections](auto use) {
    for (AlignedSection& s : sections)
      for (std::size_t r = 1; r < s.torque_Nm.size(); ++r)
        for (std::size_t i = 0; i < s.feed[r].size(); ++i)
          use(s.torque_Nm[0][i], s.torque_Nm[r][i], feed_ratio(s.feed[r][i], s.feed[0][i]));
  };
  each([&](double first, double torque, double o) {
    if (!is_finite(first) || !is_finite(torque)) return;
    const double by = first * (o - 1);
    square += by * by;
    product += by * (torque - first);
  });
  if (!(square > 0)) return;
  const double share = std::clamp(product / square, 0.0, 1.0);
  each([share](double, double& torque, double o) { torque /= 1 + share * (o - 1); });
}

}  // namespace

Expected<TorqueBand> make_torque_band(std::span<const TorqueRun> runs, const TorqueBandOptions& o) {
  if (runs.empty()) return usage_error("a torque band needs a prediction or at least one run");
  for (const double x :
       {o.above_Nm, o.above_share, o.below_Nm, o.below_share, o.lead, o.lag, o.max_shift})
    if (!(x >= 0 && is_finite(x)))
      return usage_error("a tolerance of the torque band is negative or no number");
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const std::string name = "run " + std::to_string(r + 1);
    if (const auto ok = check_run(runs[r], name); !ok) return ok.error();
    if (!same_spacing(runs[0].spacing, runs[r].spacing))
      return usage_error(name + " is spaced otherwise than the first; average both alike");
  }
  if (!(o.false_alarms >= 0 && o.false_alarms < 1))
    return usage_error("the share of false alarms must be within 0 and 1");
  TorqueBand band;
  band.spacing = runs[0].spacing;
  const TorqueRun& first = runs[0];
  const std::size_t n = first.torque_Nm.size();
  if (!(o.max_shift / band.spacing <= static_cast<double>(n)) && first.sections.empty())
    return usage_error("max_shift is longer than the first run");
  const auto most =
      static_cast<int>(std::min(o.max_shift / band.spacing, static_cast<double>(n)) + 1e-9);
  const int sync = std::min(most, static_cast<int>(o.sync_shift / band.spacing + 1e-9));
  auto aligned = align_runs(runs, {most, sync, o.max_drift});
  if (!aligned) return aligned.error();
  bring_to_one_feed(*aligned);
  const std::size_t lead = points_in(o.lead, band.spacing);
  const std::size_t lag = points_in(o.lag, band.spacing);
  const RunSpread spread = spread_of(
      *aligned,
      {o.false_alarms, lag, lead, std::max<std::size_t>(1, points_in(first.step, band.spacing))});
  band.level_deviation = spread.level_deviation;
  band.air_limit_Nm = spread.air_limit_Nm;
  const auto count = static_cast<double>(runs.size());
  std::vector<double> mean(n), high(n), low(n);
  band.shift.assign(runs.size(), 0);
  double matched = 0;
  for (std::size_t k = 0; k < aligned->size(); ++k) {
    const AlignedSection& s = (*aligned)[k];
    for (std::size_t i = s.from; i < s.to; ++i) {
      double sum = 0, highest = -1e300, lowest = 1e300;
      for (const auto& run : s.torque_Nm) {
        const double x = run[i - s.from];
        sum += x;
        highest = std::max(highest, x);
        lowest = std::min(lowest, x);
      }
      mean[i] = sum / count;
      const double size = std::abs(mean[i] + s.friction_Nm);
      const double learned = o.widening * spread.section[k].half_width_Nm(size);
      high[i] =
          std::max(mean[i] + learned, highest + o.widening * (o.above_Nm + o.above_share * size));
      low[i] =
          std::min(mean[i] - learned, lowest - o.widening * (o.below_Nm + o.below_share * size));
      if (!is_finite(mean[i])) high[i] = low[i] = mean[i];
    }
    const auto length = static_cast<double>(s.to - s.from);
    if (!s.matched) {
      band.unmatched += length * band.spacing;
      continue;
    }
    matched += length;
    for (std::size_t r = 0; r < runs.size(); ++r) band.shift[r] += s.shift[r] * length;
  }
  for (double& shift : band.shift) shift *= matched > 0 ? band.spacing / matched : 0;
  for (std::size_t k = 0; k < aligned->size();) {
    const std::size_t from = (*aligned)[k++].from;
    while (k < aligned->size() && (*aligned)[k].joined) ++k;
    const std::size_t to = (*aligned)[k - 1].to;
    dilate(high, from, to, lag, lead, -1e300, greatest_around);
    dilate(low, from, to, lag, lead, 1e300, smallest_around);
  }
  for (std::size_t i = 0; i < n; ++i) {
    const double feed = first.feed.empty() ? 0 : first.feed[i];
    if (is_finite(mean[i]))
      band.points.push_back({mean[i], low[i], high[i], feed});
    else
      band.points.push_back({0, 1, -1, feed});  // nothing is expected
  }
  for (std::size_t k = 0; k < first.sections.size(); ++k) {
    const TorqueRunSection& s = first.sections[k];
    band.sections.push_back({static_cast<std::uint32_t>(s.first), s.block, std::abs(s.speed_rad_s),
                             spread.section[k].has_air, s.behind_gap, spread.section[k].air_Nm});
  }
  return band;
}

Expected<MagnitudeTolerance> smallest_tolerance(const TorqueRun& expected,
                                                const TorqueRun& measured, double lead,
                                                double lag) {
  if (const auto ok = check_run(expected, "the expected torque"); !ok) return ok.error();
  if (const auto ok = check_run(measured, "the measured torque"); !ok) return ok.error();
  if (!same_spacing(expected.spacing, measured.spacing))
    return usage_error("expected and measured torque are spaced differently");
  if (!(lead >= 0 && is_finite(lead) && lag >= 0 && is_finite(lag)))
    return usage_error("the tolerance in time is negative or no number");
  const std::size_t ahead = points_in(lead, expected.spacing);
  const std::size_t behind = points_in(lag, expected.spacing);
  const auto high = greatest_around(expected.torque_Nm, behind, ahead);
  const auto low = smallest_around(expected.torque_Nm, behind, ahead);
  MagnitudeTolerance t;
  for (std::size_t i = 0; i < measured.torque_Nm.size(); ++i) {
    const std::size_t k = std::min(i, high.size() - 1);
    t.above_Nm = std::max(t.above_Nm, measured.torque_Nm[i] - high[k]);
    t.below_Nm = std::max(t.below_Nm, low[k] - measured.torque_Nm[i]);
  }
  return t;
}

}  // namespace servosense
