#include "servosense/identify/hammer_offset.hpp"

#include <cmath>

#include "servosense/io/text.hpp"

namespace servosense {

Expected<double> hammer_offset_factor(double offset_m, double stick_out_m) {
  if (!(stick_out_m > 0) || !std::isfinite(stick_out_m))
    return usage_error("the stick-out has to be a length above 0 m; measure it from the holder");
  if (!(offset_m >= 0) || !(offset_m < stick_out_m))
    return usage_error("the hammer hits " + printed(1e3 * offset_m, 4) +
                       " mm above the sensor, but the tool sticks out " +
                       printed(1e3 * stick_out_m, 4) +
                       " mm only: the offset has to be less; hit the tool nearer to its tip");
  const double l = stick_out_m - offset_m;
  return 2 * std::pow(stick_out_m, 3) / (l * l * (3 * stick_out_m - l));
}

}  // namespace servosense
