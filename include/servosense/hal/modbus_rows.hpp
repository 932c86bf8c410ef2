// A Modbus slave as rows of signals, over TCP or a serial line (libmodbus).
//
// Buffered maps give every sample the drive has taken, in bursts: row times count from the first
// sample by the drive's own counter, so they are exact however the requests are timed. What was
// overwritten before it could be read is a hole, and counted. Polled maps give a row a poll, on a
// grid of period_s; a poll that fails is a row of invalid values, one that comes too late is a
// hole.
//
// Exceptions, timeouts, truncated or wrong answers and lost connections are counted and lived
// through: the next request is made on a new connection, with a pause that grows to a second. A
// slave that refuses again and again is asked less and less often, down to once a second. Whatever
// a slave does, next() comes back within a few time limits.
// Bad at: slaves whose counter is not read in one piece (it must stand in one request).
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "servosense/hal/modbus_map.hpp"
#include "servosense/hal/row_source.hpp"

namespace servosense {

struct ModbusHealth {
  std::uint64_t requests = 0;
  std::uint64_t answered = 0;
  std::uint64_t exceptions = 0;  ///< the slave refused
  std::uint64_t timeouts = 0;
  std::uint64_t garbage = 0;      ///< answers that were none
  std::uint64_t connections = 0;  ///< made, the first included
  std::uint64_t overwritten = 0;  ///< samples lost from the buffer
  std::uint64_t stalls = 0;       ///< its counter stood still for longer than an answer may take
  std::uint64_t restarts = 0;     ///< the slave began to count anew
  double longest_answer_s = 0;
};

class ModbusRows final : public RowSource {
 public:
  /// `url`: tcp://HOST[:PORT][/UNIT] or rtu:DEVICE[?baud=B][&parity=N|E|O][&unit=U] (port 502,
  /// unit 1, 115200 baud, no parity). Connects. Device error if that fails, usage error for a url
  /// that is none. `stop`: when it becomes true, next() ends the record; it must outlive the
  /// source.
  static Expected<std::unique_ptr<ModbusRows>> open(const std::string& url, ModbusMap map,
                                                    const std::atomic<bool>& stop);
  ~ModbusRows() override;

  [[nodiscard]] const std::vector<Signal>& signals() const override;
  [[nodiscard]] double period_s() const override;
  /// A row, or one without fields when nothing has come for a while.
  Expected<bool> next(TraceRow& row) override;
  [[nodiscard]] std::vector<std::string> remarks() const override;
  [[nodiscard]] const ModbusHealth& health() const;

 private:
  struct Content;
  explicit ModbusRows(std::unique_ptr<Content> content);
  std::unique_ptr<Content> content_;
};

}  // namespace servosense
