// Effects that the machine file has. Their sizes are refitted with inertia and friction; what they
// depend on otherwise, a frequency, a width, a phase, is here: a wrong value of the model is no
// missing effect. Gauss-Newton beside all that the model has. A parameter whose slope the record
// does not tell from the rest stays as it is.
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "reconcile/drive/workflow.hpp"
#include "reconcile/select/compare.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

constexpr int kRounds = 8;
constexpr double kSlope = 1e-3;  // change of a parameter for its slope, relative or in rad
constexpr double kStep = 0.2;    // most in one round

bool is_phase(const EffectSetting& s, std::size_t p) {
  return kDriveEffectTraits[s.effect].search[p].role == EffectRole::phase;
}

/// By `by`, in shares of its value, of a phase in rad.
void move(EffectSetting& s, std::size_t p, double by) {
  double& value = s.parameters[p].value[0];
  value = is_phase(s, p) ? std::remainder(value + by, kTwoPi) : value * std::exp(by);
}

/// A share that the file may leave open: of the friction, on a load that swings.
bool is_share(const EffectParameter& key) { return key.optional && key.low == 0 && key.high == 1; }

}  // namespace

/// The parameters that may be refitted, in order. Not those of an eccentric encoder: its phase is
/// found with the true angle (known_eccentricity.cpp), its amplitude is its size. Nor those of
/// backlash and bristles: a load that flies lands at this reversal or at the next, which is no
/// slope.
std::vector<KnownParameter> DriveWorkflow::known_parameters() const {
  std::vector<KnownParameter> all;
  for (std::size_t i = 0; i < given_.effects.count; ++i) {
    const EffectSetting& s = given_.effects.settings[i];
    const std::string name = kDriveEffects[s.effect].name;
    if (name == kEccentricity || name == kConstantLoad || name == kBacklash ||
        name == "presliding-hysteresis")
      continue;
    for (std::size_t p = 0; p < kDriveEffects[s.effect].parameter_count(); ++p)
      if (s.parameters[p].count == 1 && !is_share(kDriveEffects[s.effect].parameters[p]) &&
          (s.scalar(p) > 0 || is_phase(s, p)) &&
          kDriveEffectTraits[s.effect].search[p].role != EffectRole::order)
        all.push_back({i, p, 0});
  }
  return all;
}

/// One round; false where nothing is off by more than its error.
bool DriveWorkflow::step_known_effects() {
  struct Slope {
    KnownParameter of;
    Column column;
  };
  add_known_terms(true);
  const FitRows rows = fit_rows(problem_, options_.blocks);
  Regression r = regression_of_known(problem_, rows);
  std::vector<Slope> slopes;
  for (const KnownParameter& k : known_parameters()) {
    const EffectSetting& s = given_.effects.settings[k.setting];
    EffectSetting more = s, less = s;
    move(more, k.parameter, kSlope);
    move(less, k.parameter, -kSlope);
    Column above = signals_->response(more, data_.model);
    const Column below = signals_->response(less, data_.model);
    if (above.empty() || below.empty()) continue;
    for (std::size_t row = 0; row < above.size(); ++row)
      above[row] = (above[row] - below[row]) / (2 * kSlope);
    // What is the size of another term, or too small to be seen, is not told.
    if (!(r.share_left(above) > criteria_.least_testable)) continue;
    r.add(above);
    slopes.push_back({k, std::move(above)});
  }
  const Fit fit = r.fit();
  bool any = false;
  auto at = static_cast<Eigen::Index>(problem_.known.size());
  for (const Slope& slope : slopes) {
    EffectSetting& s = given_.effects.settings[slope.of.setting];
    const double across = fit.coefficients(at), error = fit.standard_errors(at);
    ++at;
    const auto [size, size_error] = fitted(fit, kDriveEffects[s.effect].name).value_or(Told{});
    const bool turned = is_phase(s, slope.of.parameter);
    // What does not show has no parameters to speak of; a phase may be off by any angle.
    const double all = turned ? std::hypot(size, across) : std::abs(size);
    if (!(all > criteria_.certain_standard_errors * std::max(size_error, turned ? error : 0)) ||
        !(std::abs(across) > criteria_.certain_standard_errors * error))
      continue;
    const double by = turned ? std::atan2(across, size) : std::clamp(across / size, -kStep, kStep);
    const double from = data_.model.effects.settings[slope.of.setting].scalar(slope.of.parameter);
    EffectSetting moved = s;
    move(moved, slope.of.parameter, by);
    const double ratio = moved.scalar(slope.of.parameter) / from;
    if (!turned &&
        !(ratio < criteria_.largest_model_error && ratio > 1 / criteria_.largest_model_error))
      continue;
    s = moved;
    std::erase_if(refitted_, [&](const KnownParameter& k) {
      return k.setting == slope.of.setting && k.parameter == slope.of.parameter;
    });
    refitted_.push_back(slope.of);
    refitted_.back().error = error / all * (turned ? 1 : moved.scalar(slope.of.parameter));
    any = true;
  }
  return any;
}

/// Shares that the file leaves open, over all that they can be: where friction acts beyond a spring
/// it winds this up, which bends the way too much for slopes.
void DriveWorkflow::find_open_shares() {
  constexpr unsigned kSteps = 10;
  for (std::size_t i = 0; i < given_.effects.count; ++i) {
    const EffectInfo& info = kDriveEffects[given_.effects.settings[i].effect];
    for (std::size_t p = 0; p < info.parameter_count(); ++p) {
      if (!is_share(info.parameters[p]) || data_.model.effects.settings[i].parameters[p].count > 0)
        continue;
      auto& share = given_.effects.settings[i].parameters[p];
      const EffectSetting::Values as_given = share;
      const Fit as_it_was = fit_of_known();
      Fit best_fit = as_it_was;
      double best = share.value[0];
      share.count = 1;
      for (unsigned k = 0; k <= kSteps; ++k) {
        share.value[0] = static_cast<double>(k) / kSteps;
        Fit fit = fit_of_known();
        if (!(fit.loss < best_fit.loss)) continue;
        best = share.value[0];
        best_fit = std::move(fit);
      }
      // What leaves much of the gap may have another cause that acts at reversals: backlash, say.
      const bool shows = best_fit.loss < (1 - criteria_.carries_gap) * as_it_was.loss &&
                         standard_errors_between(as_it_was.block_loss, best_fit.block_loss) >
                             criteria_.class_standard_errors;
      if (!shows) {
        share = as_given;
        continue;
      }
      share.value[0] = best;
      std::erase_if(refitted_,
                    [&](const KnownParameter& k) { return k.setting == i && k.parameter == p; });
      refitted_.push_back({i, p, 0.5 / kSteps});
    }
  }
}

/// Of the effects that the file has, as long as it leaves less.
void DriveWorkflow::refit_known_effects() {
  find_open_shares();
  if (known_parameters().empty()) return;
  double least = fit_of_known().loss;
  for (int round = 0; round < kRounds; ++round) {
    const DriveModelConfig before = given_;
    const std::vector<KnownParameter> refitted = refitted_;
    if (!step_known_effects()) return;
    const double loss = fit_of_known().loss;
    if (!(loss < least)) {
      given_ = before;
      refitted_ = refitted;
      return;
    }
    least = loss;
  }
}

void DriveWorkflow::report_known_effects(Report& report) const {
  for (const KnownParameter& k : refitted_) {
    const EffectSetting& from = data_.model.effects.settings[k.setting];
    report.recalibrated.push_back(
        {std::string(kDriveEffects[from.effect].name) + " " +
             kDriveEffects[from.effect].parameters[k.parameter].key_for(data_.turns()),
         from.scalar(k.parameter), given_.effects.settings[k.setting].scalar(k.parameter),
         k.error});
  }
}

}  // namespace servosense::reconcile
