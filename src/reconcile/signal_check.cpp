#include "reconcile/signal_check.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "servosense/core/units.hpp"
#include "servosense/dsp/quantile.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
std::vector<Held> held_values(const Column& values) {
  std::vector<Held> all;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) continue;
    if (!all.empty() && values[i] == all.back().value && all.back().first + all.back().samples == i)
      ++all.back().samples;
    else
      all.push_back({values[i], i, 1});
  }
  return all;
}

namespace {

constexpr std::size_t kReach = 4;         // neighbours on either side
constexpr std::size_t kScaleOver = 128;   // values before and behind, and as many again
constexpr std::size_t kLongestStray = 4;  // samples: an update that is held
constexpr int kStrayRounds = 3;           // a stray beside a stray shows when that is gone

/// Rms of all, the largest hundredths counted as the rest's largest.
double usual_rms(Column v) {
  for (double& x : v) x = std::abs(x);
  const double most = quantile(v, 0.99);
  double square = 0;
  for (const double x : v) square += std::min(x, most) * std::min(x, most);
  return std::sqrt(square / static_cast<double>(std::max<std::size_t>(1, v.size())));
}

double middle_of_three(double a, double b, double c) {
  return std::max(std::min(a, b), std::min(std::max(a, b), c));
}

/// How far a value is from what supports it best, and how far its neighbours spread.
struct Departure {
  double from = 0, spread = 0;
};
Departure departure(const std::vector<Held>& all, std::size_t i) {
  std::array<double, kReach> between, off;
  for (std::size_t k = 0; k < kReach; ++k) {
    // A value is that of the instant at which it came: strays that are gone leave holes.
    const Held &a = all[i - k - 1], &b = all[i + k + 1];
    const auto part =
        static_cast<double>(all[i].first - a.first) / static_cast<double>(b.first - a.first);
    between[k] = a.value + part * (b.value - a.value);
  }
  std::sort(between.begin(), between.end());
  const double both = 0.5 * (between[1] + between[2]);
  for (std::size_t k = 0; k < kReach; ++k) off[k] = std::abs(between[k] - both);
  std::sort(off.begin(), off.end());
  const double before = middle_of_three(all[i - 1].value, all[i - 2].value, all[i - 3].value);
  const double behind = middle_of_three(all[i + 1].value, all[i + 2].value, all[i + 3].value);
  // Beside a step, a counter that wraps or a hole, a motion goes on from one side alone.
  const auto onward = [&](const Held& near, const Held& far) {
    const auto per = (near.value - far.value) /
                     (static_cast<double>(near.first) - static_cast<double>(far.first));
    return near.value + per * (static_cast<double>(all[i].first) - static_cast<double>(near.first));
  };
  double from = std::numeric_limits<double>::infinity();
  for (const double support :
       {both, before, behind, onward(all[i - 1], all[i - 3]), onward(all[i + 1], all[i + 3])})
    from = std::min(from, std::abs(all[i].value - support));
  return {from, off[2]};
}

/// Marks strays among values that are no strays yet; how many.
std::size_t mark_strays(std::vector<Held>& values, double size, double longest, bool first,
                        const Criteria& criteria) {
  std::vector<std::size_t> at;
  std::vector<Held> sound;
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!values[i].stray) {
      at.push_back(i);
      sound.push_back(values[i]);
    }
  const std::size_t n = sound.size();
  if (n <= 2 * kReach) return 0;
  std::vector<Departure> departures(n);
  Column from(n, 0);
  for (std::size_t i = kReach; i + kReach < n; ++i) {
    departures[i] = departure(sound, i);
    from[i] = departures[i].from;
  }
  // A quiet stretch is no yardstick for all: noise goes with the motion.
  const double least = 0.25 * median(from);
  std::size_t found = 0;
  for (std::size_t block = 0; block < n; block += kScaleOver) {
    const auto begin = from.begin() + static_cast<long>(block - std::min(block, kScaleOver));
    const auto end = from.begin() + static_cast<long>(std::min(n, block + 2 * kScaleOver));
    const double scale = std::max(least, median(Column(begin, end)));
    for (std::size_t i = block; i < std::min(n, block + kScaleOver); ++i) {
      const Departure& d = departures[i];
      const auto samples = static_cast<double>(sound[i].samples);
      if (!(d.from > criteria.stray_scales * scale && d.from > criteria.stray_spreads * d.spread &&
            d.from > criteria.stray_size * size) ||
          samples > longest)
        continue;
      values[at[i]].stray = true;
      if (first) values[at[i]].weight = d.from * samples;
      ++found;
    }
  }
  return found;
}

std::vector<Held> marked(const Column& values, double size, const Criteria& criteria) {
  std::vector<Held> held = held_values(values);
  Column lengths;
  for (const Held& h : held) lengths.push_back(static_cast<double>(h.samples));
  const double longest = std::max(static_cast<double>(kLongestStray), 2 * median(lengths));
  for (int round = 0; size > 0 && round < kStrayRounds; ++round)
    if (mark_strays(held, size, longest, round == 0, criteria) == 0) break;
  std::erase_if(held, [](const Held& h) { return !h.stray; });
  return held;
}

/// The samples of strays, where together they matter.
std::vector<std::size_t> samples_of(const std::vector<Held>& strays, double size, std::size_t of,
                                    const Criteria& criteria) {
  double weight = 0;
  for (const Held& h : strays) weight += h.weight;
  std::vector<std::size_t> samples;
  if (!(weight > criteria.least_gain_in_effort * size * static_cast<double>(of))) return samples;
  for (const Held& h : strays)
    for (std::size_t k = 0; k < h.samples; ++k) samples.push_back(h.first + k);
  return samples;
}

std::string percent(std::size_t part, std::size_t of) {
  return printed(100 * static_cast<double>(part) / static_cast<double>(of), 2) + " %";
}

}  // namespace

std::vector<std::size_t> stray_forces(const Column& force_N, const Column& angle_rad,
                                      const Criteria& criteria) {
  constexpr std::size_t kTurns = 24;  // samples at the same angle, before and behind
  const double size = size_of_effort(force_N);
  std::vector<Held> strays = marked(force_N, size, criteria);
  if (samples_of(strays, size, force_N.size(), criteria).empty()) return {};
  std::vector<std::pair<double, std::size_t>> by_angle;
  for (std::size_t i = 0; i < force_N.size(); ++i) {
    const double turns = angle_rad[i] / kTwoPi;
    if (std::isfinite(turns) && std::isfinite(force_N[i]))
      by_angle.emplace_back(turns - std::floor(turns), i);
  }
  std::sort(by_angle.begin(), by_angle.end());
  std::vector<bool> alone(force_N.size(), false);
  for (std::size_t k = 0; k < by_angle.size(); ++k) {
    const std::size_t i = by_angle[k].second;
    Column there;
    for (std::size_t m = k - std::min(k, kTurns); m < std::min(by_angle.size(), k + kTurns); ++m)
      there.push_back(force_N[by_angle[m].second]);
    const double low = quantile(there, 0.1), high = quantile(there, 0.9);
    alone[i] = force_N[i] < low - (high - low) || force_N[i] > high + (high - low);
  }
  std::erase_if(strays, [&](const Held& h) { return !alone[h.first]; });
  return samples_of(strays, size, force_N.size(), criteria);
}

std::vector<std::size_t> cut_off_samples(const Column& force_N, const Column& angle_rad) {
  constexpr std::size_t kAtEnd = 3;  // samples in a row
  constexpr double kMostOften = 2;   // samples that a sound force keeps a value
  const std::vector<Held> held = held_values(force_N);
  Column lengths;
  double low = 0, high = 0;
  for (const Held& h : held) {
    lengths.push_back(static_cast<double>(h.samples));
    low = std::min(low, h.value);
    high = std::max(high, h.value);
  }
  const bool stepped = quantile(std::move(lengths), 0.9) > kMostOften;
  std::vector<std::size_t> at;
  for (const Held& h : held) {
    const bool end = (h.value == low || h.value == high) && h.value != 0;
    const double turned = std::abs(angle_rad[h.first + h.samples - 1] - angle_rad[h.first]);
    if ((!stepped && end && h.samples >= kAtEnd) || (h.samples >= kAtEnd && turned > kPi))
      for (std::size_t k = 0; k < h.samples; ++k) at.push_back(h.first + k);
  }
  return at;
}

double size_of_effort(const Column& values) {
  Column off;
  for (const double x : values)
    if (std::isfinite(x)) off.push_back(x);
  const double middle = median(off);
  for (double& x : off) x -= middle;
  return usual_rms(std::move(off));
}

double size_of_motion(const Column& values) {
  Column steps;
  for (std::size_t i = 1; i < values.size(); ++i)
    if (std::isfinite(values[i] - values[i - 1])) steps.push_back(values[i] - values[i - 1]);
  return usual_rms(std::move(steps));
}

std::vector<std::size_t> stray_samples(const Column& values, double size,
                                       const Criteria& criteria) {
  return samples_of(marked(values, size, criteria), size, values.size(), criteria);
}

Expected<std::vector<BadSignal>> leave_out(const std::string& column, const char* fault,
                                           const char* check, const Column& time_s,
                                           const std::vector<std::size_t>& samples,
                                           const Criteria& criteria) {
  std::vector<BadSignal> found;
  if (samples.empty()) return found;
  const double share = static_cast<double>(samples.size()) / static_cast<double>(time_s.size());
  const double from = time_s[samples.front()], to = time_s[samples.back()];
  if (share > criteria.most_left_out)
    return data_error(column + ": " + percent(samples.size(), time_s.size()) +
                      " of the samples, from " + printed(from) + " s to " + printed(to) + " s, " +
                      fault + ", too many to be left out; check " + check + ", and record again");
  found.push_back({column, fault, share, from, to});
  return found;
}

std::vector<std::size_t> stuck_samples(const Column& motion, const Criteria& criteria) {
  constexpr std::size_t kShortest = 3;  // samples
  constexpr double kUsual = 0.97;
  const std::vector<Held> held = held_values(motion);
  Column changes;
  for (std::size_t i = 2; i < motion.size(); ++i) {
    const double change = motion[i] - 2 * motion[i - 1] + motion[i - 2];
    if (std::isfinite(change)) changes.push_back(std::abs(change));
  }
  const double least = criteria.stuck_speed * quantile(changes, kUsual);
  std::vector<std::size_t> stuck;
  for (std::size_t i = 2; i + 2 < held.size(); ++i) {
    const Held& h = held[i];
    const auto next = [&](const Held& a, const Held& b) { return a.first + a.samples == b.first; };
    // At speed before, and at speed again after whatever it has to catch up.
    if (h.samples < kShortest || held[i - 1].samples > 1 || held[i + 1].samples > 1 ||
        !next(held[i - 2], held[i - 1]) || !next(held[i - 1], h) || !next(h, held[i + 1]) ||
        !next(held[i + 1], held[i + 2]))
      continue;
    const double before = h.value - held[i - 1].value;
    const double behind = held[i + 2].value - held[i + 1].value;
    if (std::min(std::abs(before), std::abs(behind)) > least)
      for (std::size_t k = 1; k < h.samples; ++k) stuck.push_back(h.first + k);
  }
  return stuck;
}

}  // namespace servosense::reconcile
