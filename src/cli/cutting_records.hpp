// A trace of test cuts as the signals that tell cutting coefficients.
#pragma once

#include <string>
#include <vector>

#include "console.hpp"
#include "servosense/identify/cutting.hpp"

namespace servosense::cli {

/// Bandwidth of a load meter and of a power for display where the file does not say
/// (current_filter_hz): Dunwoody 2010, fig. 3.3.
inline constexpr double kLoadMeter_hz = 7;

/// Drives through their observers, a dynamometer as it is, at the rate of the trace. What is said
/// of the columns goes to `remarks`. Data error as of the trace and of plan_stack().
Expected<CuttingRecord> read_cutting_record(const std::string& path, const MachineFile& machine,
                                            Progress& progress, std::vector<std::string>& remarks);

}  // namespace servosense::cli
