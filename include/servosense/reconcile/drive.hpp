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
#include "servosense/io/machine_file.hpp"
#include "servosense/model/drive_model.hpp"
#include "servosense/observer/disturbance_observer.hpp"
#include "servosense/reconcile/options.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {

/// One drive of a trace with what the machine file says about it.
struct DriveData {
  Channel channel = Channel::x;
  double sample_period_s = 0;
  double servo_period_s = 0;  ///< of the controller; the trace may be thinned out
  double start_s = 0;
  std::vector<DriveSample<double>> samples;
  DriveModelConfig model;
  DisturbanceObserverConfig observer;  ///< of the monitors; its drive is `model`
  double unit_per_count = 0;           ///< m or rad; 0: not counted
  double effort_per_unit = 1;          ///< N/A, or Nm/A
  double expected_lag_s = 0;           ///< of the effort, from [controller.*]
  Column load_position;                ///< of a scale on the stage [m]; empty when there is none
  struct Other {
    Channel channel = Channel::y;
    Column effort;  ///< N
  };
  std::vector<Other> others;  ///< further drives that the trace shows
  std::vector<std::string> remarks;

  [[nodiscard]] bool turns() const { return channel == Channel::spindle; }
};

/// Reads one drive; without `channel`, the first of x, y, z, spindle that moves. Data error with
/// what to record when the trace lacks a column or the machine file a section.
Expected<DriveData> read_drive(const MachineFile& machine, const std::string& trace_path,
                               std::optional<Channel> channel);

struct DriveOutcome {
  Report report;
  DriveModelConfig model;  ///< recalibrated, with the effects found
  std::vector<EffectSetting> added;
};

/// The whole workflow. Data error with what to record when the trace cannot be compared.
Expected<DriveOutcome> reconcile_drive(const DriveData& data, const Options& options);

/// Writes what was found into the machine file: recalibrated parameters, and a section for each
/// effect with its provenance.
void augment(MachineFile& machine, const DriveOutcome& outcome, const std::string& provenance);

}  // namespace servosense::reconcile
