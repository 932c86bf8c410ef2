// Traces of hammer tests, as a recorder writes them.
#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include "identify/hammer_hits.hpp"

namespace hammer_test {

inline std::string trace(const std::vector<Hit>& hits, const Bench& bench = {}, unsigned seed = 1,
                         const std::vector<Mode>& modes = kTool,
                         const std::string& response = "tool.displacement_x_m") {
  std::mt19937_64 random(seed);
  const servosense::ImpactRecord r = record(modes, hits, bench, random);
  std::string text = "t_s,hammer.force_N," + response + "\n";
  for (std::size_t i = 0; i < r.force_N.size(); ++i) {
    char line[100];
    std::snprintf(line, sizeof line, "%.7f,%.8g,%.8g\n", static_cast<double>(i) / bench.rate_hz,
                  r.force_N[i], r.response[i]);
    text += line;
  }
  return text;
}

}  // namespace hammer_test
