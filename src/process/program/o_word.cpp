// Reading a line with an O word, M98 or M99. Expressions are worked out where the line is carried
// out, and left alone where it is passed over.
#include <algorithm>
#include <cmath>

#include "flow.hpp"
#include "servosense/io/text.hpp"

namespace servosense::process {
// ---------------------------------------------------------------------------

Expected<Flow::OWord> Flow::read_o_word(Cursor& cursor) const {
  OWord o;
  if (cursor.take("m98")) {
    o.word = Word::call_98;
    const auto block = read_block(cursor, machine_);
    if (!block) return block.error();
    const auto p = block->word('p');
    if (!p || std::abs(*p - std::round(*p)) > kEqualNumbers || std::abs(*p) > 1e9)
      return data_error("M98 asks for P, the number of the subroutine");
    o.name = std::to_string(std::lround(*p));
    if (const auto l = block->word('l')) o.repeats = std::lround(std::clamp(*l, -1.0, 1e9));
    if (skips()) o.word = Word::none;
    return o;
  }
  if (cursor.take("m99")) {
    o.word = Word::return_99;
    o.name = calls_.back().name;
    return o;
  }
  cursor.take("o");
  std::string name;
  if (cursor.next() == '<') {
    auto found = read_name(cursor);
    if (!found) return found.error();
    name = std::move(*found);
  } else {
    const auto number = read_whole(cursor, machine_);
    if (!number) return number.error();
    name = std::to_string(*number);
  }
  static constexpr std::pair<std::string_view, Word> kWords[] = {
      {"sub", Word::sub},           {"endsub", Word::endsub},       {"call", Word::call},
      {"do", Word::loop_do},        {"while", Word::loop_while},    {"repeat", Word::repeat},
      {"if", Word::when},           {"elseif", Word::elsewhen},     {"else", Word::otherwise},
      {"endif", Word::endwhen},     {"break", Word::leave},         {"continue", Word::next_turn},
      {"endwhile", Word::endwhile}, {"endrepeat", Word::endrepeat}, {"return", Word::back}};
  for (const auto& [text, word] : kWords)
    if (cursor.take(text)) {
      o.word = word;
      break;
    }
  if (o.word == Word::none) {
    if (!cursor.at_end() && cursor.next() != '(')
      return data_error(
          "O is followed by SUB, CALL, IF, WHILE, DO, REPEAT or what ends them, not by " +
          in_quotes(cursor.line.substr(cursor.at, 12)));
    o.word = Word::number;
  }
  const bool global = o.word == Word::sub || o.word == Word::endsub || o.word == Word::call ||
                      o.word == Word::back || o.word == Word::number;
  o.name = global ? name : scope() + "#" + name;
  if ((o.word == Word::sub || o.word == Word::number) && defining_)
    return data_error("a subroutine is defined within subroutine O" + defined_ +
                      "; end that before");

  const bool passed_over = skips() && skipping_ != o.name;
  const auto condition = [&](const char* what) -> Refusal {
    if (cursor.next() != '[')
      return refuse(std::string(what) + " asks for its condition in brackets");
    const auto value = read_bracket(cursor, machine_);
    if (!value) return value.error();
    o.value = *value;
    return std::nullopt;
  };
  switch (o.word) {
    case Word::endsub:
    case Word::back:
      if (passed_over) return o;
      if (cursor.next() == '[') {
        if (skips() || (calls_.empty() && defining_)) return o;  // is not carried out here
        if (auto no = condition("RETURN")) return *no;
        o.has_value = true;
      }
      break;
    case Word::sub:
    case Word::number:
      break;
    default:
      if (defining_) {
        o.word = Word::none;
        return o;
      }
      if (o.word == Word::call) {
        if (skips()) {
          o.word = Word::none;
          return o;
        }
        while (cursor.next() == '[' || cursor.next() == '(') {
          if (cursor.next() == '(') {
            cursor.at = std::min(cursor.line.find(')', cursor.at), cursor.line.size() - 1) + 1;
            continue;
          }
          const auto value = read_bracket(cursor, machine_);
          if (!value) return value.error();
          if (o.arguments.size() == kCallArguments)
            return data_error("a call takes " + std::to_string(kCallArguments) +
                              " arguments at most");
          o.arguments.push_back(*value);
        }
      } else if (o.word == Word::loop_while || o.word == Word::repeat || o.word == Word::when ||
                 o.word == Word::elsewhen) {
        if (passed_over) return o;
        const char* names[] = {"WHILE", "REPEAT", "IF", "ELSEIF"};
        const std::size_t which = o.word == Word::loop_while ? 0U
                                  : o.word == Word::repeat   ? 1U
                                  : o.word == Word::when     ? 2U
                                                             : 3U;
        if (auto no = condition(names[which])) return *no;
      }
  }
  while (cursor.next() == '(')
    cursor.at = std::min(cursor.line.find(')', cursor.at), cursor.line.size() - 1) + 1;
  if (!cursor.at_end() && !passed_over)
    return data_error("nothing more stands on a line with an O word, but " +
                      in_quotes(cursor.line.substr(cursor.at, 12)) + " does");
  return o;
}

}  // namespace servosense::process
