// A hostile map and a hostile slave at once: the input is the text of a map up to a zero byte, then
// what the slave answers to one request after another.
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "loopback.hpp"
#include "servosense/hal/modbus_rows.hpp"

namespace {

using Bytes = std::basic_string_view<std::uint8_t>;

int listener = -1;
std::string url;

void listen_once() {
  if (listener >= 0) return;
  std::uint16_t port = 0;
  listener = ::listen_on_loopback(port);
  if (listener < 0) std::abort();
  url = "tcp://127.0.0.1:" + std::to_string(port);
}

void hang_up(int& connection) {
  if (connection < 0) return;
  const linger at_once{1, 0};  // no connection is left waiting
  ::setsockopt(connection, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
  ::close(connection);
  connection = -1;
}

// Of each answer the first byte says how it is put together, the second how long it is.
std::vector<std::uint8_t> answer_to(const std::uint8_t* request, Bytes& script, bool& end) {
  const std::uint8_t kind = script[0];
  const std::size_t length = std::min<std::size_t>(
      script.size() < 2 ? 0 : script[1], script.size() - std::min<std::size_t>(2, script.size()));
  const Bytes body = script.substr(std::min<std::size_t>(2, script.size()), length);
  script.remove_prefix(std::min(script.size(), 2 + length));
  end = kind % 8 == 7;                                   // and hangs up
  if (kind % 4 == 3) return {body.begin(), body.end()};  // no frame at all
  std::vector<std::uint8_t> data(body.begin(), body.end());
  if (kind % 4 < 2) {  // as many registers as were asked for
    data.resize(std::size_t{2} * request[11]);
    data.insert(data.begin(), static_cast<std::uint8_t>(data.size()));
    data.insert(data.begin(), request[7]);
  }
  std::vector<std::uint8_t> answer = {request[0], request[1], 0, 0, 0, 0, request[6]};
  answer[5] = static_cast<std::uint8_t>(data.size() + 1);
  answer.insert(answer.end(), data.begin(), data.end());
  return answer;
}

// After so many answers the slave has shown what it can do: a reader that is refused waits longer
// each time.
constexpr unsigned kMostAnswers = 64;

void slave(Bytes script, std::atomic<bool>& stop) {
  int connection = -1;
  std::vector<std::uint8_t> heard;
  unsigned answers = 0;
  while (!stop) {
    pollfd wait[2] = {{listener, POLLIN, 0}, {connection, POLLIN, 0}};
    ::poll(wait, 2, 1);
    if ((wait[0].revents & POLLIN) != 0) {
      hang_up(connection);
      heard.clear();
      connection = ::accept(listener, nullptr, nullptr);
      continue;
    }
    if (connection < 0 || wait[1].revents == 0) continue;
    std::uint8_t bytes[256];
    const ssize_t n = ::recv(connection, bytes, sizeof bytes, MSG_DONTWAIT);
    if (n <= 0) {
      hang_up(connection);
      continue;
    }
    heard.insert(heard.end(), bytes, bytes + n);
    while (heard.size() >= 12 && connection >= 0) {
      if (script.empty() || ++answers > kMostAnswers) {
        stop = true;
        break;
      }
      bool end = false;
      const auto answer = answer_to(heard.data(), script, end);
      ::send(connection, answer.data(), answer.size(), MSG_NOSIGNAL);
      heard.erase(heard.begin(), heard.begin() + 12);
      if (end) hang_up(connection);
    }
  }
  hang_up(connection);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servosense;
  const Bytes input(data, size);
  const std::size_t zero = std::min(input.find(std::uint8_t{0}), size);
  auto map = ModbusMap::parse({reinterpret_cast<const char*>(data), zero}, "map");  // NOLINT
  if (!map) return 0;
  map->timeout_s = 0.002;  // nobody has time to wait
  map->period_ns = std::min<Nanoseconds>(map->period_ns, 20000);
  listen_once();
  std::atomic<bool> stop{false};
  std::thread other([&] { slave(input.substr(std::min(zero + 1, size)), stop); });
  {
    const std::size_t columns = map->signals.size();
    auto rows = ModbusRows::open(url, std::move(*map), stop);
    TraceRow row;
    Nanoseconds last = 0;
    for (int i = 0; rows && i < 2000; ++i) {
      const auto more = (*rows)->next(row);
      if (!more) std::abort();  // it lives through everything
      if (!*more) break;
      if (!row.fields.empty() && (row.fields.size() != columns || row.t_ns <= last)) std::abort();
      if (!row.fields.empty()) last = row.t_ns;
    }
    if (rows && (*rows)->health().answered > (*rows)->health().requests) std::abort();
    stop = true;
  }
  other.join();
  return 0;
}
