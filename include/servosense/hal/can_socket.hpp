// Frames from a CAN interface of the Linux kernel (SocketCAN), classic and FD.
//
// Times are the kernel's: of the controller where it has a clock that runs with the system's, else
// of the interrupt. Only wanted frames leave the kernel. Error frames come along, and frames that
// the kernel had to drop because nobody read them are counted. An interface that goes down and
// comes back, even as a new device, is taken up again.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/can_frame.hpp"

namespace servosense {

struct CanSocketHealth {
  std::uint64_t received = 0;
  std::uint64_t dropped = 0;        ///< by the kernel; told with the next frame that gets through
  std::uint64_t interruptions = 0;  ///< times the interface was down or gone
};

class CanSocket {
 public:
  /// `keys`: of the frames that are wanted (CanFrame::key()); none: all. Device error if the kernel
  /// has no CAN or the interface is not there.
  static Expected<CanSocket> open(std::string interface, std::span<const std::uint32_t> keys = {});

  CanSocket(CanSocket&& other) noexcept;
  CanSocket& operator=(CanSocket&& other) noexcept;
  ~CanSocket();

  /// Waits up to `timeout_ms` for a frame; false if none has come. Device error for what does not
  /// mend by itself.
  Expected<bool> receive(CanFrame& frame, int timeout_ms);
  /// Device error if the interface does not take it.
  Expected<Done> send(const CanFrame& frame);

  [[nodiscard]] const CanSocketHealth& health() const { return health_; }
  [[nodiscard]] const std::string& interface() const { return interface_; }

 private:
  CanSocket(std::string interface, std::vector<std::uint32_t> keys)
      : interface_(std::move(interface)), keys_(std::move(keys)) {}
  Expected<Done> connect();
  void disconnect() noexcept;
  [[nodiscard]] Error failure(const std::string& what) const;

  std::string interface_;
  std::vector<std::uint32_t> keys_;
  CanSocketHealth health_;
  std::uint32_t kernel_drops_ = 0;  // the kernel's counter, as last seen
  int socket_ = -1;
  bool down_ = false;
};

}  // namespace servosense
