// Ring buffers: the last N values, oldest first. `RingBuffer` owns a fixed array, `RingView` works
// on memory that the caller provides; neither ever allocates.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <type_traits>

#include "servosense/core/real_time.hpp"

namespace servosense {

/// Ring over caller memory. Misuse contract: the span must outlive the view, and must not be empty.
template <typename T>
class RingView {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  explicit RingView(std::span<T> memory) noexcept : memory_(memory) {}

  void clear() noexcept { head_ = size_ = 0; }
  /// Stores `value`; returns the value it displaced, or T{} while the ring is still filling.
  T push(T value) SERVOSENSE_NONBLOCKING {
    const bool was_full = full();
    T displaced = was_full ? memory_[head_] : T{};
    memory_[head_] = value;
    if (++head_ == memory_.size()) head_ = 0;
    if (!was_full) ++size_;
    return displaced;
  }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] std::size_t capacity() const noexcept { return memory_.size(); }
  [[nodiscard]] bool full() const noexcept { return size_ == memory_.size(); }
  /// i-th value, 0 the oldest. Requires i < size().
  [[nodiscard]] const T& operator[](std::size_t i) const noexcept {
    std::size_t at = head_ + memory_.size() - size_ + i;
    if (at >= memory_.size()) at -= memory_.size();
    return memory_[at];
  }
  /// k-th newest value, 0 the newest. Requires k < size().
  [[nodiscard]] const T& newest(std::size_t k = 0) const noexcept { return (*this)[size_ - 1 - k]; }

 private:
  std::span<T> memory_;
  std::size_t head_ = 0;
  std::size_t size_ = 0;
};

/// Ring with its own fixed array; trivially copyable, so it may be part of a block's State.
template <typename T, std::size_t Capacity>
class RingBuffer {
  static_assert(Capacity > 0);
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  void clear() noexcept { head_ = size_ = 0; }
  T push(T value) SERVOSENSE_NONBLOCKING {
    const bool was_full = full();
    T displaced = was_full ? memory_[head_] : T{};
    memory_[head_] = value;
    if (++head_ == Capacity) head_ = 0;
    if (!was_full) ++size_;
    return displaced;
  }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] static constexpr std::size_t capacity() noexcept { return Capacity; }
  [[nodiscard]] bool full() const noexcept { return size_ == Capacity; }
  [[nodiscard]] const T& operator[](std::size_t i) const noexcept {
    std::size_t at = head_ + Capacity - size_ + i;
    if (at >= Capacity) at -= Capacity;
    return memory_[at];
  }
  [[nodiscard]] const T& newest(std::size_t k = 0) const noexcept { return (*this)[size_ - 1 - k]; }

 private:
  std::array<T, Capacity> memory_{};
  std::size_t head_ = 0;
  std::size_t size_ = 0;
};

}  // namespace servosense
