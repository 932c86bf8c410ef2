// Pairs of signals and the machine file: [monitor.signal.x] and of every other drive.
#pragma once

#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/paired_signals.hpp"

namespace servosense {

/// "monitor.signal.x"
[[nodiscard]] std::string pair_section(Channel channel);
/// "load_band_m", "load_terms"
struct PairKeys {
  std::string band, terms;
};
[[nodiscard]] PairKeys pair_keys(PairKind kind, Channel channel);
inline constexpr const char* kIdleEffortTerms = "idle_effort_terms";
/// Of band and difference: "m", "rad", "N" or "Nm".
[[nodiscard]] const char* pair_unit(PairKind kind, Channel channel);

/// Data error where the machine file cannot scale the drive.
Expected<PairScaling> pair_scaling(const MachineFile& machine, const PairedColumns& columns);

/// Whether the columns have both sides of a pair.
[[nodiscard]] bool has_pair(const PairedColumns& columns, PairKind kind);

/// A pair of the trace, and the watch of it that the machine file asks for.
struct PlannedPair {
  PairKind kind = PairKind::load;
  bool runs = false;
  std::string reason;  ///< what it watches, or why it does not
  PairWatchConfig config;
};
Expected<std::vector<PlannedPair>> plan_pairs(const MachineFile& machine,
                                              const PairedColumns& columns);

/// The sentence of an event.
[[nodiscard]] std::string pair_text(const PairWatch& watch, Channel channel, bool beyond);

}  // namespace servosense
