// Reconcile a cut: the milling model of a machine file against forces measured while milling.
//
// Forces are averaged over revolutions, so that what turns with the tool stays and noise and what
// is fixed in time go. The model is not linear in what it may have wrong (the angular zero of the
// encoder, the immersion, the lag of the helix), so every candidate effect is a refit of the whole
// cut with the effect's parameters free, all of these and the cutting coefficients beside it; what
// is compared is what each refit leaves. Effects: model/cutting_effects.hpp.
// Bad at: transients but for those of a mode of the tool (else only whole revolutions at a steady
// feed count), chatter (reported as a line),
// and cuts whose engagement changes on the way.
#pragma once

#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/model/milling.hpp"
#include "servosense/model/structural_mode.hpp"
#include "servosense/reconcile/options.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {

/// Forces of a trace over the angle of the spindle, with what the machine file says about the cut.
struct CuttingData {
  std::string channel = "dyno";
  MillingTool tool;
  MillingCut cut;
  Structure structure;
  Column time_s;
  Column angle_rad;  ///< of tooth 1, counted on
  Column feed_per_tooth_m;
  Column force_x_N, force_y_N;
  std::vector<bool> valid;
  std::vector<BadSignal> bad_signals;  ///< left out
  std::vector<std::string> remarks;
};

/// True when the trace has forces of a cut.
[[nodiscard]] bool has_cutting_forces(const Trace& trace);
/// True when a sensor has recorded one component of them alone.
[[nodiscard]] bool has_one_cutting_force(const Trace& trace);

/// Data error with what to record when the trace lacks forces or the spindle's angle, or the
/// machine file the tool or the cut.
Expected<CuttingData> read_cutting(const MachineFile& machine, const Trace& trace,
                                   const Criteria& criteria = kCriteria);

/// What was found, ready for the machine file.
struct CuttingOutcome {
  Report report;
};

/// The whole workflow. Data error with what to record when the trace cannot be compared.
Expected<CuttingOutcome> reconcile_cutting(const CuttingData& data, const Options& options);

/// Writes recalibrated parameters and a section for each effect with its provenance.
void augment(MachineFile& machine, const CuttingOutcome& outcome, const std::string& provenance);

}  // namespace servosense::reconcile
