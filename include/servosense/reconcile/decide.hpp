// Which of the candidates is missing? Floors, ranking, naming, pruning and proof, for any data that
// can be written as a Problem.
#pragma once

#include <string>
#include <vector>

#include "servosense/reconcile/options.hpp"
#include "servosense/reconcile/problem.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {

/// A candidate that was accepted, with everything needed to put it into a model.
struct Accepted {
  std::size_t candidate = 0;  ///< index
  std::vector<double> theta;
  std::vector<double> coefficients;
  Meaning meaning;
};

struct Decision {
  Report report;  ///< without channel, machine file and monitors
  std::vector<Accepted> accepted;
  std::vector<std::string> proxies;  ///< refuted: another law was seen to fit better
  std::vector<std::size_t> failed;   ///< candidates that were chosen, and then failed a guard
  double loss = 0;                   ///< mean square of rows left out of the fit, with the effects
  std::vector<double> known;         ///< coefficients of the known terms, in their order
  std::vector<double> known_errors;
  /// Coefficients without any effect, with the first, with the first two...: those of the known
  /// terms, then those of the effects' columns.
  std::vector<std::vector<double>> steps;
};

/// Candidates whose columns, at the middle of their ranges, agree once the known terms are removed.
[[nodiscard]] std::vector<Alike> classes_of(const Problem& problem,
                                            const std::vector<Candidate>& candidates,
                                            const Options& options);

/// Stages 3 to 8. Deterministic: neither clock nor number of threads changes the answer.
[[nodiscard]] Decision decide(const Problem& problem, const std::vector<Candidate>& candidates,
                              const Options& options);

}  // namespace servosense::reconcile
