// A report: one HTML page with its pictures inside, for the browser, the printer and the archive.
//
// The page stands alone (no network, no library, no font), is complete without script, and carries
// no time stamp: the same blocks give the same bytes. With script, pointing at a picture opens a
// lens: 2 % of the axis either side of the cursor, magnified, with values.
//
// Long records are drawn as the smallest and largest value of each pixel column, in the order in
// which they occurred, so a spike of one sample out of millions is always seen. The lens reads a
// second envelope of up to 8192 columns, coarser when the page would otherwise pass about 2.5 MB.
//
// A number that cannot be drawn (NaN, Inf, beyond 1e290, not positive on a logarithmic axis) leaves
// a gap; all but NaN, which means "gap", are counted in a sentence below the picture.
// Text may be anything: it is escaped, and bytes that are not UTF-8 become U+FFFD.
//
// Bad at: closed curves (x not ascending) of more than some 20 000 distinguishable pixels, which
// are drawn on a coarser grid; heat maps above 240 x 120 cells, which show the value of largest
// magnitude of each group of cells.
#pragma once

#include <limits>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense::report {

enum class Level { none, info, warning, alarm };

/// Ends of an axis; NaN leaves that end to the data.
struct Range {
  double from = std::numeric_limits<double>::quiet_NaN();
  double to = std::numeric_limits<double>::quiet_NaN();
};

/// One curve. Unequal lengths of x and y are cut to the shorter and said so on the page.
struct Series {
  enum class Style { line, points, step };  ///< step: a value holds until the next one
  std::string name{};
  std::string unit{};  ///< of y; "N/m2" is shown as N/m², and N as kN or mN where that reads better
  std::vector<double> x{}, y{};  ///< NaN = gap
  Style style = Style::line;
  bool faint = false;   ///< drawn pale: an envelope behind a mean
  bool broad = false;   ///< drawn broad and pale: what others are laid over
  bool dashed = false;  ///< so that what lies below shows through
  int colour = -1;      ///< of the style sheet, 0..7; -1: by its place among the others
};

/// Vertical line at x. A label makes it a numbered flag, explained in a list below the picture.
struct Mark {
  double x = 0;
  std::string label{};
  Level level = Level::alarm;
};

/// Band of x, for example a phase of the cut or the time that an alarm lasted.
struct Span {
  double from = 0, to = 0;
  std::string label{};
  Level level = Level::warning;
};

/// Horizontal line, for example a threshold. It widens the y axis, unless that would flatten the
/// curves to less than a tenth of the height; then a sentence names it.
struct Limit {
  double y = 0;
  std::string label{};
  Level level = Level::alarm;
};

/// Time series, spectrum, stability lobes, coherence...
struct Plot {
  std::string title{};
  std::string caption{};
  std::string x_label{}, x_unit{};
  std::string y_label{};  ///< its unit is that of the series when they share one
  bool log_x = false, log_y = false;
  Range x_range{}, y_range{};
  std::vector<Series> series{};
  std::vector<Mark> marks{};
  std::vector<Span> spans{};
  std::vector<Limit> limits{};
  double height_px = 240;  ///< of the drawing area, 60..2000
};

/// Plots one above the other over a common x axis, with one cursor. The first plot names the axis.
struct PlotGroup {
  std::string title{};
  std::vector<Plot> plots{};
};

/// Counts per bin, from `values` or ready-made in `edges` and `counts`. Values are put in bins of
/// width 2 IQR n^(-1/3) (Freedman and Diaconis 1981), rounded to a 1-2-5 step, 200 bins at most.
struct Histogram {
  std::string title{};
  std::string caption{};
  std::string x_label{}, x_unit{};
  std::vector<double> values{};
  std::vector<double> edges{};   ///< ascending, one more than counts; used when values is empty
  std::vector<double> counts{};  ///< not negative
  std::vector<Mark> limits{};    ///< thresholds on x: lines, named in the legend
  bool normal_curve = false;     ///< with the mean and standard deviation of the values or bins
  bool log_count = false;        ///< shows the tails, where thresholds live
  double height_px = 240;
};

/// Coloured map of z over x and y: stability map, residual map, spectrogram.
struct HeatMap {
  std::string title{};
  std::string caption{};
  std::string x_label{}, x_unit{};
  std::string y_label{}, y_unit{};
  std::string z_label{}, z_unit{};
  std::vector<double> x_edges{}, y_edges{};  ///< ascending, one more than columns and rows
  std::vector<double> z{};         ///< row by row, first row at the smallest y; NaN = empty
  bool diverging = false;          ///< blue below zero, red above, symmetric about zero
  std::vector<Series> contours{};  ///< lines drawn over the map, in its x and y
  std::vector<Mark> marks{};
  double height_px = 300;
};

/// A part as one sees it: columns that stand on a floor, isometric, from the front left. x and y
/// have the unit of z. At most 90 cells on the longer side are drawn, each as its highest column.
struct Surface {
  std::string title{};
  std::string caption{};
  std::vector<double> x_edges{}, y_edges{};  ///< ascending, evenly spaced
  std::vector<double> z{};  ///< upper ends, row by row, first row at the smallest y; NaN = nothing
  double floor = 0;
};

/// A text or a number, which is right-aligned and printed with `significant` digits (1..17).
struct Cell {
  Cell(std::string words) : text(std::move(words)) {}  // NOLINT(google-explicit-constructor)
  Cell(const char* words) : text(words) {}             // NOLINT(google-explicit-constructor)
  Cell(double value, int significant = 4);             // NOLINT(google-explicit-constructor)
  std::string text;
  bool is_number = false;
};

struct Row {
  std::vector<Cell> cells{};
  Level level = Level::none;
};

/// Rows shorter than the header are filled with empty cells.
struct Table {
  std::string title{};
  std::string caption{};
  std::vector<std::string> header{};
  std::vector<Row> rows{};
  bool folded = false;  ///< its title alone, until somebody asks for the rest
};

struct Bar {
  std::string name{};
  double value = 0;
  Level level = Level::none;
};

/// Named values from top to bottom in the given order, for example a ranking.
struct BarChart {
  std::string title{};
  std::string caption{};
  std::string value_label{}, unit{};
  std::vector<Bar> bars{};
};

/// From when to when something was in a state: idle, learning, armed, warning, alarm or
/// signal-fault.
struct TimelineSpan {
  double from = 0, to = 0;
  std::string state{};
};

struct TimelineRow {
  std::string name{};
  std::vector<TimelineSpan> spans{};
  std::string remark{};
};

/// States over time, a row a thing.
struct Timeline {
  std::string title{};
  std::string caption{};
  std::string unit{};  ///< of from and to
  double from = 0, to = 0;
  std::vector<TimelineRow> rows{};
};

struct KeyFigure {
  std::string label{};
  Cell value{""};
  std::string unit{};
  Level level = Level::none;
};

/// The three to six numbers that a reader in a hurry wants.
struct KeyFigures {
  std::vector<KeyFigure> figures{};
};

struct Heading {
  std::string text{};
};

struct Paragraph {
  std::string text{};
};

/// Boxed sentence.
struct Note {
  std::string text{};
  Level level = Level::info;
};

using Block = std::variant<Heading, Paragraph, Note, KeyFigures, Table, BarChart, Timeline, Plot,
                           PlotGroup, Histogram, HeatMap, Surface>;

/// Collects blocks in reading order and writes the page.
class Report {
 public:
  explicit Report(std::string title, std::string subtitle = {})
      : title_(std::move(title)), subtitle_(std::move(subtitle)) {}

  Report& add(Block block) {
    blocks_.push_back(std::move(block));
    return *this;
  }

  /// The whole page. Deterministic.
  [[nodiscard]] std::string html() const;

  /// Writes html() to `path`, replacing what was there. Errors: ErrorKind::device.
  [[nodiscard]] Expected<Done> write(const std::string& path) const;

 private:
  std::string title_, subtitle_;
  std::vector<Block> blocks_;
};

}  // namespace servosense::report
