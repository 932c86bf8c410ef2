// What the cutter meets along its feed: a block with its faces, slots, holes, and a depth that may
// grow along the feed (the triangular workpiece of Koike 2016, ch. 7).
//
// Frame of model/milling.hpp, fixed to the work: the cutter axis travels along y = 0 toward +x, the
// front face of the block is x = 0. A tooth cuts where its tip lies in the block and inside the
// width of cut (generalises the entry, steady and exit cases of Tarng 1988, App. B; slots and holes
// come with it, and the two arcs left when a full slot runs out of the far face).
#pragma once

#include <limits>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/model/milling.hpp"

namespace servosense {

/// A slot already in the work, across the feed: no material for from < x < to.
struct WorkpieceSlot {
  double from_m = 0;
  double to_m = 0;
};

/// A round hole already in the work, y measured from the line of feed.
struct WorkpieceHole {
  double x_m = 0;
  double y_m = 0;
  double radius_m = 0;
};

/// A block; with unequal depths, a wedge whose axial depth of cut runs from one to the other.
struct Workpiece {
  double length_m = std::numeric_limits<double>::infinity();
  double front_depth_m = 0;  ///< axial depth at x = 0; both zero: the depth of the cut throughout
  double far_depth_m = 0;    ///< axial depth at x = length
  std::vector<WorkpieceSlot> slots;
  std::vector<WorkpieceHole> holes;

  /// A plain block has its depth from the cut.
  [[nodiscard]] bool is_wedge() const { return front_depth_m > 0 || far_depth_m > 0; }
  /// True where engagement does not depend on the position of the cutter at all.
  [[nodiscard]] bool is_endless() const {
    return length_m == std::numeric_limits<double>::infinity() && slots.empty() && holes.empty();
  }
};

/// Says what is wrong with a workpiece.
[[nodiscard]] Expected<Done> validate(const Workpiece& workpiece);

/// Disjoint arcs of tooth angle, ascending, in which a tooth tip is inside the work when the cutter
/// axis is at `axis_x_m`. `within` bounds the result (the width of cut: `engagement_of`).
[[nodiscard]] std::vector<Engagement> engagement_arcs(const Workpiece& workpiece, double radius_m,
                                                      const Engagement& within, double axis_x_m);

/// Position of the cutter axis at which the first tooth tip can touch the front face [m]
/// (negative). Tarng 1988: S_L behind the contact of the cutter's leading edge for small
/// immersions.
[[nodiscard]] double first_contact_m(double radius_m, const Engagement& within);

}  // namespace servosense
