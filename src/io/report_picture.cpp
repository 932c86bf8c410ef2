// The frame around every picture with two axes. The SVG element is the drawing area itself, as
// wide as the page allows: texts and rules are placed in per cent across and pixels down, and only
// the curves are stretched, so letters keep their size on every screen.
#include <algorithm>
#include <array>
#include <set>
#include <tuple>

#include "report_internal.hpp"

namespace servosense::report::detail {

namespace {

// Least width of the drawing area on a wide and on a narrow page (the style sheet's break).
constexpr double kWide_px = 520, kNarrow_px = 280;
constexpr std::size_t kMostListed = 60;
constexpr double kFlagRow_px = 20;

std::string percent(double fraction) { return plain(100 * fraction) + "%"; }

bool inside(double fraction) { return fraction >= -1e-9 && fraction <= 1 + 1e-9; }

/// A mark or span that has a label: a flag in the picture and an entry of the list below.
struct Entry {
  double at = 0;     ///< fraction of the x axis, middle of a span
  std::string when;  ///< not escaped
  std::string label;
  Level level = Level::none;
};

std::vector<Entry> entries_of(const Picture& p) {
  std::vector<Entry> entries;
  for (const Mark& m : p.marks)
    if (!m.label.empty()) entries.push_back({p.x.at(m.x), p.x.value(m.x), m.label, m.level});
  for (const Span& s : p.spans) {
    if (s.label.empty()) continue;
    // The flag stands over the part that is in the picture.
    double from = p.x.at(s.from), to = p.x.at(s.to);
    if (from < 1 && to > 0) {
      from = std::max(from, 0.0);
      to = std::min(to, 1.0);
    }
    entries.push_back(
        {(from + to) / 2, p.x.value(s.from) + " to " + p.x.value(s.to), s.label, s.level});
  }
  const auto graver = [](const Entry& a, const Entry& b) { return a.level > b.level; };
  const auto earlier = [](const Entry& a, const Entry& b) { return a.at < b.at; };
  if (entries.size() > kMostListed) {
    std::stable_sort(entries.begin(), entries.end(), graver);
    entries.resize(kMostListed);
  }
  // NaN would break the order; such marks are listed last.
  const auto middle = std::stable_partition(entries.begin(), entries.end(),
                                            [](const Entry& e) { return std::isfinite(e.at); });
  std::stable_sort(entries.begin(), middle, earlier);
  return entries;
}

struct Flag {
  std::size_t first = 0, last = 0;  ///< numbers that share it
  double from_at = 0, to_at = 0;
  Level level = Level::none;
  int row = 0;
  [[nodiscard]] std::string text() const {
    return first == last ? std::to_string(first)
                         : std::to_string(first) + "–" + std::to_string(last);
  }
  [[nodiscard]] double at() const { return (from_at + to_at) / 2; }
  [[nodiscard]] double width_px() const { return text_width_px(text()) + 10; }
};

/// Flags in two rows; those that still have no room share one.
std::vector<Flag> flags_of(const std::vector<Entry>& entries, double width_px) {
  std::vector<Flag> flags;
  std::array<double, 2> end = {-1e9, -1e9};
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const Entry& e = entries[i];
    if (!inside(e.at)) continue;
    Flag flag{i + 1, i + 1, e.at, e.at, e.level, 0};
    const double left = e.at * width_px - flag.width_px() / 2 - 6;
    for (flag.row = 0; flag.row < 2; ++flag.row)
      if (left >= end[static_cast<std::size_t>(flag.row)]) break;
    if (flag.row == 2) {
      Flag& shared = flags.back();
      shared.last = i + 1;
      shared.to_at = e.at;
      shared.level = std::max(shared.level, e.level);
      flag = shared;
    } else {
      flags.push_back(flag);
    }
    end[static_cast<std::size_t>(flag.row)] = flag.at() * width_px + flag.width_px() / 2;
  }
  return flags;
}

int rows_of(const std::vector<Flag>& flags) {
  int rows = 0;
  for (const Flag& f : flags) rows = std::max(rows, f.row + 1);
  return rows;
}

void put_flags(std::string& out, const std::vector<Flag>& flags, const char* width_class) {
  if (flags.empty()) return;
  put(out, "<g class=\"", width_class, "\" aria-hidden=\"true\">");
  for (const Flag& f : flags) {
    const double w = f.width_px();
    put(out, "<svg class=\"flag ", level_class(f.level), "\" x=\"", percent(f.at()), "\" y=\"",
        plain(-kFlagRow_px * (f.row + 1)), "\"><rect x=\"", plain(-w / 2), "\" width=\"", plain(w),
        "\" height=\"17\" rx=\"3\"/><text y=\"13\">", f.text(), "</text></svg>");
  }
  out += "</g>\n";
}

void put_x_ticks(std::string& out, const Picture& p, double width_px, const char* width_class) {
  const double bottom = p.height_px;
  put(out, "<g class=\"", width_class, "\">");
  for (const Tick& t : ticks_across(p.x, width_px)) {
    const std::string at = percent(t.at);
    put(out, "<line class=\"", t.label.empty() ? "grid minor" : "grid", "\" x1=\"", at, "\" x2=\"",
        at, "\" y2=\"", plain(bottom), "\"/>");
    if (!t.label.empty() && p.x_tick_labels)
      put(out, "<text class=\"tick x\" x=\"", at, "\" y=\"", plain(bottom + 16), "\">", t.label,
          "</text>");
  }
  out += "</g>\n";
}

void put_y_ticks(std::string& out, const Picture& p) {
  const auto most = static_cast<std::size_t>(std::max(2.0, p.height_px / 36));
  out += "<g>";
  for (const Tick& t : ticks(p.y, most)) {
    const double at = p.height_px * (1 - t.at);
    put(out, "<line class=\"", t.label.empty() ? "grid minor" : "grid", "\" x2=\"100%\" y1=\"",
        plain(at), "\" y2=\"", plain(at), "\"/>");
    if (!t.label.empty())
      put(out, "<text class=\"tick y\" x=\"-7\" y=\"", plain(at + 4), "\">", t.label, "</text>");
  }
  out += "</g>\n";
}

void put_spans(std::string& out, const Picture& p) {
  std::set<std::tuple<Level, int, int>> drawn;  // thousands of alarms fall on the same pixels
  for (const Span& s : p.spans) {
    const double from = std::max(0.0, p.x.at(s.from)), to = std::min(1.0, p.x.at(s.to));
    if (!(from <= to)) continue;
    if (!drawn.emplace(s.level, static_cast<int>(from * 1000), static_cast<int>(to * 1000)).second)
      continue;
    put(out, "<rect class=\"span ", level_class(s.level), "\" x=\"", percent(from), "\" width=\"",
        percent(to - from), "\" height=\"", plain(p.height_px), "\"/>\n");
  }
}

void put_marks(std::string& out, const Picture& p) {
  std::set<std::pair<Level, int>> drawn;
  for (const Mark& m : p.marks) {
    const double at = p.x.at(m.x);
    if (!inside(at) || !drawn.emplace(m.level, static_cast<int>(at * 2000)).second) continue;
    put(out, "<line class=\"mark ", level_class(m.level), "\" x1=\"", percent(at), "\" x2=\"",
        percent(at), "\" y2=\"", plain(p.height_px), "\"/>\n");
  }
}

/// Threshold lines; a label that finds no room beside the others moves to the remarks.
void put_limits(std::string& out, const Picture& p, std::vector<std::string>& remarks) {
  struct Taken {
    bool left;
    double top;
  };
  std::vector<Taken> taken;
  const auto is_free = [&](bool left, double top) {
    if (top < 0 || top + 16 > p.height_px) return false;
    return std::none_of(taken.begin(), taken.end(), [&](const Taken& t) {
      return t.left == left && std::abs(t.top - top) < 16;
    });
  };
  for (const Limit& limit : p.limits) {
    const double at = p.y.at(limit.y);
    const std::string words = limit.label.empty() ? "Limit" : limit.label;
    if (!inside(at)) {
      remarks.push_back("“" + words + "” (" + p.y.value(limit.y) + ") lies outside the picture.");
      continue;
    }
    const double y = p.height_px * (1 - at);
    put(out, "<line class=\"limit ", level_class(limit.level), "\" x2=\"100%\" y1=\"", plain(y),
        "\" y2=\"", plain(y), "\"/>\n");
    if (limit.label.empty()) continue;
    bool placed = false;
    for (const bool left : {false, true}) {
      for (const double top : {y - 17, y + 2}) {
        if (placed || !is_free(left, top)) continue;
        taken.push_back({left, top});
        put(out, "<text class=\"limit ", level_class(limit.level), left ? " left" : "", "\" x=\"",
            left ? "0" : "100%", "\" dx=\"", left ? "5" : "-5", "\" y=\"", plain(top + 12), "\">",
            escaped(shortened(limit.label, 34)), "</text>\n");
        placed = true;
      }
    }
    if (!placed) remarks.push_back("Limit “" + words + "”: " + p.y.value(limit.y) + ".");
  }
}

void put_list(std::string& out, const std::vector<Entry>& entries) {
  if (entries.empty()) return;
  put(out, "<ol class=\"marks", entries.size() > 3 ? " many" : "", "\">\n");
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const Entry& e = entries[i];
    const std::string word = level_word(e.level);
    put(out, "<li class=\"", level_class(e.level), "\"><span class=\"number\">",
        std::to_string(i + 1), "</span><span>", word.empty() ? "" : word + " at ", "<b>",
        escaped(e.when), "</b>: ", escaped(e.label), inside(e.at) ? "" : " (outside the picture)",
        "</span></li>\n");
  }
  out += "</ol>\n";
}

void put_axis_json(std::string& out, const char* name, const Axis& a) {
  put(out, "\"", name, "\":{\"from\":", exact(a.from), ",\"to\":", exact(a.to),
      ",\"log\":", a.log ? "true" : "false", ",\"scale\":", exact(a.scale), "}");
}

void put_lens_json(std::string& out, const Picture& p) {
  out += "<script type=\"application/json\">{";
  put_axis_json(out, "x", p.x);
  out += ',';
  put_axis_json(out, "y", p.y);
  put(out, ",\"height\":", exact(p.height_px), ",\"marks\":[");
  bool first = true;
  std::set<std::pair<Level, int>> listed;
  for (const Mark& m : p.marks) {
    const double at = p.x.at(m.x);
    if (!inside(at) || !listed.emplace(m.level, static_cast<int>(at * 10000)).second) continue;
    put(out, first ? "" : ",", "[", plain(at, 6), ",\"", level_class(m.level), "\"]");
    first = false;
  }
  out += "],\"limits\":[";
  first = true;
  for (const Limit& l : p.limits) {
    if (!inside(p.y.at(l.y))) continue;
    put(out, first ? "" : ",", "[", exact(l.y), ",\"", level_class(l.level), "\"]");
    first = false;
  }
  put(out, "]", p.lens, "}</script>\n");
}

}  // namespace

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

std::string numbers_json(const std::vector<double>& values) {
  std::string out = "[";
  for (std::size_t i = 0; i < values.size(); ++i) put(out, i == 0 ? "" : ",", exact(values[i]));
  return out + "]";
}

std::string html_of(const Picture& p) {
  std::string out;
  std::vector<std::string> remarks = p.remarks;
  const std::vector<Entry> entries = entries_of(p);
  const std::vector<Flag> wide = flags_of(entries, kWide_px);
  const std::vector<Flag> narrow = flags_of(entries, kNarrow_px);
  const double above_px = kFlagRow_px * std::max(rows_of(wide), rows_of(narrow));
  const std::string y_title = p.y.title(p.y_label), x_title = p.x.title(p.x_label);
  const std::string height = plain(p.height_px);

  put(out, "<figure id=\"", p.id, "\">\n");
  if (!p.title.empty() || !p.caption.empty()) {
    out += "<figcaption>";
    if (!p.title.empty()) put(out, "<h3>", escaped(p.title), "</h3>");
    if (!p.caption.empty()) put(out, "<p>", escaped(p.caption), "</p>");
    out += "</figcaption>\n";
  }
  if (!p.legend.empty()) {
    out += "<ul class=\"legend\">";
    for (const LegendEntry& e : p.legend) {
      out += "<li>";
      if (!e.swatch.empty())
        put(out,
            "<svg class=\"swatch\" width=\"26\" height=\"12\" aria-hidden=\"true\"><path class=\"",
            e.swatch, "\" d=\"",
            e.swatch.find("points") == std::string::npos ? "M2 6h22" : "M13 6h0", "\"/></svg>");
      put(out, "<span>", escaped(e.name), "</span></li>");
    }
    out += "</ul>\n";
  }

  put(out, "<div class=\"frame", p.x_tick_labels ? "" : " bare",
      "\" style=\"padding-top:", plain(above_px + (y_title.empty() ? 8 : 26)),
      "px\">\n<svg class=\"area\" width=\"100%\" height=\"", height,
      "\" role=\"img\" tabindex=\"0\" aria-labelledby=\"", p.id, "-t ", p.id,
      "-d\" data-x-label=\"", escaped(p.x_label), "\" data-y-label=\"", escaped(p.y_label),
      "\" data-x-unit=\"", escaped(p.x.unit), "\" data-y-unit=\"", escaped(p.y.unit),
      "\">\n<title id=\"", p.id, "-t\">", escaped(p.title.empty() ? y_title : p.title),
      "</title>\n<desc id=\"", p.id, "-d\">", escaped(p.description),
      "</desc>\n<rect class=\"paper\" width=\"100%\" height=\"", height, "\"/>\n");
  put_spans(out, p);
  const std::string stretched = "<svg class=\"data\" width=\"100%\" height=\"" + height +
                                "\" viewBox=\"0 0 " + plain(kUnits) + " " +
                                plain(10 * p.height_px) + "\" preserveAspectRatio=\"none\">";
  put_x_ticks(out, p, kWide_px, "wide");
  put_x_ticks(out, p, kNarrow_px, "narrow");
  put_y_ticks(out, p);
  if (!p.under.empty()) put(out, stretched, p.under, "</svg>\n");
  put_marks(out, p);
  if (!p.over.empty()) put(out, stretched, p.over, "</svg>\n");
  put_limits(out, p, remarks);
  put(out, "<rect class=\"border\" width=\"100%\" height=\"", height, "\"/>\n");
  put_flags(out, wide, "wide");
  put_flags(out, narrow, "narrow");
  if (!y_title.empty())
    put(out, "<text class=\"axis\" x=\"-52\" y=\"", plain(-above_px - 10), "\">", escaped(y_title),
        "</text>\n");
  if (p.x_tick_labels && !x_title.empty())
    put(out, "<text class=\"axis x\" x=\"100%\" y=\"", plain(p.height_px + 34), "\">",
        escaped(x_title), "</text>\n");
  if (!p.empty_words.empty())
    put(out, "<text class=\"empty\" x=\"50%\" y=\"", plain(p.height_px / 2), "\">",
        escaped(p.empty_words), "</text>\n");
  out += "</svg>\n";
  put_lens_json(out, p);
  out += "</div>\n";

  out += p.below;
  put_list(out, entries);
  std::size_t labelled = 0;
  for (const Mark& m : p.marks) labelled += m.label.empty() ? 0U : 1U;
  for (const Span& s : p.spans) labelled += s.label.empty() ? 0U : 1U;
  if (labelled > entries.size())
    remarks.push_back(count_text(labelled - entries.size()) +
                      " further marks are drawn but not listed, the least grave ones.");
  for (const std::string& remark : remarks)
    put(out, "<p class=\"remark\">", escaped(remark), "</p>\n");
  out += "</figure>\n";
  return out;
}

}  // namespace servosense::report::detail
