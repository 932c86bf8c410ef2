// A drive that swings all the time, above the band in which forces are compared, and the noise
// beside that.
#pragma once

#include <string>

#include "servosense/reconcile/drive.hpp"

namespace servosense::reconcile {

/// A sinusoid that the drive keeps up in motion.
struct LimitCycle {
  double frequency_hz = 0;  ///< 0: there is none
  double amplitude = 0;     ///< m or rad
};

/// A loop that is set too high, or has backlash in it, swings all the time: in most of the motion
/// one line above 100 Hz, always of the same frequency, carries most of what is there, and is
/// faster than a hundredth of the top speed: where the drive is slow, it turns friction over.
LimitCycle find_limit_cycle(const DriveData& data, const Criteria& criteria = kCriteria);

/// What to do about it, in a sentence of the report.
std::string advice_on(const LimitCycle& limit_cycle, bool turns);

/// Why a friction law and a soft coupling have no name beside it; empty for what may have one.
std::string unnameable_under(const LimitCycle& limit_cycle, const std::string& effect);

/// Standard deviation of the white part of a signal that holds a swing, whose harmonics are no
/// noise: the median level of its spectrum between a quarter and a half of the sample rate. 0 where
/// the signal is too short. Of the stretches in which it moves by `moving` a sample.
double noise_beside_limit_cycle(const Column& x, double period_s, double moving);

}  // namespace servosense::reconcile
