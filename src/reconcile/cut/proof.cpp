// The end of the record, which took no part in the fit.
#include <algorithm>
#include <cmath>
#include <limits>

#include "reconcile/cut/workflow.hpp"
#include "reconcile/select/standing.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/golden_section.hpp"

namespace servosense::reconcile {
/// rms of measurement less model over the samples kept for the proof, before and after finding the
/// angular zero anew from their first tenth (an encoder without an index forgets it).
CuttingWorkflow::Gap CuttingWorkflow::held_out_gap(const CutFit& fit) const {
  const auto gap_of = [&](const CutState& state) {
    const Column x = predicted(state, false), y = predicted(state, true);
    double square = 0, n = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      if (average_.block_of[i] == CutAverage::kNone ||
          !average_.blocks[average_.block_of[i]].held_out)
        continue;
      const double dx = data_.force_x_N[i] - x[i], dy = data_.force_y_N[i] - y[i];
      square += 0.5 * (dx * dx + dy * dy);
      ++n;
    }
    return n > 0 ? std::sqrt(square / n) : 0;
  };
  Gap gap;
  gap.as_fitted_N = gap.rezeroed_N = gap_of(fit.state);
  std::vector<const CutBlock*> first;
  for (const CutBlock& b : average_.blocks)
    if (b.held_out) first.push_back(&b);
  if (first.empty()) return gap;
  first.resize(std::max<std::size_t>(1, first.size() / 10));
  CutState moved = fit.state;
  const auto loss = [&](double zero) {
    CutState s = fit.state;
    s.zero_rad = zero;
    const std::vector<Eigen::VectorXd> forces = fitter_->forces(s);
    double sum = 0;
    for (const CutBlock* b : first)
      sum += (b->count.array() * (b->mean - forces[b->level]).array().square()).sum();
    return sum;
  };
  constexpr int kPoints = 180;
  double best = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kPoints; ++k) {
    const double zero = fit.state.zero_rad + kTwoPi * k / kPoints;
    if (const double left = loss(zero); left < best) {
      best = left;
      moved.zero_rad = zero;
    }
  }
  constexpr double kStep = kTwoPi / kPoints, kClose = 1e-4;
  moved.zero_rad =
      lowest_between(loss, moved.zero_rad - kStep, moved.zero_rad + kStep,
                     [](double low, double high) { return high - low < kClose * kStep; });
  gap.rezeroed_N = gap_of(moved);
  return gap;
}

/// Gaps before and after each effect; what does not hold where it was not fitted is taken back.
void CuttingWorkflow::prove(Report& report) {
  const Gap before = held_out_gap(base_), after = held_out_gap(found_);
  moved_ = after.rezeroed_N < criteria_.zero_moved * after.as_fitted_N &&
           after.as_fitted_N > 1.2 * average_.noise_N;
  if (moved_)
    report.remarks.emplace_back(
        "the angular zero has changed for the end of the record; it was found again from its first "
        "tenth");
  const auto of = [&](const Gap& gap) { return moved_ ? gap.rezeroed_N : gap.as_fitted_N; };
  report.gap_before = of(before);
  report.gap_after = of(after);
  CutFit as_given = base_;
  as_given.state.immersion_scale = as_given.state.lag_scale = 1;
  as_given.state.coefficients = given_.coefficients;
  report.gap_nominal = held_out_gap(as_given).as_fitted_N;
  report.floors.lap = report.floors.used = average_.noise_N;
  report.effort_rms = average_.effort_N;
  report.held_from_s = average_.held_from_s;
  report.held_to_s = average_.held_to_s;
  double gap = report.gap_before;
  for (std::size_t i = 0; i < report.effects.size(); ++i) {
    report.effects[i].gap_before = gap;
    const std::vector<std::size_t> part(found_.families.begin(),
                                        found_.families.begin() + static_cast<long>(i + 1));
    gap = i + 1 == report.effects.size() ? report.gap_after : of(held_out_gap(fit_afresh(part)));
    report.effects[i].gap_after = gap;
  }
  // What is not steady moves the means of turns, too.
  const double most =
      unsteady_N_ > criteria_.mostly_unsteady * average_.effort_N ? criteria_.cut_must_shrink : 1;
  if (!report.effects.empty() && report.gap_after >= most * report.gap_before) {
    why_nothing_ = report.effects[0].name + ": does not shrink the gap on the end of the record";
    report.effects.clear();
    found_ = base_;
    report.gap_after = report.gap_before;
  }
}

void CuttingWorkflow::judge(Report& report) const {
  const double left = root(beyond_noise(found_));
  const double held_left =
      root(report.gap_after * report.gap_after - average_.noise_N * average_.noise_N);
  const bool at_floor =
      !unsteady_ && left < floor_N() && held_left < std::max(1.1 * average_.noise_N, 3 * floor_N());
  report.verdict = verdict_of(!report.effects.empty() || !lines_.empty(), at_floor);
  report.ranking = ranking_;
  report.residual_white = at_floor;
  report.residual_detail = at_floor ? "" : why_nothing_;
}

/// Ahead of the effects of the cut: it was taken off first.
void CuttingWorkflow::report_lines(Report& report) const {
  double gap = report.gap_before;
  for (std::size_t k = lines_.size(); k > 0; --k) {
    const TimeLockedLine& line = lines_[k - 1];
    const double amplitude = std::max(line.amplitude_N(0), line.amplitude_N(1));
    report.lines.insert(report.lines.begin(), {line.frequency_hz, amplitude});
    FoundEffect e;
    e.name = "time-locked-vibration";
    e.confidence = confidence_of({.margin = amplitude / line.error_N}, criteria_);
    e.parameters = {{"frequency_hz", {line.frequency_hz}}, {"amplitude_N", {amplitude}}};
    e.standard_errors = {{"frequency_hz", {line.frequency_error_hz}},
                         {"amplitude_N", {line.error_N}}};
    e.where = "time";
    e.scope = "record";
    e.gap_after = gap;
    gap = std::hypot(gap, std::sqrt(line.held_mean_square_N2));
    e.gap_before = gap;
    e.share_of_residual = line.held_mean_square_N2 / (gap * gap);
    report.effects.insert(report.effects.begin(), std::move(e));
  }
  const double more = gap * gap - report.gap_before * report.gap_before;
  report.gap_before = gap;
  report.gap_nominal = std::sqrt(report.gap_nominal * report.gap_nominal + more);
}

}  // namespace servosense::reconcile
