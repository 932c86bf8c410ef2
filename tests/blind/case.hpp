// A blind case: what the user of the workflow has (a machine file and a trace), and the truth,
// which only the scorer reads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace blind {

/// A column of the trace. NaN is written as `nan`, a value that is not there (`absent`) as nothing.
struct Column {
  std::string name;
  std::vector<double> values;
};

inline constexpr double kAbsent = 1e300;

struct HiddenEffect {
  std::string name;  ///< of the catalogue, or of the kind of disturbance that is not in it
  std::vector<std::pair<std::string, double>> parameters;
  double strength = 0;    ///< rms beyond the refitted baseline over the noise floor
  double visibility = 0;  ///< the same over noise and the baseline's own imperfection together
};

struct Truth {
  std::string expect;  ///< name, none, outside, line, class
  std::vector<HiddenEffect> effects;
  std::vector<HiddenEffect> background;  ///< also there, not asked for: may be named
  std::string note;                      ///< how the record was made, for who looks into a case
  double noise_floor = 0;
  double gap_before = 0;  ///< held out, baseline refitted
  double gap_oracle = 0;  ///< held out, of the same machine without the effect
  double held_out_from_s = 0;
  /// What the machine has that its file does not say and no effect is meant by.
  std::vector<std::pair<std::string, double>> circumstances;
};

struct Case {
  std::string name;  ///< domain/cell[/effect]
  std::uint64_t seed = 0;
  std::string variant = "plain";
  std::string machine;  ///< text of the machine file
  std::vector<Column> columns;
  Truth truth;
};

/// All cells, as domain/cell or domain/cell/effect where the effect may be chosen.
std::vector<std::string> cells();

/// Draws the case. `name` is a cell, with or without the effect. `variant` is plain, units,
/// reversed, decimated or offset. Ends the program with a sentence when there is no such case.
Case draw_case(const std::string& name, std::uint64_t seed, const std::string& variant);

/// Writes machine.ini, trace.csv and truth.json into `folder`, which is made when it is not there.
void write_case(const Case&, const std::string& folder);

/// The text of truth.json.
std::string truth_json(const Case&);

// The domains behind draw_case.
std::vector<std::string> drive_cells(const std::string& domain);
Case draw_drive_case(const std::string& domain, const std::string& cell, const std::string& effect,
                     std::uint64_t seed, const std::string& variant);
std::vector<std::string> second_cells(const std::string& domain);
Case draw_second_case(const std::string& domain, const std::string& cell, const std::string& effect,
                      std::uint64_t seed, const std::string& variant);
std::vector<std::string> milling_cells();
Case draw_milling_case(const std::string& cell, const std::string& effect, std::uint64_t seed,
                       const std::string& variant);
std::vector<std::string> second_milling_cells();
Case draw_second_milling_case(const std::string& cell, const std::string& effect,
                              std::uint64_t seed, const std::string& variant);

}  // namespace blind
