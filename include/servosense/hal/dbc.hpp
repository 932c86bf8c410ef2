// Signals by name, from the DBC file that describes a CAN bus: where they lie, in what units. For
// filling a CAN map (hal/can_map.hpp).
//
// Read are messages (BO_) and signals (SG_) with byte order, sign, factor, offset, unit and one
// multiplexer a message, and which signals are floating point (SIG_VALTYPE_). Passed over is what
// does not say where a number lies: comments, value names, attributes, nodes.
//
// What is outside the subset is kept with the reason and refused when it is asked for: extended
// multiplexing, messages longer than a CAN FD frame, factors of 0. Identifiers are taken as they
// stand: of J1939 files, with the sender's address in them.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/hal/bit_field.hpp"

namespace servosense {

/// A multiplexed signal is only in frames in which this field has this value.
struct Multiplexing {
  BitField field;
  std::uint64_t value = 0;
  friend bool operator==(const Multiplexing&, const Multiplexing&) = default;
};

struct DbcSignal {
  std::string name;
  BitField bits;
  double factor = 1;
  double offset = 0;
  std::string unit;  ///< as it stands in the file, in whatever encoding
  std::optional<Multiplexing> multiplexing;
  std::string outside;  ///< why it cannot be read; empty if it can
};

struct DbcMessage {
  std::string name;
  std::uint32_t key = 0;  ///< CanFrame::key()
  unsigned bytes = 0;
  std::vector<DbcSignal> signals;
};

class Dbc {
 public:
  static constexpr std::size_t kLongestFile = std::size_t{1} << 24U;

  /// Data error naming file and line; device error if the file cannot be read.
  static Expected<Dbc> read(const std::string& path);
  /// The same from text; `name` stands for the file.
  static Expected<Dbc> parse(std::string_view text, std::string name);

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] const std::vector<DbcMessage>& messages() const { return messages_; }

  struct Found {
    std::uint32_t key = 0;
    DbcSignal signal;
  };
  /// The signal "MESSAGE.SIGNAL". Data error for one that is not there or outside the subset.
  [[nodiscard]] Expected<Found> find(std::string_view path) const;

 private:
  std::string name_;
  std::vector<DbcMessage> messages_;
};

}  // namespace servosense
