// Two recorded columns at one rate: the rows in which both have a new value.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/trace.hpp"

namespace servosense::cli {

/// A column of a trace, or of the estimates beside it.
struct FoundColumn {
  const Trace* trace = nullptr;
  std::size_t at = 0;
  [[nodiscard]] bool updated(std::size_t row) const { return trace->updated[at][row]; }
  [[nodiscard]] double value(std::size_t row) const { return trace->columns[at][row]; }
};

struct CommonRows {
  double begin_s = 0, sample_rate_hz = 0;
  std::vector<double> first, second;
};

/// What is done with a value that is no number. Rows before both columns have begun never count.
enum class NoNumber { refuse, keep };

/// Data error when the columns have different rates, or a row is missing or late.
Expected<CommonRows> common_rows(const std::string& path, const Trace& trace,
                                 const FoundColumn& first, const FoundColumn& second,
                                 NoNumber no_number);

}  // namespace servosense::cli
