// Plots of the report, alone and stacked: each turns its data into a Picture.
#include <algorithm>

#include "report_internal.hpp"

namespace servosense::report::detail {

namespace {

constexpr std::size_t kColours = 8;  // of the style sheet

/// The unit that all series share, or "" when they differ.
std::string common_unit(const std::vector<Series>& series) {
  if (series.empty()) return {};
  for (const Series& s : series)
    if (s.unit != series.front().unit) return {};
  return series.front().unit;
}

std::string swatch_of(const Series& series, std::size_t index) {
  const std::size_t colour = series.colour >= 0 ? static_cast<std::size_t>(series.colour) : index;
  std::string out = "curve s" + std::to_string(colour % kColours);
  if (colour >= kColours || series.dashed) out += " again";
  if (series.broad) out += " broad";
  if (series.style == Series::Style::points) out += " points";
  if (series.faint) out += " faint";
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

}  // namespace servosense::report::detail
