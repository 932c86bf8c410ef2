// How an effect stands beside what else might be the cause: its class, its runner-up, how sure its
// name is, and what is said where there is none.
#pragma once

#include <algorithm>
#include <span>
#include <string>
#include <string_view>

#include "reconcile/select/confidence.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {

/// What may be named as well, in the place of an effect.
struct Rival {
  std::string name;
  double gap = 0;     ///< that it leaves, rms
  double margin = 0;  ///< standard errors by which the effect leaves less
  bool in_class = false;
};

/// `rivals` in the order of what they leave. `its`: but for the margin, which they give.
inline void stand_beside(FoundEffect& effect, std::span<const Rival> rivals,
                         const std::string& splitting_motion, Evidence its,
                         const Criteria& criteria) {
  its.margin = 8;  // without a rival
  for (const Rival& r : rivals) {
    if (r.in_class) {
      if (std::ranges::find(effect.class_members, r.name) == effect.class_members.end())
        effect.class_members.push_back(r.name);
    } else if (effect.runner_up.empty()) {
      effect.runner_up = r.name;
      effect.runner_up_gap = r.gap;
      its.margin = r.margin;
    }
  }
  if (!effect.class_members.empty()) effect.splitting_motion = splitting_motion;
  effect.confidence = confidence_of(its, criteria);
}

/// Whether the report names this effect.
[[nodiscard]] inline bool reports_effect(const Report& report, std::string_view effect) {
  return std::ranges::find(report.effects, effect, &FoundEffect::name) != report.effects.end();
}

/// `named`: something was missing. `at_floor`: no more is left than noise and laws leave open.
[[nodiscard]] constexpr Verdict verdict_of(bool named, bool at_floor) {
  return named ? (at_floor ? Verdict::explained : Verdict::partly_explained)
               : (at_floor ? Verdict::agrees : Verdict::unexplained);
}

/// The same once something has been named besides.
[[nodiscard]] constexpr Verdict with_a_name(Verdict verdict) {
  return verdict_of(true, verdict == Verdict::agrees || verdict == Verdict::explained);
}

/// Why there is no name.
inline constexpr const char* kNothingBeyondNoise =
    "no candidate explains more than the noise allows";
inline constexpr const char* kAsLikelyWrong = "as likely wrong as right, for all that is left";
inline constexpr const char* kUnsteadySize = "its size changes along the record";
[[nodiscard]] inline std::string explains_too_little(const std::string& name, double share) {
  return "the best candidate, " + name + ", explains only " +
         std::to_string(static_cast<int>(100 * share)) + " % of what is beyond the noise";
}
/// More than a class may have; empty: no more. `this_record`: "this motion", "this cut".
[[nodiscard]] inline std::string class_too_large(std::size_t members, const char* this_record) {
  if (members <= 2) return {};
  return std::string(this_record) + " cannot tell it from " + std::to_string(members) +
         " other effects";
}

}  // namespace servosense::reconcile
