// The cut of a rotating tool, in layers, against the surface that earlier teeth have left.
//
// Support-function form. For every layer and every direction n(theta) = (sin, cos) the surface is
// kept as the farthest reach w = c.n + r any tooth has had there: c is the tool axis (feed plus
// vibration) in the frame of the work, r the throw of the tooth. A tooth that comes by takes
//
//   h = max(0, c.n + r - w),     w becomes max(w, c.n + r)
//
// which is the closed form h = max(0, min_k (r_i - r_(i-k) + k s sin(theta) + z - z_k)) over all
// earlier teeth: regeneration over several teeth (Tarng 1988, eq. 3-26 to 3-28), run-out with chips
// left to later teeth (eq. 3-40), teeth that leave the cut, chipped and missing teeth and unequal
// pitch are all the same maximum. Material outside the work is swept as well but asks no force.
//
// Helix. The rows of the store are indexed by the angle of the tooth *tip*: one row holds all
// layers at theta = phi - lag. A tooth therefore reads and writes contiguous memory, in the order
// in which it turns, and n(theta) of a layer is a fixed rotation of n(phi): the inner loop has
// neither trigonometry nor gathers. Between two rows the surface is linear, chip thickness is taken
// on the same chord, so that the growing feed position cancels exactly.
//
// Trochoidal path. The tip moves on a trochoid, not on circles: with D the feed since the surface
// there was left and b the feed per radian,
//   h += D^2 cos^2(theta) / (2R) - D b sin(theta) cos(theta) / R
// which is exact to third order in s/R (the first term is the second order of Tarng 1988, eq. 3-38;
// the second the tilt of the path).
//
// Cost: proportional to the layers that are in the cut; see bench/bench_milling.cpp.
// Bad at: vibration so large that the engagement itself moves (the arcs follow the undisturbed
// axis), and edges entering the front face, where a chip thinner than s sin(theta) is ignored.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "servosense/model/milling.hpp"

namespace servosense {

class LayeredCut {
 public:
  struct Config {
    MillingTool tool;
    Engagement window;            ///< every angle at which a tooth may ever cut
    double feed_per_tooth_m = 0;  ///< mean over the teeth
    double depth_m = 0;           ///< greatest axial depth
    double front_depth_m = 0;     ///< depth at x = 0 and its growth along the feed
    double depth_slope = 0;
    bool wedge = false;  ///< depth follows front_depth_m + depth_slope x, else depth_m
    int layers = 64;
    int rows = 4096;  ///< angular points of the surface per revolution
    bool trochoidal = false;
    std::vector<double> break_fractions;  ///< breakages to come, so that layers end where they do
  };
  /// Tool axis in the frame of the work, feed included.
  struct Axis {
    double x_m = 0, y_m = 0;
    double vx_m_s = 0, vy_m_s = 0;  ///< vibration only
  };
  struct Load {
    double fx_N = 0, fy_N = 0;  ///< on the tool
    double torque_Nm = 0;       ///< against the rotation
    int teeth_in_cut = 0;
  };

  LayeredCut() = default;
  /// The surface is the one a rigid tool leaves that has come along the feed to `axis_x_m`.
  LayeredCut(const Config& config, double angle_rad, double axis_x_m);

  /// Turns the tool by `turn_rad` >= 0 to where its axis is at `axis`, leaves the surface it cuts
  /// on the way, and returns the load at the end of the way. `arcs`: where tips are in the work
  /// now. `blur_rad`: angle over which engagement of a straight tooth is averaged (the turn of a
  /// step).
  Load advance(double turn_rad, double blur_rad, const Axis& axis, double cutting_speed_m_s,
               std::span<const Engagement> arcs);

  void break_tooth(std::size_t tooth, double fraction);

 private:
  struct Range {
    std::size_t first = 0, last = 0;  // layers [first, last)
  };
  struct Sums;

  [[nodiscard]] double* row(std::vector<double>& store, std::size_t index) {
    return store.data() + index * stride_;
  }
  [[nodiscard]] std::size_t layer_above(double lag_rad) const;
  [[nodiscard]] Range layers_between(double low_lag_rad, double high_lag_rad) const;
  void leave_surface(std::size_t tooth, std::size_t index, const Axis& axis, const Range& range);
  void add_load(std::size_t tooth, std::size_t index, double share, double phi, const Axis& axis,
                double blur_rad, double cutting_speed_m_s, std::span<const Engagement> arcs,
                Load& load);
  [[nodiscard]] Sums cut_linear(const Range& range, const double* width, const double* before,
                                const double* ahead, double share, double reach, double a,
                                double b) const;
  template <bool Trochoidal>
  [[nodiscard]] Sums cut_general(const Range& range, const double* width, std::size_t tooth,
                                 std::size_t index, double share, double reach, double sine,
                                 double cosine, const Axis& axis, double cutting_speed_m_s);
  [[nodiscard]] double trochoid_term(double feed_m, double sine, double cosine) const {
    // After a revolution without a chip the place that was cut then has been left behind.
    feed_m = feed_m < kTwoPi * feed_per_rad_m_ ? feed_m : kTwoPi * feed_per_rad_m_;
    return feed_m * cosine / radius_m_ * (0.5 * feed_m * cosine - feed_per_rad_m_ * sine);
  }

  CuttingForceLaw law_;
  double radius_m_ = 0;
  double feed_per_rad_m_ = 0;
  bool trochoidal_ = false, linear_ = true, edges_ = false, wedge_ = false, straight_ = true;
  double front_depth_m_ = 0, depth_slope_ = 0;

  // Layers, from the tip up.
  std::size_t layers_ = 0, stride_ = 0;
  std::vector<double> bottom_m_, width_m_;  // of each layer
  std::vector<double> lag_from_, lag_to_;   // helix lag of its ends
  std::vector<double> cos_lag_, sin_lag_;   // of its middle
  std::vector<double> part_width_m_;        // width in the cut, of this evaluation
  double layers_per_rad_ = 0, total_lag_ = 0;

  // Rows.
  std::size_t rows_ = 0;
  double row_rad_ = 0, rows_per_rad_ = 0;
  std::vector<double> row_sin_, row_cos_;           // one more than rows_, for the chord
  std::vector<double> surface_m_, surface_feed_m_;  // w, and where the axis was when it was left

  // Teeth.
  std::vector<double> throw_m_, tooth_rows_;      // tooth_rows_: position of the tip, 0 to rows_
  std::vector<std::size_t> intact_from_;          // first layer that still has its edge
  std::vector<double> before_m_, before_feed_m_;  // last row passed, as it was before this tooth
  Engagement window_;
  double window_low_ = 0, window_high_ = 0;  // tip angles that can matter
  double margin_ = 0;

  Axis last_axis_;
};

}  // namespace servosense
