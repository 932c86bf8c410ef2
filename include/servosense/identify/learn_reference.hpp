// A reference from traces of sound cuts.
//
// Purpose: what sound cuts look like, from records that a machine writes anyway.
// Method: a first reading tells rate, speed, which parts cut, and how large each signal is; a
// second one cuts the windows (identify/reference_windows.hpp).
// Cut and air: mean magnitude of the effort of the spindle (else of the tool, else of the axes) in
// short stretches at the usual speed of the spindle. Their logarithms lie in hills, one a state of
// the machine; the lightest is air where a valley parts it from the next and most records begin or
// end in it. Where none is, everything is a cut.
// Window: kUsualTurns turns (kLeastTurns where the cuts are short) and kLeastSamples samples at
// least; longer where the cuts are.
// Bad at: cuts that load the spindle by a few per cent of its idling: all is taken for a cut then.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/reference.hpp"
#include "servosense/io/machine_file.hpp"

namespace servosense {

struct LearnReferenceOptions {
  double window_s = 0;  ///< 0 = chosen
  double false_alarms = 1e-3;
  /// Called with the share of the work that is done.
  std::function<void(double)> progress = [](double) {};
};

struct LearnedReference {
  Reference reference;
  double cutting_s = 0, total_s = 0;
  std::vector<std::size_t> windows;  ///< that were learned from, one a trace
  std::vector<std::string> remarks;  ///< what a reader must know
};

/// `machine` tells teeth and diameter of the tool, a speed that no column tells, counts of the
/// encoder. Each trace is read twice. Data error where the traces do not go together or hold too
/// little.
Expected<LearnedReference> learn_reference(const MachineFile& machine,
                                           const std::vector<std::string>& traces,
                                           const LearnReferenceOptions& options = {});

/// Shortest window that shows orders and bands.
[[nodiscard]] double least_window_s(const ReferenceLayout& layout);

/// Where the turns of the spindle stand among these columns.
[[nodiscard]] Expected<TurnColumn> turn_column(const MachineFile& machine,
                                               const std::vector<Signal>& columns);

}  // namespace servosense
