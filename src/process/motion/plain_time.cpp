#include "servosense/process/motion/plain_time.hpp"

#include <algorithm>
#include <cmath>

namespace servosense::process {

double PlainTime::seconds(const CanonicalMove& move) const {
  using Kind = CanonicalMove::Kind;
  if (move.kind == Kind::dwell) return move.seconds;
  if (move.kind == Kind::tool) return limits_.tool_change_s;
  if (!is_motion(move.kind)) return 0;
  if (move.kind == Kind::rapid) {
    double slowest = 0;
    for (std::size_t i = 0; i < limits_.velocity_m_s.size(); ++i)
      slowest =
          std::max(slowest, std::abs(move.machine[i] - machine_[i]) / limits_.velocity_m_s[i]);
    return slowest / limits_.rapid_override;
  }
  const double override_ = move.feed_m_rev > 0 ? 1 : limits_.feed_override;
  if (move.kind == Kind::arc)
    return move.feed_m_s > 0 ? path_length(move, move.begin) / (move.feed_m_s * override_) : 0;
  // Lengths are the same in the machine's coordinates, where the start is known whatever offset
  // came between.
  const bool turns = move.feed_deg_s > 0;
  const double speed = (turns ? move.feed_deg_s : move.feed_m_s) * override_;
  CanonicalMove straight = move;
  straight.end = move.machine;
  const double length = path_length(straight, machine_);
  return speed > 0 ? (move.kind == Kind::tap ? 2 : 1) * length / speed : 0;
}

void PlainTime::put(const CanonicalMove& move) {
  spindle_.put(move, now_s_);
  if (is_motion(move.kind) && move.kind != CanonicalMove::Kind::rapid)
    now_s_ = std::max(now_s_, spindle_.ready_s());
  now_s_ += seconds(move);
  if (is_motion(move.kind) && move.kind != CanonicalMove::Kind::tap) machine_ = move.machine;
  sink_(move, now_s_);
}

}  // namespace servosense::process
