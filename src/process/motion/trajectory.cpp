#include "servosense/process/motion/trajectory.hpp"

#include <algorithm>
#include <cmath>

#include "corner.hpp"

namespace servosense::process {
namespace {

using Kind = CanonicalMove::Kind;
/// Moves that become one line at most (LinuxCNC, linkable()).
constexpr std::size_t kMostInLine = 100;

/// Whether the machine stands before the move is done. M62, M63 and M67 come with the motion.
bool stands_for(const CanonicalMove& move) {
  return !(move.kind == Kind::output &&
           (move.number == 62 || move.number == 63 || move.number == 67));
}

double distance(const AxisPoint& a, const AxisPoint& b) {
  return std::hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]);
}

/// How far `p` is from the straight line between `from` and `to`.
double off_line(const AxisPoint& p, const AxisPoint& from, const AxisPoint& to) {
  double dot = 0, square = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    dot += (p[i] - from[i]) * (to[i] - from[i]);
    square += (to[i] - from[i]) * (to[i] - from[i]);
  }
  const double share = square > 0 ? std::clamp(dot / square, 0.0, 1.0) : 0;
  AxisPoint foot = from;
  for (std::size_t i = 0; i < 3; ++i) foot[i] += share * (to[i] - from[i]);
  return distance(p, foot);
}

bool same_others(const AxisPoint& a, const AxisPoint& b) {
  return std::equal(a.begin() + 3, a.end(), b.begin() + 3);
}

}  // namespace

bool TrajectoryPlanner::in_line(const CanonicalMove& move) const {
  const CanonicalMove& last = line_.back().move;
  if (move.path_control != PathControl::blend || !(move.merge_m > 0) ||
      last.merge_m != move.merge_m || last.blend_m != move.blend_m ||
      last.path_control != move.path_control || last.feed_m_s != move.feed_m_s ||
      last.feed_m_rev != move.feed_m_rev || line_.size() > kMostInLine ||
      !same_others(last.machine, move.machine))
    return false;
  return std::all_of(line_.begin(), line_.end(), [&](const LinePoint& point) {
    return off_line(point.move.machine, line_from_, move.machine) <= move.merge_m;
  });
}

void TrajectoryPlanner::put(const CanonicalMove& move) {
  if (is_motion(move.kind) && move.kind != Kind::tap) {
    put_path(move);
    return;
  }
  if (!stands_for(move)) {
    close_line();
    if (ahead_.empty())
      sink_(move, now_s_);
    else
      ahead_.back().marks.push_back({1, move});
    return;
  }
  finish();
  spindle_.put(move, now_s_);
  if (move.kind == Kind::dwell) now_s_ += move.seconds;
  if (move.kind == Kind::tool) now_s_ += limits_.tool_change_s;
  if (move.kind == Kind::tap) now_s_ = std::max(now_s_, spindle_.ready_s());
  if (move.kind == Kind::tap && move.feed_m_s > 0)
    now_s_ += 2 * distance(machine_, move.machine) / move.feed_m_s;
  sink_(move, now_s_);
}

void TrajectoryPlanner::put_path(const CanonicalMove& move) {
  if (move.kind == Kind::feed) {
    put_line(move, move.kind, true);
    return;
  }
  if (move.kind == Kind::arc && move.plane == Plane::xy && std::abs(move.turns) == 1 &&
      move.path_control == PathControl::blend && move.merge_m > 0) {
    const PathCurve arc = PathCurve::arc(move, machine_);
    if (arc.is_arc() && arc.radius_m() * (1 - std::cos(arc.angle_rad() / 2)) < move.merge_m) {
      CanonicalMove half = move;
      half.kind = Kind::feed;
      half.machine = arc.at(arc.length() / 2);
      put_line(half, move.kind, false);
      half.machine = move.machine;
      put_line(half, move.kind, true);
      return;
    }
  }
  close_line();
  PathSegment segment = path_segment(move, machine_, limits_);
  segment.marks.push_back({1, move});
  machine_ = move.machine;
  append(std::move(segment));
}

void TrajectoryPlanner::put_line(const CanonicalMove& move, Kind asked, bool ends_move) {
  if (!line_.empty() && !in_line(move)) close_line();
  if (line_.empty()) line_from_ = machine_;
  const bool others = !same_others(machine_, move.machine);
  line_.push_back({move, asked, ends_move});
  machine_ = move.machine;
  if (others || !(move.merge_m > 0)) close_line();
}

void TrajectoryPlanner::close_line() {
  if (line_.empty()) return;
  PathSegment segment = path_segment(line_.back().move, line_from_, limits_);
  const auto way = [&](const auto& at_point) {
    double gone = 0;
    const AxisPoint* from = &line_from_;
    for (auto& point : line_) {
      gone += distance(*from, point.move.machine);
      from = &point.move.machine;
      at_point(point, gone);
    }
    return gone;
  };
  const double whole = way([](const LinePoint&, double) {});
  way([&](LinePoint& point, double gone) {
    if (!point.ends_move) return;
    point.move.kind = point.asked;
    segment.marks.push_back(
        {&point == &line_.back() || !(whole > 0) ? 1 : gone / whole, point.move});
  });
  line_.clear();
  append(std::move(segment));
}

void TrajectoryPlanner::append(PathSegment segment) {
  if (!(segment.curve.length() > 0) || !(segment.feed_m_s > 0)) {  // goes nowhere
    for (auto& mark : segment.marks)
      if (ahead_.empty())
        sink_(mark.move, now_s_);
      else
        ahead_.back().marks.push_back({1, mark.move});
    return;
  }
  if (!ahead_.empty()) {
    Corner corner = join(ahead_.back(), segment, limits_);
    if (corner.rounding) {
      PathSegment& before = ahead_.back();
      if (corner.swallows_before) {
        corner.rounding->marks = std::move(before.marks);
        const double share = corner.rounding->curve.run_up_m() / corner.rounding->curve.length();
        for (auto& mark : corner.rounding->marks) mark.share *= share;
        ahead_.pop_back();
      } else {
        settle_speed(before, limits_);
      }
      settle_speed(*corner.rounding, limits_);
      ahead_.push_back(std::move(*corner.rounding));
    } else {
      settle_speed(ahead_.back(), limits_);
    }
  }
  if (!segment.rapid) segment.earliest_s = spindle_.ready_s();
  ahead_.push_back(std::move(segment));
  while (ahead_.size() > limits_.look_ahead + 2) run_first(false);
}

double TrajectoryPlanner::leaving_speed() const {
  if (ahead_.size() < 2 || ahead_[0].joint != Joint::tangent) return 0;
  double speed = 0;
  for (std::size_t k = std::min(ahead_.size() - 1, limits_.look_ahead); k > 0; --k) {
    const PathSegment &before = ahead_[k - 1], &segment = ahead_[k];
    if (before.joint != Joint::tangent) {
      speed = 0;
      continue;
    }
    speed = std::min({reachable_speed(speed, segment.curve.length(),
                                      {segment.path_acceleration(), segment.jerk_m_s3}),
                      before.top_m_s, segment.top_m_s, before.kink_m_s});
  }
  return std::min({speed, ahead_[0].target_m_s(), ahead_[1].target_m_s()});
}

void TrajectoryPlanner::run_first(bool last) {
  const double leaving = leaving_speed();
  PathSegment segment = std::move(ahead_.front());
  ahead_.pop_front();
  const double length = segment.curve.length();
  const RampLimits ramp{segment.path_acceleration(), segment.jerk_m_s3};
  const auto profile =
      VelocityProfile::plan(length, speed_m_s_, segment.target_m_s(), leaving, ramp);
  // It sets out early, but is not done before the last.
  const double start =
      std::max(now_s_ - std::min(overlap_s_, profile.duration_s()), segment.earliest_s);
  now_s_ = start + profile.duration_s();
  speed_m_s_ = leaving > 0 ? profile.end_m_s() : 0;
  overlap_s_ = 0;
  for (const auto& mark : segment.marks) {
    // A move within an overlap is done no sooner than the one before.
    given_s_ = std::max(given_s_, start + profile.time_at(mark.share * length));
    sink_(mark.move, given_s_);
  }
  if (segment.joint == Joint::parabola && !last) {
    const PathSegment& next = ahead_.front();
    const double leaving_at =
        overlap_speeds(segment, next, segment.target_m_s(), next.target_m_s(), false).leaving;
    overlap_s_ = std::min(leaving_at, profile.braking_from_m_s()) / ramp.acceleration_m_s2;
  } else if (leaving == 0) {
    now_s_ += limits_.cycle_s / 2;  // it goes on with a servo period: half of one on average
  }
  if (motions_)
    motions_({std::move(segment.curve), profile, start,
              segment.marks.empty() ? 0 : segment.marks.back().move.line, segment.rapid,
              segment.rounding});
}

void TrajectoryPlanner::finish() {
  close_line();
  if (ahead_.empty()) return;
  // Where nothing follows, LinuxCNC keeps half of the acceleration back for a corner that never
  // comes, and does not settle the speed of an arc anew.
  if (ahead_.back().joint != Joint::parabola) ahead_.back().joint = Joint::stop;
  while (!ahead_.empty()) run_first(ahead_.size() == 1);
}

void Trajectory::add(TimedMotion&& motion) {
  end_s_ = std::max(end_s_, motion.end_s());
  motions_.push_back(std::move(motion));
}

std::size_t Trajectory::first_at(double t_s) const {
  const auto found =
      std::partition_point(motions_.begin(), motions_.end(),
                           [&](const TimedMotion& motion) { return motion.end_s() < t_s; });
  return static_cast<std::size_t>(found - motions_.begin());
}

AxisPoint Trajectory::position(double t_s) const {
  if (motions_.empty()) return {};
  std::size_t i = first_at(t_s);
  AxisPoint at = i < motions_.size() ? motions_[i].curve.from() : motions_.back().curve.to();
  for (; i < motions_.size() && motions_[i].start_s < t_s; ++i) {
    const TimedMotion& motion = motions_[i];
    const AxisPoint there = motion.curve.at(motion.profile.distance(t_s - motion.start_s));
    for (std::size_t k = 0; k < at.size(); ++k) at[k] += there[k] - motion.curve.from()[k];
  }
  return at;
}

Eigen::Vector3d Trajectory::velocity(double t_s) const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (std::size_t i = first_at(t_s); i < motions_.size() && motions_[i].start_s < t_s; ++i) {
    const TimedMotion& motion = motions_[i];
    const double t = t_s - motion.start_s;
    sum += motion.profile.velocity(t) * motion.curve.tangent(motion.profile.distance(t));
  }
  return sum;
}

}  // namespace servosense::process
