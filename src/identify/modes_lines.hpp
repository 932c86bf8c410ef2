// Lines of one receptance as they are fitted.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
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
  [[nodiscard]] Lines between(double from_rad_s, double to_rad_s) const {
    const auto begin = std::lower_bound(w_rad_s.begin(), w_rad_s.end(), from_rad_s);
    const auto end = std::upper_bound(begin, w_rad_s.end(), to_rad_s);
    const Eigen::Index at = begin - w_rad_s.begin(), n = end - begin;
    return {name,
            direct,
            decay_per_s,
            w_rad_s.segment(at, n),
            response.segment(at, n),
            noise.segment(at, n)};
  }
};

struct Pole {
  double w_rad_s = 0;  // natural
  double damping = 0;
  [[nodiscard]] std::complex<double> upper() const {
    return w_rad_s * std::complex<double>(-damping, std::sqrt(1 - damping * damping));
  }
};

}  // namespace servosense::modes
