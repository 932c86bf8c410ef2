// How far a program moves in a sample: by time and feed override, or by the path of its axes.
//
// Purpose: what the torque band lies over. Time goes on by a sample's period, or by a hole where
// the time stamps show one, times the override. Path: encoders count up and down while an axis
// stands, and sums of such steps are no path; so the way counts once it is a grain long. Delay: a
// grain. Cost: a square root a grain, else nine operations. Numerical bound: none sums up. Bad at:
// curves tighter than a grain, which it cuts off.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "servosense/core/real_time.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

template <RealNumber Real, std::size_t Axes>
class PathMeter {
 public:
  /// `grain_m`: well above the encoder's noise, well below what is to be told apart.
  void configure(double grain_m) noexcept {
    grain2_ = static_cast<Real>(grain_m * grain_m);
    reset();
  }
  void reset() noexcept { way_ = {}; }
  /// Path [m] that has become known with these increments, most often none.
  Real add(const std::array<Real, Axes>& increment_m) SERVOSENSE_NONBLOCKING {
    Real square = 0;
    for (std::size_t i = 0; i < Axes; ++i) {
      way_[i] += increment_m[i];
      square += way_[i] * way_[i];
    }
    if (!(square >= grain2_)) {
      if (!(square >= 0)) way_ = {};  // an increment was no number
      return 0;
    }
    way_ = {};
    return std::sqrt(square);
  }

 private:
  std::array<Real, Axes> way_{};
  Real grain2_ = 0;
};

template <RealNumber Real, std::size_t Axes>
class ProgramProgress {
 public:
  void configure(double period_s, bool over_path, double grain_m) noexcept {
    period_s_ = static_cast<Real>(period_s);
    hole_ns_ = nanoseconds_from(1.5 * period_s);
    over_path_ = over_path;
    path_.configure(grain_m);
    reset();
  }
  void reset() noexcept {
    path_.reset();
    last_t_ns_ = 0;
  }
  /// [s] or [m]. Time stamps that stand are not looked at.
  Real next(Nanoseconds t_ns, const std::array<Real, Axes>& way_m,
            Real feed_override) SERVOSENSE_NONBLOCKING {
    if (over_path_) return path_.add(way_m);
    const Nanoseconds passed = t_ns - last_t_ns_;
    const bool hole = passed > hole_ns_ && last_t_ns_ != 0;
    last_t_ns_ = t_ns;
    return (hole ? static_cast<Real>(passed) * Real(1e-9) : period_s_) * feed_override;
  }

 private:
  Real period_s_ = 0;
  Nanoseconds hole_ns_ = 0;
  Nanoseconds last_t_ns_ = 0;
  bool over_path_ = false;
  PathMeter<Real, Axes> path_;
};

}  // namespace servosense
