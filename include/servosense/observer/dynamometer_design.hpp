// Kalman gains of the dynamometer filter for one spindle speed, by the discrete Riccati equation.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <span>

#include "servosense/core/expected.hpp"
#include "servosense/observer/dynamometer_filter.hpp"

namespace servosense {

/// Measured over applied force at `frequency_rad_s` (model/dynamometer_mode.hpp).
[[nodiscard]] std::complex<double> dynamometer_response(std::span<const DynamometerMode> modes,
                                                        double frequency_rad_s);

/// The filter of one speed: z' = Phi z + w, y = C z + v, F = Cf z with cov w = Q and cov v = 1.
/// States: each mode's ringing by itself in balanced coordinates (two each, in force), the mean,
/// then two of each harmonic. In them Phi is a set of turns: its condition number is the slowest
/// decay's e^(sigma T), whatever the number of modes.
struct DynamometerDesign {
  Eigen::MatrixXd transition;  ///< Phi, exact
  Eigen::MatrixXd noise;       ///< Q: white noise on every state of the force, exact over a sample
  Eigen::RowVectorXd output;   ///< C
  Eigen::RowVectorXd force;    ///< Cf
  Eigen::MatrixXd covariance;  ///< P, before a sample, over the variance of the measured force
  Eigen::VectorXd gain;        ///< K = P C' / (1 + C P C')
  double residual = 0;         ///< of the Riccati equation, relative, Frobenius norm
  double spectral_radius = 0;  ///< of Phi (I - K C)
  double error_std = 0;        ///< of the estimate of F, over that of the measured force
  DynamometerGain block;       ///< the same gains for DynamometerFilter::configure()
};

/// Gains of `config` at `speed_rad_s`. The noise that drives each harmonic is that for which its
/// amplitude follows with a time constant of `averaged_turns` where |H| = 1. The gains of the block
/// hold for the speeds, at most 5 % away, at which they are stable. Usage error where the config is
/// invalid, the speed is not positive, a harmonic lies above the block's share of half the sample
/// rate, or H has a zero there.
Expected<DynamometerDesign> design_dynamometer_filter(const DynamometerFilterConfig& config,
                                                      double speed_rad_s);

/// Standard deviation of the error of F with another gain in the same design, as `error_std`.
[[nodiscard]] double dynamometer_error_std(const DynamometerDesign& design,
                                           const Eigen::VectorXd& gain);
/// The gain that the block uses without `DynamometerGain`, in the states of the design.
[[nodiscard]] Eigen::VectorXd dynamometer_block_gain(const DynamometerFilterConfig& config,
                                                     double speed_rad_s);

}  // namespace servosense
