// Stands between a Modbus master and a slave of somebody else, over TCP or a pair of
// pseudo-terminals, and spoils answers on demand. Exceptions are the slave's own: it is asked for a
// register that it does not have.
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

enum class Spoil { none, slow, late, exception, truncated, garbage, disconnect, silent };
inline constexpr int kSpoils = 8;

class ModbusRelay {
 public:
  /// What to do with request n.
  using Fault = std::function<Spoil(unsigned n)>;

  /// `slow_s` passes within the master's time limit, `late_s` does not.
  ModbusRelay(bool tcp, Fault fault, double slow_s, double late_s)
      : tcp_(tcp), fault_(std::move(fault)), slow_s_(slow_s), late_s_(late_s) {
    if (tcp_) {
      std::uint16_t port = 0;
      listener_ = listen_on_loopback(port);
      slave_port_ = free_port_on_loopback();
      if (listener_ < 0 || slave_port_ == 0) return;
      master_url_ = "tcp://127.0.0.1:" + std::to_string(port) + "/1";
      slave_address_ = std::to_string(slave_port_);
    } else {
      master_url_ = "rtu:" + terminal(client_, keep_open_[0]) + "?baud=115200&parity=N&unit=1";
      slave_address_ = terminal(slave_, keep_open_[1]);
    }
  }
  ModbusRelay(const ModbusRelay&) = delete;
  ModbusRelay& operator=(const ModbusRelay&) = delete;
  ~ModbusRelay() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
    for (const int fd : {client_, slave_, listener_, keep_open_[0], keep_open_[1]})
      if (fd >= 0) ::close(fd);
  }
  /// Where the slave is to serve: a port or a device.
  const std::string& slave_address() const { return slave_address_; }
  const std::string& master_url() const { return master_url_; }
  /// True when the slave answers within 20 s; from then on the relay works.
  bool start() {
    for (int n = 0; n < 200; ++n) {
      if (tcp_) {
        slave_ = dial();
        if (slave_ >= 0) {
          ::close(slave_);
          slave_ = -1;
          thread_ = std::thread([this] { run(); });
          return true;
        }
      } else {
        // Unit 1, function 3, register 100, one word.
        const std::vector<std::uint8_t> ask = {1, 3, 0, 100, 0, 1, 0xC5, 0xD5};
        if (::write(slave_, ask.data(), ask.size()) > 0 && !reply(500).empty()) {
          thread_ = std::thread([this] { run(); });
          return true;
        }
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    return false;
  }

 private:
  static std::string terminal(int& ours, int& theirs) {
    char name[128];
    if (openpty(&ours, &theirs, name, nullptr, nullptr) != 0) return "none";
    termios raw{};
    tcgetattr(theirs, &raw);
    cfmakeraw(&raw);
    tcsetattr(theirs, TCSANOW, &raw);
    return name;
  }
  int dial() const {
    const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address = loopback(slave_port_);
    if (::connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
      ::close(fd);
      return -1;
    }
    const int yes = 1;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    return fd;
  }
  static bool readable(int fd, int ms) {
    pollfd p{fd, POLLIN, 0};
    return ::poll(&p, 1, ms) > 0;
  }
  static void pause(double seconds) {
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  }
  static std::uint16_t crc(const std::vector<std::uint8_t>& bytes, std::size_t count) {
    unsigned value = 0xFFFF;
    for (std::size_t i = 0; i < count; ++i) {
      value ^= bytes[i];
      for (int bit = 0; bit < 8; ++bit)
        value = (value & 1U) != 0 ? value >> 1U ^ 0xA001U : value >> 1U;
    }
    return static_cast<std::uint16_t>(value);
  }
  void hang_up() {
    if (!tcp_) return;
    for (int* fd : {&client_, &slave_}) {
      if (*fd >= 0) ::close(*fd);
      *fd = -1;
    }
  }
  /// A whole answer of the slave; what there is of it when no more comes for `ms`.
  std::vector<std::uint8_t> reply(int ms) {
    std::vector<std::uint8_t> all;
    const auto whole = [&] {
      const std::size_t at = tcp_ ? 7 : 1;
      if (all.size() < at + 2) return false;
      const std::size_t pdu = (all[at] & 0x80U) != 0 ? 2 : 2U + all[at + 1];
      return all.size() >= at + pdu + (tcp_ ? 0 : 2);
    };
    while (!whole() && !stop_ && readable(slave_, ms)) {
      std::uint8_t bytes[512];
      const ssize_t n = ::read(slave_, bytes, sizeof bytes);
      if (n <= 0) break;
      all.insert(all.end(), bytes, bytes + n);
    }
    return all;
  }
  void run() {
    std::vector<std::uint8_t> buffer;
    while (!stop_) {
      if (tcp_ && readable(listener_, client_ < 0 ? 20 : 0)) {
        hang_up();
        buffer.clear();
        client_ = accept(listener_, nullptr, nullptr);
        const int yes = 1;
        setsockopt(client_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
        slave_ = dial();
      }
      if (client_ < 0 || !readable(client_, 20)) continue;
      std::uint8_t bytes[512];
      const ssize_t n = ::read(client_, bytes, sizeof bytes);
      if (n <= 0) {
        hang_up();
        continue;
      }
      buffer.insert(buffer.end(), bytes, bytes + n);
      const std::size_t request = tcp_ ? 12 : 8;
      if (buffer.size() < request) continue;
      buffer.resize(request);
      pass(buffer);
      buffer.clear();
    }
  }
  void pass(std::vector<std::uint8_t> request) {
    const Spoil fault = fault_(requests_++);
    if (fault == Spoil::disconnect) return hang_up();
    if (fault == Spoil::exception) {
      request[tcp_ ? 8 : 2] = 0xE0;  // register 57444
      if (!tcp_) {
        const std::uint16_t check = crc(request, 6);
        request[6] = static_cast<std::uint8_t>(check);
        request[7] = static_cast<std::uint8_t>(check >> 8U);
      }
    }
    if (::write(slave_, request.data(), request.size()) < 0) return hang_up();
    std::vector<std::uint8_t> answer = reply(5000);
    if (fault == Spoil::silent) return;
    if (fault == Spoil::slow) pause(slow_s_);
    if (fault == Spoil::late) pause(late_s_);
    if (fault == Spoil::truncated) answer.resize(answer.size() / 2);
    if (fault == Spoil::garbage)
      for (std::uint8_t& byte : answer) byte = static_cast<std::uint8_t>(byte * 37U + 11U);
    if (::send(client_, answer.data(), answer.size(), MSG_NOSIGNAL) < 0 &&
        ::write(client_, answer.data(), answer.size()) < 0)
      hang_up();
  }

  bool tcp_;
  Fault fault_;
  double slow_s_, late_s_;
  std::string master_url_, slave_address_;
  std::uint16_t slave_port_ = 0;
  int listener_ = -1, client_ = -1, slave_ = -1;
  int keep_open_[2] = {-1, -1};  // or the master end reads EIO whenever nobody is there
  unsigned requests_ = 0;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};
