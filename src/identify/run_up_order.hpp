// One order of a sweep: its complex amplitude, and that of what would be a mode: steps 2 and 3 of
// run_up.hpp.
#pragma once

#include <complex>
#include <cstddef>
#include <vector>

#include "servosense/identify/idle.hpp"

namespace servosense::run_up {

using Complex = std::complex<double>;

constexpr double kWindowTurns = 4;
constexpr double kHopTurns = 2;

/// Regular samples of a sweep; turns rise.
struct Sweep {
  double from_s = 0, period_s = 0;
  std::vector<double> value, turns;
};

/// Where the windows of a sweep lie.
struct Windows {
  std::vector<std::size_t> begin, end;              ///< samples
  std::vector<double> middle_turn, middle_s;        ///< s: since the sweep's first sample
  std::vector<double> rotation_hz, rotation_slope;  ///< Hz and Hz/s there
  [[nodiscard]] std::size_t count() const { return begin.size(); }
};
Windows windows_of(const Sweep& s);

/// exp(j n turns) at every sample.
std::vector<Complex> harmonic(const Sweep& s, int order);

/// Mean of `signal` against the harmonic under each window.
std::vector<Complex> amplitudes(const Sweep& s, const Windows& w, const std::vector<Complex>& line);

struct Shape {
  double w_rad_s, damping;
};

struct CrossingFit {
  std::vector<Shape> modes;  ///< the first is the one sought
  Estimate natural_frequency_hz, damping_ratio;
  double gain = 0;       ///< fall of N log misfit by the first mode
  double over_line = 0;  ///< the same against a line of fixed frequency in its place
  double enough = 0;     ///< gain that chance does not give
  double alike = 0;      ///< correlation of neighbours in what is left
  double peak = 0, smooth = 0, rest = 0;  ///< rms: mode at its highest; smooth part there; left
  std::size_t first = 0, last = 0;        ///< windows
  std::vector<double> fitted;             ///< amplitude in each
};

/// A start: steady response of a mode against the smooth part alone.
struct Start {
  double hz = 0, damping = 0, gain = 0;
};

/// The best starts of an order, each of a band of its own, the best first.
std::vector<Start> starts(const Windows& w, const std::vector<Complex>& amplitude, int order,
                          double from_hz, double to_hz);

/// Fit about a start. No modes: it does not settle.
CrossingFit fit_crossing(const Sweep& s, const Windows& w, const std::vector<Complex>& line,
                         const std::vector<Complex>& amplitude, int order, const Start& start);

}  // namespace servosense::run_up
