// A whole cut as the controller sees it: the milling simulator between simulated drives.
//
// A record begins and ends at rest: the spindle runs up, x feeds at its pace in the air, the cut
// lasts `cut_s` (from the entry, or from the moment a run-in tool is immersed), x stops, the
// spindle runs down.
//
// Coupling, once per servo period T:
//   spindle and feed of the cut = what their drives moved in the last period / T
//   load of spindle             = mean cutting torque over the last period (positive: against it)
//   load of x, y                = - mean force on the tool (the axis carries the tool along)
// so the cut follows the drives by one period exactly and never drifts from their encoders, and
// its forces reach them one period late: 45 degrees of phase at 1 kHz for T = 125 us, far above
// what a drive can follow. The tool's own vibration does not move the encoders.
// Only means over whole servo periods act on the drives.
//
// A drive that is left out is ideal: its reference is its motion. With ideal spindle and x the cut
// is that of MillingSimulator at the same speed.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/sim/drive_simulator.hpp"
#include "servosense/sim/milling_simulator.hpp"

namespace servosense {

/// The feed stops for a while: the controller's feed hold. Times count from the start of the cut.
struct FeedHold {
  double at_s = 0;
  double duration_s = 0;
};

/// Something in the way of an axis: an elastic tool of this stiffness that breaks at its strength.
struct Obstacle {
  Channel axis = Channel::x;
  double at_s = 0;  ///< from the start of the cut: met where the axis is then
  double stiffness_N_per_m = 0;
  double strength_N = 0;  ///< it gives way for good
};

struct MachiningSimulation {
  MillingSimulation milling;                    ///< speed profile counts from the start of the cut
  std::optional<DriveSimulatorConfig> spindle;  ///< velocity loop
  std::optional<DriveSimulatorConfig> x, y, z;  ///< position loop; y and z hold still
  double servo_period_s = 125e-6;
  double cut_s = 1;
  double spindle_acceleration_rad_s2 = 2000;  ///< run-up and run-down
  double feed_acceleration_m_s2 = 1;
  double settle_s = 0.2;  ///< air cutting at full speed before the cut, rest after it
  std::vector<FeedHold> feed_holds;
  std::vector<Obstacle> obstacles;
};

/// One servo instant. Drives that are ideal or absent hold their reference and no current.
struct MachiningSample {
  double t_s = 0;
  bool cutting = false;  ///< between start and end of the cut
  DriveSimSample spindle, x, y, z;
  MillingStep cut;  ///< means over the period that ends here; zero outside the cut
};

class MachiningSimulator {
 public:
  /// Errors of MillingSimulator and DriveSimulator, and durations or accelerations that are not
  /// positive. The step of the cut is shortened to divide the servo period.
  static Expected<MachiningSimulator> create(const MachiningSimulation& simulation);

  [[nodiscard]] double duration_s() const { return end_s_; }
  /// When the cut begins and ends.
  [[nodiscard]] double cut_from_s() const { return cut_from_s_; }
  [[nodiscard]] double cut_to_s() const { return cut_from_s_ + simulation_.cut_s; }

  /// Runs the whole record from its beginning. An error of `sample` ends it, as does a tool that is
  /// lost.
  Expected<Done> run(const std::function<Expected<Done>(const MachiningSample&)>& sample);
  Expected<std::vector<MachiningSample>> run();

  /// The cut after run(): surface and roughness. Nullptr before.
  [[nodiscard]] const MillingSimulator* cut() const { return cut_ ? &*cut_ : nullptr; }

  /// Columns of a trace: of each drive counts (or angle, position) and current, of ideal ones angle
  /// or position, and cutting torque as the spindle's; then the truth of the tool: torque, forces,
  /// displacements, feed per tooth.
  [[nodiscard]] std::vector<Signal> trace_signals() const;
  /// The row of a sample, in the order of trace_signals().
  void trace_fields(const MachiningSample& sample, std::vector<TraceField>& row) const;

 private:
  explicit MachiningSimulator(MachiningSimulation simulation);
  [[nodiscard]] double spindle_reference(double t_s) const;
  [[nodiscard]] double feed_override(double t_s) const;

  MachiningSimulation simulation_;
  double run_up_s_ = 0;     // of the spindle
  double feed_ramp_s_ = 0;  // of x
  double feed_from_s_ = 0, cut_from_s_ = 0, end_s_ = 0;
  std::optional<MillingSimulator> cut_;
};

}  // namespace servosense
