// What a report of the workflow is worth, given the truth.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "case.hpp"
#include "json.hpp"

namespace blind {

struct SaidEffect {
  std::string name;
  std::vector<std::string> others;  ///< of its class
  double confidence = 0;
};

/// One scored case: a line of the results file.
struct Row {
  std::string name, variant = "plain";
  std::uint64_t seed = 0;
  std::string expect;
  std::vector<HiddenEffect> truth;  ///< parameters not kept
  std::string verdict;              ///< of the workflow; "refused" or "failed" without a report
  std::vector<SaidEffect> said;
  /// right, none, unexplained, wrong, refused; for pairs both, one; "+extra" behind right, both or
  /// one.
  std::string outcome;
  double explained = 0;  ///< share of the gap beyond the noise, by all names; NaN without a gap
  double closure = 0;    ///< share of the oracle's gap; NaN when the oracle has nothing to close
  std::vector<std::pair<std::string, double>> parameter_errors;  ///< relative
  double seconds = 0;                                            ///< of processor time
  std::vector<std::string> comparator;                           ///< names of the plain library
  std::string comparator_outcome;
  bool motion = false;  ///< the report says what to record to see the effect or to tell it apart
};

/// What the workflow said against what is true.
Row score(const Case&, const Json& report, double seconds);

/// right, none, unexplained, wrong, both, one: the same rule for the workflow and the comparator.
std::string outcome_of(const std::string& expect, const std::vector<HiddenEffect>& truth,
                       const std::vector<SaidEffect>& said, bool agrees);

std::string row_json(const Row&);
Row row_of(const Json&);

/// One of the hidden effects, or a class of at most three that contains it.
bool is_true(const SaidEffect&, const std::vector<HiddenEffect>& truth);

/// What must hold even on a small set: every case answered, no name that is wrong and none where
/// nothing is missing, and four of five single effects of strength 4 and more found. Says what did
/// not hold.
bool acceptable(const std::vector<Row>&, std::string& why);

}  // namespace blind
