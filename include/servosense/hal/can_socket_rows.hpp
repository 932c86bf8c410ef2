// A live CAN interface as rows of signals.
#pragma once

#include <algorithm>
#include <atomic>
#include <string>
#include <utility>
#include <vector>

#include "servosense/hal/can_decoder.hpp"
#include "servosense/hal/can_socket.hpp"
#include "servosense/hal/host_clock.hpp"
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
        // Frames that make no row, such as heartbeats, are silence, too.
        if (heard_ns_ == 0) heard_ns_ = frame.t_ns;
        if (decoder_.pop(row)) break;
        if (frame.t_ns - heard_ns_ > kSilence_ns) return silent(row);
        continue;
      }
      return silent(row);
    }
    heard_ns_ = host_now_ns();
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
  static constexpr Nanoseconds kSilence_ns = Nanoseconds{kWait_ms} * 1'000'000;
  // Says that nothing has come until now.
  bool silent(TraceRow& row) noexcept {
    heard_ns_ = host_now_ns();
    row.fields.clear();
    row.t_ns = decoder_.silent_until(heard_ns_);
    return true;
  }

  CanSocket socket_;
  CanDecoder decoder_;
  const std::atomic<bool>* stop_;
  Nanoseconds heard_ns_ = 0;  // of the last row, or word of silence
  bool finished_ = false;
};

}  // namespace servosense
