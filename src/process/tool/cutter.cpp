#include "servosense/process/tool/cutter.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "servosense/io/text.hpp"

namespace servosense::process {
namespace {

constexpr double kRadians = std::numbers::pi / 180;

std::string in_mm(double metres) { return printed(metres * 1e3, 6) + " mm"; }

std::optional<Error> fault_of(const CutterShape& s) {
  if (!(s.diameter_m > 0) || !std::isfinite(s.diameter_m))
    return data_error("a cutter has a diameter above 0; give diameter_m");
  if (!(s.corner_radius_m >= 0) || s.corner_radius_m > s.diameter_m / 2)
    return data_error("a corner radius of " + in_mm(s.corner_radius_m) +
                      " does not fit a diameter of " + in_mm(s.diameter_m) +
                      "; corner_radius_m is at most half of diameter_m");
  if (s.kind == CutterKind::bull && !(s.corner_radius_m > 0))
    return data_error("a bull-nose cutter has a corner radius; give corner_radius_m");
  if (!(s.flute_length_m > 0)) return data_error("flute_length_m is above 0");
  if (s.kind == CutterKind::drill && !(s.point_angle_deg > 0 && s.point_angle_deg < 180))
    return data_error("the point angle of a drill is between 0 and 180; check point_angle_deg");
  if (s.kind == CutterKind::taper && !(s.taper_deg > 0 && s.taper_deg < 90))
    return data_error(
        "the side of a taper stands between 0 and 90 degrees off its axis; give "
        "taper_deg");
  if ((s.kind == CutterKind::taper || s.entering_angle_deg < 90) &&
      !std::isfinite(s.flute_length_m))
    return data_error("a conical cutter ends somewhere; give flute_length_m");
  if (s.kind == CutterKind::face && !(s.entering_angle_deg > 0 && s.entering_angle_deg <= 90))
    return data_error("an entering angle is above 0 and at most 90; check entering_angle_deg");
  if (s.kind == CutterKind::face && s.entering_angle_deg < 90 && s.corner_radius_m > 0)
    return data_error(
        "inserts have an entering angle below 90 or a corner radius, not both; leave "
        "out one of entering_angle_deg and corner_radius_m");
  if (std::isfinite(s.stick_out_m) && s.stick_out_m < s.flute_length_m &&
      std::isfinite(s.flute_length_m))
    return data_error(
        "the holder begins below the end of the flutes; stick_out_m is at least "
        "flute_length_m");
  return {};
}

}  // namespace

std::string_view cutter_kind_name(CutterKind kind) {
  switch (kind) {
    case CutterKind::flat:
      return "flat";
    case CutterKind::ball:
      return "ball";
    case CutterKind::bull:
      return "bull";
    case CutterKind::taper:
      return "taper";
    case CutterKind::drill:
      return "drill";
    case CutterKind::tap:
      return "tap";
    case CutterKind::face:
      break;
  }
  return "face";
}

Expected<Cutter> Cutter::of(const CutterShape& shape) {
  if (const auto fault = fault_of(shape)) return *fault;
  Cutter c;
  c.shape_ = shape;
  const double radius = shape.diameter_m / 2;
  double top = shape.flute_length_m;
  if (!std::isfinite(top)) top = std::min(kEndlessFlute, shape.stick_out_m);
  const auto nose = [&](double corner) {
    c.nose_ = RoundedDisc{radius - corner, corner, std::min(corner, top)};
  };
  double low = 0, low_radius = radius, widening = 0;
  switch (shape.kind) {
    case CutterKind::flat:
    case CutterKind::tap:
      break;
    case CutterKind::ball:
      nose(radius);
      low = radius;
      break;
    case CutterKind::bull:
    case CutterKind::face:
      if (shape.corner_radius_m > 0) nose(shape.corner_radius_m), low = shape.corner_radius_m;
      if (shape.entering_angle_deg < 90 && shape.kind == CutterKind::face)
        widening = 1 / std::tan(shape.entering_angle_deg * kRadians);
      break;
    case CutterKind::taper: {
      const double corner = shape.corner_radius_m, half = shape.taper_deg * kRadians;
      widening = std::tan(half);
      if (corner > 0) {  // the cone goes on where the corner has its slope
        nose(corner);
        low = corner * (1 - std::sin(half));
        low_radius = radius - corner + corner * std::cos(half);
        c.nose_->high_m = std::min(low, top);
      }
      break;
    }
    case CutterKind::drill: {
      const double cone = radius / std::tan(shape.point_angle_deg / 2 * kRadians);
      const double share = std::min(1.0, top / cone);
      c.frusta_.push_back({0, cone * share, 0, radius * share});
      low = cone;
      break;
    }
  }
  if (top > low) c.frusta_.push_back({low, top, low_radius, low_radius + widening * (top - low)});
  c.finish();
  return c;
}

Expected<Cutter> Cutter::thinner(double by_m) const {
  CutterShape shape = shape_;
  shape.diameter_m -= 2 * by_m;
  shape.corner_radius_m = std::max(0.0, shape.corner_radius_m - by_m);
  return of(shape);
}

std::optional<Cutter> Cutter::holder() const {
  if (!std::isfinite(shape_.stick_out_m) || !(shape_.holder_diameter_m > 0)) return {};
  return upright(shape_.holder_diameter_m / 2, shape_.stick_out_m,
                 shape_.stick_out_m + kEndlessFlute);
}

std::optional<Cutter> Cutter::shank() const {
  const double radius = radius_ - kShankClearance;
  if (!std::isfinite(shape_.flute_length_m) || !(radius > 0)) return {};
  const double high = std::isfinite(shape_.stick_out_m) ? shape_.stick_out_m
                                                        : shape_.flute_length_m + kEndlessFlute;
  if (!(high > shape_.flute_length_m)) return {};
  return upright(radius, shape_.flute_length_m, high);
}

Cutter Cutter::upright(double radius_m, double low_m, double high_m) {
  Cutter c;
  c.shape_.diameter_m = 2 * radius_m;
  c.frusta_.push_back({low_m, high_m, radius_m, radius_m});
  c.finish();
  return c;
}

void Cutter::finish() {
  bottom_ = nose_ ? 0 : frusta_.front().low_m;
  top_ = frusta_.empty() ? nose_->high_m : frusta_.back().high_m;
  bottom_radius_ = nose_ ? nose_->disc_m : frusta_.front().low_radius_m;
  radius_ = radius_at(top_);
  floor_scale_ = static_cast<double>(kFloorSteps) / (radius_ * radius_);
  for (std::size_t i = 0; i < kFloorSteps; ++i)
    floor_.push_back(surface_at(std::sqrt(static_cast<double>(i) / floor_scale_)));
  if (!nose_) return;
  const double r = nose_->corner_m;
  const double widest = std::acos(std::clamp(1 - nose_->high_m / r, -1.0, 1.0));
  const double step = 2 * std::acos(std::max(0.0, 1 - kNoseTolerance / r));
  const int pieces = std::max(1, static_cast<int>(std::ceil(widest / step)));
  const auto at = [&](int i) { return widest * i / pieces; };
  for (int i = 0; i < pieces; ++i)
    nose_frusta_.push_back({r * (1 - std::cos(at(i))), r * (1 - std::cos(at(i + 1))),
                            nose_->disc_m + r * std::sin(at(i)),
                            nose_->disc_m + r * std::sin(at(i + 1))});
}

double Cutter::radius_at(double height_m) const {
  if (height_m < bottom_ || height_m > top_) return -1;
  if (nose_ && height_m <= nose_->high_m) {
    const double below = nose_->corner_m - height_m;
    return nose_->disc_m +
           std::sqrt(std::max(0.0, nose_->corner_m * nose_->corner_m - below * below));
  }
  for (const Frustum& f : frusta_)
    if (height_m <= f.high_m)
      return f.low_radius_m +
             (f.high_radius_m - f.low_radius_m) * (height_m - f.low_m) / (f.high_m - f.low_m);
  return radius_;
}

double Cutter::widening_at(double height_m) const {
  if (nose_ && height_m < nose_->high_m) {
    const double below = nose_->corner_m - height_m;
    const double across =
        std::sqrt(std::max(0.0, nose_->corner_m * nose_->corner_m - below * below));
    return across > 0 ? below / across : std::numeric_limits<double>::infinity();
  }
  for (const Frustum& f : frusta_)
    if (height_m <= f.high_m) return (f.high_radius_m - f.low_radius_m) / (f.high_m - f.low_m);
  return 0;
}

double Cutter::surface_at(double distance_m) const {
  if (distance_m <= bottom_radius_) return bottom_;
  if (nose_) {
    const double out = distance_m - nose_->disc_m, r = nose_->corner_m;
    const double height = r - std::sqrt(std::max(0.0, r * r - out * out));
    if (out <= r && height <= nose_->high_m) return height;
  }
  for (const Frustum& f : frusta_)
    if (distance_m <= f.high_radius_m) {
      const double wider = f.high_radius_m - f.low_radius_m;
      if (!(wider > 0)) return f.low_m;
      return f.low_m + (f.high_m - f.low_m) * std::max(0.0, distance_m - f.low_radius_m) / wider;
    }
  return top_;
}

double Cutter::slope_at(double distance_m) const {
  if (distance_m < bottom_radius_) return 0;
  if (nose_) {
    const double out = distance_m - nose_->disc_m, r = nose_->corner_m;
    const double up = std::sqrt(std::max(0.0, r * r - out * out));
    if (out < r && r - up <= nose_->high_m) return out / up;
  }
  for (const Frustum& f : frusta_)
    if (distance_m <= f.high_radius_m && f.high_radius_m > f.low_radius_m)
      return (f.high_m - f.low_m) / (f.high_radius_m - f.low_radius_m);
  return std::numeric_limits<double>::infinity();
}

double Cutter::side_area_per_rad(double from_m, double to_m) const {
  double area = 0;
  if (nose_) {
    // Of a ring of the corner: a band of the sphere and the same band about the flat part.
    const double r = nose_->corner_m;
    const double low = std::clamp(from_m, 0.0, nose_->high_m);
    const double high = std::clamp(to_m, 0.0, nose_->high_m);
    const auto angle = [&](double h) { return std::acos(std::clamp(1 - h / r, -1.0, 1.0)); };
    area += r * (high - low) + nose_->disc_m * r * (angle(high) - angle(low));
  }
  for (const Frustum& f : frusta_) {
    const double low = std::clamp(from_m, f.low_m, f.high_m);
    const double high = std::clamp(to_m, f.low_m, f.high_m);
    const double widening = (f.high_radius_m - f.low_radius_m) / (f.high_m - f.low_m);
    const double middle = f.low_radius_m + widening * ((low + high) / 2 - f.low_m);
    area += middle * (high - low) * std::sqrt(1 + widening * widening);
  }
  return area;
}

}  // namespace servosense::process
