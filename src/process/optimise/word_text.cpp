#include "servosense/process/optimise/word_text.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>

namespace servosense::process {
namespace {

/// Behind the brackets, or the name, that open at `i`.
std::size_t behind_pair(std::string_view line, std::size_t i, char open, char close) {
  int depth = 0;
  for (; i < line.size(); ++i) {
    if (line[i] == open) ++depth;
    if (line[i] == close && --depth == 0) return i + 1;
  }
  return line.size();
}

/// Behind the value that begins at `i`; the same place: it is none of the plain ones.
std::size_t behind_value(std::string_view line, const std::size_t begin) {
  std::size_t i = begin;
  while (i < line.size() && line[i] == ' ') ++i;
  if (i >= line.size()) return begin;
  if (line[i] == '[') return behind_pair(line, i, '[', ']');
  if (line[i] == '#') {
    while (i < line.size() && line[i] == '#') ++i;
    if (i < line.size() && line[i] == '<') return behind_pair(line, i, '<', '>');
    if (i < line.size() && line[i] == '[') return behind_pair(line, i, '[', ']');
  }
  while (i < line.size() && (std::isdigit(static_cast<unsigned char>(line[i])) != 0 ||
                             line[i] == '.' || line[i] == '+' || line[i] == '-'))
    ++i;
  return i > begin && line[i - 1] != ' ' ? i : begin;
}

/// Calls f(place) for every character of the code outside comments, brackets and names.
template <typename F>
void each_code(std::string_view line, const F& f) {
  for (std::size_t i = 0; i < line.size();) {
    const char c = line[i];
    if (c == ';') return;
    if (c == '(')
      i = behind_pair(line, i, '(', ')');
    else if (c == '[')
      f(i), i = behind_pair(line, i, '[', ']'), f(i - 1);
    else if (c == '<')
      f(i), i = behind_pair(line, i, '<', '>'), f(i - 1);
    else
      f(i), ++i;
  }
}

}  // namespace

CodeWord code_word_of(std::string_view line, char letter) {
  CodeWord word;
  char before = ' ';
  each_code(line, [&](std::size_t i) {
    const char c = line[i];
    // The letters of a function, of an O word's keyword or of a comparison are no F.
    const bool alone =
        std::isalpha(static_cast<unsigned char>(before)) == 0 &&
        (i + 1 >= line.size() || std::isalpha(static_cast<unsigned char>(line[i + 1])) == 0);
    if (std::toupper(static_cast<unsigned char>(c)) == letter && !word.found()) {
      const std::size_t end = behind_value(line, i + 1);
      if (alone)
        word = {i, end, end > i + 1};
      else if (std::isalpha(static_cast<unsigned char>(before)) == 0)
        word = {i, i + 1, false};
    }
    if (c != ' ' && c != '\t') before = c;
  });
  return word;
}

std::string with_words(std::string_view text, char letter,
                       const std::map<std::size_t, std::string>& words) {
  std::string out;
  std::size_t number = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t found = text.find('\n', at);
    const std::size_t end = found == std::string_view::npos ? text.size() : found;
    const std::string_view line = text.substr(at, end - at);
    const auto found_word = words.find(++number);
    if (found_word == words.end()) {
      out += line;
    } else if (const CodeWord word = code_word_of(line, letter); word.found()) {
      out += line.substr(0, word.begin + 1);
      out += found_word->second;
      out += line.substr(word.end);
    } else {
      std::size_t last = 0;
      each_code(line, [&](std::size_t i) {
        if (std::isspace(static_cast<unsigned char>(line[i])) == 0) last = i + 1;
      });
      out += line.substr(0, last);
      out += letter + found_word->second;
      out += line.substr(last);
    }
    if (found != std::string_view::npos) out += '\n';
    at = end + 1;
  }
  return out;
}

std::string word_digits(double value) {
  const int digits = std::max(0, 4 - static_cast<int>(std::floor(std::log10(value))));
  const double scale = std::pow(10.0, digits);
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", digits, std::floor(value * scale * (1 + 1e-12)) / scale);
  std::string out = text;
  if (out.find('.') != std::string::npos) {
    out.erase(out.find_last_not_of('0') + 1);
    if (out.back() == '.') out.pop_back();
  }
  return out;
}

}  // namespace servosense::process
