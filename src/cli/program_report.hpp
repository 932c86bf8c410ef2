// The page of `program check`: the part as one sees it and in three views, the path over it,
// findings beside their lines.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "program_moves.hpp"
#include "servosense/io/report.hpp"
#include "servosense/process/engagement/engagement.hpp"
#include "servosense/process/verification/finding.hpp"
#include "servosense/process/workpiece/workpiece.hpp"

namespace servosense::cli {

/// Upper surface of a part seen from above, in square cells, 240 along the longer side at most.
struct HeightPicture {
  explicit HeightPicture(const process::Workpiece& part);
  std::vector<double> x_mm, y_mm;  ///< edges
  std::vector<double> z_mm;        ///< row by row; NaN: nothing is there
  double bottom_mm = 0;
};

/// A part seen from the front (along y) or from the right (against x): how far behind the stock's
/// face there is material, in square cells as above.
struct SidePicture {
  enum class From : std::uint8_t { front, right };
  SidePicture(const process::Workpiece& part, From from);
  std::vector<double> across_mm, z_mm;  ///< edges; across is x or y
  std::vector<double> depth_mm;         ///< row by row from below; NaN: nothing is there
};

/// What steps of a program tell a reader, thinned out where they are many.
class CutHistory {
 public:
  void add(const process::Engagement& e, const ProgramMoves& moves, double diameter_m);
  /// Path of the tip in the cut, from middle to middle of the steps, by share of the diameter that
  /// is in material.
  [[nodiscard]] std::vector<report::Series> path() const;
  [[nodiscard]] report::PlotGroup over_time() const;

 private:
  static constexpr std::size_t kMost = 200000;
  struct Point {
    double t_s, x_m, y_m, depth_m, width_m, share;
    bool goes_on;  // from the point before, without a way in air
  };
  std::vector<Point> points_;
  std::size_t every_ = 1, count_ = 0;
  std::size_t last_move_ = 0;
  double last_share_ = -1;  // of that, up to where it was in material
  bool goes_on_ = false;    // since the last point
};

struct ProgramPage {
  std::string title, subtitle;
  const HeightPicture* before = nullptr;
  const HeightPicture* after = nullptr;
  const SidePicture* front = nullptr;  ///< afterwards
  const SidePicture* right = nullptr;
  const CutHistory* history = nullptr;
  const std::vector<process::Finding>* findings = nullptr;
  const std::vector<std::string>* lines = nullptr;  ///< of the program
  std::vector<std::string> not_checked;
  report::KeyFigures figures;
};
[[nodiscard]] report::Report report_of(const ProgramPage& page);

}  // namespace servosense::cli
