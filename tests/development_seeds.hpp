// Seeds that were looked at case by case, or that a rule was made for. They keep what was reached
// from getting lost; figures come from others. A list grows and never shrinks.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

namespace development {

struct Seeds {
  std::uint64_t from, to;  ///< both included
  const char* what;
};

/// Of `reconcile`: tests/blind.
inline constexpr Seeds kBlind[] = {
    {0, 99999, "rules were made on them"},
    {100000, 199999, "round 1"},
    {500000, 529999, "second generators"},
    {1100000, 1199999, "round 2"},
    {2100000, 2199999, "round 3"},
    {3100000, 3199999, "round 4"},
    {4100000, 4199999, "round 5"},
    {5100000, 5199999, "round 6"},
    {6100000, 6199999, "round 7"},
    {7100000, 7199999, "round 8"},
    {8100000, 8199999, "round 9"},
    {9100000, 9299999, "round 10, its answers read one by one"},
    {9300000, 9300019, "cuts that forget, loads that jump: answers read one by one"},
    {9600000, 9600000, "machines of text books: answers read one by one"},
    {10200000, 10299999, "nulls of all generators: answers read one by one"},
    {10300000, 10499999, "confidence and what is left: rules were made on them"},
    {10500000, 10599999, "machines of text books: answers read one by one"},
};

/// Of the monitors: tests/detection.
inline constexpr Seeds kDetection[] = {
    {0, 99999, "rules were made on them"},
    {100000, 100299, "diagnosed cut by cut, and scored again"},
    {150000, 150999, "the shift of eight hours"},
    {300000, 300149, "programs"},
    {700000, 749999, "thresholds, stable speeds"},
    {760000, 760149, "scored, then diagnosed"},
    {810000, 823999, "one cause, several alarms"},
    {830000, 830149, "tooth breakage beside chatter"},
    {850000, 850099, "stable speeds"},
    {860000, 860039, "sees from"},
    {865000, 866030, "pockets"},
    {870000, 879999, "faults"},
    {880000, 882199, "lines of chatter"},
    {890000, 890299, "lines of chatter, scored, then diagnosed"},
    {907000, 907149, "lines of chatter, scored, then diagnosed"},
    {905000, 906999, "sensors of chatter"},
    {910000, 910099, "sensors of chatter and lines beside a belt, scored, then diagnosed"},
    {908000, 908049, "lines of chatter, scored"},
    {909000, 909099, "lines of chatter, scored, then diagnosed"},
    {912000, 912099, "lines beside a belt, scored"},
    {913000, 913099, "lines beside a belt, scored, then diagnosed"},
    {914000, 914099, "lines beside a belt, scored, then diagnosed"},
    {915000, 915099, "lines of chatter, scored, then diagnosed"},
    {916000, 916099, "lines of chatter, scored"},
    {917000, 917099, "lines beside a belt, scored"},
    {920000, 920299, "the study with lines, scored"},
    {925000, 925099, "the study with lines, scored"},
    {930000, 930099, "the study with lines, scored"},
};

/// Of `identify idle`: tests/cli. A seed stands for those that a test derives from it.
inline constexpr Seeds kIdle[] = {
    {1, 12, "rules were made on them"},
    {701, 712, "power_effort, scored and read one by one"},
    {801, 801, "torque_saturation, scored"},
    {811, 815, "torque_saturation, scored and read one by one"},
    {1411, 1464, "torque_saturation, ramps alike, rules were made on them"},
    {2001, 2020, "warm_motor, scored"},
    {3500, 3503, "torque_saturation, scored"},
    {31000, 31005, "two_encoders, scored and read one by one"},
};

/// What the seeds of [from, from + count) were used for before; null when no one has seen them.
inline const char* use_of(std::span<const Seeds> list, std::uint64_t from, std::uint64_t count) {
  const auto seen = std::ranges::find_if(
      list, [&](const Seeds& s) { return from <= s.to && from + count > s.from; });
  return seen == list.end() ? nullptr : seen->what;
}

}  // namespace development
