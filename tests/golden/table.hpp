// Golden files: tests/golden/<block>.csv. First row the names, second the tolerance of each output
// in single precision (empty: an input), then a row a sample.
#pragma once

#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "check.hpp"

namespace golden {

struct Table {
  std::vector<std::string> names;
  std::vector<double> tolerances;  // one an output; the outputs follow the inputs
  std::vector<std::vector<double>> rows;

  [[nodiscard]] std::size_t inputs() const { return names.size() - tolerances.size(); }
};

inline std::string path(const std::string& block) { return "tests/golden/" + block + ".csv"; }

inline std::vector<std::string> cells(const std::string& line) {
  std::vector<std::string> found;
  std::istringstream in(line + ',');
  for (std::string cell; std::getline(in, cell, ',');) found.push_back(cell);
  return found;
}

/// Checks the layout; without rows where there is no such file.
inline Table read(const std::string& block) {
  std::ifstream file(path(block));
  Table table;
  std::string line;
  CHECK(std::getline(file, line));
  table.names = cells(line);
  CHECK(std::getline(file, line));
  const std::vector<std::string> second = cells(line);
  CHECK(second.size() == table.names.size());
  for (const std::string& cell : second)
    if (!cell.empty())
      table.tolerances.push_back(std::stod(cell));
    else
      CHECK(table.tolerances.empty());  // inputs first
  while (std::getline(file, line)) {
    std::vector<double> row;
    for (const std::string& cell : cells(line)) row.push_back(std::stod(cell));
    CHECK(row.size() == table.names.size());
    if (row.size() == table.names.size()) table.rows.push_back(row);
  }
  return table;
}

inline void write(const std::string& block, const Table& table) {
  std::FILE* file = std::fopen(path(block).c_str(), "w");
  if (!file)
    return check::fail(__FILE__, __LINE__) << "cannot write " << path(block) << '\n', void();
  auto comma = [](std::size_t i) { return i == 0 ? "" : ","; };
  for (std::size_t i = 0; i < table.names.size(); ++i)
    std::fprintf(file, "%s%s", comma(i), table.names[i].c_str());
  std::fputc('\n', file);
  for (std::size_t i = 0; i < table.names.size(); ++i) {
    std::fputs(comma(i), file);
    if (i >= table.inputs()) std::fprintf(file, "%g", table.tolerances[i - table.inputs()]);
  }
  for (const std::vector<double>& row : table.rows)
    for (std::size_t i = 0; i < row.size(); ++i)
      std::fprintf(file, "%s%.14g", i == 0 ? "\n" : ",", row[i]);
  std::fputc('\n', file);
  std::fclose(file);
}

}  // namespace golden
