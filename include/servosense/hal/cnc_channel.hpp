// What an identification asks of a CNC: orient the spindle, move an axis a little, know when it is
// there, hold and release the feed, override it, turn the spindle (Dunwoody 2010, ch. 6).
//
// Answers get lost, texts are taken in part, controllers are busy. Everything is therefore repeated
// a bounded number of times, and nothing that is repeated does harm: moves go to absolute
// positions, and a block that breaks off anywhere is an error or does nothing, since the position
// comes last, in brackets. A controller that was reset or taken over ends the job: whoever did that
// had a reason.
//
// Moves leave G21 G90 G94 G1 active.
// Bad at: machines that a second client moves at the same time.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/hal/cnc_link.hpp"

namespace servosense {

struct CncChannelConfig {
  unsigned tries = 20;              ///< of one command, before it is an error
  double pause_s = 0.01;            ///< between tries
  double settle_s = 0.2;            ///< from a block to the first look whether it is done...
  double poll_s = 0.02;             ///< ...between looks...
  unsigned looks = 5;               ///< ...and so many in a row that find nothing moving
  double operator_timeout_s = 60;   ///< for the controller to be let go to us
  double motion_margin_s = 10;      ///< beyond distance / feed, for holds and overrides
  double orient_timeout_s = 30;     ///< for the spindle to stand oriented
  double longest_move_m = 0.02;     ///< a longer one is refused
  double greatest_feed_m_s = 0.05;  ///< a faster one is refused
  double arrived_m = 5e-6;          ///< an axis that stands so near is where it should be
  std::string move_words = "G21 G90 G94 G53 G1";
  std::string orient_words = "M19 R";  ///< degrees follow, in brackets
};

struct CncHealth {
  std::uint64_t commands = 0;
  std::uint64_t repeated = 0;  ///< tries beyond the first
  std::uint64_t in_part = 0;   ///< texts that were not taken whole
  std::uint64_t busy = 0;
  std::uint64_t refused = 0;
  std::uint64_t no_answer = 0;
  std::uint64_t connections = 0;
};

class CncChannel {
 public:
  /// The link must outlive the channel.
  explicit CncChannel(CncLink& link, CncChannelConfig config = {});

  /// Takes control; waits for the operator to let go.
  Expected<Done> open();
  /// Turns the spindle to `angle_rad` and returns when it stands there.
  Expected<Done> orient_spindle(double angle_rad);
  /// Begins to move `axis` (x, y or z) by `distance_m` at `feed_m_s` from where it stands.
  Expected<Done> jog(Channel axis, double distance_m, double feed_m_s);
  /// What is left of the last jog [m], with its sign.
  Expected<double> distance_to_go_m();
  /// Returns when the last jog is over; an error when that takes too long, e.g. in a feed hold.
  Expected<Done> wait_until_there();
  Expected<Done> hold_feed();
  Expected<Done> release_feed();
  /// 0 to 2; 1 as programmed.
  Expected<Done> override_feed(double factor);
  /// Positive clockwise (M3), negative counterclockwise (M4), 0 stop (M5).
  Expected<Done> turn_spindle(double speed_rad_s);
  Expected<CncStatus> status();

  [[nodiscard]] const CncHealth& health() const { return health_; }

 private:
  Expected<Done> repeat(const char* what, const std::function<CncReply()>& one);
  Expected<Done> send_block(const char* what, const std::string& block);
  Expected<Done> wait_until_still(const char* what, double limit_s);
  [[nodiscard]] Error error(const char* what, const std::string& why) const;

  CncLink& link_;
  CncChannelConfig config_;
  CncHealth health_;
  // Of the last jog.
  std::size_t axis_ = 0;
  double target_m_ = 0;
  double limit_s_ = 0;
};

}  // namespace servosense
