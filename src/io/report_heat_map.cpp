// Heat maps of the report.
#include <algorithm>
#include <array>

#include "report_internal.hpp"

namespace servosense::report::detail {

namespace {

constexpr std::size_t kShades = 32;

using Rgb = std::array<int, 3>;

/// Sequential shades: viridis (van der Walt and Smith 2015), sampled at ninths. Even in lightness,
/// hence readable in grey and by colour-blind eyes.
constexpr std::array<Rgb, 9> kSequential = {{{68, 1, 84},
                                             {71, 44, 122},
                                             {59, 81, 139},
                                             {44, 113, 142},
                                             {33, 144, 141},
                                             {39, 173, 129},
                                             {92, 200, 99},
                                             {170, 220, 50},
                                             {253, 231, 37}}};
/// Diverging shades: ColorBrewer RdBu (Brewer 2003), blue to red.
constexpr std::array<Rgb, 9> kDiverging = {{{33, 102, 172},
                                            {67, 147, 195},
                                            {146, 197, 222},
                                            {209, 229, 240},
                                            {247, 247, 247},
                                            {253, 219, 199},
                                            {244, 165, 130},
                                            {214, 96, 77},
                                            {178, 24, 43}}};

std::string shade(bool diverging, std::size_t index) {
  const auto& table = diverging ? kDiverging : kSequential;
  const double at = 8.0 * static_cast<double>(index) / static_cast<double>(kShades - 1);
  const auto low = std::min<std::size_t>(static_cast<std::size_t>(at), 7);
  std::string out = "#";
  for (std::size_t c = 0; c < 3; ++c) {
    const double mixed =
        table[low][c] + (at - static_cast<double>(low)) * (table[low + 1][c] - table[low][c]);
    const auto value = static_cast<unsigned>(std::lround(mixed));
    out += "0123456789abcdef"[value / 16];
    out += "0123456789abcdef"[value % 16];
  }
  return out;
}

std::string trouble_with(const HeatMap& map) {
  const std::size_t columns = map.x_edges.size(), rows = map.y_edges.size();
  if (columns < 2 || rows < 2 || map.z.empty()) return "The map has no cell.";
  if (map.z.size() != (columns - 1) * (rows - 1))
    return "The map has " + count_text(map.z.size()) + " values for " + count_text(columns - 1) +
           " columns and " + count_text(rows - 1) + " rows.";
  for (const auto* edges : {&map.x_edges, &map.y_edges})
    for (std::size_t i = 0; i < edges->size(); ++i)
      if (!drawable((*edges)[i], false) || (i > 0 && !((*edges)[i] > (*edges)[i - 1])))
        return "The edges of the map are not ascending numbers.";
  return {};
}

struct Grid {
  std::vector<double> x_edges, y_edges, z;
  [[nodiscard]] std::size_t columns() const { return x_edges.size() - 1; }
  [[nodiscard]] std::size_t rows() const { return y_edges.size() - 1; }
  [[nodiscard]] double at(std::size_t row, std::size_t column) const {
    return z[row * columns() + column];
  }
};

/// Every `group`-th edge and the last.
std::vector<double> thinned(const std::vector<double>& edges, std::size_t group) {
  std::vector<double> out;
  for (std::size_t i = 0; i + 1 < edges.size(); i += group) out.push_back(edges[i]);
  out.push_back(edges.back());
  return out;
}

/// The map on a grid that a page can carry; a group of cells shows its largest magnitude, so that
/// no peak is lost.
Grid grid_of(const HeatMap& map, std::size_t most_columns, std::size_t most_rows) {
  const std::size_t columns = map.x_edges.size() - 1, rows = map.y_edges.size() - 1;
  const std::size_t across = (columns + most_columns - 1) / most_columns;
  const std::size_t down = (rows + most_rows - 1) / most_rows;
  Grid g{thinned(map.x_edges, across), thinned(map.y_edges, down), {}};
  g.z.assign(g.columns() * g.rows(), std::numeric_limits<double>::quiet_NaN());
  for (std::size_t r = 0; r < rows; ++r)
    for (std::size_t c = 0; c < columns; ++c) {
      const double value = map.z[r * columns + c];
      double& cell = g.z[r / down * g.columns() + c / across];
      if (drawable(value, false) && !(std::abs(value) <= std::abs(cell))) cell = value;
    }
  return g;
}

/// One path per shade, made of horizontal runs of equal cells.
std::string cells_svg(const Grid& g, const Axis& x, const Axis& y, const Axis& z, bool diverging,
                      double height_px) {
  std::vector<std::string> paths(kShades);
  const auto shade_at = [&](std::size_t r, std::size_t c) {
    const double value = g.at(r, c);
    if (std::isnan(value)) return kShades;
    const double at = std::clamp(z.at(value), 0.0, 1.0) * static_cast<double>(kShades);
    return std::min(static_cast<std::size_t>(at), kShades - 1);
  };
  for (std::size_t r = 0; r < g.rows(); ++r) {
    const int top = y_unit(y, g.y_edges[r + 1], height_px);
    const int bottom = y_unit(y, g.y_edges[r], height_px);
    for (std::size_t c = 0; c < g.columns();) {
      const std::size_t s = shade_at(r, c);
      std::size_t end = c + 1;
      while (end < g.columns() && shade_at(r, end) == s) ++end;
      if (s < kShades) {
        const int left = x_unit(x, g.x_edges[c]), right = x_unit(x, g.x_edges[end]);
        put(paths[s], "M", std::to_string(left), " ", std::to_string(top), "h",
            std::to_string(right - left), "v", std::to_string(bottom - top), "H",
            std::to_string(left), "z");
      }
      c = end;
    }
  }
  std::string out = "<g class=\"cells\">";
  for (std::size_t s = 0; s < kShades; ++s)
    if (!paths[s].empty())
      put(out, "<path fill=\"", shade(diverging, s), "\" d=\"", paths[s], "\"/>");
  return out + "</g>";
}

std::string colour_bar(const HeatMap& map, const Axis& z) {
  std::string out = "<div class=\"colour-bar\">";
  const std::string title = z.title(map.z_label);
  if (!title.empty()) put(out, "<span>", escaped(title), "</span>");
  out += "<svg width=\"100%\" height=\"34\" aria-hidden=\"true\">";
  for (std::size_t s = 0; s < kShades; ++s)
    put(out, "<rect x=\"", plain(100.0 * static_cast<double>(s) / kShades), "%\" width=\"",
        plain(100.0 / kShades + 0.1), "%\" height=\"14\" fill=\"", shade(map.diverging, s), "\"/>");
  for (const Tick& t : ticks_across(z, 240))
    put(out, "<line x1=\"", plain(100 * t.at), "%\" x2=\"", plain(100 * t.at),
        "%\" y1=\"14\" y2=\"18\"/><text class=\"tick x\" x=\"", plain(100 * t.at), "%\" y=\"31\">",
        t.label, "</text>");
  return out + "</svg></div>\n";
}

}  // namespace

std::string html_of(const HeatMap& map, const std::string& id, std::size_t lens_columns) {
  Picture p;
  p.id = id;
  p.title = map.title;
  p.caption = map.caption;
  p.x_label = map.x_label;
  p.y_label = map.y_label;
  p.marks = map.marks;
  p.height_px = height_of(map.height_px);
  const std::string trouble = trouble_with(map);
  if (!trouble.empty()) {
    p.remarks.push_back(trouble);
    p.empty_words = "Nothing to draw";
    p.x = make_axis({}, {}, false, map.x_unit, 0);
    p.y = make_axis({}, {}, false, map.y_unit, 0);
    p.description = trouble;
    return html_of(p);
  }
  p.x = make_axis({map.x_edges.front(), map.x_edges.back()}, {}, false, map.x_unit, 0);
  p.y = make_axis({map.y_edges.front(), map.y_edges.back()}, {}, false, map.y_unit, 0);
  const Grid grid = grid_of(map, kMapColumns, kMapRows);
  Extent z_data;
  std::size_t infinite = 0;
  for (const double v : map.z) infinite += !std::isnan(v) && !drawable(v, false) ? 1U : 0U;
  for (const double v : grid.z)
    if (!std::isnan(v)) z_data.include(v);
  // The extremes of a group may hide those of smaller magnitude; the scale shows what is drawn.
  if (map.diverging && z_data.any()) {
    const double most = std::max(std::abs(z_data.low), std::abs(z_data.high));
    z_data.include(-most);
    z_data.include(most);
  }
  const Axis z = make_axis(z_data, {}, false, map.z_unit, 0);
  p.z_unit = z.unit;
  p.under = cells_svg(grid, p.x, p.y, z, map.diverging, p.height_px);
  p.lens = ",\"cells\":{\"x\":" + numbers_json(grid.x_edges) +
           ",\"y\":" + numbers_json(grid.y_edges) + ",\"scale\":" + exact(z.scale) + ",\"data\":\"";
  std::vector<float> values;
  for (const double v : grid.z) values.push_back(static_cast<float>(std::clamp(v, -3e38, 3e38)));
  if (lens_columns > 0) p.lens += base64(values);
  p.lens += "\"}";
  for (std::size_t i = 0; i < map.contours.size(); ++i) {
    const Series& s = map.contours[i];
    const Facts facts = facts_of(s, false, false);
    const std::string d = path_of(s, facts, p.x, p.y, p.height_px);
    put(p.over, "<path class=\"contour halo\" d=\"", d, "\"/><path class=\"contour c",
        std::to_string(i % 3), "\" d=\"", d, "\"/>");
    if (!s.name.empty()) p.legend.push_back({s.name, "contour c" + std::to_string(i % 3)});
    remark_omitted(p.remarks, s.name, facts.omitted);
  }
  if (infinite > 0)
    p.remarks.push_back(count_text(infinite) + " infinite " +
                        (infinite == 1 ? "value is" : "values are") + " left empty.");
  if (z_data.any()) {
    p.below = colour_bar(map, z);
    p.description = "Map of " + count_text(map.x_edges.size() - 1) + " by " +
                    count_text(map.y_edges.size() - 1) + " cells, values from " +
                    z.value(z_data.low) + " to " + z.value(z_data.high) + ".";
  } else {
    p.empty_words = "Nothing to draw";
    p.remarks.emplace_back("No cell of the map has a value.");
  }
  return html_of(p);
}

}  // namespace servosense::report::detail
