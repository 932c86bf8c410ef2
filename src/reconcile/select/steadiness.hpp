// Whether an effect has one size all along a record. A cause has; what stands in for something
// that comes and goes has a mean size, and another one in every stretch.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

namespace servosense::reconcile {

class Steadiness {
 public:
  explicit Steadiness(std::size_t stretches) : stretches_(stretches) {}

  /// One row: force of the effect as fitted to the whole record, what the fit leaves, and how often
  /// the row counts.
  void add(std::size_t stretch, double effect, double rest, double weight = 1) {
    Stretch& s = stretches_[stretch];
    s.power += weight * effect * effect;
    s.with += weight * effect * rest;
  }

  /// Departure of the size from that of the whole, rms over the stretches by their power, as a
  /// share of it; 0 without power. `noise_power`: mean square of white noise in the rows, taken
  /// off.
  [[nodiscard]] double unsteadiness(double noise_power = 0) const {
    double power = 0, square = 0;
    for (const Stretch& s : stretches_) {
      if (!(s.power > 0)) continue;
      power += s.power;
      square += s.with * s.with / s.power - noise_power;
    }
    return power > 0 && square > 0 ? std::sqrt(square / power) : 0;
  }

  [[nodiscard]] double power(std::size_t stretch) const { return stretches_[stretch].power; }
  /// In this stretch, 1 on the whole. Only where there is power.
  [[nodiscard]] double size(std::size_t stretch) const {
    return 1 + stretches_[stretch].with / stretches_[stretch].power;
  }

 private:
  struct Stretch {
    double power = 0, with = 0;
  };
  std::vector<Stretch> stretches_;
};

}  // namespace servosense::reconcile
