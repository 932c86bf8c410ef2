// What the units that data sheets and DBC files use are in those of trace columns.
#pragma once

#include <optional>
#include <string_view>

#include "servosense/core/channel.hpp"

namespace servosense::detail {

/// The unit of a quantity: "rad/s" of speed_rad_s; "" if it has none.
std::string_view unit_of(Quantity quantity);
/// The value of one `unit`, such as "1/min" or "mA", in the unit of `quantity`; nothing if it is no
/// unit of that kind, or not known. UTF-8 or Latin-1.
std::optional<double> value_of_unit(std::string_view unit, Quantity quantity);

}  // namespace servosense::detail
