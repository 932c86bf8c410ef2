// A trace of test cuts as the signals that tell cutting coefficients.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "console.hpp"
#include "servosense/identify/cutting.hpp"
#include "servosense/io/trace.hpp"

namespace servosense::cli {

/// Bandwidth of a load meter and of a power for display where the file does not say
/// (current_filter_hz): Dunwoody 2010, fig. 3.3.
inline constexpr double kLoadMeter_hz = 7;

/// Drives through their observers, a dynamometer as it is, at the rate of the trace. What is said
/// of the columns goes to `remarks`. Data error as of the trace and of plan_stack().
/// `beside`: a column that is no drive and no sensor of the cut is the last signal, as kind z;
/// data error where there is none.
Expected<CuttingRecord> read_cutting_record(const std::string& path, const MachineFile& machine,
                                            Progress& progress, std::vector<std::string>& remarks,
                                            std::optional<Signal> beside = std::nullopt);

}  // namespace servosense::cli
