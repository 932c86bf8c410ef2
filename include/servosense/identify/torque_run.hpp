// A run of a program as the torque band monitor hears it: steps of steady turning, at equal
// distances of the program, with the places where the controller or the spindle tells where it is.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/core/quality.hpp"
#include "servosense/monitors/torque_band_points.hpp"
#include "servosense/monitors/turn_steps.hpp"

namespace servosense {

/// Begins where the spindle comes to a steady speed, behind a gap, and with every block.
struct TorqueRunSection {
  std::size_t first = 0;  ///< point of the run
  std::int32_t block = kNoBlock;
  double speed_rad_s = 0;  ///< with the sense of rotation; 0 = unknown
  double friction_Nm = 0;  ///< of the spindle, which its observer has taken off: shares are of both
  bool by_block = false;   ///< the spindle turned steadily on: only the block has changed
  bool behind_gap = false;  ///< the record had a gap here
};

/// Torque at 0, spacing, 2 spacing, ... of the program, time [s] or path [m].
struct TorqueRun {
  double spacing = 0;
  std::vector<double> torque_Nm;           ///< NaN: nothing to be learned here
  std::vector<TorqueRunSection> sections;  ///< empty: one, from beginning to end
  std::vector<double> feed = {};           ///< over path, progress per second; else empty
  double step = 0;                         ///< that a torque is the mean of; 0 = unknown
};

struct TorqueRunOptions {
  double spacing = 0.02;  ///< of the points
  double step = 0.05;     ///< as the monitor's
  double steady_share = 0.02;
  double sample_period_s = 0;  ///< tells the speed; 0 = unknown
  bool over_path = false;
};

/// Takes a run sample by sample.
class TorqueRunRecorder {
 public:
  explicit TorqueRunRecorder(const TorqueRunOptions& options);
  /// As TorqueBandMonitor::process.
  /// `friction_Nm`: what the motor gave besides the torque.
  void add(double torque_Nm, double increment_rad, double advance, double feed_override,
           Quality quality, std::int32_t block = kNoBlock, double friction_Nm = 0);
  /// Data error when the spindle never turns steadily.
  [[nodiscard]] Expected<TorqueRun> finish();
  /// Samples in which the signal was missing.
  [[nodiscard]] std::size_t missing() const { return missing_; }

 private:
  struct Knot {
    double at, torque_Nm, width, feed;
  };
  struct Stretch {  // of steady turning
    double length = 0, speed_rad_s = 0;
    bool behind_gap = false;
    double friction = 0, samples = 0;  // sum, and of how many
    std::vector<Knot> knots;
    std::vector<std::pair<double, std::int32_t>> blocks;  // where each begins
  };
  void take_step();
  void end_stretch();

  TorqueRunOptions options_;
  TurnSteps<double> steps_;
  std::vector<Stretch> stretches_;
  bool steady_ = false;
  bool open_ = false;  // the last stretch may go on, behind a droop
  unsigned behind_gap_ = 0;
  std::int32_t block_ = kNoBlock;
  double turned_rad_ = 0;  // in the step under way
  std::size_t missing_ = 0;
};

}  // namespace servosense
