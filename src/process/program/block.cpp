#include "servosense/process/program/block.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/io/text.hpp"
#include "servosense/process/program/limits.hpp"

namespace servosense::process {
namespace {

std::optional<GGroup> g_group(int code) {
  struct Member {
    GGroup group;
    std::array<int, 24> codes;  // the rest 0
  };
  static constexpr std::array<Member, 14> kMembers = {
      {{GGroup::once, {40, 100, 280, 281, 300, 301, 520, 530, 920, 921, 922, 923}},
       {GGroup::motion, {10,  20,  30,  330, 331, 730, 740, 760, 800, 810, 820, 830,
                         840, 850, 860, 870, 880, 890, 382, 383, 384, 385, 50,  51}},
       {GGroup::plane, {170, 180, 190, 171, 181, 191}},
       {GGroup::distance, {900, 910}},
       {GGroup::arc_distance, {901, 911}},
       {GGroup::feed_mode, {930, 940, 950}},
       {GGroup::units, {200, 210}},
       {GGroup::cutter_compensation, {400, 410, 420, 411, 421}},
       {GGroup::tool_length, {430, 431, 432, 490}},
       {GGroup::retract, {980, 990}},
       {GGroup::coordinate_system, {540, 550, 560, 570, 580, 590, 591, 592, 593}},
       {GGroup::path_control, {610, 611, 640}},
       {GGroup::spindle_mode, {960, 970}},
       {GGroup::motion, {52, 700, 710, 711, 712, 720, 721, 722}}}};
  if (code == 0) return GGroup::motion;
  for (const Member& member : kMembers)
    if (std::find(member.codes.begin(), member.codes.end(), code) != member.codes.end())
      return member.group;
  return std::nullopt;
}

std::optional<MGroup> m_group(long code) {
  switch (code) {
    case 0:
    case 1:
    case 2:
    case 30:
    case 60:
    case 99:
      return MGroup::stop;
    case 62:
    case 63:
    case 64:
    case 65:
    case 66:
    case 67:
    case 68:
      return MGroup::input_output;
    case 6:
    case 61:
      return MGroup::tool;
    case 3:
    case 4:
    case 5:
    case 19:
    case 70:
    case 71:
    case 72:
    case 73:
      return MGroup::spindle;
    case 7:
    case 8:
    case 9:
      return MGroup::coolant;
    case 48:
    case 49:
    case 50:
    case 51:
    case 52:
    case 53:
      return MGroup::override_switch;
    default:
      break;
  }
  if (code >= 100 && code <= 199) return MGroup::user;
  return std::nullopt;
}

std::string upper(char letter) { return {static_cast<char>(letter - 'a' + 'A')}; }

/// Puts a G word into its group.
std::optional<Error> put_g(Block& block, double value) {
  if (value < 0) return data_error("a G code is not negative");
  const double tenths = std::round(value * 10);
  if (std::abs(value * 10 - tenths) > 1e-3 || tenths > 999)
    return data_error("there is no G" + number_text(value));
  const int code = static_cast<int>(tenths);
  const auto group = g_group(code);
  if (!group)
    return data_error("there is no " + code_name(code) +
                      " on a mill under LinuxCNC; take the line out or put what it means there");
  int& slot = block.g[static_cast<std::size_t>(*group)];
  if (slot != kNoCode)
    return data_error(code_name(slot) + " and " + code_name(code) +
                      " are of one modal group; put them on two lines");
  slot = code;
  return std::nullopt;
}

std::optional<Error> put_m(Block& block, long code, int& count) {
  const auto group = m_group(code);
  if (!group) return data_error("there is no M" + std::to_string(code) + " under LinuxCNC");
  int& slot = block.m[static_cast<std::size_t>(*group)];
  if (slot != kNoCode)
    return data_error("M" + std::to_string(slot) + " and M" + std::to_string(code) +
                      " are of one modal group; put them on two lines");
  slot = static_cast<int>(code);
  if (++count > kMostMCodes)
    return data_error("more than " + std::to_string(kMostMCodes) + " M codes stand on one line");
  return std::nullopt;
}

/// `#5=1`, `#<name>=1`, without the `#`.
std::optional<Error> put_assignment(Block& block, Cursor& cursor, const ParameterValues& values) {
  Block::Assignment assignment;
  if (cursor.next() == '<') {
    const auto name = read_name(cursor);
    if (!name) return name.error();
    assignment.parameter = *name;
  } else {
    const auto index = read_whole(cursor, values);
    if (!index) return index.error();
    if (*index < 1 || *index > kLastParameter)
      return data_error("there is no parameter #" + std::to_string(*index) + "; they are #1 to #" +
                        std::to_string(kLastParameter));
    if (*index >= kFirstReadOnlyParameter && *index <= kLastReadOnlyParameter)
      return data_error("#" + std::to_string(*index) + " is kept by the machine and cannot be set");
    assignment.parameter = *index;
  }
  if (!cursor.take("=")) return data_error("a parameter stands alone; set it with '='");
  const auto value = read_value(cursor, values);
  if (!value) return value.error();
  assignment.value = *value;
  block.assignments.push_back(std::move(assignment));
  return std::nullopt;
}

}  // namespace

std::string code_name(int g_code) {
  std::string name = "G" + std::to_string(g_code / 10);
  if (g_code % 10 != 0) name += "." + std::to_string(g_code % 10);
  return name;
}

bool Block::has_any(std::string_view letters) const {
  return std::any_of(letters.begin(), letters.end(), [&](char c) { return has(c); });
}

Expected<std::string> tidy_line(std::string_view line) {
  if (line.size() >= kLongestProgramLine)
    return data_error("the line is longer than " + std::to_string(kLongestProgramLine - 1) +
                      " characters, which a control does not read; break it");
  std::string tidy;
  bool comment = false;
  for (const char c : line) {
    if (!comment && c == ';') break;
    if (comment) {
      if (c == '(') return data_error("a comment stands within a comment");
      comment = c != ')';
      tidy += c;
    } else if (c == ' ' || c == '\t' || c == '\r') {
      continue;
    } else {
      comment = c == '(';
      tidy += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    }
  }
  if (comment) return data_error("a comment is not closed; a ')' is missing");
  return tidy;
}

Expected<Block> read_block(Cursor& cursor, const ParameterValues& values) {
  Block block;
  int m_count = 0;
  while (!cursor.at_end()) {
    const char c = cursor.next();
    if (c == '(') {
      const std::size_t end = cursor.line.find(')', cursor.at);
      if (end == std::string_view::npos) return data_error("a comment is not closed");
      block.comment = cursor.line.substr(cursor.at + 1, end - cursor.at - 1);
      cursor.at = end + 1;
      continue;
    }
    ++cursor.at;
    if (c == '#') {
      if (auto error = put_assignment(block, cursor, values)) return *error;
      continue;
    }
    std::optional<double>* slot = nullptr;
    if (c == '@') slot = &block.polar_radius;
    if (c == '^') slot = &block.polar_angle_deg;
    if (c == '$') slot = &block.spindle;
    const bool letter = c >= 'a' && c <= 'z';
    if (letter && c != 'n' && c != 'o') slot = &block.words[static_cast<std::size_t>(c - 'a')];
    if (slot == nullptr)
      return data_error("a word is expected where " +
                        in_quotes(cursor.line.substr(cursor.at - 1, 12)) + " stands");
    if (c == 'm') {
      const auto code = read_whole(cursor, values);
      if (!code) return code.error();
      if (auto error = put_m(block, *code, m_count)) return *error;
      continue;
    }
    const auto value = read_value(cursor, values);
    if (!value) return value.error();
    if (c == 'g') {
      if (auto error = put_g(block, *value)) return *error;
      continue;
    }
    if (*slot)
      return data_error((letter ? upper(c) : std::string(1, c)) + " stands twice on one line");
    *slot = *value;
  }
  return block;
}

}  // namespace servosense::process
