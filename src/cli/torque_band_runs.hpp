// Recorded runs of a program, as the torque band monitor hears them.
#pragma once

#include <string>

#include "console.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/identify/torque_run.hpp"
#include "servosense/io/machine_file.hpp"

namespace servosense::cli {

/// The steps of a trace. `options` without the sample period. `say`: the columns that are not used.
Expected<TorqueRun> read_torque_run(const MachineFile& machine, const std::string& path,
                                    TorqueRunOptions options, Progress& progress, bool say);

/// A sound run stays below that: the warning (HeldRun::worst); else the band is too narrow.
inline constexpr double kSoundRun = 0.5;

/// What the monitor makes of a trace.
struct HeldRun {
  double worst = 0;    ///< its value, part of what alarms
  double worst_s = 0;  ///< when
};
/// `machine` names the reference.
Expected<HeldRun> hold_torque_run(const MachineFile& machine, const std::string& path,
                                  Progress& progress);

}  // namespace servosense::cli
