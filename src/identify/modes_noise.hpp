// Noise of each line of a receptance, up to a common factor.
#pragma once

#include <Eigen/Dense>

namespace servosense::modes {

/// Standard deviation of real and imaginary part [m/N], from the standard errors of the complex
/// values, else from the coherence, of neighbours each. Both may be empty, or say nothing because
/// nothing was averaged: fourth differences from line to line tell the noise then.
[[nodiscard]] Eigen::VectorXd noise_of(const Eigen::VectorXcd& response,
                                       const Eigen::VectorXd& coherence,
                                       const Eigen::VectorXd& standard_error);

}  // namespace servosense::modes
