// Programs of the second generator: what test engineers let a machine do.
#pragma once

#include <cstddef>

#include "analysis.hpp"
#include "draw.hpp"

namespace blind::second {

struct Limits {
  double stroke = 0.3, speed = 0.3, acceleration = 2;
  bool turns = false;  ///< a spindle: speeds rather than places
};

enum class Profile { trapezoid, s_curve, sine_square };

/// A path that is drawn move by move, one position a sample.
class Path {
 public:
  Path(double rate_hz, double start, Profile profile) : rate_hz_(rate_hz), profile_(profile) {
    q_.push_back(start);
  }
  /// From rest to rest by `way`.
  void move(double way, double speed, double acceleration);
  void dwell(double seconds);
  /// Speeds up or down to `speed` and holds it.
  void run(double speed, double acceleration, double seconds);
  /// Sines about the place where it stands, faded in and out; `speeds` and `hertz` of the same
  /// length.
  void swing(const Signal& speeds, const Signal& hertz, double seconds);
  /// Rounds off the corners by a running mean.
  void round_off(double seconds);

  [[nodiscard]] double at() const { return q_.back(); }
  [[nodiscard]] double seconds() const { return static_cast<double>(q_.size()) / rate_hz_; }
  [[nodiscard]] const Signal& positions() const { return q_; }

 private:
  double rate_hz_;
  Profile profile_;
  double speed_ = 0;  ///< where the last run ended
  Signal q_;
};

struct Program {
  Signal reference;
  double held_out_from_s = 0;
};

/// Laps to learn from, then something else. The length is not met exactly.
Program program(Draw&, const Limits&, double rate_hz, double seconds);

/// How fast a path that was given goes, and its acceleration, by differences.
double fastest(const Signal& path, double rate_hz);

}  // namespace blind::second
