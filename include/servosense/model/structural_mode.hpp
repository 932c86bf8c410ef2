// One vibration mode of the tool or machine structure, in one direction.
#pragma once

#include <complex>
#include <vector>

#include "servosense/core/units.hpp"

namespace servosense {

/// m x'' + 2 zeta w m x' + w^2 m x = F. Modes of one direction add up.
struct StructuralMode {
  double natural_frequency_hz = 0;
  double damping_ratio = 0;
  double modal_mass_kg = 0;

  [[nodiscard]] double natural_frequency_rad_s() const { return kTwoPi * natural_frequency_hz; }
  [[nodiscard]] double stiffness_N_per_m() const {
    return modal_mass_kg * natural_frequency_rad_s() * natural_frequency_rad_s();
  }
  /// Receptance X/F [m/N] at `frequency_rad_s`.
  [[nodiscard]] std::complex<double> receptance(double frequency_rad_s) const {
    const double wn = natural_frequency_rad_s();
    const std::complex<double> stiffness(wn * wn - frequency_rad_s * frequency_rad_s,
                                         2 * damping_ratio * wn * frequency_rad_s);
    return std::conj(stiffness) / (modal_mass_kg * std::norm(stiffness));
  }
};

/// Modes in the feed (x) and normal (y) direction of the machine; cross receptances are zero.
struct Structure {
  std::vector<StructuralMode> x;
  std::vector<StructuralMode> y;
};

}  // namespace servosense
