#include "servosense/process/engagement/program_engagement.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace servosense::process {
namespace {

constexpr std::size_t kBatch = 1024;
/// Two work offsets are one within this [m].
constexpr double kSameOffset = 1e-9;
/// Removed lengths below this do not count for depth and width [m]: floats.
constexpr double kShaving = 1e-6;

Error at_line(const CanonicalMove& move, const std::string& what) {
  return data_error("line " + std::to_string(move.line) + ": " + what);
}

/// Least and greatest sine on an arc.
std::array<double, 2> sines(const Arc& arc) {
  constexpr double to_rad = std::numbers::pi / 180;
  const double a = std::sin(arc.from_deg * to_rad), b = std::sin(arc.to_deg * to_rad);
  double low = std::min(a, b), high = std::max(a, b);
  if (arc.from_deg <= 90 && arc.to_deg >= 90) high = 1;
  if (arc.from_deg <= 270 && arc.to_deg >= 270) low = -1;
  return {low, high};
}

/// What an arc of a circle covers across the feed, to the left positive; as an Arc, in metres.
Arc lateral(const Arc& arc, double radius) {
  constexpr double to_rad = std::numbers::pi / 180;
  const double a = std::cos(arc.from_deg * to_rad), b = std::cos(arc.to_deg * to_rad);
  double low = std::min(a, b), high = std::max(a, b);
  if (arc.from_deg <= 0 && arc.to_deg >= 0) high = 1;
  if (arc.from_deg <= 180 && arc.to_deg >= 180) low = -1;
  return {radius * low, radius * high};
}

}  // namespace

ProgramEngagement::ProgramEngagement(Workpiece& workpiece, Cutters cutters, Sink sink,
                                     double step_share)
    : workpiece_(workpiece),
      cutters_(std::move(cutters)),
      sink_(std::move(sink)),
      step_share_(step_share),
      circle_(workpiece) {}

Expected<Done> ProgramEngagement::put(const CanonicalMove& move) {
  using Kind = CanonicalMove::Kind;
  const std::size_t number = move_++;
  if (move.kind == Kind::tool) {
    if (move.tool != tool_) turning_ = {};
    tool_ = move.tool;
    last_.reset();
  }
  if (!is_motion(move.kind)) return Done{};
  for (std::size_t i = 3; i < 9; ++i)
    if (std::abs(move.machine[i] - machine_[i]) > kSameOffset)
      return at_line(move, std::string("axis ") + "abcuvw"[i - 3] +
                               " moves; the workpiece is cut by x, y and z alone, so leave it out");
  const std::array<double, 2> offset = {move.end[0] - move.machine[0],
                                        move.end[1] - move.machine[1]};
  if (!offset_) offset_ = offset;
  for (std::size_t i = 0; i < 2; ++i)
    if (std::abs(offset[i] - (*offset_)[i]) > kSameOffset)
      return at_line(move,
                     "the work offset changes, but the stock stands in that of the first move; "
                     "give each offset a program of its own");
  if (turning_.cutter == nullptr) {
    const auto found = cutters_(tool_);
    if (!found) return at_line(move, found.error().sentence);
    turning_ = *found;
  }
  Point from{}, to{};
  for (std::size_t i = 0; i < 3; ++i) {
    from[i] = machine_[i] + move.end[i] - move.machine[i];
    to[i] = move.end[i];
  }
  if (move.kind != Kind::tap) machine_ = move.machine;
  if (!placed_) {
    placed_ = from[2] != to[2];
    return Done{};
  }
  const double step = std::max(step_share_ * turning_.cutter->radius_m(), 1e-6);
  const auto pieces = [](double length, double at_most) {
    return static_cast<std::size_t>(std::clamp(std::ceil(length / at_most - 1e-9), 1.0, 1e7));
  };
  CanonicalMove numbered = move;
  numbered.number = static_cast<int>(number);
  if (move.kind == Kind::arc) {
    const auto axes = plane_axes(move.plane);
    const double turn = arc_angle_rad(move, move.begin);
    const double u = move.begin[axes[0]] - move.centre_m[0],
                 v = move.begin[axes[1]] - move.centre_m[1];
    const double radius = std::hypot(u, v), start = std::atan2(v, u);
    const double end_radius =
        std::hypot(move.end[axes[0]] - move.centre_m[0], move.end[axes[1]] - move.centre_m[1]);
    const double length = path_length(move, move.begin);
    const double chord = 2 * std::sqrt(2 * std::max(radius, end_radius) * kChordTolerance);
    const auto at = [&](double share) {
      Point p{};
      const double r = radius + (end_radius - radius) * share, angle = start + turn * share;
      p[axes[0]] = move.centre_m[0] + r * std::cos(angle);
      p[axes[1]] = move.centre_m[1] + r * std::sin(angle);
      p[axes[2]] = move.begin[axes[2]] + (move.end[axes[2]] - move.begin[axes[2]]) * share;
      return p;
    };
    add(numbered, at, pieces(length, std::min(step, chord)), length);
  } else {
    const double length = std::hypot(to[0] - from[0], to[1] - from[1], to[2] - from[2]);
    const auto at = [&](double share) {
      Point p{};
      for (std::size_t i = 0; i < 3; ++i) p[i] = from[i] + (to[i] - from[i]) * share;
      return p;
    };
    if (length > 0) add(numbered, at, pieces(length, step), length);
  }
  last_ = to;
  return Done{};
}

void ProgramEngagement::add(const CanonicalMove& move, const std::function<Point(double)>& at,
                            std::size_t count, double length_m) {
  const Point& low = workpiece_.origin();
  const auto misses_with = [&](const Sweep& sweep) {
    for (std::size_t i = 0; i < 3; ++i) {
      const Interval in = sweep.bounds(i);
      const double high =
          low[i] + static_cast<double>(workpiece_.cells()[i]) * workpiece_.cell_m()[i];
      if (in.high <= low[i] || in.low >= high) return true;
    }
    return false;
  };
  const auto misses = [&](const Point& from, const Point& to) {
    return misses_with(Sweep(*turning_.cutter, from, to)) &&
           (turning_.holder == nullptr || misses_with(Sweep(*turning_.holder, from, to))) &&
           (turning_.shank == nullptr || misses_with(Sweep(*turning_.shank, from, to)));
  };
  Step step;
  step.cutter = turning_.cutter, step.holder = turning_.holder, step.shank = turning_.shank;
  step.engagement.move = static_cast<std::size_t>(move.number);
  step.engagement.line = move.line;
  step.engagement.tool = tool_;
  step.engagement.rapid = move.kind == CanonicalMove::Kind::rapid;
  const auto put_step = [&](double from_share, double to_share, bool air) {
    step.engagement.from_share = from_share, step.engagement.to_share = to_share;
    step.engagement.path_m = length_m * (to_share - from_share);
    step.air = air;
    filling_.push_back(step);
    if (filling_.size() >= kBatch) flush();
  };
  if (move.kind != CanonicalMove::Kind::arc && misses(at(0), at(1))) {
    put_step(0, 1, true);
    return;
  }
  Point from = at(0);
  double air_from = 0;  // steps in air are one
  const auto share = [&](std::size_t i) {
    return static_cast<double>(i) / static_cast<double>(count);
  };
  for (std::size_t i = 0; i < count; ++i) {
    const Point to = at(share(i + 1));
    const bool air = misses(from, to);
    if (!air) {
      if (air_from < share(i)) put_step(air_from, share(i), true);
      air_from = share(i + 1);
      step.from = from, step.to = to, step.middle = at((share(i) + share(i + 1)) / 2);
      const double dx = to[0] - from[0], dy = to[1] - from[1], dz = to[2] - from[2];
      const double level = std::hypot(dx, dy), whole = std::hypot(level, dz);
      if (!(whole > 0)) continue;
      step.level = level / whole, step.rise = dz / whole;
      step.engagement.place = step.middle, step.engagement.rise = step.rise;
      step.ahead = {dx / level, dy / level};
      if (!(level > 1e-9 * whole)) step.level = 0, step.ahead = {1, 0};
      step.engagement.ahead = step.ahead;
      step.follows = i > 0 || (last_ && *last_ == from);
      put_step(share(i), share(i + 1), false);
    }
    from = to;
  }
  if (air_from < 1) put_step(air_from, 1, true);
}

void ProgramEngagement::flush() {
  auto columns = std::async(std::launch::async, [this] { cut_columns(filling_); });
  cut_level(ahead_of_);
  columns.get();
  for (const Step& step : ahead_of_) sink_(step.engagement);
  ahead_of_.clear();
  std::swap(ahead_of_, filling_);
}

void ProgramEngagement::finish() {
  flush();
  flush();
}

double ProgramEngagement::removed_error_m3() const {
  double worst = 0;
  for (const double quarter : quarters_) worst = std::max(worst, std::abs(4 * quarter - removed_));
  return worst;
}

void ProgramEngagement::cut_columns(std::vector<Step>& steps) {
  Dexels& lines = workpiece_.lines(2);
  const Point& origin = workpiece_.origin();
  const double area = workpiece_.plan_area_m2();
  for (Step& step : steps) {
    if (step.air) continue;
    const Sweep sweep(*step.cutter, step.from, step.to);
    // A level step clears nothing behind where the cutter has been.
    const bool front_only = sweep.level() && step.follows;
    const double bottom = step.cutter->bottom_radius_m();
    const bool faces_down = step.rise < 0 && bottom > 0;
    const auto middle_z = static_cast<float>(step.middle[2] - origin[2]);
    float top = -1e30F, low = 1e30F, high = -1e30F;
    double length = 0, bottom_area = 0, left = -1e30, right = 1e30;
    workpiece_.each_column(
        sweep, [&](std::size_t line, std::size_t i, std::size_t j, double x, double y) {
          const double dx = x - step.from[0], dy = y - step.from[1];
          if (front_only && dx * step.ahead[0] + dy * step.ahead[1] <= 0) return;
          const float highest = lines.top(line, -1e30F);
          if (highest == -1e30F) return;
          if (sweep.above(x, y) - origin[2] >= static_cast<double>(highest)) return;
          const Interval in = sweep.along_z(x, y);
          if (in.empty()) return;
          top = std::max(top, highest);
          const auto cut_low = static_cast<float>(in.low - origin[2]);
          if (cut_low >= highest) return;
          if (faces_down && std::hypot(x - step.middle[0], y - step.middle[1]) <= bottom &&
              lines.holds(line, middle_z, 0.0F))
            bottom_area += area;
          lines.subtract(line, cut_low, static_cast<float>(in.high - origin[2]),
                         [&](float from, float to) {
                           const double part = static_cast<double>(to) - static_cast<double>(from);
                           length += part;
                           quarters_[(i & 1U) + 2 * (j & 1U)] += part * area;
                           if (part < kShaving) return;
                           low = std::min(low, from), high = std::max(high, to);
                           const double aside = dy * step.ahead[0] - dx * step.ahead[1];
                           left = std::max(left, aside), right = std::min(right, aside);
                         });
        });
    step.engagement.removed_m3 = length * area;
    step.engagement.bottom_m2 = bottom_area;
    removed_ += length * area;
    if (step.holder != nullptr)
      step.engagement.holder_m3 = workpiece_.volume_in(Sweep(*step.holder, step.from, step.to));
    if (step.shank != nullptr)
      step.engagement.shank_m3 = workpiece_.volume_in(Sweep(*step.shank, step.from, step.to));
    step.low_z = origin[2] + static_cast<double>(low);
    step.high_z = origin[2] + static_cast<double>(high);
    step.top_z = origin[2] + static_cast<double>(top);
    step.left = left, step.right = right;
    if (low < high) step.engagement.axial_depth_m = step.high_z - step.low_z;
  }
}

void ProgramEngagement::cut_level(std::vector<Step>& steps) {
  for (Step& step : steps) {
    if (step.air) continue;
    if (step.low_z < step.high_z) look_at(step);
    // A layer of margin: the lines along z do not stand everywhere.
    const Sweep sweep(*step.cutter, step.from, step.to);
    workpiece_.remove_level(sweep, step.top_z + workpiece_.cell_m()[2]);
  }
}

void ProgramEngagement::look_at(Step& step) {
  Engagement& e = step.engagement;
  const Cutter& cutter = *step.cutter;
  const double tip = step.middle[2], layer = workpiece_.cell_m()[2];
  const double low = std::max(step.low_z, tip + cutter.bottom_m()), high = step.high_z;
  double least = 2, greatest = -1;
  if (e.bottom_m2 > 0) least = greatest = -step.rise;
  std::vector<Arc> found, across;
  if (high > low) {
    const auto layers = workpiece_.lattice_range(2, {low, high});
    const std::size_t count = layers[1] - layers[0];
    const std::size_t slabs = std::clamp(count, std::size_t{1}, kMostSlabs);
    e.thin = count == 0;
    double set_radius = -1, set_sine = 0;
    for (std::size_t s = 0; s < slabs; ++s) {
      const auto edge = [&](std::size_t at) {
        return low + (high - low) * static_cast<double>(at) / static_cast<double>(slabs);
      };
      double z = (edge(s) + edge(s + 1)) / 2;
      std::size_t k = 0;
      if (!e.thin) {
        const double place = std::round((z - workpiece_.origin()[2]) / layer - 0.5);
        k = static_cast<std::size_t>(
            std::clamp(place, static_cast<double>(layers[0]), static_cast<double>(layers[1]) - 1));
        z = workpiece_.lattice(2, k);
      }
      const double radius = cutter.radius_at(z - tip);
      if (!(radius > 0)) continue;
      // Faces the path: level sin(angle) - rise widening > 0.
      const double widening = cutter.widening_at(z - tip);
      double sine = 0;
      if (step.level > 0)
        sine = widening > 0 ? step.rise * widening / step.level : 0;
      else
        sine = step.rise < 0 && widening > 0 ? -2 : 2;
      if (sine >= 1) continue;
      std::vector<Arc> arcs;
      if (e.thin) {
        const auto angle = [&](double aside) {
          return std::acos(std::clamp(aside / radius, -1.0, 1.0)) * 180 / std::numbers::pi;
        };
        arcs = step.level > 0 ? std::vector<Arc>{{angle(step.left), angle(step.right)}}
                              : std::vector<Arc>{{0, 360}};
      } else {
        if (radius != set_radius || sine != set_sine)
          circle_.set_circle(step.middle[0], step.middle[1], radius, step.ahead, sine);
        set_radius = radius, set_sine = sine;
        circle_.find(k, arcs);
      }
      const double area = cutter.side_area_per_rad(edge(s) - tip, edge(s + 1) - tip);
      const double across_m = 1 / std::sqrt(1 + widening * widening);
      for (const Arc& arc : arcs) {
        e.side_m2 += area * (arc.to_deg - arc.from_deg) * std::numbers::pi / 180;
        found.push_back(arc);
        e.side.push_back({arc, edge(s) - tip, edge(s + 1) - tip, radius, widening});
        across.push_back(lateral(arc, radius));
        for (const double sin_angle : sines(arc)) {
          const double chip = (step.level * sin_angle - step.rise * widening) * across_m;
          least = std::min(least, std::max(0.0, chip)), greatest = std::max(greatest, chip);
        }
      }
    }
  }
  unite(found, 0.25);
  unite(across, layer);
  e.arcs = std::move(found);
  for (const Arc& part : across) e.radial_immersion_m += part.to_deg - part.from_deg;
  if (greatest >= 0) e.least_chip = least, e.greatest_chip = greatest;
}

}  // namespace servosense::process
