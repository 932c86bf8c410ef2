// Forces of a rigid tool: the curve of each tooth, summed over layers and teeth.
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "reconcile/cut/chip.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kStraight = 1e-4;  // rad of lag: the layers of a zone cut at once

/// Force per depth of one tooth over its angle: x and y of Kt, Kr and, when `Values` is 8, Kte and
/// Kre, straight between the points. What is asked for are its first and second integral.
template <int Values>
class ToothCurve {
  using Force = Eigen::Array<double, Values, 1>;
  static constexpr Eigen::Index kSteps = ArcPoints::kSteps;

 public:
  ToothCurve(const CuttingForceLaw& law, const ArcPoints& arc, const Eigen::ArrayXd& room_m)
      : start_(arc.start_rad), step_(arc.step_rad), per_step_(1 / arc.step_rad) {
    once_[0].setZero();
    twice_[0].setZero();
    for (Eigen::Index k = 0; k <= kSteps; ++k) {
      const double s = arc.sine(k), c = arc.cosine(k);
      const double h = std::max(0.0, room_m(k));
      double area = h;
      if (law.size_effect_exponent != 0 && h > 0)
        area *= std::pow(h / law.size_effect_reference_m, -law.size_effect_exponent);
      const double edge = h > 0 ? 1 : 0;
      const auto i = static_cast<std::size_t>(k);
      Force& now = force_[i];
      now.template head<4>() << -area * c, area * s, -area * s, -area * c;
      if constexpr (Values == 8)
        now.template tail<4>() << -edge * c, edge * s, -edge * s, -edge * c;
      if (k == 0) continue;
      const Force& before = force_[i - 1];
      once_[i] = once_[i - 1] + 0.5 * step_ * (before + now);
      twice_[i] = twice_[i - 1] + step_ * (once_[i - 1] + step_ / 6 * (2 * before + now));
    }
  }

  [[nodiscard]] double end() const { return start_ + static_cast<double>(kSteps) * step_; }
  [[nodiscard]] double start() const { return start_; }

  [[nodiscard]] Force once(double theta) const {
    const double x = (theta - start_) * per_step_;
    if (x <= 0) return Force::Zero();
    if (x >= static_cast<double>(kSteps)) return once_[kSteps];
    const auto k = static_cast<std::size_t>(x);
    const double part = x - static_cast<double>(k);
    return once_[k] + part * step_ * (force_[k] + 0.5 * part * (force_[k + 1] - force_[k]));
  }
  [[nodiscard]] Force twice(double theta) const {
    const double x = (theta - start_) * per_step_;
    if (x <= 0) return Force::Zero();
    if (x >= static_cast<double>(kSteps)) return twice_[kSteps] + (theta - end()) * once_[kSteps];
    const auto k = static_cast<std::size_t>(x);
    const double part = x - static_cast<double>(k), d = part * step_;
    return twice_[k] +
           d * (once_[k] + 0.5 * d * (force_[k] + part / 3 * (force_[k + 1] - force_[k])));
  }

 private:
  double start_, step_, per_step_;
  std::array<Force, static_cast<std::size_t>(kSteps) + 1> force_, once_, twice_;
};

/// Angles within one turn, rising, and where each of them stood.
struct Rising {
  std::vector<double> angle_rad;
  std::vector<Eigen::Index> from;  // empty: in their order already
  explicit Rising(std::span<const double> angles) : angle_rad(angles.begin(), angles.end()) {
    for (double& a : angle_rad) a -= kTwoPi * std::floor(a / kTwoPi);
    if (std::is_sorted(angle_rad.begin(), angle_rad.end())) return;
    from.resize(angle_rad.size());
    std::iota(from.begin(), from.end(), Eigen::Index{0});
    const std::vector<double> unsorted = angle_rad;
    const auto at = [&](Eigen::Index i) { return unsorted[static_cast<std::size_t>(i)]; };
    std::sort(from.begin(), from.end(), [&](auto a, auto b) { return at(a) < at(b); });
    for (std::size_t k = 0; k < from.size(); ++k) angle_rad[k] = at(from[k]);
  }
};

/// `Values`: twice the columns.
template <int Values>
Eigen::MatrixXd columns_of(const CutState& state, double feed_per_tooth_m,
                           std::span<const double> angles_rad) {
  using Force = Eigen::Array<double, Values, 1>;
  const Rising angles(angles_rad);
  std::vector<Force> sum(angles_rad.size(), Force::Zero());
  const ArcPoints arc(engagement_of(state));
  const double lag = total_lag(state);
  const double blur = std::max(1e-6, state.blur_rad);
  for (const Zone& zone : zones_of(state.tool)) {
    const double low = lag * zone.low, high = lag * zone.high;
    const bool straight = std::abs(high - low) < kStraight;
    const double share = (zone.high - zone.low) / (straight ? blur : (high - low) * blur);
    for (const std::size_t tooth : zone.teeth) {
      const ToothCurve<Values> curve(state.tool.force, arc,
                                     room_m(state, zone, tooth, feed_per_tooth_m, arc));
      double ahead = pitch_angle(state.tool, tooth) + state.zero_rad;
      ahead -= kTwoPi * std::floor(ahead / kTwoPi);
      const double first = curve.start() + std::min(low, high) - blur / 2;
      const double last = curve.end() + std::max(low, high) + blur / 2;
      // In the cut only: the tip has turned by `ahead` less some turns more than the angle says.
      for (double more = ahead + kTwoPi * std::floor((first - ahead) / kTwoPi); more < last;
           more += kTwoPi) {
        const auto begin = angles.angle_rad.begin(), end = angles.angle_rad.end();
        const auto from = std::upper_bound(begin, end, first - more);
        const auto to = std::lower_bound(from, end, last - more);
        for (auto it = from; it != to; ++it) {
          const double at = *it + more;
          Force& force = sum[static_cast<std::size_t>(it - begin)];
          if (straight) {
            const double middle = at - (low + high) / 2;
            force += (curve.once(middle + blur / 2) - curve.once(middle - blur / 2)) * share;
          } else {
            force += (curve.twice(at - low + blur / 2) - curve.twice(at - low - blur / 2) -
                      curve.twice(at - high + blur / 2) + curve.twice(at - high - blur / 2)) *
                     share;
          }
        }
      }
    }
  }
  const auto n = static_cast<Eigen::Index>(angles_rad.size());
  Eigen::MatrixXd out(2 * n, Values / 2);
  for (Eigen::Index k = 0; k < n; ++k) {
    const Eigen::Index i = angles.from.empty() ? k : angles.from[static_cast<std::size_t>(k)];
    const Force force = sum[static_cast<std::size_t>(k)] * state.cut.axial_depth_m;
    for (Eigen::Index c = 0; c < out.cols(); ++c) {
      out(i, c) = force(2 * c);
      out(n + i, c) = force(2 * c + 1);
    }
  }
  return out;
}

}  // namespace

Eigen::MatrixXd rigid_columns(const CutState& state, double feed_per_tooth_m,
                              std::span<const double> angles_rad) {
  return state.edges ? columns_of<8>(state, feed_per_tooth_m, angles_rad)
                     : columns_of<4>(state, feed_per_tooth_m, angles_rad);
}

}  // namespace servosense::reconcile
