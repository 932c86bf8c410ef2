#include "servosense/hal/privileges.hpp"

#include <linux/capability.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>

namespace servosense {
namespace {

constexpr std::uint32_t bit(unsigned capability) { return 1U << capability; }

}  // namespace

bool give_up_privileges(Privileges kept) noexcept {
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> sets{};
  if (syscall(SYS_capget, &header, sets.data()) != 0) return false;
  // All of the first 32.
  const std::uint32_t mask = kept == Privileges::none
                                 ? 0
                                 : bit(CAP_DAC_OVERRIDE) | bit(CAP_NET_BIND_SERVICE) |
                                       bit(CAP_IPC_LOCK) | bit(CAP_SYS_NICE);
  sets[0].permitted &= mask;
  sets[0].effective &= mask;
  sets[0].inheritable = 0;
  sets[1] = {};
  return syscall(SYS_capset, &header, sets.data()) == 0 &&
         prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0;
}

}  // namespace servosense
