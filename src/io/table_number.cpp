// Numbers of foreign tables: either decimal mark, thousands marks, words for a missing value.
#include <algorithm>
#include <array>
#include <string>

#include "servosense/io/table_file.hpp"
#include "servosense/io/text.hpp"
#include "table_layout.hpp"

namespace servosense {
namespace {

bool is_figure(char c) { return c >= '0' && c <= '9'; }

/// Length of a thousands mark that is no decimal mark: apostrophe, blanks of several widths.
std::size_t thousands_blank(std::string_view text) {
  using namespace std::string_view_literals;
  for (const std::string_view mark :
       {"'"sv, "\xC2\xA0"sv, "\xE2\x80\xAF"sv, "\xE2\x80\x89"sv, "\xE2\x80\x99"sv, " "sv})
    if (text.starts_with(mark)) return mark.size();
  return 0;
}

bool same_word(std::string_view text, std::string_view lower_word) {
  return text.size() == lower_word.size() &&
         std::equal(text.begin(), text.end(), lower_word.begin(), [](char a, char b) {
           return (a >= 'A' && a <= 'Z' ? static_cast<char>(a - 'A' + 'a') : a) == b;
         });
}

/// A field that a control or spreadsheet writes where it has no value.
bool spells_missing(std::string_view field) {
  if (spells_nan(field)) return true;
  if (std::all_of(field.begin(), field.end(), [](char c) { return c == '-' || c == '*'; }))
    return true;
  constexpr auto kWords = std::to_array<std::string_view>(
      {"n/a",          "na",          "#n/a",    "#nv",      "n.a.",
       "n.v.",         "null",        "none",    "nil",      "?",
       "inf",          "-inf",        "+inf",    "infinity", "-infinity",
       "1.#ind",       "-1.#ind",     "1.#qnan", "1.#inf",   "-1.#inf",
       "overflow",     "ovf",         "bad",     "invalid",  "ung\xC3\xBCltig",
       "fehler",       "error",       "#wert!",  "#value!",  "#div/0!",
       "\xE2\x80\x93", "\xE2\x88\x9E"});
  return std::any_of(kWords.begin(), kWords.end(),
                     [&](std::string_view word) { return same_word(field, word); });
}

}  // namespace

std::string plain_number(std::string_view field, DecimalMark mark) {
  const char decimal = mark == DecimalMark::point ? '.' : ',';
  const char thousands = mark == DecimalMark::point ? ',' : '.';
  std::string out;
  if (!field.empty() && (field[0] == '+' || field[0] == '-')) {
    if (field[0] == '-') out = "-";
    field.remove_prefix(1);
  } else if (field.starts_with("\xE2\x88\x92")) {
    out = "-";
    field.remove_prefix(3);
  }
  std::size_t in_group = 0;
  bool grouped = false;
  while (!field.empty()) {
    if (is_figure(field[0])) {
      out += field[0];
      ++in_group;
      field.remove_prefix(1);
      continue;
    }
    const std::size_t mark_size = field[0] == thousands ? 1 : thousands_blank(field);
    if (mark_size == 0) break;
    // One to three digits before the first mark, three between and behind them.
    if (in_group == 0 || in_group > 3 || (grouped && in_group != 3)) return {};
    grouped = true;
    in_group = 0;
    field.remove_prefix(mark_size);
  }
  if (grouped && in_group != 3) return {};
  bool digits = in_group > 0;
  if (!field.empty() && field[0] == decimal) {
    out += '.';
    field.remove_prefix(1);
    while (!field.empty() && is_figure(field[0])) {
      digits = true;
      out += field[0];
      field.remove_prefix(1);
    }
  }
  if (!digits) return {};
  if (!field.empty() && (field[0] == 'e' || field[0] == 'E')) {
    out += 'e';
    field.remove_prefix(1);
    if (!field.empty() && (field[0] == '+' || field[0] == '-')) {
      if (field[0] == '-') out += '-';
      field.remove_prefix(1);
    }
    if (field.empty()) return {};
    while (!field.empty() && is_figure(field[0])) {
      out += field[0];
      field.remove_prefix(1);
    }
  }
  return field.empty() ? out : std::string();
}

TableNumber table_number(std::string_view field, DecimalMark mark) {
  using State = TableNumber::State;
  if (field.empty()) return {State::empty, 0};
  if (mark == DecimalMark::point)
    if (const auto number = parse_number(field); number.ok()) return {State::value, number.value};
  if (is_figure(field.back()) || field.back() == '.' || field.back() == ',') {
    const std::string plain = plain_number(field, mark);
    if (!plain.empty()) {
      const auto number = parse_number(plain);
      if (number.ok()) return {State::value, number.value};
      return {number.fault == NumberFault::out_of_range ? State::invalid : State::text, 0};
    }
  }
  return {spells_missing(field) ? State::invalid : State::text, 0};
}

namespace detail {

void MarkEvidence::take(std::string_view field) {
  if (field.size() > 40) return;
  std::size_t points = 0, commas = 0;
  for (const char c : field) {
    points += c == '.' ? 1U : 0U;
    commas += c == ',' ? 1U : 0U;
  }
  if (points + commas == 0) return;
  const bool as_point = !plain_number(field, DecimalMark::point).empty();
  const bool as_comma = !plain_number(field, DecimalMark::comma).empty();
  if (as_point && as_comma) {
    // "1,234" and "1.234" alike; a number of thousands does not begin with a zero.
    const std::size_t figure = field.find_first_of("0123456789");
    if (figure != std::string_view::npos && field[figure] == '0')
      ++(points > 0 ? point : comma);
    else if (open++ == 0)
      example = field;
    (points > 0 ? open_points : open_commas) += 1;
  } else if (as_point) {
    ++point;
  } else if (as_comma) {
    ++comma;
  }
}

}  // namespace detail
}  // namespace servosense
