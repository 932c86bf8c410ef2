// How large a step of force must be for the collision monitor to find it.
//
// Purpose: the threshold is on the filtered rate of change of a force; a contact is a force. A step
// is carried through the drive's filter, the observer and the filters of the monitor once; then, at
// instants all over the record, what the machine itself shows there is added, the threshold of that
// instant held against the sum, and the smallest step noted that stays beyond it for as many
// samples as an alarm takes. Either direction counts. A force that rises evenly has to reach the
// threshold itself [N/s]. Off the real-time path: 0.02 us a sample. Bad at: contacts that rise more
// slowly than the filters (3 ms at 335 rad/s): they must be larger.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "servosense/monitors/stack_config.hpp"

namespace servosense {

class CollisionReach {
 public:
  struct Result {
    double step_N = 0;        ///< median over the instants at which the axis moves, if it does
    double rate_N_per_s = 0;  ///< of a force that rises evenly, likewise
    bool moving = false;
    std::array<std::optional<double>, kMotionPhases>
        phase_N;  ///< median in each phase that was seen
  };

  /// `axis` as it runs; `grouped`: of four samples. `filter_hz`: cutoff of the drive's own filter
  /// of the current, 0 = none is known.
  CollisionReach(const HostAxisSlotConfig& axis, std::size_t index, bool grouped,
                 double filter_hz = 0);

  /// A servo sample, after the stack has heard it.
  void heard(const HostStack& stack);
  /// Nothing when the monitor was never armed long enough.
  [[nodiscard]] std::optional<Result> result() const;

 private:
  struct Instant {
    double jerk = 0;
    double threshold = 0;
    MotionPhase phase = MotionPhase::unknown;
    bool armed = false;
  };
  void judge();

  std::size_t index_;
  unsigned group_;
  unsigned consecutive_;
  double mean_;
  std::vector<double> response_;  // jerk after a step of 1 N
  std::vector<Instant> window_;   // of as many samples
  struct Found {
    float step_N, rate_N_per_s;
  };
  struct Phase {
    std::vector<Found> found;  // two an instant, one a direction
    std::uint64_t instants = 0, stride = 1;
  };
  std::array<Phase, kMotionPhases + 1> found_;
};

}  // namespace servosense
