// A Modbus slave that shares no code with libmodbus, and that misbehaves on demand: over TCP or on
// one end of a pseudo-terminal.
#pragma once

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pty.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "loopback.hpp"

enum class Misbehaviour { none, exception, truncated, garbage, disconnect, silent };

class ModbusServer {
 public:
  /// `registers(first, count)` gives the words; `fault(n)` what to do with request n.
  using Registers = std::function<std::vector<std::uint16_t>(unsigned first, unsigned count)>;
  using Fault = std::function<Misbehaviour(unsigned n)>;

  ModbusServer(bool tcp, Registers registers, Fault fault)
      : tcp_(tcp), registers_(std::move(registers)), fault_(std::move(fault)) {
    if (tcp_) {
      std::uint16_t port = 0;
      listener_ = listen_on_loopback(port);
      if (listener_ < 0) return;
      url_ = "tcp://127.0.0.1:" + std::to_string(port) + "/1";
    } else {
      int slave = -1;
      char name[128];
      if (openpty(&connection_, &slave, name, nullptr, nullptr) != 0) return;
      termios raw{};
      tcgetattr(slave, &raw);
      cfmakeraw(&raw);
      tcsetattr(slave, TCSANOW, &raw);
      keep_open_ = slave;  // or the master reads EIO whenever nobody is there
      url_ = std::string("rtu:") + name + "?baud=115200&parity=N&unit=1";
    }
    thread_ = std::thread([this] { run(); });
  }
  ModbusServer(const ModbusServer&) = delete;
  ModbusServer& operator=(const ModbusServer&) = delete;
  ~ModbusServer() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
    for (const int fd : {connection_, listener_, keep_open_})
      if (fd >= 0) ::close(fd);
  }
  const std::string& url() const { return url_; }
  unsigned requests() const { return requests_; }

 private:
  bool readable(int fd, int ms) const {
    pollfd p{fd, POLLIN, 0};
    return ::poll(&p, 1, ms) > 0;
  }
  void drop() {
    if (tcp_ && connection_ >= 0) {
      ::close(connection_);
      connection_ = -1;
    }
    buffer_.clear();
  }
  static std::uint16_t crc(const std::vector<std::uint8_t>& bytes) {
    unsigned value = 0xFFFF;
    for (const std::uint8_t byte : bytes) {
      value ^= byte;
      for (int bit = 0; bit < 8; ++bit)
        value = (value & 1U) != 0 ? value >> 1U ^ 0xA001U : value >> 1U;
    }
    return static_cast<std::uint16_t>(value);
  }
  void run() {
    while (!stop_) {
      if (tcp_ && readable(listener_, connection_ < 0 ? 20 : 0)) {
        drop();
        connection_ = accept(listener_, nullptr, nullptr);
        const int yes = 1;
        setsockopt(connection_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
      }
      if (connection_ < 0 || !readable(connection_, 20)) continue;
      std::uint8_t bytes[512];
      const ssize_t n = ::read(connection_, bytes, sizeof bytes);
      if (n <= 0) {
        drop();
        continue;
      }
      buffer_.insert(buffer_.end(), bytes, bytes + n);
      const std::size_t request = tcp_ ? 12 : 8;
      while (connection_ >= 0 && buffer_.size() >= request) {
        const std::vector<std::uint8_t> one(buffer_.begin(),
                                            buffer_.begin() + static_cast<long>(request));
        buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<long>(request));
        answer(one);
      }
    }
  }
  void answer(const std::vector<std::uint8_t>& request) {
    const std::size_t at = tcp_ ? 7 : 1;  // function code
    const unsigned first = request[at + 1] * 256U + request[at + 2];
    const unsigned count = request[at + 3] * 256U + request[at + 4];
    const Misbehaviour fault = fault_(requests_++);
    if (fault == Misbehaviour::silent) return;
    if (fault == Misbehaviour::disconnect) return drop();
    std::vector<std::uint8_t> pdu;
    if (fault == Misbehaviour::exception) {
      pdu = {static_cast<std::uint8_t>(request[at] | 0x80U), 4};
    } else {
      pdu = {request[at], static_cast<std::uint8_t>(2 * count)};
      for (const std::uint16_t word : registers_(first, count)) {
        pdu.push_back(static_cast<std::uint8_t>(word >> 8U));
        pdu.push_back(static_cast<std::uint8_t>(word));
      }
    }
    std::vector<std::uint8_t> out;
    if (tcp_) {
      const auto length = static_cast<std::uint8_t>(pdu.size() + 1);
      out = {request[0], request[1], 0, 0, 0, length, request[6]};
      out.insert(out.end(), pdu.begin(), pdu.end());
    } else {
      out = {request[0]};
      out.insert(out.end(), pdu.begin(), pdu.end());
      const std::uint16_t check = crc(out);
      out.push_back(static_cast<std::uint8_t>(check));
      out.push_back(static_cast<std::uint8_t>(check >> 8U));
    }
    if (fault == Misbehaviour::truncated) out.resize(out.size() / 2);
    if (fault == Misbehaviour::garbage) {
      if (tcp_)
        out[0] = static_cast<std::uint8_t>(out[0] + 17);  // the answer to something else
      else
        out[out.size() - 3] ^= 0x10U;  // a flipped bit
    }
    if (::write(connection_, out.data(), out.size()) < 0) drop();
  }

  bool tcp_;
  Registers registers_;
  Fault fault_;
  std::string url_;
  int listener_ = -1, connection_ = -1, keep_open_ = -1;
  std::vector<std::uint8_t> buffer_;
  std::atomic<unsigned> requests_{0};
  std::atomic<bool> stop_{false};
  std::thread thread_;
};
