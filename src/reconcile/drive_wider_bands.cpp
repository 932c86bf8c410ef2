// A mode beyond the working band. Its corner lies where the encoder's noise, differentiated twice,
// would dominate: right for what acts at every frequency, too low for a load on a spring, which
// within it shows no more than the foot of the mode, and that is any mode's. Around its resonance
// the load moves the motor by much more than the noise there.
#include <algorithm>
#include <cmath>
#include <optional>

#include "drive_workflow.hpp"

namespace servosense::reconcile {
namespace {

constexpr const char* kCoupling = "flexible-coupling";
constexpr double kWider = 2;              // at most, from band to band
constexpr double kWidestCorner_hz = 120;  // beyond it sound machines have modes, too
constexpr double kLeastWider = 1.2;

}  // namespace

/// The coupling alone, beside what the model has: is there one at all in the band of these signals?
bool DriveWorkflow::mode_stands_out() {
  if (!check_motion()) return false;
  set_up();
  if (!calibrate()) return false;
  add_coordinates();
  candidates_ = drive_candidates(situation());
  std::erase_if(candidates_, [](const Candidate& c) { return c.name != kCoupling; });
  decision_ = decide(problem_, candidates_, options_);
  return !decision_.accepted.empty() && decision_.accepted[0].theta[0] < signals_.corner_hz;
}

/// And is it still the best with the whole catalogue beside it?
const FoundEffect* DriveWorkflow::mode_beside_others() {
  candidates_ = drive_candidates(situation());
  decision_ = decide(problem_, candidates_, options_);
  for (const FoundEffect& effect : decision_.report.effects)
    if (effect.name == kCoupling) return &effect;
  return nullptr;
}

void DriveWorkflow::look_in_wider_bands(DriveOutcome& outcome) const {
  Report& report = outcome.report;
  // Play hides the spring in series with it.
  for (const char* name : {kCoupling, "backlash"})
    if (outcome.model.effects.find(name) != nullptr) return;
  if (outcome.model.effects.count >= kMaxActiveEffects) return;
  DriveData known = data_;
  known.model = outcome.model;
  const double widest = std::min(kWidestCorner_hz, 0.1 / data_.sample_period_s);
  std::optional<DriveWorkflow> best;
  double most = 0;
  const double wider = widest / signals_.corner_hz;
  const int bands =
      wider < kLeastWider ? 0 : static_cast<int>(std::ceil(std::log(wider) / std::log(kWider)));
  for (int band = 1; band <= bands; ++band) {
    const double corner = signals_.corner_hz * std::pow(wider, band / static_cast<double>(bands));
    DriveWorkflow wide(known, options_, corner);
    if (!wide.mode_stands_out()) continue;
    // Noise in the motion makes the spring seem other than it is: the band with the least of it.
    const Report& r = wide.decision_.report;
    const double closed = 1 - r.gap_after / r.gap_before;
    if (!(closed > most)) continue;
    most = closed;
    best.emplace(wide);
  }
  if (!best) return;
  const FoundEffect* mode = best->mode_beside_others();
  if (mode == nullptr) return;
  outcome.added.push_back(setting_of(kCoupling, {mode->parameters, {}}, data_.turns()));
  outcome.model.effects.settings[outcome.model.effects.count++] = outcome.added.back();
  report.effects.push_back(*mode);
  if (report.verdict == Verdict::agrees) report.verdict = Verdict::explained;
  if (report.verdict == Verdict::unexplained) report.verdict = Verdict::partly_explained;
  report.remarks.push_back(std::string(kCoupling) + " shows beyond the " +
                           printed(signals_.corner_hz, 2) +
                           " Hz of the comparison, where it hardly changes the gap: its own gaps "
                           "are those up to " +
                           printed(best->signals_.corner_hz, 3) + " Hz");
}

}  // namespace servosense::reconcile
