// Independent jobs on all cores, with word of how far they are.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>

#include "servosense/reconcile/options.hpp"
#include "servosense/sim/run_parallel.hpp"

namespace servosense::reconcile {

/// run_parallel() that tells options.progress after each job; `what` is being done.
inline void run_reporting(const char* what, std::size_t count,
                          const std::function<void(std::size_t)>& job, const Options& options) {
  std::atomic<std::size_t> done{0};
  if (options.progress && count > 0) options.progress(what, 0, count);
  run_parallel(
      count,
      [&](std::size_t i) {
        job(i);
        if (options.progress) options.progress(what, ++done, count);
      },
      options.threads);
}

}  // namespace servosense::reconcile
