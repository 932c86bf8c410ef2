// The table of `program predict` as a reference of the torque band monitor.
//
// Its rows are steps of the program, each over the time since the row before: they become points
// at equal times of steady turning, a section for each line (`machine.nc_block` is its number).
// Around what is predicted, low_Nm to high_Nm, lies the tolerance in magnitude, then that in time:
// the greatest upper and the smallest lower limit within it (Bertok 1984, section 5.4). Where
// torque is not known nothing is expected. What else the rows say of a step, its force and where
// the teeth are in the cut, goes beside the points (monitors/expected_cut.hpp).
#pragma once

#include <string>
#include <string_view>

#include "servosense/core/expected.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/monitors/torque_band_file.hpp"

namespace servosense {

/// Whether this is the header of such a table.
[[nodiscard]] bool is_prediction(std::string_view header);

/// The rows behind the header. Errors as of read_torque_band().
Expected<TorqueBandReference> read_prediction(LineReader& lines, std::string_view header,
                                              const PredictedBand& band);

}  // namespace servosense
