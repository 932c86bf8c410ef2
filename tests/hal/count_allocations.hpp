// Replaces operator new in a test program by one that counts. Include it once.
#pragma once

#include <cstdlib>
#include <new>

/// By this thread.
inline thread_local unsigned long allocations = 0;

// Not inlined: g++ takes malloc and delete for a mismatch then.
[[gnu::noinline]] void* operator new(std::size_t bytes) {
  ++allocations;
  if (void* p = std::malloc(bytes)) return p;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* p) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete(void* p, std::size_t) noexcept { std::free(p); }
