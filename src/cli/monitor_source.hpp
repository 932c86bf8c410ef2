// Where `servosense monitor` takes its samples from: a trace, a candump log, a CAN interface, or a
// Modbus slave.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "effort_pairs.hpp"
#include "pair_watches.hpp"
#include "reference_watch.hpp"
#include "sensor_watches.hpp"
#include "servosense/hal/sample_source.hpp"

namespace servosense::cli {

/// Its options, for the help.
[[nodiscard]] std::vector<Option> source_options();

struct MonitorSource {
  SampleSource samples;
  std::string name;                      ///< as the user gave it
  bool live = false;                     ///< ends when asked to
  std::shared_ptr<TraceWriter> record;   ///< of --record, to be closed; may be none
  std::shared_ptr<EffortPairs> efforts;  ///< hears the rows
};

/// Usage error for options that do not go together.
Expected<Done> check_source(const Arguments& arguments);
/// Opens what the options ask for. Requires check_source(). `stop` ends a live source; `watch`,
/// `pairs` and `sensors` hear the rows.
Expected<MonitorSource> open_source(const Arguments& arguments, const MachineFile& machine,
                                    const std::atomic<bool>& stop, ReferenceWatch& watch,
                                    PairWatches& pairs, SensorWatches& sensors);

}  // namespace servosense::cli
