#include "reconcile/drive/signal_check.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "reconcile/report/machine_file.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kFar = 12;       // scales: Gaussian noise never comes there
constexpr double kBeyond = 4;     // spreads of the neighbours: a swing stays within one
constexpr double kMatters = 0.1;  // of the size: less is the spike of a count at the loop's gain
/// Of the size, the mean of all strays: as much as is worth a name (Options::least_gain_in_effort).
/// 80 sound drives of two generators stay below 0.0016, those that hit their flanks the most.
constexpr double kWorthSaying = 0.0025;
/// Of the samples. With more, one in five of those that stand in for a stray has one beside it.
constexpr double kMostLeftOut = 0.05;
constexpr std::size_t kReach = 4;         // neighbours on either side
constexpr std::size_t kScaleOver = 128;   // values before and behind, and as many again
constexpr std::size_t kLongestStray = 4;  // samples: an update that is held
constexpr int kStrayRounds = 3;           // a stray beside a stray shows when that is gone

double median(Column v) {
  if (v.empty()) return 0;
  const auto middle = v.begin() + static_cast<long>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}
double quantile(Column v, double share) {
  if (v.empty()) return 0;
  const auto at = v.begin() + static_cast<long>(share * static_cast<double>(v.size() - 1));
  std::nth_element(v.begin(), at, v.end());
  return *at;
}

/// Rms of all, the largest hundredths counted as the rest's largest.
double usual_rms(Column v) {
  for (double& x : v) x = std::abs(x);
  const double most = quantile(v, 0.99);
  double square = 0;
  for (const double x : v) square += std::min(x, most) * std::min(x, most);
  return std::sqrt(square / static_cast<double>(std::max<std::size_t>(1, v.size())));
}

/// A value that a column keeps for some samples: of slow updates, or of counts.
struct Held {
  double value;
  std::size_t first, samples;
  bool stray = false;
  double weight = 0;  // of a stray that shows at once: how far it is, times its samples
};

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
std::size_t mark_strays(std::vector<Held>& values, double size, double longest, bool first) {
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
      if (!(d.from > kFar * scale && d.from > kBeyond * d.spread && d.from > kMatters * size) ||
          samples > longest)
        continue;
      values[at[i]].stray = true;
      if (first) values[at[i]].weight = d.from * samples;
      ++found;
    }
  }
  return found;
}

std::vector<Held> marked(const Column& values, double size) {
  std::vector<Held> held = held_values(values);
  Column lengths;
  for (const Held& h : held) lengths.push_back(static_cast<double>(h.samples));
  const double longest = std::max(static_cast<double>(kLongestStray), 2 * median(lengths));
  for (int round = 0; size > 0 && round < kStrayRounds; ++round)
    if (mark_strays(held, size, longest, round == 0) == 0) break;
  std::erase_if(held, [](const Held& h) { return !h.stray; });
  return held;
}

/// The samples of strays, where together they matter.
std::vector<std::size_t> samples_of(const std::vector<Held>& strays, double size, std::size_t of) {
  double weight = 0;
  for (const Held& h : strays) weight += h.weight;
  std::vector<std::size_t> samples;
  if (!(weight > kWorthSaying * size * static_cast<double>(of))) return samples;
  for (const Held& h : strays)
    for (std::size_t k = 0; k < h.samples; ++k) samples.push_back(h.first + k);
  return samples;
}

std::string percent(std::size_t part, std::size_t of) {
  return printed(100 * static_cast<double>(part) / static_cast<double>(of), 2) + " %";
}

}  // namespace

std::vector<std::size_t> stray_forces(const Column& force_N, const Column& angle_rad) {
  constexpr std::size_t kTurns = 24;  // samples at the same angle, before and behind
  const double size = size_of_effort(force_N);
  std::vector<Held> strays = marked(force_N, size);
  if (samples_of(strays, size, force_N.size()).empty()) return {};
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
  return samples_of(strays, size, force_N.size());
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

std::vector<std::size_t> stray_samples(const Column& values, double size) {
  return samples_of(marked(values, size), size, values.size());
}

Expected<std::vector<BadSignal>> leave_out(const std::string& column, const char* fault,
                                           const char* check, const Column& time_s,
                                           const std::vector<std::size_t>& samples) {
  std::vector<BadSignal> found;
  if (samples.empty()) return found;
  const double share = static_cast<double>(samples.size()) / static_cast<double>(time_s.size());
  const double from = time_s[samples.front()], to = time_s[samples.back()];
  if (share > kMostLeftOut)
    return data_error(column + ": " + percent(samples.size(), time_s.size()) +
                      " of the samples, from " + printed(from) + " s to " + printed(to) + " s, " +
                      fault + ", too many to be left out; check " + check + ", and record again");
  found.push_back({column, fault, share, from, to});
  return found;
}

std::vector<std::size_t> stuck_samples(const Column& motion) {
  constexpr std::size_t kShortest = 3;  // samples
  constexpr double kBeyondUsual = 4;    // of the largest hundredths of all changes of speed
  constexpr double kUsual = 0.97;
  const std::vector<Held> held = held_values(motion);
  Column changes;
  for (std::size_t i = 2; i < motion.size(); ++i) {
    const double change = motion[i] - 2 * motion[i - 1] + motion[i - 2];
    if (std::isfinite(change)) changes.push_back(std::abs(change));
  }
  const double least = kBeyondUsual * quantile(changes, kUsual);
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

namespace {

constexpr double kWindow_s = 0.01;  // of the slopes
constexpr double kLongestLag_s = 0.1;
/// No servo loop is later: two recorders, or a filter of the display.
constexpr double kLatest_s = 0.02;
constexpr double kSlow = 0.01;      // of the top speed: below friction is anywhere
constexpr double kLeastWay = 0.02;  // of the motion, each way

/// What the machine file expects of the effort along the motion, and the effort, both smoothed
/// alike.
struct Expectation {
  Column effort, wanted, speed;
  std::vector<bool> moving;
  std::size_t half = 1;  // of the window
  double period_s = 0;
};

Column smoothed(const Column& x, std::size_t half) {
  Column sum(x.size() + 1, 0), out(x.size(), 0);
  for (std::size_t i = 0; i < x.size(); ++i) sum[i + 1] = sum[i] + x[i];
  for (std::size_t i = 0; i < x.size(); ++i) {
    const std::size_t from = i - std::min(i, half), to = std::min(x.size(), i + half + 1);
    out[i] = (sum[to] - sum[from]) / static_cast<double>(to - from);
  }
  return out;
}

Column slope(const Column& x, std::size_t half, double period_s) {
  Column out(x.size(), 0);
  for (std::size_t i = half; i + half < x.size(); ++i)
    out[i] = (x[i + half] - x[i - half]) / (2 * static_cast<double>(half) * period_s);
  return out;
}

Expectation expectation(const DriveData& data) {
  Expectation e;
  e.period_s = data.sample_period_s;
  e.half = std::max<std::size_t>(1, static_cast<std::size_t>(kWindow_s / e.period_s));
  Column position, effort;
  double at = 0;
  for (const auto& s : data.samples) {
    position.push_back(at += s.increment);
    effort.push_back(s.effort);
  }
  e.effort = smoothed(smoothed(effort, e.half), e.half);
  e.speed = slope(position, e.half, e.period_s);
  const Column acceleration = slope(e.speed, e.half, e.period_s);
  Column speeds;
  for (const double v : e.speed) speeds.push_back(std::abs(v));
  const double slow = kSlow * quantile(std::move(speeds), 0.99);
  for (std::size_t i = 0; i < position.size(); ++i) {
    const double v = e.speed[i];
    const double sign = slow > 0 ? std::clamp(v / slow, -1.0, 1.0) : 0;
    e.wanted.push_back(data.model.inertia * acceleration[i] + data.model.viscous * v +
                       data.model.coulomb * sign);
    e.moving.push_back(std::abs(v) > slow);
  }
  return e;
}

/// Correlation of the effort with `other`, as it was `late` samples before, in motion.
double correlation(const Expectation& e, const Column& other, long late) {
  double n = 0, x = 0, y = 0, xx = 0, yy = 0, xy = 0;
  const auto size = static_cast<long>(e.effort.size());
  for (long i = std::max(0L, late); i < std::min(size, size + late); ++i) {
    const auto at = static_cast<std::size_t>(i - late);
    if (!e.moving[at]) continue;
    const double a = e.effort[static_cast<std::size_t>(i)], b = other[at];
    ++n, x += a, y += b, xx += a * a, yy += b * b, xy += a * b;
  }
  const double power = (xx - x * x / n) * (yy - y * y / n);
  return power > 0 ? (xy - x * y / n) / std::sqrt(power) : 0;
}

/// Share of the effort's variance that inertia, friction and a load of any size explain.
double explained(const Expectation& e) {
  Eigen::Matrix4d gram = Eigen::Matrix4d::Zero();
  Eigen::Vector4d right = Eigen::Vector4d::Zero();
  double n = 0, sum = 0, square = 0;
  for (std::size_t i = 0; i < e.effort.size(); ++i) {
    if (!e.moving[i]) continue;
    const double way = e.speed[i] < 0 ? -1 : 1;
    const Eigen::Vector4d row(1, e.wanted[i], e.speed[i], way);
    gram += row * row.transpose();
    right += e.effort[i] * row;
    ++n, sum += e.effort[i], square += e.effort[i] * e.effort[i];
  }
  const double all = square - sum * sum / n;
  const Eigen::Vector4d scale = gram.diagonal().cwiseSqrt().cwiseMax(1e-300);
  const Eigen::Matrix4d scaled =
      scale.cwiseInverse().asDiagonal() * gram * scale.cwiseInverse().asDiagonal();
  const Eigen::Vector4d b = right.cwiseQuotient(scale);
  const Eigen::Vector4d c = (scaled + 1e-9 * Eigen::Matrix4d::Identity()).ldlt().solve(b);
  return all > 0 ? (c.dot(b) - sum * sum / n) / all : 0;
}

/// Samples in which the effort stays what it was while the motion asks for another.
std::vector<std::size_t> held_against_motion(const Expectation& e, const DriveData& data) {
  constexpr double kAsksForAnother = 0.5;  // of the range that the motion asks for
  constexpr double kBeyondUsual = 10;      // of updates
  Column effort;
  for (const auto& s : data.samples) effort.push_back(s.effort);
  const std::vector<Held> held = held_values(effort);
  // Of the update that a sample is in, not of all updates: slow ones count by what they last.
  Column lengths;
  for (const Held& h : held)
    lengths.insert(lengths.end(), h.samples, static_cast<double>(h.samples));
  const double longest =
      std::max(3 * static_cast<double>(e.half), kBeyondUsual * quantile(std::move(lengths), 0.25));
  Column wanted;
  for (std::size_t i = 0; i < e.wanted.size(); ++i)
    if (e.moving[i]) wanted.push_back(e.wanted[i]);
  const double range = quantile(wanted, 0.95) - quantile(wanted, 0.05);
  std::vector<std::size_t> at;
  for (const Held& h : held) {
    if (static_cast<double>(h.samples) <= longest) continue;
    const auto from = e.wanted.begin() + static_cast<long>(h.first);
    const auto [low, high] = std::minmax_element(from, from + static_cast<long>(h.samples));
    if (!(*high - *low > kAsksForAnother * range)) continue;
    for (std::size_t k = 1; k < h.samples; ++k)
      if (!has(data.samples[h.first + k].quality, kUnusable | Quality::saturated))
        at.push_back(h.first + k);
  }
  return at;
}

/// Whole steps of an effort where its noise does not blur them; 0 where it does.
double coarse_step(const DriveData& data) {
  constexpr std::size_t kMostLevels = 200;
  constexpr double kMostlyAlike = 0.5;
  Column levels;
  double alike = 0;
  for (std::size_t i = 0; i < data.samples.size(); ++i) {
    const double u = data.samples[i].effort;
    if (i > 0 && u == data.samples[i - 1].effort) ++alike;
    const auto place = std::lower_bound(levels.begin(), levels.end(), u);
    if (place != levels.end() && *place == u) continue;
    if (levels.size() == kMostLevels) return 0;
    levels.insert(place, u);
  }
  if (alike < kMostlyAlike * static_cast<double>(data.samples.size())) return 0;
  Column gaps;
  for (std::size_t i = 1; i < levels.size(); ++i) gaps.push_back(levels[i] - levels[i - 1]);
  return median(gaps);
}

}  // namespace

Expected<Done> check_effort(const std::string& column, DriveData& data) {
  constexpr double kLeastExplainedByRates = 0.2;  // of the variance
  constexpr double kUnlike = 0.5, kAlike = 0.7, kSame = 0.9;
  constexpr double kCoarsest = 0.25;  // of the effort's size
  const Expectation e = expectation(data);
  double ways = 0, forward = 0, negative = 0;
  Column efforts;
  for (std::size_t i = 0; i < e.effort.size(); ++i) {
    efforts.push_back(data.samples[i].effort);
    if (!e.moving[i]) continue;
    ++ways;
    forward += e.speed[i] > 0 ? 1 : 0;
    negative += e.effort[i] < 0 ? 1 : 0;
  }
  // What turns one way, or hardly, is refused for that.
  if (!(forward > kLeastWay * ways && forward < (1 - kLeastWay) * ways)) return Done{};
  const double size = size_of_effort(efforts);
  if (!(size > 0)) return Done{};  // the fit says that it does not accelerate the drive

  Column time_s;
  for (std::size_t i = 0; i < data.samples.size(); ++i)
    time_s.push_back(data.start_s + static_cast<double>(i) * data.sample_period_s);
  const std::vector<std::size_t> held = held_against_motion(e, data);
  auto left_out =
      leave_out(column, "keep one value while the drive speeds up or slows down",
                "the sensor, its cable and the update rate of the recorder", time_s, held);
  if (!left_out) return left_out.error();
  for (const std::size_t i : held) data.samples[i].quality |= Quality::invalid;
  data.bad_signals.insert(data.bad_signals.end(), left_out->begin(), left_out->end());

  if (const double step = coarse_step(data); step > kCoarsest * size)
    return data_error(column + ": comes in steps of " + printed(step) + ", the effort is " +
                      printed(size) +
                      " rms, so little can be told from it; record it with a finer resolution");

  Column without_sign = e.wanted;
  for (double& w : without_sign) w = std::abs(w);
  const double alike = correlation(e, e.wanted, 0);
  const bool one_sign = negative < 0.01 * ways || negative > 0.99 * ways;
  if (one_sign && std::abs(alike) < kUnlike && std::abs(correlation(e, without_sign, 0)) > kAlike)
    return data_error(column +
                      ": has lost its sign: it has the same one whichever way the drive pushes; "
                      "record the current with its sign (of the torque-producing component, not "
                      "of the amount)");

  const auto farthest = static_cast<long>(kLongestLag_s / e.period_s);
  const long stride = std::max(1L, farthest / 50);
  long late = 0;
  double best = alike;
  for (long k = -farthest; k <= farthest; k += stride)
    if (const double c = correlation(e, e.wanted, k); c > best) {
      best = c;
      late = k;
    }
  const double late_s = static_cast<double>(late) * e.period_s;
  // A pull along the travel looks late too, but never so alike.
  if (best > kSame && std::abs(late_s) > std::max(kLatest_s, 2 * e.period_s))
    return data_error(column + ": comes " + printed(1000 * std::abs(late_s), 2) + " ms " +
                      (late > 0 ? "behind" : "ahead of") +
                      " the motion, more than any servo loop; record both in one device, with one "
                      "clock and without a filter for display");
  if (best < kUnlike && explained(e) < kLeastExplainedByRates)
    return data_error(column +
                      ": does not go with the motion: inertia, friction and a load of any size "
                      "explain " +
                      printed(100 * std::max(0.0, explained(e)), 2) +
                      " % of it; check that both columns are of the same drive and the same run, "
                      "and that nothing is cut");
  return Done{};
}

}  // namespace servosense::reconcile
