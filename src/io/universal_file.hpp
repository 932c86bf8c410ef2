// Frequency responses as ASCII datasets 58 of universal files.
#pragma once

#include <string>
#include <string_view>

#include "servosense/io/frf_file.hpp"

namespace servosense {

/// Line of a text that says how fast the exponential window fell.
inline constexpr std::string_view kExponentialWindowKey = "exponential_window_per_s:";

/// Puts the rate of a line that holds the key into `response`; a data error for one that is none.
Expected<Done> take_exponential_window(const LineReader& lines, std::string_view line,
                                       FrequencyResponse& response);

/// The rest of a universal file, from behind the first line (-1) on.
Expected<FrequencyResponse> read_universal_frf(LineReader& lines);

[[nodiscard]] std::string universal_frf_text(const FrequencyResponse& response,
                                             const std::string& title);

}  // namespace servosense
