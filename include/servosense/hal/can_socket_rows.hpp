// A live CAN interface as rows of signals.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <string>
#include <utility>
#include <vector>

#include "servosense/hal/can_decoder.hpp"
#include "servosense/hal/can_socket.hpp"
#include "servosense/hal/row_source.hpp"

namespace servosense {

class CanSocketRows final : public RowSource {
 public:
  /// `stop`: when it becomes true, next() ends the record; it must outlive the source.
  CanSocketRows(CanSocket socket, CanMap map, const std::atomic<bool>& stop)
      : socket_(std::move(socket)), decoder_(std::move(map)), stop_(&stop) {}

  [[nodiscard]] const std::vector<Signal>& signals() const override {
    return decoder_.map().signals;
  }
  [[nodiscard]] double period_s() const override { return seconds_from(decoder_.map().period_ns); }

  Expected<bool> next(TraceRow& row) override {
    CanFrame frame;
    while (!decoder_.pop(row)) {
      if (finished_) return false;
      if (*stop_) {
        finished_ = true;
        decoder_.finish();
        continue;
      }
      auto more = socket_.receive(frame, kWait_ms);
      if (!more) return more.error();
      if (*more) {
        decoder_.push(frame);
        continue;
      }
      // Whatever is older than this can no longer come.
      row.fields.clear();
      row.t_ns = now_ns() - (decoder_.longest_delay_rows() + 2) * decoder_.map().period_ns;
      return true;
    }
    return true;
  }
  [[nodiscard]] std::vector<std::string> remarks() const override {
    std::vector<std::string> all = decoder_.remarks();
    const CanSocketHealth& h = socket_.health();
    if (h.dropped > 0)
      all.push_back("the kernel dropped " + std::to_string(h.dropped) +
                    " frames that were not read in time");
    if (h.interruptions > 0)
      all.push_back("the interface was down or gone " + std::to_string(h.interruptions) +
                    " time(s)");
    return all;
  }
  [[nodiscard]] const CanDecoder& decoder() const { return decoder_; }
  [[nodiscard]] const CanSocket& socket() const { return socket_; }

  /// The frames that a map needs, for the kernel's filter.
  [[nodiscard]] static std::vector<std::uint32_t> wanted(const CanMap& map) {
    std::vector<std::uint32_t> keys = map.heartbeat_keys;
    if (map.sync_key) keys.push_back(*map.sync_key);
    for (const MapMessage& m : map.messages) keys.push_back(m.key);
    return keys;
  }

 private:
  static constexpr int kWait_ms = 20;
  static Nanoseconds now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(
               std::chrono::system_clock::now().time_since_epoch())
        .count();
  }

  CanSocket socket_;
  CanDecoder decoder_;
  const std::atomic<bool>* stop_;
  bool finished_ = false;
};

}  // namespace servosense
