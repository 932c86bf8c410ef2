// What the parts of the report writer share: text, axes, decimation, pictures.
#pragma once

#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/io/report.hpp"

namespace servosense::report::detail {

// ---- text (report_text.cpp) ----------------------------------------------------------------

template <typename... Parts>
void put(std::string& out, const Parts&... parts) {
  ((out += parts), ...);
}

/// Text fit for HTML content and quoted attributes; invalid UTF-8 and control characters become
/// U+FFFD.
std::string escaped(std::string_view text);
/// As a reader expects it: 4 significant digits, true minus sign, grouped thousands, 1.5×10⁻⁷.
std::string number(double value, int significant = 4);
/// The same with a fixed number of decimals.
std::string fixed(double value, int decimals);
/// For attributes: '-' and '.', no trailing zeros.
std::string plain(double value, int decimals = 3);
/// Shortest text that reads back as the same double; "null" when not finite.
std::string exact(double value);
/// 10 with the exponent as superscript.
std::string power_of_ten(int exponent);
/// "m/s2" as m/s². Not escaped.
std::string pretty_unit(std::string_view unit);
/// " unit" or "", escaped, with a space that does not break.
std::string unit_after(std::string_view unit);
std::string count_text(std::size_t count);
/// Estimated width of 12 px text.
double text_width_px(std::string_view text);
/// At most `most` characters, the last an ellipsis when something was cut.
std::string shortened(std::string_view text, std::size_t most);
std::string base64(const std::vector<float>& values);  // little endian
const char* level_class(Level level);
const char* level_word(Level level);

// ---- axes (report_axis.cpp) ----------------------------------------------------------------

/// Beyond this, differences of axis ends overflow.
inline constexpr double kLargest = 1e290;

inline bool drawable(double value, bool log) {
  return std::abs(value) <= kLargest && (!log || value > 1 / kLargest);
}

/// Interval that grows over the values shown to it.
struct Extent {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();
  [[nodiscard]] bool any() const { return low <= high; }
  [[nodiscard]] double span() const { return any() ? high - low : 0; }
  void include(double value) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
};

struct Axis {
  double from = 0, to = 1;
  bool log = false;
  double scale = 1;   ///< shown = (value - origin) * scale
  double origin = 0;  ///< subtracted from the labels when the span is tiny beside the values
  std::string unit;   ///< as shown, after scale

  /// 0 at `from`, 1 at `to`.
  [[nodiscard]] double at(double value) const;
  /// "Force [kN]", not escaped.
  [[nodiscard]] std::string title(std::string_view label) const;
  /// "12.35 kN" to a thousandth of the axis, not escaped.
  [[nodiscard]] std::string value(double raw) const;
};

/// Axis over the data, padded by this fraction of the span where `wanted` leaves the end open.
Axis make_axis(Extent data, const Range& wanted, bool log, std::string_view unit, double padding);

struct Tick {
  double at = 0;      ///< fraction of the axis
  std::string label;  ///< empty for a minor grid line
};

/// 1-2-5 steps (decades on a logarithmic axis), at most `most` labels.
std::vector<Tick> ticks(const Axis& axis, std::size_t most);
/// As many as fit side by side into this width.
std::vector<Tick> ticks_across(const Axis& axis, double width_px);
/// Largest of 1, 2, 5 times a power of ten that is not below `step`.
double nice_step(double step);

// ---- curves (report_curve.cpp) -------------------------------------------------------------

/// The drawing area spans kUnits across and 10 units per pixel down; it is stretched to the page.
inline constexpr double kUnits = 10000;

int x_unit(const Axis& axis, double value);
int y_unit(const Axis& axis, double value, double height_px);

/// What had to be left out of a curve.
struct Omitted {
  std::size_t infinite = 0;
  std::size_t not_positive = 0;
};

struct Facts {
  Omitted omitted;
  std::size_t length = 0;
  std::size_t drawn = 0;
  Extent x, y;
  bool ascending = true;  ///< x never decreases, gaps aside
};
Facts facts_of(const Series& series, bool log_x, bool log_y);

/// Path data of the curve for the drawing area.
std::string path_of(const Series& series, const Facts& facts, const Axis& x, const Axis& y,
                    double height_px);

/// JSON object that the lens reads, with at most `columns` columns or points; "null" for none.
std::string lens_json(const Series& series, const Facts& facts, const Axis& x, const Axis& y,
                      std::size_t columns);

// ---- pictures (report_picture.cpp) ---------------------------------------------------------

struct LegendEntry {
  std::string name;    ///< not escaped
  std::string swatch;  ///< class of the curve, "" for a plain note
};

/// Everything between the data and the page, for whatever has two axes.
struct Picture {
  std::string id;
  std::string title, caption, description;
  Axis x, y;
  std::string x_label, y_label;
  std::string z_unit;  ///< of a map, as shown
  bool x_tick_labels = true;
  double height_px = 240;
  std::string under;  ///< SVG below the curves: bands, bars, cells; in drawing units
  std::string over;   ///< SVG of the curves, in drawing units
  std::vector<LegendEntry> legend;
  std::vector<Mark> marks;
  std::vector<Span> spans;
  std::vector<Limit> limits;
  std::vector<std::string> remarks;
  std::string empty_words;  ///< written across the area when there is nothing to draw
  std::string lens;         ///< members of the lens JSON object beyond the axes, with leading comma
  std::string below;        ///< HTML below the area: a colour bar
};
std::string html_of(const Picture& picture);

inline constexpr double kPadding = 0.04;  ///< of the y span, above and below the curves
inline constexpr double kFlattest = 0.1;  ///< limits may squeeze the curves to this part

/// Height that was asked for, within reason; 240 for one that is no number.
double height_of(double wanted_px);
const char* values_word(std::size_t count);
/// Says what of the curve `name` could not be drawn.
void remark_omitted(std::vector<std::string>& remarks, const std::string& name, const Omitted& o);
std::string numbers_json(const std::vector<double>& values);

// ---- what a picture shows (report_plots, report_histogram, report_heat_map, report_timeline) ----

std::string html_of(const Plot& plot, const std::string& id, std::size_t lens_columns);
std::string html_of(const PlotGroup& group, const std::string& id, std::size_t lens_columns);
std::string html_of(const Histogram& histogram, const std::string& id);
std::string html_of(const Timeline& timeline);
void put_caption(std::string& out, const std::string& title, const std::string& caption);
std::string html_of(const Surface& surface);
/// Of a map, the most that are drawn.
inline constexpr std::size_t kMapColumns = 240, kMapRows = 240;
std::string html_of(const HeatMap& map, const std::string& id, std::size_t lens_columns);

// ---- the page (report_page.cpp, report_assets.cpp) -----------------------------------------

extern const std::string_view kStyle;
extern const std::string_view kScript;

}  // namespace servosense::report::detail
