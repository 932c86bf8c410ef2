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
// on the same chord, so that the growing feed position cancels exactly. A tooth leaves its surface
// one row late: the row behind it still shows what it found there, the row ahead what it will find.
//
// Trochoidal path. The tip moves on a trochoid, not on circles: with D the feed since the surface
// there was left and b the feed per radian,
//   h += D^2 cos^2(theta) / (2R) - D b sin(theta) cos(theta) / R
// which is exact to third order in s/R (the first term is the second order of Tarng 1988, eq. 3-38;
// the second the tilt of the path).
//
// Cost: a tooth out of the cut takes a look into a table, one in the cut as much as twenty
// layers, and those of its layers that are in, two at a time; see bench/bench_milling.cpp.
// Bad at: vibration so large that the engagement itself moves (the arcs follow the undisturbed
// axis), and edges entering the front face, where a chip thinner than s sin(theta) is ignored.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
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
    int rows = 4096;  ///< angular points of the surface per revolution, four or more in a pitch
    bool trochoidal = false;
    std::vector<double> break_fractions;  ///< breakages to come, so that layers end where they do
  };
  /// Tool axis in the frame of the work, feed included.
  struct Axis {
    double x_m = 0, y_m = 0;
    double vx_m_s = 0, vy_m_s = 0;                ///< vibration only
    double forgotten_x_m = 0, forgotten_y_m = 0;  ///< of x_m and y_m, what no surface keeps
  };
  struct Load {
    double fx_N = 0, fy_N = 0;  ///< on the tool
    double fz_N = 0;            ///< along it, positive as the axial coefficients are
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
  /// A row seen by a tooth: theta of layer l is the angle of the row, plus `turn_rad`, minus the
  /// lag.
  struct Pass {
    double turn_rad = 0;                // whole turns
    std::uint32_t first = 0, last = 0;  // layers [first, last) leave a surface there
  };
  /// Two layers, side by side for the vector unit.
  struct alignas(64) LayerPair {
    double cosine[2]{}, sine[2]{};  // of the helix lag of their middles
    double bottom_m[2]{}, width_m[2]{};
  };
  /// A tooth leaves its surface one row late, so that the row it has passed last still shows what
  /// it found there.
  struct Tooth {
    double throw_m = 0;
    std::size_t intact_from = 0;            // first layer that still has its edge
    double intact_from_m = 0;               // and where it begins
    std::size_t row = 0;                    // last row passed by the tip,
    double passed_x_m = 0, passed_y_m = 0;  // where the tool axis was then,
    double share = 0;                       // and the way since, as a part of the way to the next
  };
  [[nodiscard]] bool makes_wall(const Tooth& tooth, std::size_t low, std::size_t high) const;
  struct Moment {
    const Axis& axis;
    double blur_rad = 0, cutting_speed_m_s = 0;
    std::span<const Engagement> arcs;
  };
  struct Sums;   // over the teeth
  struct Place;  // where a tooth stands, for its load
  // Effects beyond a force proportional to chip thickness. Others: size effect, process damping.
  static constexpr std::size_t kEdges = 1, kWedge = 2, kOthers = 4, kTrochoid = 8;
  static constexpr std::size_t kCombinations = 16;

  [[nodiscard]] double bottom_m(std::size_t l) const { return layer_[l / 2].bottom_m[l % 2]; }
  [[nodiscard]] double width_m(std::size_t l) const { return layer_[l / 2].width_m[l % 2]; }
  [[nodiscard]] double cos_lag(std::size_t l) const { return layer_[l / 2].cosine[l % 2]; }
  [[nodiscard]] double sin_lag(std::size_t l) const { return layer_[l / 2].sine[l % 2]; }
  [[nodiscard]] std::size_t layer_at(double height_m) const;
  [[nodiscard]] bool meets_work(std::size_t row) const {
    return first_pass_[row] != first_pass_[row + 1];
  }
  void pass_rows(Tooth& tooth, std::int64_t passed, double turn_rows, const Axis& axis);
  void leave_surface(const Tooth& tooth, std::size_t begin, std::size_t end);
  template <std::size_t kEffects>
  [[nodiscard]] Load load(const Moment& now) const;
  template <std::size_t... kEffects>
  static constexpr auto loads(std::index_sequence<kEffects...> /*all*/) {
    return std::array{&LayeredCut::load<kEffects>...};
  }
  template <std::size_t kEffects>
  [[nodiscard]] bool add_tooth(const Tooth& tooth, const Moment& now, Sums& sums) const;
  template <std::size_t kEffects>
  [[nodiscard]] bool cut(const Place& place, const Moment& now, Sums& sums) const;

  CuttingForceLaw law_;
  double radius_m_ = 0;
  double feed_per_rad_m_ = 0;
  bool trochoidal_ = false, straight_ = true;
  std::size_t effects_ = 0;
  double front_depth_m_ = 0, depth_slope_ = 0;

  // Layers, from the tip up.
  std::size_t layers_ = 0, stride_ = 0;
  std::vector<LayerPair> layer_;
  std::vector<double> top_m_;
  double layers_per_m_ = 0, height_per_rad_ = 0, depth_m_ = 0;

  // Rows.
  std::size_t rows_ = 0;
  double row_rad_ = 0, rows_per_rad_ = 0;
  std::vector<double> row_sin_, row_cos_;           // one more than rows_, for the chord
  std::vector<double> surface_m_, surface_feed_m_;  // w, and where the axis was when it was left
  std::vector<Pass> passes_;
  std::vector<std::uint32_t> first_pass_;  // of each row, and one more

  double farthest_throw_m_ = 0;
  std::vector<Tooth> teeth_;
  Axis last_axis_;
};

}  // namespace servosense
