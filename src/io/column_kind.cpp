// What foreign columns are of, and the units that go with it.
#include <array>

#include "heading_meaning.hpp"

namespace servosense::detail {

std::string_view kind_name(ColumnKind kind_) {
  constexpr auto kNames = std::to_array<std::string_view>(
      {"a time", "a date", "a position", "a speed", "a speed of rotation", "an acceleration",
       "a current", "a torque", "a force", "a power", "a load", "a voltage", "a temperature",
       "a block number", "an override", "a count"});
  return kNames[static_cast<std::size_t>(kind_)];
}

bool kind_fits(ColumnKind kind_, Dimension d) {
  switch (kind_) {
    case ColumnKind::time:
      return d == Dimension::time;
    case ColumnKind::date:
      return false;
    case ColumnKind::position:
      return d == Dimension::length || d == Dimension::angle || d == Dimension::counts;
    case ColumnKind::speed:
      return d == Dimension::velocity || d == Dimension::angular_speed;
    case ColumnKind::rotation:
      return d == Dimension::angular_speed;
    case ColumnKind::acceleration:
      return d == Dimension::acceleration;
    case ColumnKind::current:
      return d == Dimension::current || d == Dimension::share;
    case ColumnKind::torque:
      return d == Dimension::torque || d == Dimension::share;
    case ColumnKind::force:
      return d == Dimension::force;
    case ColumnKind::power:
      return d == Dimension::power;
    case ColumnKind::load:
      return d == Dimension::share || d == Dimension::voltage;
    case ColumnKind::voltage:
      return d == Dimension::voltage;
    case ColumnKind::temperature:
      return d == Dimension::temperature;
    case ColumnKind::block:
      return d == Dimension::none;
    case ColumnKind::override_:
      return d == Dimension::share;
    case ColumnKind::counts:
      return d == Dimension::counts;
  }
  return false;
}

}  // namespace servosense::detail
