// The list of what reconcile decides by: complete, each with its source, and set by name.
#include <set>
#include <string>

#include "check.hpp"
#include "servosense/reconcile/options.hpp"

using namespace servosense;
using namespace servosense::reconcile;

int main() {
  std::set<std::string_view> names;
  for (const Criterion& c : list_of_criteria()) {
    CHECK(names.insert(c.name).second);
    CHECK(!c.unit.empty() && !c.source.empty());
    if (c.kind == CriterionKind::calibrated) CHECK(!c.calibrated_on.empty());
  }
  CHECK(names.size() * sizeof(double) == sizeof(Criteria));

  Options options;
  CHECK_NEAR(options.least_gain(10, 0), 10 * kCriteria.least_gain_in_floors, 1e-12);
  CHECK(set_criterion(options.criteria, "least_gain_in_floors=2").has_value());
  CHECK_NEAR(options.least_gain(10, 0), 20, 1e-12);
  for (const char* wrong :
       {"least_gain_in_floors", "least_gain_in_floors=", "least_gain_in_floors=much",
        "least_gain_in_floors=nan", "least_gain_in_floors=1x"})
    CHECK(!set_criterion(options.criteria, wrong).has_value());
  const auto unknown = set_criterion(options.criteria, "least_gain=1");
  CHECK(!unknown.has_value() && unknown.error().kind == ErrorKind::usage);
  for (const std::string_view name : names)
    CHECK(unknown.error().sentence.find(name) != std::string::npos);
  CHECK_NEAR(options.least_gain(10, 0), 20, 1e-12);
  return check::done();
}
