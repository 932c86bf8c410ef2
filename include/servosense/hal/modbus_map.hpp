// Where the signals of a machine are in the registers of a Modbus slave: the map file.
//
// Settings `name = value`, then a table with a heading. `#` begins a comment. Two kinds:
//
// Polled: the registers hold present values, read once every period_s.
//   period_s = 0.05
//   signal,              register, type,  factor
//   spindle.speed_rad_s, 100,      int16, 0.104719755
//   spindle.torque_Nm,   101,      int16, 0.001*35
//
// Buffered: the drive keeps its last samples in a ring of records and counts those it has ever
// written; sample n stands in record n modulo buffer_samples. Read in bursts without a gap.
//   period_s = 0.000125
//   buffer_samples = 512
//   signal,               register, type,   factor, stride
//   counter,              1000,     uint32
//   spindle.angle_counts, 2000,     int32,  ,       3
//   spindle.current_A,    2002,     int16,  0.0125, 3
//
// | setting | |
// |---|---|
// | period_s | of the polls, or of the samples in the buffer; required |
// | table | `holding` (default) or `input` registers |
// | word_order | of numbers in several registers: `big` (default) or `little` |
// | buffer_samples | length of the ring, in samples |
// | timeout_s | for an answer (0.5) |
//
// Types: int16, uint16, int32, uint32, int64, uint64, float32, float64.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/core/units.hpp"
#include "servosense/hal/bit_field.hpp"
#include "servosense/io/trace.hpp"

namespace servosense {

struct ModbusField {
  std::uint16_t address = 0;
  unsigned registers = 1;  ///< 1, 2 or 4
  BitField::Kind kind = BitField::Kind::signed_integer;
  double factor = 1;
  double offset = 0;
};

struct ModbusMap {
  Nanoseconds period_ns = 0;
  bool input_registers = false;
  bool little_words = false;
  double timeout_s = 0.5;
  unsigned buffer_samples = 0;  ///< 0: polled
  unsigned stride = 0;          ///< registers from record to record
  ModbusField counter;          ///< buffered only
  std::vector<Signal> signals;
  std::vector<ModbusField> fields;  ///< by signal

  static Expected<ModbusMap> read(const std::string& path);
  static Expected<ModbusMap> parse(std::string_view text, std::string name);

  /// First register of the values (of the first record) and how many there are.
  [[nodiscard]] std::uint16_t first_register() const;
  [[nodiscard]] unsigned register_count() const;
};

/// The number in the registers of `field`, which begin at words[0].
[[nodiscard]] std::uint64_t raw_words(std::span<const std::uint16_t> words,
                                      const ModbusField& field, bool little_words) noexcept;
[[nodiscard]] TraceField field_from_words(std::span<const std::uint16_t> words,
                                          const ModbusField& field, bool little_words,
                                          bool counts) noexcept;

}  // namespace servosense
