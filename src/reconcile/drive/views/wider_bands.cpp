// A mode beyond the working band. Its corner lies where the encoder's noise, differentiated twice,
// would dominate: right for what acts at every frequency, too low for a load on a spring, which
// shows there no more than the foot of the mode, and that may be any mode's. Around its resonance
// it outdoes the noise by far.
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "reconcile/drive/candidates/kinds.hpp"
#include "reconcile/drive/workflow.hpp"
#include "reconcile/select/standing.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

constexpr const char* kCoupling = "flexible-coupling";
constexpr double kWider = 2;  // at most, from band to band

/// Corners up to the widest, from the working one on.
std::vector<double> wider_bands(double corner, double widest, const Criteria& criteria) {
  std::vector<double> corners;
  const double wider = widest / corner;
  if (wider < criteria.wider_band) return corners;
  const double bands = std::ceil(std::log(wider) / std::log(kWider));
  for (double band = 1; band <= bands; ++band)
    corners.push_back(corner * std::pow(wider, band / bands));
  return corners;
}

}  // namespace

Decision DriveWorkflow::decide_on_mode() const {
  Options options = options_;
  options.criteria.least_gain_in_floors = criteria_.strong_gain_in_floors;
  return decide(problem_, candidates_, options);
}

/// At one speed a ripple shakes the drive at one frequency, and what little the mass moves there
/// otherwise than a rigid one is what any mode would do, from its foot up: an amplitude and a
/// phase, by direction. A mode has to show beside that.
std::vector<Column> DriveWorkflow::beside_ripple() const {
  std::vector<Column> all;
  const EffectSetting* ripple = given_.effects.find("torque-ripple");
  if (ripple == nullptr) return all;
  for (std::size_t line = 0; line < ripple->parameters[0].count; ++line)
    for (const double phase : {0.0, kTwoPi / 4}) {
      const double order = ripple->parameters[0].value[line];
      Column column =
          signals_->response(effect_with(ripple->effect, {order, 1, phase}), data_.model);
      if (column.empty()) continue;
      all.push_back(column);
      for (std::size_t i = 0; i < column.size(); ++i)
        if (signals_->velocity_rows[i] < 0) column[i] = -column[i];
      all.push_back(std::move(column));
    }
  return all;
}

/// The coupling alone, beside what the model has: is there one at all in the band of these signals?
bool DriveWorkflow::mode_stands_out() {
  if (!check_motion()) return false;
  set_up();
  // What an eccentric encoder's error at the angle measured leaves, twice a turn and in proportion
  // to the acceleration there, is the stronger the wider the band, and looks like a load that
  // swings.
  correct_angle_as_known();
  found_ = beside_ripple();
  if (!calibrate()) return false;
  add_coordinates();
  candidates_ = drive_candidates(situation());
  std::erase_if(candidates_, [](const Candidate& c) { return c.name != kCoupling; });
  decision_ = decide_on_mode();
  return !decision_.accepted.empty();
}

/// And is it still named with the whole catalogue beside it?
const FoundEffect* DriveWorkflow::mode_beside_others() {
  candidates_ = drive_candidates(situation());
  decision_ = decide_on_mode();
  for (const FoundEffect& effect : decision_.report.effects)
    if (effect.name == kCoupling) return &effect;
  return nullptr;
}

/// A mode found in a wider band, on another record of the same drive: its gap there in the same
/// band. Without a gain it does not stand out there.
std::optional<SecondGap> DriveWorkflow::mode_on(const DriveData& second,
                                                SecondRecord& proof) const {
  if (mode_corner_hz_ == 0) return {};
  DriveData known = second;
  known.model = beside_mode_;
  set_constant(known, constant_found());
  DriveWorkflow wide(known, options_, mode_corner_hz_);
  const bool holds = wide.mode_stands_out();
  const Report& r = wide.decision_.report;
  SecondGap gap{kCoupling, r.gap_before, holds ? r.gap_after : r.gap_before, true, mode_corner_hz_};
  if (shown_in_band_ && holds) {
    gap.gap_band_hz = 0;
    proof.from_s = r.held_from_s;
    proof.to_s = r.held_to_s;
    proof.effort_rms = r.effort_rms;
    proof.gap_nominal = nominal_gap_in_band(second);
    proof.gap_before = gap.gap_before;
    proof.gap_after = gap.gap_after;
  }
  return gap;
}

double DriveWorkflow::nominal_gap_in_band(const DriveData& data) const {
  DriveWorkflow given(data, options_, mode_corner_hz_);
  given.set_up();
  given.correct_angle_as_known();
  given.add_known_terms();
  return given.nominal_gap();
}

/// Nothing else was found: then the comparison is that of the band in which the mode shows.
void DriveWorkflow::show_in_band(Report& report, const DriveWorkflow& band,
                                 const DriveModelConfig& found) {
  shown_in_band_ = true;
  Report wide = band.decision_.report;
  wide.proof = band.prove_by_simulation(found);
  wide.gap_nominal = nominal_gap_in_band(data_);
  wide.channel = std::move(report.channel);
  wide.criteria = report.criteria;
  wide.timing_s = report.timing_s;
  wide.recalibrated = std::move(report.recalibrated);
  wide.not_testable = std::move(report.not_testable);
  wide.remarks = std::move(report.remarks);
  wide.remarks.push_back(
      std::string(kCoupling) + " shows beyond the " + printed(signals_->corner_hz, 2) +
      " Hz of the usual comparison: gaps are those up to " + printed(mode_corner_hz_, 3) + " Hz");
  report = std::move(wide);
}

void DriveWorkflow::look_in_wider_bands(DriveOutcome& outcome) {
  // Backlash hides the spring that is in series with it.
  for (const char* name : {kCoupling, kBacklash})
    if (outcome.model.effects.find(name) != nullptr) return;
  if (has_limit_cycle() || outcome.model.effects.count >= kMaxActiveEffects) return;
  DriveData known = data_;
  known.model = outcome.model;
  set_constant(known, outcome.constant);
  const double widest = std::min(criteria_.highest_mode_hz, 0.1 / data_.sample_period_s);
  std::vector<double> corners = wider_bands(signals_->corner_hz, widest, criteria_);
  std::optional<DriveWorkflow> best;
  double most = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const double corner = corners[i];
    DriveWorkflow wide(known, options_, corner);
    if (!wide.mode_stands_out()) continue;
    const double mode_hz = wide.decision_.accepted[0].theta[0];
    if (mode_hz > criteria_.highest_mode_hz) continue;
    if (mode_hz > criteria_.wider_band * corner) {
      // At the end of its range: then in the band that holds it.
      if (corner < widest) corners.push_back(std::min(mode_hz, widest));
      continue;
    }
    // Noise of the motion makes the spring seem other than it is: the band with the least of it.
    const Report& r = wide.decision_.report;
    const double closed = 1 - r.gap_after / r.gap_before;
    if (!(closed > most)) continue;
    most = closed;
    best.emplace(wide);
  }
  if (!best) return;
  const FoundEffect* mode = best->mode_beside_others();
  if (mode == nullptr) return;
  mode_corner_hz_ = best->signals_->corner_hz;
  beside_mode_ = outcome.model;
  outcome.added.push_back(setting_of(kCoupling, {mode->parameters, {}}, data_.turns()));
  add_effect(outcome.model.effects, outcome.added.back());
  Report& report = outcome.report;
  if (report.effects.empty() && best->decision_.report.effects.size() == 1) {
    show_in_band(report, *best, outcome.model);
    return;
  }
  report.effects.push_back(*mode);
  report.effects.back().gap_band_hz = mode_corner_hz_;
  report.verdict = with_a_name(report.verdict);
  report.remarks.push_back(std::string(kCoupling) + " shows beyond the " +
                           printed(signals_->corner_hz, 2) +
                           " Hz of the comparison, where it changes the gap by little or nothing: "
                           "its own gaps are those up to " +
                           printed(mode_corner_hz_, 3) + " Hz");
}

}  // namespace servosense::reconcile
