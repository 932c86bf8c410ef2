#include "reconcile/drive/controller_delay.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "reconcile/numerics/floors.hpp"
#include "reconcile/numerics/least_squares.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kLongest_s = 5e-3;
constexpr double kLeastFilter_s = 3e-4;  // 500 Hz
constexpr double kSmall_s = 1e-4;        // for slopes
constexpr unsigned kMostDelayRounds = 20;
constexpr double kSettled_s = 2e-6;
constexpr std::size_t kBlocks = 20;

/// A first-order lag on straight lines between samples, exactly.
Column lagged(const Column& x, double lag_s, double period_s) {
  const double keep = std::exp(-period_s / lag_s);
  const double ramp = lag_s / period_s * (1 - keep);
  Column out = x;
  for (std::size_t i = 1; i < x.size(); ++i)
    out[i] = keep * out[i - 1] + (ramp - keep) * x[i - 1] + (1 - ramp) * x[i];
  return out;
}

/// The law of the cascade: its effort is a sum of the position's error, the sum of that, position
/// and speed behind a lag, and the speed that was told.
class Law {
 public:
  Law(const DriveData& data, const DriveSignals& signals, const Problem& problem)
      : signals_(signals), rows_(fit_rows(problem, kBlocks)) {
    Column told = signals.to_work(data.command);
    for (std::size_t i = told.size(); i-- > 0;) told[i] -= told[0];
    Column error(told.size(), 0), sum(told.size(), 0);
    for (std::size_t i = 0; i < error.size(); ++i) {
      error[i] = told[i] - signals.position[i];
      if (i > 0) sum[i] = sum[i - 1] + 0.5 * signals.work_period_s * (error[i] + error[i - 1]);
    }
    terms_.push_back(signals.to_rows(error));
    terms_.push_back(signals.to_rows(sum));
    terms_.push_back(signals.to_rows(told, 1));
    terms_.emplace_back(signals.rows(), 1.0);
    // The zeros of command and encoder differ, and that is summed up too.
    terms_.push_back(problem.time_s);
  }

  [[nodiscard]] double effort_rms() const {
    const Column effort = signals_.effort_rows(0);
    double square = 0;
    for (const std::size_t i : rows_.rows) square += effort[i] * effort[i];
    return std::sqrt(square / static_cast<double>(std::max<std::size_t>(1, rows_.rows.size())));
  }

  struct Answer {
    double late_s = 0, filter_s = kLeastFilter_s;
    double error_s = 0;  ///< standard error of `late_s`
    double rms = 0;
    Column rest;
  };
  /// One step of Gauss and Newton.
  [[nodiscard]] Answer improved(const Answer& from) const {
    const auto seen = [&](double filter_s, int derivative) {
      return signals_.to_rows(lagged(signals_.position, filter_s, signals_.work_period_s),
                              derivative);
    };
    const auto slope = [](Column higher, const Column& lower) {
      for (std::size_t i = 0; i < higher.size(); ++i)
        higher[i] = (higher[i] - lower[i]) / (2 * kSmall_s);
      return higher;
    };
    std::vector<Column> columns = terms_;
    columns.push_back(seen(from.filter_s, 0));
    columns.push_back(seen(from.filter_s, 1));
    columns.push_back(slope(seen(from.filter_s + kSmall_s, 1), seen(from.filter_s - kSmall_s, 1)));
    columns.push_back(slope(signals_.effort_rows(kSmall_s - from.late_s),
                            signals_.effort_rows(-kSmall_s - from.late_s)));
    const Column target = signals_.effort_rows(-from.late_s);
    Regression r(rows_, target);
    std::vector<const Column*> all;
    for (const Column& column : columns) {
      r.add(column);
      all.push_back(&column);
    }
    const Fit fit = r.fit();
    const Eigen::Index last = fit.coefficients.size() - 1;
    Answer to;
    to.late_s = std::clamp(from.late_s + fit.coefficients(last), -kLongest_s, kLongest_s);
    to.error_s = fit.standard_errors(last);
    // Its column comes with the gain of the speed.
    const double gain = fit.coefficients(last - 2);
    const double more = gain != 0 ? fit.coefficients(last - 1) / gain : 0;
    to.filter_s = std::clamp(from.filter_s + more, kLeastFilter_s, kLongest_s);
    to.rms = std::sqrt(fit.mean_square);
    to.rest = residual_of(target, all, fit.coefficients);
    return to;
  }

 private:
  const DriveSignals& signals_;
  FitRows rows_;
  std::vector<Column> terms_;
};

}  // namespace

ControllerDelay controller_delay(const DriveData& data, const DriveSignals& signals,
                                 const Problem& problem, const Criteria& criteria) {
  if (data.command.empty() || data.command.size() != data.samples.size()) return {};
  const Law law(data, signals, problem);
  // From the filter that suits best: slopes alone get lost between the two.
  Law::Answer now, first;
  now.rms = std::numeric_limits<double>::infinity();
  for (const double late_s : {0.0, 0.5e-3})
    for (double filter_s = kLeastFilter_s; filter_s < kLongest_s; filter_s *= 1.6) {
      first.late_s = late_s;
      first.filter_s = filter_s;
      Law::Answer step = law.improved(first);
      if (step.rms < now.rms) now = std::move(step);
    }
  for (unsigned round = 0; round < kMostDelayRounds; ++round) {
    const Law::Answer before = now;
    now = law.improved(before);
    if (std::abs(now.late_s - before.late_s) > kSettled_s ||
        std::abs(now.filter_s - before.filter_s) > kSettled_s)
      continue;
    const bool holds =
        now.rms < criteria.negligible_in_effort * law.effort_rms() ||
        now.rms < criteria.floor_tolerance * floors_of(problem, now.rest, criteria).used;
    if (!holds) break;
    const double sure = criteria.sure_standard_errors * now.error_s;
    return {std::max(0.0, now.late_s - sure), std::max(0.0, now.late_s + sure)};
  }
  return {};
}

}  // namespace servosense::reconcile
