// Two doubles, the vector that every 64-bit machine has: sums are formed in the same order, and
// come out the same, everywhere.
#pragma once

#include <new>

namespace servosense {

using Pair = double __attribute__((vector_size(16), may_alias));
using PairMask = long long __attribute__((vector_size(16)));

static_assert(__STDCPP_DEFAULT_NEW_ALIGNMENT__ >= sizeof(Pair), "pairs lie in std::vector<double>");

/// `from` aligned as the start of a std::vector<double> is, or an even number of doubles behind it.
inline const Pair& pair_at(const double* from) { return *reinterpret_cast<const Pair*>(from); }
inline Pair& pair_at(double* to) { return *reinterpret_cast<Pair*>(to); }
inline Pair both(double value) { return Pair{value, value}; }
inline Pair higher(const Pair& a, const Pair& b) { return a > b ? a : b; }
inline Pair lower(const Pair& a, const Pair& b) { return a < b ? a : b; }

}  // namespace servosense
