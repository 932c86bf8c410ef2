#include "servosense/identify/torque_path.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "dsp/dense.hpp"
#include "idle_design.hpp"
#include "idle_regression.hpp"
#include "regular_interval.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"
#include "servosense/model/effects/current_loop_lag.hpp"

namespace servosense {
namespace {

using idle_fit::Column;
using idle_fit::Columns;
using idle_fit::regress;
using idle_fit::Regression;

constexpr std::array kCutoffs_rad_s = {250.0, 500.0, 1000.0, 2000.0};
constexpr std::array kStarts_s = {0.0006, 0.003};  // roots of the variance
constexpr double kLongest_s = 0.03;    // root of the variance: slower than any drive's filter
constexpr double kSeen = 3;            // standard errors from no variance to a filter
constexpr double kLeastPeriods = 1.2;  // root of the variance: sampling itself is as wide
constexpr double kBound = 2;           // and from the estimate to what is stated at least
// Below this a bound says nothing: every drive shows as much.
constexpr double kLeast_hz = 5;
// Standard errors: a causal filter of one sign is late by the spread of its response at least, a
// first order lag by just that.
constexpr double kEarly = 3;
// Squares left by the worse shape over those by the better: nearer, they are not told apart.
// Calibrated: where the record cannot tell, friction and springs alone gave up to 1.10 (seeds
// 880001 to 880006), and where it can, 1.3 and more.
constexpr double kToldApart = 1.2;
constexpr int kSteps = 10;
// Rows that are used at most: of long records the beginning is enough.
constexpr std::size_t kMostRows = 60000;
constexpr double kHacLag_s = 0.1;
constexpr double kSlow = 0.05;          // of the highest speed: near a reversal
constexpr double kSpeedOver_s = 0.002;  // half of the stretch that a speed is taken over
constexpr double kMemory = 8;           // time constants of the observer

// Where a first order lag and a moving average leave half.
const double kLagHalf = std::sqrt(3.0);  // times the cutoff
constexpr double kAverageHalf = 0.6034;  // over the stretch: sin(pi x) = pi x / 2

enum class Shape : unsigned char { lag, average };

/// Of straight lines from sample to sample: the mean over `width` samples, `delay` samples late in
/// its middle (either way); of width 0 the value there, by a cubic (Lagrange).
Column mean_of(const Column& x, double width, double delay) {
  const auto n = static_cast<std::ptrdiff_t>(x.size());
  const auto at = [&](std::ptrdiff_t i) {
    return x[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(i, 0, n - 1))];
  };
  Column y(x.size());
  if (width < 1e-6) {
    const double whole = std::floor(-delay), f = -delay - whole;
    const double a = -f * (f - 1) * (f - 2) / 6, b = (f + 1) * (f - 1) * (f - 2) / 2,
                 c = -(f + 1) * f * (f - 2) / 2, d = (f + 1) * f * (f - 1) / 6;
    for (std::ptrdiff_t i = 0; i < n; ++i) {
      const std::ptrdiff_t k = i + static_cast<std::ptrdiff_t>(whole);
      y[static_cast<std::size_t>(i)] = a * at(k - 1) + b * at(k) + c * at(k + 1) + d * at(k + 2);
    }
    return y;
  }
  Column integral(x.size(), 0.0);
  for (std::size_t i = 1; i < x.size(); ++i) integral[i] = integral[i - 1] + (x[i - 1] + x[i]) / 2;
  const auto until = [&](double t) {
    if (t <= 0) return t * x.front();
    const auto last = static_cast<double>(n - 1);
    if (t >= last) return integral.back() + (t - last) * x.back();
    const auto k = static_cast<std::size_t>(t);
    const double f = t - static_cast<double>(k);
    return integral[k] + f * (x[k] + f * (x[k + 1] - x[k]) / 2);
  };
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double middle = static_cast<double>(i) - delay;
    y[i] = (until(middle + width / 2) - until(middle - width / 2)) / width;
  }
  return y;
}

Column lagged(const Column& x, double tau_s, double period_s) {
  EffectSetting setting;
  setting.parameters[0].value[0] = 1 / (kTwoPi * tau_s);
  DriveFacts facts;
  facts.sample_period_s = period_s;
  CurrentLoopLag<double> lag;
  lag.configure(setting, facts);
  MotionState<double> start;
  start.effort = x.front();
  lag.start(start);
  Column y;
  y.reserve(x.size());
  for (const double value : x) y.push_back(lag.acting_effort(value, start));
  return y;
}

/// Where friction turns round, nobody knows how sharply: a knee that is off looks like a filter.
void leave_out_reversals(std::vector<bool>& moving, const DriveRecord& record,
                         double cutoff_rad_s) {
  const double period = record.sample_period_s;
  const auto half = static_cast<std::size_t>(kSpeedOver_s / period) + 1;
  Column travel(1, 0.0);
  for (const auto& s : record.samples) travel.push_back(travel.back() + s.increment);
  const auto speed = [&](std::size_t i) {
    const std::size_t from = i > half ? i - half : 0, to = std::min(i + half, travel.size() - 1);
    return std::abs(travel[to] - travel[from]) / static_cast<double>(to - from);
  };
  double highest = 0;
  for (std::size_t i = 0; i < moving.size(); ++i) highest = std::max(highest, speed(i));
  const auto memory =
      static_cast<std::size_t>((kMemory / cutoff_rad_s + kLongest_s) / period) + half;
  std::size_t since = 0;
  for (std::size_t i = 0; i < moving.size(); ++i) {
    since = speed(i) < kSlow * highest ? 0 : since + 1;
    if (since <= memory) moving[i] = false;
  }
}

/// Delay and variance, searched; one of a shape.
struct Point {
  double delay_s = 0, variance_s2 = 0;
};

/// The record through the observer at one cutoff: the effort, and what the motion asks for.
class Design {
 public:
  Design(const DisturbanceObserverConfig& base, const IdleIdentification& found,
         const DriveRecord& record, double cutoff_rad_s, double held_samples)
      : period_s_(record.sample_period_s), held_(held_samples), hold_samples_(held_samples) {
    DisturbanceObserverConfig c = base;
    c.sample_period_s = period_s_;
    c.disturbance_cutoff_rad_s = c.velocity_cutoff_rad_s = cutoff_rad_s;
    DriveModelConfig& drive = c.drive;
    drive.inertia = drive.viscous = drive.coulomb = drive.constant_load = 0;
    drive.friction_knee = found.friction_knee;
    std::vector<bool> moving = samples_in_motion(c, record);
    leave_out_reversals(moving, record, cutoff_rad_s);
    block_ = std::max<std::size_t>(1, static_cast<std::size_t>(0.03 / (cutoff_rad_s * period_s_)));
    blocks_ = std::min(moving.size() / block_, kMostRows);
    for (std::size_t b = 0; b < blocks_; ++b) {
      const auto from = moving.begin() + static_cast<std::ptrdiff_t>(b * block_);
      if (std::all_of(from, from + static_cast<std::ptrdiff_t>(block_), [](bool m) { return m; }))
        rows_.push_back(b);
    }
    effort_ = in_motion(means(idle_fit::response(c, record, false)));
    // From here on a block is a sample.
    period_s_ *= static_cast<double>(block_);
    held_ /= static_cast<double>(block_);
    drive.effects.count = 0;
    const auto add = [&](double DriveModelConfig::*parameter) {
      DisturbanceObserverConfig one = c;
      one.drive.*parameter = 1;
      Column y = idle_fit::response(one, record, true);
      for (double& value : y) value = -value;
      motion_.push_back(means(y));
    };
    add(&DriveModelConfig::inertia);
    add(&DriveModelConfig::viscous);
    add(&DriveModelConfig::coulomb);
    if (found.constant_load_fitted) add(&DriveModelConfig::constant_load);
  }

  [[nodiscard]] double period_s() const { return period_s_; }
  [[nodiscard]] std::size_t rows() const { return rows_.size(); }
  [[nodiscard]] const Column& effort() const { return effort_; }
  [[nodiscard]] std::size_t terms() const { return motion_.size(); }
  [[nodiscard]] std::size_t lag() const { return static_cast<std::size_t>(kHacLag_s / period_s_); }
  /// A term of the motion, a value a block; the torque of all of them.
  [[nodiscard]] const Column& term(std::size_t k) const { return motion_[k]; }
  [[nodiscard]] Column torque(const Eigen::VectorXd& parameters) const {
    Column sum(motion_.front().size(), 0.0);
    for (std::size_t k = 0; k < motion_.size(); ++k)
      for (std::size_t i = 0; i < sum.size(); ++i)
        sum[i] += parameters(static_cast<Eigen::Index>(k)) * motion_[k][i];
    return sum;
  }
  /// What the drive would report of it, in the rows.
  [[nodiscard]] Column reported(const Column& x, Shape shape, const Point& p) const {
    const double root = std::sqrt(p.variance_s2);
    Column y;
    if (shape == Shape::lag)
      y = root > 1e-7 ? mean_of(lagged(x, root, period_s_), 0, (p.delay_s - root) / period_s_)
                      : mean_of(x, 0, p.delay_s / period_s_);
    else
      y = mean_of(x, std::sqrt(12.0) * root / period_s_, p.delay_s / period_s_);
    if (hold_samples_ > 1) y = mean_of(y, held_, held_ * (hold_samples_ - 1) / (2 * hold_samples_));
    return in_motion(y);
  }

 private:
  /// Over blocks that are short against the observer's time constant.
  [[nodiscard]] Column means(const Column& all) const {
    Column out(blocks_, 0.0);
    for (std::size_t b = 0; b < blocks_; ++b) {
      for (std::size_t i = b * block_; i < (b + 1) * block_; ++i) out[b] += all[i];
      out[b] /= static_cast<double>(block_);
    }
    return out;
  }
  [[nodiscard]] Column in_motion(const Column& all) const {
    Column out;
    out.reserve(rows_.size());
    for (const std::size_t b : rows_) out.push_back(all[b]);
    return out;
  }

  double period_s_;      // of a block
  double held_;          // samples, then blocks
  double hold_samples_;  // likewise in samples
  std::size_t block_ = 1, blocks_ = 0;
  std::vector<std::size_t> rows_;
  Column effort_;
  std::vector<Column> motion_;
};

struct PathFit {
  Point at;
  Eigen::VectorXd parameters;
  double square = std::numeric_limits<double>::infinity();
};

PathFit linear_fit(const Design& design, Shape shape, const Point& at) {
  const auto rows = static_cast<Eigen::Index>(design.rows());
  Eigen::MatrixXd a(rows, static_cast<Eigen::Index>(design.terms()));
  for (std::size_t k = 0; k < design.terms(); ++k) {
    const Column c = design.reported(design.term(k), shape, at);
    a.col(static_cast<Eigen::Index>(k)) = Eigen::Map<const Eigen::VectorXd>(c.data(), rows);
  }
  const Eigen::Map<const Eigen::VectorXd> y(design.effort().data(), rows);
  PathFit fit{at, {}, 0};
  fit.parameters = dense::solve_symmetric(a.transpose() * a, a.transpose() * y);
  fit.square = (y - a * fit.parameters).squaredNorm();
  return fit;
}

/// By how much the reported torque changes with delay and variance.
std::array<Column, 2> slopes(const Design& design, Shape shape, const PathFit& fit,
                             double period_s) {
  const Column torque = design.torque(fit.parameters);
  const double h = period_s / 4;
  const double root = std::sqrt(fit.at.variance_s2);
  const double up = std::pow(root + h, 2), down = std::pow(std::max(root - h, 0.0), 2);
  const auto difference = [&](const Point& a, const Point& b, double step) {
    Column x = design.reported(torque, shape, a);
    const Column y = design.reported(torque, shape, b);
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = (x[i] - y[i]) / step;
    return x;
  };
  const Point& p = fit.at;
  return {difference({p.delay_s + h, p.variance_s2}, {p.delay_s - h, p.variance_s2}, 2 * h),
          difference({p.delay_s, up}, {p.delay_s, down}, up - down)};
}

PathFit search(const Design& design, Shape shape, const Point& start, double period_s) {
  PathFit best = linear_fit(design, shape, start);
  const auto rows = static_cast<Eigen::Index>(design.rows());
  for (int step = 0; step < kSteps; ++step) {
    const auto [late, wide] = slopes(design, shape, best, period_s);
    const auto terms = static_cast<Eigen::Index>(design.terms());
    Eigen::MatrixXd a(rows, terms + 2);
    for (Eigen::Index k = 0; k < terms; ++k) {
      const Column c = design.reported(design.term(static_cast<std::size_t>(k)), shape, best.at);
      a.col(k) = Eigen::Map<const Eigen::VectorXd>(c.data(), rows);
    }
    a.col(terms) = Eigen::Map<const Eigen::VectorXd>(late.data(), rows);
    a.col(terms + 1) = Eigen::Map<const Eigen::VectorXd>(wide.data(), rows);
    const Eigen::VectorXd scale = a.colwise().norm().cwiseMax(1e-300);
    for (Eigen::Index k = 0; k < a.cols(); ++k) a.col(k) /= scale(k);
    const Eigen::Map<const Eigen::VectorXd> y(design.effort().data(), rows);
    Eigen::VectorXd move = dense::solve_symmetric(a.transpose() * a, a.transpose() * y);
    move = move.cwiseQuotient(scale);
    bool better = false;
    for (double part = 1; part > 0.05 && !better; part /= 2) {
      Point p = best.at;
      p.delay_s = std::clamp(p.delay_s + part * move(terms), -kLongest_s, 2 * kLongest_s);
      p.variance_s2 =
          std::clamp(p.variance_s2 + part * move(terms + 1), 0.0, kLongest_s * kLongest_s);
      PathFit next = linear_fit(design, shape, p);
      if (!(next.square < best.square)) continue;
      better = next.square < (1 - 1e-6) * best.square;
      best = std::move(next);
      break;
    }
    if (!better) break;
  }
  return best;
}

/// Delay and variance at one cutoff, with the errors that this record gives them.
struct Found {
  Shape shape = Shape::lag;
  PathFit fit;
  double delay_error_s = 0, variance_error_s2 = 0;
  double other_square = 0;  // of the other shape
};

Found find(const Design& design, const std::vector<Point>& starts, double period_s) {
  std::array<PathFit, 2> best;
  for (const Shape shape : {Shape::lag, Shape::average})
    for (const Point& start : starts) {
      PathFit fit = search(design, shape, start, period_s);
      PathFit& own = best[static_cast<std::size_t>(shape)];
      if (fit.square < own.square) own = std::move(fit);
    }
  Found found;
  found.shape = best[1].square < best[0].square ? Shape::average : Shape::lag;
  found.other_square = best[found.shape == Shape::lag ? 1 : 0].square;
  found.fit = std::move(best[static_cast<std::size_t>(found.shape)]);
  std::vector<Column> all;
  for (std::size_t k = 0; k < design.terms(); ++k)
    all.push_back(design.reported(design.term(k), found.shape, found.fit.at));
  auto [late, wide] = slopes(design, found.shape, found.fit, period_s);
  all.push_back(std::move(late));
  all.push_back(std::move(wide));
  Columns columns;
  for (const Column& c : all) columns.push_back(&c);
  const Regression r = regress(columns, design.effort(), design.lag());
  const auto terms = static_cast<Eigen::Index>(design.terms());
  found.delay_error_s = r.standard_errors(terms);
  found.variance_error_s2 = r.standard_errors(terms + 1);
  // Straight lines from block to block have a variance of their own, and a sampled derivative of
  // the angle lacks one (Tustin: tan(w T / 2) for w T / 2, twice). Half of that is its error.
  double& variance = found.fit.at.variance_s2;
  const double lines = variance > 0 ? std::pow(design.period_s(), 2) / 6 : 0.0;
  variance = std::max(0.0, variance + lines - period_s * period_s / 3);
  found.variance_error_s2 =
      std::hypot(found.variance_error_s2, std::pow(design.period_s(), 2) / 12);
  return found;
}

double half_hz(Shape shape, double variance_s2) {
  const double root = std::sqrt(variance_s2);
  return shape == Shape::lag ? kLagHalf / (kTwoPi * root) : kAverageHalf / (std::sqrt(12.0) * root);
}

}  // namespace

double effort_update_hz(const DriveRecord& record) {
  double highest = 0;
  for (const auto& s : record.samples) highest = std::max(highest, std::abs(s.increment));
  std::vector<std::size_t> apart;
  std::size_t since = 0;
  bool counts = false;  // a stretch that began with a new value and has moved throughout
  for (std::size_t i = 1; i < record.samples.size(); ++i) {
    const DriveSample<double>& s = record.samples[i];
    ++since;
    if (!(std::abs(s.increment) > 0.01 * highest)) counts = false;
    if (has(s.quality, Quality::held) || s.effort == record.samples[i - 1].effort) continue;
    if (counts) apart.push_back(since);
    since = 0;
    counts = true;
  }
  const double mean = regular_interval(std::move(apart));
  return mean > 0 ? 1 / (mean * record.sample_period_s) : 0;
}

TorquePath identify_torque_path(const DisturbanceObserverConfig& base,
                                const IdleIdentification& found, const DriveRecord& record) {
  TorquePath path;
  path.update_hz = effort_update_hz(record);
  const double period = record.sample_period_s;
  const double held = path.update_hz > 0 ? 1 / (path.update_hz * period) : 1;
  std::optional<Found> best;
  std::optional<Found> slower;
  bool shapes_agree = true;
  std::vector<Point> starts;
  for (const double root : kStarts_s) starts.push_back({root, root * root});
  for (const double cutoff : kCutoffs_rad_s) {
    if (cutoff * period > 1) break;
    const Design design(base, found, record, cutoff, held);
    if (design.rows() < 100) continue;
    Found now = find(design, starts, period);
    starts = {now.fit.at};
    Found told = now;
    if (slower) {
      const auto moved = [](double a, double ea, double b, double eb) {
        return std::max(0.0, (a - b) * (a - b) - std::max(0.0, eb * eb - ea * ea));
      };
      told.variance_error_s2 =
          std::sqrt(std::pow(now.variance_error_s2, 2) +
                    moved(now.fit.at.variance_s2, now.variance_error_s2, slower->fit.at.variance_s2,
                          slower->variance_error_s2));
      told.delay_error_s = std::sqrt(std::pow(now.delay_error_s, 2) +
                                     moved(now.fit.at.delay_s, now.delay_error_s,
                                           slower->fit.at.delay_s, slower->delay_error_s));
    }
    slower = std::move(now);
    if (best && told.shape != best->shape) shapes_agree = false;
    if (!best || told.variance_error_s2 < best->variance_error_s2) best = std::move(told);
  }
  if (!best) return path;
  const Point& at = best->fit.at;
  path.delay_s = {at.delay_s, best->delay_error_s};
  const bool seen = at.variance_s2 > kSeen * best->variance_error_s2 &&
                    at.variance_s2 > std::pow(kLeastPeriods * period, 2);
  if (!seen) {
    // Of both shapes the one that shows less.
    const double most = at.variance_s2 + kBound * best->variance_error_s2;
    path.half_to_hz = std::min(half_hz(Shape::lag, most), half_hz(Shape::average, most));
    path.stated_from = true;
    path.told = path.half_to_hz > kLeast_hz && at.variance_s2 < kLongest_s * kLongest_s;
    if (!path.told) path.half_to_hz = 0;
    return path;
  }
  const double spread = std::sqrt(at.variance_s2);
  const double spread_error = best->variance_error_s2 / (2 * spread);
  if (at.delay_s + kEarly * std::hypot(best->delay_error_s, spread_error) < spread) {
    // So slow it cannot be: at the most as slow as it is late.
    const double most = at.delay_s + kBound * best->delay_error_s;
    path.too_early = !(most > 0);
    if (path.too_early) return path;
    path.half_to_hz =
        std::min(half_hz(Shape::lag, most * most), half_hz(Shape::average, most * most));
    path.stated_from = true;
    path.told = path.half_to_hz > kLeast_hz;
    if (!path.told) path.half_to_hz = 0;
    return path;
  }
  path.told = true;
  path.averages = best->shape == Shape::average;
  const double lag = half_hz(Shape::lag, at.variance_s2);
  const double average = half_hz(Shape::average, at.variance_s2);
  const double error = best->variance_error_s2 / (2 * at.variance_s2);
  // What one cutoff shows and another denies is no shape.
  path.shape_told = shapes_agree && best->other_square > kToldApart * best->fit.square;
  path.half_to_hz = path.shape_told && !path.averages ? lag : average;
  const double filter = path.half_to_hz / kLagHalf;
  path.filter_hz = {filter, path.shape_told
                                ? filter * error
                                : std::hypot(filter * error, (lag - average) / kLagHalf)};
  return path;
}

std::string TorquePath::sentence() const {
  if (too_early)
    return "how fast the reported current follows the torque is not told: it comes " +
           printed(-1e3 * delay_s.value, 3) + " +- " + printed(1e3 * delay_s.standard_error, 3) +
           " ms before the motion, as no filter does; the speed may be late itself, or the current "
           "is not in proportion to the torque";
  if (!told)
    return "the record does not show how fast the reported current follows the torque: its "
           "accelerations are too soft";
  const std::string late = "the reported current is " + printed(1e3 * delay_s.value, 3) + " +- " +
                           printed(1e3 * delay_s.standard_error, 3) + " ms late";
  if (stated_from)
    return late + "; no filter is seen: it shows half of a vibration up to " +
           printed(half_to_hz, 3) + " Hz at least; accelerations too soft to tell more";
  return late + ", filtered at " + printed(filter_hz.value, 3) + " +- " +
         printed(filter_hz.standard_error, 3) + " Hz" +
         (!shape_told ? " (by a moving average; if it is a lag, 1.5 times that)"
          : averages  ? " (by a moving average)"
                      : "") +
         ": beyond " + printed(half_to_hz, 3) + " Hz it shows less than half of a vibration";
}

}  // namespace servosense
