// Curves of the report: from samples to path data, and to the finer envelope behind the lens.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <unordered_set>

#include "report_internal.hpp"

namespace servosense::report::detail {

namespace {

constexpr std::size_t kColumns = 1000;  // pixel columns of the widest page
constexpr std::size_t kMostSegments = 20000;

/// Smallest and largest value of the samples that fall into one column.
struct Column {
  double low = 0, high = 0, last = 0;
  bool any = false;
  bool low_first = true;   ///< the smallest occurred before the largest
  bool after_gap = false;  ///< a gap lies between this column and the one before
};

/// Visits every sample that can be drawn: visit(i, x, y, after_gap).
template <typename Visit>
void for_each_drawable(const Series& series, const Facts& facts, bool log_x, bool log_y,
                       Visit visit) {
  bool after_gap = true;
  for (std::size_t i = 0; i < facts.length; ++i) {
    if (!drawable(series.x[i], log_x) || !drawable(series.y[i], log_y)) {
      after_gap = true;
      continue;
    }
    visit(series.x[i], series.y[i], after_gap);
    after_gap = false;
  }
}

std::vector<Column> envelope(const Series& series, const Facts& facts, const Axis& x, const Axis& y,
                             std::size_t count) {
  std::vector<Column> columns(count);
  const double n = static_cast<double>(count);
  bool gap = true;
  for_each_drawable(series, facts, x.log, y.log, [&](double at, double value, bool after_gap) {
    gap = gap || after_gap;
    const double fraction = x.at(at);
    if (fraction < 0 || fraction > 1) return;
    Column& c = columns[std::min(static_cast<std::size_t>(fraction * n), count - 1)];
    if (!c.any) {
      c = {value, value, value, true, true, gap};
    } else if (value < c.low) {
      c.low = value;
      c.low_first = false;
    } else if (value > c.high) {
      c.high = value;
      c.low_first = true;
    }
    c.last = value;
    gap = false;
  });
  return columns;
}

/// Path data with relative whole-number moves, the shortest form.
class PathWriter {
 public:
  void move(int x, int y) {
    if (started_)
      put(out_, "m", std::to_string(x - x_), y < y_ ? "" : " ", std::to_string(y - y_));
    else
      put(out_, "M", std::to_string(x), " ", std::to_string(y));
    started_ = true;
    go(x, y);
    out_ += "h0";  // a point without neighbours shows as a dot
  }
  void line(int x, int y) {
    if (x == x_ && y == y_) return;
    if (x == x_)
      put(out_, "v", std::to_string(y - y_));
    else if (y == y_)
      put(out_, "h", std::to_string(x - x_));
    else
      put(out_, "l", std::to_string(x - x_), y < y_ ? "" : " ", std::to_string(y - y_));
    go(x, y);
  }
  [[nodiscard]] std::string take() { return std::move(out_); }

 private:
  void go(int x, int y) {
    x_ = x;
    y_ = y;
  }
  std::string out_;
  int x_ = 0, y_ = 0;
  bool started_ = false;
};

std::string decimated_path(const Series& series, const Facts& facts, const Axis& x, const Axis& y,
                           double height_px) {
  PathWriter path;
  const std::vector<Column> columns = envelope(series, facts, x, y, kColumns);
  const int width = static_cast<int>(kUnits) / static_cast<int>(kColumns);
  int before = 0;  // a step holds this height up to the next column
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const Column& c = columns[i];
    if (!c.any) continue;
    const int at = static_cast<int>(i) * width + width / 2;
    const int low = y_unit(y, c.low, height_px), high = y_unit(y, c.high, height_px);
    const int first = c.low_first ? low : high, second = c.low_first ? high : low;
    const bool step = series.style == Series::Style::step;
    if (c.after_gap) {
      path.move(at, first);
    } else {
      if (step) path.line(at, before);
      path.line(at, first);
    }
    path.line(at, second);
    if (step) path.line(at, before = y_unit(y, c.last, height_px));
  }
  return path.take();
}

/// Every point, for a curve short enough.
std::string full_path(const Series& series, const Facts& facts, const Axis& x, const Axis& y,
                      double height_px) {
  PathWriter path;
  int before = 0;
  for_each_drawable(series, facts, x.log, y.log, [&](double at, double value, bool after_gap) {
    const int px = x_unit(x, at), py = y_unit(y, value, height_px);
    if (after_gap || series.style == Series::Style::points) {
      path.move(px, py);
    } else {
      if (series.style == Series::Style::step) path.line(px, before);
      path.line(px, py);
    }
    before = py;
  });
  return path.take();
}

/// A curve that turns back in x: each pair of neighbouring cells is drawn once, on the finest grid
/// that keeps the path short.
std::string cell_path(const Series& series, const Facts& facts, const Axis& x, const Axis& y,
                      double height_px) {
  for (int cell = 10;; cell *= 2) {
    PathWriter path;
    std::unordered_set<std::uint64_t> seen;
    std::uint64_t here = 0;
    bool pen_here = false;
    // x_unit and y_unit stay within +-100 000, so an index takes 15 bits.
    const auto index = [cell](int unit) { return (unit + 100000) / cell; };
    const auto middle = [cell](int i) { return i * cell + cell / 2 - 100000; };
    int last_x = 0, last_y = 0;
    for_each_drawable(series, facts, x.log, y.log, [&](double at, double value, bool after_gap) {
      if (seen.size() > kMostSegments) return;
      const int ix = index(x_unit(x, at)), iy = index(y_unit(y, value, height_px));
      const int px = middle(ix), py = middle(iy);
      const auto there = static_cast<std::uint64_t>(ix) << 15U | static_cast<std::uint64_t>(iy);
      if (after_gap || series.style == Series::Style::points) {
        if (seen.insert(there << 32U | there).second) path.move(px, py);
        pen_here = true;
      } else if (there != here) {
        const bool fresh = seen.insert(here << 32U | there).second;
        if (fresh && !pen_here) path.move(last_x, last_y);
        if (fresh) path.line(px, py);
        pen_here = fresh;
      }
      here = there;
      last_x = px;
      last_y = py;
    });
    if (seen.size() <= kMostSegments || cell >= 640) return path.take();
  }
}

}  // namespace

int x_unit(const Axis& axis, double value) {
  return static_cast<int>(std::lround(std::clamp(axis.at(value), -4.0, 5.0) * kUnits));
}

int y_unit(const Axis& axis, double value, double height_px) {
  return static_cast<int>(std::lround(std::clamp(1 - axis.at(value), -4.0, 5.0) * 10 * height_px));
}

Facts facts_of(const Series& series, bool log_x, bool log_y) {
  Facts facts;
  facts.length = std::min(series.x.size(), series.y.size());
  double before = -std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < facts.length; ++i) {
    const double x = series.x[i], y = series.y[i];
    if (std::isnan(x) || std::isnan(y)) continue;
    if (!drawable(x, false) || !drawable(y, false)) {
      ++facts.omitted.infinite;
    } else if (!drawable(x, log_x) || !drawable(y, log_y)) {
      ++facts.omitted.not_positive;
    } else {
      ++facts.drawn;
      facts.x.include(x);
      facts.y.include(y);
      facts.ascending = facts.ascending && x >= before;
      before = x;
    }
  }
  return facts;
}

std::string path_of(const Series& series, const Facts& facts, const Axis& x, const Axis& y,
                    double height_px) {
  if (facts.drawn <= 2 * kColumns) return full_path(series, facts, x, y, height_px);
  if (facts.ascending && series.style != Series::Style::points)
    return decimated_path(series, facts, x, y, height_px);
  return cell_path(series, facts, x, y, height_px);
}

std::string lens_json(const Series& series, const Facts& facts, const Axis& x, const Axis& y,
                      std::size_t columns) {
  if (columns == 0 || facts.drawn == 0) return "null";
  // float keeps 7 digits of the distance from the middle, whatever the offset of the signal.
  const double offset = y.log ? 0 : facts.y.low / 2 + facts.y.high / 2;
  const auto stored = [&](double value) {
    return static_cast<float>(std::clamp(value - offset, -3e38, 3e38));
  };
  constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
  std::vector<float> values;
  const char* kind = "points";
  if (facts.drawn <= columns) {  // every point: fraction of the x axis, value
    if (!facts.ascending) kind = "curve";
    bool first = true;
    for_each_drawable(series, facts, x.log, y.log, [&](double at, double value, bool after_gap) {
      if (after_gap && !first) values.insert(values.end(), {kNothing, kNothing});
      values.insert(values.end(), {static_cast<float>(x.at(at)), stored(value)});
      first = false;
    });
  } else if (facts.ascending) {  // smallest and largest of each column
    kind = "envelope";
    for (const Column& c : envelope(series, facts, x, y, columns)) {
      values.push_back(c.any ? stored(c.low) : kNothing);
      values.push_back(c.any ? stored(c.high) : kNothing);
    }
  } else {
    return "null";
  }
  const char* style = series.style == Series::Style::points ? "points"
                      : series.style == Series::Style::step ? "step"
                                                            : "line";
  std::string out;
  put(out, "{\"kind\":\"", kind, "\",\"style\":\"", style, "\",\"offset\":", exact(offset),
      ",\"data\":\"", base64(values), "\"}");
  return out;
}

}  // namespace servosense::report::detail
