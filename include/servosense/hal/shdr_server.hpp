// Values and conditions for MTConnect agents, in their adapter protocol (SHDR): a line of text for
// each change, to every agent that is connected. The agent gathers many machines and passes them on
// to whatever the factory runs.
//
//   2026-03-01T10:15:00.250000Z|spindle_torque|4.21
//   2026-03-01T10:15:00.250000Z|chatter_spindle|FAULT|alarm|||strong vibration at no multiple ...
//
// An agent that connects is told the present value of everything, then the changes. `* PING` is
// answered with `* PONG` and the interval in which the next is expected; anything else that a
// client says is passed over, and one that says more than a line holds, or does not read what it is
// sent, is dropped. Where all places are taken, one that has said nothing for two heartbeats makes
// room for a new one, the longest silent first. All memory is bounded. Listens on the loopback
// interface unless told otherwise: the protocol knows no passwords.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "servosense/core/expected.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

struct ShdrConfig {
  std::uint16_t port = 7878;  ///< 0: any that is free
  std::string address = "127.0.0.1";
  std::size_t most_clients = 16;
  std::size_t most_unread_bytes = std::size_t{1} << 18U;  ///< of a client before it is dropped
  int heartbeat_ms = 10000;
};

struct ShdrHealth {
  std::uint64_t connected = 0;
  std::uint64_t dropped_slow = 0;  ///< did not read
  std::uint64_t dropped_rude = 0;  ///< said too much
  std::uint64_t dropped_idle = 0;  ///< had said nothing for two heartbeats when another came
  std::uint64_t refused = 0;       ///< more than most_clients, none of them idle
};

/// "2026-03-01T10:15:00.250000Z"
[[nodiscard]] std::string shdr_time(Nanoseconds t_ns);
/// `text` without what would end a field or a line.
[[nodiscard]] std::string shdr_text(std::string_view text);

class ShdrServer {
 public:
  /// Device error if the port cannot be had.
  static Expected<ShdrServer> open(const ShdrConfig& config);
  ShdrServer(ShdrServer&&) noexcept;
  ShdrServer& operator=(ShdrServer&&) noexcept;
  ~ShdrServer();

  /// The port that is listened on.
  [[nodiscard]] std::uint16_t port() const;
  /// A new value of a data item. Never waits.
  void value(Nanoseconds t_ns, std::string_view item, double value);
  /// The same of a data item that is a word.
  void text(Nanoseconds t_ns, std::string_view item, std::string_view value);
  /// A condition. `level`: NORMAL, WARNING, FAULT or UNAVAILABLE.
  void condition(Nanoseconds t_ns, std::string_view item, std::string_view level,
                 std::string_view native_code, std::string_view text);
  [[nodiscard]] ShdrHealth health() const;

 private:
  struct Content;
  explicit ShdrServer(std::unique_ptr<Content> content);
  std::unique_ptr<Content> content_;
};

}  // namespace servosense
