#include "chart_tool.hpp"

#include <algorithm>

#include "servosense/io/report.hpp"

namespace servosense::cli {

Expected<Done> chart_knows(const MillingTool& tool, const MillingCut& cut,
                           std::vector<std::string>& remarks) {
  for (const double broken : tool.broken_fraction)
    if (broken > 0)
      return data_error(
          "[tool] broken_teeth: no chart knows broken teeth, whose place the tooth behind takes; "
          "remove the key, or ask 'servosense simulate milling'");
  if (!tool.throw_m.empty()) {
    const auto [low, high] = std::minmax_element(tool.throw_m.begin(), tool.throw_m.end());
    if (*high - *low >= cut.feed_per_tooth_m)
      return data_error(
          "the run-out of " + report::Cell(1e6 * (*high - *low), 3).text +
          " um is as large as the feed per tooth, so that teeth miss the cut; no chart knows that: "
          "raise the feed or ask 'servosense simulate milling'");
    if (*high > *low)
      remarks.push_back(
          "run-out does not move the limit of stability while every tooth cuts, and is not used");
  }
  if (tool.force.size_effect_exponent != 0)
    remarks.push_back(
        "the size effect is not used: the tangential coefficient is that at its reference chip");
  return Done{};
}

}  // namespace servosense::cli
