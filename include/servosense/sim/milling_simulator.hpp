// Milling in the time domain: teeth in layers, the surface they leave, the structure that gives.
//
// One step of length h, all of second order in h (Koike 2016, 2.5, and Tarng 1988, 3.2 to 3.4, with
// the changes named in sim/layered_cut.hpp and sim/modal_response.hpp):
//   1. turn and feed to the middle of the step, let the structure coast there,
//   2. chips against the surface of earlier teeth, their force and torque,
//   3. move the structure through the whole step under that force, exactly.
// A force taken at the start of the step would act half a step late, as negative damping does.
//
// Frame and angles: model/milling.hpp. Forces act on the tool; torque is positive against the
// rotation. The feed follows the spindle, so that feed per tooth is constant whatever the speed
// does, unless the caller gives a feed of his own (coupling with a feed drive).
//
// Memory is taken at the start and does not grow with the duration, but for the wall, which grows
// to `wall_points`. One simulation runs on one core and its bytes depend on nothing but its input;
// run several with run_parallel (sim/run_parallel.hpp).
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/model/milling.hpp"
#include "servosense/model/structural_mode.hpp"
#include "servosense/sim/layered_cut.hpp"
#include "servosense/sim/machined_surface.hpp"
#include "servosense/sim/modal_response.hpp"
#include "servosense/sim/spindle_speed_profile.hpp"
#include "servosense/sim/workpiece.hpp"

namespace servosense {

enum class MillingStart {
  entry,     ///< outside the work, about to touch the front face
  immersed,  ///< in the work, after a run-in of a rigid tool
};

/// Part of a tooth's edge, from the tip up, breaks off during the cut.
struct ToothBreak {
  double time_s = 0;
  int tooth = 1;        ///< counted from 1
  double fraction = 1;  ///< of the edge over the greatest axial depth
};

struct MillingSimulation {
  MillingTool tool;
  MillingCut cut;
  Structure structure;        ///< an axis without modes is rigid
  Workpiece workpiece;        ///< endless block by default
  SpindleSpeedProfile speed;  ///< empty: the speed of the cut
  MillingStart start = MillingStart::immersed;
  double clearance_m = 0;       ///< entry: feed before the first touch
  double start_position_m = 0;  ///< immersed: tool axis behind the front face
  double start_angle_rad = 0;   ///< of tooth 1
  bool trochoidal_path = false;
  std::vector<ToothBreak> breaks;
  double step_s = 2e-6;
  int layers = 64;
  /// Angular points of the surface; never more than the steps of a revolution, between which the
  /// surface is linear anyway, and never less than four between two teeth.
  int surface_points = 2048;
  std::vector<double> wall_heights_m;  ///< where the wall is recorded; empty: half the depth
  double wall_spacing_m = 0;           ///< 0: a fortieth of the feed per tooth
  /// Points kept of each wall, the latest; never less than two diameters of it.
  std::size_t wall_points = std::size_t{1} << 20;
};

/// State at the end of a step. Forces and torque are those of the step, taken at its middle.
struct MillingStep {
  double t_s = 0;
  double angle_rad = 0;  ///< of tooth 1, counted on
  double spindle_speed_rad_s = 0;
  double feed_m = 0;  ///< position of the undisturbed tool axis behind the front face
  double fx_N = 0, fy_N = 0, fz_N = 0;
  double torque_Nm = 0;
  double x_m = 0, y_m = 0;
  double vx_m_s = 0, vy_m_s = 0;
  int teeth_in_cut = 0;
};

/// How an output sample is made of the steps since the last one.
enum class Decimation {
  average,  ///< means of forces, torque, displacement, velocity and speed; most teeth in cut at
            ///< once
  last,     ///< the last step
};

class MillingSimulator {
 public:
  /// Refuses, in one sentence, tools without teeth, masses that are not positive, immersion above
  /// the diameter, steps too long for the structure stiffened by the cut, and the like.
  [[nodiscard]] static Expected<MillingSimulator> create(const MillingSimulation& simulation);

  /// One step at the speed of the profile.
  const MillingStep& step();
  /// One step at a given speed, feed per tooth kept. Speed >= 0.
  const MillingStep& step(double spindle_speed_rad_s);
  /// One step at a given speed and feed. Both >= 0.
  const MillingStep& step(double spindle_speed_rad_s, double feed_m_s);

  /// Runs on for a time and hands over a sample every 1/`rate_hz`; a rate at or above that of the
  /// steps gives every step. A sample holds the steps that end within its period. Ends early, with
  /// an error, when the tool is lost.
  Expected<Done> run(double duration_s, double rate_hz, Decimation decimation,
                     const std::function<void(const MillingStep&)>& sample);
  Expected<std::vector<MillingStep>> run(double duration_s, double rate_hz,
                                         Decimation decimation = Decimation::average);

  /// True once the tool has vibrated by more than a quarter of its radius, where engagement has no
  /// meaning any more (a cut many times deeper than its stability limit). It no longer cuts then.
  [[nodiscard]] bool lost() const { return lost_; }

  /// A hammer blow on the tool.
  void strike(double x_N_s, double y_N_s) { structure_.strike(x_N_s, y_N_s); }

  [[nodiscard]] const MillingStep& now() const { return now_; }
  [[nodiscard]] const ModalResponse& structure() const { return structure_; }
  [[nodiscard]] const MachinedSurface& surface() const { return wall_; }
  [[nodiscard]] const std::vector<Engagement>& engagement() const { return arcs_; }
  /// Points of the surface in use, see MillingSimulation::surface_points.
  [[nodiscard]] int surface_points() const { return simulation_.surface_points; }

 private:
  explicit MillingSimulator(const MillingSimulation& simulation);

  MillingSimulation simulation_;
  double depth_m_ = 0;
  double feed_per_rad_m_ = 0;
  double radius_m_ = 0;
  bool endless_ = true;
  Engagement window_;
  LayeredCut cut_;
  ModalResponse structure_;
  MachinedSurface wall_;
  std::vector<Engagement> arcs_;
  double arcs_at_m_ = 0;
  double half_turn_rad_ = 0;  // of the last step, still to be turned
  std::int64_t steps_ = 0;
  std::size_t next_break_ = 0;
  bool lost_ = false;
  MillingStep now_;
};

}  // namespace servosense
