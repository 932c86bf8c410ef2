// What an idling run tells of an accelerometer or a microphone: lines of the machine itself.
//
// Purpose: fans, pumps, mains and converters are heard in every cut, and are no chatter
// (monitors/sensor_chatter.hpp leaves them out).
// Method: windows of half a second (a power of two of samples), Hann, half overlapping. A line is a
// peak of twelve times the median of the 32 lines about it, 1.5 lines or more away from every
// multiple of the rotation; white noise has such a peak at one line in 4000. It is the machine's
// own where it stands in six of ten windows in which no multiple covers it. At one speed alone
// what turns with the spindle and is no multiple of it (a belt, a bearing) looks the same; two
// speeds tell them apart.
// Bad at: what the idling run does not have, coolant above all; lines that wander by more than
// 2 Hz.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense {

struct SensorIdle {
  struct Line {
    double frequency_hz = 0;
    double amplitude = 0;  ///< in the unit of the sensor
  };
  std::vector<Line> own_lines;  ///< strongest first
  double noise = 0;             ///< rms of what is in no line and no multiple of the rotation
  std::size_t windows = 0;

  /// As many as a monitor leaves out, strongest first.
  [[nodiscard]] std::vector<double> own_lines_hz(std::size_t most) const;
};

/// `values` of the sensor, and the angle of the spindle [rad], whole turns added up; not a number
/// where there was no value. Data error where no window of half a second is whole.
Expected<SensorIdle> learn_sensor(std::span<const double> values, std::span<const double> angle_rad,
                                  double sample_period_s);

}  // namespace servosense
