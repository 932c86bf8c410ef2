// Words and numbers as the readers and writers of this room share them. Independent of the locale.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace servosense {

/// `text` without the blanks and tabs at both ends.
[[nodiscard]] std::string_view trim(std::string_view text) noexcept;

enum class NumberFault : std::uint8_t {
  none,
  not_a_number,  ///< something else stands there, or something follows the number
  infinite,      ///< spelled inf or infinity
  out_of_range,  ///< a number that no double (or the wanted integer) can hold
};

template <typename T>
struct ParsedNumber {
  T value = 0;
  NumberFault fault = NumberFault::none;
  [[nodiscard]] bool ok() const noexcept { return fault == NumberFault::none; }
};

/// A finite decimal number with `.`, optional sign and exponent, and nothing else.
[[nodiscard]] ParsedNumber<double> parse_number(std::string_view text) noexcept;

/// A whole number of up to 64 bits. One of the upper half of an unsigned 64-bit counter is returned
/// as its two's complement, so that differences stay exact.
[[nodiscard]] ParsedNumber<std::int64_t> parse_counts(std::string_view text) noexcept;

/// True for `nan` in any case, with or without a sign (as C's printf writes it).
[[nodiscard]] bool spells_nan(std::string_view text) noexcept;

/// Appends the shortest spelling that reads back as the same double; `nan` and `inf` as such.
void append_number(std::string& out, double value);
void append_integer(std::string& out, std::int64_t value);
[[nodiscard]] std::string number_text(double value);
/// Rounded for a sentence: `digits` that count, 1 to 17.
[[nodiscard]] std::string printed(double value, int digits = 4);

/// Length in bytes (1..4) of the well-formed UTF-8 character at the start of `text`, 0 if none.
[[nodiscard]] std::size_t utf8_length(std::string_view text) noexcept;

/// Whether `text` is well-formed UTF-8 without control characters.
[[nodiscard]] bool is_shown_as_written(std::string_view text) noexcept;

/// `text` fit for an error sentence: one line, bytes that cannot be shown as \xNN, long ones cut.
[[nodiscard]] std::string printable(std::string_view text, std::size_t longest = 60);
/// printable() between single quotes.
[[nodiscard]] std::string in_quotes(std::string_view text);

/// Levenshtein distance over the first 64 characters, upper and lower case taken as half a change
/// (so the result is in half changes).
[[nodiscard]] std::size_t edit_distance(std::string_view a, std::string_view b);

/// The candidate with the smallest edit distance, the first of equals; "" when there is none.
[[nodiscard]] std::string_view nearest_name(std::string_view name,
                                            std::span<const std::string_view> candidates);

}  // namespace servosense
