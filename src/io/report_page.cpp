// The page around the pictures: key figures, tables, bars, text, and the file.
#include <algorithm>

#include "report_internal.hpp"
#include "servosense/io/write_file.hpp"

namespace servosense::report {

namespace detail {

void put_caption(std::string& out, const std::string& title, const std::string& caption) {
  if (title.empty() && caption.empty()) return;
  out += "<figcaption>";
  if (!title.empty()) put(out, "<h3>", escaped(title), "</h3>");
  if (!caption.empty()) put(out, "<p>", escaped(caption), "</p>");
  out += "</figcaption>\n";
}

namespace {

/// Class and, for the ear and the monochrome printer, the word of a level.
std::string class_of(Level level) {
  return level == Level::none ? "" : std::string(" class=\"") + level_class(level) + "\"";
}

void put_cell(std::string& out, const char* tag, const Cell& cell, const char* scope = "") {
  put(out, "<", tag, scope, cell.is_number ? " class=\"number\">" : ">", escaped(cell.text), "</",
      tag, ">");
}

std::string html_of(const KeyFigures& key) {
  std::string out = "<dl class=\"key\">\n";
  for (const KeyFigure& f : key.figures) {
    const std::string word = level_word(f.level);
    put(out, "<div", class_of(f.level), "><dt>", escaped(f.label), "</dt><dd><b>",
        escaped(f.value.text), "</b>", unit_after(f.unit));
    if (!word.empty()) put(out, "<em>", word, "</em>");
    out += "</dd></div>\n";
  }
  return out + "</dl>\n";
}

std::string html_of(const Table& table) {
  if (table.folded) {
    Table open = table;
    open.folded = false;
    open.title.clear();
    return "<details><summary>" + escaped(table.title) + "</summary>\n" + html_of(open) +
           "</details>\n";
  }
  std::string out = "<figure class=\"table\">\n";
  put_caption(out, table.title, table.caption);
  std::size_t columns = table.header.size();
  for (const Row& row : table.rows) columns = std::max(columns, row.cells.size());
  // A column heads to the right when the first number below it does.
  const auto is_number = [&](std::size_t column) {
    for (const Row& row : table.rows)
      if (column < row.cells.size() && row.cells[column].is_number) return true;
    return false;
  };
  out += "<div class=\"scroll\" tabindex=\"0\"><table>\n";
  if (!table.header.empty()) {
    out += "<thead><tr>";
    for (std::size_t c = 0; c < columns; ++c) {
      Cell head(c < table.header.size() ? table.header[c] : std::string());
      head.is_number = is_number(c);
      put_cell(out, "th", head, " scope=\"col\"");
    }
    out += "</tr></thead>\n";
  }
  out += "<tbody>\n";
  for (const Row& row : table.rows) {
    put(out, "<tr", class_of(row.level), ">");
    for (std::size_t c = 0; c < columns; ++c)
      put_cell(out, "td", c < row.cells.size() ? row.cells[c] : Cell(""));
    out += "</tr>\n";
  }
  out += "</tbody>\n</table></div>\n";
  if (table.rows.empty()) out += "<p class=\"remark\">The table has no row.</p>\n";
  return out + "</figure>\n";
}

std::string html_of(const BarChart& chart) {
  std::string out = "<figure class=\"table\">\n";
  put_caption(out, chart.title, chart.caption);
  Extent extent;
  extent.include(0);
  for (const Bar& b : chart.bars)
    if (drawable(b.value, false)) extent.include(b.value);
  const double span = extent.span() > 0 ? extent.span() : 1;
  const double zero = -extent.low / span;
  out += "<table class=\"bars\">\n";
  const std::string head =
      chart.value_label + (chart.unit.empty() ? "" : " [" + pretty_unit(chart.unit) + "]");
  if (head.find_first_not_of(' ') != std::string::npos)
    put(out, "<thead><tr><th></th><th></th><th class=\"number\">", escaped(head),
        "</th></tr></thead>\n");
  out += "<tbody>\n";
  for (const Bar& b : chart.bars) {
    put(out, "<tr", class_of(b.level), "><th scope=\"row\">", escaped(b.name), "</th><td>");
    if (drawable(b.value, false)) {
      const double from = std::min(b.value, 0.0) / span + zero,
                   to = std::max(b.value, 0.0) / span + zero;
      put(out, "<svg width=\"100%\" height=\"16\" aria-hidden=\"true\"><rect class=\"bar\" x=\"",
          plain(100 * from), "%\" width=\"", plain(100 * (to - from)),
          "%\" height=\"16\" rx=\"2\"/><line class=\"zero\" x1=\"", plain(100 * zero), "%\" x2=\"",
          plain(100 * zero), "%\" y2=\"16\"/></svg>");
    }
    put(out, "</td><td class=\"number\">", number(b.value), "</td></tr>\n");
  }
  out += "</tbody>\n</table>\n";
  if (chart.bars.empty()) out += "<p class=\"remark\">The chart has no bar.</p>\n";
  return out + "</figure>\n";
}

std::string html_of(const Note& note) {
  const std::string word = level_word(note.level);
  std::string out = "<p class=\"note " + std::string(level_class(note.level)) + "\" role=\"note\">";
  if (!word.empty()) put(out, "<b>", word, ":</b> ");
  return out + escaped(note.text) + "</p>\n";
}

/// Finest envelope behind the lens for which all curves of the page stay within the budget.
std::size_t lens_columns(const std::vector<Block>& blocks) {
  constexpr std::size_t kBudget = 1'800'000, kBytesPerColumn = 11;  // two floats in base64
  std::vector<std::size_t> lengths;
  const auto add = [&](const std::vector<Series>& series) {
    for (const Series& s : series) lengths.push_back(std::min(s.x.size(), s.y.size()));
  };
  std::size_t cells = 0;
  for (const Block& block : blocks) {
    if (const auto* plot = std::get_if<Plot>(&block)) add(plot->series);
    if (const auto* group = std::get_if<PlotGroup>(&block))
      for (const Plot& p : group->plots) add(p.series);
    if (const auto* map = std::get_if<HeatMap>(&block))
      cells += std::min<std::size_t>(map->z.size(), kMapColumns * kMapRows) / 2;
  }
  for (std::size_t columns = 8192; columns >= 256; columns /= 2) {
    std::size_t total = cells;
    for (const std::size_t n : lengths) total += std::min(n + n / 4, columns);
    if (total * kBytesPerColumn <= kBudget) return columns;
  }
  return 0;
}

}  // namespace

}  // namespace detail

std::string Report::html() const {
  using namespace detail;
  std::string out;
  // The policy keeps the promise that nothing is fetched, whatever a label may hold.
  put(out,
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src "
      "'unsafe-inline'; script-src 'unsafe-inline'\"/>\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n"
      "<meta name=\"color-scheme\" content=\"light dark\"/>\n<title>",
      escaped(title_), "</title>\n<style>\n", kStyle, "</style>\n</head>\n<body>\n<header>\n<h1>",
      escaped(title_), "</h1>\n");
  if (!subtitle_.empty()) put(out, "<p>", escaped(subtitle_), "</p>\n");
  out += "</header>\n";

  std::size_t headings = 0;
  for (const Block& b : blocks_) headings += std::holds_alternative<Heading>(b) ? 1U : 0U;
  if (headings >= 4) {
    out += "<nav aria-label=\"Contents\"><ul>";
    std::size_t i = 0;
    for (const Block& b : blocks_)
      if (const auto* heading = std::get_if<Heading>(&b))
        put(out, "<li><a href=\"#h", std::to_string(++i), "\">", escaped(heading->text),
            "</a></li>");
    out += "</ul></nav>\n";
  }

  out += "<main>\n";
  const std::size_t columns = lens_columns(blocks_);
  std::size_t heading_number = 0, picture_number = 0;
  for (const Block& block : blocks_) {
    const std::string id = "p" + std::to_string(++picture_number);
    if (const auto* heading = std::get_if<Heading>(&block))
      put(out, "<h2 id=\"h", std::to_string(++heading_number), "\">", escaped(heading->text),
          "</h2>\n");
    else if (const auto* paragraph = std::get_if<Paragraph>(&block))
      put(out, "<p>", escaped(paragraph->text), "</p>\n");
    else if (const auto* note = std::get_if<Note>(&block))
      out += html_of(*note);
    else if (const auto* key = std::get_if<KeyFigures>(&block))
      out += html_of(*key);
    else if (const auto* table = std::get_if<Table>(&block))
      out += html_of(*table);
    else if (const auto* chart = std::get_if<BarChart>(&block))
      out += html_of(*chart);
    else if (const auto* timeline = std::get_if<Timeline>(&block))
      out += html_of(*timeline);
    else if (const auto* plot = std::get_if<Plot>(&block))
      out += html_of(*plot, id, columns);
    else if (const auto* group = std::get_if<PlotGroup>(&block))
      out += html_of(*group, id, columns);
    else if (const auto* histogram = std::get_if<Histogram>(&block))
      out += html_of(*histogram, id);
    else if (const auto* map = std::get_if<HeatMap>(&block))
      out += html_of(*map, id, columns);
    else if (const auto* surface = std::get_if<Surface>(&block))
      out += html_of(*surface);
  }
  put(out,
      "</main>\n<footer>Point at a picture, or focus it and use the arrow keys, for values and a "
      "magnified view.</footer>\n<script>\n",
      kScript, "</script>\n</body>\n</html>\n");
  return out;
}

Expected<Done> Report::write(const std::string& path) const { return write_file(path, html()); }

}  // namespace servosense::report
