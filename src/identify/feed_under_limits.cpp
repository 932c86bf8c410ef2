#include "feed_under_limits.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/model/average_cutting.hpp"

namespace servosense {
namespace {

/// Value that a share `probability` of them does not exceed.
double quantile_of(std::vector<double> values, double probability) {
  const auto at =
      static_cast<std::size_t>(std::ceil(probability * static_cast<double>(values.size()) - 1e-9));
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(
                                        std::min(values.size(), std::max<std::size_t>(at, 1)) - 1);
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

}  // namespace

FeedUnderLimits::FeedUnderLimits(const UncertainCut& cut, const CutBelief& belief,
                                 const CutLimits& limits, double probability)
    : cut_(cut), limits_(limits), probability_(probability) {
  const double nominal = cut.tool().force.tangential_coefficient_N_per_m2;
  std::vector<double> factors;
  for (Eigen::Index s = 0; s < belief.cols(); ++s)
    factors.push_back(cut.at(belief.col(s)).tool.force.tangential_coefficient_N_per_m2 / nominal);
  tangential_factor_ = quantile_of(factors, probability);
  if (limits.deflection_m < CutLimits::kNone) {
    constexpr Eigen::Index kMost = 24;  // each costs as much as a stability limit
    for (Eigen::Index s = 0, n = std::min(kMost, belief.cols()); s < n; ++s)
      possible_.push_back(cut.at(belief.col(s * belief.cols() / n)));
  }
  if (const auto& t = cut.tool().throw_m; !t.empty())
    spread_m_ = *std::max_element(t.begin(), t.end()) - *std::min_element(t.begin(), t.end());
  // An offset, normal in both directions, is beyond r with probability exp(-r^2 / 2 s^2) and makes
  // teeth differ by 2 r at most.
  if (cut.tool().teeth > 1)
    spread_m_ += 2 * cut.offset_error_m() * std::sqrt(-2 * std::log(1 - probability));
}

double FeedUnderLimits::torque(double axial_depth_m, double feed_m) const {
  const MillingTool& tool = cut_.tool();
  const AverageCutting average = average_cutting(tool.teeth, tool.radius_m(), axial_depth_m, feed_m,
                                                 engagement_of(tool, cut_.cut()));
  return tangential_factor_ * tool.force.tangential_coefficient_N_per_m2 *
             average.torque.tangential +
         tool.force.tangential_edge_N_per_m * average.torque.tangential_edge;
}

std::vector<ForcedDeflection> FeedUnderLimits::deflections(double spindle_speed_rpm,
                                                           double axial_depth_m) const {
  MillingCut cut = cut_.cut();
  cut.spindle_speed_rpm = spindle_speed_rpm;
  cut.axial_depth_m = axial_depth_m;
  std::vector<ForcedDeflection> all;
  for (const UncertainCut::Possible& p : possible_) all.emplace_back(p.structure, p.tool, cut);
  return all;
}

double FeedUnderLimits::farthest(const std::vector<ForcedDeflection>& deflections,
                                 double feed_m) const {
  std::vector<double> each;
  for (const ForcedDeflection& d : deflections) each.push_back(d.farthest_m(feed_m));
  return quantile_of(std::move(each), probability_);
}

double FeedUnderLimits::removal(double spindle_speed_rpm, double axial_depth_m,
                                double feed_m) const {
  const MillingTool& tool = cut_.tool();
  const double width_m = cut_.cut().direction == MillingDirection::slot
                             ? tool.diameter_m
                             : std::min(cut_.cut().radial_immersion_m, tool.diameter_m);
  return axial_depth_m * width_m * feed_m * tool.teeth * spindle_speed_rpm / 60;
}

double FeedUnderLimits::feed(double spindle_speed_rpm, double axial_depth_m) const {
  double feed_m = limits_.feed_per_tooth_m - spread_m_;
  const double edge = torque(axial_depth_m, 0);
  const double per_feed = torque(axial_depth_m, 1) - edge;
  const double most_torque =
      std::min(limits_.torque_Nm, limits_.power_W / rad_s_from_rpm(spindle_speed_rpm));
  if (std::isfinite(most_torque) && per_feed > 0)
    feed_m = std::min(feed_m, (most_torque - edge) / per_feed);
  if (!(feed_m > spread_m_)) return 0;
  if (!(limits_.deflection_m < CutLimits::kNone)) return feed_m;
  const auto bent = deflections(spindle_speed_rpm, axial_depth_m);
  if (farthest(bent, feed_m) <= limits_.deflection_m) return feed_m;
  double low = spread_m_, high = feed_m;
  if (farthest(bent, low) > limits_.deflection_m) return 0;
  while (high - low > 0.01 * high) {
    const double middle = 0.5 * (low + high);
    (farthest(bent, middle) > limits_.deflection_m ? high : low) = middle;
  }
  return low;
}

FeedAndDepth FeedUnderLimits::best(double spindle_speed_rpm, double deepest_m) const {
  const bool limited =
      std::isfinite(std::min(limits_.torque_Nm, limits_.power_W)) || !possible_.empty();
  // A shallower cut can remove more when torque or deflection limit the feed of the deeper one.
  const int looks = limited ? 12 : 1;
  FeedAndDepth best;
  for (int i = looks; i > 0; --i) {
    const double depth_m = deepest_m * i / looks;
    // Shallower ones cannot catch up even with the greatest feed.
    if (removal(spindle_speed_rpm, depth_m, limits_.feed_per_tooth_m - spread_m_) <=
        best.removal_m3_s)
      break;
    const double feed_m = feed(spindle_speed_rpm, depth_m);
    const double removed = removal(spindle_speed_rpm, depth_m, feed_m);
    if (removed > best.removal_m3_s) best = {depth_m, feed_m, removed};
  }
  return best;
}

std::vector<LimitAtCut> FeedUnderLimits::at(double spindle_speed_rpm, const FeedAndDepth& best,
                                            bool stability_binds) const {
  const double torque_Nm = torque(best.axial_depth_m, best.feed_per_tooth_m);
  std::vector<LimitAtCut> all;
  const auto add = [&](const char* name, double limit, double value) {
    if (std::isfinite(limit)) all.push_back({name, limit, value, value >= 0.98 * limit});
  };
  add("spindle_speed_rpm", limits_.greatest_rpm, spindle_speed_rpm);
  add("axial_depth_m", limits_.axial_depth_m, best.axial_depth_m);
  add("feed_per_tooth_m", limits_.feed_per_tooth_m, best.feed_per_tooth_m + spread_m_);
  add("torque_Nm", limits_.torque_Nm, torque_Nm);
  add("power_W", limits_.power_W, torque_Nm * rad_s_from_rpm(spindle_speed_rpm));
  if (std::isfinite(limits_.deflection_m))
    add("deflection_m", limits_.deflection_m,
        farthest(deflections(spindle_speed_rpm, best.axial_depth_m), best.feed_per_tooth_m));
  if (stability_binds) all.push_back({"stability", best.axial_depth_m, best.axial_depth_m, true});
  return all;
}

}  // namespace servosense
