#include "machine.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense::process {

void rotate(AxisPoint& point, double angle_deg) {
  const double c = std::cos(rad_from_deg(angle_deg)), s = std::sin(rad_from_deg(angle_deg));
  const double x = point[kX], y = point[kY];
  point[kX] = x * c - y * s;
  point[kY] = x * s + y * c;
}

AxisPoint Offsets::to_machine(AxisPoint point) const {
  for (std::size_t i = 0; i < point.size(); ++i) point[i] += shift[i];
  rotate(point, rotation_deg);
  for (std::size_t i = 0; i < point.size(); ++i) point[i] += work[i] + tool[i];
  return point;
}

AxisPoint Offsets::to_program(AxisPoint point) const {
  for (std::size_t i = 0; i < point.size(); ++i) point[i] -= work[i] + tool[i];
  rotate(point, -rotation_deg);
  for (std::size_t i = 0; i < point.size(); ++i) point[i] -= shift[i];
  return point;
}

Machine::Machine(const ProgramOptions& options, std::function<void(const CanonicalMove&)> sink)
    : parameters(static_cast<std::size_t>(kLastParameter) + 1),
      options_(options),
      sink_(std::move(sink)),
      tools_(options.tools) {
  for (const auto& [index, value] : options.parameters)
    if (index >= 1 && index <= kLastParameter) parameters[static_cast<std::size_t>(index)] = value;
  const double system = parameters[5220];
  modes_.coordinate_system = system >= 1 && system <= 9 ? static_cast<int>(system) : 1;
  parameters[5220] = modes_.coordinate_system;
  load_work_offset();
  if (parameters[5210] != 0)
    for (std::size_t i = 0; i < offsets_.shift.size(); ++i)
      offsets_.shift[i] = parameters[5211 + i];
  modes_.retract_to_r = options.dialect == Dialect::linuxcnc;
  // The machine stands at its zero, as LinuxCNC's interpreter takes it to.
  position_ = offsets_.to_program({});
  show_tool();
}

// ---- moves
// ---------------------------------------------------------------------------------------

AxisPoint in_metres(AxisPoint point) {
  for (std::size_t i = 0; i < point.size(); ++i)
    if (!is_rotary(i)) point[i] /= 1000;
  return point;
}

CanonicalMove Machine::move_to(CanonicalMove::Kind kind, const AxisPoint& end) const {
  CanonicalMove move;
  move.kind = kind;
  move.end = in_metres(end);
  move.machine = in_metres(offsets_.to_machine(end));
  move.tool_length_m = offsets_.tool[kZ] / 1000;
  if (kind == CanonicalMove::Kind::rapid) return move;
  if (modes_.feed_mode == FeedMode::per_revolution) {
    move.feed_m_rev = modes_.feed_mm / 1000;
    move.feed_word_m_s = modes_.unit_mm / 1000 * modes_.speed_rpm / 60;
  } else if (modes_.feed_mode == FeedMode::per_minute) {
    move.feed_word_m_s = modes_.unit_mm / 1000 / 60;
  }
  return move;
}

void Machine::put(CanonicalMove move) {
  if (overflow_) return;
  if (++moves_ > options_.most_moves) {
    overflow_ = refuse("the program makes more than " + std::to_string(options_.most_moves) +
                       " moves; does a cycle repeat without end?");
    return;
  }
  move.line = line;
  const auto far = [](double v) { return !(std::abs(v) <= kFarthest); };
  if (is_motion(move.kind) && (std::any_of(move.end.begin(), move.end.end(), far) ||
                               std::any_of(move.machine.begin(), move.machine.end(), far))) {
    overflow_ = refuse("the move goes farther than any machine, beyond " + number_text(kFarthest) +
                       " m or degrees; look at the numbers and offsets");
    return;
  }
  if (!is_motion(move.kind)) {
    move.end = in_metres(position_);
    move.machine = in_metres(offsets_.to_machine(position_));
  }
  move.tool = in_spindle_.number;
  move.path_control = modes_.path_control;
  move.blend_m = modes_.blend_mm / 1000;
  move.merge_m = modes_.merge_mm / 1000;
  move.rotation_deg = offsets_.rotation_deg;
  double rpm = modes_.speed_rpm;
  if (modes_.surface_speed) {
    // S is m/min, or ft/min under G20; the speed that it asks for at this radius (LinuxCNC, G96).
    const double m_min = modes_.unit_mm == 1 ? rpm : rpm * 0.3048;
    const double radius = std::abs(move.end[kX]);
    rpm = std::min(highest_rpm_, radius > 0 ? m_min / (kTwoPi * radius) : highest_rpm_);
  }
  move.spindle_rpm = modes_.spindle_direction * rpm;
  if (open_.empty() && !waits_)
    give(move);
  else
    open_.push_back({move});
}

void Machine::give(CanonicalMove move) {
  if (move.kind == CanonicalMove::Kind::arc) {
    move.begin = in_metres(offsets_.to_program(stands_));
  }
  if (is_motion(move.kind) && move.kind != CanonicalMove::Kind::tap) {
    stands_ = move.machine;
    for (std::size_t i = 0; i < stands_.size(); ++i)
      if (!is_rotary(i)) stands_[i] *= 1000;
  }
  sink_(move);
}

void Machine::put_number(CanonicalMove::Kind kind, int number) {
  CanonicalMove move;
  move.kind = kind;
  move.number = number;
  put(move);
}

void Machine::go(CanonicalMove::Kind kind, const AxisPoint& end, double feed_mm_s) {
  CanonicalMove move = move_to(kind, end);
  move.feed_m_s = feed_mm_s / 1000;
  put(move);
  position_ = end;
}

// ---- a block
// -------------------------------------------------------------------------------------

Refusal Machine::assign(const Block& block) {
  for (const auto& [parameter, value] : block.assignments) {
    if (const long* index = std::get_if<long>(&parameter)) {
      parameters[static_cast<std::size_t>(*index)] = value;
    } else if (auto no = set_named(std::get<std::string>(parameter), value)) {
      return no;
    }
  }
  return std::nullopt;
}

Refusal Machine::execute(const Block& block) {
  // Parameters of the line are set before it is carried out, after it was read.
  if (auto no = assign(block)) return no;
  const auto motion = motion_of(block);
  if (!motion) return motion.error();
  if (auto no = check(block, *motion)) return no;
  if (auto no = execute_modes(block)) return no;
  if (const int code = block.code(GGroup::once); code != kNoCode)
    if (auto no = once(block, code)) return no;
  if (*motion != kNoCode)
    if (auto no = move(block, *motion)) return no;
  if (const int code = block.code(MGroup::stop); code != kNoCode)
    if (auto no = stop(code)) return no;
  return overflow_;
}

double Machine::dwell_seconds(const Block& block) const {
  if (options_.dialect != Dialect::fanuc) return block.word('p').value_or(0);
  // Fanuc: X and U are seconds, P milliseconds.
  for (const char letter : {'x', 'u'})
    if (const auto word = block.word(letter)) return *word;
  return block.word('p').value_or(0) / 1000;
}

Refusal Machine::not_compensating(const char* what) const {
  if (!compensating()) return std::nullopt;
  return refuse(std::string(what) + " while cutter compensation is on; end it with G40 before");
}

Refusal Machine::set_feed(double value) {
  modes_.feed = value;
  modes_.feed_mm = value * modes_.unit_mm;
  return std::nullopt;
}

Refusal Machine::execute_modes(const Block& block) {
  if (const int code = block.code(GGroup::spindle_mode); code != kNoCode) {
    modes_.surface_speed = code == 960;
    if (modes_.surface_speed) {
      if (!block.has('d'))
        return refuse("G96 without D bounds no speed at X0; give the highest speed as D");
      highest_rpm_ = std::abs(*block.word('d'));
    }
  }
  if (const int code = block.code(GGroup::feed_mode); code != kNoCode) {
    modes_.feed_mode = code == 930   ? FeedMode::inverse_time
                       : code == 940 ? FeedMode::per_minute
                                     : FeedMode::per_revolution;
    if (code != 930) modes_.feed = modes_.feed_mm = 0;
  }
  if (block.has('f') && modes_.feed_mode != FeedMode::inverse_time)
    if (auto no = set_feed(*block.word('f'))) return no;
  if (const auto speed = block.word('s')) {
    if (block.spindle && *block.spindle != 0) return refuse("this machine has one spindle; $ is 0");
    modes_.speed_rpm = *speed;
    put_number(CanonicalMove::Kind::spindle, 0);
  }
  if (const auto number = block.word('t')) {
    const auto found = tool(std::lround(*number), "T");
    if (!found) return found.error();
    selected_tool_ = static_cast<int>(std::lround(*number));
  }
  if (auto no = execute_m(block)) return no;

  if (block.code(GGroup::once) == 40) {
    CanonicalMove dwell;
    dwell.kind = CanonicalMove::Kind::dwell;
    dwell.seconds = dwell_seconds(block);
    put(dwell);
  }
  if (const int code = block.code(GGroup::plane); code != kNoCode) {
    const Plane plane = code == 170 ? Plane::xy : code == 180 ? Plane::zx : Plane::yz;
    if (compensating() && (plane != modes_.plane || code == 190))
      return not_compensating("the plane changes");
    modes_.plane = plane;
  }
  if (const int code = block.code(GGroup::units); code != kNoCode)
    if (auto no = switch_units(code == 200 ? 25.4 : 1)) return no;
  if (const int code = block.code(GGroup::cutter_compensation); code != kNoCode)
    if (auto no = compensation(block, code)) return no;
  if (const int code = block.code(GGroup::tool_length); code != kNoCode)
    if (auto no = tool_length(block, code)) return no;
  if (const int code = block.code(GGroup::coordinate_system); code != kNoCode)
    if (auto no = select_coordinate_system(code < 590 ? code / 10 - 53 : code - 584)) return no;
  if (const int code = block.code(GGroup::path_control); code != kNoCode) {
    if (auto no = not_compensating("path control changes")) return no;
    modes_.path_control = code == 610   ? PathControl::exact_path
                          : code == 611 ? PathControl::exact_stop
                                        : PathControl::blend;
    const auto tolerance_mm = [&](char letter, double otherwise_mm) {
      const auto word = code == 640 ? block.word(letter) : std::nullopt;
      return word ? std::max(0.0, *word * modes_.unit_mm) : otherwise_mm;
    };
    modes_.blend_mm = tolerance_mm('p', 0);
    modes_.merge_mm = code == 640 ? tolerance_mm('q', modes_.blend_mm) : 0;
  }
  if (const int code = block.code(GGroup::distance); code != kNoCode) modes_.absolute = code == 900;
  if (const int code = block.code(GGroup::arc_distance); code != kNoCode)
    modes_.arc_absolute = code == 901;
  if (const int code = block.code(GGroup::retract); code != kNoCode) {
    if (auto no = not_compensating("the retract level changes")) return no;
    modes_.retract_to_r = code == 990;
  }
  return std::nullopt;
}

Refusal Machine::switch_units(double unit_mm) {
  if (auto no = not_compensating("units change"); no && unit_mm != modes_.unit_mm) return no;
  if (initial_level_ && unit_mm != modes_.unit_mm)
    return refuse("units change while a drilling cycle is in force; end it with G80 before");
  modes_.unit_mm = unit_mm;
  return std::nullopt;
}

Refusal Machine::execute_m(const Block& block) {
  if (const int code = block.code(MGroup::input_output); code != kNoCode) {
    if (auto no = not_compensating("an output is set or an input read")) return no;
    if (code >= 62 && code <= 65 && !block.has('p'))
      return refuse("M" + std::to_string(code) + " asks for P, the number of the output");
    if (code >= 67 && (!block.has('e') || std::lround(*block.word('e')) < 0))
      return refuse("M" + std::to_string(code) + " asks for E, the number of the output");
    if (code == 66) {
      const auto p = block.word('p'), e = block.word('e'), l = block.word('l'), q = block.word('q');
      const long wait = l ? std::lround(*l) : 0;
      if (p && e) return refuse("M66 reads P or E, not both");
      if (wait > 0 && q.value_or(0) <= 0)
        return refuse("M66 waits, so it asks for Q, the time-out");
      if (e && wait != 0) return refuse("M66 waits for no analogue input; leave L out");
      if ((!p && !e) || std::lround(p.value_or(*(p ? p : e))) < 0)
        return refuse("M66 asks for P or E, the number of the input");
    }
    put_number(CanonicalMove::Kind::output, code);
  }
  if (const int code = block.code(MGroup::tool); code == 6) {
    if (auto no = not_compensating("the tool changes")) return no;
    modes_.spindle_direction = 0;
    if (auto no = change_tool(selected_tool_)) return no;
  } else if (code == 61) {
    const long number = std::lround(block.word('q').value_or(-1));
    if (number < 0) return refuse("M61 asks for Q, the number of the tool in the spindle");
    if (auto no = change_tool(static_cast<int>(number))) return no;
  }
  const int spindle = block.code(MGroup::spindle);
  if (block.spindle && *block.spindle != 0 && spindle != kNoCode)
    return refuse("this machine has one spindle; $ is 0");
  if (spindle == 3 || spindle == 4 || spindle == 5 || spindle == 19) {
    if (spindle == 19 && block.has('q') && *block.word('q') <= 0)
      return refuse("M19 takes a Q above 0, the time-out");
    modes_.spindle_direction = spindle == 3 ? 1 : spindle == 4 ? -1 : 0;
    put_number(CanonicalMove::Kind::spindle, spindle);
  } else if (spindle == 70 || spindle == 73) {
    frames.back().saved = modes_;
    frames.back().saved->tool_offset = offsets_.tool != AxisPoint{};
    frames.back().restore_on_return = spindle == 73 && frames.size() > 1;
  } else if (spindle == 71) {
    frames.back().saved.reset();
  } else if (spindle == 72) {
    if (!frames.back().saved)
      return refuse("M72 has nothing to restore; save the modes before with M70 or M73");
    if (auto no = restore(*frames.back().saved)) return no;
  }
  if (const int code = block.code(MGroup::coolant); code != kNoCode) {
    modes_.mist = code == 7 || (code == 8 && modes_.mist);
    modes_.flood = code == 8 || (code == 7 && modes_.flood);
    put_number(CanonicalMove::Kind::coolant, code);
  }
  if (const int code = block.code(MGroup::override_switch); code != kNoCode) {
    if (auto no = not_compensating("an override is switched")) return no;
    const bool on = code == 48 || (code != 49 && block.word('p').value_or(1) != 0);
    if (code <= 50) modes_.feed_override = on;
    if (code <= 49 || code == 51) modes_.speed_override = on;
    if (code == 52) modes_.adaptive_feed = on;
    if (code == 53) modes_.feed_hold = on;
    put_number(CanonicalMove::Kind::override_switch, code);
  }
  if (const int code = block.code(MGroup::user); code != kNoCode)
    return refuse("M" + std::to_string(code) +
                  " is a program of the machine's own, which is not known here; take it out or "
                  "write what it moves");
  return std::nullopt;
}

Refusal Machine::change_tool(int number) {
  // LinuxCNC asks the machine where it stands then: beside the contour, if G40 has just left it.
  if (after_exit_) position_ = offsets_.to_program(stands_);
  const auto found = tool(number, "the tool change");
  if (!found) return found.error();
  in_spindle_ = *found != nullptr ? **found : Tool{};
  in_spindle_.number = number;
  show_tool();
  put_number(CanonicalMove::Kind::tool, number);
  return std::nullopt;
}

Refusal Machine::restore(const Modes& saved) {
  if (auto no = not_compensating("modes are restored")) return no;
  Modes modes = saved;
  modes.motion = modes_.motion;  // what moves stays as it is
  modes.coordinate_system = modes_.coordinate_system;
  const bool turns = modes.spindle_direction != modes_.spindle_direction;
  if (auto no = switch_units(modes.unit_mm)) return no;
  modes_ = modes;
  if (turns)
    put_number(CanonicalMove::Kind::spindle, modes.spindle_direction == 0  ? 5
                                             : modes.spindle_direction > 0 ? 3
                                                                           : 4);
  const AxisPoint none{};
  if (saved.tool_offset != (offsets_.tool != none)) {
    AxisPoint offset{};
    if (saved.tool_offset) offset = offset_of(in_spindle_);
    use_tool_offset(offset);
  }
  return select_coordinate_system(saved.coordinate_system);
}

Refusal Machine::stop(int code) {
  flush();
  if (code == 2 || code == 30 || code == 99) return end_program();
  put_number(CanonicalMove::Kind::stop, code);
  return overflow_;
}

Refusal Machine::end_program() {
  flush();
  side_ = Side::none;
  modes_.spindle_direction = 0;
  put_number(CanonicalMove::Kind::end, 2);
  ended_ = true;
  return overflow_;
}

}  // namespace servosense::process
