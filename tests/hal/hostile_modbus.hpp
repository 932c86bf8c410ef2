// Modbus slaves over TCP that do what no slave should, each in its own way, and never end it by
// themselves.
#pragma once

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "loopback.hpp"

namespace hostile {

enum class Mode {
  silent,
  closes,
  resets,
  drip,
  wrong_unit,
  wrong_protocol,
  too_short,
  too_long,
  false_count,
  wrong_function,
  refuses,
  refuses_data,  // and tells its counter
  garbage,
  never_accepts,
  frozen,
  huge,
  half,
  late,   // what was asked before
  flood,  // of answers to nobody
  twice   // the only one of them that can be lived with
};
constexpr std::array<std::pair<Mode, const char*>, 20> kModes = {
    {{Mode::silent, "silent"},
     {Mode::closes, "closes"},
     {Mode::resets, "resets"},
     {Mode::drip, "drip"},
     {Mode::wrong_unit, "wrong unit"},
     {Mode::wrong_protocol, "wrong protocol"},
     {Mode::too_short, "too short"},
     {Mode::too_long, "too long"},
     {Mode::false_count, "false count"},
     {Mode::wrong_function, "wrong function"},
     {Mode::refuses, "refuses"},
     {Mode::refuses_data, "refuses data"},
     {Mode::garbage, "garbage"},
     {Mode::never_accepts, "never accepts"},
     {Mode::frozen, "frozen counter"},
     {Mode::huge, "huge answer"},
     {Mode::half, "half an answer"},
     {Mode::late, "answer to the last request"},
     {Mode::flood, "flood"},
     {Mode::twice, "answers twice"}}};

class Server {
 public:
  using Registers = std::function<std::vector<std::uint16_t>(unsigned first, unsigned count)>;
  static constexpr unsigned kCounter = 10;  // registers below 100 tell how much there is

  Server(Mode mode, Registers registers) : mode_(mode), registers_(std::move(registers)) {
    listener_ = listen_on_loopback(port_);
    if (listener_ >= 0) thread_ = std::thread([this] { run(); });
  }
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;
  ~Server() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
    hang_up();
    if (listener_ >= 0) ::close(listener_);
  }
  [[nodiscard]] std::string url() const {
    return "tcp://127.0.0.1:" + std::to_string(port_) + "/1";
  }
  [[nodiscard]] unsigned requests() const { return requests_; }

 private:
  using Bytes = std::vector<std::uint8_t>;

  static bool ready(int fd, int ms) {
    pollfd p{fd, POLLIN, 0};
    return ::poll(&p, 1, ms) > 0;
  }
  void hang_up() {
    if (connection_ >= 0) ::close(connection_);
    connection_ = -1;
    come_.clear();
  }
  void run() {
    while (!stop_) {
      if (mode_ == Mode::never_accepts) {
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        continue;
      }
      if (ready(listener_, connection_ < 0 ? 20 : 0)) {
        hang_up();
        connection_ = ::accept(listener_, nullptr, nullptr);
      }
      if (connection_ < 0 || !ready(connection_, 20)) continue;
      std::uint8_t bytes[512];
      const ssize_t n = ::read(connection_, bytes, sizeof bytes);
      if (n <= 0) {
        hang_up();
        continue;
      }
      come_.insert(come_.end(), bytes, bytes + n);
      while (connection_ >= 0 && come_.size() >= 12) {
        const Bytes request(come_.begin(), come_.begin() + 12);
        come_.erase(come_.begin(), come_.begin() + 12);
        ++requests_;
        answer(request);
      }
    }
  }
  bool send(const Bytes& bytes) {
    return connection_ >= 0 && ::send(connection_, bytes.data(), bytes.size(), MSG_NOSIGNAL) ==
                                   static_cast<ssize_t>(bytes.size());
  }
  Bytes pdu_of(const Bytes& request) {
    const unsigned first = request[8] * 256U + request[9], count = request[10] * 256U + request[11];
    Bytes pdu = {request[7], static_cast<std::uint8_t>(2 * count)};
    const bool counter = first < 100;
    for (const std::uint16_t word : counter&& mode_ == Mode::frozen
                                        ? std::vector<std::uint16_t>(count, 7)
                                        : registers_(first, count)) {
      pdu.push_back(static_cast<std::uint8_t>(word >> 8U));
      pdu.push_back(static_cast<std::uint8_t>(word));
    }
    return pdu;
  }
  static Bytes framed(const Bytes& request, const Bytes& pdu) {
    const std::size_t length = pdu.size() + 1;
    Bytes out = {request[0],
                 request[1],
                 0,
                 0,
                 static_cast<std::uint8_t>(length >> 8U),
                 static_cast<std::uint8_t>(length),
                 request[6]};
    out.insert(out.end(), pdu.begin(), pdu.end());
    return out;
  }
  void answer(const Bytes& request) {
    Bytes pdu = pdu_of(request);
    Bytes out = framed(request, pdu);
    switch (mode_) {
      case Mode::silent:
      case Mode::never_accepts:
        return;
      case Mode::closes:
        return hang_up();
      case Mode::resets: {
        const linger at_once{1, 0};
        ::setsockopt(connection_, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
        return hang_up();
      }
      case Mode::drip:  // each byte within the time limit, all of them not
        for (const std::uint8_t byte : out) {
          if (stop_ || !send({byte})) return;
          std::this_thread::sleep_for(std::chrono::milliseconds(30));
          if (ready(listener_, 0)) return;
        }
        return;
      case Mode::wrong_unit:
        ++out[6];
        break;
      case Mode::wrong_protocol:
        out[3] = 1;
        break;
      case Mode::too_short:
        pdu.pop_back();
        pdu.pop_back();
        out = framed(request, pdu);
        break;
      case Mode::too_long:
        pdu.insert(pdu.end(), {1, 2});
        out = framed(request, pdu);
        break;
      case Mode::false_count:
        ++pdu[1];
        out = framed(request, pdu);
        break;
      case Mode::wrong_function:
        ++pdu[0];
        out = framed(request, pdu);
        break;
      case Mode::refuses_data:
        if (request[8] == 0 && request[9] < 100) break;
        [[fallthrough]];
      case Mode::refuses:
        out = framed(request, {static_cast<std::uint8_t>(request[7] | 0x80U), 6});
        break;
      case Mode::garbage:
        for (std::size_t i = 0; i < out.size(); ++i)
          out[i] = static_cast<std::uint8_t>(out[i] * 37U + 11U * i + requests_);
        break;
      case Mode::huge:
        out = framed(request, Bytes(60000, 3));
        break;
      case Mode::half:
        out.resize(out.size() / 2);
        break;
      case Mode::late:
        out = last_;
        last_ = framed(request, pdu);
        break;
      case Mode::flood: {
        Bytes other = out;
        ++other[0];
        while (!stop_ && send(other) && !ready(listener_, 0)) {
        }
        return;
      }
      case Mode::twice:
        out.insert(out.end(), out.begin(), out.end());
        break;
      case Mode::frozen:
        break;
    }
    if (!out.empty() && !send(out)) hang_up();
  }

  Mode mode_;
  Registers registers_;
  std::uint16_t port_ = 0;
  int listener_ = -1, connection_ = -1;
  Bytes come_, last_;
  std::atomic<unsigned> requests_{0};
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace hostile
