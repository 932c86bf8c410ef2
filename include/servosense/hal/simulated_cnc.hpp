// A CNC that is not there: moves with limited acceleration, takes its time to answer, takes texts
// in part, is busy, is reset, and loses what it is told or what it answers. In time of its own:
// waiting costs nothing, and every run with the same seed is the same.
//
// What it misunderstands does not move: a block with an open bracket or an unknown word is counted
// and left alone. Not in it: following error, jerk limits, moves of several axes.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "servosense/hal/cnc_link.hpp"

namespace servosense {

struct SimulatedCncConfig {
  unsigned seed = 1;
  double reply_s = 0.002;         ///< from command to answer...
  double reply_jitter_s = 0.001;  ///< ...and up to so much more
  double time_limit_s = 0.05;     ///< a try without an answer takes so long
  double step_s = 125e-6;         ///< of its motion
  double acceleration_m_s2 = 1;
  double orient_s = 0.4;
  // Shares of the tries that go wrong, 0 to 1.
  double lost_request = 0;  ///< never arrives
  double lost_reply = 0;    ///< is carried out, and not acknowledged
  double in_part = 0;       ///< of a text only a piece is taken
  double busy = 0;
  double reset = 0;
  /// Connections that are refused before the operator lets go.
  unsigned refused_connections = 0;
  bool real_time = false;  ///< waits for real, for demonstrations
};

/// What really happened, for tests.
struct SimulatedCncTruth {
  std::uint64_t blocks = 0;      ///< carried out
  std::uint64_t bad_blocks = 0;  ///< not understood
  std::uint64_t tries = 0;       ///< of anything
  std::uint64_t lost = 0;        ///< requests and replies
  std::uint64_t holds = 0;       ///< feed holds that arrived, repeated ones included
  double path_m = 0;             ///< way of all axes together
  double speed_m_s = 0;          ///< now
  double spindle_angle_rad = 0;  ///< where it was oriented last
  double spindle_speed_rad_s = 0;
  Nanoseconds first_hold_ns = 0;  ///< when the last feed hold began to act
};

class SimulatedCnc final : public CncLink {
 public:
  explicit SimulatedCnc(const SimulatedCncConfig& config = {});
  ~SimulatedCnc() override;

  [[nodiscard]] const std::string& name() const override;
  CncReply connect() override;
  CncReply send(std::string_view text, std::size_t& taken) override;
  CncReply status(CncStatus& status) override;
  CncReply hold_feed(bool hold) override;
  CncReply set_feed_override(double factor) override;
  CncReply set_spindle_override(double factor) override;
  CncReply overrides(CncOverrides& overrides) override;
  [[nodiscard]] Nanoseconds now_ns() const override;
  /// The machine goes on meanwhile.
  void wait(double seconds) override;

  // What the operator does, without any link.
  void press_reset();
  void press_hold(bool hold);
  void turn_overrides(double feed, double spindle);
  void switch_on(bool on);
  [[nodiscard]] const SimulatedCncTruth& truth() const;
  [[nodiscard]] CncStatus true_status() const;

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

}  // namespace servosense
