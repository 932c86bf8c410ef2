// Evidence of an alarm: enough to raise it again, bit for bit.
//
// Purpose: keeps, without a burst, what a block with a small memory needs to repeat an alarm: the
// whole block every Stride samples, and the inputs since. Feeding the inputs to the copy gives the
// alarm again.
// Form: four slots, each a copy of the block and the Stride inputs that followed. Recording goes
// round; an alarm pins the present slot and the one before, and recording goes on in the two that
// are left. Nothing is moved, so an alarm costs nothing; the evidence stays until the next one.
// Reach: between Stride + 1 and 2 Stride samples back (fewer right after the start).
// Cost: one store a sample, one copy of the block every Stride samples. Delay: none.
// Bad at: blocks with long windows; they keep a ring of their own.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "servosense/core/real_time.hpp"

namespace servosense {

template <typename Block, typename Input, std::size_t Stride>
class EvidenceRecorder {
  static_assert(Stride >= 1);
  static_assert(std::is_trivially_copyable_v<Block> && std::is_trivially_copyable_v<Input>);

 public:
  /// The block before `inputs[0]`, and the inputs that led to the alarm, the last one raising it.
  struct Evidence {
    Block before{};
    std::array<Input, 2 * Stride> inputs{};
    std::uint32_t count = 0;   ///< inputs; 0: no alarm yet
    std::uint64_t sample = 0;  ///< number of the sample that raised it, from 1
  };

  void reset() noexcept {
    now_ = last_ = 0;
    filled_ = 0;
    samples_ = 0;
    alarm_ = Alarm{};
  }

  /// Before the block sees `input`.
  void before(const Block& block, const Input& input) SERVOSENSE_NONBLOCKING {
    if (filled_ == Stride || samples_ == 0) open(block);
    slots_[now_].inputs[filled_++] = input;
    ++samples_;
  }
  /// When that input has raised an alarm.
  void freeze() SERVOSENSE_NONBLOCKING { alarm_ = {last_, now_, filled_, samples_}; }

  /// Number of the sample that raised the last alarm; 0 before the first.
  [[nodiscard]] std::uint64_t alarm_sample() const noexcept { return alarm_.sample; }

  /// A copy of what the last alarm was raised from. Off the real-time path.
  [[nodiscard]] Evidence evidence() const noexcept {
    Evidence e;
    if (alarm_.sample == 0) return e;
    e.sample = alarm_.sample;
    e.before = slots_[alarm_.first].before;
    if (alarm_.first != alarm_.second)
      for (const Input& input : slots_[alarm_.first].inputs) e.inputs[e.count++] = input;
    for (std::uint32_t i = 0; i < alarm_.filled; ++i)
      e.inputs[e.count++] = slots_[alarm_.second].inputs[i];
    return e;
  }

 private:
  struct Slot {
    Block before{};
    std::array<Input, Stride> inputs{};
  };
  struct Alarm {
    std::uint32_t first = 0;
    std::uint32_t second = 0;
    std::uint32_t filled = 0;  // of the second slot
    std::uint64_t sample = 0;
  };

  // Goes on in a slot that neither the alarm nor a possible next one needs.
  void open(const Block& block) noexcept {
    last_ = now_;
    if (samples_ > 0) {
      std::uint32_t next = 0;
      while (next == last_ ||
             (alarm_.sample > 0 && (next == alarm_.first || next == alarm_.second)))
        ++next;
      now_ = next;
    }
    slots_[now_].before = block;
    filled_ = 0;
  }

  std::array<Slot, 4> slots_{};
  std::uint32_t now_ = 0;
  std::uint32_t last_ = 0;
  std::uint32_t filled_ = 0;
  std::uint64_t samples_ = 0;
  Alarm alarm_;
};

}  // namespace servosense
