// The common form of map files: settings `name = value`, then a table under a heading.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/io/line_reader.hpp"

namespace servosense::detail {

struct MapTable {
  struct Setting {
    std::string name, value;
    std::size_t line = 0;
  };
  struct Row {
    std::vector<std::string> cell;  ///< by column of the format; "" where left out
    std::size_t line = 0;
  };
  std::string name;
  std::vector<Setting> settings;
  std::vector<Row> rows;

  /// `columns`: names of the format, the first `required` of which the heading must have; only the
  /// first of all if it has the column `instead`.
  static Expected<MapTable> read(LineReader lines, std::span<const std::string_view> columns,
                                 std::size_t required, std::span<const std::string_view> settings,
                                 std::string_view instead = {});
  [[nodiscard]] Error error_at(std::size_t line, const std::string& what) const;
};

std::optional<std::uint32_t> parse_unsigned(std::string_view text, int base = 10);
/// A product of numbers, such as 0.001*8.5.
std::optional<double> parse_product(std::string_view text);
/// A trace column; the error says which name is nearest.
Expected<Signal> parse_signal(std::string_view text, std::string_view others);
/// A servo period of 1e-6 to 10 s.
std::optional<std::int64_t> parse_period_ns(std::string_view text);

}  // namespace servosense::detail
