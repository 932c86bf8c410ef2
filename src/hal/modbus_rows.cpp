#include "servosense/hal/modbus_rows.hpp"

#include <netdb.h>

#include <algorithm>
#include <chrono>
#include <deque>
#include <thread>
#include <utility>

#include "modbus_link.hpp"
#include "servosense/hal/host_clock.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

using Clock = std::chrono::steady_clock;

constexpr auto kShortestPause = std::chrono::milliseconds(20);
constexpr auto kLongestPause = std::chrono::milliseconds(1000);

// libmodbus calls a name that nobody knows a refused connection.
bool is_known(const ModbusAddress& a) {
  addrinfo* found = nullptr;
  if (getaddrinfo(a.host.c_str(), a.port.c_str(), nullptr, &found) != 0) return false;
  freeaddrinfo(found);
  return true;
}

}  // namespace

struct ModbusRows::Content {
  ModbusMap map;
  const std::atomic<bool>* stop = nullptr;
  std::string name;
  std::unique_ptr<ModbusLink> link;
  ModbusHealth health;
  std::deque<TraceRow> ready;
  Clock::duration pause{};  // before the next connection
  Clock::duration refusal_pause{};
  unsigned refusals = 0;  // since the last sample; the first costs no time
  bool connected = false;

  bool started = false;
  Nanoseconds start_ns = 0;   // of sample or poll 0
  Clock::time_point start;    // the same by the clock that never jumps
  std::int64_t sample = 0;    // next to be read, counted from the first
  std::uint32_t counter = 0;  // the slave's, as last read
  Clock::time_point moved;    // when it was last another
  bool stands = false;        // for longer than an answer may take
  std::int64_t poll = 0;
  Nanoseconds last_row_ns = 0;

  Expected<Done> connect() {
    connected = false;
    if (const std::string wrong = link->connect(); !wrong.empty())
      return device_error(name + ": " + wrong);
    connected = true;
    ++health.connections;
    return Done{};
  }

  [[nodiscard]] Clock::duration time_limit() const {
    return std::chrono::duration_cast<Clock::duration>(
        std::chrono::duration<double>(map.timeout_s));
  }

  void wait(Clock::duration time) const {
    const auto end = Clock::now() + time;
    while (!*stop && Clock::now() < end)
      std::this_thread::sleep_for(std::min<Clock::duration>(end - Clock::now(), kShortestPause));
  }

  /// A pause that grows as long as nothing is gained; no longer at first than an answer may take.
  void back_off(Clock::duration& time) const {
    time = std::max(time, std::min<Clock::duration>(kShortestPause, time_limit()));
    wait(time);
    time = std::min<Clock::duration>(2 * time, kLongestPause);
  }

  /// Whether the slave may be asked: connected, and left alone for as long as it wants.
  bool can_ask() {
    if (!connected) {
      back_off(pause);
      if (*stop || !connect()) return false;
    } else if (refusals > 1) {
      back_off(refusal_pause);
    }
    return !*stop;
  }

  /// Samples have come: whatever was wrong is over.
  void gained() {
    pause = refusal_pause = {};
    refusals = 0;
  }

  // After can_ask(). False when the slave gave no proper answer.
  bool read(std::uint16_t first, unsigned count, std::vector<std::uint16_t>& words) {
    ++health.requests;
    const auto begin = Clock::now();
    const ModbusLink::Answer answer = link->read(map.input_registers, first, count, words);
    health.longest_answer_s = std::max(health.longest_answer_s,
                                       std::chrono::duration<double>(Clock::now() - begin).count());
    switch (answer) {
      case ModbusLink::Answer::good:
        ++health.answered;
        return true;
      case ModbusLink::Answer::exception:
        ++health.exceptions;
        ++refusals;
        return false;
      case ModbusLink::Answer::timeout:
        ++health.timeouts;
        // A late answer has as long again to come before a serial line is used again.
        if (!link->address().tcp) pause = std::max(pause, time_limit());
        break;
      case ModbusLink::Answer::garbage:
        ++health.garbage;
        break;
      case ModbusLink::Answer::stopped:
        break;
    }
    // Whatever comes now may belong to the old request.
    connected = false;
    return false;
  }

  void begin() {
    started = true;
    start = Clock::now();
    start_ns = std::max(host_now_ns(), last_row_ns);
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
    // A row has the time at which it was asked for, after whatever pause.
    const bool may = can_ask();
    poll = std::max(poll, (elapsed_ns() + map.period_ns / 2) / map.period_ns);
    std::vector<std::uint16_t> words;
    const bool good = may && read(map.first_register(), map.register_count(), words);
    if (*stop) return;
    if (good) gained();
    add_row(poll, good ? std::span<const std::uint16_t>(words) : std::span<const std::uint16_t>{});
    // Polls that have been missed meanwhile are holes.
    poll = std::max(poll + 1, (elapsed_ns() + map.period_ns / 2) / map.period_ns);
  }

  void read_buffer() {
    std::vector<std::uint16_t> words;
    if (!can_ask() || !read(map.counter.address, map.counter.registers, words)) return;
    const auto now = static_cast<std::uint32_t>(raw_words(words, map.counter, map.little_words));
    const std::uint32_t mask = map.counter.registers == 1 ? 0xFFFFU : 0xFFFFFFFFU;
    if (!started) {
      begin();
      moved = start;
      counter = now;
      return;
    }
    const std::uint32_t fresh = (now - counter) & mask;
    if (fresh == 0) {
      if (Clock::now() - moved > time_limit() && !std::exchange(stands, true)) ++health.stalls;
      wait(std::chrono::nanoseconds(map.period_ns * std::max(1U, map.buffer_samples / 8)));
      return;
    }
    moved = Clock::now();
    stands = false;
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
      // What has come is passed on in time, however slow the rest is.
      const bool late = !parts.empty() && Clock::now() - moved > time_limit();
      if (late || !read(first, count * map.stride, words)) {
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
    if (!parts.empty() && can_ask() && read(map.counter.address, map.counter.registers, after)) {
      const auto latest =
          static_cast<std::uint32_t>(raw_words(after, map.counter, map.little_words));
      const std::uint32_t age =
          (latest - (next - static_cast<std::uint32_t>(sample - first_sample))) & mask;
      if (age > map.buffer_samples) kept_from = age - map.buffer_samples;
    } else if (!parts.empty()) {
      kept_from = static_cast<std::uint32_t>(sample - first_sample);  // nobody knows
    }
    if (!parts.empty()) gained();
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
  auto address = modbus_address(url);
  if (!address) return address.error();
  auto content = std::make_unique<Content>();
  content->map = std::move(map);
  content->stop = &stop;
  content->name = printable(url);
  if (address->tcp && !is_known(*address))
    return device_error(content->name + ": no computer of the name " + in_quotes(address->host) +
                        " is known; check the name, or give its number");
  content->link = std::make_unique<ModbusLink>(std::move(*address), content->map.timeout_s, stop);
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
    if (c.ready.empty() && Clock::now() - begin > c.time_limit()) {
      row.fields.clear();  // nothing has come
      row.t_ns = c.last_row_ns =
          std::max(c.last_row_ns, c.started ? c.start_ns + c.elapsed_ns() : host_now_ns());
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
  say(h.stalls, "times the device's counter stood still for longer than an answer may take");
  say(h.restarts, "times the device began to count anew");
  return all;
}

}  // namespace servosense
