// The map of one tooth period to the next, of which the semi-discretization takes the largest
// eigenvalue (semi_discretization.hpp has the method and its sources).
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "servosense/identify/semi_discretization.hpp"
#include "stability_loop.hpp"

namespace servosense {

inline constexpr int kHighestHoldOrder = 6;

/// One mode; its state is (q, q'/wn), so that both have the unit of a displacement.
struct Oscillator {
  double wn, zeta, mass;
  int direction;  ///< index of the tool tip displacement it adds to

  struct Free {
    double qq, qp, pq, pp;
  };
  /// State after `t` without force.
  [[nodiscard]] Free free(double t) const {
    const double r = 1 / std::sqrt(1 - zeta * zeta);
    const double decay = std::exp(-zeta * wn * t);
    const double s = decay * std::sin(wn * t / r);
    const double c = decay * std::cos(wn * t / r);
    return {c + r * zeta * s, r * s, -r * s, c - r * zeta * s};
  }
  /// State after `t` from a unit impulse is (qp, pp) of free(t) times this.
  [[nodiscard]] double impulse() const { return 1 / (mass * wn); }
};

/// Exact response over one interval of given length to a polynomial force, for every mode.
struct Stencil {
  double length_s = 0;
  std::vector<Oscillator::Free> free;  ///< [mode * order + node - 1]
  std::vector<double> q;               ///< [(mode * order + node - 1) * (order + 1) + force node]
  std::vector<double> p;               ///< [mode * (order + 1) + force node], at the end
};

/// A stretch of the tooth period between two entries or exits, or a flight between two cuts.
struct Segment {
  double length_s = 0;
  bool in_cut = false;
  int intervals = 0;
  std::size_t stencil = 0;
  std::size_t first_node = 0;      ///< in the memory of the deflection
  std::size_t first_interval = 0;  ///< in the coefficient store
  std::vector<Oscillator::Free> flight;
};

/// The map of one tooth period to the next.
class ToothPassMap {
 public:
  ToothPassMap(const Structure& structure, const MillingTool& tool, const Engagement& engagement,
               const SemiDiscretizationConfig& config, double spindle_speed_rpm,
               double axial_depth_m);

  [[nodiscard]] std::size_t size() const { return 2 * modes_.size() + directions_ * nodes_; }
  [[nodiscard]] const std::vector<Oscillator>& modes() const { return modes_; }
  void apply(const double* before, double* after) const;

 private:
  using Small = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor,
                              2 * kHighestHoldOrder, 2 * kHighestHoldOrder>;

  [[nodiscard]] std::size_t stencil_of(double length_s);
  void prepare(const Segment& segment, double start_rad, double width_rad, double lag_rad,
               const MillingTool& tool, const Engagement& engagement, double half_depth_kt);

  std::size_t order_;
  std::size_t directions_ = 0;
  std::array<bool, 2> moves_{};  ///< x, y
  std::array<double, kHighestHoldOrder + 1> nodes_at_{};
  std::vector<Oscillator> modes_;
  std::vector<Stencil> stencils_;
  std::vector<Segment> segments_;
  std::size_t nodes_ = 0;
  std::size_t intervals_ = 0;
  std::vector<double> stiffness_;  ///< per interval and node: force per deflection, 2 x 2 or 1
  std::vector<double> solve_;      ///< per interval: inverse of the implicit system
};

}  // namespace servosense
