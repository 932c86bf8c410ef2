// A machine at work: the milling cut with the drives around it, as a control would record it.
//
//   program --> spindle drive --> turn --+
//           --> x drive ------> feed --> cut (milling_simulator.hpp) --> fx, fy, torque
//                 ^                                                          |
//                 '--- load = -fx (x), -fy (y), -fz (z), +torque (spindle) --'
//
// Signs. The work pushes the tool with fx, fy, in the frame of model/milling.hpp, whose x and y are
// the machine's. An axis moves by J a = effort - resistance - cutting, where the push itself stands
// with a plus: cutting = -fx. The torque of the cut opposes the rotation, as cutting does. Then the
// power that the drives give up, torque w - fx vx, is what the chips take.
//
// Coupling, once a servo period: the tool goes where the straight lines through the last two
// positions of the drives lead, the cut makes its own, shorter steps on that way, and the mean of
// its forces loads the drives over the very same period. Position is taken anew each period, so
// the tool never drifts from its drives: it is off by 3 T^2 times their acceleration at most (0.05
// mrad in a run-up at 1000 rad/s2).
//
// A drive that is absent is ideal: it does what it is told, and the cut is exactly that of
// MillingSimulator. The feed is interpolated from the commanded spindle speed, as controls do; so
// feed per tooth rises when the spindle droops.
//
// Program: run-up of the spindle, dwell, jerk-limited start of the feed in the air, entry, cut,
// exit, stop of the feed, dwell, run-down. Times of the speed profile, of tooth breaks and of feed
// holds count from the first contact, as commanded; the axis follows by its lag (1/position gain).
//
// Overrides: the feed stretches the time of the program, from the start of the feed to its stop, as
// the trajectory of a control is stretched; the speed override leaves the feed as it is (G94).
//
// Bad at: without axial coefficients z is loaded by gravity alone. y and z yield under their load
// in their own signals but not in the cut. The tool cannot back out or turn back: where a drive
// does, it waits until the drive comes by again. Drives carry the force at the tool, not what the
// structure lets through above its resonances. Axes lighter than cut stiffness times 10 T^2 (2e7
// N/m: 3 kg).
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/sim/drive_simulator.hpp"
#include "servosense/sim/milling_simulator.hpp"
#include "servosense/sim/trajectory.hpp"

namespace servosense {

/// The feed comes to a stop in the cut, while the spindle turns on.
struct FeedHold {
  double time_s = 0;      ///< when it begins to slow down, after the first contact
  double duration_s = 0;  ///< at rest
};

/// What the control does around the cut.
struct CutProgram {
  /// Run-up from rest and run-down. 0: at speed all the time, for an ideal spindle only.
  double spindle_acceleration_rad_s2 = 0;
  double dwell_s = 0;  ///< before the feed starts, after it has stopped, and at the end
  /// Start and stop of the feed, at the spindle speed of the first contact. Both 0: feeding all the
  /// time, for an ideal x only.
  double feed_acceleration_m_s2 = 0;
  double feed_jerk_m_s3 = 0;
  /// From the first contact until the feed stops. 0: until the tool has left the work and gone on
  /// by the clearance.
  double cut_s = 0;
  std::vector<FeedHold> holds;  ///< in their order
};

/// Something hard in the way of x: a spring until it, or the tool, breaks.
struct FeedObstacle {
  double position_m = 0;  ///< of the tool axis behind the front face, when they touch
  double stiffness_N_per_m = 0;
  double strength_N = std::numeric_limits<double>::infinity();
};

struct MachineSimulation {
  MillingSimulation milling;
  double sample_period_s = 125e-6;  ///< servo rate; that of all drives
  /// Ideal when absent. The spindle runs in the velocity loop, the axes in the position loop,
  /// whatever their `loop` says; y and z stay at their initial position, x starts there.
  std::optional<DriveSimulatorConfig> spindle, x, y, z;
  CutProgram program;
  std::optional<FeedObstacle> obstacle;
};

/// What is set at the panel while the program runs; 1: as programmed.
struct MachineOverride {
  double speed = 1;   ///< of the spindle, at once: whoever sets it minds the rate
  double feed = 1;    ///< of all feeds, reached with the acceleration of the feed
  bool hold = false;  ///< the feed comes to rest
};

/// Instants of the program [s] from the start of the record.
struct CutSchedule {
  double feed_s = 0;      ///< the feed starts
  double contact_s = 0;   ///< first contact as commanded (started immersed: feed_s)
  double stop_s = 0;      ///< the feed begins to stop
  double run_down_s = 0;  ///< the spindle begins to run down
  double end_s = 0;
};

/// One servo instant.
struct MachineSample {
  double t_s = 0;
  double spindle_reference_rad_s = 0;
  double feed_reference_m = 0;  ///< as feed_m of the cut
  std::optional<DriveSimSample> spindle, x, y, z;
  /// The truth about the cut: angle and feed now, means over the period that ends now (as
  /// Decimation::average).
  MillingStep cut;
  double obstacle_N = 0;  ///< against x, mean over the period that ends now
};

class MachineSimulator {
 public:
  /// Usage error naming what is wrong.
  [[nodiscard]] static Expected<MachineSimulator> create(const MachineSimulation& simulation);

  /// From this servo instant on.
  void set(const MachineOverride& override) { override_ = override; }

  /// The state at this servo instant, then on to the next.
  MachineSample step();

  /// From here to the end of the program; ends early with a data error when the tool is lost
  /// (MillingSimulator::lost), or with whatever error `sample` returns.
  Expected<Done> run(const std::function<Expected<Done>(const MachineSample&)>& sample);
  Expected<std::vector<MachineSample>> run();

  [[nodiscard]] const MachineSimulation& simulation() const { return simulation_; }
  [[nodiscard]] const CutSchedule& schedule() const { return schedule_; }
  [[nodiscard]] const MillingSimulator& milling() const { return milling_; }
  [[nodiscard]] bool obstacle_broken() const { return obstacle_broken_; }
  /// Time of the program at this servo instant; behind that of the record where feed was taken off.
  [[nodiscard]] double program_s() const {
    return static_cast<double>(sample_) * simulation_.sample_period_s - behind_s_;
  }

  /// Programmed speed and feed, as functions of the program's time.
  [[nodiscard]] double spindle_reference(double t_s) const;
  [[nodiscard]] double feed_reference(double t_s) const;

 private:
  /// Where a drive has been, and where that leads.
  struct Way {
    double start = 0, before = 0, last = 0;
    void to(double position) {
      before = last;
      last = position;
    }
    /// From the start, `periods` after the last position.
    [[nodiscard]] double ahead(double periods) const {
      return last - start + periods * (last - before);
    }
  };

  MachineSimulator(const MachineSimulation& simulation, MillingSimulator milling);
  [[nodiscard]] Expected<Done> plan();
  [[nodiscard]] Expected<Done> plan_holds();
  [[nodiscard]] Expected<Done> plan_stop();
  [[nodiscard]] Expected<Done> add_drives();
  [[nodiscard]] double feed_share(double t_s) const;
  [[nodiscard]] double command_step(double t_s) const;
  void keep_pace();
  void cut_period();
  void meet_obstacle();

  MachineSimulation simulation_;
  MillingSimulator milling_;
  std::optional<DriveSimulator> spindle_, x_, y_, z_;
  CutSchedule schedule_;
  JerkLimitedMove feed_start_;
  double feed_per_rad_m_ = 0;
  double contact_feed_m_s_ = 0;
  double run_up_s_ = 0, ramp_s_ = 0;
  double last_speed_rad_s_ = 0;  // from which the spindle runs down

  MachineOverride override_;
  double pace_ = 1;      // of the program
  double behind_s_ = 0;  // what pace has cost
  std::uint64_t sample_ = 0, milling_steps_ = 0;
  double start_angle_rad_ = 0, start_feed_m_ = 0;
  double feed_m_ = 0;  // commanded
  Way turn_, feed_;
  MillingStep cut_;  // of the last period
  double obstacle_N_ = 0;
  bool obstacle_broken_ = false;
};

/// Columns of a record. The spindle reports angle_counts (angle_rad without a counter) and
/// current_A, an axis command_position_m, angle_counts (position_m) and current_A; an ideal spindle
/// reports angle_rad, an ideal x position_m. `truth` adds spindle.speed_rad_s, tool.torque_Nm
/// (of the cut, against the rotation), x.position_m, x.velocity_m_s, tool.force_x_N and force_y_N
/// (on the tool), displacement_x_m and displacement_y_m.
[[nodiscard]] std::vector<Signal> record_signals(const MachineSimulation& simulation, bool truth);
/// The fields of a row, in the order of record_signals.
void record_row(const MachineSimulation& simulation, const MachineSample& sample, bool truth,
                std::vector<TraceField>& row);
/// Instants of the program, for the head of a record.
[[nodiscard]] TraceMetadata record_metadata(const MachineSimulator& simulator);
/// Runs the rest of the program into a writer with record_signals, which it does not close.
Expected<Done> write_record(MachineSimulator& simulator, TraceWriter& writer, bool truth = true);

}  // namespace servosense
