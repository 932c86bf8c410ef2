// Programs of moves: a command sampled at the servo rate, from trapezoids and sines.
#pragma once

#include <cstddef>
#include <vector>

namespace blind {

/// A command that grows by moves. `smoothed` then limits its jerk.
class Program {
 public:
  Program(double rate_hz, double start) : rate_hz_(rate_hz), path_{start} {}

  void dwell(double seconds);
  /// From rest to rest with a trapezoidal (or triangular) velocity.
  void move(double target, double speed, double acceleration);
  /// Whole cycles of a sine around the place where it stands, its amplitude faded in and out.
  void sine(double amplitude, double frequency_hz, unsigned cycles);
  /// There and back `times` times.
  void to_and_fro(double distance, double speed, double acceleration, unsigned times);

  [[nodiscard]] double position() const { return path_.back(); }
  [[nodiscard]] double seconds() const { return static_cast<double>(path_.size()) / rate_hz_; }
  /// The path averaged over `seconds`, which limits the jerk to acceleration / seconds.
  [[nodiscard]] std::vector<double> smoothed(double seconds) const;

 private:
  [[nodiscard]] std::size_t samples(double seconds) const;

  double rate_hz_;
  std::vector<double> path_;
};

}  // namespace blind
