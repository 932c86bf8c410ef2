// Least squares of an idling run, and how far what the model lacks may have moved its result.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace servosense::idle_fit {

using Column = std::vector<double>;
using Columns = std::vector<const Column*>;

struct Regression {
  Eigen::VectorXd parameters;
  Eigen::VectorXd standard_errors;
  double residual_rms = 0;
  double output_rms = 0;
  double output_spread = 0;  ///< rms about the mean
};

/// Ordinary least squares. The errors allow for correlated residuals (Bartlett weights
/// up to `lag` rows) and are the larger of two: by Newey and West (1987), which lets the residual
/// vary with the motion but hangs on the few accelerations of a record and then states too little,
/// and from the residual's autocovariance over the whole record.
Regression regress(const Columns& columns, const Column& output, std::size_t lag);

/// Condition number of the regressors after scaling each to unit length.
double condition(const Columns& columns);

/// Another fit of the same parameters, which what the model lacks moves elsewhere: the square of
/// the difference, less what noise alone makes of it (Hausman 1978). `other` may hold more
/// parameters after the same ones.
Eigen::VectorXd moved_by(const Regression& fit, const Regression& other);

/// What a friction law that is no straight line over speed adds to the squares of the standard
/// errors: the jackknife (Tukey 1958) over groups of speed a factor of two apart, beyond what noise
/// makes of it, as wide as so few groups ask for (Student 1908). `speed`: the one of each row.
Eigen::VectorXd moved_by_speeds(const Regression& fit, const Columns& columns, const Column& output,
                                const Column& speed);

}  // namespace servosense::idle_fit
