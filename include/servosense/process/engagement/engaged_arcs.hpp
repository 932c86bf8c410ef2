// The part of a circle that lies in a layer of the workpiece.
//
// The circle is followed from line to line of the layer's lattice: at each crossing the line says
// whether there is material. Where that changes, the outline runs through the lattice cell between
// two crossings; it is taken as straight between the two points where it crosses the cell's sides,
// which the lines know exactly, or as a corner, where the outline in the cells before and behind
// points to one.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "servosense/process/engagement/engagement.hpp"
#include "servosense/process/workpiece/workpiece.hpp"

namespace servosense::process {

/// Material counts from this depth on [m], for arcs, depth and width alike: twice what chords of
/// arcs and floats are off (derived). What is thinner lies between two ways in which the same
/// surface is held: chords of two turns of a helix do not begin at one angle, so that the later
/// turn takes up to kChordTolerance off the wall of the earlier one, as high as that wall is.
inline constexpr double kContactDepth = 2.5e-6;

class EngagedArcs {
 public:
  explicit EngagedArcs(const Workpiece& workpiece) : workpiece_(&workpiece) {}

  /// A circle about (x, y); `ahead` is the direction of the feed seen from above, of length 1.
  /// Only the part with sin(angle) > `least_sine` counts: the rest moves out of the material.
  void set_circle(double x, double y, double radius, const std::array<double, 2>& ahead,
                  double least_sine);
  /// Arcs of it that lie in the layer, from low to high angles.
  void find(std::size_t layer, std::vector<Arc>& arcs) const;
  /// Takes out of arcs what a circle of the same radius covers on its way from `from` to `to`,
  /// but for half of kContactDepth.
  void take_out(const std::array<double, 2>& from, const std::array<double, 2>& to,
                std::vector<Arc>& arcs) const;
  struct Disc {
    double x = 0, y = 0, radius = 0;
  };
  /// The same of discs on a way, each so near the next that they leave nothing between them.
  void take_out(std::span<const Disc> way, std::vector<Arc>& arcs) const;

 private:
  struct Sample {
    double order = 0;  // grows with the angle
    double x = 0, y = 0;
    std::size_t axis = 0, across = 0;  // the line that it lies on
  };
  using Cell = std::array<long, 2>;  // between lattice lines; beyond the last there is air
  struct OutlinePoint {
    std::array<double, 2> at{};
    Cell beyond{};  // where the outline goes on
  };
  [[nodiscard]] double angle_deg(double x, double y) const;
  [[nodiscard]] double order_of(double sine, double cosine) const;
  [[nodiscard]] bool inside(const Sample& at, std::size_t layer) const;
  /// Puts the points where the outline crosses the sides of a cell, two at most; how many there
  /// are.
  std::size_t outline(const Cell& cell, std::size_t layer,
                      std::array<OutlinePoint, 2>& points) const;
  /// The corner that the outline has in a cell, from how it comes in and goes out.
  [[nodiscard]] std::optional<std::array<double, 2>> corner(
      const Cell& cell, std::size_t layer, const std::array<OutlinePoint, 2>& points) const;
  /// Angle at which the outline crosses the circle between two neighbouring samples; NaN where the
  /// cell holds no such crossing.
  [[nodiscard]] double crossing_deg(const Sample& a, const Sample& b, std::size_t layer,
                                    double slack) const;

  const Workpiece* workpiece_;
  double x_ = 0, y_ = 0, radius_ = 0;
  std::array<double, 2> ahead_{};
  std::vector<Sample> samples_;
  Sample first_, last_;  // ends of the part that counts
  bool whole_ = false;
};

/// One list of arcs that do not overlap, from low to high; gaps up to `gap_deg` are closed.
void unite(std::vector<Arc>& arcs, double gap_deg);

}  // namespace servosense::process
