#include "pictures.hpp"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <map>
#include <set>

namespace blind {
namespace {

// Ink and colours that stand out from white and from black alike; the three can be told apart by
// the colour-blind (Okabe and Ito 2008).
constexpr const char* kInk = "#768390";
constexpr const char* kRight = "#1f80c4";
constexpr const char* kWrong = "#d55e00";
constexpr const char* kAbstained = "#999999";

void put(std::string& out, const char* format, ...) {
  char text[600];
  va_list list;
  va_start(list, format);
  std::vsnprintf(text, sizeof text, format, list);
  va_end(list);
  out += text;
}

std::string opened(double width, double height, const char* what) {
  std::string svg;
  put(svg,
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\" width=\"%.0f\" "
      "height=\"%.0f\" role=\"img\" font-family=\"system-ui,sans-serif\" font-size=\"13\" "
      "fill=\"%s\">\n<title>%s</title>\n",
      width, height, width, height, kInk, what);
  return svg;
}

void words(std::string& svg, double x, double y, const char* anchor, const std::string& text,
           const char* more = "") {
  put(svg, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\"%s>%s</text>\n", x, y, anchor, more,
      text.c_str());
}

void line(std::string& svg, double x1, double y1, double x2, double y2, const char* colour,
          double width, const char* more = "") {
  put(svg,
      "<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\" "
      "stroke-width=\"%.1f\"%s/>\n",
      x1, y1, x2, y2, colour, width, more);
}

/// A frame with shares from 0 to 100 % upwards.
struct Frame {
  double left = 62, top = 46, width = 470, height = 260;
  [[nodiscard]] double y(double share) const { return top + (1 - share) * height; }
  void draw(std::string& svg, const char* title, const char* upwards, const char* along) const {
    words(svg, left, 20, "start", title, " font-size=\"15\" font-weight=\"600\"");
    words(svg, left, 37, "start", upwards);
    for (int k = 0; k <= 4; ++k) {
      line(svg, left, y(0.25 * k), left + width, y(0.25 * k), kInk, k == 0 ? 1 : 0.4);
      words(svg, left - 8, y(0.25 * k) + 4, "end", std::to_string(25 * k) + " %");
    }
    words(svg, left + width / 2, top + height + 42, "middle", along);
  }
};

void mark(std::string& svg, const Frame& f, double x, const Rate& rate, const char* colour) {
  const Interval i = rate.interval();
  line(svg, x, f.y(i.low), x, f.y(i.high), colour, 2);
  put(svg, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4.5\" fill=\"%s\"/>\n", x, f.y(rate.share()),
      colour);
}

/// Of names that were said with a confidence, how many are right.
std::string calibration(const Summary& s) {
  Frame f;
  f.height = 300;
  std::string svg = opened(560, 410, "Calibration: confidence said and share of names right");
  f.draw(svg, "Confidence said, and how often the name is right",
         "share right, with 95 % interval; dashed: as said", "confidence said (names)");
  const auto bins = static_cast<double>(s.calibration.size());
  std::string path;
  for (std::size_t k = 0; k < s.calibration.size(); ++k) {
    const Calibration& c = s.calibration[k];
    const double middle = f.left + (static_cast<double>(k) + 0.5) / bins * f.width;
    char label[60];
    std::snprintf(label, sizeof label, "%g to %g", c.from, c.to);
    words(svg, middle, f.top + f.height + 18, "middle",
          std::string(label) + " (" + std::to_string(c.right.of) + ")", " font-size=\"12\"");
    // What is said in a bin of no names: its middle.
    const double said =
        c.right.of > 0 ? c.confidence / static_cast<double>(c.right.of) : 0.5 * (c.from + c.to);
    line(svg, middle - 0.4 * f.width / bins, f.y(said), middle + 0.4 * f.width / bins, f.y(said),
         kInk, 1.5, " stroke-dasharray=\"5 4\"");
    if (c.right.of > 0) mark(svg, f, middle, c.right, kRight);
  }
  return svg + "</svg>\n";
}

/// Right, abstained and wrong over the strength of what is hidden.
std::string sweep(const Summary& s) {
  const Frame f;
  std::string svg = opened(560, 400, "Share right, abstained and wrong over strength");
  f.draw(svg, "One hidden effect: what is said, by its strength",
         "share of cases, with 95 % interval", "strength: rms over that of the noise (cases)");
  const auto bins = static_cast<double>(s.sweep.size());
  struct Curve {
    const char* title;
    const char* colour;
    double shift;
  };
  const Curve curves[] = {{"right", kRight, -6}, {"no name", kAbstained, 0}, {"wrong", kWrong, 6}};
  for (std::size_t c = 0; c < 3; ++c) {
    std::string path;
    for (std::size_t k = 0; k < s.sweep.size(); ++k) {
      const Outcomes& o = s.sweep[k].second;
      if (o.of == 0) continue;
      const Rate rate{c == 0 ? o.right : c == 1 ? o.abstained() : o.wrong, o.of};
      const double x = f.left + (static_cast<double>(k) + 0.5) / bins * f.width + curves[c].shift;
      put(path, "%c%.1f %.1f", path.empty() ? 'M' : 'L', x, f.y(rate.share()));
      mark(svg, f, x, rate, curves[c].colour);
    }
    put(svg, "<path d=\"%s\" fill=\"none\" stroke=\"%s\" stroke-width=\"1.2\"/>\n", path.c_str(),
        curves[c].colour);
    const double x = f.left + 30 + 120 * static_cast<double>(c);
    put(svg, "<circle cx=\"%.1f\" cy=\"377\" r=\"4.5\" fill=\"%s\"/>\n", x, curves[c].colour);
    words(svg, x + 10, 381, "start", curves[c].title);
  }
  for (std::size_t k = 0; k < s.sweep.size(); ++k) {
    const double x = f.left + static_cast<double>(k) / bins * f.width;
    char label[40];
    std::snprintf(label, sizeof label, "%g", s.sweep[k].first);
    words(svg, x, f.top + f.height + 16, "middle", label, " font-size=\"12\"");
    words(svg, x + 0.5 * f.width / bins, f.top + f.height + 16, "middle",
          "(" + std::to_string(s.sweep[k].second.of) + ")", " font-size=\"10\"");
  }
  return svg + "</svg>\n";
}

/// What is hidden against the first name said; `from` and `to`: classes of strength.
std::string confusion(const Summary& s, std::size_t from, std::size_t to, const char* title,
                      bool nameless) {
  std::map<std::string, std::map<std::string, std::size_t>> rows;
  std::set<std::string> names;
  const auto add = [&](const std::string& truth, const auto& classes) {
    for (std::size_t c = from; c < to; ++c)
      for (const auto& [said, n] : classes[c]) {
        const std::string first = said.substr(0, said.find(" + "));
        const bool silent =
            first == "none" || first == "unexplained" || first == "refused" || first == "failed";
        rows[truth][silent ? "no name" : first] += n;
        if (!silent) names.insert(first);
      }
  };
  for (const auto& [truth, classes] : s.confusion) add(truth, classes);
  for (const auto& [truth, classes] : rows) names.insert(truth);
  std::vector<std::string> order;
  for (const auto& [truth, said] : rows) order.push_back(truth);
  if (nameless) {
    // Nulls and outside cases together, whatever strength the latter have.
    from = 0;
    to = kStrengthClasses.size();
    for (const auto& [name, classes] : s.nameless) {
      const auto slash = name.find('/');
      if (slash == std::string::npos || name.find("/poor") != std::string::npos) continue;
      const std::string domain = name.substr(0, slash);
      const bool null = name.find("/null") != std::string::npos;
      const std::string truth = null ? "nothing hidden, " + domain
                                : name.ends_with("/time-locked-vibration") ? "time-locked-vibration"
                                                                           : "outside, " + domain;
      if (!rows.contains(truth)) order.push_back(truth);
      add(truth, classes);
    }
  }
  std::vector<std::string> columns(names.begin(), names.end());
  columns.emplace_back("no name");
  constexpr double kCell = 17, kLeft = 196, kTop = 190;
  const double width = kLeft + kCell * static_cast<double>(columns.size()) + 96;
  const double height = kTop + kCell * static_cast<double>(order.size()) + 16;
  std::string svg = opened(width, height, title);
  words(svg, 8, 20, "start", title, " font-size=\"15\" font-weight=\"600\"");
  words(svg, 8, 38, "start", "row: hidden (cases); column: first name said");
  for (std::size_t c = 0; c < columns.size(); ++c) {
    const double x = kLeft + kCell * (static_cast<double>(c) + 0.5) + 4;
    put(svg, "<text font-size=\"11\" transform=\"translate(%.1f %.1f) rotate(-60)\">%s</text>\n", x,
        kTop - 6, columns[c].c_str());
  }
  for (std::size_t r = 0; r < order.size(); ++r) {
    const double y = kTop + kCell * static_cast<double>(r);
    const auto& said = rows[order[r]];
    std::size_t all = 0;
    for (const auto& [name, n] : said) all += n;
    words(svg, kLeft - 6, y + 13, "end", order[r] + " (" + std::to_string(all) + ")",
          " font-size=\"11\"");
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const double x = kLeft + kCell * static_cast<double>(c);
      const auto found = said.find(columns[c]);
      put(svg,
          "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.0f\" height=\"%.0f\" fill=\"%s\" "
          "fill-opacity=\"%.2f\"/>",
          x + 0.5, y + 0.5, kCell - 1, kCell - 1,
          found == said.end()       ? kInk
          : columns[c] == "no name" ? kAbstained
          : columns[c] == order[r]  ? kRight
                                    : kWrong,
          found == said.end()
              ? 0.07
              : 0.55 + 0.45 * static_cast<double>(found->second) / static_cast<double>(all));
      if (found != said.end())
        put(svg,
            "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"middle\" font-size=\"10\" "
            "fill=\"#fff\">%zu</text>",
            x + kCell / 2, y + 12.5, found->second);
    }
    svg += '\n';
  }
  return svg + "</svg>\n";
}

}  // namespace

std::vector<Picture> pictures_of(const Summary& s) {
  return {{"blind_calibration.svg", calibration(s)},
          {"blind_strength.svg", sweep(s)},
          {"blind_confusion.svg", confusion(s, 0, 1, "Named, strength 4 and more", true)},
          {"blind_confusion_weak.svg", confusion(s, 1, 3, "Named, strength 1 to 4", false)}};
}

}  // namespace blind
