// CAN socket on a real kernel: runs as the only program of a virtual machine (tests/vm/run.sh),
// with vcan0 up and can-utils beside it.
#include "servosense/hal/can_socket.hpp"

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <thread>

#include "check.hpp"
#include "servosense/hal/can_decoder.hpp"
#include "servosense/io/candump.hpp"

using namespace servosense;

namespace {

int shell(const std::string& command) { return std::system(command.c_str()); }

CanFrame numbered(std::uint32_t id, unsigned n, bool fd) {
  CanFrame frame;
  frame.id = id;
  frame.fd = fd;
  frame.bit_rate_switch = fd;
  frame.length = fd ? 64 : 8;
  for (unsigned i = 0; i < frame.length; ++i) frame.data[i] = static_cast<std::uint8_t>(n + i);
  return frame;
}

bool same(CanFrame a, const CanFrame& b) {
  a.t_ns = b.t_ns;
  return a == b;
}

void frames_of_all_kinds() {
  auto sender = CanSocket::open("vcan0");
  auto receiver = CanSocket::open("vcan0");
  CHECK(sender && receiver);
  if (!sender || !receiver) return;
  std::vector<CanFrame> all = {numbered(0x181, 1, false), numbered(0x181, 2, true)};
  all.push_back(numbered(0x7FF, 3, false));
  all.back().length = 0;
  all.back().data = {};
  all.push_back(numbered(0x18FF0001, 4, true));
  all.back().extended = true;
  all.push_back(numbered(0x123, 0, false));
  all.back().remote = true;
  all.back().data = {};
  for (const CanFrame& f : all) CHECK(sender->send(f));
  CanFrame got;
  Nanoseconds last = 0;
  for (const CanFrame& f : all) {
    const auto more = receiver->receive(got, 500);
    CHECK(more && *more);
    CHECK(same(f, got));
    CHECK(got.t_ns >= last && got.t_ns > 0);
    last = got.t_ns;
  }
  const auto none = receiver->receive(got, 10);
  CHECK(none && !*none);
}

void filters_and_errors() {
  const std::uint32_t keys[] = {0x181, 0x18FF0001U | 1U << 31U};
  auto receiver = CanSocket::open("vcan0", keys);
  auto sender = CanSocket::open("vcan0");
  if (!receiver || !sender) return;
  CanFrame wide = numbered(0x18FF0001, 2, false);
  wide.extended = true;
  CanFrame narrow = wide;  // the same digits, another frame
  narrow.extended = false;
  narrow.id = 0x001;
  for (const CanFrame& f : {numbered(0x182, 0, false), numbered(0x181, 1, false), narrow, wide})
    CHECK(sender->send(f));
  CanFrame got;
  CHECK(*receiver->receive(got, 500) && got.id == 0x181);
  CHECK(*receiver->receive(got, 500) && got.id == 0x18FF0001 && got.extended);
  CHECK(!*receiver->receive(got, 10));
  CanFrame bus_off;
  bus_off.error = true;
  bus_off.id = 0x40;
  bus_off.length = 8;
  CHECK(sender->send(bus_off));
  CHECK(*receiver->receive(got, 500) && got.error && can_error_text(got) == "bus off");
}

void drops_are_counted() {
  auto receiver = CanSocket::open("vcan0");
  auto sender = CanSocket::open("vcan0");
  if (!receiver || !sender) return;
  constexpr unsigned kSent = 20000;
  for (unsigned n = 0; n < kSent; ++n)
    if (!sender->send(numbered(0x100 + n % 16, n, false))) break;
  CanFrame got;
  std::uint64_t received = 0;
  while (*receiver->receive(got, 20)) ++received;
  CHECK(sender->send(numbered(0x100, 0, false)));
  CHECK(*receiver->receive(got, 500));
  std::printf("  of %u frames %llu were read late, %llu dropped by the kernel\n", kSent,
              static_cast<unsigned long long>(received),
              static_cast<unsigned long long>(receiver->health().dropped));
  CHECK(received < kSent);
  CHECK(received + receiver->health().dropped == kSent);
}

void down_and_up_again() {
  auto receiver = CanSocket::open("vcan0");
  if (!receiver) return;
  CanFrame got;
  CHECK(shell("ip link set vcan0 down") == 0);
  CHECK(!*receiver->receive(got, 100));
  CHECK(receiver->health().interruptions == 1);
  CHECK(shell("ip link set vcan0 up") == 0);
  {
    auto sender = CanSocket::open("vcan0");
    CHECK(sender && sender->send(numbered(0x181, 7, false)));
  }
  CHECK(*receiver->receive(got, 1000) && got.id == 0x181);
  // Unplugged, and plugged in again: another device of the same name.
  CHECK(shell("ip link del vcan0") == 0);
  CHECK(!*receiver->receive(got, 100));
  CHECK(!*receiver->receive(got, 100));
  CHECK(shell("ip link add dev vcan0 type vcan && ip link set vcan0 up") == 0);
  CHECK(!*receiver->receive(got, 300));
  {
    auto sender = CanSocket::open("vcan0");
    CHECK(sender && sender->send(numbered(0x182, 8, false)));
  }
  CHECK(*receiver->receive(got, 1000) && got.id == 0x182);
  CHECK(receiver->health().interruptions == 2);
  const auto absent = CanSocket::open("vcan9");
  CHECK(!absent && absent.error().sentence.find("no such interface") != std::string::npos);
}

// can-utils as independent peers: what candump records of our frames reads back, what canplayer
// sends arrives.
void peers() {
  if (shell("test -x /bin/candump") != 0) {
    std::puts("SKIPPED: can-utils are not in the machine");
    return;
  }
  shell("candump -L vcan0 -n 400 > /tmp/log & sleep 0.3");
  auto sender = CanSocket::open("vcan0");
  if (!sender) return;
  for (unsigned n = 0; n < 400; ++n) {
    CanFrame f = numbered(0x200 + n % 7, n, n % 2 == 1);
    f.extended = n % 3 == 0;
    CHECK(sender->send(f));
    // A peer that is slow to read loses frames beyond a few hundred.
    if (n % 50 == 49) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  shell("sleep 0.5");
  auto log = CandumpReader::open("/tmp/log");
  CHECK(log);
  if (!log) return;
  unsigned n = 0;
  CanFrame got;
  while (*log->next(got)) {
    CanFrame f = numbered(0x200 + n % 7, n, n % 2 == 1);
    f.extended = n % 3 == 0;
    CHECK(same(f, got));
    ++n;
  }
  CHECK(n == 400);
  // The log that we write is one that canplayer sends.
  {
    std::ofstream own("/tmp/own.log");
    for (unsigned i = 0; i < 200; ++i) {
      CanFrame f = numbered(0x300, i, i % 2 == 1);
      f.t_ns = 1'700'000'000'000'000'000 + i * Nanoseconds{125000};
      own << candump_line(f, "vcan0") << '\n';
    }
  }
  const std::uint32_t keys[] = {0x300};
  auto receiver = CanSocket::open("vcan0", keys);
  CHECK(receiver);
  shell("canplayer -I /tmp/own.log &");
  n = 0;
  while (*receiver->receive(got, 1000)) {
    CHECK(same(numbered(0x300, n, n % 2 == 1), got));
    if (++n == 200) break;
  }
  CHECK(n == 200);
}

}  // namespace

int main() {
  frames_of_all_kinds();
  filters_and_errors();
  drops_are_counted();
  peers();
  down_and_up_again();
  return check::done();
}
