// Cutter radius compensation: G40, G41, G42, G41.1, G42.1.
//
// The tool's centre keeps its radius from the programmed contour. Around a convex corner it goes on
// an arc about the corner; into a concave one the move before is cut short where both offset paths
// meet. So the end of a move is open until the next one is known, and moves wait (open_) until
// then. Where the tool would gouge the program is refused, as LinuxCNC does.
#include <algorithm>
#include <cmath>

#include "machine.hpp"
#include "servosense/core/units.hpp"

namespace servosense::process {
namespace {

using Spot = std::array<double, 2>;

Spot spot_of(const AxisPoint& point, Plane plane) {
  const auto axes = plane_axes(plane);
  return {point[axes[0]], point[axes[1]]};
}
void put_spot(AxisPoint& point, Plane plane, const Spot& spot) {
  const auto axes = plane_axes(plane);
  point[axes[0]] = spot[0];
  point[axes[1]] = spot[1];
}
Spot beside(const Spot& from, double distance, double angle) {
  return {from[0] + distance * std::cos(angle), from[1] + distance * std::sin(angle)};
}
double direction(const Spot& from, const Spot& to) {
  return std::atan2(to[1] - from[1], to[0] - from[0]);
}
double apart(const Spot& a, const Spot& b) { return std::hypot(a[0] - b[0], a[1] - b[1]); }

const char* const kCorner =
    "the tool does not fit into this corner of the contour; take a smaller one, or round the "
    "corner";

}  // namespace

void Machine::flush() {
  std::vector<OpenMove> open;
  open.swap(open_);
  for (const OpenMove& o : open) give(o.move);
  start_known_ = false;
}

void Machine::begin_at(const Spot& spot) {
  flush();
  start_ = spot;
  start_known_ = true;
}

Refusal Machine::end_open_moves(const Spot& spot) {
  const double mm = modes_.unit_mm;
  for (OpenMove& o : open_) {
    if (!is_motion(o.move.kind)) continue;
    if (o.move.kind == CanonicalMove::Kind::arc) {
      const Spot centre = {o.move.centre_m[0] * 1000, o.move.centre_m[1] * 1000};
      const Spot end = spot_of(o.end, o.move.plane);
      if (std::abs(apart(end, centre) - apart(spot, centre)) > kArcMismatch * mm)
        return refuse(kCorner);
      const double swept = swept_rad(start_, spot, centre, o.move.turns);
      if (o.swept_rad != 0 && start_known_ &&
          std::abs(swept) >
              std::abs(o.swept_rad) + (mm == 1 ? kArcGrowthMetric_rad : kArcGrowthInch_rad))
        return refuse(kCorner);
    } else if (start_known_ &&
               o.toward[0] * (spot[0] - start_[0]) + o.toward[1] * (spot[1] - start_[1]) < 0) {
      return refuse(kCorner);
    }
    put_spot(o.end, modes_.plane, spot);
    o.move.end = in_metres(o.end);
    o.move.machine = in_metres(offsets_.to_machine(o.end));
  }
  begin_at(spot);
  return std::nullopt;
}

void Machine::open_move(CanonicalMove move, const AxisPoint& end, const Spot& toward,
                        double swept) {
  const std::size_t before = open_.size();
  // put() appends to moves that wait; the first begins to.
  if (before == 0) waits_ = true;
  put(move);
  waits_ = false;
  if (open_.size() == before) return;  // too many moves
  open_.back().end = end;
  open_.back().toward = toward;
  open_.back().swept_rad = swept;
}

// ---- on and off
// ----------------------------------------------------------------------------------

Refusal Machine::compensation(const Block& block, int code) {
  if (code == 400) return compensation_off();
  if (modes_.plane == Plane::yz)
    return refuse("cutter compensation works in the planes of G17 and G18; choose one before");
  if (compensating()) return refuse("cutter compensation is on already; end it with G40 before");
  Side side = code / 10 == 41 ? Side::left : Side::right;
  double radius = 0;
  int orientation = 0;
  if (code == 411 || code == 421) {
    if (!block.has('d')) return refuse(code_name(code) + " asks for D, the diameter of the tool");
    radius = *block.word('d') * modes_.unit_mm / 2;
    if (const auto l = block.word('l')) {
      if (modes_.plane != Plane::zx)
        return refuse("L is the orientation of a lathe tool, in the plane of G18 alone");
      orientation = static_cast<int>(std::lround(*l));
    }
  } else {
    Tool used = in_spindle_;
    if (const auto d = block.word('d')) {
      if (std::abs(*d - std::round(*d)) > kEqualNumbers || *d < -0.5)
        return refuse("D of " + code_name(code) + " is the number of a tool");
      const auto found = tool(std::lround(*d), "D");
      if (!found) return found.error();
      if (*found != nullptr)
        used = **found;
      else if (std::lround(*d) != 0)
        used = Tool{};
    }
    if (!tools_)
      return refuse(code_name(code) +
                    " needs the diameter of the tool, and there is no tool table; give one");
    radius = used.diameter_m * 1000 / 2;
    orientation = used.orientation;
    if (modes_.plane != Plane::zx && orientation != 0 && orientation != 9)
      return refuse("a lathe tool is compensated in the plane of G18; choose it before");
  }
  if (orientation != 0 && orientation != 9)
    return refuse(
        "compensation of lathe tools is not supported; have the path of the tool's centre "
        "put out");
  if (radius < 0) {
    radius = -radius;
    side = side == Side::left ? Side::right : Side::left;
  }
  radius_ = radius;
  side_ = side;
  return std::nullopt;
}

Refusal Machine::compensation_off() {
  if (compensated() && !entry_) {
    if (auto no = end_open_moves(spot_of(position_, modes_.plane))) return no;
    flush();
    // The program goes on from the contour; the tool leaves it with the next move.
    position_[kX] = programmed_[kX];
    position_[kY] = programmed_[kY];
    position_[kZ] = programmed_[kZ];
    after_exit_ = true;
  }
  side_ = Side::none;
  entry_ = true;
  return std::nullopt;
}

// ---- straight
// ------------------------------------------------------------------------------------

Refusal Machine::compensated_straight(const Block& block, int motion, const AxisPoint& end) {
  const auto kind = motion == 0 ? CanonicalMove::Kind::rapid : CanonicalMove::Kind::feed;
  const Plane plane = modes_.plane;
  const Spot to = spot_of(end, plane), centre = spot_of(position_, plane);
  const bool left = side_ == Side::left;
  AxisPoint from = position_;
  if (!entry_) put_spot(from, plane, spot_of(programmed_, plane));
  const double feed = motion == 0 ? 0 : feed_mm_s(block, straight_length(from, end)) / 1000;
  AxisPoint goal = end;
  const auto straight_to = [&](const Spot& spot, const Spot& toward) {
    put_spot(goal, plane, spot);
    CanonicalMove move = move_to(kind, goal);
    move.feed_m_s = feed;
    open_move(move, goal, toward, 0);
  };
  if (entry_) {
    if (apart(to, centre) <= radius_)
      return refuse(
          "the move into cutter compensation is shorter than the radius of the tool; "
          "begin farther away");
    const double across = direction(centre, to) + (left ? kPi / 2 : -kPi / 2);
    begin_at(centre);
    straight_to(beside(to, radius_, across), {std::cos(across), std::sin(across)});
    entry_ = false;
    programmed_ = end;
    position_ = goal;
    return overflow_;
  }
  const Spot corner = spot_of(programmed_, plane);
  if (to == corner) {
    straight_to(centre, {0, 0});
    programmed_ = end;
    position_ = goal;
    return overflow_;
  }
  double theta = direction(corner, centre), alpha = direction(corner, to);
  if (left && theta < alpha) theta += kTwoPi;
  if (!left && alpha < theta) alpha += kTwoPi;
  const double beta = (left ? theta - alpha : alpha - theta) - kPi / 2;
  const double gamma = left ? kPi / 2 : -kPi / 2;
  const Spot goal_spot = beside(to, radius_, alpha + gamma);
  const Spot middle = beside(corner, radius_, alpha + gamma);
  const bool arc_before = !open_.empty() && open_.front().move.kind == CanonicalMove::Kind::arc;
  const int turns = arc_before ? open_.front().move.turns : 0;
  const bool concave =
      beta < -kFlatCorner_rad || beta > kPi + kFlatCorner_rad ||
      (beta > kPi - kFlatCorner_rad && arc_before && (left ? turns < 0 : turns > 0));
  if (!concave && beta > kFlatCorner_rad) {
    if (auto no = end_open_moves(centre)) return no;
    AxisPoint at = end;
    put_spot(at, plane, middle);
    const std::size_t across = plane_axes(plane)[2];
    at[across] = position_[across];
    if (motion == 0) {
      put(move_to(kind, at));
    } else {
      CanonicalMove round = arc_move({corner, left ? -1 : 1}, at);
      round.feed_m_s = feed;
      put(round);
    }
    begin_at(middle);
  } else if (concave && !arc_before) {
    const double half = (beta + kPi) / 2;
    if (half == 0) return refuse("the contour turns back on itself; the tool cannot follow");
    if (auto no = end_open_moves(beside(centre, radius_ / std::tan(half), theta + gamma)))
      return no;
  } else if (concave) {
    const CanonicalMove& arc = open_.front().move;
    const Spot middle_of_arc = {arc.centre_m[0] * 1000, arc.centre_m[1] * 1000};
    const double now = apart(middle_of_arc, spot_of(open_.front().end, plane));
    const bool inside = left == (turns > 0);
    const double normal = direction(corner, to) + (turns > 0 ? kPi / 2 : -kPi / 2);
    // Distance of the arc's centre from the new line, then from the path of the tool.
    const double far =
        (now + (inside ? radius_ : -radius_)) * std::cos(normal - direction(corner, middle_of_arc));
    const double share = (far + (inside ? -radius_ : radius_)) / now;
    if (std::abs(share) > 1) return refuse(kCorner);
    const double turn = (inside == (turns > 0)) ? -std::acos(share) : std::acos(share);
    if (auto no = end_open_moves(beside(middle_of_arc, now, normal + kPi + turn))) return no;
  } else {
    begin_at(centre);
  }
  straight_to(goal_spot, {to[0] - corner[0], to[1] - corner[1]});
  programmed_ = end;
  position_ = goal;
  return overflow_;
}

// ---- arcs
// ----------------------------------------------------------------------------------------

Refusal Machine::compensated_arc(const Block& block, int motion, const AxisPoint& end) {
  const Plane plane = modes_.plane;
  const bool left = side_ == Side::left;
  const bool inside = left == (motion == 30);
  const Spot at = spot_of(position_, plane), to = spot_of(end, plane);
  AxisPoint from = position_;
  if (!entry_) put_spot(from, plane, spot_of(programmed_, plane));
  if (entry_ && apart(to, at) <= radius_)
    return refuse(
        "the arc into cutter compensation is shorter than the radius of the tool; begin "
        "farther away");
  const auto found = circle(block, motion, from, end);
  if (!found) return found.error();
  const Spot centre = found->centre;
  const double radius = entry_ ? apart(centre, spot_of(from, plane)) : apart(centre, to);
  const double asked = block.has('r') ? std::abs(*block.word('r')) * modes_.unit_mm : radius;
  if (inside && (entry_ ? asked : radius) <= radius_)
    return refuse("the tool does not fit into this arc; take a smaller one");
  CanonicalMove programmed = arc_move(*found, end);
  const double feed = feed_mm_s(block, 1000 * path_length(programmed, in_metres(from))) / 1000;
  const Spot goal_spot =
      beside(to, radius_, inside ? direction(to, centre) : direction(centre, to));
  AxisPoint goal = end;
  put_spot(goal, plane, goal_spot);
  const auto arc_to_goal = [&](const Spot& about, double swept) {
    CanonicalMove move = arc_move({about, found->turns}, goal);
    move.feed_m_s = feed;
    open_move(move, goal, {0, 0}, swept);
    programmed_ = end;
    position_ = goal;
    return overflow_;
  };
  if (entry_) {
    // An arc that ends where the compensated one does, and begins where the tool stands: its centre
    // is on the normal at the end.
    entry_ = false;
    const double normal = direction(goal_spot, centre);
    const double corner = direction(goal_spot, at) - normal;
    if (std::abs(std::cos(corner)) < kEqualAngles)
      return refuse("the tool does not fit into this arc; take a smaller one");
    const Spot about = beside(goal_spot, apart(at, goal_spot) / 2 / std::cos(corner), normal);
    flush();
    return arc_to_goal(about, swept_rad(at, goal_spot, about, found->turns));
  }
  const Spot corner = spot_of(programmed_, plane);
  const double swept = swept_rad(corner, to, centre, found->turns);
  double theta = direction(corner, at) + (left ? -kPi / 2 : kPi / 2);
  double delta = direction(corner, centre);
  const double alpha = motion == 30 ? delta - kPi / 2 : delta + kPi / 2;
  double beta = left ? theta - alpha : alpha - theta;
  if (beta > 1.5 * kPi)
    beta -= kTwoPi;
  else if (beta < -kPi / 2)
    beta += kTwoPi;
  if (!inside) delta += kPi;
  const bool concave = beta < -kFlatCorner_rad || beta > kPi + kFlatCorner_rad ||
                       (std::abs(beta - kPi) < kFlatCorner_rad && !inside);
  const bool turns_left = found->turns > 0;
  if (concave && (open_.empty() || open_.front().move.kind != CanonicalMove::Kind::arc)) {
    const double far = radius + (inside ? -radius_ : radius_);
    const double share = (radius * std::sin(beta - kPi / 2) + (inside ? radius_ : -radius_)) / far;
    if (std::abs(share) > 1) return refuse(kCorner);
    const double reach = std::asin(share);
    const double angle = inside ? theta + (turns_left ? reach : -reach)
                                : theta + kPi + (turns_left ? -reach : reach);
    if (auto no = end_open_moves(beside(centre, far, angle))) return no;
  } else if (concave) {
    const CanonicalMove& before = open_.front().move;
    const Spot other = {before.centre_m[0] * 1000, before.centre_m[1] * 1000};
    const double old = apart(other, spot_of(open_.front().end, plane));
    const double next = radius + (inside ? -radius_ : radius_), between = apart(other, centre);
    if (old == 0 || between == 0)
      return refuse("two arcs of the contour have one centre; the tool cannot follow");
    const double share = (old * old + between * between - next * next) / (2 * old * between);
    if (std::abs(share) > 1) return refuse(kCorner);
    const double back = std::acos(share);
    const bool was_inside = left == (before.turns > 0);
    const double angle = direction(other, centre) + (was_inside == turns_left ? back : -back);
    if (auto no = end_open_moves(beside(other, old, angle))) return no;
  } else if (beta > kFlatCorner_rad) {
    const Spot middle = beside(corner, radius_, delta);
    flush();
    AxisPoint round = end;
    put_spot(round, plane, middle);
    const std::size_t across = plane_axes(plane)[2];
    round[across] = position_[across];
    CanonicalMove move = arc_move({corner, left ? -1 : 1}, round);
    move.feed_m_s = feed;
    put(move);
    begin_at(middle);
  } else {
    begin_at(at);
  }
  return arc_to_goal(centre, swept);
}

}  // namespace servosense::process
