// Turns a tool so that a hammer that is fixed to the table hits it behind a cutting edge, and sets
// the distance sensor below the hammer to its zero (Dunwoody 2010, 4.1, 4.2, 6.2).
//
// A solid end mill can be hit only behind a flute, an inserted cutter only on the flat behind an
// insert. The sensor cannot see the place that the hammer hits, for then the tool would stand in
// the table. With a constant helix the flute turns as far from the sensor to the hammer as from the
// tool's end to half of that: theta_A = 2 theta_B - theta_C (4.1). A pitch too many in theta_B is
// two in theta_A: on another flute, and as good.
//
// The source walks along the flute in growing steps (4.7). Where the sensor sees nothing between
// the flutes there is no slope to walk along, so one pitch is scanned instead, and the best place
// with its neighbours is narrowed by golden section, always about the nearest place so far.
//
// Where the hammer hits a flute the sensor faces whatever the helix has turned there, a gullet
// perhaps. So the zero is set on the flute first, where nothing of the tool can be nearer. From
// there the tool turns to where it is hit and goes on towards the sensor, at most until an edge
// that the sensor is wide enough to meet is half the gap away: then the sensor ends short of its
// zero, in its range, and that is said. No move towards the sensor is longer than `longest_step_m`,
// and none is made but from farther than its zero. After an error the tool is drawn back to where
// it stood. The slope is that of readings on both sides of where it ends: the sensor is curved, and
// the last step may be tiny. Bad at: variable helix; a collar or another edge above the sensor's
// height, which the sensor does not see.
#pragma once

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/core/units.hpp"
#include "servosense/hal/cnc_channel.hpp"

namespace servosense {

struct DistanceReading {
  double volts = 0;           ///< mean; greater is nearer, 0 in the middle of the range
  double standard_error = 0;  ///< of that mean [V]
};

/// A capacitive or other distance sensor and whatever reads it.
class DistanceSensor {
 public:
  DistanceSensor() = default;
  DistanceSensor(const DistanceSensor&) = delete;
  DistanceSensor& operator=(const DistanceSensor&) = delete;
  virtual ~DistanceSensor() = default;

  /// Mean over some 10 ms; an error when the reader does not answer in its own time limit.
  virtual Expected<DistanceReading> read() = 0;
};

struct AutomaticHammerConfig {
  unsigned teeth = 4;     ///< 1 to 32, equally spaced or nearly
  bool inserted = false;  ///< inserts at the tool's end alone: the flat behind one is hit
  double behind_edge_rad =
      0;  ///< from the nearest place to where it shall be hit, against the rotation
  double tool_radius_m = 0;   ///< to the cutting edges
  double land_share = 0.4;    ///< of the pitch that land and heel take behind an edge, at most
  double sensor_width_m = 0;  ///< of its housing, along y
  double hammer_above_sensor_m = 0.015;  ///< hammer's tip above the sensor's middle
  double feed_m_s = 0.001;
  double greatest_volts = 9.5;  ///< beyond, the sensor sees nothing, or too much
  // Search for a flute.
  unsigned scanned = 16;                         ///< places of one pitch
  double angle_tolerance_rad = rad_from_deg(1);  // Dunwoody: 1.5, of which noise takes a part
  // Zero of the sensor; +x is towards it.
  double zero_tolerance_V = 0.1;
  double zero_gap_m = 0.25e-3;       ///< between sensor and tool at 0 V, from its data sheet
  double longest_step_m = 0.1e-3;    ///< at most half of `zero_gap_m`
  double longest_approach_m = 3e-3;  ///< to the flute, or back from it
  unsigned steps = 120;              ///< at most
};

struct FluteFound {
  double hit_rad = 0;        ///< theta_A, 0 to 2 pi: where the hammer meets a flute
  double at_sensor_rad = 0;  ///< theta_B
  double at_end_rad = 0;     ///< theta_C
  unsigned probes = 0;       ///< orientations that were tried
};

struct SensorZeroed {
  double volts = 0;        ///< where it ended
  double volts_per_m = 0;  ///< there, for the receptance
  double volts_per_m_standard_error = 0;
  double moved_m = 0;  ///< along x, from where it stood
  unsigned steps = 0;
  bool land_in_the_way = false;  ///< ended before its zero, because a land would have come too near
};

class AutomaticHammer {
 public:
  /// Channel (open) and sensor must outlive it.
  AutomaticHammer(CncChannel& cnc, DistanceSensor& sensor, const AutomaticHammerConfig& config);

  /// Finds the flute with the sensor at the tool's end and half way to the hammer, and goes back.
  /// The tool stands before the sensor, its end at the sensor's height, a flute within the sensor's
  /// range. At most 2 (scanned + 16) orientations.
  Expected<FluteFound> find_flute();
  /// Leaves the tool turned to `flute.hit_rad`, and so far along x that the sensor shows zero.
  Expected<SensorZeroed> zero_sensor(const FluteFound& flute);

 private:
  [[nodiscard]] Expected<Done> checked() const;
  Expected<DistanceReading> read();
  Expected<DistanceReading> read_at(double angle_rad);
  Expected<double> nearest(double from_rad, const char* where);
  Expected<Done> move(Channel axis, double distance_m);
  Expected<Done> approach(double limit_m, double blind_m, SensorZeroed& out);
  Expected<Done> measure_slope(SensorZeroed& out);
  [[nodiscard]] double clear_way_m(const FluteFound& flute) const;

  CncChannel& cnc_;
  DistanceSensor& sensor_;
  AutomaticHammerConfig config_;
  unsigned probes_ = 0;
  double moved_m_ = 0;
};

}  // namespace servosense
