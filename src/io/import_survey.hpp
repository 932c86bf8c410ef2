// One reading of a foreign table: what the values of its columns are like.
#pragma once

#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "import_time.hpp"

namespace servosense::detail {

/// Values as they stand in the file, not converted.
struct ColumnSurvey {
  std::size_t values = 0, empty = 0, invalid = 0, texts = 0;
  double least = std::numeric_limits<double>::infinity();
  double greatest = -std::numeric_limits<double>::infinity();
  bool whole = true;               ///< all numbers are whole
  std::vector<std::string> first;  ///< fields
  std::size_t text_line = 0;
  std::string text;
};

/// Stretches of rows that follow one another, from all over the table.
struct RowSample {
  static constexpr std::size_t kStretch = 64, kMostStretches = 128;
  std::vector<std::size_t> columns;         ///< which are kept
  std::vector<std::vector<double>> t_s;     ///< a stretch: its times
  std::vector<std::vector<double>> values;  ///< a stretch: its rows, one after the other
};

struct TableSurvey {
  std::size_t rows = 0;
  std::vector<ColumnSurvey> columns;
  TimeSurvey time;
  RowSample sample;
  TableFile::Ragged ragged;
};

/// Data error when a row cannot be read. `sampled`: the columns whose rows are kept.
Expected<TableSurvey> survey_table(TableFile& file, const ImportTime& time,
                                   const std::vector<std::size_t>& sampled,
                                   const ImportProgress& progress);

}  // namespace servosense::detail
