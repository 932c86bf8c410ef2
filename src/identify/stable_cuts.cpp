#include "servosense/identify/stable_cuts.hpp"

#include <algorithm>
#include <utility>

#include "quick_stability.hpp"

namespace servosense {
namespace {

double multiplier(const UncertainCut::Possible& possible, const StableCuts::Cut& cut, double rpm) {
  // Tool and structure were accepted when `tool` was made.
  return SemiDiscretization::create(possible.structure, possible.tool, cut.engagement, kQuick)
      ->spectral_radius(rpm, cut.axial_depth_m);
}

}  // namespace

double StableCuts::probability(double rpm, double least) const {
  if (cuts_.empty()) return 1;
  const UncertainCut::Possible middle = tool_.at(belief_.rowwise().mean());
  std::vector<std::pair<double, const Cut*>> order;
  for (const Cut& cut : cuts_) {
    order.emplace_back(multiplier(middle, cut, rpm), &cut);
    if (least > 0.5 && order.back().first >= 1) return 0;
  }
  const std::size_t count = std::min(kNearest, order.size());
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count), order.end(),
                    [](const auto& a, const auto& b) { return a.first > b.first; });
  order.resize(count);
  const auto samples = static_cast<double>(belief_.cols());
  double unstable = 0;
  for (Eigen::Index s = 0; s < belief_.cols(); ++s) {
    const UncertainCut::Possible possible = tool_.at(belief_.col(s));
    unstable += std::any_of(order.begin(), order.end(), [&](const auto& o) {
      return multiplier(possible, *o.second, rpm) >= 1;
    });
    if (unstable > (1 - least) * samples * (1 + 1e-9)) return 0;
  }
  return 1 - unstable / samples;
}

}  // namespace servosense
