// A spring is a line: a chain of cables or a stop, whose force grows otherwise, is none. The force
// is computed from sines.
#include <algorithm>
#include <cstdio>

#include "check.hpp"
#include "servosense/reconcile/drive.hpp"
#include "sine_motion.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

template <typename Force>
Report report_of(Force force) {
  const auto outcome = reconcile_drive(
      sine_axis([&](double, double x, double direction) { return 60 * direction + force(x); }), {});
  CHECK(outcome);
  return outcome ? outcome->report : Report{};
}

}  // namespace

int main() {
  const Report line = report_of([](double x) { return 200 * (x - 0.1); });
  CHECK(line.effects.size() == 1);
  for (const FoundEffect& e : line.effects) {
    CHECK_TEXT(e.name, "spring-load");
    CHECK_NEAR(e.parameters.at(0).values.at(0), 200, 2);
  }
  for (const double stiff : {3000.0, 800.0}) {
    const Report chain = report_of([&](double x) { return stiff * x * x; });
    std::printf("%g x^2: gap %.3g N, %zu names\n", stiff, chain.gap_before, chain.effects.size());
    CHECK(chain.gap_before > 10 * chain.floors.used);
    CHECK(
        std::ranges::none_of(chain.effects, [](const auto& e) { return e.name == "spring-load"; }));
  }
  return check::done();
}
