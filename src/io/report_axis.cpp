// Axes of the report: range, SI prefix, ticks.
#include <algorithm>
#include <array>

#include "report_internal.hpp"

namespace servosense::report::detail {

namespace {

/// Units that take a prefix; a compound unit takes it on its first part (mm/s, kN/m²).
constexpr std::array<std::string_view, 13> kPrefixable = {"m", "N",  "Nm", "A",  "V",   "W",  "Hz",
                                                          "J", "Pa", "s",  "Ws", "rad", "Ohm"};

struct Scaling {
  double factor = 1;
  std::string unit;
};

/// Thousands of ten in which values up to `largest` read well.
int engineering_exponent(double largest) {
  return 3 * static_cast<int>(std::floor(std::log10(largest) / 3 + 1e-9));
}

Scaling scaling_for(double largest, std::string_view unit) {
  const std::string shown = pretty_unit(unit);
  if (!(largest > 0)) return {1, shown};
  std::size_t end = 0;
  while (end < unit.size() && std::isalpha(static_cast<unsigned char>(unit[end]))) ++end;
  const std::string_view head = unit.substr(0, end);
  const bool power =
      end < unit.size() && (unit[end] == '2' || unit[end] == '3' || unit[end] == '^');
  const bool takes_prefix =
      !power && std::find(kPrefixable.begin(), kPrefixable.end(), head) != kPrefixable.end();
  const int exponent = engineering_exponent(largest);
  if (takes_prefix && exponent >= -12 && exponent <= 12) {
    const bool keep = (largest >= 0.1 && largest < 1e4) || (head == "s" && largest >= 1);
    if (keep) return {1, shown};
    static constexpr std::array<const char*, 9> kPrefixes = {"p", "n", "µ", "m", "",
                                                             "k", "M", "G", "T"};
    const int prefix = exponent / 3 + 4;
    return {std::pow(10.0, -exponent), kPrefixes[static_cast<std::size_t>(prefix)] + shown};
  }
  if (largest >= 1e-3 && largest < 1e6) return {1, shown};
  const std::string factor = power_of_ten(exponent);
  return {std::pow(10.0, -exponent), shown.empty() ? "×" + factor : factor + " " + shown};
}

std::vector<Tick> linear_ticks(const Axis& axis, std::size_t most) {
  const double span = axis.to - axis.from;
  const double step = nice_step(span / static_cast<double>(std::max<std::size_t>(most, 2)));
  const int decimals =
      static_cast<int>(std::ceil(std::max(0.0, -std::log10(step * axis.scale) - 1e-9)));
  std::vector<Tick> out;
  const double slack = 1e-9;
  const double base = axis.origin;  // a multiple of every step in use
  const double first = std::ceil((axis.from - base) / step - slack);
  const double last = std::floor((axis.to - base) / step + slack);
  for (double i = first; i <= last; i += 1)
    out.push_back({axis.at(base + i * step), fixed(i * step * axis.scale, decimals)});
  // One label alone gives no scale.
  return out.size() < 2 && most < 16 ? linear_ticks(axis, 2 * most) : out;
}

std::vector<Tick> log_ticks(const Axis& axis, std::size_t most) {
  const double low = std::log10(axis.from), high = std::log10(axis.to);
  const double decades = high - low;
  std::vector<Tick> out;
  if (decades < 1) {  // no two decades in sight: steps as on a linear axis
    const double step =
        nice_step((axis.to - axis.from) / static_cast<double>(std::max<std::size_t>(most, 2)));
    for (double i = std::ceil(axis.from / step - 1e-9); i * step <= axis.to * (1 + 1e-12); i += 1)
      out.push_back({axis.at(i * step), number(i * step)});
    return out;
  }
  const double room = static_cast<double>(most);
  const double stride = std::max(1.0, std::ceil(decades / room));
  const bool between = 3 * decades <= room;
  // All decades are written alike: 0.01 beside 10⁻⁵ does not read as a scale.
  const bool powers = low < -4 || high >= 7;
  for (double n = std::floor(low / stride) * stride; n <= high + 1e-9; n += stride) {
    const double decade = std::pow(10.0, n);
    for (int digit = 1; digit <= (decades <= 6 ? 9 : 1); ++digit) {
      const double value = decade * digit;
      const double at = axis.at(value);
      if (at < -1e-9 || at > 1 + 1e-9) continue;
      const bool labelled = digit == 1 || (between && (digit == 2 || digit == 5));
      std::string label;
      if (labelled && powers)
        label = (digit == 1 ? "" : std::to_string(digit) + "×") + power_of_ten(static_cast<int>(n));
      else if (labelled)
        label = number(value, 2);
      out.push_back({at, std::move(label)});
    }
  }
  return out;
}

}  // namespace

double Axis::at(double value) const {
  if (log) return std::log10(value / from) / std::log10(to / from);
  return (value - from) / (to - from);
}

std::string Axis::title(std::string_view label) const {
  std::string out(label);
  if (!unit.empty()) put(out, out.empty() ? "[" : " [", unit, "]");
  if (origin != 0) put(out, out.empty() ? "" : ", ", "counted from ", number(origin, 15));
  return out;
}

std::string Axis::value(double raw) const {
  const double span = (to - from) * scale;
  std::string out = log || !(std::abs(raw) <= kLargest)
                        ? number(raw)
                        : fixed(raw * scale, static_cast<int>(std::ceil(3 - std::log10(span))));
  if (!unit.empty()) put(out, "\xC2\xA0", unit);
  return out;
}

double nice_step(double step) {
  const double decade = std::pow(10.0, std::floor(std::log10(step)));
  for (const double digit : {1.0, 2.0, 5.0})
    if (step <= digit * decade * (1 + 1e-9)) return digit * decade;
  return 10 * decade;
}

Axis make_axis(Extent data, const Range& wanted, bool log, std::string_view unit, double padding) {
  Axis axis;
  axis.log = log;
  const bool from_given = drawable(wanted.from, log), to_given = drawable(wanted.to, log);
  if (!data.any()) {
    data.low = from_given ? wanted.from
               : to_given ? (log ? wanted.to / 10 : wanted.to - 1)
               : log      ? 1
                          : 0;
    data.high = to_given ? wanted.to : log ? data.low * 10 : data.low + 1;
  }
  double from = from_given ? wanted.from : data.low;
  double to = to_given ? wanted.to : data.high;
  if (from_given && to_given && !(from < to)) {  // no range at all
    from = data.low;
    to = data.high;
  }
  const double largest = std::max(std::abs(from), std::abs(to));
  if (log) {
    if (!(to / from > 1 + 1e-9)) {
      const double middle = std::max(from, to);
      from = middle / 3;
      to = middle * 3;
    } else {
      const double grow = std::pow(to / from, padding);
      if (!from_given) from /= grow;
      if (!to_given) to *= grow;
    }
  } else if (!(to - from > 1e-12 * largest) || to - from < 1 / kLargest) {
    const double middle = largest < 1 / kLargest ? 0 : from / 2 + to / 2;
    const double half = middle == 0 ? 1 : std::abs(middle) * 0.1;
    from = middle - half;
    to = middle + half;
  } else {
    const double grow = (to - from) * padding;
    const bool above_zero = from >= 0, below_zero = to <= 0;
    if (!from_given) from = above_zero ? std::max(0.0, from - grow) : from - grow;
    if (!to_given) to = below_zero ? std::min(0.0, to + grow) : to + grow;
  }
  axis.from = from;
  axis.to = to;
  if (log) {
    axis.unit = pretty_unit(unit);
    return axis;
  }
  if (std::max(std::abs(from), std::abs(to)) > 1e5 * (to - from)) {
    const double decade = std::pow(10.0, std::ceil(std::log10(to - from)));
    axis.origin = std::floor(from / decade) * decade;
  }
  const Scaling scaling =
      scaling_for(std::max(std::abs(from - axis.origin), std::abs(to - axis.origin)), unit);
  axis.scale = scaling.factor;
  axis.unit = scaling.unit;
  return axis;
}

std::vector<Tick> ticks(const Axis& axis, std::size_t most) {
  return axis.log ? log_ticks(axis, most) : linear_ticks(axis, most);
}

std::vector<Tick> ticks_across(const Axis& axis, double width_px) {
  for (std::size_t most = static_cast<std::size_t>(width_px / 50); most > 2; --most) {
    std::vector<Tick> all = ticks(axis, most);
    bool fits = true;
    double right = -1e9;  // end of the label before
    for (const Tick& tick : all) {
      if (tick.label.empty()) continue;
      const double half = text_width_px(tick.label) / 2;
      fits = fits && tick.at * width_px - half >= right;
      right = tick.at * width_px + half + 10;
    }
    if (fits) return all;
  }
  return ticks(axis, 2);
}

}  // namespace servosense::report::detail
