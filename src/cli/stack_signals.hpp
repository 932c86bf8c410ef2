// What a recorded trace delivers to the monitor stack.
#pragma once

#include <cstdio>
#include <string>
#include <utility>

#include "servosense/hal/sample_source.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense::cli {

/// A trace whose columns are read as the machine file has it.
[[nodiscard]] inline Expected<SampleSource> open_trace(TraceReader reader, const std::string& path,
                                                       const MachineFile& machine) {
  return SampleSource::open(std::move(reader), path, SampleSource::kMaxFill,
                            column_choices(machine));
}

/// What the trace has and this command does not use, on standard error.
inline void say_columns(const SampleSource& source, bool quiet) {
  if (quiet) return;
  for (const std::string& remark : source.column_remarks())
    std::fprintf(stderr, "servosense: note: %s\n", remark.c_str());
}

[[nodiscard]] inline StackSignals signals_of(const SampleSource& source) {
  StackSignals signals;
  signals.sample_period_s = source.sample_period_s();
  for (const Channel channel : kDriveChannels)
    if (const auto& columns = source.drive(channel)) signals.drive(channel) = columns->signal;
  signals.nc_block = source.has_blocks();
  return signals;
}

}  // namespace servosense::cli
