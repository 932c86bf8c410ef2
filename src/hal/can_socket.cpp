#include "servosense/hal/can_socket.hpp"

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <linux/net_tstamp.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include "servosense/hal/host_clock.hpp"

namespace servosense {
namespace {

constexpr int kReceiveBuffer = 1 << 20;  // 8000 frames and more
constexpr int kRetry_ms = 50;

Nanoseconds nanoseconds_of(const timespec& t) {
  return static_cast<Nanoseconds>(t.tv_sec) * kNanosecondsPerSecond + t.tv_nsec;
}

void pause_ms(int ms) {
  const timespec t{ms / 1000, static_cast<long>(ms % 1000) * 1'000'000};
  nanosleep(&t, nullptr);
}

template <typename Value>
bool set_option(int socket, int level, int name, const Value& value) {
  return setsockopt(socket, level, name, &value, sizeof value) == 0;
}

// A controller's clock that nobody has set to the system's time is of no use here.
bool near_system_time(Nanoseconds t) {
  const Nanoseconds off = t - wall_clock_ns();
  return off < kNanosecondsPerSecond && off > -kNanosecondsPerSecond;
}

struct Ancillary {
  Nanoseconds t_ns = 0;
  bool has_drops = false;
  std::uint32_t drops = 0;
};

Ancillary ancillary_of(msghdr& message) {
  Ancillary result;
  Nanoseconds hardware = 0;
  for (cmsghdr* c = CMSG_FIRSTHDR(&message); c != nullptr; c = CMSG_NXTHDR(&message, c)) {
    if (c->cmsg_level != SOL_SOCKET) continue;
    if (c->cmsg_type == SO_RXQ_OVFL) {
      std::memcpy(&result.drops, CMSG_DATA(c), sizeof result.drops);
      result.has_drops = true;
    } else if (c->cmsg_type == SO_TIMESTAMPING) {
      std::array<timespec, 3> stamps{};  // software, none, hardware
      std::memcpy(stamps.data(), CMSG_DATA(c), sizeof stamps);
      result.t_ns = nanoseconds_of(stamps[0]);
      hardware = nanoseconds_of(stamps[2]);
    }
  }
  if (hardware != 0 && near_system_time(hardware)) result.t_ns = hardware;
  result.t_ns = result.t_ns == 0 ? host_now_ns() : host_time_of(result.t_ns);
  return result;
}

CanFrame frame_of(const canfd_frame& raw, bool fd, Nanoseconds t_ns) {
  CanFrame frame;
  frame.t_ns = t_ns;
  frame.error = (raw.can_id & CAN_ERR_FLAG) != 0;
  frame.remote = (raw.can_id & CAN_RTR_FLAG) != 0;
  frame.extended = !frame.error && (raw.can_id & CAN_EFF_FLAG) != 0;
  frame.id = raw.can_id & (frame.error || frame.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
  frame.fd = fd;
  frame.bit_rate_switch = fd && (raw.flags & CANFD_BRS) != 0;
  frame.error_state_indicator = fd && (raw.flags & CANFD_ESI) != 0;
  frame.length = std::min<std::uint8_t>(raw.len, fd ? CANFD_MAX_DLEN : CAN_MAX_DLEN);
  std::copy_n(raw.data, frame.length, frame.data.begin());
  return frame;
}

}  // namespace

Error CanSocket::failure(const std::string& what) const {
  return device_error(interface_ + ": " + what + ": " + std::strerror(errno));
}

Expected<CanSocket> CanSocket::open(std::string interface, std::span<const std::uint32_t> keys) {
  CanSocket can(std::move(interface), {keys.begin(), keys.end()});
  if (can.interface_.empty() || can.interface_.size() >= IFNAMSIZ)
    return device_error("'" + can.interface_ + "' is no name of an interface, such as can0");
  if (auto done = can.connect(); !done) return done.error();
  return can;
}

CanSocket::CanSocket(CanSocket&& other) noexcept
    : interface_(std::move(other.interface_)),
      keys_(std::move(other.keys_)),
      health_(other.health_),
      kernel_drops_(other.kernel_drops_),
      socket_(std::exchange(other.socket_, -1)),
      down_(other.down_) {}

CanSocket& CanSocket::operator=(CanSocket&& other) noexcept {
  std::swap(interface_, other.interface_);
  std::swap(keys_, other.keys_);
  std::swap(health_, other.health_);
  std::swap(kernel_drops_, other.kernel_drops_);
  std::swap(socket_, other.socket_);
  std::swap(down_, other.down_);
  return *this;
}

CanSocket::~CanSocket() { disconnect(); }

void CanSocket::disconnect() noexcept {
  if (socket_ >= 0) ::close(socket_);
  socket_ = -1;
}

Expected<Done> CanSocket::connect() {
  disconnect();
  socket_ = ::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW);
  if (socket_ < 0) {
    if (errno == EAFNOSUPPORT || errno == EPROTONOSUPPORT)
      return device_error(interface_ +
                          ": this kernel has no CAN; load its modules (modprobe can-raw) or replay "
                          "a log with --candump");
    return failure("no CAN socket can be opened");
  }
  const auto index = static_cast<int>(if_nametoindex(interface_.c_str()));
  if (index == 0) {
    disconnect();
    return device_error(interface_ +
                        ": there is no such interface; 'ip link' lists those that are there");
  }
  ifreq request{};
  interface_.copy(request.ifr_name, IFNAMSIZ - 1);
  if (ioctl(socket_, SIOCGIFMTU, &request) == 0 && request.ifr_mtu >= static_cast<int>(CANFD_MTU) &&
      !set_option(socket_, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, 1))
    return failure("CAN FD cannot be switched on");

  std::vector<can_filter> filters;
  for (const std::uint32_t key : keys_) {
    const bool extended = (key >> 31U) != 0;
    filters.push_back({(key & CAN_EFF_MASK) | (extended ? CAN_EFF_FLAG : 0U),
                       CAN_EFF_FLAG | CAN_RTR_FLAG | (extended ? CAN_EFF_MASK : CAN_SFF_MASK)});
  }
  // The kernel takes 512 filters; with more, everything comes and the map sorts it out.
  if (!filters.empty() && filters.size() <= CAN_RAW_FILTER_MAX &&
      setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_FILTER, filters.data(),
                 static_cast<socklen_t>(filters.size() * sizeof filters[0])) != 0)
    return failure("the filter is not accepted");
  const can_err_mask_t all_errors = CAN_ERR_MASK;
  if (!set_option(socket_, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, all_errors))
    return failure("error frames cannot be asked for");
  const int stamps = SOF_TIMESTAMPING_RX_HARDWARE | SOF_TIMESTAMPING_RX_SOFTWARE |
                     SOF_TIMESTAMPING_SOFTWARE | SOF_TIMESTAMPING_RAW_HARDWARE;
  if (!set_option(socket_, SOL_SOCKET, SO_TIMESTAMPING, stamps) ||
      !set_option(socket_, SOL_SOCKET, SO_RXQ_OVFL, 1))
    return failure("time stamps cannot be asked for");
  if (!set_option(socket_, SOL_SOCKET, SO_RCVBUFFORCE, kReceiveBuffer))
    set_option(socket_, SOL_SOCKET, SO_RCVBUF, kReceiveBuffer);  // as much as is allowed

  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = index;
  if (bind(socket_, reinterpret_cast<const sockaddr*>(&address),  // NOLINT: the sockets API
           sizeof address) != 0)
    return failure("cannot be listened to");
  kernel_drops_ = 0;
  down_ = false;
  return Done{};
}

Expected<bool> CanSocket::receive(CanFrame& frame, int timeout_ms) {
  for (;;) {
    if (socket_ < 0) {  // gone, perhaps only unplugged
      const int wait = std::min(timeout_ms, kRetry_ms);
      pause_ms(wait);
      timeout_ms -= wait;
      if (auto done = connect(); !done) {
        disconnect();
        if (timeout_ms <= 0) return false;
        continue;
      }
    }
    canfd_frame raw{};
    alignas(cmsghdr) std::array<char, 256> control{};
    iovec part{&raw, sizeof raw};
    msghdr message{};
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    const ssize_t size = recvmsg(socket_, &message, 0);
    if (size == CAN_MTU || size == CANFD_MTU) {
      const Ancillary extra = ancillary_of(message);
      if (extra.has_drops) {
        health_.dropped += extra.drops - kernel_drops_;  // both are uint32: a wrap is no harm
        kernel_drops_ = extra.drops;
      }
      frame = frame_of(raw, size == CANFD_MTU, extra.t_ns);
      ++health_.received;
      down_ = false;
      return true;
    }
    if (size >= 0) continue;  // no frame of any kind that we know
    if (errno == EINTR) continue;
    if (errno == ENETDOWN || errno == ENODEV || errno == ENXIO) {
      if (!std::exchange(down_, true)) ++health_.interruptions;
      if (if_nametoindex(interface_.c_str()) == 0) disconnect();
      if (timeout_ms <= 0) return false;
      const int wait = std::min(timeout_ms, kRetry_ms);
      if (socket_ >= 0) pause_ms(wait);
      if (socket_ >= 0) timeout_ms -= wait;
      continue;
    }
    if (errno != EAGAIN && errno != EWOULDBLOCK) return failure("reading failed");
    // A device that is unplugged and comes back has another index; the old socket hears nothing.
    if (timeout_ms <= 0) {
      sockaddr_can address{};
      socklen_t length = sizeof address;
      if (getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &length) == 0 &&  // NOLINT
          address.can_ifindex != static_cast<int>(if_nametoindex(interface_.c_str()))) {
        if (!std::exchange(down_, true)) ++health_.interruptions;
        disconnect();
      }
      return false;
    }
    pollfd wait{socket_, POLLIN, 0};
    const int ready = poll(&wait, 1, timeout_ms);
    if (ready == 0) timeout_ms = 0;
    if (ready < 0 && errno != EINTR) return failure("waiting failed");
  }
}

Expected<Done> CanSocket::send(const CanFrame& frame) {
  canfd_frame raw{};
  raw.can_id = frame.id | (frame.extended ? CAN_EFF_FLAG : 0U) |
               (frame.remote ? CAN_RTR_FLAG : 0U) | (frame.error ? CAN_ERR_FLAG : 0U);
  raw.len = frame.length;
  raw.flags = static_cast<std::uint8_t>((frame.bit_rate_switch ? CANFD_BRS : 0) |
                                        (frame.error_state_indicator ? CANFD_ESI : 0));
  std::copy_n(frame.data.begin(), frame.length, raw.data);
  const std::size_t size = frame.fd ? CANFD_MTU : CAN_MTU;
  for (;;) {
    if (::write(socket_, &raw, size) == static_cast<ssize_t>(size)) return Done{};
    if (errno == EINTR) continue;
    if (errno != ENOBUFS && errno != EAGAIN) return failure("sending failed");
    pause_ms(1);  // the queue is full
  }
}

}  // namespace servosense
