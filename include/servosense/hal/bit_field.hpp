// A number somewhere in the bytes of a frame.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

namespace servosense {

struct BitField {
  enum class Kind : std::uint8_t { unsigned_integer, signed_integer, real };
  /// Little-endian: of the least significant bit, counted from the least significant bit of byte 0.
  /// Big-endian: of the most significant bit, counted from the most significant bit of byte 0.
  unsigned start_bit = 0;
  unsigned bits = 8;  ///< 1..64; a real has 32 or 64
  Kind kind = Kind::unsigned_integer;
  bool big_endian = false;
  friend bool operator==(const BitField&, const BitField&) = default;
};

/// The bits of `field`, sign extended if it is signed; nothing if the frame is too short.
[[nodiscard]] std::optional<std::uint64_t> raw_bits(std::span<const std::uint8_t> data,
                                                    const BitField& field) noexcept;
/// The number that bits of this kind stand for; NaN is possible for a real.
[[nodiscard]] double number_of(std::uint64_t raw, const BitField& field) noexcept;

}  // namespace servosense
