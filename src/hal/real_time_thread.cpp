#include "servosense/hal/real_time_thread.hpp"

#include <sched.h>
#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>

namespace servosense {

RealTimeGrant ask_for_real_time(int priority) {
  RealTimeGrant grant;
  std::string refused;
  // Not MCL_FUTURE: a thread without the right, or a process at its limit, would get no memory any
  // more. What a sample needs has been allocated by now.
  grant.memory_locked = mlockall(MCL_CURRENT) == 0;
  if (!grant.memory_locked)
    refused += std::string("memory is not locked (") + std::strerror(errno) + ")";
  sched_param parameters{};
  parameters.sched_priority = std::clamp(priority, 1, 99);
  grant.first_in_first_out = sched_setscheduler(0, SCHED_FIFO, &parameters) == 0;
  if (!grant.first_in_first_out)
    refused += (refused.empty() ? "" : ", and ") +
               std::string("the scheduling class SCHED_FIFO is not granted (") +
               std::strerror(errno) + ")";
  if (!refused.empty())
    grant.remark = refused +
                   ": other programs may hold this one up; run it as root, or give it the "
                   "capabilities CAP_SYS_NICE and CAP_IPC_LOCK";
  return grant;
}

void leave_real_time() {
  const sched_param parameters{};
  sched_setscheduler(0, SCHED_OTHER, &parameters);
}

void LatencyHistogram::add(Nanoseconds latency_ns) noexcept {
  const double octaves = latency_ns > 1000 ? std::log2(static_cast<double>(latency_ns) / 1000) : 0;
  ++bins_[std::min(static_cast<std::size_t>(4 * octaves), kBins - 1)];
  ++count_;
  greatest_ = std::max(greatest_, latency_ns);
  if (limit_ > 0 && latency_ns > limit_) ++overruns_;
}

Nanoseconds LatencyHistogram::quantile_ns(double share) const noexcept {
  const double wanted = share * static_cast<double>(count_);
  std::uint64_t seen = 0;
  for (std::size_t bin = 0; bin + 1 < kBins && count_ > 0; ++bin) {
    seen += bins_[bin];
    if (static_cast<double>(seen) >= wanted)
      return std::min(greatest_, static_cast<Nanoseconds>(
                                     1000 * std::exp2((static_cast<double>(bin) + 1) / 4)));
  }
  return greatest_;
}

}  // namespace servosense
