// Cuts of which somebody saw whether they chattered, as JSON Lines: one object a line with
// spindle_speed_rpm, axial_depth_m, stable (true or false), and where known chatter_hz,
// radial_immersion_m and direction (up, down, slot) when it was not the engagement of [cut], and
// note, a text for people.
#pragma once

#include <istream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense {

struct WatchedCut {
  double spindle_speed_rpm = 0;
  double axial_depth_m = 0;
  bool stable = true;
  std::optional<double> chatter_hz;          ///< of a cut that chattered
  std::optional<double> radial_immersion_m;  ///< else that of [cut]
  std::string direction;                     ///< up, down or slot; "" that of [cut]
  std::string note = {};                     ///< for people
};

/// One line. `where` ("FILE:LINE") begins the sentence of a data error: malformed JSON, an unknown
/// key, a key that is missing, a number that is not positive, chatter_hz of a stable cut.
Expected<WatchedCut> watched_cut_from_json(std::string_view line, const std::string& where);

/// Reads a file of them; blank lines are passed over. Errors as above; device error if the file
/// cannot be read.
Expected<std::vector<WatchedCut>> read_watched_cuts(const std::string& path);
/// The same from a stream; `name` stands for the file in error sentences.
Expected<std::vector<WatchedCut>> read_watched_cuts(std::unique_ptr<std::istream> stream,
                                                    std::string name);

/// One line, without its end; a key that is not known is left out.
std::string to_json_line(const WatchedCut& cut);

/// Data error if there is a file at `path` that holds something else than such lines.
Expected<Done> check_watched_cuts(const std::string& path);
/// Adds lines to the end of a file, or makes it. Written whole: what was there stays if it fails.
/// Data error as by check_watched_cuts(), device error if it cannot be written.
Expected<Done> append_watched_cuts(const std::string& path, const std::vector<WatchedCut>& cuts);

}  // namespace servosense
