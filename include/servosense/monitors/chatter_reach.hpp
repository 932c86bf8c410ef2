// How large a vibration of the torque must be for the chatter monitor to find it.
//
// What stands between a sinusoid of cutting torque and an alarm: the rate of the current, groups of
// samples, two lags of the observer, the means of the comb and what it cannot tell from the cut,
// the share of the load, the quarter in the air, two verdicts in a row; and the noise of the
// record. None of it is estimated: the vibration is carried through the blocks themselves, beside
// the record, by superposition. All that a verdict is made from is quadratic in the torque, so of
// torque + A * sinusoid it is
//   m(A) = m + A (m_both - m - m_alone) + A^2 m_alone
// with m of the torque as heard, of the sinusoid alone, and of both. Every verdict of the record is
// passed again for amplitudes A 3 % apart, by the rule of the monitor (chatter_verdict.hpp); the
// smallest that alarms is the answer. A disturbance torque reaches the observer's estimate by way
// of the motion and of the current; the parts add up to the same lags whatever the controller does,
// so it is enough to add it to the current. A filter of the drive damps it there; what the
// controller does not answer reaches the motion undamped, so this is the least favourable case. Off
// the real-time path: some microseconds a revolution, 0.3 us a sample. Bad at: records that chatter
// already. The sinusoid alone, with the load of the record, stands for them.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "servosense/monitors/stack_config.hpp"

namespace servosense {

struct ChatterReachConfig {
  double sample_period_s = 125e-6;  ///< of the signals
  bool grouped = false;
  DisturbanceObserverConfig observer;  ///< as it runs, of the monitor
  ChatterConfig chatter;               ///< as it runs
  double current_update_hz = 0;        ///< 0: as the samples tell
  double current_filter_hz = 0;        ///< of the drive, first order; 0: none is known
  std::vector<double> modes_hz;        ///< of the structure, most compliant first
};

class ChatterReach {
 public:
  struct Result {
    double frequency_hz = 0;
    double amplitude_Nm = 0;                      ///< anywhere in the record
    std::optional<double> in_cut_Nm;              ///< while the mean torque shows a cut
    std::optional<double> largest_cut_Nm;         ///< mean torque of a revolution, likewise
    double largest_Nm = 0;                        ///< the same, cut or not
    double slowest_rad_s = 0, fastest_rad_s = 0;  ///< speeds that were judged
    std::optional<double> unheard_mode_hz;  ///< of the structure, beyond what the signals show
  };

  explicit ChatterReach(const ChatterReachConfig& config);
  ~ChatterReach();

  /// A servo sample, after the stack has heard it.
  void heard(const RawDriveSample<double>& raw, const HostStack& stack);
  /// Nothing when no verdict was passed. An amplitude that no verdict of the record hears is
  /// infinite.
  [[nodiscard]] std::optional<Result> result() const;

 private:
  struct Tone;
  void choose_tones();
  void judge(const HostStack::Chatter& chatter);

  ChatterReachConfig config_;
  std::vector<std::unique_ptr<Tone>> tones_;
  std::uint64_t samples_ = 0;
  std::uint64_t fresh_ = 0;  // samples with a new current
  std::uint64_t verdicts_ = 0;
  std::uint32_t present_ = 0;     // revolution of the window that fills
  std::uint32_t until_turn_ = 0;  // samples until the one before is measured
  bool alarmed_ = false;          // the record does, by itself
  bool judged_ = false;
  double speed_rad_s_ = 0;  // of the verdict before
  Result result_;
};

}  // namespace servosense
