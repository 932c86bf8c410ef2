// The drive under its controller, along the motion that it was told to make: what simulated and
// measured response have in common. The loop hides much of the plant, so this is shown and never
// decides.
#pragma once

#include <cstddef>
#include <vector>

#include "reconcile/drive/free_run.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/reconcile/drive.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {

/// Fills `command` and `loop` of `data`, or says in `no_loop` why not. `row_of`: the row of the
/// trace at each instant of an even time base; a hole repeats the row before it.
void read_loop(const MachineFile& machine, const Trace& trace,
               const std::vector<std::size_t>& row_of, DriveData& data);

/// The whole record is simulated; figures are of `from_s` to `to_s`. Efforts are compared behind a
/// low-pass of `corner_hz`.
[[nodiscard]] ClosedLoop closed_loop(const DriveData& data, const FreeModel& before,
                                     const FreeModel& after, double corner_hz, double from_s,
                                     double to_s);

}  // namespace servosense::reconcile
