// IF, GOTO, WHILE and DO of Fanuc's macro language.
#include <cmath>

#include "flow.hpp"
#include "servosense/io/text.hpp"

namespace servosense::process {
namespace {

/// Number of a line `N...` of the tidy text, -1 without.
long line_number(std::string_view line) {
  if (line.starts_with('/')) line.remove_prefix(1);
  if (!line.starts_with('n')) return -1;
  long number = -1;
  for (std::size_t i = 1;
       i < line.size() && line[i] >= '0' && line[i] <= '9' && number < 100'000'000; ++i)
    number = std::max(number, 0L) * 10 + (line[i] - '0');
  return number;
}

std::string_view behind_number(std::string_view line) {
  if (line.starts_with('/')) line.remove_prefix(1);
  if (!line.starts_with('n')) return line;
  std::size_t i = 1;
  while (i < line.size() && line[i] >= '0' && line[i] <= '9') ++i;
  return line.substr(i);
}

}  // namespace

Refusal Flow::go_to(long number) {
  const auto& lines = here_.file->lines();
  // From here on, then from the top, as the control seeks.
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const std::size_t at = (here_.next + i) % lines.size();
    const auto tidy = tidy_line(lines[at]);
    if (!tidy || line_number(*tidy) != number) continue;
    here_.next = at;
    return std::nullopt;
  }
  return refuse("GOTO " + std::to_string(number) + " leads nowhere; there is no line N" +
                std::to_string(number));
}

Refusal Flow::skip_loop(long number) {
  const auto& lines = here_.file->lines();
  const std::string end = "end" + std::to_string(number);
  for (std::size_t at = here_.next; at < lines.size(); ++at) {
    const auto tidy = tidy_line(lines[at]);
    if (!tidy) continue;
    const std::string_view line = behind_number(*tidy);
    if (line != end && !line.starts_with(end + "(")) continue;
    here_.next = at + 1;
    return std::nullopt;
  }
  return refuse("DO " + std::to_string(number) + " has no END " + std::to_string(number) +
                " after it");
}

Expected<bool> Flow::fanuc_line(Cursor& cursor) {
  const auto whole = [&](const char* what) -> Expected<long> {
    auto number = read_whole(cursor, machine_);
    if (!number)
      return data_error(std::string(what) + " asks for a number: " + number.error().sentence);
    return *number;
  };
  const auto done = [](const Refusal& no) -> Expected<bool> {
    if (no) return *no;
    return true;
  };
  if (cursor.take("if")) {
    const auto condition = read_bracket(cursor, machine_);
    if (!condition) return condition.error();
    if (cursor.take("then")) {
      if (*condition == 0) return true;
      return false;  // the rest is an ordinary line
    }
    if (!cursor.take("goto")) return data_error("IF [...] is followed by GOTO or THEN");
    const auto number = whole("GOTO");
    if (!number) return number.error();
    return *condition == 0 ? Expected<bool>(true) : done(go_to(*number));
  }
  if (cursor.take("goto")) {
    const auto number = whole("GOTO");
    if (!number) return number.error();
    return done(go_to(*number));
  }
  const bool waits = cursor.take("while");
  double condition = 1;
  if (waits) {
    const auto value = read_bracket(cursor, machine_);
    if (!value) return value.error();
    condition = *value;
  }
  if (cursor.take("do")) {
    const auto number = whole("DO");
    if (!number) return number.error();
    // A loop left by GOTO is over once its number begins another.
    for (std::size_t i = 0; i < loops_.size(); ++i)
      if (loops_[i].number == *number) loops_.resize(i);
    if (condition == 0) return done(skip_loop(*number));
    loops_.push_back({*number, {here_.file, here_.next - 1}});
    return true;
  }
  if (waits) return data_error("WHILE [...] is followed by DO and its number");
  if (cursor.take("end")) {
    const auto number = whole("END");
    if (!number) return number.error();
    while (!loops_.empty() && loops_.back().number != *number) loops_.pop_back();
    if (loops_.empty())
      return data_error("END " + std::to_string(*number) + " has no DO " + std::to_string(*number) +
                        " before it");
    here_ = loops_.back().at;
    loops_.pop_back();
    return true;
  }
  return false;
}

}  // namespace servosense::process
