#include "servosense/process/engagement/program_engagement.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "step_length.hpp"

namespace servosense::process {
namespace {

constexpr std::size_t kBatch = 1024;
/// Two work offsets, or two places, are one within this [m].
constexpr double kSameOffset = 1e-9;

Error at_line(const CanonicalMove& move, const std::string& what) {
  return data_error("line " + std::to_string(move.line) + ": " + what);
}

/// Of removed parts of lines along z: heights, and how far to the left and right of the feed.
struct Extent {
  float low = 1e30F, high = -1e30F;
  double left = -1e30, right = 1e30;
  [[nodiscard]] bool holds(float from, float to, double aside) const {
    return from >= low && to <= high && aside <= left && aside >= right;
  }
  void add(float from, float to, double aside) {
    low = std::min(low, from), high = std::max(high, to);
    left = std::max(left, aside), right = std::min(right, aside);
  }
};

Point raised(Point tip) {
  tip[2] += kContactDepth;
  return tip;
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
    auto& core = cores_[turning_.cutter];
    if (!core)
      if (auto thinner = turning_.cutter->thinner(kContactDepth))
        core = std::make_unique<Cutter>(std::move(*thinner));
  }
  AxisPoint from{};
  for (std::size_t i = 0; i < 3; ++i) from[i] = machine_[i] + move.end[i] - move.machine[i];
  const PathCurve curve = PathCurve::programmed(move, from);
  if (move.kind != Kind::tap) machine_ = move.machine;
  if (!placed_) {
    placed_ = from[2] != move.end[2];
    return Done{};
  }
  if (curve.length() > 0) {
    double step = std::max(step_share_ * turning_.cutter->radius_m(), 1e-6);
    if (curve.is_arc()) step = std::min(step, curve.chord_m(kChordTolerance));
    const double count = std::clamp(std::ceil(curve.length() / step - 1e-9), 1.0, 1e7);
    add(move, number, curve, static_cast<std::size_t>(count));
  }
  last_ = {move.end[0], move.end[1], move.end[2]};
  return Done{};
}

void ProgramEngagement::add(const CanonicalMove& move, std::size_t number, const PathCurve& curve,
                            std::size_t count) {
  const auto at = [&](double share) {
    const AxisPoint point = curve.at(share * curve.length());
    return Point{point[0], point[1], point[2]};
  };
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
  step.cutter = turning_.cutter, step.core = cores_[turning_.cutter].get();
  step.holder = turning_.holder, step.shank = turning_.shank;
  step.engagement.move = number;
  step.engagement.line = move.line;
  step.engagement.tool = tool_;
  step.engagement.rapid = move.kind == CanonicalMove::Kind::rapid;
  const auto put_step = [&](double from_share, double to_share, bool air) {
    step.engagement.from_share = from_share, step.engagement.to_share = to_share;
    step.engagement.path_m = curve.length() * (to_share - from_share);
    step.air = air;
    filling_.push_back(step);
    if (filling_.size() >= kBatch) flush();
  };
  if (!curve.is_arc() && misses(at(0), at(1))) {
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
      step.follows = i > 0 || (last_ && length_of(*last_, from) < kSameOffset);
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
  clear_held();
}

double ProgramEngagement::removed_error_m3() const {
  double worst = 0;
  for (const double quarter : quarters_) worst = std::max(worst, std::abs(4 * quarter - removed_));
  return worst;
}

/// Where a step can clear what the cutter has not cleared at its start: ahead, unless it goes down.
SweepFront ProgramEngagement::front_of(const Step& step, const Sweep& sweep) const {
  SweepFront front{step.from[0], step.from[1], step.ahead, 0};
  if (!step.follows || step.level == 0) return {};
  if (sweep.level()) return front;
  // Above the cutter there may be something that it goes up into.
  const double top =
      workpiece_.origin()[2] + static_cast<double>(workpiece_.cells()[2]) * workpiece_.cell_m()[2];
  if (step.rise > 0) return step.from[2] + step.cutter->top_m() >= top ? front : SweepFront{};
  if (!sweep.is_ball()) return {};
  // The lower side of a ball sinks where its slope along the path is above that of the path.
  front.least_m = step.rise / step.level * step.cutter->radius_m();
  return front;
}

void ProgramEngagement::cut_columns(std::vector<Step>& steps) {
  Dexels& lines = workpiece_.lines(2);
  const Point& origin = workpiece_.origin();
  const double area = workpiece_.plan_area_m2();
  for (Step& step : steps) {
    if (step.air) continue;
    const Sweep sweep(*step.cutter, step.from, step.to);
    const SweepFront front = front_of(step, sweep);
    const double always = std::min(step.from[2], step.to[2]) + step.cutter->top_m() - origin[2];
    const double bottom = step.cutter->bottom_radius_m();
    std::optional<Sweep> core;
    if (step.core != nullptr) core.emplace(*step.core, raised(step.from), raised(step.to));
    const bool faces_down = step.rise < 0 && bottom > 0;
    const auto middle_z = static_cast<float>(step.middle[2] - origin[2]);
    float top = -1e30F;
    double bottom_area = 0;
    Extent whole, in_core;
    std::array<double, 4> lengths{};  // by the fourth of the lines that one belongs to
    workpiece_.each_column(
        sweep,
        [&](std::size_t line, std::size_t i, std::size_t j, double x, double y) {
          const float highest = lines.top(line, -1e30F);
          if (highest == -1e30F) return;
          if (sweep.above(x, y) - origin[2] >= static_cast<double>(highest)) return;
          const double begins = sweep.low_z(x, y);
          if (begins == Sweep::kNowhere) return;
          top = std::max(top, highest);
          const auto cut_low = static_cast<float>(begins - origin[2]);
          if (cut_low >= highest) return;
          const float cut_high = static_cast<double>(highest) <= always
                                     ? highest
                                     : static_cast<float>(sweep.along_z(x, y).high - origin[2]);
          if (faces_down && std::hypot(x - step.middle[0], y - step.middle[1]) <= bottom &&
              lines.holds(line, middle_z, 0.0F))
            bottom_area += area;
          lines.subtract(line, cut_low, cut_high, [&](float from, float to) {
            const double part = static_cast<double>(to) - static_cast<double>(from);
            lengths[(i & 1U) + 2 * (j & 1U)] += part;
            const double aside =
                (y - step.from[1]) * step.ahead[0] - (x - step.from[0]) * step.ahead[1];
            whole.add(from, to, aside);
            if (in_core.holds(from, to, aside)) return;
            if (!core || static_cast<double>(to) > core->low_z(x, y) - origin[2])
              in_core.add(from, to, aside);
          });
        },
        front);
    for (std::size_t k = 0; k < lengths.size(); ++k) {
      step.engagement.removed_m3 += lengths[k] * area;
      quarters_[k] += lengths[k] * area;
    }
    step.engagement.bottom_m2 = bottom_area;
    removed_ += step.engagement.removed_m3;
    if (step.holder != nullptr)
      step.engagement.holder_m3 = workpiece_.volume_in(Sweep(*step.holder, step.from, step.to));
    if (step.shank != nullptr)
      step.engagement.shank_m3 = workpiece_.volume_in(Sweep(*step.shank, step.from, step.to));
    step.in_core = in_core.low < in_core.high;
    const Extent& seen = step.in_core ? in_core : whole;
    step.low_z = origin[2] + static_cast<double>(seen.low);
    step.high_z = origin[2] + static_cast<double>(seen.high);
    step.top_z = origin[2] + static_cast<double>(top);
    step.left = seen.left, step.right = seen.right;
    if (step.in_core) step.engagement.axial_depth_m = step.high_z - step.low_z;
  }
}

}  // namespace servosense::process
