// Requests to a Modbus slave, one after another, over TCP or a serial line.
//
// libmodbus connects, and sets up the line. What is asked and answered is framed here (Modbus
// Application Protocol V1.1b3; Messaging on TCP/IP V1.0b; Serial Line V1.02), for its time limit
// holds for each byte anew, and over TCP it looks neither at the unit nor at the length of an
// answer. Here one time limit holds for the whole answer, whoever asks to stop waits 50 ms, and an
// answer is taken only with transaction, unit, function and length as asked for. Over TCP, answers
// to other requests are passed over, as the standard says.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"

struct _modbus;  // NOLINT: libmodbus' own

namespace servosense {

inline constexpr unsigned kMostRegisters = 125;  // of one request

struct ModbusAddress {
  bool tcp = true;
  std::string host;  // or device
  std::string port = "502";
  int baud = 115200;
  char parity = 'N';
  std::uint8_t unit = 1;
};
/// Of tcp://HOST[:PORT][/UNIT] or rtu:DEVICE[?baud=B][&parity=N|E|O][&unit=U]; usage error else.
Expected<ModbusAddress> modbus_address(const std::string& url);

class ModbusLink {
 public:
  enum class Answer {
    good,
    exception,  ///< the slave refused, and the connection is in step
    timeout,
    garbage,  ///< wrong, broken off, or the connection is lost
    stopped
  };

  /// `stop` must outlive the link.
  ModbusLink(ModbusAddress address, double timeout_s, const std::atomic<bool>& stop);
  ~ModbusLink();

  /// Makes the connection, anew if need be. What is wrong; empty if nothing.
  std::string connect();
  /// Reads `count` registers. After a timeout or garbage, connect() before the next.
  Answer read(bool input_registers, std::uint16_t first, unsigned count,
              std::vector<std::uint16_t>& words);
  [[nodiscard]] const ModbusAddress& address() const { return address_; }

 private:
  struct Deleter {
    void operator()(_modbus* m) const noexcept;
  };
  [[nodiscard]] std::vector<std::uint8_t> framed(const std::vector<std::uint8_t>& pdu);
  [[nodiscard]] bool send(const std::vector<std::uint8_t>& frame);
  /// Takes the answer out of what has come; false while it is not complete.
  bool take(std::uint8_t function, unsigned count, std::vector<std::uint16_t>& words,
            Answer& answer);
  bool take_tcp(std::vector<std::uint8_t>& pdu, Answer& answer);
  bool take_serial(unsigned count, std::vector<std::uint8_t>& pdu, Answer& answer);

  ModbusAddress address_;
  double timeout_s_;
  const std::atomic<bool>& stop_;
  std::unique_ptr<_modbus, Deleter> modbus_;
  int fd_ = -1;
  std::uint16_t transaction_ = 0;
  std::vector<std::uint8_t> come_;  // bytes that no answer was made of yet
};

}  // namespace servosense
