// Where a cutter meets the workpiece while it goes a short step: the geometry of a cut, without
// feeds and speeds.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <vector>

#include "servosense/process/tool/sweep.hpp"

namespace servosense::process {

/// About the cutter's axis [deg]: 0 on the left of the feed, 90 ahead, 180 on the right, seen from
/// above; of a plunge, whose feed has no direction, 90 is +x. From -90 to 270, 0 to 360 all round.
struct Arc {
  double from_deg = 0, to_deg = 0;
};

/// An arc of contact at some height of the cutter's side.
struct SideContact {
  Arc arc;
  double low_m = 0, high_m = 0;  ///< heights above the tip
  double radius_m = 0;           ///< between them
  double widening = 0;           ///< d radius / d height there
};

struct Engagement {
  std::size_t move = 0;  ///< place among the moves of the program, from 0
  std::size_t line = 0;  ///< of the program
  int tool = 0;
  bool rapid = false;
  /// The step, as shares of the move's path.
  double from_share = 0, to_share = 0;
  double path_m = 0;
  /// Of a step that is not in air: the tip in its middle, and the sine of its climb.
  Point place{};
  double rise = 0;
  /// The feed seen from above, of length 1; of a plunge +x.
  std::array<double, 2> ahead{};

  double removed_m3 = 0;  ///< on the whole step
  /// Height of what is removed, from its lowest to its highest point on the cutter.
  double axial_depth_m = 0;
  // In the middle of the step.
  /// Where the side of the cutter faces material that it moves into, over all heights.
  std::vector<Arc> arcs;
  /// The same by height, what they unite.
  std::vector<SideContact> side;
  /// Across the feed, of what the arcs cover.
  double radial_immersion_m = 0;
  double side_m2 = 0;    ///< contact of the side: all that is not the flat bottom
  double bottom_m2 = 0;  ///< of the flat bottom on its way down
  /// Chip thickness over feed per tooth where there is contact: cosine between the cutter's normal
  /// and its path. Least and greatest; 0 without contact.
  double least_chip = 0, greatest_chip = 0;
  /// The arcs are known to half a line spacing only: the cut is less deep than the layers are
  /// apart.
  bool thin = false;

  /// What the holder, and the shank below it, would remove: more than 0 is a collision.
  double holder_m3 = 0, shank_m3 = 0;

  [[nodiscard]] bool cuts() const { return removed_m3 > 0; }
};

inline constexpr double kNoAngle = std::numeric_limits<double>::quiet_NaN();

}  // namespace servosense::process
