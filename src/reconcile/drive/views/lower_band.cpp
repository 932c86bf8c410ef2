// Backlash in a drive that swings through it now and then: while it accelerates, say, and its load
// hangs between the flanks. That is no swing that lasts (limit_cycle.hpp), and most of it is beyond
// the band, but what reaches through is more than what the backlash does in the band. Half the band
// has none of it, and crossing the backlash takes longer than that.
#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>

#include "reconcile/drive/workflow.hpp"
#include "reconcile/select/standing.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kLower = 0.5;  // of the corner

}  // namespace

/// What is left lies in the upper part of the band.
bool DriveWorkflow::residual_beyond_lower_band() const {
  const Report& r = decision_.report;
  Column rest(r.measured.size(), 0);
  for (std::size_t i = 0; i < rest.size(); ++i)
    if (problem_.usable[i]) rest[i] = r.measured[i] - r.simulated_after[i];
  // Gaussians in a row: the squares of their widths add.
  const double corner = kLower * signals_->corner_hz / std::sqrt(1 - kLower * kLower);
  const Column below = Smoother(corner, problem_.row_period_s).apply(rest, 0, 1);
  double all = 0, left = 0;
  for (std::size_t i = 0; i < rest.size(); ++i)
    if (problem_.usable[i] && !problem_.held_out[i]) {
      all += rest[i] * rest[i];
      left += below[i] * below[i];
    }
  return left < criteria_.most_below * all;
}

BandRun run_in_band(const DriveData& data, const Options& options, double corner,
                    const std::vector<SecondGap>& refuted) {
  const auto run = [&](double in_band_hz) {
    auto workflow = std::make_unique<DriveWorkflow>(data, options, in_band_hz);
    auto outcome = workflow->run(refuted);
    return BandRun{std::move(workflow), std::move(outcome)};
  };
  BandRun usual = run(corner);
  if (!usual.outcome || usual.outcome->report.verdict != Verdict::unexplained ||
      !usual.workflow->residual_beyond_lower_band())
    return usual;
  BandRun lower = run(kLower * corner);
  if (!lower.outcome || !reports_effect(lower.outcome->report, kBacklash)) return usual;
  lower.outcome->report.remarks.push_back(
      "compared below " + printed(kLower * corner, 2) +
      " Hz only: at times the drive swings, which hides what is above; lower the gain of the loop "
      "for a record that shows more");
  return lower;
}

}  // namespace servosense::reconcile
