// Independent jobs on all cores.
#pragma once

#include <cstddef>
#include <functional>

namespace servosense {

/// Calls job(0) ... job(count - 1), each once, on `threads` threads (0: one a core), and returns
/// when all are done. Jobs must not share what they write; their results then do not depend on
/// `threads`. The first exception of a job is thrown again here, after the others have come to an
/// end.
void run_parallel(std::size_t count, const std::function<void(std::size_t)>& job,
                  unsigned threads = 0);

}  // namespace servosense
