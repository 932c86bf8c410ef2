// Every limit by which reconcile decides: its value, of what kind it is, where it comes from and
// what it was set on. criteria.inc is the list; reports print it.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "servosense/core/expected.hpp"

namespace servosense::reconcile {

enum class CriterionKind { statistical, physical, calibrated };
[[nodiscard]] const char* name_of(CriterionKind kind) noexcept;

struct Criteria {
#define SERVOSENSE_CRITERION(name, value, ...) double name = value;
#include "servosense/reconcile/criteria.inc"
#undef SERVOSENSE_CRITERION
};

/// As they are unless somebody sets one.
inline constexpr Criteria kCriteria{};

/// One line of the list.
struct Criterion {
  std::string_view name;
  double Criteria::*value;
  std::string_view unit;
  CriterionKind kind;
  std::string_view source;
  std::string_view calibrated_on;  ///< empty: on nothing
};
[[nodiscard]] std::span<const Criterion> list_of_criteria();

/// Sets one by "NAME=VALUE". Usage error with the list where there is none of that name.
Expected<Done> set_criterion(Criteria& criteria, const std::string& assignment);

}  // namespace servosense::reconcile
