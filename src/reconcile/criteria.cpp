#include "servosense/reconcile/criteria.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace servosense::reconcile {
namespace {

using enum CriterionKind;

constexpr Criterion kList[] = {
#define SERVOSENSE_CRITERION(name, value, ...) {#name, &Criteria::name, __VA_ARGS__},
#include "servosense/reconcile/criteria.inc"
#undef SERVOSENSE_CRITERION
};

}  // namespace

const char* name_of(CriterionKind kind) noexcept {
  switch (kind) {
    case statistical:
      return "statistical";
    case physical:
      return "physical";
    case calibrated:
      return "calibrated";
  }
  return "calibrated";
}

std::span<const Criterion> list_of_criteria() { return kList; }

Expected<Done> set_criterion(Criteria& criteria, const std::string& assignment) {
  const std::size_t sign = assignment.find('=');
  const std::string name = assignment.substr(0, sign);
  const auto found =
      std::ranges::find_if(kList, [&](const Criterion& c) { return c.name == name; });
  if (found == std::end(kList)) {
    std::string all;
    for (const Criterion& c : kList) all.append(all.empty() ? "" : ", ").append(c.name);
    return usage_error("there is no criterion '" + name + "'; there are " + all);
  }
  const std::string text = sign == std::string::npos ? "" : assignment.substr(sign + 1);
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0' || !std::isfinite(value))
    return usage_error("--criterion takes NAME=VALUE with a number, not '" + assignment + "'");
  criteria.*found->value = value;
  return Done{};
}

}  // namespace servosense::reconcile
