// States over time: a table whose middle column is a bar a row.
#include <algorithm>
#include <array>
#include <string_view>

#include "report_internal.hpp"

namespace servosense::report::detail {
namespace {

struct StateWord {
  std::string_view state;
  const char* word;
};
constexpr std::array<StateWord, 6> kStates = {{{"idle", "nothing to watch"},
                                               {"learning", "filling its windows"},
                                               {"armed", "watching"},
                                               {"warning", "warning"},
                                               {"alarm", "alarm"},
                                               {"signal-fault", "signals not to be trusted"}}};

bool occurs(const Timeline& timeline, std::string_view state) {
  for (const TimelineRow& row : timeline.rows)
    for (const TimelineSpan& span : row.spans)
      if (span.state == state) return true;
  return false;
}

/// Spans of a fraction of a pixel, thousands of them, are joined; what is grave is never hidden.
std::string bar_of(const Timeline& timeline, const TimelineRow& row) {
  constexpr double kLeast = 0.0015;  // of the width: a pixel or so
  const double length = timeline.to - timeline.from;
  std::string out = "<svg width=\"100%\" height=\"14\" role=\"img\"><title>";
  put(out, escaped(row.name), "</title>");
  for (const StateWord& state : kStates) {  // the grave ones last, over the others
    double drawn_to = -1;
    for (const TimelineSpan& span : row.spans) {
      if (span.state != state.state || !(length > 0)) continue;
      const double from = std::clamp((span.from - timeline.from) / length, 0.0, 1.0);
      const double to = std::clamp((span.to - timeline.from) / length, 0.0, 1.0);
      const double end = std::max(to, from + kLeast);
      if (!(end > drawn_to)) continue;
      put(out, "<rect class=\"", std::string(state.state), "\" x=\"", plain(100 * from),
          "%\" width=\"", plain(100 * (end - from)), "%\" height=\"14\"/>");
      drawn_to = end;
    }
  }
  return out + "</svg>";
}

}  // namespace

std::string html_of(const Timeline& timeline) {
  std::string out = "<figure class=\"timeline\">\n<figcaption>";
  if (!timeline.title.empty()) put(out, "<h3>", escaped(timeline.title), "</h3>");
  if (!timeline.caption.empty()) put(out, "<p>", escaped(timeline.caption), "</p>");
  out += "</figcaption>\n<ul class=\"legend\">";
  for (const StateWord& state : kStates)
    if (occurs(timeline, state.state))
      put(out,
          "<li><svg class=\"swatch\" width=\"26\" height=\"12\" aria-hidden=\"true\"><rect "
          "class=\"",
          std::string(state.state), "\" width=\"26\" height=\"12\"/></svg><span>", state.word,
          "</span></li>");
  const std::string unit = timeline.unit.empty() ? "" : " " + escaped(pretty_unit(timeline.unit));
  out += "</ul>\n<table class=\"bars\">\n<tbody>\n";
  for (const TimelineRow& row : timeline.rows)
    put(out, "<tr><th scope=\"row\">", escaped(row.name), "</th><td>", bar_of(timeline, row),
        "</td><td>", escaped(row.remark), "</td></tr>\n");
  put(out,
      "<tr><td></td><td><svg width=\"100%\" height=\"18\" aria-hidden=\"true\"><text y=\"13\">",
      number(timeline.from), unit, "</text><text class=\"axis x\" x=\"100%\" y=\"13\">",
      number(timeline.to), unit, "</text></svg></td><td></td></tr>\n");
  return out + "</tbody>\n</table>\n</figure>\n";
}

}  // namespace servosense::report::detail
