// Where the signals of a machine are in the frames of its CAN bus: the map file, and the reading of
// frames by it. Any PDO layout fits, and so do packed blocks of several samples a frame.
//
// A map is text: settings `name = value`, then a table with a heading. `#` begins a comment.
//
//   period_s = 0.000125          servo period, required
//   sync = 0x080                 frame that opens a servo period (CANopen SYNC)
//   heartbeat = 0x701 0x702      frames that say a drive lives; counted
//
//   signal,              frame, byte, type,  factor
//   spindle.angle_counts, 0x181, 0,   int32
//   spindle.current_A,    0x181, 4,   int16, 0.001*8.5
//   sequence,             0x181, 6,   uint8
//
// signal   a trace column; `sequence`: counter of the frames; `CHANNEL.status_word`: CiA 402 0x6041
// frame    identifier; more than 3 hexadecimal digits, or beyond 0x7FF: 29 bits
// byte     where it begins, or byte.bit (bit 0 is the least significant)
// type     intN, uintN (1 to 64 bits), float32, float64; `be` behind it for big-endian whole bytes
// factor   value of one step; a product such as 0.001*8.5 (thousandths of the rated current)
// offset   added after the factor
// samples  a packed block of so many samples, the oldest first
// stride   bytes from sample to sample; needed with samples
// every    servo periods from frame to frame; default: samples
// dbc      MESSAGE.SIGNAL of a DBC file in place of frame, byte and type
//
// With a DBC file (hal/dbc.hpp) the layout comes from there:
//
//   period_s = 0.001
//   dbc = drives.dbc
//   signal,              dbc,                 factor
//   spindle.speed_rad_s, SpindleState.Speed
//   spindle.current_A,   SpindleState.Current, 0.001*8.5
//
// Values come in the units of the DBC file. Known ones (1/min, mm, mA, ...) are turned into those
// of the column; of others the factor says what one of them is.
//
// Bad at: signals spread over two frames.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/core/units.hpp"
#include "servosense/hal/bit_field.hpp"
#include "servosense/hal/dbc.hpp"
#include "servosense/io/can_frame.hpp"
#include "servosense/io/trace.hpp"

namespace servosense {

struct MapField {
  std::size_t column = 0;  ///< of CanMap::signals
  BitField bits;
  unsigned stride_bits = 0;
  double factor = 1;
  double offset = 0;
};

struct MapMessage {
  std::uint32_t key = 0;                     ///< CanFrame::key()
  std::optional<Multiplexing> multiplexing;  ///< some of these frames only
  unsigned samples = 1;
  unsigned every = 1;
  std::vector<MapField> fields;
  std::optional<BitField> sequence;
  std::optional<BitField> status_word;
};

struct CanMap {
  Nanoseconds period_ns = 0;
  std::optional<std::uint32_t> sync_key;
  std::vector<std::uint32_t> heartbeat_keys;
  std::vector<MapMessage> messages;
  std::vector<Signal> signals;  ///< message by message

  /// Data error naming file and line; device error if the file cannot be read.
  static Expected<CanMap> read(const std::string& path);
  /// The same from text; `name` stands for the file, `dbc` for the content of the DBC file it
  /// names.
  static Expected<CanMap> parse(std::string_view text, std::string name, std::string_view dbc = {});
};

/// Sample `sample` (0: the oldest) of a message's field in `frame`: invalid if the frame is too
/// short or the number is none.
[[nodiscard]] TraceField read_field(const CanFrame& frame, const MapField& field, unsigned sample,
                                    bool counts) noexcept;

/// State of a CiA 402 drive from its status word (0x6041).
[[nodiscard]] std::string_view cia402_state(std::uint16_t status_word) noexcept;

}  // namespace servosense
