// Evidence of an alarm: enough to raise it again, bit for bit.
//
// Purpose: a block whose whole memory is small is copied every Stride samples; the inputs since the
// copy before last are kept. On an alarm the older copy and those inputs are frozen: feeding them to
// the copy gives the alarm again. Cost: one store a sample, one copy of the block a stride.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "servosense/core/real_time.hpp"

namespace servosense {

template <typename Block, typename Input, std::size_t Stride>
class EvidenceRecorder {
  static_assert(std::is_trivially_copyable_v<Block> && std::is_trivially_copyable_v<Input>);

 public:
  /// The block before `inputs[0]`, and the inputs that led to the alarm, the last one raising it.
  struct Evidence {
    Block before;
    std::array<Input, 2 * Stride> inputs{};
    std::uint32_t count = 0;   ///< 0: no alarm yet
    std::uint64_t sample = 0;  ///< number of the sample that raised it, from 1
  };

  void reset() noexcept {
    count_ = 0;
    samples_ = 0;
    evidence_.count = 0;
  }

  /// Before the block sees `input`.
  void before(const Block& block, const Input& input) SERVOSENSE_NONBLOCKING {
    if (count_ == 2 * Stride) {
      older_ = newer_;
      for (std::size_t i = 0; i < Stride; ++i) inputs_[i] = inputs_[Stride + i];
      count_ = Stride;
    }
    if (count_ == 0) older_ = block;
    if (count_ == Stride) newer_ = block;
    inputs_[count_++] = input;
    ++samples_;
  }
  /// When that input has raised an alarm.
  void freeze() SERVOSENSE_NONBLOCKING {
    evidence_.before = older_;
    evidence_.inputs = inputs_;
    evidence_.count = count_;
    evidence_.sample = samples_;
  }
  [[nodiscard]] const Evidence& evidence() const noexcept { return evidence_; }

 private:
  Block older_{};
  Block newer_{};
  std::array<Input, 2 * Stride> inputs_{};
  std::uint32_t count_ = 0;
  std::uint64_t samples_ = 0;
  Evidence evidence_{};
};

}  // namespace servosense
