// Reconcile a drive: the model of an axis or a spindle against a trace of it moving without
// cutting.
//
// The comparison is of forces (torques): what the motor exerted against what the model says the
// motion took, both through one zero-phase filter (Gautier 1997; Janot, Gautier and Brunot 2019).
//   u(t) = M a + D v + C S(x) + L + effects
// Every effect of the catalogue (model/drive_effects.hpp) takes part by driving its own class with
// the measured motion, so what is found is what observer and simulator will do with it.
// Bad at: effects above the filter's corner, and at standstill, where friction may hold any force.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/drive_sample.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/motor_temperature.hpp"
#include "servosense/model/drive_model.hpp"
#include "servosense/observer/disturbance_observer.hpp"
#include "servosense/reconcile/options.hpp"
#include "servosense/reconcile/report.hpp"
#include "servosense/sim/drive_simulator.hpp"

namespace servosense::reconcile {

/// One drive of a trace with what the machine file says about it.
struct DriveData {
  std::string source;  ///< the trace
  Channel channel = Channel::x;
  double sample_period_s = 0;
  double servo_period_s = 0;  ///< of the controller; the trace may be thinned out
  double start_s = 0;
  double start_position = 0;  ///< of a position as recorded; 0 for counts [m or rad]
  std::vector<DriveSample<double>> samples;
  DriveModelConfig model;
  DisturbanceObserverConfig observer;  ///< of the monitors; its drive is `model`
  double unit_per_count = 0;           ///< m or rad; 0: not counted
  double motion_step = 0;              ///< m or rad, of a position or speed in whole steps; 0: not
  double effort_per_unit = 1;          ///< N/A, or Nm/A
  Column temperature_C;                ///< of the motor, a sample each; empty: not recorded
  ConstantOverTemperature constant;    ///< that the efforts have
  double expected_lag_s = 0;           ///< of the effort, from [controller.*]
  /// Behind the transmission, by a scale or an encoder of its own beside that of the motor [m or
  /// rad]; empty when there is none.
  Column load_position;
  double motor_turn = 0;  ///< of the drive, a turn of the motor [m or rad]; 0: not known
  struct Other {
    Channel channel = Channel::y;
    Column position;  ///< m, from where it stood first
    Column effort;    ///< N; empty where it is not recorded
  };
  std::vector<Other> others;                 ///< further drives that the trace shows
  std::optional<DriveSimulatorConfig> loop;  ///< the drive under its controller...
  Column command;                            ///< ...and what that was told [m or rad]
  std::string no_loop = "the trace does not say what the drive was told";  ///< why there is none
  std::vector<BadSignal> bad_signals;                                      ///< left out
  std::vector<std::string> remarks;

  /// Of a torque or force, `model` knows of no ampere.
  [[nodiscard]] EffortKind effort_kind() const {
    return model.effort_per_ampere > 0 ? EffortKind::current_A
           : turns()                   ? EffortKind::torque_Nm
                                       : EffortKind::force_N;
  }
  [[nodiscard]] bool turns() const { return is_turning(channel); }
};

/// The presliding distance where nobody says it: what rolls in a screw and its bearings rolls with
/// the turn, so it is a share of that, and a record in other units is searched alike.
[[nodiscard]] double usual_presliding(const DriveModelConfig& model, Channel channel);

/// Reads one drive; without `channel`, the first of x, y, z, a, b, c, spindle, spindle2 that moves.
/// Data error with what to record when the trace lacks a column or the machine file a section.
Expected<DriveData> read_drive(const MachineFile& machine, const std::string& trace_path,
                               std::optional<Channel> channel,
                               const Criteria& criteria = kCriteria);

struct DriveOutcome {
  Report report;
  DriveModelConfig model;  ///< recalibrated, with the effects found
  std::vector<EffectSetting> added;
  std::optional<ConstantOverTemperature> constant;  ///< where it is not that of the data
  /// Effects that the model had already: their size, 1 when right.
  struct Size {
    std::string name;
    double size = 1, error = 0;
  };
  std::vector<Size> sizes;
};

/// The whole workflow. `second`: another record of the same drive, on which nothing is fitted but
/// what a new power-up changes; an effect that does not pay there is not named. Data error with
/// what to record when a trace cannot be compared.
Expected<DriveOutcome> reconcile_drive(const DriveData& data, const Options& options,
                                       const DriveData* second = nullptr);

/// The report on a record that the workflow refuses: no name, but what the record cannot show, what
/// it cannot tell apart and which motion would.
[[nodiscard]] Report refusal(const DriveData& data, const Error& why, const Options& options);

struct DriveChanges {
  DriveOutcome earlier;
  DriveOutcome later;  ///< `changed` of its report is the answer
};

/// What has changed on a drive since an earlier record of it, both of the same moves without
/// cutting: the model is brought to the earlier record and then compared with the later one. What
/// counts are parameters that moved and effects that came up. Data error as reconcile_drive().
Expected<DriveChanges> changes_since(const DriveData& earlier, const DriveData& later,
                                     const Options& options);

/// Writes what was found into the machine file: recalibrated parameters, and a section for each
/// effect with its provenance.
void augment(MachineFile& machine, const DriveOutcome& outcome, const std::string& provenance);

/// Of the effects just written, those stay with the monitors that make them read less on the part
/// of the record that was kept for the proof, through the observer that they listen to; the others
/// get `used_by_monitors = no`. Says so in the report, with what the monitors read with the file as
/// it was (`before`) and as it is.
void choose_for_monitors(MachineFile& machine, const MachineFile& before, const DriveData& data,
                         Report& report);

}  // namespace servosense::reconcile
