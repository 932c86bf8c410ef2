// The solid that a turning cutter clears: a convex body of revolution about z, its tip at height 0.
//
// It is the union of a rounded disc (ball and bull noses) and of frusta (everything else), each of
// them convex, so that what the cutter clears on a straight line is met by any line in one
// interval.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string_view>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense::process {

enum class CutterKind : std::uint8_t {
  flat,   ///< end mill with a sharp corner
  ball,   ///< end mill whose tip is half a sphere
  bull,   ///< end mill with a corner radius
  taper,  ///< conical above its tip, which is flat, rounded or half a sphere
  drill,  ///< a cone with a point angle, a cylinder above
  face,   ///< face mill with inserts under an entering angle
  tap,    ///< a cylinder as wide as its thread
};
[[nodiscard]] std::string_view cutter_kind_name(CutterKind kind);

struct CutterShape {
  CutterKind kind = CutterKind::flat;
  /// Cutting diameter [m], above 0; of a taper and a face mill that at the tip.
  double diameter_m = 0;
  double corner_radius_m = 0;  ///< of bull, taper and face; at most half the diameter
  /// Height that cuts [m]; infinite: as high as the stock is.
  double flute_length_m = std::numeric_limits<double>::infinity();
  /// Height of the holder's lower face above the tip [m]; infinite: there is no holder.
  double stick_out_m = std::numeric_limits<double>::infinity();
  double holder_diameter_m = 0;
  double point_angle_deg = 118;    ///< of a drill, between its edges, 0 to 180 excluded
  double taper_deg = 0;            ///< of a taper, from the axis to its side, below 90
  double entering_angle_deg = 90;  ///< of a face mill's inserts, from the feed to the edge
};

class Cutter {
 public:
  struct Frustum {
    double low_m = 0, high_m = 0;                ///< heights
    double low_radius_m = 0, high_radius_m = 0;  ///< the upper one is not the smaller
  };
  struct RoundedDisc {
    double disc_m = 0;    ///< radius of the flat part
    double corner_m = 0;  ///< its edge is rounded with this, and so is its centre's height
    double high_m = 0;    ///< it ends here, at most at `corner_m`
  };

  /// Data error for a shape that is none: what is wrong and which value to change.
  static Expected<Cutter> of(const CutterShape& shape);
  /// The cutter that is thinner by `by` [m] all round, corner included; raised by `by` it lies
  /// within this one. Data error where nothing is left.
  [[nodiscard]] Expected<Cutter> thinner(double by_m) const;
  /// The holder, as a solid that stands `stick_out_m` above the tip; nothing if there is none.
  [[nodiscard]] std::optional<Cutter> holder() const;
  /// What stands between cutter and holder, kShankClearance thinner than the cutter; nothing where
  /// the flute is endless.
  [[nodiscard]] std::optional<Cutter> shank() const;

  [[nodiscard]] const CutterShape& shape() const { return shape_; }
  [[nodiscard]] const std::vector<Frustum>& frusta() const { return frusta_; }
  [[nodiscard]] const std::optional<RoundedDisc>& nose() const { return nose_; }
  /// A ball without a flat part.
  [[nodiscard]] bool has_ball() const { return nose_ && !(nose_->disc_m > 0); }
  /// One radius from the bottom to the top.
  [[nodiscard]] bool is_cylinder() const {
    return !nose_ && frusta_.size() == 1 && frusta_[0].low_radius_m == radius_;
  }
  /// The nose as frusta within kNoseTolerance.
  [[nodiscard]] const std::vector<Frustum>& nose_frusta() const { return nose_frusta_; }

  [[nodiscard]] double bottom_m() const { return bottom_; }  ///< lowest height, 0 but for a holder
  [[nodiscard]] double top_m() const { return top_; }
  [[nodiscard]] double radius_m() const { return radius_; }  ///< the largest
  /// Radius of the flat bottom; 0 of a ball and a drill.
  [[nodiscard]] double bottom_radius_m() const { return bottom_radius_; }
  /// Radius at a height; negative outside the cutter.
  [[nodiscard]] double radius_at(double height_m) const;
  /// d radius / d height there, at least 0; infinite at a flat bottom.
  [[nodiscard]] double widening_at(double height_m) const;
  /// Height of the lower surface at a distance from the axis of at most radius_m().
  [[nodiscard]] double surface_at(double distance_m) const;
  /// A lower bound of it, from the square of the distance: cheap.
  [[nodiscard]] double surface_above(double distance2_m2) const {
    const double place = distance2_m2 * floor_scale_;
    return place < kFloorSteps ? floor_[static_cast<std::size_t>(place)] : top_;
  }
  /// d height / d distance there; infinite at a side that stands upright.
  [[nodiscard]] double slope_at(double distance_m) const;
  /// Side surface between two heights, of a radian about the axis [m2].
  [[nodiscard]] double side_area_per_rad(double from_m, double to_m) const;

 private:
  static constexpr std::size_t kFloorSteps = 512;
  [[nodiscard]] static Cutter upright(double radius_m, double low_m, double high_m);
  void finish();

  CutterShape shape_;
  std::vector<Frustum> frusta_;
  std::optional<RoundedDisc> nose_;
  std::vector<Frustum> nose_frusta_;
  std::vector<double> floor_;  // surface over the squared distance, at the lower end of each step
  double floor_scale_ = 0;
  double bottom_ = 0, top_ = 0, radius_ = 0, bottom_radius_ = 0;
};

/// Deviation of nose_frusta() from the nose [m] (chosen: a tenth of what a tool's radius is known
/// to).
inline constexpr double kNoseTolerance = 5e-7;
/// Of a shank below the radius of its cutter [m] (chosen: shanks of this diameter are ground a
/// little below it, and what the cutter has left on a wall is no contact).
inline constexpr double kShankClearance = 2e-5;
/// Stands for an infinite flute [m]: higher than any stock.
inline constexpr double kEndlessFlute = 10;

}  // namespace servosense::process
