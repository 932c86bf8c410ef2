// The side wall that the teeth leave, and its roughness.
//
// Every tooth tip that passes the wall leaves an arc of the tool's radius; the wall is what the
// deepest of them left. A rigid tool leaves feed marks (cusps) of height s^2 / (8 R), at the pitch
// of the feed per tooth, or per revolution when one tooth stands out.
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/model/milling.hpp"

namespace servosense {

/// Height of a wall along the feed: above the nominal wall, positive where material is left
/// standing. NaN where no tooth has been.
struct WallProfile {
  double first_x_m = 0;
  double spacing_m = 0;
  std::vector<double> height_m;

  /// The points from `from_m` to `to_m` along the feed.
  [[nodiscard]] WallProfile between(double from_m, double to_m) const;
};

struct Roughness {
  double ra_m = 0;  ///< mean distance from the mean line (ISO 4287)
  double rz_m = 0;  ///< highest peak to lowest valley, mean of five sampling lengths (ISO 4287)
};

/// Of the whole profile, about its least-squares line. No waviness filter: cut the profile to the
/// evaluation length first. Refused where a point was never cut, and below 50 points.
[[nodiscard]] Expected<Roughness> roughness(const WallProfile& profile);

/// Collects walls while a tool passes: the one of up milling (phi = 0), of down milling (phi = pi),
/// or both of a slot, each at some heights above the tool's end.
class MachinedSurface {
 public:
  struct Config {
    MillingTool tool;
    MillingDirection direction = MillingDirection::down;
    std::vector<double> heights_m;
    double spacing_m = 0;
    double start_x_m = 0;                       ///< tool axis at the start
    std::size_t points = std::size_t{1} << 20;  ///< see MillingSimulation::wall_points
  };

  MachinedSurface() = default;
  explicit MachinedSurface(const Config& config);

  /// The tool has come to `tip_angle_rad` (tooth 1, counted on), its axis to x, y; less than a
  /// twentieth of a turn since the last call.
  void advance(double tip_angle_rad, double axis_x_m, double axis_y_m);
  void break_tooth(std::size_t tooth, double height_m);

  /// The wall at height `i` of the configured ones; of a slot: up-milled side unless told.
  [[nodiscard]] const WallProfile& wall(std::size_t i,
                                        MillingDirection side = MillingDirection::up) const;

 private:
  struct Edge {  // one tooth at one height
    std::size_t tooth = 0;
    double reach_m = 0, height_m = 0;
    double passes_rad = 0;  // angle of tooth 1 at which this edge is next, or now, at the wall
    double x_m = 0, z_m = 0;
    bool near = false;
  };
  struct Wall {
    double side = 1;  // +1: at y = R, -1: at y = -R
    WallProfile profile;
    std::vector<Edge> edges;
  };
  static std::size_t forget(WallProfile& profile, std::size_t points);
  void leave_mark(Wall& wall, Edge& edge, double off_rad, double axis_x_m, double axis_y_m);

  double radius_m_ = 0;
  double next_visit_rad_ = -std::numeric_limits<double>::infinity();
  std::size_t heights_ = 0, points_ = 0;
  std::vector<double> broken_to_m_;
  std::vector<Wall> walls_;
};

}  // namespace servosense
