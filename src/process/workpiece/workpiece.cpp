#include "servosense/process/workpiece/workpiece.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "servosense/io/text.hpp"

namespace servosense::process {
namespace {

/// Irrational numbers whose multiples fill [0, 1) evenly in one and in two dimensions: powers of
/// the root of x^3 = x + 1 (Roberts 2018).
constexpr double kRowShift = 0.7548776662466927, kColumnShift = 0.5698402909980532;

std::vector<double> shifts(std::size_t count, double by) {
  std::vector<double> all(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double multiple = (static_cast<double>(i) + 0.5) * by;
    all[i] = multiple - std::floor(multiple);
  }
  return all;
}

double lines_at(const BoxStock& box, double spacing) {
  std::array<double, 3> n{};
  for (std::size_t a = 0; a < 3; ++a) n[a] = std::ceil((box.high[a] - box.low[a]) / spacing);
  return 4 * n[0] * n[1] + n[1] * n[2] + n[2] * n[0];
}

Stretch stretch(double low, double high, double origin) {
  return {static_cast<float>(low - origin), static_cast<float>(high - origin)};
}

}  // namespace

double default_spacing_m(const Stock& stock, double smallest_radius_m) {
  const BoxStock box = bounds_of(stock);
  double spacing = std::min(kDefaultSpacing, kSpacingShare * smallest_radius_m);
  while (lines_at(box, spacing) > kMostLines) spacing *= 1.1;
  return spacing;
}

template <typename Fill>
void Workpiece::fill(std::size_t axis, const Fill& stretches_of) {
  Dexels& lines = lines_[axis];
  const auto put = [&](std::size_t line, double u, double v) {
    const Interval in = stretches_of(u, v);
    const Stretch only = stretch(in.low, in.high, origin_[axis]);
    if (only.low < only.high) lines.set(line, {&only, 1});
  };
  if (axis == 2) {
    for (std::size_t j = 0; j < plan_[1]; ++j)
      for (std::size_t i = 0; i < plan_[0]; ++i) put(column(i, j), column_x(i, j), column_y(i, j));
    return;
  }
  for (std::size_t k = 0; k < cells_[2]; ++k)
    for (std::size_t i = 0; i < cells_[1 - axis]; ++i)
      put(level_line(axis, i, k), lattice(1 - axis, i), lattice(2, k));
}

void Workpiece::fill_from(const Mesh& mesh, std::size_t axis) {
  // Where the triangles cross the lines. Sides are taken in one sense whichever triangle they
  // belong to, so that a line that passes through one belongs to exactly one of its triangles.
  const std::size_t u = axis == 0 ? 1 : 0, v = axis == 2 ? 1 : 2;
  struct Crossing {
    std::uint32_t line;
    float at;
  };
  std::vector<Crossing> crossings;
  crossings.reserve(2 * lines_[axis].size());
  const auto side = [&](const Point& a, const Point& b, double pu, double pv) {
    const auto signed_area = [&](const Point& s, const Point& t) {
      return (t[u] - s[u]) * (pv - s[v]) - (t[v] - s[v]) * (pu - s[u]);
    };
    const bool swapped = std::pair(b[u], b[v]) < std::pair(a[u], a[v]);
    const bool left = swapped ? !(signed_area(b, a) >= 0) : signed_area(a, b) >= 0;
    return left;
  };
  for (const auto& t : mesh.triangles) {
    const Point &a = mesh.corners[t[0]], &b = mesh.corners[t[1]], &c = mesh.corners[t[2]];
    const auto spread = [&](std::size_t of) {
      return Interval{std::min({a[of], b[of], c[of]}), std::max({a[of], b[of], c[of]})};
    };
    const double nu = (b[v] - a[v]) * (c[axis] - a[axis]) - (b[axis] - a[axis]) * (c[v] - a[v]);
    const double nv = (b[axis] - a[axis]) * (c[u] - a[u]) - (b[u] - a[u]) * (c[axis] - a[axis]);
    const double n = (b[u] - a[u]) * (c[v] - a[v]) - (b[v] - a[v]) * (c[u] - a[u]);
    if (n == 0) continue;  // seen from its edge
    const Interval along = spread(axis);
    const auto cross = [&](std::size_t line, double pu, double pv) {
      const bool first = side(a, b, pu, pv);
      if (side(b, c, pu, pv) != first || side(c, a, pu, pv) != first) return;
      const double at = a[axis] - (nu * (pu - a[u]) + nv * (pv - a[v])) / n;
      crossings.push_back(
          {static_cast<std::uint32_t>(line),
           static_cast<float>(std::clamp(at, along.low, along.high) - origin_[axis])});
    };
    if (axis == 2) {
      const auto is = plan_range(0, spread(0)), js = plan_range(1, spread(1));
      for (std::size_t j = js[0]; j < js[1]; ++j)
        for (std::size_t i = is[0]; i < is[1]; ++i)
          cross(column(i, j), column_x(i, j), column_y(i, j));
    } else {
      const auto is = lattice_range(1 - axis, spread(1 - axis)), ks = lattice_range(2, spread(2));
      for (std::size_t k = ks[0]; k < ks[1]; ++k)
        for (std::size_t i = is[0]; i < is[1]; ++i)
          cross(level_line(axis, i, k), lattice(1 - axis, i), lattice(2, k));
    }
  }
  std::sort(crossings.begin(), crossings.end(), [](const Crossing& a, const Crossing& b) {
    return std::pair(a.line, a.at) < std::pair(b.line, b.at);
  });
  std::vector<Stretch> stretches;
  for (std::size_t i = 0; i < crossings.size();) {
    const std::uint32_t line = crossings[i].line;
    stretches.clear();
    for (; i + 1 < crossings.size() && crossings[i].line == line && crossings[i + 1].line == line;
         i += 2)
      if (crossings[i].at < crossings[i + 1].at)
        stretches.push_back({crossings[i].at, crossings[i + 1].at});
    while (i < crossings.size() && crossings[i].line == line) ++i;
    lines_[axis].set(line, stretches);
  }
}

Expected<Workpiece> Workpiece::of(const Stock& stock, double spacing_m, Lines lines) {
  const BoxStock box = bounds_of(stock);
  if (!(spacing_m > 0)) return usage_error("the spacing of the lines is above 0");
  if (lines_at(box, spacing_m) > kMostLines)
    return usage_error("lines " + printed(spacing_m * 1e3) +
                       " mm apart are too many for this stock; the finest spacing it can have is " +
                       printed(default_spacing_m(stock, spacing_m) * 1e3) + " mm");
  Workpiece w;
  w.origin_ = box.low;
  for (std::size_t a = 0; a < 3; ++a) {
    const double size = box.high[a] - box.low[a];
    w.cells_[a] = static_cast<std::size_t>(std::max(1.0, std::ceil(size / spacing_m - 1e-9)));
    w.cell_[a] = size / static_cast<double>(w.cells_[a]);
  }
  for (std::size_t a = 0; a < 2; ++a) {
    w.plan_[a] = 2 * w.cells_[a];
    w.plan_cell_[a] = w.cell_[a] / 2;
  }
  w.row_shift_ = shifts(w.plan_[1], kRowShift);
  w.column_shift_ = shifts(w.plan_[0], kColumnShift);
  w.lines_[2] = Dexels(w.plan_[0] * w.plan_[1]);
  if (lines == Lines::all)
    for (const std::size_t axis : {0U, 1U})
      w.lines_[axis] = Dexels(w.cells_[1 - axis] * w.cells_[2]);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (w.lines_[axis].size() == 0) continue;
    if (const auto* mesh = std::get_if<Mesh>(&stock)) {
      w.fill_from(*mesh, axis);
    } else if (const auto* c = std::get_if<CylinderStock>(&stock)) {
      w.fill(axis, [&](double u, double v) -> Interval {
        if (axis == 2)
          return std::hypot(u - c->x_m, v - c->y_m) <= c->radius_m ? Interval{c->low_m, c->high_m}
                                                                   : Interval{};
        const double centre = axis == 0 ? c->x_m : c->y_m, off = u - (axis == 0 ? c->y_m : c->x_m);
        const double half2 = c->radius_m * c->radius_m - off * off;
        if (half2 < 0) return {};
        return {centre - std::sqrt(half2), centre + std::sqrt(half2)};
      });
    } else {
      w.fill(axis, [&](double, double) { return Interval{box.low[axis], box.high[axis]}; });
    }
  }
  return w;
}

std::array<std::size_t, 2> Workpiece::lattice_range(std::size_t axis, const Interval& of) const {
  if (of.empty()) return {0, 0};
  const auto last = static_cast<double>(cells_[axis]);
  const double first = std::ceil((of.low - origin_[axis]) / cell_[axis] - 0.5);
  const double end = std::floor((of.high - origin_[axis]) / cell_[axis] - 0.5) + 1;
  return {static_cast<std::size_t>(std::clamp(first, 0.0, last)),
          static_cast<std::size_t>(std::clamp(end, 0.0, last))};
}

std::array<std::size_t, 2> Workpiece::plan_range(std::size_t axis, const Interval& of) const {
  if (of.empty()) return {0, 0};
  const auto last = static_cast<double>(plan_[axis]);
  const double first = std::floor((of.low - origin_[axis]) / plan_cell_[axis]);
  const double end = std::ceil((of.high - origin_[axis]) / plan_cell_[axis]);
  return {static_cast<std::size_t>(std::clamp(first, 0.0, last)),
          static_cast<std::size_t>(std::clamp(end, 0.0, last))};
}

double Workpiece::volume_m3() const {
  double length = 0;
  for (std::size_t i = 0; i < lines_[2].size(); ++i) length += lines_[2].length(i);
  return length * plan_area_m2();
}

double Workpiece::volume_in(const Sweep& sweep) const {
  double length = 0;
  const double top = origin_[2] + static_cast<double>(cells_[2]) * cell_[2];
  if (sweep.bounds(2).low >= top) return 0;
  each_column(sweep, [&](std::size_t line, std::size_t, std::size_t, double x, double y) {
    const Interval in = sweep.along_z(x, y);
    if (in.empty()) return;
    const Stretch cut = stretch(in.low, in.high, origin_[2]);
    for (const Stretch& s : lines_[2].of(line))
      length += static_cast<double>(
          std::max(0.0F, std::min(s.high, cut.high) - std::max(s.low, cut.low)));
  });
  return length * plan_area_m2();
}

double Workpiece::remove(const Sweep& sweep) {
  double length = 0;
  each_column(sweep, [&](std::size_t line, std::size_t, std::size_t, double x, double y) {
    const Interval in = sweep.along_z(x, y);
    if (in.empty()) return;
    const Stretch cut = stretch(in.low, in.high, origin_[2]);
    lines_[2].subtract(line, cut.low, cut.high, [&](float from, float to) {
      length += static_cast<double>(to) - static_cast<double>(from);
    });
  });
  remove_level(sweep, sweep.bounds(2).high);
  return length * plan_area_m2();
}

void Workpiece::remove_level(const Sweep& sweep, double top_m) {
  if (!has_level_lines()) return;
  Interval heights = sweep.bounds(2);
  heights.high = std::min(heights.high, top_m);
  const auto layers = lattice_range(2, heights);
  const auto ignore = [](float, float) {};
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const std::size_t other = 1 - axis;
    const Interval path = {std::min(sweep.from()[axis], sweep.to()[axis]),
                           std::max(sweep.from()[axis], sweep.to()[axis])};
    const Interval aside = {std::min(sweep.from()[other], sweep.to()[other]),
                            std::max(sweep.from()[other], sweep.to()[other])};
    for (std::size_t k = layers[0]; k < layers[1]; ++k) {
      const double z = lattice(2, k), radius = sweep.radius_passing(z);
      if (radius < 0) continue;
      const auto across = lattice_range(other, {aside.low - radius, aside.high + radius});
      for (std::size_t i = across[0]; i < across[1]; ++i) {
        // First by a box about it: most lines were cut by the step before.
        const double place = lattice(other, i);
        const double off = std::max({0.0, aside.low - place, place - aside.high});
        const double half = std::sqrt(std::max(0.0, radius * radius - off * off));
        const Stretch box = stretch(path.low - half, path.high + half, origin_[axis]);
        const std::size_t line = level_line(axis, i, k);
        if (!lines_[axis].meets(line, box.low, box.high)) continue;
        const Interval in = sweep.along(axis, place, z);
        if (in.empty()) continue;
        const Stretch cut = stretch(in.low, in.high, origin_[axis]);
        lines_[axis].subtract(line, cut.low, cut.high, ignore);
      }
    }
  }
}

}  // namespace servosense::process
