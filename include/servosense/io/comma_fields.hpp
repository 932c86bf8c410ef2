// The fields of a line that commas separate, without quotes: as this project's own tables have
// them. Tables of others: table_file.hpp.
#pragma once

#include <cstddef>
#include <string_view>
#include <vector>

#include "servosense/io/text.hpp"

namespace servosense {

/// Trimmed, one more than there are commas; they point into `line`.
[[nodiscard]] inline std::vector<std::string_view> comma_fields(std::string_view line) {
  std::vector<std::string_view> fields;
  for (;;) {
    const std::size_t comma = line.find(',');
    fields.push_back(trim(line.substr(0, comma)));
    if (comma == std::string_view::npos) return fields;
    line.remove_prefix(comma + 1);
  }
}

}  // namespace servosense
