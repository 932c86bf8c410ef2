// What `servosense monitor` keeps of a run for summary and report, in bounded memory.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "chatter_advice.hpp"
#include "constant_watch.hpp"
#include "found_coefficients.hpp"
#include "reference_watch.hpp"
#include "servosense/dsp/power_spectrum.hpp"
#include "servosense/hal/real_time_thread.hpp"
#include "servosense/hal/stop_request.hpp"
#include "servosense/io/event.hpp"
#include "servosense/monitors/pair_config.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "verdict.hpp"

namespace servosense::cli {

/// Smallest and largest value per stretch of time; the stretches double when memory is used up.
class Envelope {
 public:
  void add(double t_s, double value);
  [[nodiscard]] bool empty() const { return buckets_.empty(); }
  [[nodiscard]] double largest_magnitude() const;
  /// Points in time order, two a stretch.
  void points(std::vector<double>& x, std::vector<double>& y) const;
  /// Mean values, `most` at the most, over stretches of equal numbers of samples.
  void means(std::size_t most, std::vector<double>& x, std::vector<double>& y) const;

 private:
  struct Bucket {
    double t_low = 0, low = 0, t_high = 0, high = 0;
    std::size_t count = 0;
    double sum = 0;
  };
  static constexpr std::size_t kMostBuckets = std::size_t{1} << 16U;
  std::size_t per_bucket_ = 1;
  std::vector<Bucket> buckets_;
};

/// One drive's signals over the run.
struct DriveHistory {
  DriveHistory(Channel drive, std::string effort_unit, double sample_rate_hz)
      : channel(drive), unit(std::move(effort_unit)), spectrum(4096, sample_rate_hz) {}
  Channel channel;
  std::string unit;  ///< of the estimate: Nm, N, or "ratio" where the current has no scale
  Envelope estimate;
  Envelope value;         ///< what the monitor looks at: chatter power or disturbance jerk
  Envelope forced_power;  ///< spindle only
  Envelope speed;
  std::vector<double> values;  ///< a thinned sample of `value`, for the histogram
  PowerSpectrum spectrum;
  double threshold = 0;
};

/// What a monitor of the tool looked at over the run.
struct ToolHistory {
  MonitorId monitor = MonitorId::wear;
  std::string title, caption, y_label, unit;
  double threshold = 0;  ///< 0: none to draw
  Envelope value;
};
/// Of every monitor of the tool that runs by the plan.
[[nodiscard]] std::vector<ToolHistory> tool_histories(const StackPlan& plan);
void keep(ToolHistory& history, const HostStack& stack, double t_s);

/// Torque against its band, a value a step of the program that was judged.
struct BandHistory {
  Envelope measured, expected, lower, upper;
  std::uint64_t steps = 0;
};
void keep(BandHistory& history, const HostStack& stack, double t_s);

/// A pair of signals of a drive over the run.
struct PairRun {
  Channel channel = Channel::x;
  PlannedPair plan;
  std::string unit;
  double largest = 0, watched_s = 0;
};

/// A finished run.
struct MonitorRun {
  std::string trace;
  std::string machine;
  double sample_period_s = 0;
  double from_s = 0, to_s = 0;
  std::uint64_t samples = 0;  ///< heard, with those that stand in for missing ones
  std::uint64_t rows = 0;     ///< that the source delivered
  std::uint64_t missing = 0;
  double worst_jitter_s = 0;
  StackPlan plan;
  std::vector<Watched> watched;  ///< of each monitor of the plan
  Verdict verdict;
  std::vector<DriveHistory> drives;
  std::vector<PairRun> pairs;
  std::vector<ToolHistory> tool;
  BandHistory band;
  std::optional<std::vector<ReferenceVerdict>> reference;  ///< where the machine file names one
  double reference_threshold = 0;
  std::vector<ConstantWatch::Finding> constants;  ///< of the drives that accelerated often enough
  std::vector<FoundCoefficient> coefficients;     ///< where the monitor of them runs
  CoefficientHistory coefficient_history;         ///< likewise
  unsigned teeth = 0;                             ///< of the tool; 0: not known
  std::vector<double> chatter_hz;                 ///< that the advice tells, those within 1 % once
  std::string recorded;                           ///< when, as the trace says it; may be empty
  std::vector<Event> events;  ///< at most kMostEvents of them, see `event_count`
  std::uint64_t event_count = 0;
  std::vector<ChatterAdviceResult> advice;  ///< on the chatter alarms that were looked into
  std::uint64_t alarms = 0;
  std::uint64_t warnings = 0;
  LatencyHistogram latency;                 ///< of a live run
  std::optional<StopHealth> stop;           ///< feed holds, where a CNC was given
  std::vector<std::string> notes;           ///< metadata of the trace that a reader must know
  std::vector<std::string> source_remarks;  ///< of them, those of a live source
  std::optional<Error> broke_off;           ///< why a live source ended
  std::vector<std::string> not_written;     ///< what is missing in which file, and why

  static constexpr std::size_t kMostEvents = 100000;
};

/// Of the comparison with a sound reference, filled when the record is over.
[[nodiscard]] ToolHistory reference_history();
void keep(ToolHistory& history, const MonitorRun& run);

}  // namespace servosense::cli
