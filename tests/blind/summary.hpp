// The tables over many scored cases: what the goals ask for, beside what was reached.
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "score.hpp"
#include "statistics.hpp"

namespace blind {

/// Classes of strength, strongest first.
struct StrengthClass {
  const char* title;
  double from, below;
};
inline constexpr std::array<StrengthClass, 4> kStrengthClasses{
    {{">= 4", 4, 1e300}, {"2 to 4", 2, 4}, {"1 to 2", 1, 2}, {"< 1", -1, 1}}};

/// Index into kStrengthClasses.
std::size_t class_of(double strength);

/// A figure that has a goal: a rate, or a quantile of what was measured.
struct GoalFigure {
  std::string title;
  std::string goal;
  Rate rate;                   ///< unless it is a quantile
  std::vector<double> values;  ///< of the quantile
  double q = -1;
};

/// Cases of one kind by what was said about them. `one`: of two.
struct Outcomes {
  std::size_t of = 0, right = 0, one = 0, wrong = 0, extra = 0, none = 0, unexplained = 0,
              refused = 0, failed = 0;
  void add(const std::string& outcome);
  [[nodiscard]] std::size_t abstained() const { return none + unexplained + refused; }
};

struct Calibration {
  double from = 0, to = 1;
  double confidence = 0;  ///< sum
  Rate right;
};

struct Summary {
  std::vector<GoalFigure> goals;
  std::map<std::string, Outcomes> cells, comparator;
  std::map<std::string, std::array<Outcomes, kStrengthClasses.size()>> strength;  ///< by domain
  std::vector<std::pair<double, Outcomes>> sweep;  ///< by lower end of narrower bins of strength
  /// What is true, and for each class of strength what was said how often. What has no strength,
  /// nulls and outside cases, is in the first.
  std::map<std::string, std::array<std::map<std::string, std::size_t>, kStrengthClasses.size()>>
      confusion, nameless;
  std::vector<Calibration> calibration;
  double brier = 0;
  std::size_t names = 0;
  std::map<std::string, std::vector<double>> parameter_errors;  ///< relative, by effect and key
  std::vector<double> closures, seconds;
  std::vector<std::string> wrong, missed;  ///< cases, with what was said
};

/// Upper end of the last bin of `sweep`, for drawing.
inline constexpr double kSweepEnd = 256;

Summary summarise(const std::vector<Row>&);
/// Markdown, to be pasted into docs/blind-tests.md.
std::string summary_text(const Summary&);
std::string summary_json(const Summary&);

}  // namespace blind
