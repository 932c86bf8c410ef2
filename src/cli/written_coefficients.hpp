// Cutting coefficients as they go into [tool] of a machine file or of a coefficient file.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "servosense/identify/idle.hpp"
#include "servosense/io/machine_file.hpp"

namespace servosense::cli {

/// A coefficient by its key in the machine file.
struct NamedCoefficient {
  const char* key;
  const char* unit;
  Estimate estimate;
};

/// Replaces what [tool] of `file` has of them; the first is the tangential coefficient. An edge
/// force or a radial ratio is not negative to those who read it: one that is, of noise, is left out
/// and said in `remarks`. The axial ones have either sign.
void write_coefficients(MachineFile& file, std::span<const NamedCoefficient> coefficients,
                        const std::string& provenance, std::vector<std::string>& remarks);

/// A coefficient file of its own (io/coefficient_file.hpp), with the material of the machine file.
/// Device error where it cannot be written.
Expected<Done> write_coefficient_file(const std::string& path, const MachineFile& machine,
                                      std::span<const NamedCoefficient> coefficients,
                                      const std::string& provenance,
                                      std::vector<std::string>& remarks);

}  // namespace servosense::cli
