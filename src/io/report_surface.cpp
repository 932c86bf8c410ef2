// Parts of the report as one sees them: columns in an isometric view, from the front.
#include <algorithm>
#include <array>

#include "report_internal.hpp"

namespace servosense::report::detail {

namespace {

constexpr std::size_t kMostCells = 90;  // on the longer side: some 1 MB where no two are alike
constexpr double kAcross = 0.8660254037844386, kDown = 0.5;  // cos and sin of 30 degrees
constexpr double kWide = 1000;                               // of the picture

/// Upper ends of columns on a grid, the highest of those that fall into one of its cells.
struct Columns {
  std::size_t nx = 0, ny = 0;
  std::vector<double> z;
  double dx = 0, dy = 0;
  /// NaN where nothing stands, and beyond the ends.
  [[nodiscard]] double at(long i, long j) const {
    const bool in = i >= 0 && j >= 0 && i < static_cast<long>(nx) && j < static_cast<long>(ny);
    return in ? z[static_cast<std::size_t>(j) * nx + static_cast<std::size_t>(i)]
              : std::numeric_limits<double>::quiet_NaN();
  }
};

Columns columns_of(const Surface& s) {
  Columns c;
  const std::size_t nx = s.x_edges.size() - 1, ny = s.y_edges.size() - 1;
  const double wide = s.x_edges.back() - s.x_edges.front(),
               deep = s.y_edges.back() - s.y_edges.front();
  const double cell = std::max(wide, deep) / static_cast<double>(kMostCells);
  const auto cells = [&](double length, std::size_t most) {
    return std::clamp<std::size_t>(static_cast<std::size_t>(std::lround(length / cell)), 1, most);
  };
  c.nx = cells(wide, nx), c.ny = cells(deep, ny);
  c.dx = wide / static_cast<double>(c.nx), c.dy = deep / static_cast<double>(c.ny);
  c.z.assign(c.nx * c.ny, std::numeric_limits<double>::quiet_NaN());
  for (std::size_t j = 0; j < ny; ++j)
    for (std::size_t i = 0; i < nx; ++i) {
      double& top = c.z[j * c.ny / ny * c.nx + i * c.nx / nx];
      const double value = s.z[j * nx + i];
      if (drawable(value, false) && !(value <= top)) top = value;
    }
  return c;
}

std::string grey(double light) {
  const auto value = static_cast<unsigned>(std::lround(255 * std::clamp(light, 0.0, 1.0)));
  std::string out = "#";
  // A little blue, as steel is.
  for (const unsigned part : {value * 92 / 100, value * 96 / 100, value}) {
    out += "0123456789abcdef"[part / 16];
    out += "0123456789abcdef"[part % 16];
  }
  return out;
}

class Drawing {
 public:
  Drawing(const Surface& surface, const Columns& columns) : c_(columns), floor_(surface.floor) {
    for (const double z : c_.z)
      if (!std::isnan(z)) high_ = std::max(high_, z);
    high_ = std::max(high_, floor_);
    const double wide = static_cast<double>(c_.nx) * c_.dx,
                 deep = static_cast<double>(c_.ny) * c_.dy;
    scale_ = kWide / ((wide + deep) * kAcross);
    left_ = deep * kAcross * scale_;
    height_ = ((wide + deep) * kDown + high_ - floor_) * scale_;
  }

  /// From the back to the front: what is drawn later hides what is behind it.
  std::string svg() {
    for (long j = static_cast<long>(c_.ny) - 1; j >= 0; --j)
      for (long i = static_cast<long>(c_.nx) - 1; i >= 0;) {
        const double z = c_.at(i, j);
        long from = i;  // a run of columns that look alike
        const double front = standing(i, j - 1);
        while (from > 0 && c_.at(from - 1, j) == z && standing(from - 1, j - 1) == front) --from;
        if (!std::isnan(z)) {
          const double x0 = at_x(from), x1 = at_x(i + 1), y0 = at_y(j), y1 = at_y(j + 1);
          face({{{x0, y0, z}, {x1, y0, z}, {x1, y1, z}, {x0, y1, z}}}, top_light(z));
          if (front < z) face({{{x0, y0, z}, {x1, y0, z}, {x1, y0, front}, {x0, y0, front}}}, 0.62);
          const double beside = standing(from - 1, j);
          if (beside < z)
            face({{{x0, y0, z}, {x0, y1, z}, {x0, y1, beside}, {x0, y0, beside}}}, 0.42);
        }
        i = from - 1;
      }
    std::string out = "<svg viewBox=\"0 0 " + plain(kWide, 0) + " " + plain(height_, 0) +
                      "\" width=\"100%\" role=\"img\" stroke-width=\"0.6\">";
    return out + body_ + "</svg>\n";
  }

 private:
  using Corner = std::array<double, 3>;
  [[nodiscard]] double at_x(long i) const { return static_cast<double>(i) * c_.dx; }
  [[nodiscard]] double at_y(long j) const { return static_cast<double>(j) * c_.dy; }
  /// Height of what stands there.
  [[nodiscard]] double standing(long i, long j) const {
    const double z = c_.at(i, j);
    return std::isnan(z) ? floor_ : z;
  }
  /// Deeper is darker.
  [[nodiscard]] double top_light(double z) const {
    return high_ > floor_ ? 0.78 + 0.17 * (z - floor_) / (high_ - floor_) : 0.95;
  }
  void face(const std::array<Corner, 4>& corners, double light) {
    body_ += "<path d=\"";
    for (std::size_t k = 0; k < corners.size(); ++k) {
      const auto& [x, y, z] = corners[k];
      put(body_, k == 0 ? "M" : "L", plain(left_ + (x - y) * kAcross * scale_, 1), " ",
          plain(height_ - ((x + y) * kDown + z - floor_) * scale_, 1));
    }
    const std::string colour = grey(light);
    put(body_, "z\" fill=\"", colour, "\" stroke=\"", colour, "\"/>");
  }

  const Columns& c_;
  double floor_, high_ = -std::numeric_limits<double>::infinity();
  double scale_ = 1, left_ = 0, height_ = 0;
  std::string body_;
};

}  // namespace

std::string html_of(const Surface& surface) {
  std::string out = "<figure class=\"table\">\n";
  put_caption(out, surface.title, surface.caption);
  const bool sound =
      surface.x_edges.size() > 1 && surface.y_edges.size() > 1 &&
      surface.z.size() == (surface.x_edges.size() - 1) * (surface.y_edges.size() - 1) &&
      surface.x_edges.back() > surface.x_edges.front() &&
      surface.y_edges.back() > surface.y_edges.front() && drawable(surface.floor, false);
  if (!sound) return out + "<p>There is no surface to draw.</p></figure>\n";
  const Columns columns = columns_of(surface);
  return out + Drawing(surface, columns).svg() + "</figure>\n";
}

}  // namespace servosense::report::detail
