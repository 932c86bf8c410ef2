#include "servosense/hal/bit_field.hpp"

#include <bit>

namespace servosense {

std::optional<std::uint64_t> raw_bits(std::span<const std::uint8_t> data,
                                      const BitField& field) noexcept {
  if (field.bits < 1 || field.bits > 64 || field.start_bit + field.bits > 8 * data.size())
    return std::nullopt;
  std::uint64_t raw = 0;
  for (unsigned i = 0; i < field.bits; ++i) {
    const unsigned at = field.start_bit + i;
    if (field.big_endian)
      raw = raw << 1U | (data[at / 8] >> (7 - at % 8) & 1U);
    else
      raw |= static_cast<std::uint64_t>(data[at / 8] >> at % 8 & 1U) << i;
  }
  if (field.kind == BitField::Kind::signed_integer && field.bits < 64 &&
      (raw >> (field.bits - 1) & 1U) != 0)
    raw |= ~std::uint64_t{0} << field.bits;
  return raw;
}

double number_of(std::uint64_t raw, const BitField& field) noexcept {
  switch (field.kind) {
    case BitField::Kind::unsigned_integer:
      return static_cast<double>(raw);
    case BitField::Kind::signed_integer:
      return static_cast<double>(static_cast<std::int64_t>(raw));
    case BitField::Kind::real:
      return field.bits == 32
                 ? static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(raw)))
                 : std::bit_cast<double>(raw);
  }
  return 0;
}

}  // namespace servosense
