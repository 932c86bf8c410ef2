// Frames of a CAN bus to rows of signals: the map says where the signals are, the aligner which
// servo period each frame belongs to.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "servosense/hal/can_map.hpp"
#include "servosense/hal/frame_aligner.hpp"

namespace servosense {

struct CanHealth {
  std::uint64_t frames = 0;     ///< that the map speaks of
  std::uint64_t unknown = 0;    ///< others
  std::uint64_t too_short = 0;  ///< a signal lies beyond their end: marked invalid
  std::uint64_t remote = 0;
  std::uint64_t heartbeats = 0;
  std::uint64_t errors = 0;     ///< error frames
  std::uint64_t bus_off = 0;    ///< of them: the controller left the bus
  std::uint64_t overflows = 0;  ///< of them: a controller lost frames
};

class CanDecoder {
 public:
  /// `wait_rows`: see FrameAligner.
  explicit CanDecoder(CanMap map, unsigned wait_rows = 20);

  [[nodiscard]] const CanMap& map() const { return map_; }
  void push(const CanFrame& frame) noexcept;
  void finish() noexcept { aligner_.finish(); }
  /// The next row, if it is ready; call it until it is false after every push().
  bool pop(TraceRow& row) noexcept { return aligner_.pop(row); }

  [[nodiscard]] const CanHealth& health() const noexcept { return health_; }
  [[nodiscard]] const AlignerHealth& aligner_health() const noexcept { return aligner_.health(); }
  /// Nothing has come until `t_ns` by the clock of the stamps: so no row before this time can.
  [[nodiscard]] Nanoseconds silent_until(Nanoseconds t_ns) const noexcept {
    return saturated_difference(aligner_.row_time(t_ns),
                                (aligner_.longest_delay_rows() + 2) * map_.period_ns);
  }
  /// Sentences about everything that was not as it should be.
  [[nodiscard]] std::vector<std::string> remarks() const;

 private:
  void note_error(const CanFrame& frame) noexcept;
  // False when the frame did not hold all that message `index` of the map says.
  bool take(std::size_t index, const CanFrame& frame) noexcept;

  CanMap map_;
  FrameAligner aligner_;
  CanHealth health_;
  std::vector<TraceField> fields_;
  std::vector<std::size_t> streams_;   // of the aligner, by message
  std::vector<std::uint16_t> status_;  // newest status word of each message...
  std::vector<bool> faulted_;          // ...and whether it ever told of a fault
};

/// What an error frame says, in words.
[[nodiscard]] std::string can_error_text(const CanFrame& frame);

}  // namespace servosense
