// Cutting coefficients of a tool and material in a file of their own, which machine files name.
//
// `[tool] coefficients = FILE` (beside the machine file) stands for the keys that FILE has in its
// [tool] section, the only one. A key that stands in both is refused: one of them would be ignored.
#pragma once

#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"

namespace servosense {

/// The machine with the coefficients of the file that it names, or as it is where it names none.
/// Data error for a key that is given twice and for a file that holds anything else; device error
/// if it cannot be read.
Expected<MachineFile> with_coefficients(const MachineFile& machine);

/// What of [tool] goes into such a file.
inline constexpr const char* kCoefficientKeys[] = {"tangential_coefficient_N_per_m2",
                                                   "tangential_edge_N_per_m",
                                                   "radial_ratio",
                                                   "radial_edge_N_per_m",
                                                   "axial_coefficient_N_per_m2",
                                                   "axial_edge_N_per_m",
                                                   "tangential_coefficient_relative_error"};

}  // namespace servosense
