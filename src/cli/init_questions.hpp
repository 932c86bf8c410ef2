// The questions of `servosense init` on a terminal, one figure at a time in the units of data
// sheets.
#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "servosense/io/data_sheet.hpp"

namespace servosense::cli {

struct SheetAnswers {
  std::vector<SheetEntry> entries;
  std::string machine_class;  ///< "" for none
};

/// Asks on `out` and reads a line of `in` for each: an empty one leaves the figure out, what cannot
/// be right is asked for again, the end of `in` ends the questions. A class that is known is not
/// asked for.
[[nodiscard]] SheetAnswers ask_sheet(std::istream& in, std::ostream& out,
                                     const std::string& machine_class = {});

}  // namespace servosense::cli
