#include "modbus_link.hpp"

#include <modbus/modbus.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <utility>

#include "map_table.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

using Clock = std::chrono::steady_clock;
using detail::parse_unsigned;

constexpr int kSlice_ms = 50;          // after which a request to stop is seen
constexpr std::size_t kTcpHeader = 6;  // transaction, protocol, length
constexpr unsigned kLongestTcp = 254;  // unit and PDU
constexpr std::uint8_t kReadHolding = 3, kReadInput = 4, kRefused = 0x80;

std::uint8_t high(unsigned word) { return static_cast<std::uint8_t>(word >> 8U); }
std::uint8_t low(unsigned word) { return static_cast<std::uint8_t>(word); }
unsigned word_at(const std::vector<std::uint8_t>& bytes, std::size_t at) {
  return static_cast<unsigned>(bytes[at]) << 8U | bytes[at + 1];
}

// CRC of the serial line: polynomial 0xA001, low byte first.
std::uint16_t crc(const std::uint8_t* bytes, std::size_t count) {
  unsigned value = 0xFFFF;
  for (std::size_t i = 0; i < count; ++i) {
    value ^= bytes[i];
    for (int bit = 0; bit < 8; ++bit)
      value = (value & 1U) != 0 ? value >> 1U ^ 0xA001U : value >> 1U;
  }
  return static_cast<std::uint16_t>(value);
}

}  // namespace

Expected<ModbusAddress> modbus_address(const std::string& url) {
  const auto wrong = [&] {
    return usage_error("'" + printable(url) +
                       "' is no Modbus address; write tcp://HOST:502/UNIT, or "
                       "rtu:/dev/ttyUSB0?baud=115200&parity=N&unit=1");
  };
  ModbusAddress a;
  if (url.starts_with("tcp://")) {
    std::string rest = url.substr(6);
    if (const std::size_t slash = rest.find('/'); slash != std::string::npos) {
      const auto unit = parse_unsigned(std::string_view(rest).substr(slash + 1));
      if (!unit || *unit > 255) return wrong();
      a.unit = static_cast<std::uint8_t>(*unit);
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
      a.unit = static_cast<std::uint8_t>(*value);
    else if (option == "parity=N" || option == "parity=E" || option == "parity=O")
      a.parity = option.back();
    else
      return wrong();
    rest.erase(question, end - question);
  }
  return a;
}

void ModbusLink::Deleter::operator()(_modbus* m) const noexcept {
  modbus_close(m);
  modbus_free(m);
}

ModbusLink::ModbusLink(ModbusAddress address, double timeout_s, const std::atomic<bool>& stop)
    : address_(std::move(address)), timeout_s_(timeout_s), stop_(stop) {}
ModbusLink::~ModbusLink() = default;

std::string ModbusLink::connect() {
  fd_ = -1;
  come_.clear();
  modbus_.reset(address_.tcp
                    ? modbus_new_tcp_pi(address_.host.c_str(), address_.port.c_str())
                    : modbus_new_rtu(address_.host.c_str(), address_.baud, address_.parity, 8, 1));
  if (!modbus_) return std::string("no Modbus connection can be made: ") + modbus_strerror(errno);
  const auto us = static_cast<std::uint32_t>(std::lround(timeout_s_ * 1e6));
  modbus_set_response_timeout(modbus_.get(), us / 1'000'000, us % 1'000'000);
  modbus_set_slave(modbus_.get(), address_.unit);
  if (modbus_connect(modbus_.get()) != 0)
    return std::string("no connection: ") + modbus_strerror(errno) +
           "; check the address, and that the device is on";
  fd_ = modbus_get_socket(modbus_.get());
  return {};
}

std::vector<std::uint8_t> ModbusLink::framed(const std::vector<std::uint8_t>& pdu) {
  std::vector<std::uint8_t> frame;
  if (address_.tcp) {
    ++transaction_;
    const auto length = static_cast<unsigned>(1 + pdu.size());
    frame = {high(transaction_), low(transaction_), 0, 0, high(length), low(length)};
  }
  frame.push_back(address_.unit);
  frame.insert(frame.end(), pdu.begin(), pdu.end());
  if (!address_.tcp) {
    const std::uint16_t check = crc(frame.data(), frame.size());
    frame.insert(frame.end(), {low(check), high(check)});
  }
  return frame;
}

bool ModbusLink::send(const std::vector<std::uint8_t>& frame) {
  // A serial line tells no answer from another: what comes unasked is not for this request.
  if (!address_.tcp) {
    modbus_flush(modbus_.get());
    come_.clear();
  }
  const ssize_t sent = address_.tcp ? ::send(fd_, frame.data(), frame.size(), MSG_NOSIGNAL)
                                    : ::write(fd_, frame.data(), frame.size());
  return sent == static_cast<ssize_t>(frame.size());
}

ModbusLink::Answer ModbusLink::read(bool input_registers, std::uint16_t first, unsigned count,
                                    std::vector<std::uint16_t>& words) {
  const std::uint8_t function = input_registers ? kReadInput : kReadHolding;
  if (fd_ < 0 || !send(framed({function, high(first), low(first), high(count), low(count)})))
    return Answer::garbage;
  const auto end = Clock::now() + std::chrono::duration<double>(timeout_s_);
  Answer answer = Answer::timeout;
  while (!take(function, count, words, answer)) {
    if (stop_) return Answer::stopped;
    const double left_s = std::chrono::duration<double>(end - Clock::now()).count();
    if (left_s <= 0) return Answer::timeout;
    pollfd wanted{fd_, POLLIN, 0};
    const int ready =
        ::poll(&wanted, 1, static_cast<int>(std::min<double>(kSlice_ms, std::ceil(1e3 * left_s))));
    if (ready < 0 && errno != EINTR) return Answer::garbage;
    if (ready <= 0) continue;
    std::uint8_t bytes[512];
    const ssize_t n = ::read(fd_, bytes, sizeof bytes);
    if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR)) return Answer::garbage;
    if (n > 0) come_.insert(come_.end(), bytes, bytes + n);
  }
  return answer;
}

bool ModbusLink::take(std::uint8_t function, unsigned count, std::vector<std::uint16_t>& words,
                      Answer& answer) {
  std::vector<std::uint8_t> pdu;
  if (!(address_.tcp ? take_tcp(pdu, answer) : take_serial(count, pdu, answer))) return false;
  if (pdu.empty()) return true;  // garbage
  answer = Answer::garbage;
  if (pdu[0] == (function | kRefused) && pdu.size() == 2) answer = Answer::exception;
  const std::size_t bytes = std::size_t{2} * count;
  if (pdu[0] != function || pdu.size() != 2 + bytes || pdu[1] != bytes) return true;
  answer = Answer::good;
  words.clear();
  for (std::size_t at = 2; at < pdu.size(); at += 2)
    words.push_back(static_cast<std::uint16_t>(word_at(pdu, at)));
  return true;
}

bool ModbusLink::take_tcp(std::vector<std::uint8_t>& pdu, Answer& answer) {
  for (;;) {
    if (come_.size() < kTcpHeader) return false;
    const unsigned transaction = word_at(come_, 0), protocol = word_at(come_, 2);
    const unsigned length = word_at(come_, 4);
    answer = Answer::garbage;
    // Behind such a header nobody knows where the next one begins.
    if (protocol != 0 || length < 3 || length > kLongestTcp) return true;
    if (come_.size() < kTcpHeader + length) return false;
    const auto begin = come_.begin() + kTcpHeader;
    const std::uint8_t unit = *begin;
    std::vector<std::uint8_t> whole(begin + 1, begin + length);
    come_.erase(come_.begin(), begin + length);
    if (transaction != transaction_) continue;
    if (unit == address_.unit) pdu = std::move(whole);
    return true;
  }
}

bool ModbusLink::take_serial(unsigned count, std::vector<std::uint8_t>& pdu, Answer& answer) {
  if (come_.size() < 2) return false;
  const bool refused = (come_[1] & kRefused) != 0;
  const std::size_t length = refused ? 5 : 5 + std::size_t{2} * count;
  if (come_.size() < length) return false;
  answer = Answer::garbage;
  const std::uint16_t check = crc(come_.data(), length - 2);
  if (come_[0] == address_.unit && come_[length - 2] == low(check) &&
      come_[length - 1] == high(check))
    pdu.assign(come_.begin() + 1, come_.begin() + static_cast<std::ptrdiff_t>(length) - 2);
  return true;
}

}  // namespace servosense
