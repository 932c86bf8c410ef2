// What keeps a transfer function from being told, each with its sentence.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "servosense/identify/transfer.hpp"
#include "transfer_lines.hpp"

namespace servosense::transfer {

/// Records of one rate, signals that vary.
[[nodiscard]] Expected<Done> check_records(std::span<const TransferRecord> records,
                                           const TransferOptions& options);
/// Signals that have their sign.
[[nodiscard]] Expected<Done> check_signs(std::span<const TransferRecord> records,
                                         const TransferOptions& options, std::size_t segment);
/// An input of a few lines tells of those alone. `runs`: coherent and excited.
[[nodiscard]] Expected<Done> check_excitation(const std::vector<LineRun>& runs,
                                              const std::vector<double>& power, double line_hz,
                                              const TransferOptions& options);

}  // namespace servosense::transfer
