// Cutting coefficients from records of test cuts.
//
// The means of torque and force over whole revolutions are linear in the coefficients, whatever
// immersion, helix and run-out are (model/average_cutting.hpp; Dunwoody 2010, eq. 3.19), so cuts at
// two feeds or more show them by weighted least squares. Cuts are found in the record by
// themselves; entry, exit and the lag of the sensor are skipped. What a sensor reads in the air is
// friction that the machine file has wrong: an unknown offset beside the coefficients, of its own
// at every speed (an axis: in every direction), which the air in the record tells; without air it
// is nothing within kFrictionKnown of the friction of the file.
// Run-out of the machine file is taken into account: a tooth that misses the cut has no edge force.
// Without any, what kUsualRunout_m of it would change is said.
// Bad at: a size effect: means are not linear.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/model/milling.hpp"

namespace servosense {

/// What of a test cut the machine file tells.
struct CutGeometry {
  int teeth = 1;
  double radius_m = 0;
  double axial_depth_m = 0;
  Engagement engagement;
  double feed_per_tooth_m = 0;  ///< where the record does not tell; 0: not known
  std::vector<double> throw_m;  ///< of each tooth; empty: none
  bool runout_known = false;    ///< whether the file has any, be it 0
};
/// [tool] diameter_m and teeth, with throws as milling_teeth() has them, [cut] axial_depth_m,
/// direction and radial_immersion_m. Data error for what is missing.
Expected<CutGeometry> cut_geometry(const MachineFile& machine);

/// One sensor over a record.
struct CuttingSignal {
  enum class Kind : std::uint8_t { torque, x, y, z };
  std::string name;  ///< for a reader: "spindle.load_V", "x.current_A"
  Kind kind = Kind::torque;
  /// Torque against the rotation [Nm], or force on the tool along a machine axis [N], with the
  /// friction of the file taken off; NaN where it cannot be trusted. One a sample.
  std::vector<double> value;
  double lag_s = 0;       ///< time constant with which it follows
  double filter_s = 0;    ///< what of that acts before it is sampled
  bool is_drive = false;  ///< has friction, and its speed tells how much
  double viscous = 0, coulomb = 0;
  std::vector<double> raw;  ///< as reported; empty: not known
  double quantum = 0;       ///< step of `raw`; 0: none
  double unit_per_raw = 1;  ///< of `value`, over the speed [rad/s] where `over_speed`
  bool over_speed = false;  ///< it is a power
};

/// Signals of one record at a constant rate; vectors have one value a sample, or none.
struct CuttingRecord {
  std::string name;
  double start_s = 0, sample_period_s = 0;
  std::vector<double> speed_rad_s;                  ///< of the spindle
  std::vector<double> feed_per_tooth_m;             ///< or
  std::array<std::vector<double>, 3> velocity_m_s;  ///< of x, y, z
  std::vector<std::int32_t> block;                  ///< of the program
  double known_from_rad_s = 0;                      ///< slower, the torque is not known
  double known_to_rad_s = 0;                        ///< faster, neither; 0: no limit
  /// Cuts are found by the first torque, without one by the forces of a dynamometer in the plane.
  std::vector<CuttingSignal> signals;
};

/// Mean of a signal over a part of a record.
struct CutMean {
  double value = 0, standard_error = 0;
};

/// A stretch of even speed and feed, in the cut or in the air.
struct FoundCut {
  std::size_t record = 0;
  double from_s = 0, to_s = 0;  ///< what is used of it, or where it was found
  double speed_rad_s = 0;
  double feed_per_tooth_m = 0;               ///< 0: not known
  std::array<double, 2> direction = {1, 0};  ///< of the feed, machine axes x and y
  std::array<double, 3> velocity_m_s = {0, 0, 0};
  bool air = false;
  bool used = false;
  std::string reason;          ///< why it is not used
  std::vector<CutMean> means;  ///< by signal of the record; NaN: none
};

/// Stretches of cutting and of air. Data error when the spindle stands.
Expected<std::vector<FoundCut>> find_cuts(const CuttingRecord& record, const CutGeometry& geometry);

struct SensorCoefficients {
  std::string sensor;
  Estimate tangential_N_per_m2, tangential_edge_N_per_m;
};

struct CuttingIdentification {
  Estimate tangential_N_per_m2, tangential_edge_N_per_m;
  bool edge_held = false;  ///< the edge coefficient is that of the machine file
  std::optional<Estimate> radial_ratio, radial_edge_N_per_m;
  std::optional<Estimate> axial_N_per_m2, axial_edge_N_per_m;
  double misfit = 0;  ///< square root of chi square per degree of freedom, of the tangential fit
  /// Where more than one sensor tells the tangential coefficients, the one that is used first.
  std::vector<SensorCoefficients> sensors;
  std::vector<FoundCut> cuts;  ///< with the air
  std::vector<std::string> remarks;
};

struct CuttingOptions {
  std::optional<double> tangential_edge_N_per_m;  ///< known: one feed will do
};

/// Finds the cuts of the records and fits. Signals that tell the coefficients directly (a
/// dynamometer) come before those of drives. Data error when no cut can be used or the plan of the
/// cuts cannot tell the coefficients, with what to cut.
Expected<CuttingIdentification> identify_cutting(const CutGeometry& geometry,
                                                 const std::vector<CuttingRecord>& records,
                                                 const CuttingOptions& options = {});

}  // namespace servosense
