// Plots, histograms and maps of the report: each turns its data into a Picture.
#include <algorithm>
#include <array>
#include <numeric>

#include "report_internal.hpp"

namespace servosense::report::detail {

namespace {

constexpr double kPadding = 0.04;    // of the y span, above and below the curves
constexpr double kFlattest = 0.1;    // limits may squeeze the curves to this part of the height
constexpr std::size_t kColours = 8;  // of the style sheet
constexpr std::size_t kShades = 32;  // of a map

double height_of(double wanted_px) {
  return std::isfinite(wanted_px) ? std::clamp(std::round(wanted_px), 60.0, 2000.0) : 240;
}

const char* values_word(std::size_t count) { return count == 1 ? " value " : " values "; }

void remark_omitted(std::vector<std::string>& remarks, const std::string& name, const Omitted& o) {
  const std::string of = name.empty() ? "" : "of “" + name + "” ";
  if (o.infinite > 0)
    remarks.push_back(count_text(o.infinite) + values_word(o.infinite) + of +
                      (o.infinite == 1 ? "is" : "are") + " infinite and left out.");
  if (o.not_positive > 0)
    remarks.push_back(count_text(o.not_positive) + values_word(o.not_positive) + of +
                      "cannot stand on a logarithmic axis, being zero or negative, and " +
                      (o.not_positive == 1 ? "is" : "are") + " left out.");
}

/// The unit that all series share, or "" when they differ.
std::string common_unit(const std::vector<Series>& series) {
  if (series.empty()) return {};
  for (const Series& s : series)
    if (s.unit != series.front().unit) return {};
  return series.front().unit;
}

std::string swatch_of(const Series& series, std::size_t index) {
  std::string out = "curve s" + std::to_string(index % kColours);
  if (index >= kColours) out += " again";
  if (series.style == Series::Style::points) out += " points";
  return out;
}

Extent x_extent(const Plot& plot, const std::vector<Facts>& facts) {
  Extent x;
  for (const Facts& f : facts)
    if (f.x.any()) x.include(f.x.low), x.include(f.x.high);
  if (!x.any())
    for (const Mark& m : plot.marks)
      if (drawable(m.x, plot.log_x)) x.include(m.x);
  return x;
}

std::vector<Facts> all_facts(const Plot& plot) {
  std::vector<Facts> facts;
  for (const Series& s : plot.series) facts.push_back(facts_of(s, plot.log_x, plot.log_y));
  return facts;
}

/// Limits widen the axis where that does not flatten the curves.
Extent with_limits(Extent y, const std::vector<Limit>& limits, bool log) {
  const Extent curves = y;
  for (const Limit& limit : limits) {
    if (!drawable(limit.y, log)) continue;
    Extent wider = y;
    wider.include(limit.y);
    const bool flattens =
        log ? std::log(curves.high / curves.low) < kFlattest * std::log(wider.high / wider.low)
            : curves.span() < kFlattest * wider.span();
    if (!curves.any() || curves.span() == 0 || !flattens) y = wider;
  }
  return y;
}

std::string plot_html(const Plot& plot, const std::vector<Facts>& facts, const Axis& x,
                      bool x_tick_labels, const std::string& id, std::size_t lens_columns) {
  Picture p;
  p.id = id;
  p.title = plot.title;
  p.caption = plot.caption;
  p.x = x;
  p.x_label = plot.x_label;
  // The axis is the best place for the name of a single curve.
  const bool alone = plot.series.size() == 1;
  p.y_label = plot.y_label.empty() && alone ? plot.series[0].name : plot.y_label;
  p.x_tick_labels = x_tick_labels;
  p.height_px = height_of(plot.height_px);
  p.marks = plot.marks;
  p.spans = plot.spans;
  p.limits = plot.limits;

  Extent y;
  std::size_t drawn = 0;
  for (const Facts& f : facts) {
    if (f.y.any()) y.include(f.y.low), y.include(f.y.high);
    drawn += f.drawn;
  }
  const std::string unit = common_unit(plot.series);
  p.y =
      make_axis(with_limits(y, plot.limits, plot.log_y), plot.y_range, plot.log_y, unit, kPadding);

  p.description = (p.x_label.empty() ? "Horizontal axis" : p.x_label) + " from " +
                  p.x.value(p.x.from) + " to " + p.x.value(p.x.to) + ".";
  p.lens = ",\"series\":[";
  for (std::size_t i = 0; i < plot.series.size(); ++i) {
    const Series& s = plot.series[i];
    const Facts& f = facts[i];
    const std::string swatch = swatch_of(s, i);
    put(p.over, "<path class=\"", swatch, "\" d=\"", path_of(s, f, p.x, p.y, p.height_px), "\"/>");
    const std::string own_unit =
        unit.empty() && !s.unit.empty() ? " [" + pretty_unit(s.unit) + "]" : "";
    if (!alone || (!s.name.empty() && s.name != plot.title && s.name != p.y_label))
      p.legend.push_back(
          {(s.name.empty() ? "Curve " + std::to_string(i + 1) : s.name) + own_unit, swatch});
    if (f.drawn > 0)
      put(p.description, " ", s.name.empty() ? "Curve" : s.name, ": ", count_text(f.drawn),
          " samples from ", p.y.value(f.y.low), " to ", p.y.value(f.y.high), ".");
    put(p.lens, i == 0 ? "" : ",", lens_json(s, f, p.x, p.y, lens_columns));

    remark_omitted(p.remarks, s.name, f.omitted);
    if (s.x.size() != s.y.size())
      p.remarks.push_back("“" + s.name + "” has " + count_text(s.x.size()) + " x and " +
                          count_text(s.y.size()) + " y values; the surplus is left out.");
    const std::string subject = s.name.empty() ? "The curve" : "“" + s.name + "”";
    if (f.drawn == 0)
      p.remarks.push_back(subject + " has no value to draw.");
    else if (f.drawn == 1)
      p.remarks.push_back(subject + " is a single value: " + p.y.value(f.y.low) + ".");
    else if (f.y.span() == 0)
      p.remarks.push_back(subject + " is constant: " + p.y.value(f.y.low) + ".");
  }
  p.lens += "]";
  if (drawn == 0) p.empty_words = "Nothing to draw";
  if (plot.series.empty()) p.remarks.emplace_back("This picture has no curve.");
  if (!plot.marks.empty())
    put(p.description, " ", count_text(plot.marks.size()),
        plot.marks.size() == 1 ? " mark." : " marks.");
  return html_of(p);
}

Axis x_axis(const Plot& plot, Extent data) {
  // Curves reach both ends, but for a single point.
  return make_axis(data, plot.x_range, plot.log_x, plot.x_unit, 0);
}

// ---- histogram -----------------------------------------------------------------------------

/// Value below which this fraction of the sorted values lies, interpolated.
double quantile(const std::vector<double>& sorted, double fraction) {
  const double at = fraction * static_cast<double>(sorted.size() - 1);
  const auto i = static_cast<std::size_t>(at);
  if (i + 1 >= sorted.size()) return sorted.back();
  return sorted[i] + (at - static_cast<double>(i)) * (sorted[i + 1] - sorted[i]);
}

struct Bins {
  std::vector<double> edges, counts;
  double total = 0, mean = 0, deviation = 0;
  std::size_t left_out = 0;
  std::string trouble;
};

Bins bins_of_values(const Histogram& h) {
  Bins b;
  std::vector<double> sorted;
  std::size_t gaps = 0;
  for (const double v : h.values) {
    if (drawable(v, false))
      sorted.push_back(v);
    else
      gaps += std::isnan(v) ? 1U : 0U;
  }
  b.left_out = h.values.size() - sorted.size() - gaps;
  if (sorted.empty()) return b;
  std::sort(sorted.begin(), sorted.end());
  const double n = static_cast<double>(sorted.size());
  const double low = sorted.front(), high = sorted.back(), span = high - low;
  double width = 0;
  double base = 0;
  if (!(span > 1e-12 * std::max(std::abs(low), std::abs(high)))) {  // constant
    width = low == 0 ? 1 : nice_step(std::abs(low) / 10);
    base = low - width / 2;
  } else {
    const double spread = quantile(sorted, 0.75) - quantile(sorted, 0.25);
    width = spread > 0 ? 2 * spread / std::cbrt(n) : span / std::ceil(std::sqrt(n));
    width = nice_step(std::max(width, span / 100));  // rounding up leaves at most 200
    while (span / width < 5 && n >= 50) width = nice_step(width / 2.6);
    base = std::floor(low / width) * width;
  }
  const auto count = static_cast<std::size_t>(std::floor((high - base) / width)) + 1;
  for (std::size_t i = 0; i <= count; ++i) b.edges.push_back(base + static_cast<double>(i) * width);
  b.counts.assign(count, 0);
  for (const double v : sorted) {
    b.counts[std::min(static_cast<std::size_t>(std::max(0.0, (v - base) / width)), count - 1)] += 1;
    b.mean += (v - low) / n;  // relative to the smallest, so that an offset costs no digits
  }
  double squares = 0;
  for (const double v : sorted) squares += (v - low - b.mean) * (v - low - b.mean);
  b.mean += low;
  b.deviation = n > 1 ? std::sqrt(squares / (n - 1)) : 0;
  b.total = n;
  return b;
}

Bins bins_of_counts(const Histogram& h) {
  Bins b;
  if (h.edges.empty() && h.counts.empty()) return b;
  if (h.edges.size() != h.counts.size() + 1) {
    b.trouble = "The histogram has " + count_text(h.edges.size()) + " edges for " +
                count_text(h.counts.size()) + " bins; it needs one more edge than bins.";
    return b;
  }
  for (std::size_t i = 0; i < h.edges.size(); ++i)
    if (!drawable(h.edges[i], false) || (i > 0 && !(h.edges[i] > h.edges[i - 1]))) {
      b.trouble = "The edges of the histogram are not ascending numbers.";
      return b;
    }
  b.edges = h.edges;
  for (const double c : h.counts) {
    const bool good = drawable(c, false) && c >= 0;
    b.counts.push_back(good ? c : 0);
    b.left_out += good ? 0U : 1U;
    b.total += b.counts.back();
  }
  if (!(b.total > 0)) return b;
  for (std::size_t i = 0; i < b.counts.size(); ++i)
    b.mean += (b.edges[i] / 2 + b.edges[i + 1] / 2) * b.counts[i] / b.total;
  double variance = 0;
  for (std::size_t i = 0; i < b.counts.size(); ++i) {
    const double away = b.edges[i] / 2 + b.edges[i + 1] / 2 - b.mean;
    variance += away * away * b.counts[i] / b.total;
  }
  b.deviation = std::sqrt(variance);
  return b;
}

/// Density of the normal distribution times bin width and total: comparable with the counts.
Series normal_curve(const Bins& bins, double from, double to) {
  Series curve;
  curve.name =
      "Normal, mean " + number(bins.mean) + ", standard deviation " + number(bins.deviation);
  constexpr int kPoints = 200;
  for (int i = 0; i <= kPoints; ++i) {
    const double x = from + (to - from) * i / kPoints;
    const auto above = std::upper_bound(bins.edges.begin(), bins.edges.end(), x);
    const auto at = std::clamp<std::ptrdiff_t>(above - bins.edges.begin(), 1,
                                               static_cast<std::ptrdiff_t>(bins.edges.size()) - 1);
    const double width =
        bins.edges[static_cast<std::size_t>(at)] - bins.edges[static_cast<std::size_t>(at) - 1];
    const double z = (x - bins.mean) / bins.deviation;
    curve.x.push_back(x);
    curve.y.push_back(bins.total * width / bins.deviation * std::exp(-z * z / 2) /
                      std::sqrt(2 * 3.14159265358979323846));
  }
  return curve;
}

// ---- heat map ------------------------------------------------------------------------------

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

std::string numbers_json(const std::vector<double>& values) {
  std::string out = "[";
  for (std::size_t i = 0; i < values.size(); ++i) put(out, i == 0 ? "" : ",", exact(values[i]));
  return out + "]";
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

std::string html_of(const Plot& plot, const std::string& id, std::size_t lens_columns) {
  const std::vector<Facts> facts = all_facts(plot);
  return plot_html(plot, facts, x_axis(plot, x_extent(plot, facts)), true, id, lens_columns);
}

std::string html_of(const PlotGroup& group, const std::string& id, std::size_t lens_columns) {
  std::string out = "<section class=\"group\">\n";
  if (!group.title.empty()) put(out, "<h3 class=\"group-title\">", escaped(group.title), "</h3>\n");
  std::vector<std::vector<Facts>> facts;
  Extent x;
  for (const Plot& plot : group.plots) {
    facts.push_back(all_facts(plot));
    const Extent own = x_extent(plot, facts.back());
    if (own.any()) x.include(own.low), x.include(own.high);
  }
  for (std::size_t i = 0; i < group.plots.size(); ++i) {
    const bool last = i + 1 == group.plots.size();
    Plot framed = group.plots[i];  // the first plot names the axis for all
    framed.x_label = group.plots[0].x_label;
    put(out, plot_html(framed, facts[i], x_axis(group.plots[0], x), last,
                       id + "-" + std::to_string(i + 1), lens_columns));
  }
  return out + "</section>\n";
}

std::string html_of(const Histogram& h, const std::string& id) {
  const Bins bins = h.values.empty() ? bins_of_counts(h) : bins_of_values(h);
  Picture p;
  p.id = id;
  p.title = h.title;
  p.caption = h.caption;
  p.x_label = h.x_label;
  p.y_label = "Count";
  p.marks = h.limits;
  p.height_px = height_of(h.height_px);
  if (!bins.trouble.empty()) p.remarks.push_back(bins.trouble);
  if (bins.left_out > 0)
    p.remarks.push_back(count_text(bins.left_out) + values_word(bins.left_out) +
                        (bins.left_out == 1 ? "is" : "are") + " not usable and left out.");

  Extent x, y;
  const double floor = h.log_count ? 0.5 : 0;  // below one count on a logarithmic axis
  y.include(h.log_count ? floor : 0);
  if (!bins.edges.empty()) {
    x.include(bins.edges.front());
    x.include(bins.edges.back());
    const double span = x.span();
    for (const Mark& m : h.limits) {
      Extent wider = x;
      if (drawable(m.x, false)) wider.include(m.x);
      if (span >= kFlattest * wider.span()) x = wider;
    }
  }
  for (const double c : bins.counts) y.include(c);
  Series normal;
  const bool curve = h.normal_curve && bins.total > 1 && bins.deviation > 0;
  if (curve) {
    normal = normal_curve(bins, x.low, x.high);
    for (const double v : normal.y) y.include(v);
    if (h.log_count)
      for (double& v : normal.y)
        if (v < floor) v = std::numeric_limits<double>::quiet_NaN();
  }
  if (h.log_count) y.low = floor;
  p.x = make_axis(x, {}, false, h.x_unit, x.any() && x.low == bins.edges.front() ? 0 : 0.02);
  p.y = make_axis(y.span() > 0 ? y : Extent{}, {floor, std::numeric_limits<double>::quiet_NaN()},
                  h.log_count, "", kPadding);

  const int bottom = y_unit(p.y, p.y.from, p.height_px);
  std::string bars;
  for (std::size_t i = 0; i < bins.counts.size(); ++i) {
    if (!(bins.counts[i] > 0)) continue;
    const int left = x_unit(p.x, bins.edges[i]), right = x_unit(p.x, bins.edges[i + 1]);
    const int top = y_unit(p.y, std::max(bins.counts[i], p.y.from), p.height_px);
    put(bars, "M", std::to_string(left), " ", std::to_string(bottom), "V", std::to_string(top), "H",
        std::to_string(right), "V", std::to_string(bottom), "z");
  }
  if (!bars.empty()) put(p.over, "<path class=\"bars\" d=\"", bars, "\"/>");
  if (curve) {
    const Facts facts = facts_of(normal, false, h.log_count);
    put(p.over, "<path class=\"curve s1\" d=\"", path_of(normal, facts, p.x, p.y, p.height_px),
        "\"/>");
    p.legend.push_back(
        {normal.name + (h.x_unit.empty() ? "" : " " + pretty_unit(h.x_unit)), "curve s1"});
  }
  if (!(bins.total > 0)) {
    p.empty_words = "Nothing to draw";
    p.remarks.emplace_back("The histogram has no value.");
  }
  put(p.description, "Histogram of ", number(bins.total, 9), " values in ",
      count_text(bins.counts.size()), " bins");
  if (bins.total > 0)
    put(p.description, ", mean ", p.x.value(bins.mean), ", standard deviation ",
        number(bins.deviation), h.x_unit.empty() ? "" : " ", pretty_unit(h.x_unit));
  p.description += ".";
  if (!bins.edges.empty())
    put(p.lens, ",\"bars\":{\"edges\":", numbers_json(bins.edges),
        ",\"counts\":", numbers_json(bins.counts), "}");
  return html_of(p);
}

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
  const Grid grid = grid_of(map, 240, 120);
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
