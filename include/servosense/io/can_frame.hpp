// A frame of a CAN bus, classic or FD, as it was received.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "servosense/core/units.hpp"

namespace servosense {

struct CanFrame {
  static constexpr std::size_t kMaxBytes = 64;

  Nanoseconds t_ns = 0;  ///< when it was received
  std::uint32_t id = 0;  ///< 11 or 29 bits; of an error frame, the classes of error
  bool extended = false;
  bool remote = false;  ///< asks for data, carries none
  bool error = false;   ///< made by the controller, never on the wire
  bool fd = false;
  bool bit_rate_switch = false;        ///< FD only
  bool error_state_indicator = false;  ///< FD only: the sender is error passive
  std::uint8_t length = 0;             ///< bytes of data; of a remote frame, those asked for
  std::array<std::uint8_t, kMaxBytes> data{};

  [[nodiscard]] std::span<const std::uint8_t> bytes() const noexcept {
    return {data.data(), remote ? std::size_t{0} : length};
  }
  /// Identifier and its width in one number, to look frames up by.
  [[nodiscard]] std::uint32_t key() const noexcept { return id | (extended ? 1U << 31U : 0U); }
  friend bool operator==(const CanFrame&, const CanFrame&) = default;
};

/// The lengths an FD frame can have: 0..8, 12, 16, 20, 24, 32, 48, 64.
[[nodiscard]] constexpr bool is_fd_length(std::size_t bytes) noexcept {
  return bytes <= 8 || bytes == 12 || bytes == 16 || bytes == 20 || bytes == 24 || bytes == 32 ||
         bytes == 48 || bytes == 64;
}

}  // namespace servosense
