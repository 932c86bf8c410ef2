#include "servosense/identify/torque_band_reference.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <deque>
#include <string>

namespace servosense {
namespace {

bool same_spacing(double a, double b) { return std::abs(a - b) <= 1e-9 * std::abs(a); }

Expected<Done> check_run(const TorqueRun& run, const std::string& name) {
  if (!(run.spacing > 0 && is_finite(run.spacing)))
    return usage_error(name + " has no positive spacing; give the distance of its points");
  if (run.torque_Nm.size() < 2)
    return data_error(name + " has fewer than two points; record the whole program");
  for (std::size_t i = 0; i < run.torque_Nm.size(); ++i)
    if (!is_finite(run.torque_Nm[i]))
      return data_error(name + " holds no number at point " + std::to_string(i) +
                        "; leave faulty runs out");
  return Done{};
}

// Greatest value within [i - behind, i + ahead], each point entering and leaving the queue once.
std::vector<double> greatest_around(const std::vector<double>& x, std::size_t behind,
                                    std::size_t ahead) {
  std::vector<double> out(x.size());
  std::deque<std::size_t> falling;
  std::size_t next = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    for (; next < x.size() && next <= i + ahead; ++next) {
      while (!falling.empty() && x[falling.back()] <= x[next]) falling.pop_back();
      falling.push_back(next);
    }
    while (falling.front() + behind < i) falling.pop_front();
    out[i] = x[falling.front()];
  }
  return out;
}
std::vector<double> smallest_around(std::vector<double> x, std::size_t behind, std::size_t ahead) {
  for (double& v : x) v = -v;
  x = greatest_around(x, behind, ahead);
  for (double& v : x) v = -v;
  return x;
}

std::size_t points_in(double length, double spacing) {
  return static_cast<std::size_t>(std::ceil(length / spacing - 1e-9));
}

// Beyond its ends a run is as at its ends.
double value_at(const std::vector<double>& x, double at) {
  if (at <= 0) return x.front();
  const auto last = static_cast<double>(x.size() - 1);
  if (at >= last) return x.back();
  const auto i = static_cast<std::size_t>(at);
  const double part = at - static_cast<double>(i);
  return x[i] + part * (x[i + 1] - x[i]);
}

double correlation(const std::vector<double>& a, const std::vector<double>& b, double shift) {
  const auto n = static_cast<double>(a.size());
  double mean_a = 0, mean_b = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    mean_a += a[i] / n;
    mean_b += value_at(b, static_cast<double>(i) + shift) / n;
  }
  double ab = 0, aa = 0, bb = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double x = a[i] - mean_a;
    const double y = value_at(b, static_cast<double>(i) + shift) - mean_b;
    ab += x * y;
    aa += x * x;
    bb += y * y;
  }
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

struct Alignment {
  double shift = 0;  // points
  double correlation = 0;
};
Alignment align(const std::vector<double>& first, const std::vector<double>& run, int most) {
  Alignment best{0, correlation(first, run, 0)};
  for (int s = 1; s <= most; ++s)
    for (const int sign : {-1, 1}) {
      const double c = correlation(first, run, sign * s);
      if (c > best.correlation) best = {static_cast<double>(sign * s), c};
    }
  if (most == 0) return best;
  const double before = correlation(first, run, best.shift - 1);
  const double after = correlation(first, run, best.shift + 1);
  const double bend = before - 2 * best.correlation + after;
  if (bend < 0)
    best.shift = std::clamp(best.shift + 0.5 * (before - after) / bend, -static_cast<double>(most),
                            static_cast<double>(most));
  return best;
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
  TorqueBand band;
  band.spacing = runs[0].spacing;
  const std::vector<double>& first = runs[0].torque_Nm;
  if (!(o.max_shift / band.spacing <= static_cast<double>(first.size())))
    return usage_error("max_shift is longer than the first run");
  const std::size_t n = first.size();
  std::vector<double> mean(n), high = first, low = first;
  const int most = static_cast<int>(o.max_shift / band.spacing);
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const std::vector<double>& run = runs[r].torque_Nm;
    Alignment found{0, 1};
    if (r > 0) found = align(first, run, most);
    if (found.correlation < 0.5)
      return data_error("run " + std::to_string(r + 1) +
                        " does not resemble the first within max_shift; leave it out");
    band.shift.push_back(found.shift * band.spacing);
    for (std::size_t i = 0; i < n; ++i) {
      const double x = value_at(run, static_cast<double>(i) + found.shift);
      mean[i] += x / static_cast<double>(runs.size());
      high[i] = std::max(high[i], x);
      low[i] = std::min(low[i], x);
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    high[i] += o.above_Nm + o.above_share * std::abs(mean[i]);
    low[i] -= o.below_Nm + o.below_share * std::abs(mean[i]);
  }
  const std::size_t lead = points_in(o.lead, band.spacing);
  const std::size_t lag = points_in(o.lag, band.spacing);
  high = greatest_around(high, lag, lead);
  low = smallest_around(low, lag, lead);
  for (std::size_t i = 0; i < n; ++i) band.points.push_back({mean[i], low[i], high[i]});
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

Expected<TorqueRun> average_revolutions(std::span<const double> torque_Nm,
                                        std::span<const double> increment_rad,
                                        std::span<const double> advance, double spacing) {
  if (torque_Nm.size() != increment_rad.size() || torque_Nm.size() != advance.size())
    return usage_error("torque, spindle increments and progress have different lengths");
  if (!(spacing > 0 && is_finite(spacing)))
    return usage_error("the spacing of a torque run must be positive");
  std::vector<double> where, mean;
  TurnMean<double> turns;
  double at = 0, began = 0;
  for (std::size_t i = 0; i < torque_Nm.size(); ++i) {
    if (!is_finite(torque_Nm[i]) || !is_finite(increment_rad[i]) || !(advance[i] >= 0) ||
        !is_finite(advance[i]))
      return data_error("sample " + std::to_string(i) + " of the run is no number or goes back");
    at += advance[i];
    if (advance[i] == 0 || !turns.add(torque_Nm[i], increment_rad[i])) continue;
    where.push_back(0.5 * (began + at));
    mean.push_back(turns.mean());
    began = at;
    turns.next();
  }
  if (mean.size() < 2)
    return data_error("the spindle makes fewer than two turns in the run; record a whole program");
  if (at / spacing > 1e8) return usage_error("the spacing is too fine for the length of the run");
  TorqueRun run;
  run.spacing = spacing;
  std::size_t next = 0;
  for (std::size_t i = 0; static_cast<double>(i) * spacing <= at; ++i) {
    const double x = static_cast<double>(i) * spacing;
    while (next < where.size() && where[next] < x) ++next;
    if (next == 0) {
      run.torque_Nm.push_back(mean.front());
    } else if (next == where.size()) {
      run.torque_Nm.push_back(mean.back());
    } else {
      const double part = (x - where[next - 1]) / (where[next] - where[next - 1]);
      run.torque_Nm.push_back(mean[next - 1] + part * (mean[next] - mean[next - 1]));
    }
  }
  return run;
}

}  // namespace servosense
