// Vibration in a slow torque: what of its spectrum neither turns with the spindle nor is the
// machine's own.
//
// Purpose: chatter of 300 to 1500 Hz in a current of 250 Hz to 2 kHz. What the drive's filter
// leaves of it is folded below half the sample rate: it is there, at a frequency that is not its
// own.
// Equation, on half overlapping windows of the torque x of N samples:
//   x = polynomial of degree 3
//       + sum over h of (a_h + b_h t) cos h angle + (c_h + d_h t) sin h angle + e,   least squares
// h the multiples of the rotation and of the tooth passing frequency with its neighbours. The angle
// is that of the samples, so multiples beyond half the sample rate are folded by themselves, at any
// speed and while it changes. Of e, with a Hann window,
//   L_k    power of a line about bin k: three bins [Nm2]
//   F_k    its floor: median of 32 bins about it
//   value  max over k of min over three windows of
//          min(L_k / (kLine F_k), (L_k - S_k) / threshold)
// with k a bin to either side; 1 raises the alarm. Bins of the machine's own lines (mains, a pump:
// learned in the air) are left out. S_k is what an uneven cut leaves: a share of the load (mean
// square of the torque), or the skirt of what turns nearby, the largest of the three. A window in
// which the cut begins or ends holds no line.
// Delay: two windows. Cost: some 3 ms a window on a PC; off the real-time path.
// Range: from kLeastTurns revolutions a window on; speeds that change by less than 4 % in one.
// Bad at: its frequency is one of several (folded_frequencies()); lines that fold onto a multiple
// of the rotation; a speed that is not measured (half a percent off leaves the multiples in);
// vibration shorter than two windows; a second spindle or a screw that turns at a pace of its own
// and is heard in this torque: it is a line like any other.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

#include "servosense/core/quality.hpp"
#include "servosense/identify/alarm_rate.hpp"
#include "servosense/monitors/idle_statistics.hpp"

namespace servosense {

struct SlowVibrationConfig {
  double sample_period_s = 1e-3;
  unsigned teeth = 0;                  ///< of the tool; 0 = unknown
  double threshold_Nm2 = 0;            ///< power of a line; 0 = not known: nothing is judged
  double tolerated_load_share = 1e-3;  ///< of the load: a cut is as irregular as that
  std::vector<double> own_lines_hz;    ///< of the machine, as they appear below half the rate
};

/// What a window said.
struct SlowVibrationVerdict {
  std::size_t from = 0, to = 0;  ///< samples
  double value = 0;              ///< 1 raises the alarm
  double line_Nm2 = 0;           ///< power of the line that is nearest to it, over three windows
  double apparent_hz = 0;        ///< where it appears
  double strongest_Nm2 = 0;      ///< of any line beyond S_k, standing out or not
  double mean_Nm = 0, load_Nm2 = 0;
  double needed_Nm2 = 0;   ///< of a line in the middle of the spectrum, to be found
  double heard_share = 0;  ///< of the frequencies: the rest folds onto multiples or own lines
};

class SlowVibration {
 public:
  /// A line has so many times the power of its neighbourhood, in three windows in a row.
  static constexpr double kLine = 6;
  static constexpr double kLeastTurns = 4;
  static constexpr double kLeastRate_hz = 250, kMostRate_hz = 2000;
  static constexpr double kWindow_s = 0.5;
  static constexpr std::size_t kLeastWindow = 512;

  explicit SlowVibration(const SlowVibrationConfig& config);

  [[nodiscard]] std::size_t window() const noexcept { return window_; }
  [[nodiscard]] double minimum_speed_rad_s() const noexcept;
  /// One sample: torque [Nm], motion since the last [rad]. A verdict where three windows are there;
  /// a sample that cannot be used, a speed too low or one that runs away begin anew.
  std::optional<SlowVibrationVerdict> add(double torque_Nm, double increment_rad, Quality quality);

  /// Power about each bin of the last window [Nm2], and over its floor.
  [[nodiscard]] const std::vector<double>& line_Nm2() const noexcept { return lines_[0]; }
  [[nodiscard]] const std::vector<double>& over_floor() const noexcept { return ratios_[0]; }
  [[nodiscard]] double bin_hz() const noexcept;

 private:
  bool transform();
  [[nodiscard]] SlowVibrationVerdict verdict() const;

  SlowVibrationConfig config_;
  std::size_t window_;
  std::size_t lowest_ = 1;              // bin
  std::vector<double> torque_, angle_;  // of the window, oldest first
  double turned_ = 0;
  std::size_t samples_ = 0;
  std::size_t windows_ = 0;  // in a row
  // Of the last three windows, newest first.
  std::array<std::vector<double>, 3> lines_, ratios_, skirts_;
  std::array<double, 3> loads_{};
  std::vector<bool> own_;
  std::vector<double> floor_;
  double mean_ = 0, load_ = 0, heard_share_ = 0;
};

/// What the air teaches: the threshold, the machine's own lines, and how often noise alone reaches
/// that (alarm_rate.hpp).
struct LearnedVibration : IdleStatistics {
  std::vector<double> own_lines_hz;  ///< as they appear
  AlarmRate rate;                    ///< of the roots of the powers
  double accepted_per_hour = 0.01;
  // It knows more than the statistics alone, which nobody takes it for.
  // NOLINTNEXTLINE(bugprone-derived-method-shadowing-base-method)
  [[nodiscard]] double threshold() const;
  [[nodiscard]] double alarms_per_hour() const;
};
/// `torque`, `increment`, `quality` of an idling run or a sound cut, a value a sample.
struct VibrationSample {
  double torque_Nm = 0, increment_rad = 0;
  Quality quality = Quality::good;
};
LearnedVibration learn_vibration(const SlowVibrationConfig& config,
                                 const std::vector<VibrationSample>& idle,
                                 double accepted_per_hour = 0.01);

/// Frequencies that appear at `apparent_hz` at this rate, up to `highest_hz`, lowest first.
[[nodiscard]] std::vector<double> folded_frequencies(double apparent_hz, double rate_hz,
                                                     double highest_hz);

}  // namespace servosense
