// How fine must an encoder be? What counts alone put into the estimate of an observer.
//
// Purpose: Koike 2016, sec. 3.3 (fig. 3-3 to 3-5): the drive turns at one speed, its angle is cut
// to counts, nothing else acts; the largest line of the estimate is what a line of the cut must
// exceed. Method: the observer itself (observer/disturbance_observer.hpp, Tustin, both cutoffs
// alike) over 15360 samples after it has settled, Fourier transform without a window: the speeds of
// the source repeat after 15 samples, so that their lines fall on lines of it. Bad at: one line
// stands for all; at a speed a little off, counts spread over many.
#pragma once

namespace servosense {

struct EncoderStudyDrive {
  double inertia = 0;          ///< kg or kg m2
  double travel_per_turn = 0;  ///< of the encoder: m, or 2 pi
  double speed = 0;            ///< m/s or rad/s
  double sample_period_s = 125e-6;
};

/// Amplitude of the largest line [N or Nm]; all arguments positive, cutoff_rad_s below 2 / period.
[[nodiscard]] double encoder_noise(const EncoderStudyDrive& drive, double counts_per_turn,
                                   double cutoff_rad_s);

}  // namespace servosense
