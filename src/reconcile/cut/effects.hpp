// What a cut may lack: one table, a line an effect. How a number acts on the cut is Unknown::Kind
// (fit.hpp, state.cpp); what the effect is, and what it is called, model/cutting_effects.hpp.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "reconcile/cut/fit.hpp"
#include "servosense/reconcile/problem.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {

/// One effect as a fit has it.
struct FittedEffect {
  const CutFit& fit;
  const Family& family;
  std::size_t position;  ///< of the family in the fit
  double feed_per_tooth_m;
  double tangential_N_per_m2;  ///< of the file
  const Criteria& criteria;
  [[nodiscard]] double value(std::size_t k) const { return fit.own[position][k]; }
  [[nodiscard]] double error(std::size_t k) const {
    return fit.value_errors[fit.first[position] + k];
  }
  [[nodiscard]] const Unknown& unknown(std::size_t k) const { return family.unknowns[k]; }
};

struct CutEffect {
  const CuttingEffectInfo* info;
  /// The ways in which it may show, with where their fits start from.
  void (*families)(const CutFitter& cut, const CutFit& base, std::vector<Family>& all);
  /// The rule of physics that it breaks; empty when it keeps them all.
  std::string (*objection)(const FittedEffect& effect);
  /// Its parameters, or their standard errors.
  std::vector<NamedValue> (*parameters)(const FittedEffect& effect, bool errors);
};

/// Of this name, and nothing else known of it.
[[nodiscard]] FoundEffect found_effect(const CuttingEffectInfo& info);

[[nodiscard]] std::span<const CutEffect> cut_effects();
[[nodiscard]] const CutEffect& cut_effect(const CuttingEffectInfo* info);

}  // namespace servosense::reconcile
