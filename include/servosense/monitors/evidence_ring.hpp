// Evidence of an alarm for blocks with long windows: the newest samples, to replay it from.
//
// Purpose: a ring of Kept + kReadout samples; an alarm marks its place, and what led to it stays
// for kReadout samples more, time for a task of lower priority to copy it. Delay: none. Cost: a
// copy of the sample. Bad at: a block with little memory, of which a copy is less (evidence.hpp).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace servosense {

/// Kept: most samples that one alarm is replayed from.
template <typename Sample, std::size_t Kept>
class EvidenceRing {
 public:
  static constexpr std::size_t kReadout = 128;  ///< samples that an alarm's stay after it

  void push(const Sample& sample) noexcept {
    ring_[next_] = sample;
    if (++next_ == kSize) next_ = 0;
  }
  /// The newest sample raised an alarm.
  void mark() noexcept { end_ = next_; }
  /// Copies the `count` samples up to the mark, oldest first, `age` samples after it; returns how
  /// many. 0 when `out` is too small or they have been written over.
  std::size_t copy(std::size_t count, std::uint64_t age, std::span<Sample> out) const noexcept {
    if (count > Kept || out.size() < count || age > kReadout) return 0;
    std::size_t at = end_ + (end_ < count ? kSize : 0) - count;
    for (std::size_t i = 0; i < count; ++i) {
      out[i] = ring_[at];
      if (++at == kSize) at = 0;
    }
    return count;
  }

 private:
  static constexpr std::size_t kSize = Kept + kReadout;
  std::size_t next_ = 0;
  std::size_t end_ = 0;
  std::array<Sample, kSize> ring_{};
};

}  // namespace servosense
