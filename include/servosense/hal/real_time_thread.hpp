// What a live run asks of Linux so that nothing holds it up, and how long it took all the same.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "servosense/core/units.hpp"

namespace servosense {

/// What was granted.
struct RealTimeGrant {
  bool memory_locked = false;
  bool first_in_first_out = false;
  /// One sentence on what was refused and how to get it; empty when nothing was.
  std::string remark;
};

/// Locks the memory held by now (allocate before) and schedules this thread SCHED_FIFO at
/// `priority` (1..99). What is refused is no error: the program works without it, only later at
/// times.
RealTimeGrant ask_for_real_time(int priority);

/// Schedules this thread as any other program's: one that computes beside the real-time thread
/// that started it. Always granted.
void leave_real_time();

/// How long samples took from their arrival until the monitors had judged them: counts in bins of a
/// quarter octave, from 1 us to 70 s. No allocation.
class LatencyHistogram {
 public:
  void add(Nanoseconds latency_ns) noexcept;
  [[nodiscard]] std::uint64_t count() const noexcept { return count_; }
  [[nodiscard]] Nanoseconds greatest_ns() const noexcept { return greatest_; }
  /// Upper end of the bin that holds the `share` quantile (0..1) [ns]; 0 when empty.
  [[nodiscard]] Nanoseconds quantile_ns(double share) const noexcept;
  /// Share of the samples that took longer than `limit_ns`, counted exactly for the limit given to
  /// watch().
  void watch(Nanoseconds limit_ns) noexcept { limit_ = limit_ns; }
  [[nodiscard]] std::uint64_t overruns() const noexcept { return overruns_; }

 private:
  static constexpr std::size_t kBins = 105;
  std::array<std::uint64_t, kBins> bins_{};
  std::uint64_t count_ = 0;
  std::uint64_t overruns_ = 0;
  Nanoseconds greatest_ = 0;
  Nanoseconds limit_ = 0;
};

}  // namespace servosense
