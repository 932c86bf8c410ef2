// Whether a record can be believed, asked before anything is compared with it.
//
// A sample is stray where nothing around it supports it: it is far from what its neighbours before,
// those behind and both together say, by their medians (Hampel 1974), in the spread of such
// departures there and in that of the neighbours themselves. A step, a corner and a swing are
// supported from one side; a spike, a glitch and a row out of order from none. Strays matter when
// together they could move the column by as much as is worth a name. A few are left out, with their
// neighbours in their place; of many nobody knows which are right, and the record is refused.
// Bad at: strays within the noise, or a tenth of what the column does; many samples in a row that
// follow a wrong but smooth course.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/reconcile/criteria.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {

/// What is said of strays.
inline constexpr const char* kStray =
    "fit none of their neighbours, as spikes and rows out of order do";

/// A value that a column keeps for some samples: of slow updates, or of counts.
struct Held {
  double value;
  std::size_t first, samples;
  bool stray = false;
  double weight = 0;  // of a stray that shows at once: how far it is, times its samples
};

[[nodiscard]] std::vector<Held> held_values(const Column& values);

/// Samples of a column that its neighbours do not support; none where they do not matter. `size`:
/// how large what the column does is.
[[nodiscard]] std::vector<std::size_t> stray_samples(const Column& values, double size,
                                                     const Criteria& criteria);
/// The same of a force that comes again with the angle of the tool: supported neither by its
/// neighbours in time nor by those at the same angle of other turns.
[[nodiscard]] std::vector<std::size_t> stray_forces(const Column& force_N, const Column& angle_rad,
                                                    const Criteria& criteria);
/// Samples that repeat the largest value of a force, or keep one value through half a turn.
[[nodiscard]] std::vector<std::size_t> cut_off_samples(const Column& force_N,
                                                       const Column& angle_rad);
/// Rms of a column about its median, its largest hundredths cut down to the rest; of a motion, of
/// its steps.
[[nodiscard]] double size_of_effort(const Column& values);
[[nodiscard]] double size_of_motion(const Column& values);

/// What was left out of a column; nothing where it is sound. Data error where that is too much.
Expected<std::vector<BadSignal>> leave_out(const std::string& column, const char* fault,
                                           const char* check, const Column& time_s,
                                           const std::vector<std::size_t>& samples,
                                           const Criteria& criteria);

/// Rows in which a motion stands still in full travel: its samples repeat, and it goes on at speed.
[[nodiscard]] std::vector<std::size_t> stuck_samples(const Column& motion,
                                                     const Criteria& criteria);

}  // namespace servosense::reconcile
