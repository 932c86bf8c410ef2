// The report page: well-formed, escaped, complete for any data, and true to the pixel.
#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/io/report.hpp"

namespace {

using namespace servosense::report;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

std::string page_of(Block block) { return Report("Test").add(std::move(block)).html(); }

bool has(const std::string& page, const std::string& words) {
  return page.find(words) != std::string::npos;
}

std::size_t count(const std::string& page, const std::string& words) {
  std::size_t n = 0;
  for (std::size_t at = 0; (at = page.find(words, at)) != std::string::npos; at += words.size())
    ++n;
  return n;
}

/// The page without style sheet, script and data blocks.
std::string markup_of(std::string page) {
  for (const std::string name : {"style", "script"})
    for (std::size_t at = 0; (at = page.find("<" + name, at)) != std::string::npos;) {
      const std::size_t open_end = page.find('>', at) + 1;
      page.erase(open_end, page.find("</" + name + ">", open_end) - open_end);
      at = open_end;
    }
  return page;
}

/// What keeps the page from being well-formed; "" when nothing does. Every element is closed, in
/// order; attributes are quoted and unique; `&` begins an entity.
std::string fault_of(const std::string& page) {
  const std::string text = markup_of(page);
  std::vector<std::string> open;
  std::size_t at = 0;
  if (text.rfind("<!DOCTYPE html>", 0) != 0) return "no doctype";
  at = text.find('>') + 1;
  for (; at < text.size(); ++at) {
    if (text[at] == '&') {
      const std::size_t end = text.find(';', at);
      const std::string name = end == std::string::npos ? "" : text.substr(at, end - at + 1);
      if (name != "&amp;" && name != "&lt;" && name != "&gt;" && name != "&quot;" &&
          name != "&#39;")
        return "bare & at " + text.substr(at, 20);
    }
    if (text[at] != '<') continue;
    std::size_t i = at + 1;
    const bool closes = text[i] == '/';
    if (closes) ++i;
    std::string name;
    while (i < text.size() && (std::isalnum(static_cast<unsigned char>(text[i])) != 0))
      name += text[i++];
    if (name.empty()) return "stray < at " + text.substr(at, 20);
    std::vector<std::string> names;
    bool empty_element = false;
    while (i < text.size() && text[i] != '>') {
      if (text[i] == '/') {
        empty_element = true;
        ++i;
      } else if (text[i] == ' ' || text[i] == '\n') {
        ++i;
      } else {
        std::string attribute;
        while (i < text.size() &&
               (std::isalnum(static_cast<unsigned char>(text[i])) || text[i] == '-'))
          attribute += text[i++];
        if (attribute.empty() || text.compare(i, 2, "=\"") != 0)
          return "bad attribute at " + text.substr(at, 60);
        i = text.find('"', i + 2);
        if (i == std::string::npos) return "open quote at " + text.substr(at, 60);
        ++i;
        for (const std::string& n : names)
          if (n == attribute) return "attribute twice at " + text.substr(at, 60);
        names.push_back(attribute);
      }
    }
    if (closes) {
      if (open.empty() || open.back() != name) return "</" + name + "> closes nothing";
      open.pop_back();
    } else if (!empty_element) {
      open.push_back(name);
    }
    at = i;
  }
  return open.empty() ? "" : "<" + open.back() + "> stays open";
}

/// What no page may hold, whatever the data.
void check_sound(const std::string& page, const std::string& name) {
  const std::string fault = fault_of(page);
  if (!fault.empty()) std::cout << name << ": " << fault << '\n';
  CHECK(fault.empty());
  const std::string markup = markup_of(page);
  for (const char* bad :
       {"nan", "NaN%", "inf%", "\"inf\"", "\"inf%", "-inf", "null", "2147483648"}) {
    if (has(markup, bad)) std::cout << name << ": holds " << bad << '\n';
    CHECK(!has(markup, bad));
  }
  CHECK(!has(page, "http:") && !has(page, "https:") && !has(page, "url("));
}

struct Point {
  double x, y;
};

/// Vertices of the path data of the first element of this class, in drawing units.
std::vector<Point> path_of(const std::string& page, const std::string& path_class) {
  std::vector<Point> points;
  const std::size_t at =
      page.find("<path class=\"" + path_class + "\" d=\"M", page.find("class=\"data\""));
  if (at == std::string::npos) return points;
  const std::size_t begin = page.find(" d=\"", at) + 4;
  const std::string d = page.substr(begin, page.find('"', begin) - begin);
  double x = 0, y = 0;
  const char* p = d.c_str();
  const auto next = [&p] {
    char* end = nullptr;
    const double value = std::strtod(p, &end);
    p = end;
    return value;
  };
  while (*p != '\0') {
    const char command = *p++;
    switch (command) {
      case 'M':
        x = next(), y = next();
        break;
      case 'm':
      case 'l':
        x += next(), y += next();
        break;
      case 'h':
        x += next();
        break;
      case 'v':
        y += next();
        break;
      default:
        CHECK(command == '?');
        return points;
    }
    points.push_back({x, y});
  }
  return points;
}

Series ramp(std::size_t n) {
  Series s{"signal", "N", {}, {}};
  for (std::size_t i = 0; i < n; ++i) {
    s.x.push_back(static_cast<double>(i) / 1000);
    s.y.push_back(static_cast<double>(i % 7));
  }
  return s;
}

Plot plot_of(Series s) {
  Plot p;
  p.title = "Plot";
  p.x_label = "Time";
  p.x_unit = "s";
  p.series = {std::move(s)};
  return p;
}

void every_block_is_well_formed_and_escaped() {
  const std::string bad = "<script>alert(1)</script>\"'& \xFF\xC0\x80\xED\xA0\x80\x01 caf\xC3\xA9";
  Plot plot = plot_of(ramp(50));
  plot.title = plot.caption = plot.x_label = plot.x_unit = plot.y_label = bad;
  plot.series[0].name = plot.series[0].unit = bad;
  plot.series.push_back(plot.series[0]);
  plot.series[1].unit = bad + "2";
  plot.series[1].x.pop_back();
  plot.marks = {{0.01, bad, Level::alarm}, {9, bad, Level::info}, {kNan, bad, Level::none}};
  plot.spans = {{0.01, 0.02, bad, Level::warning}, {kNan, kInf, bad, Level::info}};
  plot.limits = {{3, bad, Level::alarm}, {1e9, bad, Level::warning}, {kNan, bad, Level::none}};
  HeatMap map{bad, bad,       bad,    bad,       bad,  bad,       bad,
              bad, {0, 1, 3}, {0, 1}, {1, kNan}, true, {ramp(5)}, {{1, bad, Level::info}}};
  Histogram histogram{bad,  bad, bad, bad, {1, 2, 3, 4}, {}, {}, {{2, bad, Level::alarm}},
                      true, true};
  Report report(bad, bad);
  for (int i = 0; i < 4; ++i) report.add(Heading{bad});
  report.add(Paragraph{bad}).add(Note{bad, Level::alarm});
  report.add(KeyFigures{{{bad, Cell(bad), bad, Level::warning}}});
  report.add(Table{bad, bad, {bad, bad}, {{{bad, 1.5}, Level::alarm}, {{bad}, Level::none}}});
  report.add(
      BarChart{bad, bad, bad, bad, {{bad, 1, Level::none}, {bad, -2, Level::alarm}, {bad, kNan}}});
  report.add(plot)
      .add(PlotGroup{bad, {plot, plot}})
      .add(histogram)
      .add(map)
      .add(Timeline{bad, bad, bad, 0, 1, {{bad, {{0, 1, "armed"}}, bad}}});
  const std::string page = report.html();
  check_sound(page, "every block");
  const std::string markup = markup_of(page);
  CHECK(!has(markup, "<script>alert"));
  CHECK(!has(markup, "alert(1)<"));
  CHECK(count(page, "</script>") == count(page, "<script"));
  // Unicode 15, section 3.9: each byte that cannot be part of a sequence is replaced.
  CHECK(has(markup,
            "&lt;script&gt;alert(1)&lt;/script&gt;&quot;&#39;&amp; "
            "\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD"
            "\xEF\xBF\xBD caf\xC3\xA9"));
  for (const char* raw : {"\xFF", "\xC0", "\xED\xA0", "\x01"}) CHECK(!has(page, raw));
  CHECK(has(page, "<html lang=\"en\">") && has(page, "name=\"viewport\""));
  CHECK(has(page, "<title id=\"p10-t\">") && has(page, "<desc id=\"p10-d\">"));
  CHECK(report.html() == page);
}

void a_spike_of_one_sample_survives() {
  // Square noise of +-1 and one sample of 50 at a fixed place: the y axis is fixed, so the height
  // of the spike follows by hand: (1 - (50 + 10) / 70) * 10 * 240 = 342.86 drawing units.
  for (const std::size_t n : {std::size_t{3000}, std::size_t{1000000}}) {
    for (const auto style : {Series::Style::line, Series::Style::step, Series::Style::points}) {
      Series s{"force", "N", {}, {}, style};
      for (std::size_t i = 0; i < n; ++i) {
        s.x.push_back(static_cast<double>(i) / static_cast<double>(n - 1));
        s.y.push_back(i % 2 == 0 ? 1 : -1);
      }
      s.y[n * 7 / 10] = 50;
      Plot p = plot_of(s);
      p.y_range = {-10, 60};
      const std::string page = page_of(p);
      double top = 1e9, at = 0;
      for (const Point& v :
           path_of(page, style == Series::Style::points ? "curve s0 points" : "curve s0"))
        if (v.y < top) top = v.y, at = v.x;
      // Half a unit of rounding; a scatter may move by its cell, three pixels at the very most.
      CHECK_NEAR(top, (1 - 60.0 / 70.0) * 2400, style == Series::Style::points ? 30 : 0.5);
      CHECK_NEAR(at, 7000, style == Series::Style::points ? 30 : 10);
      CHECK(path_of(page, "no such curve").empty());
    }
  }
  // A lone sample between gaps is a dot, not an empty path.
  Series lone{"lone", "", {0, 1, 2}, {kNan, 5, kNan}};
  CHECK(has(page_of(plot_of(lone)), "h0\"/>"));
}

void decimation_keeps_the_envelope() {
  const unsigned seed = 20240607;
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  const std::size_t n = 200000;
  Series s{"noise", "N", {}, {}};
  std::vector<double> low(1000, kInf), high(1000, -kInf);
  for (std::size_t i = 0; i < n; ++i) {
    const double value = normal(generator);
    s.x.push_back(static_cast<double>(i));
    s.y.push_back(value);
    const std::size_t column = std::min<std::size_t>(
        static_cast<std::size_t>(1000.0 * static_cast<double>(i) / static_cast<double>(n - 1)),
        999);
    low[column] = std::min(low[column], value);
    high[column] = std::max(high[column], value);
  }
  Plot p = plot_of(s);
  p.y_range = {-8, 8};
  std::vector<double> drawn_low(1000, kInf), drawn_high(1000, -kInf);
  for (const Point& v : path_of(page_of(p), "curve s0")) {
    const auto column = static_cast<std::size_t>(v.x / 10);
    const double value = 8 - 16 * v.y / 2400;
    drawn_low[column] = std::min(drawn_low[column], value);
    drawn_high[column] = std::max(drawn_high[column], value);
  }
  double worst = 0;
  for (std::size_t c = 0; c < 1000; ++c)
    worst = std::max({worst, std::abs(drawn_low[c] - low[c]), std::abs(drawn_high[c] - high[c])});
  std::cout << "  seed " << seed << '\n';
  CHECK_NEAR(worst, 0, 0.5 * 16 / 2400 + 1e-9);  // rounding to a tenth of a pixel
}

void marks_and_limits_stand_where_they_should() {
  Plot p = plot_of({"force", "N", {0, 10}, {-1, 1}});
  p.height_px = 200;
  p.x_range = {0, 10};
  p.y_range = {-50, 50};
  p.marks = {{2.5, "a", Level::alarm}, {11, "late", Level::info}};
  p.spans = {{4, 6, "b", Level::warning}};
  p.limits = {{25, "threshold", Level::alarm}, {80, "far", Level::warning}};
  const std::string page = page_of(p);
  CHECK(has(page, "<line class=\"mark alarm\" x1=\"25%\" x2=\"25%\" y2=\"200\"/>"));
  CHECK(has(page, "<rect class=\"span warning\" x=\"40%\" width=\"20%\" height=\"200\"/>"));
  CHECK(has(page, "<line class=\"limit alarm\" x2=\"100%\" y1=\"50\" y2=\"50\"/>"));
  CHECK(!has(page, "class=\"mark info\"") && has(page, "late (outside the picture)"));
  CHECK(has(page, "“far” (80.0\xC2\xA0N) lies outside the picture."));
  const std::vector<Point> line = path_of(page, "curve s0");
  CHECK(line.size() == 3);  // start, its dot, end
  CHECK_NEAR(line.front().y, 2000 * 0.51, 0.5);
  CHECK_NEAR(line.back().y, 2000 * 0.49, 0.5);
  CHECK_NEAR(line.back().x, 10000, 0);

  // Logarithmic: 100 is half way from 1 to 10^4.
  Plot l = plot_of({"gain", "", {1, 100, 10000}, {1, 10, 100}});
  l.log_x = l.log_y = true;
  l.height_px = 100;
  l.y_range = {1, 100};
  l.marks = {{100, "", Level::warning}};
  const std::string log_page = page_of(l);
  CHECK(has(log_page, "<line class=\"mark warning\" x1=\"50%\""));
  CHECK_NEAR(path_of(log_page, "curve s0")[2].x, 5000, 0.5);
  CHECK_NEAR(path_of(log_page, "curve s0")[2].y, 500, 0.5);
}

void any_data_gives_a_readable_picture() {
  struct Case {
    const char* name;
    std::vector<double> x, y;
    const char* sentence;
  };
  const std::vector<Case> cases = {
      {"empty", {}, {}, "has no value to draw."},
      {"one point", {3}, {4}, "is a single value: "},
      {"constant", {0, 1, 2}, {5, 5, 5}, "is constant: "},
      {"constant zero", {0, 1, 2}, {0, 0, 0}, "is constant: 0"},
      {"all gaps", {0, 1}, {kNan, kNan}, "has no value to draw."},
      {"infinite", {0, 1, 2}, {1, kInf, -kInf}, "2 values of “data” are infinite and left out."},
      {"infinite x", {0, -kInf, 2}, {1, 2, 3}, "1 value of “data” is infinite and left out."},
      {"huge", {0, 1, 2}, {1e308, -1e308, 1}, "2 values of “data” are infinite and left out."},
      {"tiny", {0, 1}, {5e-324, 1e-310}, "class=\"tick y\""},
      {"same x", {7, 7, 7}, {1, 2, 3}, "class=\"tick x\""},
      {"far offset",
       {1.7e9, 1.7e9 + 1},
       {1, 2},
       "counted from 1\xE2\x80\xAF"
       "700\xE2\x80\xAF"
       "000\xE2\x80\xAF"
       "000"},
      {"unequal", {0, 1, 2}, {1, 2}, "has 3 x and 2 y values; the surplus is left out."},
      {"not positive", {1, 2, 3}, {-1, 0, 1}, "class=\"curve s0\""}};
  for (const Case& c : cases)
    for (const bool log : {false, true}) {
      Plot p = plot_of({"data", "N", c.x, c.y});
      p.log_y = log;
      const std::string page = page_of(p);
      check_sound(page, c.name);
      if (!log && !has(page, c.sentence)) std::cout << c.name << ": lacks " << c.sentence << '\n';
      if (!log) CHECK(has(page, c.sentence));
      p.log_x = true;
      check_sound(page_of(p), c.name);
      check_sound(page_of(PlotGroup{"", {p, p}}), c.name);
      check_sound(page_of(Histogram{"h", "", "x", "N", c.y, {}, {}, {{kInf, "limit"}}, true, log}),
                  c.name);
    }
  Plot p = plot_of({"data", "N", {1, 2, 3}, {-1, 0, 1}});
  p.log_y = true;
  CHECK(has(page_of(p), "2 values of “data” cannot stand on a logarithmic axis"));
  check_sound(page_of(Plot{}), "no series");
  check_sound(page_of(PlotGroup{}), "no plots");
  check_sound(page_of(HeatMap{}), "no map");
  CHECK(has(page_of(HeatMap{}), "The map has no cell."));
  check_sound(page_of(Table{}), "no table");
  check_sound(page_of(BarChart{}), "no bars");
  check_sound(page_of(Surface{}), "no surface");
  CHECK(has(page_of(Surface{}), "There is no surface to draw."));
  HeatMap map;
  map.x_edges = {0, 1, 2};
  map.y_edges = {0, 1};
  map.z = {1};
  CHECK(has(page_of(map), "The map has 1 values for 2 columns and 1 rows."));
  map.z = {kNan, kInf};
  check_sound(page_of(map), "empty map");
  CHECK(has(page_of(map), "No cell of the map has a value."));
}

/// What stands behind is drawn first; columns that are alike are one face.
void surface_is_drawn_from_the_back() {
  const auto faces = [](const Surface& s) {
    const std::string page = page_of(s);
    check_sound(page, "surface");
    std::size_t count = 0;
    for (std::size_t at = page.find("<path d="); at != std::string::npos;
         at = page.find("<path d=", at + 1))
      ++count;
    return count;
  };
  // Wider than deep by 4: cells stay apart.
  Surface s{"part", "", {0, 1, 2, 3, 4}, {0, 1}, {2, 2, 2, 2}, 0};
  CHECK(faces(s) == 3);  // top, front, left
  s.z = {2, 2, 1, 1};
  // The lower step on the right has a top and a front; its left side is hidden.
  CHECK(faces(s) == 5);
  s.z = {1, 1, 2, 2};
  CHECK(faces(s) == 6);
  s.z = {1, 1, kNan, 1};
  CHECK(faces(s) == 6);
  s.z = {kNan, kNan, kInf, kNan};
  CHECK(faces(s) == 0);
}

void histogram_counts_what_it_was_given() {
  Histogram h;
  h.edges = {0, 1, 2, 4};
  h.counts = {1, 4, 2};
  h.height_px = 100;
  h.limits = {{1, "threshold", Level::alarm}};
  const std::string page = page_of(h);
  // Heights by hand: the axis ends 4 % above the tallest bar, so 4 stands at 1 - 4 / 4.16.
  CHECK(has(page, "M0 1000V760H2500V1000z"));      // 1 / 4.16 = 0.2404
  CHECK(has(page, "M2500 1000V38H5000V1000z"));    // 4 / 4.16 = 0.9615
  CHECK(has(page, "M5000 1000V519H10000V1000z"));  // 2 / 4.16 = 0.4808
  // A threshold is a line with a name, and no alarm.
  CHECK(has(page, "<path class=\"vertical\" d=\"M2500 0V1000\"/>"));
  CHECK(has(page, "threshold 1"));
  CHECK(!has(page, "Alarm at"));
  // Mean (0.5 + 4 * 1.5 + 2 * 3) / 7 = 1.786.
  CHECK(has(page, "Histogram of 7 values in 3 bins, mean 1.786"));
}

void timeline_keeps_what_is_grave() {
  Timeline t;
  t.unit = "s";
  t.from = 10;
  t.to = 110;
  t.rows = {
      {"chatter <1>",
       {{10, 35, "learning"}, {35, 85, "armed"}, {85, 85.001, "alarm"}, {85.001, 110, "armed"}},
       "75 %"}};
  const std::string page = page_of(t);
  CHECK(has(page, "<rect class=\"learning\" x=\"0%\" width=\"25%\""));
  CHECK(has(page, "<rect class=\"armed\" x=\"25%\" width=\"50%\""));
  // A millisecond of alarm is drawn, and above the rest.
  CHECK(has(page, "<rect class=\"alarm\" x=\"75%\" width=\"0.15%\""));
  CHECK(page.find("class=\"alarm\" x=") > page.find("class=\"armed\" x=\"75"));
  CHECK(has(page, "chatter &lt;1&gt;") && has(page, "75 %"));
  CHECK(has(page, ">10 s<") && has(page, ">110 s<"));
  CHECK(!has(page, "signals not to be trusted"));  // the legend has what occurs
}

void map_cells_fill_the_area() {
  HeatMap map;
  map.x_edges = {0, 1, 4};
  map.y_edges = {0, 1, 2};
  map.z = {0, 1, kNan, 0};
  map.height_px = 100;
  const std::string page = page_of(map);
  // First row at the bottom; uneven columns; the darkest and the lightest shade of the table.
  CHECK(has(page, "<path fill=\"#440154\" d=\"M0 500h2500v500H0zM2500 0h7500v500H2500z\"/>"));
  CHECK(has(page, "<path fill=\"#fde725\" d=\"M2500 500h7500v500H2500z\"/>"));
}

void numbers_read_well() {
  CHECK_TEXT(Cell(-1234.5).text, "−1234");  // half to even, as the standard library rounds
  CHECK_TEXT(Cell(12345.0, 5).text,
             "12\xE2\x80\xAF"
             "345");
  CHECK_TEXT(Cell(0.00002).text, "2×10⁻⁵");
  CHECK_TEXT(Cell(1e9).text, "10⁹");
  CHECK_TEXT(Cell(0.5).text, "0.5");
  CHECK_TEXT(Cell(-0.0).text, "0");
  CHECK_TEXT(Cell(kNan).text, "—");
  CHECK_TEXT(Cell(-kInf).text, "−∞");
  Plot p = plot_of({"error", "m", {0, 1}, {0, 4e-5}});
  CHECK(has(page_of(p), "error [µm]"));
  p.series[0].unit = "N/m2";
  p.series[0].y = {0, 6e8};
  CHECK(has(page_of(p), "error [MN/m²]"));
  p.series[0].unit = "rpm";
  p.series[0].y = {0, 12000};
  CHECK(has(page_of(p), "error [rpm]") && has(page_of(p),
                                              ">10\xE2\x80\xAF"
                                              "000</text>"));
}

void labels_never_overlap_on_a_narrow_page() {
  // The narrow layout promises 280 px of drawing area; 12 px digits are below 7.2 px wide.
  for (const double offset : {0.0, 1e3, 123456.0, 1.7e9})
    for (const double span : {1e-6, 0.0314, 12.5, 997.0, 3.6e5}) {
      const Plot p = plot_of({"s", "", {offset, offset + span}, {0, 1}});
      const std::string page = page_of(p);
      std::size_t at = page.find("<g class=\"narrow\">");
      const std::size_t end = page.find("</g>", at);
      double right = -1e9;
      int labels = 0;
      while ((at = page.find("class=\"tick x\" x=\"", at)) < end) {
        at += 18;
        const double middle = std::strtod(page.c_str() + at, nullptr) / 100 * 280;
        const std::size_t from = page.find('>', at) + 1;
        const std::string label = page.substr(from, page.find('<', from) - from);
        double letters = 0;
        for (const char c : label) letters += (static_cast<unsigned char>(c) & 0xC0U) != 0x80U;
        if (middle - 3.6 * letters < right)
          std::cout << offset << " + " << span << ": " << label << '\n';
        CHECK(middle - 3.6 * letters >= right);
        right = middle + 3.6 * letters;
        ++labels;
      }
      CHECK_BETWEEN(labels, 2, 8);
    }
}

void a_page_of_long_records_stays_light() {
  Series s{"force", "N", {}, {}};
  std::mt19937 generator(7);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 1000000; ++i) {
    s.x.push_back(i / 8000.0);
    s.y.push_back(normal(generator));
  }
  Report report("Ten plots");
  for (int i = 0; i < 10; ++i) report.add(plot_of(s));
  const std::size_t ten = report.html().size();
  check::figure("page weight, 10 plots of 1e6 samples", static_cast<double>(ten) / 1e6, "MB");
  CHECK_BETWEEN(static_cast<double>(ten), 0.5e6, 3e6);
  // A scatter and a closed curve of the same length are bounded as well.
  s.style = Series::Style::points;
  const std::size_t scatter = page_of(plot_of(s)).size();
  for (std::size_t i = 0; i < s.x.size(); ++i) s.x[i] = std::sin(static_cast<double>(i) * 0.001);
  s.style = Series::Style::line;
  const std::size_t loop = page_of(plot_of(s)).size();
  check::figure("page weight, scatter of 1e6 samples", static_cast<double>(scatter) / 1e6, "MB");
  check::figure("page weight, closed curve of 1e6 samples", static_cast<double>(loop) / 1e6, "MB");
  CHECK_BETWEEN(static_cast<double>(scatter), 0.03e6, 0.7e6);
  CHECK_BETWEEN(static_cast<double>(loop), 0.03e6, 0.7e6);
}

void many_marks_are_drawn_once_and_listed_gravest_first() {
  Plot p = plot_of(ramp(1000));
  for (int i = 0; i < 20000; ++i)
    p.marks.push_back({i * 5e-5, "m", i == 777 ? Level::alarm : Level::info});
  const std::string page = page_of(p);
  CHECK(has(page,
            "19\xE2\x80\xAF"
            "940 further marks"));
  CHECK(count(page, "<li class=\"alarm\">") == 1);
  CHECK(count(page, "<line class=\"mark") <= 2002);  // every half pixel, and the alarm
  check_sound(page, "many marks");
}

void the_file_holds_the_page() {
  Report report("File");
  report.add(Paragraph{"text"});
  const auto folder = report.write("no/such/folder/report.html");
  CHECK(!folder && folder.error().kind == servosense::ErrorKind::device);
  if (!folder) CHECK(has(folder.error().sentence, "no/such/folder/report.html: "));
  const auto full = report.write("/dev/full");
  CHECK(!full);
  const std::string path = std::string(std::getenv("TMPDIR") ? std::getenv("TMPDIR") : "/tmp") +
                           "/servosense_test_report.html";
  CHECK(report.write(path).has_value());
  std::ifstream file(path, std::ios::binary);
  std::ostringstream content;
  content << file.rdbuf();
  CHECK(content.str() == report.html());
  std::remove(path.c_str());
}

}  // namespace

int main() {
  every_block_is_well_formed_and_escaped();
  a_spike_of_one_sample_survives();
  decimation_keeps_the_envelope();
  marks_and_limits_stand_where_they_should();
  any_data_gives_a_readable_picture();
  surface_is_drawn_from_the_back();
  histogram_counts_what_it_was_given();
  timeline_keeps_what_is_grave();
  map_cells_fill_the_area();
  numbers_read_well();
  labels_never_overlap_on_a_narrow_page();
  a_page_of_long_records_stays_light();
  many_marks_are_drawn_once_and_listed_gravest_first();
  the_file_holds_the_page();
  return check::done();
}
