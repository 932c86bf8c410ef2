// Rights of root that a thread gives up once it has opened what it needs, so that whoever takes it
// over from outside has little to take. Linux counts rights by thread: a thread passes on what it
// has to those it starts.
#pragma once

#include <cstdint>

namespace servosense {

enum class Privileges : std::uint8_t {
  /// Writing files, listening on a port, locking memory, real-time priority: what a run that began
  /// as root may still need.
  of_a_run,
  none
};

/// Gives up all capabilities of this thread but `kept`, for good: no program that it starts gets
/// them back. An ordinary user has none, and nothing changes. False if the kernel refuses.
bool give_up_privileges(Privileges kept) noexcept;

}  // namespace servosense
