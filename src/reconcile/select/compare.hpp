// How two fits of the same rows compare, block by block.
#pragma once

#include <span>

namespace servosense::reconcile {

/// Difference of two losses in its standard errors, over the same blocks.
[[nodiscard]] double standard_errors_between(std::span<const double> worse,
                                             std::span<const double> better);

}  // namespace servosense::reconcile
