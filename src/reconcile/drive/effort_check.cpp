#include "reconcile/drive/effort_check.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "dsp/dense.hpp"
#include "reconcile/drive/raw_columns.hpp"
#include "reconcile/signal_check.hpp"
#include "servosense/dsp/quantile.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kWindow_s = 0.01;  // of the slopes
constexpr double kLongestLag_s = 0.1;

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

Expectation expectation(const DriveData& data, const Criteria& criteria) {
  Expectation e;
  e.period_s = data.sample_period_s;
  e.half = std::max<std::size_t>(1, static_cast<std::size_t>(kWindow_s / e.period_s));
  const Column position = raw_position(data);
  e.effort = smoothed(smoothed(raw_effort(data), e.half), e.half);
  e.speed = slope(position, e.half, e.period_s);
  const Column acceleration = slope(e.speed, e.half, e.period_s);
  Column speeds;
  for (const double v : e.speed) speeds.push_back(std::abs(v));
  const double slow = criteria.slow_speed * quantile(std::move(speeds), 0.99);
  for (std::size_t i = 0; i < position.size(); ++i) {
    const double v = e.speed[i];
    const double sign = slow > 0 ? std::clamp(v / slow, -1.0, 1.0) : 0;
    e.wanted.push_back(data.model.inertia * acceleration[i] + data.model.viscous * v +
                       data.model.coulomb * sign);
    e.moving.push_back(std::abs(v) > slow && !has(data.samples[i].quality, kUnusable));
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
  const Eigen::Vector4d c = dense::solve_symmetric(scaled + 1e-9 * Eigen::Matrix4d::Identity(), b);
  return all > 0 ? (c.dot(b) - sum * sum / n) / all : 0;
}

/// Samples in which the effort stays what it was while the motion asks for another.
std::vector<std::size_t> held_against_motion(const Expectation& e, const DriveData& data,
                                             const Criteria& criteria) {
  const std::vector<Held> held = held_values(raw_effort(data));
  // Of the update that a sample is in, not of all updates: slow ones count by what they last.
  Column lengths;
  for (const Held& h : held)
    lengths.insert(lengths.end(), h.samples, static_cast<double>(h.samples));
  const double longest = std::max(3 * static_cast<double>(e.half),
                                  criteria.held_updates * quantile(std::move(lengths), 0.25));
  Column wanted;
  for (std::size_t i = 0; i < e.wanted.size(); ++i)
    if (e.moving[i]) wanted.push_back(e.wanted[i]);
  const double range = quantile(wanted, 0.95) - quantile(wanted, 0.05);
  std::vector<std::size_t> at;
  for (const Held& h : held) {
    if (static_cast<double>(h.samples) <= longest) continue;
    const auto from = e.wanted.begin() + static_cast<long>(h.first);
    const auto [low, high] = std::minmax_element(from, from + static_cast<long>(h.samples));
    if (!(*high - *low > criteria.held_effort * range)) continue;
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

Expected<Done> check_effort(const std::string& column, DriveData& data, const Criteria& criteria) {
  const Expectation e = expectation(data, criteria);
  double ways = 0, forward = 0, negative = 0;
  for (std::size_t i = 0; i < e.effort.size(); ++i) {
    if (!e.moving[i]) continue;
    ++ways;
    forward += e.speed[i] > 0 ? 1 : 0;
    negative += e.effort[i] < 0 ? 1 : 0;
  }
  // What turns one way, or hardly, is refused for that.
  if (!(forward > criteria.least_each_way * ways && forward < (1 - criteria.least_each_way) * ways))
    return Done{};
  const double size = size_of_effort(raw_effort(data));
  if (!(size > 0)) return Done{};  // the fit says that it does not accelerate the drive

  Column time_s;
  for (std::size_t i = 0; i < data.samples.size(); ++i)
    time_s.push_back(data.start_s + static_cast<double>(i) * data.sample_period_s);
  const std::vector<std::size_t> held = held_against_motion(e, data, criteria);
  auto left_out = leave_out(column, "keep one value while the drive speeds up or slows down",
                            "the sensor, its cable and the update rate of the recorder", time_s,
                            held, criteria);
  if (!left_out) return left_out.error();
  for (const std::size_t i : held) data.samples[i].quality |= Quality::invalid;
  data.bad_signals.insert(data.bad_signals.end(), left_out->begin(), left_out->end());

  if (const double step = coarse_step(data); step > criteria.coarsest_effort * size)
    return data_error(column + ": comes in steps of " + printed(step) + ", the effort is " +
                      printed(size) +
                      " rms, so little can be told from it; record it with a finer resolution");

  Column without_sign = e.wanted;
  for (double& w : without_sign) w = std::abs(w);
  const double alike = correlation(e, e.wanted, 0);
  const bool one_sign = negative < 0.01 * ways || negative > 0.99 * ways;
  if (one_sign && std::abs(alike) < criteria.effort_unlike &&
      std::abs(correlation(e, without_sign, 0)) > criteria.effort_alike)
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
  if (best > criteria.effort_same &&
      std::abs(late_s) > std::max(criteria.latest_effort_s, 2 * e.period_s))
    return data_error(column + ": comes " + printed(1000 * std::abs(late_s), 2) + " ms " +
                      (late > 0 ? "behind" : "ahead of") +
                      " the motion, more than any servo loop; record both in one device, with one "
                      "clock and without a filter for display");
  if (best < criteria.effort_unlike && explained(e) < criteria.effort_explained)
    return data_error(column +
                      ": does not go with the motion: inertia, friction and a load of any size "
                      "explain " +
                      printed(100 * std::max(0.0, explained(e)), 2) +
                      " % of it; check that both columns are of the same drive and the same run, "
                      "and that nothing is cut");
  return Done{};
}

}  // namespace servosense::reconcile
