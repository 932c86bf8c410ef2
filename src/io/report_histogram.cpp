// Histograms of the report.
#include <algorithm>

#include "report_internal.hpp"

namespace servosense::report::detail {

namespace {

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

}  // namespace

std::string html_of(const Histogram& h, const std::string& id) {
  const Bins bins = h.values.empty() ? bins_of_counts(h) : bins_of_values(h);
  Picture p;
  p.id = id;
  p.title = h.title;
  p.caption = h.caption;
  p.x_label = h.x_label;
  p.y_label = "Count";
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
  for (const Mark& m : h.limits) {
    const double at = p.x.at(m.x);
    const std::string words = (m.label.empty() ? "Limit" : m.label) + " " + p.x.value(m.x);
    if (!(at >= 0 && at <= 1)) {
      p.remarks.push_back(words + " lies outside the picture.");
      continue;
    }
    put(p.over, "<path class=\"vertical\" d=\"M", std::to_string(x_unit(p.x, m.x)), " 0V",
        plain(10 * p.height_px), "\"/>");
    p.legend.push_back({words, "vertical"});
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

}  // namespace servosense::report::detail
