// Whether a position and a speed of one drive are each other's derivative, and by which factor.
#pragma once

#include <cstddef>
#include <optional>

#include "import_survey.hpp"

namespace servosense::detail {

/// Steps of the position against speed times steps of time, all as they stand in the file.
struct Agreement {
  double ratio = 0;           ///< position steps per (speed * time); negative: opposite signs
  double standard_error = 0;  ///< of ratio
};
/// Nothing where they have too little in common to say: no motion, a gear of changing ratio, an
/// angle too fast for the rows. `position`, `speed`: indices among the columns of the sample.
[[nodiscard]] std::optional<Agreement> agreement_of(const RowSample& sample, std::size_t position,
                                                    std::size_t speed, double position_range);

}  // namespace servosense::detail
