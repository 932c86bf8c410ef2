// Least squares over all lines at once: step 3 of identify/modes.hpp.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "modes_lines.hpp"

namespace servosense::modes {

/// Of one receptance: residue of each pole [1/kg], compliance [m/N], inverse mass [1/kg].
struct LinearFit {
  Eigen::VectorXd values;
  Eigen::MatrixXd covariance;  // the poles' own errors in it, after refine()
  Eigen::VectorXcd rest;       // measured - fitted, over the noise
  double level = 1;            // variance of the rest, real and imaginary part each
  double alike = 1;            // how much wider errors are because the rest is alike in neighbours
  [[nodiscard]] double scale() const { return level * alike; }
};

struct PoleFit {
  std::vector<Pole> poles;
  std::vector<LinearFit> receptances;
  Eigen::MatrixXd covariance;  // of log w and log damping, pole by pole; empty before refine()
};

/// What is linear, with these poles.
[[nodiscard]] PoleFit fit_linear(const std::vector<Lines>& lines, std::vector<Pole> poles);

/// Everything, from these poles on.
[[nodiscard]] PoleFit refine(const std::vector<Lines>& lines, std::vector<Pole> poles);

/// By how much the sum of squares, each receptance over its scale(), would rise without a pole; of
/// fit_linear() over its level, since poles that are off leave a rest that is alike anyway.
[[nodiscard]] double need_of(const PoleFit& fit, std::size_t pole);
/// By how much it would fall with a further one.
[[nodiscard]] double gain_of(const std::vector<Lines>& lines, const PoleFit& fit, const Pole& pole);

[[nodiscard]] Eigen::VectorXcd fitted_response(const Lines& lines, const PoleFit& fit,
                                               std::size_t receptance);

}  // namespace servosense::modes
