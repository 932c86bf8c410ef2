#include "servosense/identify/ramp_cuts.hpp"

#include <algorithm>
#include <cmath>

namespace servosense {
namespace {

struct Frame {
  double rpm = 0, power = 0, hz = 0;  // hz: NaN below a hundredth of the strongest
};

std::vector<Frame> frames_of(const ChatterRidge& ridge) {
  std::vector<Frame> frames;
  for (std::size_t i = 0; i < ridge.t_s.size(); ++i)
    frames.push_back({ridge.spindle_speed_rpm[i], ridge.power_Nm2[i], ridge.frequency_hz[i]});
  std::sort(frames.begin(), frames.end(), [](auto& a, auto& b) { return a.rpm < b.rpm; });
  return frames;
}

}  // namespace

std::vector<WatchedCut> cuts_of_ramps(const StableSpeeds& found, const WatchedCut& engagement) {
  std::vector<WatchedCut> cuts;
  if (found.verdict != StableSpeedVerdict::found) return cuts;
  for (std::size_t c = 0; c < found.ramps.size(); ++c) {
    if (!found.ramps[c].used) continue;
    const std::vector<Frame> frames = frames_of(found.ridge[c]);
    const auto at = [&](double rpm) {
      return std::lower_bound(frames.begin(), frames.end(), rpm,
                              [](const Frame& f, double speed) { return f.rpm < speed; });
    };
    auto from = frames.begin();
    for (std::size_t p = 0; p <= found.pockets.size(); ++p) {
      const bool last = p == found.pockets.size();
      const auto to = last ? frames.end() : at(found.pockets[p].spindle_speed_rpm);
      if (from == to) continue;
      const auto peak = std::max_element(
          from, to, [](const Frame& a, const Frame& b) { return a.power < b.power; });
      if (peak != from && peak + 1 != to && std::isfinite(peak->hz)) {
        WatchedCut& cut = cuts.emplace_back(engagement);
        cut.spindle_speed_rpm = peak->rpm;
        cut.stable = false;
        cut.chatter_hz = peak->hz;
      }
      from = to;
    }
  }
  return cuts;
}

}  // namespace servosense
