// What `servosense recommend` found, and how it is said, written and shown.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "recommend_inputs.hpp"
#include "servosense/identify/watched_cuts.hpp"

namespace servosense::cli {

struct RecommendAnswer {
  Recommendation found;
  std::vector<WatchedCut> cuts;        ///< evidence
  std::optional<CutsLearned> learned;  ///< from it
  std::vector<double>
      zeroth_order_m;  ///< limit depth of the file's values, a speed of the map each
  std::vector<std::string> remarks;
  std::string verdict;  ///< found, uncertain, none
  std::string sentence;
};

/// Verdict and sentence, and remarks on evidence that does not fit.
void conclude(RecommendAnswer& answer, double probability);

void print_recommendation(const RecommendAnswer& answer);
void print_recommendation_json(const RecommendInputs& inputs, const RecommendAnswer& answer);
Expected<Done> write_recommendation_report(const std::string& path, const std::string& machine,
                                           const RecommendInputs& inputs,
                                           const RecommendAnswer& answer, double probability);

}  // namespace servosense::cli
