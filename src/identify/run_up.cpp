#include "servosense/identify/run_up.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "run_up_order.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/sample_period.hpp"

namespace servosense {
namespace {

using run_up::CrossingFit;
using run_up::Start;
using run_up::Sweep;
using run_up::Windows;

constexpr double kLongStep = 1.5;             // periods; a longer one is a gap
constexpr double kLeastChange = 0.1;          // of the higher speed, in a sweep
constexpr double kSpeedReversal = 0.02;       // of the highest speed: a fall that is none of a rise
constexpr double kStanding = 0.02;            // of the highest speed: below it nothing turns
constexpr std::size_t kLeastSweepTurns = 40;  // of a sweep
constexpr double kOfRate = 0.4;               // highest frequency, of the sample rate
constexpr double kLeastErrors = 3;            // standard errors of damping
constexpr double kOverSmooth = 0.1;       // of the smooth part, which is a cubic to some hundredths
constexpr double kShadow = 0.05;          // of a stronger crossing at the same time
constexpr double kCrossingsDisagree = 3;  // deviations between crossings

std::string short_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

Expected<double> regular_period(const DecayRecord& r) {
  const double period_s = sample_period(r.t_s);
  if (!(period_s > 0)) return data_error(r.name + ": has fewer than two samples");
  for (std::size_t i = 0; i < r.t_s.size(); ++i) {
    if (!std::isfinite(r.value[i]))
      return data_error(r.name + ": has no number at " + short_number(r.t_s[i]) +
                        " s; cut the record there");
    if (i > 0 && r.t_s[i] - r.t_s[i - 1] > kLongStep * period_s)
      return data_error(r.name + ": has a gap at " + short_number(r.t_s[i]) +
                        " s; cut the record there");
  }
  return period_s;
}

/// Stretches between turning points of the speed.
std::vector<Sweep> sweeps_of(const DecayRecord& r, double period_s) {
  std::vector<double> turns = r.turns;
  if (turns.back() < turns.front())
    for (double& t : turns) t = -t;
  for (std::size_t i = 1; i < turns.size(); ++i) turns[i] = std::max(turns[i], turns[i - 1]);
  // Speed over four turns, every turn.
  std::vector<std::size_t> at;
  for (std::size_t i = 0; i < turns.size(); ++i)
    if (turns[i] >= turns.front() + static_cast<double>(at.size())) at.push_back(i);
  if (at.size() < kLeastSweepTurns) return {};
  std::vector<double> speed;
  for (std::size_t k = 4; k < at.size(); ++k)
    speed.push_back((turns[at[k]] - turns[at[k - 4]]) /
                    (period_s * static_cast<double>(at[k] - at[k - 4])));
  const double highest = *std::max_element(speed.begin(), speed.end());
  std::vector<std::size_t> pivots = {0};
  std::size_t low = 0, high = 0;
  int rising = 0;
  for (std::size_t k = 1; k < speed.size(); ++k) {
    if (speed[k] > speed[high]) high = k;
    if (speed[k] < speed[low]) low = k;
    if (rising >= 0 && speed[k] < speed[high] - kSpeedReversal * highest) {
      if (rising > 0) pivots.push_back(high);
      rising = -1, low = k;
    } else if (rising <= 0 && speed[k] > speed[low] + kSpeedReversal * highest) {
      if (rising < 0) pivots.push_back(low);
      rising = 1, high = k;
    }
    if (rising > 0) low = k;
    if (rising < 0) high = k;
  }
  pivots.push_back(speed.size() - 1);
  std::vector<Sweep> out;
  for (std::size_t p = 1; p < pivots.size(); ++p) {
    std::size_t from = pivots[p - 1], to = pivots[p];
    while (from < to && speed[from] < kStanding * highest) ++from;
    while (to > from && speed[to] < kStanding * highest) --to;
    const double a = speed[from], b = speed[to];
    if (to - from < kLeastSweepTurns || std::abs(a - b) < kLeastChange * std::max(a, b)) continue;
    Sweep s;
    const std::size_t begin = at[from + 2], end = at[to + 2];
    s.from_s = r.t_s[begin];
    s.period_s = period_s;
    s.value.assign(r.value.begin() + static_cast<std::ptrdiff_t>(begin),
                   r.value.begin() + static_cast<std::ptrdiff_t>(end));
    s.turns.assign(turns.begin() + static_cast<std::ptrdiff_t>(begin),
                   turns.begin() + static_cast<std::ptrdiff_t>(end));
    out.push_back(std::move(s));
  }
  return out;
}

struct CrossingFound {
  ModeCrossing crossing;
  std::size_t sweep = 0;
  double peak = 0, passes_s = 0;
  std::string reason;  ///< why it is no mode; empty: it is one
};

std::string why_no_mode(const CrossingFit& f, const CrossingFound& x, double window_s,
                        double least_hz, double most_hz) {
  const double hz = f.natural_frequency_hz.value, z = f.damping_ratio.value;
  if (f.gain < f.enough) return "no more than chance gives";
  if (!(z > kLeastErrors * f.damping_ratio.standard_error) ||
      !std::isfinite(f.damping_ratio.standard_error))
    return "its damping is not known by three standard errors";
  if (f.over_line < f.enough) return "a line of fixed frequency explains it as well";
  if (hz * (1 - z) < least_hz || hz * (1 + z) > most_hz)
    return "its half-power band is not within what the order sweeps";
  if (f.peak < kOverSmooth * f.smooth)
    return "hardly stands out of what changes smoothly with speed";
  if (x.passes_s < window_s) {
    const double slowest = 2 * z * hz / window_s / x.crossing.order;
    return "the sweep crosses it within the window of four turns; at most " +
           short_number(slowest) + " Hz/s of the rotation (" + short_number(60 * slowest) +
           " rpm/s) would do";
  }
  return "";
}

std::vector<CrossingFound> crossings_of(const Sweep& s, std::size_t sweep,
                                        const std::string& record, const RunUpOptions& options,
                                        double& reach_from, double& reach_to) {
  const Windows w = run_up::windows_of(s);
  std::vector<CrossingFound> out;
  if (w.count() < 2) return out;
  const auto [low, high] = std::minmax_element(w.rotation_hz.begin(), w.rotation_hz.end());
  for (int order = 1; order <= options.highest_order; ++order) {
    const double least_hz = order * *low;
    const double most_hz = std::min(order * *high, kOfRate / s.period_s);
    const double from_hz = std::max(options.from_hz, least_hz);
    const double to_hz = std::min(options.to_hz, most_hz);
    if (from_hz >= to_hz) continue;
    reach_from = std::min(reach_from, from_hz), reach_to = std::max(reach_to, to_hz);
    const auto line = run_up::harmonic(s, order);
    const auto amplitude = run_up::amplitudes(s, w, line);
    for (const Start& start : run_up::starts(w, amplitude, order, from_hz, to_hz)) {
      const CrossingFit f = run_up::fit_crossing(s, w, line, amplitude, order, start);
      if (f.modes.empty()) continue;
      CrossingFound x;
      x.sweep = sweep;
      ModeCrossing& c = x.crossing;
      c.record = record;
      c.order = order;
      c.natural_frequency_hz = f.natural_frequency_hz;
      c.damping_ratio = f.damping_ratio;
      const double hz = f.natural_frequency_hz.value;
      std::size_t near = f.first;
      for (std::size_t k = f.first; k < f.last; ++k) {
        const double at_hz = order * w.rotation_hz[k];
        if (std::abs(at_hz - hz) < std::abs(order * w.rotation_hz[near] - hz)) near = k;
        c.frequency_hz.push_back(at_hz);
        c.measured.push_back(std::abs(amplitude[k]));
      }
      c.fitted = f.fitted;
      c.at_s = s.from_s + w.middle_s[near];
      c.rate_hz_per_s = order * w.rotation_slope[near];
      const double half = f.damping_ratio.value * hz;
      c.relative_rate = std::abs(c.rate_hz_per_s) / (kTwoPi * half * half);
      x.peak = f.peak;
      x.passes_s = 2 * half / std::abs(c.rate_hz_per_s);
      x.reason = why_no_mode(f, x, run_up::kWindowTurns / w.rotation_hz[near], least_hz, most_hz);
      // Starts of which the fits meet are one crossing.
      const bool again = std::any_of(out.begin(), out.end(), [&](const CrossingFound& other) {
        const double apart = std::abs(other.crossing.natural_frequency_hz.value - hz);
        return other.crossing.order == order && apart < half && other.reason == x.reason;
      });
      if (!again) out.push_back(std::move(x));
    }
  }
  return out;
}

/// What a strong crossing leaks into other orders at the same time.
void find_shadows(std::vector<CrossingFound>& all) {
  for (CrossingFound& x : all)
    for (const CrossingFound& y : all) {
      if (!x.reason.empty() || x.sweep != y.sweep || x.crossing.order == y.crossing.order) continue;
      if (x.peak < kShadow * y.peak &&
          std::abs(x.crossing.at_s - y.crossing.at_s) < 2 * (x.passes_s + y.passes_s))
        x.reason = "order " + std::to_string(y.crossing.order) + " is far stronger at that time";
    }
}

Estimate weighted_over(const std::vector<ModeCrossing>& all, Estimate ModeCrossing::*which,
                       double& disagree) {
  double sum = 0, weights = 0, chi2 = 0;
  for (const ModeCrossing& c : all) {
    const double weight = 1 / std::pow((c.*which).standard_error, 2);
    sum += weight * (c.*which).value, weights += weight;
  }
  const double mean = sum / weights;
  for (const ModeCrossing& c : all)
    chi2 += std::pow(((c.*which).value - mean) / (c.*which).standard_error, 2);
  const double ratio =
      all.size() > 1 ? std::max(1.0, chi2 / static_cast<double>(all.size() - 1)) : 1;
  disagree = std::max(disagree, std::sqrt(ratio));
  return {mean, std::sqrt(ratio / weights)};
}

void group(std::vector<CrossingFound>& all, RunUpIdentification& out) {
  std::vector<const CrossingFound*> left;
  for (const CrossingFound& x : all) {
    if (x.reason.empty())
      left.push_back(&x);
    else
      out.turned_down.push_back({x.crossing.natural_frequency_hz.value,
                                 x.crossing.damping_ratio.value,
                                 "order " + std::to_string(x.crossing.order) + ": " + x.reason});
  }
  // The best known first; those within its half-power band are the same mode.
  std::sort(left.begin(), left.end(), [](const CrossingFound* l, const CrossingFound* r) {
    return l->crossing.natural_frequency_hz.standard_error <
           r->crossing.natural_frequency_hz.standard_error;
  });
  while (!left.empty()) {
    const Estimate hz = left.front()->crossing.natural_frequency_hz;
    const double half = hz.value * left.front()->crossing.damping_ratio.value;
    RunUpMode mode;
    std::erase_if(left, [&](const CrossingFound* x) {
      const Estimate& other = x->crossing.natural_frequency_hz;
      if (std::abs(other.value - hz.value) > half + 2 * other.standard_error) return false;
      mode.crossings.push_back(x->crossing);
      return true;
    });
    double disagree = 1;
    mode.natural_frequency_hz =
        weighted_over(mode.crossings, &ModeCrossing::natural_frequency_hz, disagree);
    mode.damping_ratio = weighted_over(mode.crossings, &ModeCrossing::damping_ratio, disagree);
    if (disagree > kCrossingsDisagree)
      mode.doubt = "orders and sweeps disagree: it moves with the speed, or is two close ones";
    else if (mode.crossings.size() == 1)
      mode.doubt = "one order of one sweep shows it; nothing confirms it";
    else if (mode.damping_ratio.standard_error > 0.2 * mode.damping_ratio.value)
      mode.doubt =
          "its damping is known within " +
          short_number(100 * mode.damping_ratio.standard_error / mode.damping_ratio.value) +
          " % only";
    out.modes.push_back(std::move(mode));
  }
}

}  // namespace

Expected<RunUpIdentification> identify_run_ups(std::span<const DecayRecord> records,
                                               const RunUpOptions& options) {
  if (records.empty()) return data_error("no record; give one of a run-up");
  RunUpIdentification out;
  out.from_hz = std::numeric_limits<double>::infinity();
  std::vector<std::pair<const DecayRecord*, Sweep>> sweeps;
  for (const DecayRecord& r : records) {
    if (r.turns.size() != r.t_s.size() || r.value.size() != r.t_s.size() || r.t_s.empty())
      return data_error(r.name +
                        ": the angle of the spindle is unknown; record spindle.angle_rad or its "
                        "counts with the run-up");
    const auto period_s = regular_period(r);
    if (!period_s) return period_s.error();
    for (Sweep& s : sweeps_of(r, *period_s)) sweeps.emplace_back(&r, std::move(s));
  }
  out.sweeps = sweeps.size();
  const std::string& first = records.front().name;
  if (sweeps.empty())
    return data_error(first + ": the speed rises or falls nowhere by a tenth within " +
                      std::to_string(kLeastSweepTurns) +
                      " turns or more; record a run-up or run-down, the slower the better");
  std::vector<CrossingFound> all;
  for (std::size_t i = 0; i < sweeps.size(); ++i) {
    if (options.progress)
      options.progress(static_cast<double>(i) / static_cast<double>(sweeps.size()));
    for (CrossingFound& x :
         crossings_of(sweeps[i].second, i, sweeps[i].first->name, options, out.from_hz, out.to_hz))
      all.push_back(std::move(x));
  }
  if (!(out.from_hz < out.to_hz))
    return data_error(first + ": no order of the rotation sweeps the band that is sought");
  find_shadows(all);
  group(all, out);
  if (out.modes.empty()) {
    std::string why = "no mode answers";
    for (const CrossingFound& x : all)
      if (x.reason.starts_with("the sweep crosses it"))
        why = "something answers at " + short_number(x.crossing.natural_frequency_hz.value) +
              " Hz, but " + x.reason;
    return data_error(first + ": the orders of the rotation sweep from " +
                      short_number(out.from_hz) + " to " + short_number(out.to_hz) + " Hz, and " +
                      why +
                      "; take a column nearer to the tool (an accelerometer), a slower or wider "
                      "sweep, or 'identify impact'");
  }
  std::sort(out.modes.begin(), out.modes.end(), [](const RunUpMode& l, const RunUpMode& r) {
    return l.natural_frequency_hz.value < r.natural_frequency_hz.value;
  });
  return out;
}

}  // namespace servosense
