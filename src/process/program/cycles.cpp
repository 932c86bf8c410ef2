// Drilling cycles: G73, G74, G81 to G89, in all planes.
#include <algorithm>
#include <cmath>

#include "machine.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense::process {
namespace {

using Kind = CanonicalMove::Kind;

// What cycles remember from block to block, in program units (Machine::cycle_).
enum Remembered : std::size_t { kR, kBottom, kP, kQ, kI, kJ, kK };

/// Levels as near as this are one [mm]; under G20 rounding parts them.
constexpr double kSameLevel_mm = 1e-9;

}  // namespace

Refusal Machine::cycle(const Block& block, int motion) {
  if (modes_.feed_mode == FeedMode::inverse_time)
    return refuse("a cycle does not go with G93; put G94 before");
  if (modes_.feed == 0) return refuse("the feed of this cycle is zero; give F before");
  if (modes_.feed_mode == FeedMode::per_revolution && modes_.speed_rpm == 0)
    return refuse("under G95 the feed asks for a spindle speed; give S before");
  if (auto no = not_compensating("a cycle is called")) return no;
  const bool again = modes_.motion == motion;
  const auto axes = plane_axes(modes_.plane);
  const char across = kAxisLetters[axes[2]];
  if (!block.has('r') && !again)
    return refuse("the first " + code_name(motion) + " asks for R, the level it retracts to");
  const long repeats = block.has('l') ? std::lround(*block.word('l')) : 1;
  if (repeats == 0) return refuse("L0 would repeat the cycle never; take the line out");
  if (!block.has(across) && !again)
    return refuse("the first " + code_name(motion) + " asks for the bottom of the hole, " +
                  std::string(1, static_cast<char>(across - 'a' + 'A')));
  const auto remember = [&](Remembered place, std::optional<double> word) {
    if (word) cycle_[place] = *word;
    return cycle_[place] * modes_.unit_mm;
  };
  const double r_word = block.word('r').value_or(cycle_[kR]);
  const double bottom_word = block.word(across).value_or(cycle_[kBottom]);
  if (!initial_level_) initial_level_ = position_[axes[2]];
  double old = *initial_level_;
  const double r = r_word * modes_.unit_mm + (modes_.absolute ? 0 : old);
  const double bottom = bottom_word * modes_.unit_mm + (modes_.absolute ? 0 : r);
  if (r < bottom)
    return refuse("the level R lies below the bottom of the hole; look at R and at " +
                  std::string(1, static_cast<char>(across - 'a' + 'A')));
  const bool dwells = motion == 820 || motion == 860 || motion == 880 || motion == 890;
  if (dwells && !again && !block.has('p'))
    return refuse("the first " + code_name(motion) + " asks for P, the seconds it waits");
  if ((motion == 730 || motion == 830) && !again && !block.has('q'))
    return refuse("the first " + code_name(motion) + " asks for Q, the depth of a peck");
  if (motion == 870 && !again && !(block.has('i') && block.has('j') && block.has('k')))
    return refuse("the first G87 asks for I, J and K, the way aside and the top of the bore");

  std::array<double, 2> at = {position_[axes[0]], position_[axes[1]]}, step = {0, 0};
  AxisPoint goal = position_;
  // Polar words: a place, or under G91 a step from hole to hole.
  const double radius = block.polar_radius.value_or(0) * modes_.unit_mm;
  const double angle = rad_from_deg(block.polar_angle_deg.value_or(0));
  const bool polar_steps = !modes_.absolute && (radius != 0 || angle != 0);
  if (modes_.absolute && (block.polar_radius || block.polar_angle_deg)) {
    const double from = block.polar_radius ? radius : std::hypot(at[0], at[1]);
    const double direction = block.polar_angle_deg ? angle : std::atan2(at[1], at[0]);
    at = {from * std::cos(direction), from * std::sin(direction)};
  }
  for (const std::size_t i : {std::size_t{0}, std::size_t{1}})
    if (const auto word = block.word(kAxisLetters[axes[i]])) {
      if (modes_.absolute)
        at[i] = *word * modes_.unit_mm;
      else
        step[i] = *word * modes_.unit_mm;
    }
  const auto traverse = [&](double height) {
    goal[axes[0]] = at[0], goal[axes[1]] = at[1], goal[axes[2]] = height;
    go(Kind::rapid, goal, 0);
  };
  if (old < r - kSameLevel_mm) {
    goal[axes[2]] = r;
    go(Kind::rapid, goal, 0);
  }
  double height = std::max(position_[axes[2]], r);
  old = std::max(old, r);
  const double clear = modes_.retract_to_r ? r : old;
  cycle_[kR] = r_word;
  cycle_[kBottom] = bottom_word;
  remember(kP, block.word('p'));
  remember(kQ, block.word('q'));
  remember(kI, block.word('i'));
  remember(kJ, block.word('j'));
  remember(kK, block.word('k'));
  // Holes are positioned exactly, whatever G64 allows.
  const PathControl path = modes_.path_control;
  modes_.path_control = PathControl::exact_path;
  for (long repeat = 0; repeat < repeats && !overflow_; ++repeat) {
    at[0] += step[0], at[1] += step[1];
    if (polar_steps) {
      if (at[0] == 0 && at[1] == 0)
        return refuse("at the origin polar increments have no direction");
      const double from = std::hypot(at[0], at[1]) + radius;
      const double direction = std::atan2(at[1], at[0]) + angle;
      at = {from * std::cos(direction), from * std::sin(direction)};
    }
    traverse(height);
    if (std::abs(height - r) > kSameLevel_mm) traverse(r);
    if (auto no = hole(block, motion, r, clear, bottom, at)) return no;
    height = clear;
  }
  modes_.path_control = path;
  goal[axes[0]] = at[0], goal[axes[1]] = at[1], goal[axes[2]] = clear;
  position_ = goal;
  modes_.motion = motion;
  return overflow_;
}

Refusal Machine::hole(const Block& block, int motion, double r, double clear, double bottom,
                      std::array<double, 2> at) {
  const auto axes = plane_axes(modes_.plane);
  AxisPoint goal = position_;
  goal[axes[0]] = at[0], goal[axes[1]] = at[1];
  const double feed = feed_mm_s(block, 0);
  const bool taps = motion == 740 || motion == 840;
  const auto down = [&](double to) {
    goal[axes[2]] = to;
    CanonicalMove move = move_to(Kind::feed, goal);
    move.feed_m_s = feed / 1000;
    move.threads = taps;
    put(move);
    position_ = goal;
  };
  const auto rapid = [&](double to) { goal[axes[2]] = to, go(Kind::rapid, goal, 0); };
  const auto dwell = [&](double seconds) {
    CanonicalMove move;
    move.kind = Kind::dwell;
    move.seconds = seconds;
    put(move);
  };
  const int direction = modes_.spindle_direction;
  const auto spindle = [&](int now) {
    modes_.spindle_direction = now;
    put_number(Kind::spindle, now == 0 ? 5 : now > 0 ? 3 : 4);
  };
  if ((motion == 860 || motion == 870 || motion == 880) && direction == 0)
    return refuse(code_name(motion) + " works with a turning spindle; start it with M3 or M4");
  switch (motion) {
    case 730:
    case 830: {
      const double peck = cycle_[kQ] * modes_.unit_mm;
      if (peck <= 0) return refuse("Q is the depth of a peck and above 0");
      for (double depth = r - peck; depth > bottom && !overflow_; depth -= peck) {
        down(depth);
        if (motion == 830) rapid(r);
        rapid(depth + kPeckClearance_mm);
      }
      down(bottom);
      rapid(clear);
      break;
    }
    case 740:
    case 840:
      if (direction == 0 || (direction > 0) != (motion == 840))
        return refuse(
            code_name(motion) + " taps with the spindle turning " +
            (motion == 840 ? "clockwise; start it with M3" : "counterclockwise; start it with M4"));
      down(bottom);
      spindle(-direction);
      dwell(cycle_[kP]);
      down(clear);
      spindle(direction);
      break;
    case 860:
      down(bottom);
      dwell(cycle_[kP]);
      spindle(0);
      rapid(clear);
      spindle(direction);
      break;
    case 870: {
      const auto word = [&](std::size_t axis) { return cycle_[kI + axis] * modes_.unit_mm; };
      const double top = word(axes[2]) + (modes_.absolute ? 0 : bottom);
      const auto place = [&](bool aside) {
        goal[axes[0]] = at[0] + (aside ? word(axes[0]) : 0);
        goal[axes[1]] = at[1] + (aside ? word(axes[1]) : 0);
      };
      place(true), rapid(r);
      spindle(0);
      rapid(bottom);
      place(false), rapid(bottom);
      spindle(direction);
      down(top);
      down(bottom);
      spindle(0);
      place(true), rapid(bottom);
      rapid(clear);
      place(false), rapid(clear);
      spindle(direction);
      break;
    }
    case 880:
      down(bottom);
      dwell(cycle_[kP]);
      spindle(0);
      put_number(Kind::stop, 0);
      spindle(direction);
      break;
    default:  // G81, G82, G85, G89
      down(bottom);
      if (motion == 820 || motion == 890) dwell(cycle_[kP]);
      if (motion == 850) down(r);
      if (motion == 890)
        down(clear);
      else
        rapid(clear);
  }
  return std::nullopt;
}

}  // namespace servosense::process
