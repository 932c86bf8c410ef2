// Evidence of an alarm: enough to raise it again, bit for bit.
//
// Purpose: keeps, without a burst, what a block with a small memory needs to repeat an alarm: the
// whole block every Stride samples, and the inputs since. Feeding the inputs to the copy gives the
// alarm again. Form: four slots, each a copy of the block and the Stride inputs that followed.
// Recording goes round; an alarm pins the present slot and the one before, and recording goes on in
// the two that are left. Nothing is moved, so an alarm costs nothing; the evidence stays until the
// next one. Reach: between Stride + 1 and 2 Stride samples back (fewer right after the start).
// Cost: 9 instructions on Cortex-M4F, and one copy of the block every Stride samples; a block that
// rests between its inputs has it copied ahead in slices, with prepare(); blocks that run side by
// side copy on different samples, with reset(phase).
// Delay: none.
// Bad at: blocks with long windows; these keep an EvidenceRing (evidence_ring.hpp).
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
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

  /// `phase`, below Stride: by so many samples the copies come earlier.
  void reset(std::uint32_t phase = 0) noexcept {
    at_ = now_ = last_ = next_ = 0;
    left_ = 0;
    copied_ = 0;
    opened_ = 0;
    phase_ = phase;
    begin_ = {};
    alarm_ = Alarm{};
  }

  /// Before the block sees `input`.
  void before(const Block& block, const Input& input) SERVOSENSE_NONBLOCKING {
    if (left_ == 0) open(block);
    --left_;
    inputs_[at_++] = input;
  }
  /// Between two inputs: copies some of the block ahead, if the next input is due to need it.
  void prepare(const Block& block) SERVOSENSE_NONBLOCKING {
    if (left_ == 0 && copied_ < sizeof(Block)) copy(block, kSlice);
  }
  /// The block has changed since, other than by an input.
  void discard() SERVOSENSE_NONBLOCKING { copied_ = 0; }
  /// When that input has raised an alarm.
  [[gnu::noinline]] void freeze() SERVOSENSE_NONBLOCKING {
    const std::uint32_t filled = at_ - now_ * kStride;
    alarm_ = {last_, now_, filled, (opened_ - 1) * Stride + filled - phase_};
    copied_ = 0;
    next_ = free_slot();
  }

  /// Number of the sample that raised the last alarm; 0 before the first.
  [[nodiscard]] std::uint64_t alarm_sample() const noexcept { return alarm_.sample; }

  /// A copy of what the last alarm was raised from. Off the real-time path.
  [[nodiscard]] Evidence evidence() const noexcept {
    Evidence e;
    if (alarm_.sample == 0) return e;
    e.sample = alarm_.sample;
    e.before = blocks_[alarm_.first];
    const auto take = [&](std::uint32_t slot, std::uint32_t filled) {
      for (std::uint32_t i = begin_[slot]; i < filled; ++i)
        e.inputs[e.count++] = inputs_[slot * kStride + i];
    };
    if (alarm_.first != alarm_.second) take(alarm_.first, kStride);
    take(alarm_.second, alarm_.filled);
    return e;
  }

 private:
  static constexpr auto kStride = static_cast<std::uint32_t>(Stride);
  static constexpr std::uint32_t kSlots = 4;
  static constexpr std::size_t kSlice = 512;  // bytes

  struct Alarm {
    std::uint32_t first = 0;
    std::uint32_t second = 0;
    std::uint32_t filled = 0;  // of the second slot
    std::uint64_t sample = 0;
  };

  // One that neither the alarm nor a possible next one needs.
  [[nodiscard]] std::uint32_t free_slot() const noexcept {
    std::uint32_t taken = 1U << now_;
    if (alarm_.sample > 0) taken |= 1U << alarm_.first | 1U << alarm_.second;
    return static_cast<std::uint32_t>(std::countr_one(taken));
  }

  [[gnu::noinline]] void copy(const Block& block, std::size_t most) noexcept {
    const std::size_t rest = sizeof(Block) - copied_;
    const std::size_t size = most < rest ? most : rest;
    const auto* from = reinterpret_cast<const unsigned char*>(&block) + copied_;
    auto* to = reinterpret_cast<unsigned char*>(&blocks_[next_]) + copied_;
    std::memcpy(to, from, size);
    copied_ += static_cast<std::uint32_t>(size);
  }

  [[gnu::noinline]] void open(const Block& block) noexcept {
    if (copied_ < sizeof(Block)) copy(block, sizeof(Block));
    last_ = now_;
    now_ = next_;
    begin_[now_] = opened_ == 0 ? phase_ : 0;
    at_ = now_ * kStride + begin_[now_];
    left_ = kStride - begin_[now_];
    copied_ = 0;
    ++opened_;
    next_ = free_slot();
  }

  std::uint32_t at_ = 0;  // where the next input goes, all slots in a row
  std::uint32_t now_ = 0;
  std::uint32_t last_ = 0;
  std::uint32_t next_ = 0;
  std::uint32_t left_ = 0;    // inputs that the present slot has room for
  std::uint32_t copied_ = 0;  // bytes of the block for the next slot
  std::uint64_t opened_ = 0;  // slots, since the start
  std::uint32_t phase_ = 0;
  std::array<std::uint32_t, kSlots> begin_{};  // of a slot's inputs: 0 but in the very first
  Alarm alarm_;
  std::array<Input, kSlots * Stride> inputs_{};
  std::array<Block, kSlots> blocks_{};
};

}  // namespace servosense
