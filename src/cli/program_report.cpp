#include "program_report.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace servosense::cli {
namespace {

constexpr std::size_t kCells = 240;
constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
/// Shares of the diameter that are one colour each (chosen).
constexpr std::array<double, 3> kShares = {0.25, 0.5, 0.75};

/// Of a drawing in which x and y have one scale.
double height_px(const HeightPicture& picture) {
  constexpr double kWide = 853;
  const double ratio =
      (picture.y_mm.back() - picture.y_mm.front()) / (picture.x_mm.back() - picture.x_mm.front());
  return std::clamp(kWide * ratio, 80.0, 1200.0);
}

/// Whether there is a picture in it: the top of a box has none.
bool is_flat(const HeightPicture& picture) {
  double low = 1e300, high = -1e300;
  for (const double z : picture.z_mm) {
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
  map.height_px = height_px(picture);
  return map;
}

std::string line_text(const std::vector<std::string>& lines, std::size_t line) {
  return line > 0 && line <= lines.size() ? lines[line - 1] : std::string();
}

}  // namespace

HeightPicture::HeightPicture(const process::Workpiece& part) {
  const auto plan = part.plan();
  const std::array<std::size_t, 2> cells = {std::min(kCells, plan[0]), std::min(kCells, plan[1])};
  const auto edges = [&](std::size_t axis) {
    std::vector<double> all;
    const double size = static_cast<double>(part.cells()[axis]) * part.cell_m()[axis];
    for (std::size_t i = 0; i <= cells[axis]; ++i)
      all.push_back(1e3 * (part.origin()[axis] +
                           size * static_cast<double>(i) / static_cast<double>(cells[axis])));
    return all;
  };
  x_mm = edges(0), y_mm = edges(1);
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

void CutHistory::add(const process::Engagement& e, const ProgramMoves& moves, double diameter_m) {
  if (!e.cuts()) return;
  if (count_++ % every_ != 0) return;
  const MoveTechnology& t = moves.moves[e.move];
  points_.push_back({t.begin_s + (t.end_s - t.begin_s) * e.to_share, e.place[0], e.place[1],
                     e.axial_depth_m, e.radial_immersion_m,
                     diameter_m > 0 ? e.radial_immersion_m / diameter_m : 0});
  if (points_.size() < kMost) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points_.size(); i += 2) points_[kept++] = points_[i];
  points_.resize(kept);
  every_ *= 2;
}

std::vector<report::Series> CutHistory::path() const {
  std::vector<report::Series> all;
  const std::array<const char*, 4> names = {"up to 25 % of the diameter in material", "25 to 50 %",
                                            "50 to 75 %", "above 75 %"};
  for (std::size_t k = 0; k < names.size(); ++k) {
    report::Series s{names[k], "mm"};
    s.style = report::Series::Style::points;
    s.colour = static_cast<int>(k);
    for (const Point& p : points_) {
      const std::size_t of = static_cast<std::size_t>(
          std::ranges::count_if(kShares, [&](double share) { return p.share > share; }));
      if (of != k) continue;
      s.x.push_back(1e3 * p.x_m), s.y.push_back(1e3 * p.y_m);
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
  report::Series places{"findings", "mm"};
  places.style = report::Series::Style::points;
  places.colour = 5;
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
    places.x.push_back(1e3 * f.position[0]), places.y.push_back(1e3 * f.position[1]);
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
  report.add(report::Surface{
      "The part afterwards", "Seen from the front left, from above; undercuts do not show.",
      page.after->x_mm, page.after->y_mm, page.after->z_mm, page.after->bottom_mm});
  report::HeatMap after = map_of(*page.after, "After");
  after.caption = "Upper surface seen from above.";
  report.add(std::move(after));
  report::Plot path;
  path.title = "Path in material";
  path.caption = "The tip seen from above, by the share of the diameter that is in material.";
  path.x_label = "x", path.x_unit = "mm", path.y_label = "y";
  path.x_range = {page.after->x_mm.front(), page.after->x_mm.back()};
  path.y_range = {page.after->y_mm.front(), page.after->y_mm.back()};
  path.height_px = height_px(*page.after);
  path.series = page.history->path();
  if (!places.x.empty()) path.series.push_back(std::move(places));
  if (!path.series.empty()) report.add(std::move(path));
  if (!is_flat(*page.before)) report.add(map_of(*page.before, "Before"));
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
