// Any bytes as watched cuts: an error of one line, or cuts that make sense.
#include <cstdint>
#include <cstdlib>
#include <sstream>

#include "servosense/io/watched_cut.hpp"

using namespace servosense;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto require = [](bool ok) {
    if (!ok) std::abort();
  };
  const Expected<std::vector<WatchedCut>> cuts = read_watched_cuts(
      std::make_unique<std::istringstream>(std::string(reinterpret_cast<const char*>(data), size)),
      "fuzz");
  if (!cuts) {
    require(cuts.error().sentence.find('\n') == std::string::npos);
    return 0;
  }
  for (const WatchedCut& cut : *cuts) {
    require(cut.spindle_speed_rpm > 0 && cut.axial_depth_m > 0);
    require(!cut.chatter_hz || (!cut.stable && *cut.chatter_hz > 0));
    const auto again = watched_cut_from_json(to_json_line(cut), "fuzz");
    require(again && again->spindle_speed_rpm == cut.spindle_speed_rpm &&
            again->chatter_hz == cut.chatter_hz && again->direction == cut.direction);
  }
  return 0;
}
