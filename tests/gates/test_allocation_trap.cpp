// No real-time block allocates or frees while it processes: malloc and its kin are replaced by ones
// that abort between arm() and disarm(). Proved to bite by violations planted in child processes.
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "../../bench/blocks.hpp"
#include "check.hpp"

// The sanitizers bring their own malloc, and only glibc lends its under another name.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || !defined(__GLIBC__)
#define SERVOSENSE_TRAP 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || \
    __has_feature(memory_sanitizer)
#define SERVOSENSE_TRAP 0
#endif
#endif
#ifndef SERVOSENSE_TRAP
#define SERVOSENSE_TRAP 1
#endif

#if SERVOSENSE_TRAP

namespace {

thread_local bool armed = false;
thread_local unsigned long calls = 0;  // of the replaced functions, to see that they are in place

void trap(const char* what) noexcept {
  ++calls;
  if (!armed) return;
  armed = false;
  // No library call that might allocate.
  [[maybe_unused]] auto n = write(STDERR_FILENO, what, std::strlen(what));
  n = write(STDERR_FILENO, " while processing\n", 18);
  std::abort();
}

void arm() noexcept { armed = true; }
void disarm() noexcept { armed = false; }

}  // namespace

extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void __libc_free(void*);

void* malloc(std::size_t bytes) {
  trap("malloc");
  return __libc_malloc(bytes);
}
void* calloc(std::size_t n, std::size_t bytes) {
  trap("calloc");
  return __libc_calloc(n, bytes);
}
void* realloc(void* old, std::size_t bytes) {
  trap("realloc");
  return __libc_realloc(old, bytes);
}
void free(void* p) {
  trap("free");
  __libc_free(p);
}
void* memalign(std::size_t alignment, std::size_t bytes) {
  trap("memalign");
  return __libc_memalign(alignment, bytes);
}
void* aligned_alloc(std::size_t alignment, std::size_t bytes) {
  trap("aligned_alloc");
  return __libc_memalign(alignment, bytes);
}
int posix_memalign(void** out, std::size_t alignment, std::size_t bytes) {
  trap("posix_memalign");
  *out = __libc_memalign(alignment, bytes);
  return *out ? 0 : 12;  // ENOMEM
}
}  // extern "C"

namespace {

constexpr std::uint32_t kSamples = 8192;  // start, cut, chatter, bump, faults, recovery

template <typename Case, typename Real>
void run(const std::vector<bench::Sample<Real>>& samples) {
  const auto block = std::make_unique<Case>();
  const bool configured = block->configure().ok();
  if (!configured) std::cout << Case::name << " refuses its configuration\n";
  CHECK(configured);
  if (!configured) return;
  Real sum = 0;
  std::size_t finite = 0;
  for (const bench::Sample<Real>& sample : samples) {
    arm();
    const Real out = block->step(sample);
    disarm();
    sum += out;
    finite += servosense::is_finite(out) ? 1 : 0;
  }
  if (finite != samples.size())
    std::cout << Case::name << ": " << samples.size() - finite << " results are not finite\n";
  CHECK(finite == samples.size());
  std::printf("  %-30s %zu samples in silence, sum %.6g\n", Case::name, samples.size(),
              static_cast<double>(sum));
}

template <typename Real, typename... Case>
void run_all(std::tuple<Case...>*) {
  bench::CutSignal<Real> signal(kSamples, true);
  std::vector<bench::Sample<Real>> samples;
  for (std::uint32_t i = 0; i < kSamples; ++i) samples.push_back(signal.next());
  (run<Case>(samples), ...);
}

// True when `violation` ends a child process by abort().
bool is_trapped(const std::function<void()>& violation) {
  std::cout.flush();
  const pid_t child = fork();
  if (child == 0) {
    arm();
    violation();
    disarm();
    _exit(0);
  }
  int status = 0;
  if (child < 0 || waitpid(child, &status, 0) != child) return false;
  return WIFSIGNALED(status) && WTERMSIG(status) == SIGABRT;
}

void planted_violations() {
  std::vector<float> samples(1);
  samples.shrink_to_fit();
  const auto kept = std::make_shared<int>(0);
  volatile std::size_t size = 100;  // keeps the compiler from removing the allocation
  void* volatile escape = nullptr;
  int* owned = new int(0);
  CHECK(is_trapped([&] { escape = std::malloc(size); }));
  CHECK(is_trapped([&] { escape = std::calloc(size, 1); }));
  CHECK(is_trapped([&] { escape = std::aligned_alloc(64, 64); }));
  CHECK(is_trapped([&] { escape = new int[size]; }));
  CHECK(is_trapped([&] { delete owned; }));
  CHECK(is_trapped([&] { samples.push_back(1); }));
  CHECK(is_trapped([&] { escape = new std::string(size, 'x'); }));
  CHECK(!is_trapped([&] { samples[0] += 1; }));  // and not by the trap itself
  delete owned;
}

}  // namespace

int main() {
  const unsigned long before = calls;
  delete new std::string(100, 'x');
  CHECK(calls >= before + 4);  // the replacements are the ones that are called
  planted_violations();
  run_all<float>(static_cast<bench::Blocks<float>*>(nullptr));
  run_all<double>(static_cast<bench::Blocks<double>*>(nullptr));
  return check::done();
}

#else

int main() {
  std::cout << "SKIPPED: the allocation trap needs glibc's own malloc (no sanitizer)\n";
  return check::done();
}

#endif
