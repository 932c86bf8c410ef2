#include "servosense/identify/presliding.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "idle_regression.hpp"
#include "presliding_pushes.hpp"
#include "servosense/dsp/golden_section.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

using idle_fit::Column;
using idle_fit::regress;
using idle_fit::Regression;
using presliding::kReversal;
using presliding::Points;
using presliding::points_of;
using presliding::Push;
using presliding::Pushed;
using presliding::pushes_of;
using presliding::read_pushed;

// Limits, each with its kind.
constexpr double kLeastEdges = 4;      // physical: two give the slope, two its curvature
constexpr double kMostNoise = 0.02;    // chosen: of the range, after smoothing: below a reversal
constexpr double kMostAgainst = 0.2;   // chosen: share of pushes whose motion runs against them
constexpr double kLastEffort = 0.05;   // of the largest effort...
constexpr double kMostAtTheEnd = 0.4;  // physical: ...moves a bristle at 0.995 of breakaway by that
constexpr double kMostResidual = 0.1;  // chosen: of the effort, that one bristle may leave
constexpr double kMostYield = 0.995;   // numerical: largest effort over breakaway that is tried
constexpr double kLeastYield = 0.02;   // numerical: below it the loop is a line
constexpr double kFineBend = 1e-6;     // numerical
constexpr double kLeastEvidence = 3;   // standard errors from nothing to a breakaway
constexpr double kMostInertia = 0.01;  // chosen: effort of the inertia over that of the spring
constexpr double kCountsInKnee = 4;    // model/elastoplastic_sign.hpp
constexpr double kMostOfACount = 0.25;  // chosen: of the breakaway, by a count at a reversal

double dot(const Column& a, const Column& b, std::size_t from = 0) {
  double sum = 0;
  for (std::size_t i = from; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

/// Efforts by a bristle with `bend` = stiffness over breakaway [1/m or 1/rad]:
///   F = d F_b - A exp(-bend d x)
/// A is each push's own; it is taken out, so that what is left of every column is orthogonal to its
/// exponential.
struct Bristle {
  Column effort, sense;
  Column by_bend;  // A d x exp(-bend d x), with the A of `breakaway`
  double breakaway = 0;

  /// With the breakaway that fits best, or with a `given` one.
  Bristle(const std::vector<Points>& pushes, double bend, std::optional<double> given = {}) {
    Column exponential, drawn;
    for (const Points& push : pushes) {
      const std::size_t from = effort.size();
      const double middle = (push.motion.front() + push.motion.back()) / 2;
      for (std::size_t i = 0; i < push.motion.size(); ++i) {
        const double travel = push.sense * (push.motion[i] - middle);
        exponential.push_back(std::exp(-bend * travel));
        drawn.push_back(travel * exponential.back());
        effort.push_back(push.effort[i]);
        sense.push_back(push.sense);
      }
      for (Column* column : {&effort, &sense, &drawn}) take_out(exponential, *column, from);
      firsts_.push_back(from);
    }
    breakaway = given ? *given : dot(sense, effort) / dot(sense, sense);
    by_bend = drawn;
    // A of each push, from what was taken out of effort and sense.
    for (std::size_t p = 0; p < firsts_.size(); ++p) {
      const double a = breakaway * taken_[3 * p + 1] - taken_[3 * p];
      const std::size_t end = p + 1 < firsts_.size() ? firsts_[p + 1] : by_bend.size();
      for (std::size_t i = firsts_[p]; i < end; ++i) by_bend[i] *= a;
    }
  }
  /// Sum of squares that it leaves of the effort.
  [[nodiscard]] double left() const {
    double sum = 0;
    for (std::size_t i = 0; i < effort.size(); ++i) {
      const double rest = effort[i] - breakaway * sense[i];
      sum += rest * rest;
    }
    return sum;
  }

 private:
  void take_out(const Column& exponential, Column& column, std::size_t from) {
    const double share = dot(exponential, column, from) / dot(exponential, exponential, from);
    for (std::size_t i = from; i < column.size(); ++i) column[i] -= share * exponential[i];
    taken_.push_back(share);
  }
  std::vector<std::size_t> firsts_;
  Column taken_;  // of effort, sense and drawn of each push
};

struct PreslidingFit {
  Estimate stiffness, breakaway;
  double residual_share = 0;
};

/// `breakaway` where it is given.
PreslidingFit fit_bristle(const std::vector<Points>& pushes, double travel,
                          std::optional<double> breakaway) {
  const auto bent = [](double yield) { return std::log((1 + yield) / (1 - yield)); };
  const double bend =
      lowest_between([&](double at) { return Bristle(pushes, at, breakaway).left(); },
                     bent(kLeastYield) / travel, bent(kMostYield) / travel,
                     [](double low, double high) { return high - low < kFineBend * low; });
  const Bristle bristle(pushes, bend, breakaway);
  // Columns of stiffness and breakaway: bend = stiffness / breakaway.
  Column by_stiffness = bristle.by_bend, by_breakaway = bristle.sense, rest = bristle.effort;
  for (std::size_t i = 0; i < rest.size(); ++i) {
    by_stiffness[i] /= bristle.breakaway;
    by_breakaway[i] -= bend * by_stiffness[i];
    rest[i] -= bristle.breakaway * bristle.sense[i];
  }
  idle_fit::Columns columns = {&by_stiffness};
  if (!breakaway) columns.push_back(&by_breakaway);
  const Regression fit = regress(columns, rest, rest.size() / pushes.size());
  const std::size_t taken = pushes.size() + 2;
  const double freedom = std::sqrt(static_cast<double>(rest.size()) /
                                   static_cast<double>(std::max(rest.size(), taken + 1) - taken));
  PreslidingFit found;
  found.stiffness = {bend * bristle.breakaway, freedom * fit.standard_errors(0)};
  found.breakaway = {bristle.breakaway, breakaway ? 0 : freedom * fit.standard_errors(1)};
  // Of what the efforts of each push differ by from their mean.
  double square = 0;
  for (const Points& push : pushes) {
    double mean = 0;
    const auto n = static_cast<double>(push.effort.size());
    for (const double e : push.effort) mean += e / n;
    for (const double e : push.effort) square += (e - mean) * (e - mean);
  }
  found.residual_share = std::sqrt(bristle.left() / square);
  return found;
}

/// What a friction that follows the speed a little, and the inertia, may do: they delay the motion
/// by about the reciprocal of the natural frequency (damping ratio 1/2).
void add_delay_error(PreslidingFit& fit, const PreslidingFit& late) {
  fit.stiffness.standard_error =
      std::hypot(fit.stiffness.standard_error, late.stiffness.value - fit.stiffness.value);
  fit.breakaway.standard_error =
      std::hypot(fit.breakaway.standard_error, late.breakaway.value - fit.breakaway.value);
}

/// Slope of effort over motion through the loop, by least squares over all samples. A count rounds:
/// that is taken off the square of the motion, and stands in the error, once for every edge; beside
/// it what the slope differs by from push to push.
Estimate slope_of(const Pushed& record, const std::vector<Push>& pushes, double grain,
                  std::size_t edges) {
  // Pairs of pushes are whole loops; the first push may have begun half way.
  std::vector<std::array<double, 2>> loops;  // products, squares
  double n = 0;
  for (std::size_t p = pushes.size() > 2 ? 1 : 0; p + 1 < pushes.size(); p += 2) {
    double x = 0, f = 0, xf = 0, xx = 0, k = 0;
    for (std::size_t i = pushes[p].from; i < pushes[p + 1].to; ++i) {
      ++k;
      const double dx = record.position[i] - x, df = record.effort[i] - f;
      x += dx / k;
      f += df / k;
      xx += dx * (record.position[i] - x);
      xf += dx * (record.effort[i] - f);
    }
    n += k;
    loops.push_back({xf, xx - k * grain * grain / 12});
  }
  double products = 0, squares = 0;
  for (const auto& loop : loops) {
    products += loop[0];
    squares += loop[1];
  }
  Estimate slope;
  slope.value = products / squares;
  double moved = 0;
  const auto groups = static_cast<double>(loops.size());
  for (const auto& loop : loops) {
    if (loops.size() < 2) break;
    const double without = (products - loop[0]) / (squares - loop[1]);
    moved += (groups - 1) / groups * (without - slope.value) * (without - slope.value);
  }
  const double rounding = grain * grain / 12 / (squares / n) / static_cast<double>(edges);
  slope.standard_error = std::sqrt(moved + slope.value * slope.value * rounding);
  return slope;
}

/// The smallest change of a reading, where it is not known what a count is.
double smallest_step(const Column& position) {
  double least = 0;
  for (std::size_t i = 1; i < position.size(); ++i) {
    const double step = std::abs(position[i] - position[i - 1]);
    if (step > 0 && (least == 0 || step < least)) least = step;
  }
  return least;
}

}  // namespace

Expected<PreslidingIdentification> identify_presliding(const DisturbanceObserverConfig& base,
                                                       const DriveRecord& record, double grain) {
  const std::string who(name_of(record.channel));
  const bool turns = is_turning(record.channel);
  const char* length = turns ? " rad" : " m";
  const char* unit = turns ? " Nm" : " N";
  const Pushed r = read_pushed(record, base.drive.constant_load);
  if (!(r.range > 0))
    return data_error(who +
                      ": the effort never changes; push the drive slowly up and down, below "
                      "breakaway");
  if (r.noise > kMostNoise * r.range)
    return data_error(who + ": the effort changes by " + printed(r.range, 3) + unit +
                      " beside a noise of " + printed(r.noise, 3) +
                      "; push harder, more slowly, or record its mean");
  const std::vector<Push> pushes = pushes_of(r.effort, kReversal * r.range);
  if (pushes.size() < 2)
    return data_error(who +
                      ": the effort goes one way only; push the drive to and fro, so that "
                      "the loop of friction shows");
  PreslidingIdentification found;
  found.pushes = pushes.size();
  std::size_t edges = 0, most_edges = 0, against = 0;
  double at_the_end = 0, moved = 0;
  for (const Push& push : pushes) {
    std::size_t own = 0;
    for (std::size_t i = push.from + 1; i <= push.to; ++i) {
      const double step = std::abs(r.position[i] - r.position[i - 1]);
      own += step > 0;
      moved += step;
    }
    edges += own;
    most_edges = std::max(most_edges, own);
    const double travel = push.sense * (r.position[push.to] - r.position[push.from]);
    if (travel < 0) ++against;
    found.travel = std::max(found.travel, std::abs(travel));
  }
  for (const double e : r.effort) found.effort = std::max(found.effort, std::abs(e));
  const auto too_coarse = [&] {
    return data_error(who + ": the encoder is too coarse: the drive moves by " +
                      std::to_string(most_edges) + " counts in a push, at least " +
                      printed(kLeastEdges, 3) +
                      " are needed; push closer to breakaway, or record a finer encoder");
  };
  if (static_cast<double>(most_edges) < kLeastEdges) return too_coarse();
  const auto all = static_cast<double>(pushes.size());
  // At the ends of the pushes, where a drive that slides moves most.
  for (const Push& push : pushes)
    for (std::size_t i = push.from + 1; i <= push.to; ++i) {
      if (std::abs(r.effort[i]) > (1 - kLastEffort) * found.effort)
        at_the_end += std::abs(r.position[i] - r.position[i - 1]);
    }
  if (at_the_end > kMostAtTheEnd * moved || !drive_stands(base, record))
    return data_error(who + ": the drive slides: it moves by " + printed(found.travel, 3) + length +
                      " in a push, " + printed(100 * at_the_end / moved, 3) +
                      " % of it at the largest effort (" + printed(found.effort, 3) + unit +
                      "); push it less far, or run 'servosense identify idle' on a record that "
                      "moves");
  if (static_cast<double>(against) > (1 - kMostAgainst) * all)
    return data_error(who +
                      ": the motion runs against the effort; check the sign of the effort "
                      "column");
  if (static_cast<double>(against) > kMostAgainst * all)
    return data_error(who + ": in " + std::to_string(against) + " of " +
                      std::to_string(pushes.size()) +
                      " pushes the motion runs against the effort; the current has lost its sign, "
                      "or something else moves the drive: record the current with its sign");
  const std::vector<Points> points = points_of(r, pushes, 0);
  if (points.empty()) return too_coarse();
  const double count = grain > 0 ? grain : smallest_step(r.position);
  found.slope = slope_of(r, pushes, count, edges);
  const double push_s = record.sample_period_s * static_cast<double>(r.effort.size()) / all;
  const double inertia = base.drive.inertia * std::pow(std::numbers::pi / push_s, 2);
  if (inertia > kMostInertia * found.slope.value)
    return data_error(who + ": it is pushed too fast, its inertia takes " +
                      printed(100 * inertia / found.slope.value, 3) +
                      " % of the effort; push more slowly");

  const double coulomb = base.drive.coulomb;
  const auto fitted = [&](std::optional<double> breakaway) {
    PreslidingFit fit = fit_bristle(points, found.travel, breakaway);
    const double late_s = std::sqrt(base.drive.inertia / std::max(fit.stiffness.value, 1e-300));
    const auto late = points_of(r, pushes, late_s / record.sample_period_s);
    if (base.drive.inertia > 0 && !late.empty())
      add_delay_error(fit, fit_bristle(late, found.travel, breakaway));
    return fit;
  };
  PreslidingFit fit = fitted({});
  found.breakaway_fitted = kLeastEvidence * fit.breakaway.standard_error < fit.breakaway.value;
  if (!found.breakaway_fitted && coulomb > found.effort) {
    fit = fitted(coulomb);
    found.remarks.push_back(who +
                            ": the record does not show how friction yields; its Coulomb "
                            "friction is taken for the breakaway");
  }
  found.stiffness = fit.stiffness;
  found.breakaway = fit.breakaway;
  found.residual_share = fit.residual_share;
  const bool known = found.breakaway_fitted || coulomb > found.effort;
  found.one_bristle = known && found.residual_share < kMostResidual;
  if (known && !found.one_bristle)
    found.remarks.push_back(
        who + ": the loop is not that of one bristle below breakaway, which leaves " +
        printed(100 * found.residual_share, 3) +
        " % of the effort; stiffness after a reversal and breakaway are not told, the slope is");
  if (!known)
    found.remarks.push_back(who +
                            ": effort against motion is a straight line; breakaway is not "
                            "shown: push harder, or give the Coulomb friction");
  found.resolved = found.one_bristle &&
                   2 * count * found.stiffness.value < kMostOfACount * found.breakaway.value;
  if (!found.one_bristle) found.stiffness = found.breakaway = {};
  const double friction = coulomb > 0 ? coulomb : found.breakaway.value;
  if (friction > 0) {
    found.friction_knee = std::max(friction / found.slope.value, kCountsInKnee * count);
    if (friction / found.slope.value < kCountsInKnee * count)
      found.remarks.push_back(who + ": the friction knee would be " +
                              printed(friction / found.slope.value, 3) + length +
                              "; it is kept at four counts, the least that the observer takes");
  }
  found.remarks.push_back(who + ": sliding friction is not shown by a drive that does not slide");
  return found;
}

}  // namespace servosense
