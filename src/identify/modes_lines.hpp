// Lines of one receptance as they are fitted.
#pragma once

#include <Eigen/Dense>
#include <complex>
#include <string>

namespace servosense::modes {

struct Lines {
  std::string name;
  bool direct = true;
  double decay_per_s = 0;     // of the exponential window
  Eigen::VectorXd w_rad_s;    // rising, above 0
  Eigen::VectorXcd response;  // m/N
  Eigen::VectorXd noise;      // standard deviation of real and imaginary part; its level may be off
  [[nodiscard]] Eigen::Index count() const { return w_rad_s.size(); }
  [[nodiscard]] std::complex<double> s(Eigen::Index k) const { return {decay_per_s, w_rad_s(k)}; }
};

struct Pole {
  double w_rad_s = 0;  // natural
  double damping = 0;
  [[nodiscard]] std::complex<double> upper() const {
    return w_rad_s * std::complex<double>(-damping, std::sqrt(1 - damping * damping));
  }
};

}  // namespace servosense::modes
