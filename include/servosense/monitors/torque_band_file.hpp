// Reference of the torque band monitor as a file: CSV, a row for each point at equal distances of
// the program from 0 on. '#' begins a comment line; `# air_limit_Nm: X` above the header is read.
// Columns are found by name, others are left alone:
//   program_s or path_m; torque_Nm, lower_Nm, upper_Nm (empty: nothing is expected);
//   and, where the runs had sections: section (a number that rises where one begins), nc_block,
//   speed_rad_s of the spindle, air_Nm level of the torque in the air (empty: unknown), behind_gap
//   (1: the record had a gap there); over path, feed_m_s at which the torque was so.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/monitors/torque_band_points.hpp"

namespace servosense {

/// Engagement of a stretch of a program.
struct PredictedEngagement {
  double removed_m2 = 0;     ///< volume over path
  double contact_m2 = 0;     ///< area of the edges' contact
  double axial_depth_m = 0;  ///< and the angles between which teeth cut, as of model/milling.hpp
  double start_rad = 0, exit_rad = 0;
};

struct TorqueBandReference {
  double spacing = 0;      ///< [s], or [m] over the path
  bool over_path = false;  ///< of the feed axes; else over program time
  std::vector<TorqueBandPoint<double>> points;
  std::vector<TorqueBandSection<double>> sections;
  double air_limit_Nm = 0;  ///< by which the air level may differ; 0 = it is not followed
  bool predicted = false;   ///< from a table of `program predict`
  // Where it is one that has them:
  std::vector<TorqueBandChange<double>> changes{};  ///< one a point
  std::vector<ExpectedCut<double>> cuts{};          ///< one a point
  std::vector<PredictedEngagement> engagements{};   ///< that those name; empty: of several tools
};

/// How far a measured torque may lie from the table of `program predict`, which is read as well.
struct PredictedBand {
  double share = 0.15;              ///< of the torque, beyond low_Nm and high_Nm
  std::optional<double> torque_Nm;  ///< besides; without it `highest_share` of the highest torque
  double highest_share = 0.03;
  double time_s = 0.3;  ///< early or late
  // How the collision monitors hear a force that repeats with the teeth; 0: as it is.
  unsigned teeth = 0;
  double force_cutoff_rad_s = 0;
};

/// Data error, naming file and line, for a wrong header, values that are no numbers, times that do
/// not rise evenly from 0, a lower limit not below the upper one, fewer than two points.
Expected<TorqueBandReference> read_torque_band(LineReader& lines, const PredictedBand& band = {});
Expected<TorqueBandReference> read_torque_band(const std::string& path,
                                               const PredictedBand& band = {});

/// `comments`: a line each, without the '#'.
Expected<Done> write_torque_band(const std::string& path, const TorqueBandReference& reference,
                                 const std::vector<std::string>& comments);

}  // namespace servosense
