// F and S words in the text of an NC program: where they stand, and the same text with others.
//
// Everything else stays as it is, byte by byte: a word that is changed keeps its place, one that is
// added stands behind the last word of its line, without a blank.
#pragma once

#include <map>
#include <string>
#include <string_view>

#include "servosense/core/expected.hpp"

namespace servosense::process {

/// A word of a line; a position behind the text: there is none.
struct CodeWord {
  std::size_t begin = std::string_view::npos;  ///< of the letter
  std::size_t end = 0;                         ///< behind the value
  bool plain = true;  ///< a number, a parameter or brackets; else it is not understood
  [[nodiscard]] bool found() const { return begin != std::string_view::npos; }
};
/// Outside comments, brackets and names. `letter` in capitals.
[[nodiscard]] CodeWord code_word_of(std::string_view line, char letter);

/// `text` with the word `letter` of each line, from 1, that `words` names.
[[nodiscard]] std::string with_words(std::string_view text, char letter,
                                     const std::map<std::size_t, std::string>& words);

/// Five digits, and not more than `value`, above 0.
[[nodiscard]] std::string word_digits(double value);

}  // namespace servosense::process
