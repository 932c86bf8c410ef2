// Coordinate systems, G92, reference points, tool lengths and the tool table.
#include <algorithm>
#include <cmath>

#include "machine.hpp"
#include "servosense/io/text.hpp"

namespace servosense::process {
namespace {

/// Place of a coordinate system's first parameter: x y z a b c u v w, then its rotation.
std::size_t system_parameter(int system) { return 5201 + 20 * static_cast<std::size_t>(system); }

AxisPoint nine(const std::vector<double>& parameters, std::size_t first) {
  AxisPoint point;
  std::copy_n(parameters.begin() + static_cast<std::ptrdiff_t>(first), point.size(), point.begin());
  return point;
}

void keep_nine(std::vector<double>& parameters, std::size_t first, const AxisPoint& point) {
  std::copy(point.begin(), point.end(), parameters.begin() + static_cast<std::ptrdiff_t>(first));
}

}  // namespace

void Machine::load_work_offset() {
  const std::size_t first = system_parameter(modes_.coordinate_system);
  offsets_.work = nine(parameters, first);
  offsets_.rotation_deg = parameters[first + 9];
}

Refusal Machine::select_coordinate_system(int number) {
  if (auto no = not_compensating("the coordinate system changes")) return no;
  if (number == modes_.coordinate_system) return std::nullopt;
  const AxisPoint place = offsets_.to_machine(position_);
  modes_.coordinate_system = number;
  parameters[5220] = number;
  load_work_offset();
  position_ = offsets_.to_program(place);
  return std::nullopt;
}

Refusal Machine::once(const Block& block, int code) {
  switch (code) {
    case 100: {
      const long l = std::lround(*block.word('l'));
      if (l == 0) {
        tools_ = options_.tools;
        return std::nullopt;
      }
      return l == 2 || l == 20 ? set_work_offset(block) : set_tool_entry(block);
    }
    case 280:
    case 300:
      return go_home(block, code);
    case 281:
    case 301:
      if (auto no = not_compensating("a reference point is set")) return no;
      save_home(code);
      return std::nullopt;
    case 520:
    case 920:
    case 921:
    case 922:
    case 923:
      return set_shift(block, code);
    default:
      return std::nullopt;  // G4 and G53 are done elsewhere
  }
}

Refusal Machine::set_work_offset(const Block& block) {
  if (block.has_any("ij")) return refuse("I and J do not go with G10 L2 and L20");
  const bool from_here = std::lround(*block.word('l')) == 20;
  int system = static_cast<int>(std::lround(block.word('p').value_or(0)));
  if (system == 0) system = modes_.coordinate_system;
  const bool in_use = system == modes_.coordinate_system;
  if (in_use)
    if (auto no = not_compensating("the coordinate system in use changes")) return no;
  if (from_here && block.has('r')) return refuse("R does not go with G10 L20");
  const std::size_t first = system_parameter(system);
  const double rotation = block.word('r').value_or(parameters[first + 9]);
  AxisPoint work = nine(parameters, first);
  // Where the tool stands in that system, as it is before.
  Offsets there = offsets_;
  there.work = work;
  there.rotation_deg = parameters[first + 9];
  AxisPoint stands = there.to_program(offsets_.to_machine(position_)), wanted = stands;
  for (std::size_t i = 0; i < work.size(); ++i)
    if (const auto word = block.word(kAxisLetters[i])) {
      const double value = *word * (is_rotary(i) ? 1 : modes_.unit_mm);
      if (from_here)
        wanted[i] = value;
      else
        work[i] = value;
    }
  if (from_here) {
    rotate(stands, rotation);
    rotate(wanted, rotation);
    for (std::size_t i = 0; i < work.size(); ++i) work[i] += stands[i] - wanted[i];
  }
  keep_nine(parameters, first, work);
  parameters[first + 9] = rotation;
  if (!in_use) return std::nullopt;
  // As LinuxCNC does it, with G92 left out of the turn.
  rotate(position_, offsets_.rotation_deg);
  for (std::size_t i = 0; i < work.size(); ++i) position_[i] += offsets_.work[i] - work[i];
  rotate(position_, -rotation);
  load_work_offset();
  return std::nullopt;
}

Refusal Machine::set_shift(const Block& block, int code) {
  AxisPoint shift = offsets_.shift;
  if (code == 920 || code == 520) {
    if (auto no = not_compensating("offsets change")) return no;
    for (std::size_t i = 0; i < shift.size(); ++i)
      if (const auto word = block.word(kAxisLetters[i])) {
        const double value = *word * (is_rotary(i) ? 1 : modes_.unit_mm);
        shift[i] = code == 520 ? value : position_[i] + shift[i] - value;
      }
  } else {
    shift = code == 923 ? nine(parameters, 5211) : AxisPoint{};
  }
  if (shift != offsets_.shift)
    if (auto no = not_compensating("offsets change")) return no;
  for (std::size_t i = 0; i < shift.size(); ++i) position_[i] += offsets_.shift[i] - shift[i];
  offsets_.shift = shift;
  parameters[5210] = code == 921 || code == 922 ? 0 : 1;
  if (code != 922 && code != 923) keep_nine(parameters, 5211, shift);
  return std::nullopt;
}

Refusal Machine::go_home(const Block& block, int code) {
  const auto middle = ends(block);
  if (!middle) return middle.error();
  if (auto no = not_compensating((code_name(code) + " goes to the reference point").c_str()))
    return no;
  go(CanonicalMove::Kind::rapid, *middle, 0);
  const AxisPoint home = offsets_.to_program(nine(parameters, code == 280 ? 5161 : 5181));
  const bool all = !block.has_any(kAxisLetters);
  AxisPoint end = *middle;
  for (std::size_t i = 0; i < end.size(); ++i)
    if (all || block.has(kAxisLetters[i])) end[i] = home[i];
  go(CanonicalMove::Kind::rapid, end, 0);
  return std::nullopt;
}

void Machine::save_home(int code) {
  keep_nine(parameters, code == 281 ? 5161 : 5181, offsets_.to_machine(position_));
}

// ---- tools
// ---------------------------------------------------------------------------------------

Expected<const Tool*> Machine::tool(long number, const char* what) const {
  const Tool* none = nullptr;
  if (number < 0) return data_error(std::string("there is no tool ") + std::to_string(number));
  if (number == 0 || !tools_) return none;
  const auto found = tools_->find(static_cast<int>(number));
  if (found == tools_->end())
    return data_error(std::string(what) + " asks for tool " + std::to_string(number) +
                      ", which is not in the tool table; add it there");
  return &found->second;
}

Expected<Tool*> Machine::tool_entry(long number) {
  if (!tools_) tools_.emplace();
  const auto found = tools_->find(static_cast<int>(number));
  if (found != tools_->end()) return &found->second;
  if (options_.tools)
    return data_error("G10 changes tool " + std::to_string(number) +
                      ", which is not in the tool table; add it there");
  Tool& made = (*tools_)[static_cast<int>(number)];
  made.number = static_cast<int>(number);
  return &made;
}

AxisPoint offset_of(const Tool& tool) {
  AxisPoint offset = tool.offset;
  for (std::size_t i = 0; i < offset.size(); ++i)
    if (!is_rotary(i)) offset[i] *= 1000;
  return offset;
}

void Machine::show_tool() {
  parameters[5400] = in_spindle_.number;
  keep_nine(parameters, 5401, offset_of(in_spindle_));
  parameters[5410] = in_spindle_.diameter_m * 1000;
  parameters[5411] = in_spindle_.front_angle_deg;
  parameters[5412] = in_spindle_.back_angle_deg;
  parameters[5413] = in_spindle_.orientation;
}

Refusal Machine::set_tool_entry(const Block& block) {
  const long l = std::lround(*block.word('l'));
  const auto found = tool_entry(std::lround(block.word('p').value_or(0)));
  if (!found) return found.error();
  if (!block.has_any(kAxisLetters) && !block.has_any("rqij"))
    return refuse("G10 L" + std::to_string(l) +
                  " sets axes, R, I, J or Q of a tool, and none is given");
  Tool& tool = **found;
  AxisPoint offset = offset_of(tool);
  AxisPoint given{};
  std::array<bool, 9> has{};
  for (std::size_t i = 0; i < offset.size(); ++i)
    if (const auto word = block.word(kAxisLetters[i])) {
      given[i] = *word * (is_rotary(i) ? 1 : modes_.unit_mm);
      has[i] = true;
    }
  if (l == 1) {
    for (std::size_t i = 0; i < offset.size(); ++i)
      if (has[i]) offset[i] = given[i];
  } else {
    // Such that the tool stands at the given place, in the system in use or, L11, in G59.3 without
    // G92.
    Offsets there = offsets_;
    if (l == 11) {
      there.work = nine(parameters, system_parameter(9));
      there.rotation_deg = parameters[system_parameter(9) + 9];
      there.shift = {};
    }
    there.tool = {};
    AxisPoint wanted = there.to_program(offsets_.to_machine(position_));
    AxisPoint kept = offset;
    rotate(kept, -there.rotation_deg);
    for (std::size_t i = 0; i < offset.size(); ++i)
      wanted[i] = has[i] ? wanted[i] - given[i] : kept[i];
    rotate(wanted, there.rotation_deg);
    offset = wanted;
    if (!has[kX] && !has[kY]) {
      for (const std::size_t i : {kX, kY}) offset[i] = tool.offset[i] * 1000;
    }
  }
  for (std::size_t i = 0; i < offset.size(); ++i)
    tool.offset[i] = offset[i] / (is_rotary(i) ? 1 : 1000);
  if (block.has('r')) tool.diameter_m = 2 * *block.word('r') * modes_.unit_mm / 1000;
  if (block.has('i')) tool.front_angle_deg = *block.word('i');
  if (block.has('j')) tool.back_angle_deg = *block.word('j');
  if (const auto q = block.word('q')) {
    if (std::abs(*q - std::round(*q)) > kEqualNumbers || *q > 9.5)
      return refuse("Q of G10 is the orientation of a tool, 0 to 9");
    tool.orientation = static_cast<int>(std::lround(*q));
  }
  if (in_spindle_.number == tool.number) in_spindle_ = tool;
  show_tool();
  return std::nullopt;
}

void Machine::use_tool_offset(const AxisPoint& offset) {
  const AxisPoint place = offsets_.to_machine(position_);
  offsets_.tool = offset;
  const AxisPoint turned = offsets_.to_program(place);
  // Axes that keep their offset stay exactly where they are.
  position_ = turned;
}

Refusal Machine::tool_length(const Block& block, int code) {
  if (auto no = not_compensating("the tool length changes")) return no;
  AxisPoint offset{};
  if (code == 430 || code == 432) {
    if (code == 432 && !block.has('h') && !block.has_any(kAxisLetters))
      return refuse("G43.2 asks for H, the tool whose length is added");
    Tool used = in_spindle_;
    if (const auto h = block.word('h')) {
      const auto found = tool(std::lround(*h), "H");
      if (!found) return found.error();
      used = *found != nullptr ? **found : Tool{};
      if (std::lround(*h) == 0) used = in_spindle_;
    } else if (code == 432) {
      used = Tool{};
    }
    offset = offset_of(used);
    if (code == 432)
      for (std::size_t i = 0; i < offset.size(); ++i) offset[i] += offsets_.tool[i];
  } else if (code == 431) {
    offset = offsets_.tool;
  }
  if (code == 431 || code == 432)
    for (std::size_t i = 0; i < offset.size(); ++i)
      if (const auto word = block.word(kAxisLetters[i])) {
        const double value = *word * (is_rotary(i) ? 1 : modes_.unit_mm);
        offset[i] = code == 431 ? value : offset[i] + value;
      }
  use_tool_offset(offset);
  return std::nullopt;
}

}  // namespace servosense::process
