#include "servosense/hal/modbus_rows.hpp"

#include <modbus/modbus.h>
#include <netdb.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <deque>
#include <thread>
#include <utility>

#include "map_table.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

using Clock = std::chrono::steady_clock;
using detail::parse_unsigned;

constexpr unsigned kMostRegisters = 125;
constexpr auto kShortestPause = std::chrono::milliseconds(20);
constexpr auto kLongestPause = std::chrono::milliseconds(1000);

struct Address {
  bool tcp = true;
  std::string host;  // or device
  std::string port = "502";
  int baud = 115200;
  char parity = 'N';
  int unit = 1;
};

Expected<Address> address_of(const std::string& url) {
  const auto wrong = [&] {
    return usage_error("'" + printable(url) +
                       "' is no Modbus address; write tcp://HOST:502/UNIT, or "
                       "rtu:/dev/ttyUSB0?baud=115200&parity=N&unit=1");
  };
  Address a;
  if (url.starts_with("tcp://")) {
    std::string rest = url.substr(6);
    if (const std::size_t slash = rest.find('/'); slash != std::string::npos) {
      const auto unit = parse_unsigned(std::string_view(rest).substr(slash + 1));
      if (!unit || *unit > 255) return wrong();
      a.unit = static_cast<int>(*unit);
      rest.resize(slash);
    }
    const std::size_t colon = rest.rfind(':');
    if (colon != std::string::npos && rest.find(']', colon) == std::string::npos) {
      a.port = rest.substr(colon + 1);
      const auto port = parse_unsigned(a.port);
      if (!port || *port < 1 || *port > 65535) return wrong();
      rest.resize(colon);
    }
    if (rest.size() > 2 && rest.front() == '[' && rest.back() == ']')
      rest = rest.substr(1, rest.size() - 2);
    if (rest.empty()) return wrong();
    a.host = rest;
    return a;
  }
  if (!url.starts_with("rtu:")) return wrong();
  a.tcp = false;
  std::string rest = url.substr(4);
  const std::size_t question = rest.find('?');
  a.host = rest.substr(0, question);
  if (a.host.empty()) return wrong();
  while (question != std::string::npos && question < rest.size()) {
    const std::size_t end = std::min(rest.find('&', question + 1), rest.size());
    const std::string option = rest.substr(question + 1, end - question - 1);
    const auto value = parse_unsigned(
        std::string_view(option).substr(std::min(option.size(), option.find('=') + 1)));
    if (option.starts_with("baud=") && value && *value >= 300 && *value <= 4'000'000)
      a.baud = static_cast<int>(*value);
    else if (option.starts_with("unit=") && value && *value <= 247)
      a.unit = static_cast<int>(*value);
    else if (option == "parity=N" || option == "parity=E" || option == "parity=O")
      a.parity = option.back();
    else
      return wrong();
    rest.erase(question, end - question);
  }
  return a;
}

// libmodbus calls a name that nobody knows a refused connection.
bool is_known(const Address& a) {
  addrinfo* found = nullptr;
  if (getaddrinfo(a.host.c_str(), a.port.c_str(), nullptr, &found) != 0) return false;
  freeaddrinfo(found);
  return true;
}

struct ModbusDeleter {
  void operator()(modbus_t* m) const noexcept {
    modbus_close(m);
    modbus_free(m);
  }
};

}  // namespace

struct ModbusRows::Content {
  ModbusMap map;
  Address address;
  const std::atomic<bool>* stop = nullptr;
  std::string name;
  std::unique_ptr<modbus_t, ModbusDeleter> modbus;
  ModbusHealth health;
  std::deque<TraceRow> ready;
  Clock::duration pause{};
  bool connected = false;

  bool started = false;
  Nanoseconds start_ns = 0;   // of sample or poll 0
  Clock::time_point start;    // the same by the clock that never jumps
  std::int64_t sample = 0;    // next to be read, counted from the first
  std::uint32_t counter = 0;  // the slave's, as last read
  std::int64_t poll = 0;
  Nanoseconds last_row_ns = 0;

  Expected<Done> connect() {
    modbus.reset(address.tcp
                     ? modbus_new_tcp_pi(address.host.c_str(), address.port.c_str())
                     : modbus_new_rtu(address.host.c_str(), address.baud, address.parity, 8, 1));
    connected = false;
    if (!modbus)
      return device_error(name + ": no Modbus connection can be made: " + modbus_strerror(errno));
    const auto us = static_cast<std::uint32_t>(std::lround(map.timeout_s * 1e6));
    modbus_set_response_timeout(modbus.get(), us / 1'000'000, us % 1'000'000);
    modbus_set_byte_timeout(modbus.get(), us / 1'000'000, us % 1'000'000);
    modbus_set_slave(modbus.get(), address.unit);
    if (modbus_connect(modbus.get()) != 0)
      return device_error(name + ": no connection: " + modbus_strerror(errno) +
                          "; check the address, and that the device is on");
    connected = true;
    ++health.connections;
    return Done{};
  }

  // No longer than an answer may take.
  [[nodiscard]] Clock::duration shortest_pause() const {
    return std::min<Clock::duration>(
        kShortestPause,
        std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(map.timeout_s)));
  }

  void wait(Clock::duration time) const {
    const auto end = Clock::now() + time;
    while (!*stop && Clock::now() < end)
      std::this_thread::sleep_for(std::min<Clock::duration>(end - Clock::now(), kShortestPause));
  }

  // False when the slave gave no proper answer; then the connection is made anew if need be.
  bool read(std::uint16_t first, unsigned count, std::vector<std::uint16_t>& words) {
    if (!connected) {
      pause = std::max(pause, shortest_pause());
      wait(pause);
      pause = std::min<Clock::duration>(2 * pause, kLongestPause);
      if (*stop || !connect()) return false;
    }
    // A serial line tells no answer from another: what comes unasked is not for this request.
    if (!address.tcp) modbus_flush(modbus.get());
    words.resize(count);
    ++health.requests;
    const auto begin = Clock::now();
    const int n =
        map.input_registers
            ? modbus_read_input_registers(modbus.get(), first, static_cast<int>(count),
                                          words.data())
            : modbus_read_registers(modbus.get(), first, static_cast<int>(count), words.data());
    const int fault = errno;
    health.longest_answer_s = std::max(health.longest_answer_s,
                                       std::chrono::duration<double>(Clock::now() - begin).count());
    if (n == static_cast<int>(count)) {
      ++health.answered;
      pause = {};
      return true;
    }
    if (n < 0 && fault > MODBUS_ENOBASE && fault < EMBBADCRC) {
      ++health.exceptions;  // a proper answer, and the connection is in step
      return false;
    }
    ++(fault == ETIMEDOUT ? health.timeouts : health.garbage);
    // A late answer has as long again to come before the line is used again.
    if (!address.tcp && fault == ETIMEDOUT)
      pause = std::max(pause, std::chrono::duration_cast<Clock::duration>(
                                  std::chrono::duration<double>(map.timeout_s)));
    // Whatever comes now may belong to the old request.
    modbus_flush(modbus.get());
    connected = false;
    return false;
  }

  void begin() {
    started = true;
    start = Clock::now();
    start_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(
                   std::chrono::system_clock::now().time_since_epoch())
                   .count();
  }
  [[nodiscard]] Nanoseconds elapsed_ns() const {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now() - start).count();
  }

  void add_row(std::int64_t index, std::span<const std::uint16_t> words) {
    TraceRow row;
    row.t_ns = start_ns + index * map.period_ns;
    for (std::size_t i = 0; i < map.fields.size(); ++i)
      row.fields.push_back(
          words.empty()
              ? TraceField::invalid()
              : field_from_words(words.subspan(map.fields[i].address - map.first_register()),
                                 map.fields[i], map.little_words, is_counts(map.signals[i])));
    ready.push_back(std::move(row));
  }

  void poll_once() {
    if (!started) begin();
    const Nanoseconds due = poll * map.period_ns;
    if (elapsed_ns() < due) wait(std::chrono::nanoseconds(due - elapsed_ns()));
    if (*stop) return;
    std::vector<std::uint16_t> words;
    const bool good = read(map.first_register(), map.register_count(), words);
    if (*stop) return;
    add_row(poll, good ? std::span<const std::uint16_t>(words) : std::span<const std::uint16_t>{});
    // Polls that have been missed meanwhile are holes.
    poll = std::max(poll + 1, (elapsed_ns() + map.period_ns / 2) / map.period_ns);
  }

  void read_buffer() {
    std::vector<std::uint16_t> words;
    if (!read(map.counter.address, map.counter.registers, words)) return;
    const auto now = static_cast<std::uint32_t>(raw_words(words, map.counter, map.little_words));
    const std::uint32_t mask = map.counter.registers == 1 ? 0xFFFFU : 0xFFFFFFFFU;
    if (!started) {
      begin();
      counter = now;
      return;
    }
    const std::uint32_t fresh = (now - counter) & mask;
    if (fresh == 0) {
      wait(std::chrono::nanoseconds(map.period_ns * std::max(1U, map.buffer_samples / 8)));
      return;
    }
    const std::int64_t end = sample + fresh;
    // By the clock there cannot be that many: the slave has begun to count anew.
    const double expected = static_cast<double>(elapsed_ns()) / static_cast<double>(map.period_ns);
    if (static_cast<double>(end) > 1.05 * expected + map.buffer_samples) {
      ++health.restarts;
      sample = std::max(sample + 1, static_cast<std::int64_t>(expected));
      counter = now;
      return;
    }
    std::uint32_t next = counter;
    counter = now;
    // Half a buffer is left to the slave to write on while we read.
    const std::uint32_t most = map.buffer_samples - map.buffer_samples / 4;
    if (fresh > most) {
      health.overwritten += fresh - most;
      next = (now - most) & mask;
      sample = end - most;
    }
    const unsigned per_request = kMostRegisters / map.stride;
    std::vector<std::vector<std::uint16_t>> parts;
    const std::int64_t first_sample = sample;
    while (sample < end) {
      const std::uint32_t slot = next % map.buffer_samples;
      const auto count = static_cast<unsigned>(
          std::min<std::int64_t>({end - sample, per_request, map.buffer_samples - slot}));
      const auto first = static_cast<std::uint16_t>(map.first_register() + slot * map.stride);
      if (!read(first, count * map.stride, words)) {
        counter = next;  // these are asked for again, if they are still there
        break;
      }
      parts.push_back(words);
      sample += count;
      next = (next + count) & mask;
    }
    // What the slave has written over while we read is not what it says it is.
    std::uint32_t kept_from = 0;
    std::vector<std::uint16_t> after;
    if (!parts.empty() && read(map.counter.address, map.counter.registers, after)) {
      const auto latest =
          static_cast<std::uint32_t>(raw_words(after, map.counter, map.little_words));
      const std::uint32_t age =
          (latest - (next - static_cast<std::uint32_t>(sample - first_sample))) & mask;
      if (age > map.buffer_samples) kept_from = age - map.buffer_samples;
    } else if (!parts.empty()) {
      kept_from = static_cast<std::uint32_t>(sample - first_sample);  // nobody knows
    }
    std::int64_t index = first_sample;
    for (const auto& part : parts)
      for (std::size_t at = 0; at + map.stride <= part.size(); at += map.stride, ++index) {
        if (index - first_sample < kept_from)
          ++health.overwritten;
        else
          add_row(index, std::span<const std::uint16_t>(part).subspan(at, map.stride));
      }
  }
};

ModbusRows::ModbusRows(std::unique_ptr<Content> content) : content_(std::move(content)) {}
ModbusRows::~ModbusRows() = default;

const std::vector<Signal>& ModbusRows::signals() const { return content_->map.signals; }
double ModbusRows::period_s() const { return seconds_from(content_->map.period_ns); }
const ModbusHealth& ModbusRows::health() const { return content_->health; }

Expected<std::unique_ptr<ModbusRows>> ModbusRows::open(const std::string& url, ModbusMap map,
                                                       const std::atomic<bool>& stop) {
  auto address = address_of(url);
  if (!address) return address.error();
  auto content = std::make_unique<Content>();
  content->map = std::move(map);
  content->address = std::move(*address);
  content->stop = &stop;
  content->name = printable(url);
  if (content->address.tcp && !is_known(content->address))
    return device_error(content->name + ": no computer of the name " +
                        in_quotes(content->address.host) +
                        " is known; check the name, or give its number");
  if (auto done = content->connect(); !done) return done.error();
  return std::unique_ptr<ModbusRows>(new ModbusRows(std::move(content)));
}

Expected<bool> ModbusRows::next(TraceRow& row) {
  Content& c = *content_;
  const auto begin = Clock::now();
  while (c.ready.empty()) {
    if (*c.stop) return false;
    if (c.map.buffer_samples == 0)
      c.poll_once();
    else
      c.read_buffer();
    if (c.ready.empty() && c.started &&
        Clock::now() - begin > std::chrono::duration<double>(c.map.timeout_s)) {
      row.fields.clear();  // nothing has come
      row.t_ns = std::max(c.last_row_ns, c.start_ns + c.elapsed_ns());
      return !*c.stop;
    }
  }
  row = std::move(c.ready.front());
  c.ready.pop_front();
  c.last_row_ns = row.t_ns;
  return true;
}

std::vector<std::string> ModbusRows::remarks() const {
  const ModbusHealth& h = content_->health;
  std::vector<std::string> all;
  auto say = [&](std::uint64_t n, const std::string& what) {
    if (n > 0) all.push_back(std::to_string(n) + ' ' + what);
  };
  say(h.exceptions, "requests were refused by the device");
  say(h.timeouts, "requests were not answered in time");
  say(h.garbage, "answers were wrong or broken off");
  if (h.connections > 1) say(h.connections - 1, "times the connection was made anew");
  say(h.overwritten, "samples were overwritten in the device before they could be read");
  say(h.restarts, "times the device began to count anew");
  return all;
}

}  // namespace servosense
