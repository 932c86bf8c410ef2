// What is left of the stock: a tri-dexel model, three bundles of lines along x, y and z.
//
// Lines along x and y share layers of one height and cross at the points of a lattice, so that in a
// layer the outline of the part is known where it crosses a line, exactly. The lines along z carry
// the volume: they stand twice as close, one in each cell of a floor plan, shifted from row to row
// and from column to column by irrational parts of the cell (a lattice that no wall is parallel to,
// as in quasi-Monte Carlo), so that a wall cuts cells in all proportions and its volume is right to
// a small part of a cell.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/process/workpiece/dexels.hpp"
#include "servosense/process/workpiece/stock.hpp"

namespace servosense::process {

/// Of all three bundles (chosen: 320 MB as long as most lines have one stretch; a 200 mm cube at
/// 0.1 mm has 24 million).
inline constexpr double kMostLines = 4e7;
/// Spacing of the level lines unless it is given [m] (chosen), so long as kMostLines allow it; of a
/// cutter at most this share of its radius (derived: the lines of a disc of radius r, s apart, give
/// its area to 0.24 (s / r)^1.5, one standard deviation; 0.03 % at s = r / 80, half the spacing).
inline constexpr double kDefaultSpacing = 1e-4, kSpacingShare = 1.0 / 40;

/// The default for a smallest cutter radius, or the finest that kMostLines allow in this stock.
[[nodiscard]] double default_spacing_m(const Stock& stock, double smallest_radius_m);

/// Where (x - x_m, y - y_m) goes farther than `least_m` along `ahead`; everywhere, unless it is
/// given.
struct SweepFront {
  double x_m = 0, y_m = 0;
  std::array<double, 2> ahead{};
  double least_m = -1e30;
};

class Workpiece {
 public:
  enum class Lines : std::uint8_t {
    all,
    upright  ///< along z alone: what is removed is known, but not where a cutter's circle meets it
  };
  /// Lines at most `spacing_m` apart. Data error if that makes more than kMostLines.
  static Expected<Workpiece> of(const Stock& stock, double spacing_m, Lines lines = Lines::all);
  [[nodiscard]] bool has_level_lines() const { return lines_[0].size() > 0; }

  [[nodiscard]] std::array<std::size_t, 3> cells() const { return cells_; }
  [[nodiscard]] const Point& origin() const { return origin_; }
  [[nodiscard]] const Point& cell_m() const { return cell_; }
  /// Lines along an axis. Stretches count from origin().
  [[nodiscard]] const Dexels& lines(std::size_t axis) const { return lines_[axis]; }
  [[nodiscard]] Dexels& lines(std::size_t axis) { return lines_[axis]; }

  /// Cells of the floor plan in x and y, in each of which a line along z stands.
  [[nodiscard]] std::array<std::size_t, 2> plan() const { return plan_; }
  /// Of the floor plan, in which the lines along z stand.
  [[nodiscard]] double plan_area_m2() const { return plan_cell_[0] * plan_cell_[1]; }
  /// Of lines along z: by cell of the floor plan in x and y.
  [[nodiscard]] std::size_t column(std::size_t i, std::size_t j) const { return i + plan_[0] * j; }
  [[nodiscard]] double column_x(std::size_t i, std::size_t j) const {
    return origin_[0] + (static_cast<double>(i) + row_shift_[j]) * plan_cell_[0];
  }
  [[nodiscard]] double column_y(std::size_t i, std::size_t j) const {
    return origin_[1] + (static_cast<double>(j) + column_shift_[i]) * plan_cell_[1];
  }
  /// Of lines along x (axis 0) and y (axis 1): by cell across, in y or x, and by layer.
  [[nodiscard]] std::size_t level_line(std::size_t axis, std::size_t across,
                                       std::size_t layer) const {
    return across + cells_[1 - axis] * layer;
  }
  /// Place along x, y or z of the lattice of level lines.
  [[nodiscard]] double lattice(std::size_t axis, std::size_t cell) const {
    return origin_[axis] + (static_cast<double>(cell) + 0.5) * cell_[axis];
  }
  /// First cell whose lattice place is at least `low`, and one past the last that is at most
  /// `high`.
  [[nodiscard]] std::array<std::size_t, 2> lattice_range(std::size_t axis,
                                                         const Interval& of) const;
  /// First cell of the floor plan that reaches beyond `low`, and one past the last that begins
  /// before `high`.
  [[nodiscard]] std::array<std::size_t, 2> plan_range(std::size_t axis, const Interval& of) const;

  /// By the lines along z [m3].
  [[nodiscard]] double volume_m3() const;
  /// What the cutter would remove on its way [m3]: a fixture or the part, against a holder.
  [[nodiscard]] double volume_in(const Sweep& sweep) const;
  /// Removes what the cutter clears; gives its volume [m3].
  double remove(const Sweep& sweep);

  /// f(line, cell in x, cell in y, x, y) for each line along z in the shadow of the sweep; of those
  /// outside the front at most one cell.
  template <typename F>
  void each_column(const Sweep& sweep, const F& f, const SweepFront& front = {}) const {
    const auto rows = plan_range(1, sweep.bounds(1));
    const double half = 0.5 * plan_cell_[1];
    for (std::size_t j = rows[0]; j < rows[1]; ++j) {
      const double y = origin_[1] + static_cast<double>(j) * plan_cell_[1] + half;
      Interval x = sweep.shadow(0, y, half);
      const double rest =
          front.least_m - (y - front.y_m) * front.ahead[1] - half * std::abs(front.ahead[1]);
      if (front.ahead[0] > 0)
        x.low = std::max(x.low, front.x_m + rest / front.ahead[0]);
      else if (front.ahead[0] < 0)
        x.high = std::min(x.high, front.x_m + rest / front.ahead[0]);
      else if (rest > 0)
        continue;
      const auto in = plan_range(0, x);
      for (std::size_t i = in[0]; i < in[1]; ++i)
        f(column(i, j), i, j, column_x(i, j), column_y(i, j));
    }
  }
  /// Removes what the cutter clears from the lines along x and y, in layers up to `top_m`.
  void remove_level(const Sweep& sweep, double top_m);

 private:
  template <typename Fill>
  void fill(std::size_t axis, const Fill& stretches_of);
  void fill_from(const Mesh& mesh, std::size_t axis);

  Point origin_{}, cell_{};
  std::array<std::size_t, 3> cells_{};
  std::array<std::size_t, 2> plan_{};
  std::array<double, 2> plan_cell_{};
  std::vector<double> row_shift_, column_shift_;  // shares of a cell
  std::array<Dexels, 3> lines_;
};

}  // namespace servosense::process
