#include "servosense/identify/torque_run.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "servosense/core/units.hpp"

namespace servosense {
namespace {

constexpr Quality kBreaks = Quality::restarted | Quality::gap | Quality::settling;
constexpr Quality kFaulty = kUnusable | Quality::stuck;
// Torque changes with the feed by a law that a run over time does not know.
constexpr double kOtherFeed = 0.01;
constexpr double kNoTorque = std::numeric_limits<double>::quiet_NaN();
constexpr double kMostPoints = 1e8;
// Unsteady revolutions that a gap explains, and one: the first has none to be held against.
constexpr unsigned kBehindGap = 2;

}  // namespace

TorqueRunRecorder::TorqueRunRecorder(const TorqueRunOptions& options) : options_(options) {
  TurnStepsConfig c;
  c.step = options.step;
  c.steady_share = options.steady_share;
  if (options.over_path) c.most_steps = kMostSteps;
  steps_.configure(c);
}

void TorqueRunRecorder::add(double torque_Nm, double increment_rad, double advance,
                            double feed_override, Quality quality, std::int32_t block,
                            double friction_Nm) {
  if (block != block_ && block != kNoBlock) {
    block_ = block;
    if (steady_) {
      Stretch& s = stretches_.back();
      s.blocks.emplace_back(s.length + steps_.under_way(), block);
    } else {
      open_ = false;
    }
  }
  if (has(quality, kBreaks)) {
    if (has(quality, Quality::gap)) ++missing_;
    if (!stretches_.empty()) behind_gap_ = kBehindGap;
    end_stretch();
    open_ = false;
    steps_.reset();
    return;
  }
  if (has(quality, kFaulty) || !is_finite(torque_Nm) || !is_finite(increment_rad) ||
      !(advance >= 0)) {
    steps_.leave_out(is_finite(advance) ? std::max(0.0, advance) : 0);
    return;
  }
  if (advance == 0 && !options_.over_path) return;
  turned_rad_ += increment_rad;
  if (steady_ && is_finite(friction_Nm)) {
    stretches_.back().friction += friction_Nm;
    stretches_.back().samples += 1;
  }
  if (steps_.add(torque_Nm, increment_rad, advance, feed_override)) take_step();
}

void TorqueRunRecorder::take_step() {
  const TurnSteps<double>::Step& step = steps_.step();
  const double sense = std::copysign(1.0, std::exchange(turned_rad_, 0));
  if (step.kind == TurnStepKind::unsteady) {
    end_stretch();
    if (behind_gap_ > 0) --behind_gap_;
    return;
  }
  const bool goes_on = step.kind == TurnStepKind::resumed && open_;
  if (goes_on) {
    stretches_.back().length += step.skipped;
  } else if (step.kind != TurnStepKind::steady) {
    stretches_.emplace_back();
    stretches_.back().blocks.emplace_back(0.0, block_);
    stretches_.back().behind_gap = behind_gap_ > 0;
    if (options_.sample_period_s > 0)
      stretches_.back().speed_rad_s =
          sense * kTwoPi / (step.turn_samples * options_.sample_period_s);
  }
  behind_gap_ = 0;
  Stretch& s = stretches_.back();
  const bool knows_feed = options_.over_path && options_.sample_period_s > 0;
  const double feed = knows_feed ? step.progress / (step.samples * options_.sample_period_s) : 0.0;
  // An onset may still hold what the spindle settles by.
  const bool known = step.usable && (knows_feed || std::abs(step.feed_override - 1) <= kOtherFeed);
  const bool rapid = options_.over_path && step.progress > kMostSteps * options_.step;
  if (rapid || (known && step.kind == TurnStepKind::steady))
    s.knots.push_back(
        {s.length + 0.5 * step.progress, rapid ? kNoTorque : step.mean_Nm, step.progress, feed});
  s.length += step.progress;
  steady_ = open_ = true;
}

// The last step may hold the beginning of the change already.
void TorqueRunRecorder::end_stretch() {
  if (steady_ && !stretches_.back().knots.empty()) stretches_.back().knots.pop_back();
  steady_ = false;
}

Expected<TorqueRun> TorqueRunRecorder::finish() {
  TorqueRun run;
  run.spacing = options_.spacing;
  double length = 0;
  std::size_t knots = 0;
  for (const Stretch& s : stretches_) {
    length += s.length;
    for (const Knot& k : s.knots) {
      if (!is_finite(k.torque_Nm)) continue;
      knots += 1;
      run.step += k.width;
    }
  }
  if (knots < 2)
    return data_error(
        "the spindle never turns steadily for some revolutions; record a whole program");
  run.step /= static_cast<double>(knots);
  if (length / run.spacing > kMostPoints)
    return usage_error("the spacing is too fine for the length of the run");
  for (const Stretch& s : stretches_) {
    if (s.knots.empty()) continue;
    const std::size_t base = run.torque_Nm.size();
    const auto count =
        std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(s.length / run.spacing)));
    for (std::size_t b = 0; b < s.blocks.size(); ++b) {
      const auto at = static_cast<std::size_t>(std::lround(s.blocks[b].first / run.spacing));
      if (at >= count) continue;
      // Blocks shorter than a point share it: the last one counts.
      if (b > 0 && !run.sections.empty() && run.sections.back().first == base + at)
        run.sections.back().block = s.blocks[b].second;
      else
        run.sections.push_back({base + at, s.blocks[b].second, s.speed_rad_s,
                                s.samples > 0 ? s.friction / s.samples : 0, b > 0,
                                b == 0 && s.behind_gap});
    }
    std::size_t next = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const double x = static_cast<double>(i) * run.spacing;
      while (next < s.knots.size() && s.knots[next].at < x) ++next;
      const Knot& b = s.knots[std::min(next, s.knots.size() - 1)];
      const Knot& a = next == 0 ? b : s.knots[next - 1];
      // Steps between them were left out.
      const bool known = b.at - a.at <= 2 * (a.width + b.width);
      const double part = b.at > a.at ? (x - a.at) / (b.at - a.at) : 0;
      run.torque_Nm.push_back(known ? a.torque_Nm + part * (b.torque_Nm - a.torque_Nm) : kNoTorque);
      run.feed.push_back(a.feed + part * (b.feed - a.feed));
    }
  }
  if (!options_.over_path || !(options_.sample_period_s > 0)) run.feed.clear();
  return run;
}

}  // namespace servosense
