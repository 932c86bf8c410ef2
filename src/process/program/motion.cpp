// Straight moves and arcs.
#include <algorithm>
#include <cmath>

#include "machine.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense::process {

std::string_view kind_name(CanonicalMove::Kind kind) {
  switch (kind) {
    case CanonicalMove::Kind::rapid:
      return "rapid";
    case CanonicalMove::Kind::feed:
      return "feed";
    case CanonicalMove::Kind::arc:
      return "arc";
    case CanonicalMove::Kind::tap:
      return "tap";
    case CanonicalMove::Kind::dwell:
      return "dwell";
    case CanonicalMove::Kind::tool:
      return "tool";
    case CanonicalMove::Kind::spindle:
      return "spindle";
    case CanonicalMove::Kind::coolant:
      return "coolant";
    case CanonicalMove::Kind::stop:
      return "stop";
    case CanonicalMove::Kind::override_switch:
      return "override";
    case CanonicalMove::Kind::output:
      return "output";
    case CanonicalMove::Kind::end:
      break;
  }
  return "end";
}

namespace {

double distance_over(const AxisPoint& a, const AxisPoint& b, std::size_t first) {
  return std::hypot(a[first] - b[first], a[first + 1] - b[first + 1], a[first + 2] - b[first + 2]);
}

bool only_turns(const AxisPoint& from, const AxisPoint& to) {
  return distance_over(from, to, 0) == 0 && distance_over(from, to, 6) == 0 &&
         distance_over(from, to, 3) > 0;
}

std::array<double, 2> in_plane(const AxisPoint& point, Plane plane) {
  const auto axes = plane_axes(plane);
  return {point[axes[0]], point[axes[1]]};
}

}  // namespace

double swept_rad(const std::array<double, 2>& from, const std::array<double, 2>& to,
                 const std::array<double, 2>& centre, int turns) {
  const double start = std::atan2(from[1] - centre[1], from[0] - centre[0]);
  double angle = std::atan2(to[1] - centre[1], to[0] - centre[0]) - start;
  if (turns > 0) {
    if (angle <= 0) angle += kTwoPi;
    if (angle <= 0) angle += kTwoPi;
    return angle + kTwoPi * (turns - 1);
  }
  if (angle >= 0) angle -= kTwoPi;
  if (angle >= 0) angle -= kTwoPi;
  return angle + kTwoPi * (turns + 1);
}

double straight_length(const AxisPoint& from, const AxisPoint& to) {
  for (const std::size_t first : {std::size_t{0}, std::size_t{6}})
    if (const double length = distance_over(from, to, first); length > 0) return length;
  return distance_over(from, to, 3);
}

double arc_angle_rad(const CanonicalMove& arc, const AxisPoint& from) {
  return swept_rad(in_plane(from, arc.plane), in_plane(arc.end, arc.plane), arc.centre_m,
                   arc.turns);
}

double path_length(const CanonicalMove& move, const AxisPoint& from) {
  if (move.kind != CanonicalMove::Kind::arc) return straight_length(from, move.end);
  const auto start = in_plane(from, move.plane);
  const std::size_t across = plane_axes(move.plane)[2];
  const double radius = std::hypot(start[0] - move.centre_m[0], start[1] - move.centre_m[1]);
  return std::hypot(radius * arc_angle_rad(move, from), move.end[across] - from[across]);
}

// ---- where a block goes
// --------------------------------------------------------------------------

Expected<AxisPoint> Machine::ends(const Block& block) const {
  const bool contour = compensating() && !entry_;
  AxisPoint end = position_;
  if (contour) {
    const auto axes = plane_axes(modes_.plane);
    end[axes[0]] = programmed_[axes[0]];
    end[axes[1]] = programmed_[axes[1]];
  }
  std::array<std::optional<double>, 9> given;
  for (std::size_t i = 0; i < given.size(); ++i)
    if (const auto word = block.word(kAxisLetters[i]))
      given[i] = *word * (is_rotary(i) ? 1 : modes_.unit_mm);
  if (block.code(GGroup::once) == 530) {
    if (block.polar_radius || block.polar_angle_deg)
      return data_error("polar coordinates do not go with G53");
    AxisPoint place = offsets_.to_machine(end);
    for (std::size_t i = 0; i < given.size(); ++i)
      if (given[i]) place[i] = *given[i];
    // Axes without a word stay exactly where they are, but X and Y turn together.
    const AxisPoint turned = offsets_.to_program(place);
    for (std::size_t i = 0; i < given.size(); ++i)
      if (given[i] || i < 2) end[i] = turned[i];
    return end;
  }
  for (std::size_t i = 0; i < given.size(); ++i)
    if (given[i]) end[i] = modes_.absolute ? *given[i] : end[i] + *given[i];
  if (auto no = polar(block, end)) return *no;
  return end;
}

Refusal Machine::polar(const Block& block, AxisPoint& end) const {
  if (!block.polar_radius && !block.polar_angle_deg) return std::nullopt;
  const double radius = block.polar_radius.value_or(0) * modes_.unit_mm;
  const double angle = rad_from_deg(block.polar_angle_deg.value_or(0));
  double from_radius = std::hypot(end[kX], end[kY]), from_angle = std::atan2(end[kY], end[kX]);
  const bool at_origin = end[kX] == 0 && end[kY] == 0;
  if (modes_.absolute) {
    if (!block.polar_angle_deg && at_origin)
      return refuse("at the origin a polar radius (@) needs its angle (^)");
    if (block.polar_radius) from_radius = radius;
    if (block.polar_angle_deg) from_angle = angle;
  } else {
    if (at_origin) return refuse("at the origin polar increments have no direction");
    from_radius += radius;
    from_angle += angle;
  }
  end[kX] = from_radius * std::cos(from_angle);
  end[kY] = from_radius * std::sin(from_angle);
  return std::nullopt;
}

Refusal Machine::may_feed(const Block& block, const char* what) const {
  if (modes_.feed_mode == FeedMode::inverse_time) {
    if (!block.has('f'))
      return refuse(std::string("under G93 every ") + what + " asks for F, one over its minutes");
    return std::nullopt;
  }
  if (modes_.feed == 0)
    return refuse(std::string("the feed of this ") + what + " is zero; give F before");
  if (modes_.feed_mode == FeedMode::per_revolution && modes_.speed_rpm == 0)
    return refuse("under G95 the feed asks for a spindle speed; give S before");
  return std::nullopt;
}

double Machine::feed_mm_s(const Block& block, double length) const {
  switch (modes_.feed_mode) {
    case FeedMode::inverse_time:
      return std::max(kLeastInverseFeed * modes_.unit_mm, length * block.word('f').value_or(0)) /
             60;
    case FeedMode::per_revolution:
      return modes_.feed_mm * modes_.speed_rpm / 60;
    case FeedMode::per_minute:
      break;
  }
  return modes_.feed_mm / 60;
}

Refusal Machine::move(const Block& block, int motion) {
  const bool in_cycle = motion == 730 || motion == 740 || (motion > 800 && motion <= 890);
  if (!in_cycle) initial_level_.reset();
  if (in_cycle) return cycle(block, motion);
  if (motion == 20 || motion == 30) return arc(block, motion);
  if (motion == 800) {
    modes_.motion = 800;
    return std::nullopt;
  }
  return straight(block, motion);
}

// ---- straight
void Machine::put_feed(const AxisPoint& end, double feed, bool turns) {
  // F of axes that turn alone counts degrees, under G20 too.
  CanonicalMove move = move_to(CanonicalMove::Kind::feed, end);
  move.feed_m_s = turns ? 0 : feed / 1000;
  if (turns) move.feed_word_m_s = 0;
  const bool degrees = modes_.feed_mode == FeedMode::inverse_time;
  if (turns) move.feed_deg_s = degrees ? feed : feed / modes_.unit_mm;
  put(move);
}

// ------------------------------------------------------------------------------------

Refusal Machine::straight(const Block& block, int motion) {
  after_exit_ = false;
  if (motion == 10)
    if (auto no = may_feed(block, "move")) return no;
  modes_.motion = motion;
  const auto found = ends(block);
  if (!found) return found.error();
  const AxisPoint end = *found;
  if (motion == 330 || motion == 331) {
    if (auto no = not_compensating("the spindle leads the feed")) return no;
    if (modes_.spindle_direction == 0)
      return refuse(code_name(motion) +
                    " goes with the spindle, which stands; start it with M3 or M4");
    const AxisPoint stands = position_;
    AxisPoint to = end;
    if (motion == 331)  // X, Y and Z alone
      std::copy(position_.begin() + 3, position_.end(), to.begin() + 3);
    CanonicalMove tap =
        move_to(motion == 331 ? CanonicalMove::Kind::tap : CanonicalMove::Kind::feed, to);
    tap.feed_m_rev = std::abs(*block.word('k')) * modes_.unit_mm / 1000;
    tap.feed_m_s = tap.feed_m_rev * modes_.speed_rpm / 60;
    tap.feed_word_m_s = 0;
    tap.threads = true;
    position_ = to;
    put(tap);
    if (motion == 331) {
      position_ = stands;
      std::copy(end.begin() + 3, end.end(), position_.begin() + 3);
    }
    return std::nullopt;
  }
  if (compensated()) {
    if (block.code(GGroup::once) == 530) return not_compensating("G53 moves");
    return compensated_straight(block, motion, end);
  }
  if (motion == 0) {
    go(CanonicalMove::Kind::rapid, end, 0);
    return std::nullopt;
  }
  const double feed = feed_mm_s(block, straight_length(position_, end));
  put_feed(end, feed, only_turns(position_, end));
  position_ = end;
  return std::nullopt;
}

// ---- arcs
// ----------------------------------------------------------------------------------------

Expected<Circle> Machine::circle(const Block& block, int motion, const AxisPoint& from,
                                 const AxisPoint& to) const {
  const auto a = in_plane(from, modes_.plane), b = in_plane(to, modes_.plane);
  const int turns = static_cast<int>(std::lround(block.word('p').value_or(1)));
  Circle found;
  found.turns = motion == 30 ? turns : -turns;
  if (const auto word = block.word('r')) {
    const double r = *word * modes_.unit_mm, radius = std::abs(r);
    if (a == b)
      return data_error("the arc ends where it begins, so R gives it no centre; write I, J or K");
    double half = std::hypot((b[0] - a[0]) / 2, (b[1] - a[1]) / 2);
    if (half - radius > kArcRadius_mm)
      return data_error("R is too small to reach the end of the arc; it is " +
                        number_text(2 * half / modes_.unit_mm) + " away");
    if (half / radius > 1 - kSemicircleShare) half = radius;
    // Up to half a turn the centre lies left of a counterclockwise chord; R below 0 is the longer
    // arc.
    const double direction =
        std::atan2(b[1] - a[1], b[0] - a[0]) + ((motion == 20) == (r > 0) ? -kPi / 2 : kPi / 2);
    const double away = radius * std::cos(std::asin(half / radius));
    found.centre = {(a[0] + b[0]) / 2 + away * std::cos(direction),
                    (a[1] + b[1]) / 2 + away * std::sin(direction)};
    return found;
  }
  const auto axes = plane_axes(modes_.plane);
  for (const std::size_t i : {std::size_t{0}, std::size_t{1}}) {
    const auto word = block.word("ijk"[axes[i]]);
    if (!word && modes_.arc_absolute)
      return data_error(
          "under G90.1 the centre of an arc is given by both its words; one is missing");
    found.centre[i] = word.value_or(0) * modes_.unit_mm + (modes_.arc_absolute ? 0 : a[i]);
  }
  const double first = std::hypot(a[0] - found.centre[0], a[1] - found.centre[1]);
  const double last = std::hypot(b[0] - found.centre[0], b[1] - found.centre[1]);
  if (first < kArcRadius_mm || last < kArcRadius_mm)
    return data_error("the radius of the arc is zero; look at I, J and K");
  const double off = std::abs(first - last);
  const double allowed = modes_.unit_mm == 1 ? kArcCentreMetric_mm : kArcCentreInch_mm;
  if (off > kArcRadiusWorst * allowed ||
      (off > allowed && off / std::max(first, last) > kArcRadiusShare))
    return data_error("the arc begins " + number_text(first / modes_.unit_mm) +
                      " from its centre and ends " + number_text(last / modes_.unit_mm) +
                      " from it; look at I, J and K and at the end point");
  return found;
}

CanonicalMove Machine::arc_move(const Circle& circle, const AxisPoint& end) const {
  CanonicalMove move = move_to(CanonicalMove::Kind::arc, end);
  move.plane = modes_.plane;
  move.centre_m = {circle.centre[0] / 1000, circle.centre[1] / 1000};
  move.turns = circle.turns;
  return move;
}

Refusal Machine::arc(const Block& block, int motion) {
  if (after_exit_)
    return refuse("the first move after G40 is straight, not an arc; put a line between");
  const auto axes = plane_axes(modes_.plane);
  const bool centre = block.has_any("ijk");
  if (!block.has('r') && !centre)
    return refuse("an arc asks for R, or for its centre by I, J and K");
  if (block.has('r') && centre)
    return refuse("an arc is given by R or by its centre; both stand on the line");
  if (auto no = may_feed(block, "arc")) return no;
  const char across = "ijk"[axes[2]];
  if (block.has(across))
    return refuse(std::string(1, static_cast<char>(across - 'a' + 'A')) +
                  " is across the plane of the arc; choose the plane with G17, G18 or G19");
  const bool moves = block.has("xyz"[axes[0]]) || block.has("xyz"[axes[1]]) || block.polar_radius ||
                     block.polar_angle_deg;
  if (block.has('r') && !moves)
    return refuse(
        "an arc by R asks for its end in the plane; a full circle is given by I, J and K");
  const auto end = ends(block);
  if (!end) return end.error();
  modes_.motion = motion;
  if (compensated()) return compensated_arc(block, motion, *end);
  const auto found = circle(block, motion, position_, *end);
  if (!found) return found.error();
  CanonicalMove move = arc_move(*found, *end);
  move.feed_m_s = feed_mm_s(block, 1000 * path_length(move, in_metres(position_))) / 1000;
  put(move);
  position_ = *end;
  return std::nullopt;
}

}  // namespace servosense::process
