// Times of trace rows as text.
#pragma once

#include <string>
#include <string_view>

#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense::detail {

inline constexpr std::string_view kTimeColumn = "t_s";

/// Decimal seconds to nanoseconds in integer arithmetic, so that long recordings keep every digit;
/// what lies beyond the ninth decimal is rounded, halves away from zero.
ParsedNumber<Nanoseconds> parse_time(std::string_view text) noexcept;
/// Appends the shortest spelling that reads back as the same time.
void append_time(std::string& out, Nanoseconds t_ns);

}  // namespace servosense::detail
