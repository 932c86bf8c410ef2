// A trace as one conditioned record a drive.
#pragma once

#include <vector>

#include "console.hpp"
#include "servosense/hal/sample_source.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense::cli {

/// Reads the whole trace into one conditioned record a drive.
inline Expected<std::vector<DriveRecord>> read_records(SampleSource& source, const StackPlan& plan,
                                                       Progress& progress) {
  std::vector<DriveRecord> records;
  std::vector<DriveInput<double>> inputs;
  for (const Channel channel : kDriveChannels)
    if (const HostDriveSlotConfig* slot = plan.slot_of(channel)) {
      records.push_back({channel, source.sample_period_s(), {}});
      inputs.emplace_back().configure(slot->input);
    }
  MachineServoSample sample;
  for (std::size_t n = 1;; ++n) {
    auto more = source.next(sample);
    if (!more) return more.error();
    if (!*more) break;
    for (std::size_t d = 0; d < records.size(); ++d) {
      records[d].samples.push_back(inputs[d].process(sample.drive(records[d].channel)));
      if (source.drive(records[d].channel)->temperature_column)
        records[d].temperature_C.push_back(source.temperature_C(records[d].channel));
    }
    if (n % 4096 == 0) progress.show(source.reader().progress());
  }
  return records;
}

}  // namespace servosense::cli
