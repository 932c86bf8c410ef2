// One vibration mode of a dynamometer: what it adds to the force that is measured.
#pragma once

namespace servosense {

/// Measured over applied force of one direction is
///   H(s) = 1 - sum c_k + sum c_k w_k^2 / (s^2 + 2 z_k w_k s + w_k^2)
/// (Dunwoody 2010, eq. 5.1 to 5.6, K_k = c_k w_k^2): the shares c_k say how much of the static gain
/// passes through each mode; what is left to one passes at once, the static part of higher modes.
struct DynamometerMode {
  double natural_frequency_hz = 0;
  double damping_ratio = 0;
  double share = 0;  ///< c_k; negative where the mode swings against the force
};

}  // namespace servosense
