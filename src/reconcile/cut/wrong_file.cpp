// A file that is of another cut: numbers and axes that no recalibration moves. Effects would be
// named for them, so they are tried first, wherever a gap is left.
#include <array>
#include <cmath>
#include <complex>
#include <limits>

#include "reconcile/cut/workflow.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

constexpr int kMostTeeth = 12;
constexpr int kOrders = 24;

CutAverage exchanged(CutAverage average) {
  const auto bins = static_cast<Eigen::Index>(average.bins);
  for (CutBlock& b : average.blocks)
    for (Eigen::VectorXd* v : {&b.mean, &b.count}) {
      const Eigen::VectorXd x = v->head(bins);
      v->head(bins) = v->tail(bins).eval();
      v->tail(bins) = x;
    }
  return average;
}

/// Mean square of the force at orders of the rotation up to kOrders, over all blocks fitted.
std::array<double, kOrders> levels_of_orders(const CutAverage& average) {
  const auto bins = static_cast<Eigen::Index>(average.bins);
  std::array<double, kOrders> out{};
  for (std::size_t l = 0; l < average.levels.size(); ++l) {
    const Eigen::VectorXd mean = average.mean_of(l, false).first;
    const double share = 0.5 / static_cast<double>(average.levels.size());
    for (int k = 1; k <= kOrders; ++k)
      for (const Eigen::Index from : {Eigen::Index{0}, bins}) {
        std::complex<double> c = 0;
        for (Eigen::Index i = 0; i < bins; ++i)
          c += mean(from + i) *
               std::polar(1.0 / static_cast<double>(bins),
                          -k * average.levels[l].angles.means()[static_cast<std::size_t>(i)]);
        out[static_cast<std::size_t>(k - 1)] += share * 2 * std::norm(c);
      }
  }
  return out;
}

/// Of what goes with so many teeth alike nothing is at other orders.
double off_order(const std::array<double, kOrders>& spectrum, int teeth) {
  double off = 0;
  for (int k = 1; k <= kOrders; ++k)
    if (k % teeth != 0) off += spectrum[static_cast<std::size_t>(k - 1)];
  return off;
}

Error exchanged_axes() {
  return data_error(
      "the forces fit with x and y exchanged: the model feeds along x; check which axis of the "
      "sensor lies along the feed, and exchange the columns of the trace");
}

}  // namespace

bool CuttingWorkflow::worth_a_look() const {
  return root(beyond_noise(base_)) >= criteria_.worth_another_file * least_gain();
}

/// The error when another reading of the file explains the gap.
std::optional<Error> CuttingWorkflow::of_another_file() const {
  if (!worth_a_look()) return std::nullopt;
  const double enough =
      criteria_.another_file_leaves * criteria_.another_file_leaves * beyond_noise(base_);
  const auto left_by = [&](const CutAverage& average, const CutState& given) {
    CutFitter fitter(average, given, data_.cut.feed_per_tooth_m, criteria_);
    const CutFit fit = fitter.calibrate(fitter.calibrate(data_.channel == "tool"));
    const bool cuts = fit.state.coefficients[0] > 0 && fit.state.coefficients[1] > 0;
    return cuts ? beyond_noise(fit) : std::numeric_limits<double>::infinity();
  };
  const auto fits = [&](const CutAverage& average, const CutState& given) {
    return left_by(average, given) < enough;
  };
  CutState given = given_;
  given.circular_paths = fitter_->circular_paths();
  if (fits(exchanged(average_), given)) return exchanged_axes();
  CutState other = given;
  if (given_.cut.direction != MillingDirection::slot) {
    const bool up = given_.cut.direction == MillingDirection::up;
    other.cut.direction = up ? MillingDirection::down : MillingDirection::up;
    if (fits(average_, other))
      return data_error(std::string("the forces are those of ") + (up ? "down" : "up") +
                        " milling, [cut] direction says " + (up ? "up" : "down") + "; check it");
    other = given;
  }
  const MillingTool& tool = given_.tool;
  if (!tool.throw_m.empty() || !tool.broken_fraction.empty() || !tool.tooth_angle_rad.empty())
    return std::nullopt;
  const std::array<double, kOrders> spectrum = levels_of_orders(average_);
  // One tooth alone may be what is left of a tool that has more.
  for (int teeth = 2; teeth <= kMostTeeth; ++teeth) {
    const double most = criteria_.most_of_runout * beyond_noise(base_),
                 off = off_order(spectrum, teeth);
    if (teeth == tool.teeth || off > most) continue;
    other.tool.teeth = teeth;
    const double left = left_by(average_, other);
    if (left < most && left - off < enough)
      return data_error("the forces are those of " + std::to_string(teeth) +
                        " teeth, [tool] teeth says " + std::to_string(tool.teeth) +
                        "; check it, and the feed per tooth");
  }
  return std::nullopt;
}

/// A fit that leaves nothing cannot tell forces from exchanged ones, but asks for another ratio.
std::optional<Error> CuttingWorkflow::of_exchanged_axes() const {
  const double radial = base_.state.coefficients[1] / base_.state.coefficients[0];
  if (cuts() && !worth_a_look() &&
      (radial < criteria_.least_radial_ratio || radial > criteria_.most_radial_ratio) &&
      std::abs(radial) > criteria_.radial_ratio_off * data_.tool.force.radial_ratio)
    return exchanged_axes();
  return std::nullopt;
}

}  // namespace servosense::reconcile
