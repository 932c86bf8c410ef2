#include <algorithm>
#include <cmath>
#include <memory>

#include "reconcile/drive/comparison_band.hpp"
#include "reconcile/drive/workflow.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {

Expected<DriveChanges> changes_since(const DriveData& earlier, const DriveData& later,
                                     const Options& options) {
  auto first = reconcile_drive(earlier, options);
  if (!first) return data_error("earlier record: " + first.error().sentence);
  DriveData then = earlier, now = later;
  then.model = now.model = first->model;
  set_constant(then, first->constant);
  set_constant(now, first->constant);
  const auto moved = [&](double before, double before_error, double after, double after_error) {
    const double by = std::abs(after - before);
    return by > options.criteria.certain_standard_errors * std::hypot(before_error, after_error) &&
           by > options.criteria.least_change * std::abs(before);
  };
  const double corner =
      std::min(comparison_corner(then, options.criteria), comparison_corner(now, options.criteria));
  auto workflow = std::make_unique<DriveWorkflow>(now, options, corner);
  auto second = workflow->run({});
  if (!second) return second.error();
  // An effect of another size may be one of other parameters: look for it anew.
  DriveEffectsConfig kept;
  for (std::size_t i = 0; i < now.model.effects.count; ++i) {
    const EffectSetting& s = now.model.effects.settings[i];
    const auto same = [&](const DriveOutcome::Size& z) {
      return z.name == kDriveEffects[s.effect].name && moved(1, 0, z.size, z.error) &&
             kDriveEffects[s.effect].parameter_count() > 1;
    };
    if (std::none_of(second->sizes.begin(), second->sizes.end(), same))
      kept.settings[kept.count++] = s;
  }
  if (kept.count < now.model.effects.count) {
    now.model.effects.settings = kept.settings;
    now.model.effects.count = kept.count;
    auto anew = std::make_unique<DriveWorkflow>(now, options, corner);
    auto third = anew->run({});
    if (third && !third->report.effects.empty()) {
      then.model = now.model;
      workflow = std::move(anew);
      second = std::move(third);
    }
  }
  Report& report = second->report;
  report.since = earlier.source.empty() ? "the earlier record" : earlier.source;

  const Keys keys = keys_of(now.turns());
  for (const Recalibrated& c : report.recalibrated) {
    if (c.parameter == load_key(now.turns())) continue;  // among the sizes below
    if (c.parameter.ends_with(" phase_rad")) continue;   // a power-up does that
    const std::size_t blank = c.parameter.find(' ');     // of an effect
    double error = 0;
    for (const Recalibrated& b : first->report.recalibrated)
      if (b.parameter == c.parameter) error = b.standard_error;
    if (moved(c.from, error, c.to, c.standard_error))
      report.changed.push_back(
          {blank != std::string::npos    ? c.parameter.substr(0, blank)
           : c.parameter == keys.viscous ? "viscous-friction"
           : c.parameter == keys.coulomb ? "coulomb-friction"
                                         : "inertia",
           blank != std::string::npos ? c.parameter.substr(blank + 1) : c.parameter, c.from, error,
           c.to, c.standard_error});
  }
  for (const DriveOutcome::Size& s : second->sizes)
    if (moved(1, 0, s.size, s.error))
      report.changed.push_back({s.name, "size", 1, 0, s.size, s.error});
  if (!report.effects.empty()) {
    // What pays on the earlier record too was there already.
    auto proof = workflow->prove(then);
    if (!proof) return proof.error();
    for (std::size_t k = 0; k < report.effects.size(); ++k) {
      const FoundEffect& e = report.effects[k];
      const SecondGap& gap = proof->effects[k];
      const EffectSetting* was = first->model.effects.find(e.name);
      if (was == nullptr && (!gap.shown || gap.gap_after < gap.gap_before)) continue;
      for (std::size_t p = 0; p < e.parameters.size(); ++p) {
        if (e.parameters[p].values.size() != 1) continue;
        double before = 0;
        if (was != nullptr) {
          const EffectInfo& info = kDriveEffects[was->effect];
          for (std::size_t q = 0; q < info.parameter_count(); ++q)
            if (e.parameters[p].key == info.parameters[q].key_for(later.turns()))
              before = was->scalar(q);
        }
        const double error = p < e.standard_errors.size() ? e.standard_errors[p].values[0] : 0.0;
        // That it is there at all has stood its guards: how large it is may be less sure.
        if (was == nullptr || moved(before, 0, e.parameters[p].values[0], error))
          report.changed.push_back(
              {e.name, e.parameters[p].key, before, 0, e.parameters[p].values[0], error});
      }
    }
  }
  report.summary = summary_of(report, std::string(servosense::name_of(later.channel)));
  const double was = first->report.gap_after;
  if (report.changed.empty() && report.gap_after > options.criteria.floor_tolerance * was &&
      report.verdict != Verdict::agrees)
    report.summary += " that has a name, but the gap grew from " + printed(was) + " to " +
                      printed(report.gap_after) + " " + report.gap_unit;
  return DriveChanges{std::move(*first), std::move(*second)};
}

}  // namespace servosense::reconcile
