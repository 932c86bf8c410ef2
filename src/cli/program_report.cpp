#include "program_report.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace servosense::cli {
namespace {

constexpr double kCells = 240;
constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
/// Shares of the diameter that are one colour each (chosen).
constexpr std::array<double, 3> kShares = {0.25, 0.5, 0.75};

/// Of a drawing in which x and y have one scale.
double height_px(const std::vector<double>& x, const std::vector<double>& y) {
  constexpr double kWide = 853;
  return std::clamp(kWide * (y.back() - y.front()) / (x.back() - x.front()), 80.0, 1200.0);
}

/// Of sides of these lengths: square cells, kCells along the longest.
std::vector<double> edges_of(double from_m, double size_m, double longest_m) {
  const double count = std::max(1.0, std::round(kCells * size_m / longest_m));
  std::vector<double> all;
  for (double i = 0; i <= count; ++i) all.push_back(1e3 * (from_m + size_m * i / count));
  return all;
}
double size_of(const process::Workpiece& part, std::size_t axis) {
  return static_cast<double>(part.cells()[axis]) * part.cell_m()[axis];
}
double longest_of(const process::Workpiece& part) {
  return std::max({size_of(part, 0), size_of(part, 1), size_of(part, 2)});
}

/// Whether there is no picture in it, as of the face of a box.
bool is_flat(const std::vector<double>& picture_mm) {
  double low = 1e300, high = -1e300;
  for (const double z : picture_mm) {
    if (!std::isfinite(z)) return false;
    low = std::min(low, z), high = std::max(high, z);
  }
  return !(high - low > 1e-3);
}

report::HeatMap map_of(const HeightPicture& picture, const std::string& title) {
  report::HeatMap map;
  map.title = title;
  map.x_label = "x", map.y_label = "y", map.z_label = "height";
  map.x_unit = map.y_unit = map.z_unit = "mm";
  map.x_edges = picture.x_mm, map.y_edges = picture.y_mm, map.z = picture.z_mm;
  map.height_px = height_px(picture.x_mm, picture.y_mm);
  return map;
}

report::HeatMap map_of(const SidePicture& picture, const std::string& title,
                       const std::string& caption, const std::string& across) {
  report::HeatMap map;
  map.title = title, map.caption = caption;
  map.x_label = across, map.y_label = "z", map.z_label = "behind the face of the stock";
  map.x_unit = map.y_unit = map.z_unit = "mm";
  map.x_edges = picture.across_mm, map.y_edges = picture.z_mm, map.z = picture.depth_mm;
  map.height_px = height_px(picture.across_mm, picture.z_mm);
  return map;
}

report::Surface surface_of(const HeightPicture& picture, const std::string& title) {
  return {title,        "Seen from the front left, from above; undercuts do not show.",
          picture.x_mm, picture.y_mm,
          picture.z_mm, picture.bottom_mm};
}

/// A cross at each finding that has a line.
report::Series crosses_of(const std::vector<process::Finding>& findings, double half_mm) {
  report::Series crosses{"findings", "mm"};
  crosses.colour = 5;
  for (const process::Finding& f : findings) {
    const double x = 1e3 * f.position[0], y = 1e3 * f.position[1];
    for (const double side : {1.0, -1.0})
      for (const double along : {-half_mm, half_mm, kNothing}) {
        crosses.x.push_back(x + along);
        crosses.y.push_back(y + side * along);
      }
  }
  return crosses;
}

/// A range and what findings need beyond it.
report::Range range_with(const std::vector<double>& edges,
                         const std::vector<process::Finding>& findings, std::size_t axis,
                         double margin_mm) {
  report::Range in{edges.front(), edges.back()};
  for (const process::Finding& f : findings) {
    in.from = std::min(in.from, 1e3 * f.position[axis] - margin_mm);
    in.to = std::max(in.to, 1e3 * f.position[axis] + margin_mm);
  }
  return in;
}

std::string line_text(const std::vector<std::string>& lines, std::size_t line) {
  return line > 0 && line <= lines.size() ? lines[line - 1] : std::string();
}

}  // namespace

HeightPicture::HeightPicture(const process::Workpiece& part) {
  const auto plan = part.plan();
  const auto edges = [&](std::size_t axis) {
    // Not finer than the lines.
    const double longest =
        std::max({size_of(part, 0), size_of(part, 1), kCells * 2 * part.cell_m()[axis]});
    return edges_of(part.origin()[axis], size_of(part, axis), longest);
  };
  x_mm = edges(0), y_mm = edges(1);
  const std::array<std::size_t, 2> cells = {x_mm.size() - 1, y_mm.size() - 1};
  bottom_mm = 1e3 * part.origin()[2];
  z_mm.assign(cells[0] * cells[1], kNothing);
  for (std::size_t j = 0; j < plan[1]; ++j)
    for (std::size_t i = 0; i < plan[0]; ++i) {
      const auto stretches = part.lines(2).of(part.column(i, j));
      if (stretches.empty()) continue;
      double& z = z_mm[(j * cells[1] / plan[1]) * cells[0] + i * cells[0] / plan[0]];
      const double top = 1e3 * (part.origin()[2] + static_cast<double>(stretches.back().high));
      if (!(z >= top)) z = top;
    }
}

SidePicture::SidePicture(const process::Workpiece& part, From from) {
  const std::size_t axis = from == From::front ? 0 : 1, away = 1 - axis;
  // Not finer than the lines.
  const double longest = std::max(longest_of(part), kCells * 2 * part.cell_m()[axis]);
  across_mm = edges_of(part.origin()[axis], size_of(part, axis), longest);
  z_mm = edges_of(part.origin()[2], size_of(part, 2), longest);
  const std::size_t wide = across_mm.size() - 1, high = z_mm.size() - 1;
  depth_mm.assign(wide * high, kNothing);
  const auto plan = part.plan();
  const double cell = size_of(part, 2) / static_cast<double>(high);
  for (std::size_t n = 0; n < plan[away]; ++n) {
    const std::size_t at = from == From::front ? n : plan[away] - 1 - n;  // the nearest first
    const double depth =
        1e3 * size_of(part, away) * static_cast<double>(n) / static_cast<double>(plan[away]);
    for (std::size_t i = 0; i < plan[axis]; ++i) {
      const auto column = axis == 0 ? part.column(i, at) : part.column(at, i);
      for (const process::Stretch& s : part.lines(2).of(column)) {
        // Cells whose middle lies in it.
        const auto low = std::ceil(static_cast<double>(s.low) / cell - 0.5);
        const auto end = std::ceil(static_cast<double>(s.high) / cell - 0.5);
        for (double k = std::max(0.0, low); k < std::min(end, static_cast<double>(high)); ++k) {
          double& seen = depth_mm[static_cast<std::size_t>(k) * wide + i * wide / plan[axis]];
          if (!(seen <= depth)) seen = depth;
        }
      }
    }
  }
}

void CutHistory::add(const process::Engagement& e, const ProgramMoves& moves, double diameter_m) {
  if (!e.cuts()) return;
  const bool follows = e.move == last_move_
                           ? e.from_share == last_share_
                           : e.move == last_move_ + 1 && last_share_ == 1 && e.from_share == 0;
  goes_on_ = goes_on_ && follows;
  last_move_ = e.move, last_share_ = e.to_share;
  if (count_++ % every_ != 0) return;
  const MoveTechnology& t = moves.moves[e.move];
  points_.push_back({t.begin_s + (t.end_s - t.begin_s) * e.to_share, e.place[0], e.place[1],
                     e.axial_depth_m, e.radial_immersion_m,
                     diameter_m > 0 ? e.radial_immersion_m / diameter_m : 0, goes_on_});
  goes_on_ = true;
  if (points_.size() < kMost) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points_.size(); i += 2) {
    if (i > 0) points_[i].goes_on = points_[i].goes_on && points_[i - 1].goes_on;
    points_[kept++] = points_[i];
  }
  points_.resize(kept);
  every_ *= 2;
}

std::vector<report::Series> CutHistory::path() const {
  std::vector<report::Series> all;
  const std::array<const char*, 4> names = {"up to 25 % of the diameter in material", "25 to 50 %",
                                            "50 to 75 %", "above 75 %"};
  for (std::size_t k = 0; k < names.size(); ++k) {
    report::Series s{names[k], "mm"};
    s.colour = static_cast<int>(k);
    const auto put = [&](double x, double y) { s.x.push_back(x), s.y.push_back(y); };
    const Point* drawn_to = nullptr;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const Point& p = points_[i];
      const auto of = std::ranges::count_if(kShares, [&](double share) { return p.share > share; });
      if (static_cast<std::size_t>(of) != k) continue;
      const Point* before = p.goes_on ? &points_[i - 1] : nullptr;
      if (before == nullptr || before != drawn_to) {
        if (!s.x.empty()) put(kNothing, kNothing);
        if (before != nullptr) put(1e3 * before->x_m, 1e3 * before->y_m);
      }
      put(1e3 * p.x_m, 1e3 * p.y_m);
      drawn_to = &p;
    }
    if (!s.x.empty()) all.push_back(std::move(s));
  }
  return all;
}

report::PlotGroup CutHistory::over_time() const {
  const auto plot = [&](const char* title, double Point::*value) {
    report::Plot p;
    p.title = title;
    p.x_label = "time", p.x_unit = "s", p.y_label = title;
    report::Series s{title, "mm"};
    s.style = report::Series::Style::step;
    for (const Point& point : points_)
      s.x.push_back(point.t_s), s.y.push_back(1e3 * (point.*value));
    p.series.push_back(std::move(s));
    p.height_px = 140;
    return p;
  };
  return {"Over time",
          {plot("axial depth", &Point::depth_m), plot("radial immersion", &Point::width_m)}};
}

report::Report report_of(const ProgramPage& page) {
  report::Report report(page.title, page.subtitle);
  report.add(page.figures);
  report::Table table{"Findings", {}, {"line", "what", "tool", "x, y, z [mm]", "the line"}};
  for (const process::Finding& f : *page.findings) {
    std::string line = f.line == 0 ? "" : std::to_string(f.line);
    if (f.last_line > f.line) line += " to " + std::to_string(f.last_line);
    std::string at;
    for (std::size_t i = 0; i < 3; ++i)
      at += (i > 0 ? ", " : "") + report::Cell(1e3 * f.position[i], 5).text;
    table.rows.push_back(
        {{line, std::string(process::finding_name(f.kind)) + ": " + f.message,
          f.line == 0 ? "" : std::to_string(f.tool), at, line_text(*page.lines, f.line)},
         report::Level::alarm});
  }
  if (table.rows.empty())
    report.add(report::Note{"Nothing was found in what was checked."});
  else
    report.add(std::move(table));
  if (!page.not_checked.empty()) {
    report::Table rest{"Not checked", {}, {"what", "because"}};
    for (const std::string& text : page.not_checked) {
      const auto colon = text.find(": ");
      rest.rows.push_back({{text.substr(0, colon), text.substr(colon + 2)}, report::Level::none});
    }
    report.add(std::move(rest));
  }
  if (!is_flat(page.before->z_mm)) report.add(surface_of(*page.before, "The part before"));
  report.add(surface_of(*page.after, "The part afterwards"));
  report::HeatMap after = map_of(*page.after, "Afterwards, from above");
  after.caption = "Upper surface.";
  report.add(std::move(after));
  if (!is_flat(page.front->depth_mm))
    report.add(map_of(*page.front, "Afterwards, from the front", "Looking along y.", "x"));
  if (!is_flat(page.right->depth_mm))
    report.add(map_of(*page.right, "Afterwards, from the right", "Looking against x.", "y"));
  report::Plot path;
  path.title = "Path in material";
  path.caption = "The tip seen from above, by the share of the diameter that is in material.";
  path.x_label = "x", path.x_unit = "mm", path.y_label = "y";
  const double cross = 0.01 * (page.after->x_mm.back() - page.after->x_mm.front());
  path.x_range = range_with(page.after->x_mm, *page.findings, 0, 2 * cross);
  path.y_range = range_with(page.after->y_mm, *page.findings, 1, 2 * cross);
  path.height_px =
      height_px({path.x_range.from, path.x_range.to}, {path.y_range.from, path.y_range.to});
  path.series = page.history->path();
  if (!page.findings->empty()) path.series.push_back(crosses_of(*page.findings, cross));
  if (!path.series.empty()) report.add(std::move(path));
  if (!is_flat(page.before->z_mm)) report.add(map_of(*page.before, "Before, from above"));
  HeightPicture removed = *page.before;
  for (std::size_t i = 0; i < removed.z_mm.size(); ++i) {
    const double left = page.after->z_mm[i];
    removed.z_mm[i] -= std::isfinite(left) ? left : removed.bottom_mm;
    if (removed.z_mm[i] == 0) removed.z_mm[i] = kNothing;
  }
  report::HeatMap gone = map_of(removed, "Removed");
  gone.z_label = "depth from above";
  report.add(std::move(gone));
  report.add(page.history->over_time());
  return report;
}

}  // namespace servosense::cli
