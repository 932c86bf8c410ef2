// The workpiece and the course of the spindle's speed, as [simulation] describes them in words or
// names their files.
#pragma once

#include <string>
#include <string_view>

#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/sim/spindle_speed_profile.hpp"
#include "servosense/sim/workpiece.hpp"

namespace servosense::detail {

/// What is wrong with a key, and where it stands.
Error wrong_at(const MachineFile& machine, std::string_view section, std::string_view key,
               const std::string& what);

/// A wedge that gives no length is as long as the travel of the cut.
Expected<Workpiece> workpiece_of(const MachineFile& machine, double travel_m);

/// Empty when the file gives none: the speed of the cut, all the time.
Expected<SpindleSpeedProfile> speed_profile(const MachineFile& machine, double cut_rpm,
                                            double duration_s);

}  // namespace servosense::detail
