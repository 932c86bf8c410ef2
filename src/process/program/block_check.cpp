// Whether the words of a block go together, as LinuxCNC asks.
#include <cmath>

#include "machine.hpp"
#include "servosense/io/text.hpp"

namespace servosense::process {
namespace {

bool is_cycle(int motion) {
  return motion == 730 || motion == 740 || (motion > 800 && motion <= 890);
}
bool is_arc(int motion) { return motion == 20 || motion == 30; }
bool is_one_of(int code, std::initializer_list<int> codes) {
  for (const int c : codes)
    if (code == c) return true;
  return false;
}
bool is_near_whole(double value) { return std::abs(value - std::round(value)) <= kEqualNumbers; }

std::string needs(char letter, const std::string& codes) {
  return std::string(1, static_cast<char>(letter - 'a' + 'A')) +
         " stands on a line without a code that uses it (" + codes + ")";
}

}  // namespace

Expected<int> Machine::motion_of(const Block& block) const {
  const bool polar = block.polar_radius || block.polar_angle_deg;
  const bool axes = block.has_any(kAxisLetters), goes = axes || polar;
  const int once = block.code(GGroup::once), motion = block.code(GGroup::motion);
  if (polar && (modes_.plane != Plane::xy || block.has_any("xy")))
    return data_error("polar coordinates stand for X and Y, in the plane of G17 alone");
  const bool once_takes_axes = is_one_of(once, {100, 280, 300, 520, 920});
  if (once_takes_axes && is_one_of(once, {520, 920}) && !axes &&
      (motion == kNoCode || motion == 800))
    return data_error(code_name(once) + " sets axes, and none is given");
  if (once_takes_axes && once == 920 && polar)
    return data_error("polar coordinates are for moves, not for G92");
  int result = kNoCode;
  if (once == 40 && options_.dialect == Dialect::fanuc && motion == kNoCode)
    return kNoCode;  // X waits
  if (motion != kNoCode) {
    if (motion == 800) {
      if (goes && !once_takes_axes)
        return data_error(
            "G80 moves nothing, and axes are given; put the move on a line of its own");
    } else if (once_takes_axes) {
      return data_error(code_name(once) + " and " + code_name(motion) +
                        " both want the axes of the line; put them on two lines");
    } else if (!goes && !is_one_of(motion, {0, 10, 20, 30})) {
      return data_error(code_name(motion) + " moves axes, and none is given");
    }
    result = motion;
  } else if (once_takes_axes) {
    result = kNoCode;
  } else if (goes) {
    const bool length = block.code(GGroup::tool_length) == 431;
    if (!length && modes_.motion == 800)
      return data_error("axes are given, and no G code says how to move; put G0 or G1 before");
    if (!length) result = modes_.motion;
  } else if (block.has_any("ijk") && is_arc(modes_.motion)) {
    result = modes_.motion;
  }
  if (polar && result == kNoCode) return data_error("polar coordinates are for moves alone");
  return result;
}

Refusal Machine::check(const Block& b, int motion) const {
  const int once = b.code(GGroup::once), length = b.code(GGroup::tool_length);
  const int side = b.code(GGroup::cutter_compensation), path = b.code(GGroup::path_control);
  const int io = b.code(MGroup::input_output), spindle = b.code(MGroup::spindle);
  const int override_code = b.code(MGroup::override_switch);
  const bool overrides = is_one_of(override_code, {50, 51, 52, 53});
  const bool sides = is_one_of(side, {410, 420, 411, 421});

  if (is_one_of(motion, {382, 383, 384, 385}))
    return refuse("where the probe of " + code_name(motion) +
                  " trips is known on the machine alone; take probing out");
  if (is_one_of(motion, {50, 51, 52}))
    return refuse("splines (" + code_name(motion) +
                  ") are not supported; have lines and arcs put out");
  if (is_one_of(motion, {700, 710, 711, 712, 720, 721, 722, 760}))
    return refuse(code_name(motion) +
                  " is a cycle of lathes, which this mill does not know; write "
                  "its moves");
  if (is_one_of(b.code(GGroup::plane), {171, 181, 191}))
    return refuse("planes of U, V and W are not supported; take " +
                  code_name(b.code(GGroup::plane)) + " out");

  for (const char letter : {'h', 't', 'l'})
    if (b.has(letter) && !is_near_whole(*b.word(letter)))
      return refuse(std::string(1, static_cast<char>(letter - 'a' + 'A')) +
                    " takes a whole number, not " + number_text(*b.word(letter)));
  if (b.has('f') && *b.word('f') < 0) return refuse("F is negative; a feed is not");
  if (b.has('s') && *b.word('s') < 0)
    return refuse("S is negative; a speed is not, M4 turns the other way");
  if (b.has('l') && *b.word('l') < 0) return refuse("L is negative; it counts");

  const bool dwell_by_axis = once == 40 && options_.dialect == Dialect::fanuc && b.has_any("xu");
  if (once == 40 && b.word('p').value_or(-1) == -1 && !dwell_by_axis)
    return refuse("G4 asks for P, the seconds to wait");
  if (once == 40 && is_arc(b.code(GGroup::motion)))
    return refuse("G4 and an arc both want P; put them on two lines");
  if (once == 40 && dwell_seconds(b) < 0) return refuse("G4 waits for no negative time");
  if (once == 100) {
    const long l = b.has('l') ? std::lround(*b.word('l')) : -1;
    if (!is_one_of(static_cast<int>(l), {0, 1, 2, 10, 11, 20}))
      return refuse("G10 asks for L0, L1, L2, L10, L11 or L20");
    const double p = b.word('p').value_or(-1);
    if (l != 0 && !is_near_whole(p)) return refuse("P of G10 is a whole number");
    if ((l == 2 || l == 20) && (p < -0.5 || p > 9.5))
      return refuse("G10 L" + std::to_string(l) +
                    " asks for P, a coordinate system from 1 to 9, or 0 "
                    "for the one in use");
    if ((l == 1 || l == 10 || l == 11) && p < 0.5)
      return refuse("G10 L" + std::to_string(l) + " asks for P, the number of a tool");
  }
  if (once == 530) {
    if (motion != 0 && motion != 10) return refuse("G53 goes with G0 or G1 alone");
    const int distance = b.code(GGroup::distance);
    if (distance == 910 || (distance != 900 && !modes_.absolute))
      return refuse("G53 is a place of the machine and no increment; put G90 before");
  }
  if (is_cycle(motion) && b.has_any("abc"))
    return refuse("axes that turn do not move in a drilling cycle; turn them before");
  if (b.has('d') && !sides && b.code(GGroup::spindle_mode) != 960)
    return refuse(needs('d', "G41, G41.1, G42, G42.1, G96"));
  if (b.has('e') && !is_one_of(io, {66, 67, 68})) return refuse(needs('e', "M66, M67, M68"));
  if (b.has('h') && !is_one_of(length, {430, 432})) return refuse(needs('h', "G43, G43.2"));
  for (const char letter : {'i', 'j'})
    if (b.has(letter) && !is_arc(motion) && motion != 870 && once != 100)
      return refuse(needs(letter, "G2, G3, G10, G87"));
  if (b.has('k') && !is_arc(motion) && !is_one_of(motion, {330, 331, 870}))
    return refuse(needs('k', "G2, G3, G33, G33.1, G87"));
  if (b.has('l') && !is_cycle(motion) && once != 100 && !sides && io != 66)
    return refuse(needs('l', "G10, a cycle, G41, G42, M66"));
  if (b.has('l') && motion == 740 && once != 100 && !sides && io != 66)
    return refuse(needs('l', "G10, G73, G81 to G89, G41, G42, M66"));
  if (const auto p = b.word('p')) {
    if (once != 100 && once != 40 && path != 640 && !is_arc(motion) && !overrides &&
        !is_one_of(motion, {740, 820, 840, 860, 880, 890}) &&
        !is_one_of(io, {62, 63, 64, 65, 66}) && spindle != 19 && b.code(MGroup::user) == kNoCode)
      return refuse(needs('p',
                          "G2, G3, G4, G10, G64, G74, G82, G84, G86, G88, G89, M19, M50 to M53, "
                          "M62 to M66"));
    if ((is_arc(motion) || spindle == 19) && std::abs(*p - std::round(*p)) > 1e-3)
      return refuse("P of an arc or of M19 is a whole number");
    if (spindle == 19 && (*p < -0.5 || *p > 2.5)) return refuse("P of M19 is 0, 1 or 2");
    if (is_arc(motion) && *p < 0.5) return refuse("P of an arc counts turns, from 1 on");
    if (is_arc(motion) && *p > 1e6)
      return refuse("P of an arc is more turns than any machine makes");
  }
  if (b.has('q') && !is_one_of(motion, {830, 730}) && !is_one_of(io, {66, 67, 68}) && once != 100 &&
      b.code(MGroup::tool) != 61 && path != 640 && spindle != 19 && b.code(MGroup::user) == kNoCode)
    return refuse(needs('q', "G10, G64, G73, G83, M19, M61, M66 to M68"));
  if (b.has('r')) {
    if (!is_arc(motion) && !is_cycle(motion) && !is_one_of(side, {411, 421}) && once != 100 &&
        spindle != 19)
      return refuse(needs('r', "G2, G3, G10, a cycle, M19"));
    if (spindle == 19 && (*b.word('r') < 0 || *b.word('r') > 360))
      return refuse("R of M19 is an angle from 0 to 360");
  }
  if (b.code(GGroup::spindle_mode) == 960 && !b.has('s'))
    return refuse("G96 asks for S, the surface speed");
  if (is_one_of(motion, {330, 331})) {
    if (!b.has('k')) return refuse(code_name(motion) + " asks for K, the travel of a revolution");
    if (b.has('f')) return refuse(code_name(motion) + " goes with the spindle, so it takes no F");
  }
  return std::nullopt;
}

}  // namespace servosense::process
