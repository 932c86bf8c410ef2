// Records of the spindle of oracles/weakened_spindle.hpp as files, and what the program made of
// them.
#pragma once

#include <cstdio>
#include <fstream>
#include <functional>
#include <optional>
#include <sstream>
#include <string>

#include "oracles/weakened_spindle.hpp"
#include "program.hpp"

namespace spindle_records {

using namespace program_test;

inline constexpr double kStepAt_s = 6;

inline void write_trace(const oracle::WeakenedSpindle& s, const std::string& name,
                        double duration_s, const std::function<double(double)>& speed,
                        const std::function<double(double)>& load, unsigned seed,
                        bool absolute = false) {
  std::ofstream out(folder / name);
  out << "t_s,spindle.angle_counts,spindle.current_A\n";
  char line[96];
  s.record(duration_s, speed, load, seed, [&](double t, std::int64_t counts, double current) {
    std::snprintf(line, sizeof line, "%.6f,%lld,%.4f\n", t, static_cast<long long>(counts),
                  absolute ? std::abs(current) : current);
    out << line;
  });
}

inline void write_machine(const oracle::WeakenedSpindle& s) {
  std::ostringstream text;
  text << "[machine]\nname = oracle\nsample_rate_hz = 8000\n[spindle]\ntorque_constant_Nm_per_A = "
       << s.constant << "\nencoder_counts_per_rev = " << s.counts << "\n";
  put("machine.ini", text.str());
}

/// Value of a key of [spindle] or of the effect in a machine file.
inline std::optional<double> value_of(const std::string& file, const std::string& section,
                                      const std::string& key) {
  std::string at;
  for (const std::string& line : lines(content(folder / file))) {
    if (line.starts_with("[")) at = line.substr(1, line.find(']') - 1);
    if (at == section && line.starts_with(key + " "))
      return std::stod(line.substr(line.find('=') + 1));
  }
  return {};
}

/// Step of the estimated torque: mean of the last second less that of the second before the load.
struct Reading {
  double step = 0;
  std::size_t empty = 0, rows = 0;
};
inline Reading read_step(const std::string& file) {
  Reading r;
  double before = 0, after = 0, n = 0, m = 0;
  for (const std::string& line : lines(content(folder / file))) {
    if (line.empty() || line[0] == '#' || line[0] == 't') continue;
    const double t = std::stod(line);
    const std::size_t at = line.find(',') + 1;
    const std::string field = line.substr(at, line.find(',', at) - at);
    ++r.rows;
    if (field.empty() || field == "nan") {
      ++r.empty;
      continue;
    }
    const double value = std::stod(field);
    if (t > kStepAt_s - 1 && t < kStepAt_s) before += value, ++n;
    if (t > kStepAt_s + 1.5) after += value, ++m;
  }
  r.step = after / m - before / n;
  return r;
}

}  // namespace spindle_records
