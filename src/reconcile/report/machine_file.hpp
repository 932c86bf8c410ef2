// Numbers as text, and what reconcile writes into a machine file.
#pragma once

#include <string>

#include "servosense/io/machine_file.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {

/// To eight digits: what is written reads back as it was judged.
[[nodiscard]] double rounded(double value);

/// "+- 0.12 (standard error)".
[[nodiscard]] std::string error_note(double standard_error, int digits);

/// The section of a named effect: parameters with their errors, and where they come from.
void set_effect(MachineFile& machine, const std::string& section, const FoundEffect& effect,
                const std::string& provenance, const std::string& gap_unit, int error_digits);

}  // namespace servosense::reconcile
