// Cross-talk: force on one drive that another one causes.
#pragma once

#include <array>
#include <string_view>

#include "servosense/core/channel.hpp"

namespace servosense {

/// What of the other drive is felt: the reaction to its acceleration through a bed that gives, drag
/// that goes with its velocity, weight that shifts with its position, or a share of its effort
/// through its mounting.
enum class CrossTalkOf { acceleration, velocity, position, effort };
inline constexpr std::array<std::string_view, 4> kCrossTalkOf{"acceleration", "velocity",
                                                              "position", "effort"};

/// `coefficient` times that: kg, N s/m, N/m or 1 between axes; of a spindle kg m and so on.
struct CrossTalk {
  Channel from = Channel::x;
  double coefficient = 0;
  CrossTalkOf of = CrossTalkOf::acceleration;
};

}  // namespace servosense
