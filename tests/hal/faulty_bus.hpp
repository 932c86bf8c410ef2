// Three drives on a bus at 8 kHz that loses frames, sends them twice and out of order, and stands
// still for 2 ms now and then. What it did is counted.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <vector>

#include "servosense/hal/can_decoder.hpp"
#include "servosense/hal/row_source.hpp"

namespace faulty_bus {

using namespace servosense;

inline constexpr Nanoseconds kPeriod = 125000;

inline constexpr const char* kMap = R"(period_s = 0.000125
signal, frame, byte, type, factor
spindle.angle_counts, 0x181, 0, int32
spindle.current_A,    0x181, 4, int16, 0.001
sequence,             0x181, 7, uint8
x.position_m,         0x281, 0, int32, 1e-8
x.current_A,          0x281, 4, int16, 0.001
sequence,             0x281, 7, uint8
y.position_m,         0x381, 0, int32, 1e-8
y.current_A,          0x381, 4, int16, 0.001
sequence,             0x381, 7, uint8
)";

struct Injected {
  std::uint64_t lost = 0, twice = 0, swapped = 0, stalls = 0;
};

/// Frames are made as rows are asked for.
class FaultyBus final : public RowSource {
 public:
  FaultyBus(double faults, unsigned seed, std::int64_t periods)
      : decoder_(*CanMap::parse(kMap, "map")), random_(seed), faults_(faults), periods_(periods) {}

  [[nodiscard]] const std::vector<Signal>& signals() const override {
    return decoder_.map().signals;
  }
  [[nodiscard]] double period_s() const override { return 125e-6; }
  /// Called with the time by the clock of the bus when the frames of a period are there; may wait.
  std::function<void(Nanoseconds)> before_frames;
  Expected<bool> next(TraceRow& row) override {
    while (!decoder_.pop(row)) {
      if (period_ == periods_ + 1) return false;
      if (period_ == periods_) decoder_.finish();
      if (period_ < periods_) one_period();
      ++period_;
    }
    return true;
  }
  const CanDecoder& decoder() const { return decoder_; }
  Injected injected;

 private:
  double uniform() { return static_cast<double>(random_()) / 4294967296.0; }
  void one_period() {
    const double t = 125e-6 * static_cast<double>(period_);
    // The bus stands still for 2 ms now and then; then everything comes at once.
    if (faults_ > 0 && stalled_until_ <= period_ && uniform() < 1.0 / 4000) {
      stalled_until_ = period_ + 16;
      ++injected.stalls;
    }
    const Nanoseconds now = std::max(period_, stalled_until_) * kPeriod;
    if (before_frames) before_frames(now + 80000);  // the latest of them
    const bool steady = period_ > 100 && period_ < periods_ - 100;
    for (unsigned drive = 0; drive < 3; ++drive) {
      CanFrame frame;
      frame.id = 0x181 + 0x100 * drive;
      frame.length = 8;
      frame.t_ns = now + (10 + 20 * drive) * 1000 + static_cast<Nanoseconds>(30000 * uniform());
      const double turns = 100 * t + 0.001 * std::sin(40 * t);
      const auto motion = drive == 0 ? static_cast<std::int64_t>(131072 * turns)
                                     : static_cast<std::int64_t>(2e6 * t);
      const auto bits = static_cast<std::uint32_t>(motion);
      const auto current = static_cast<std::uint16_t>(
          static_cast<std::int16_t>(500 + 20 * std::sin(300 * t) + 20 * uniform()));
      for (unsigned i = 0; i < 4; ++i) frame.data[i] = static_cast<std::uint8_t>(bits >> (8 * i));
      frame.data[4] = static_cast<std::uint8_t>(current);
      frame.data[5] = static_cast<std::uint8_t>(current >> 8U);
      frame.data[7] = static_cast<std::uint8_t>(period_);
      if (steady && uniform() < faults_) {
        ++injected.lost;
        continue;
      }
      CanFrame& held = held_[drive];
      if (held.length > 0) {  // the one that was held back comes behind this one
        decoder_.push(frame);
        held.t_ns = frame.t_ns;
        decoder_.push(held);
        held.length = 0;
        continue;
      }
      if (steady && uniform() < faults_) {
        ++injected.swapped;
        held = frame;
        continue;
      }
      decoder_.push(frame);
      if (steady && uniform() < faults_) {
        ++injected.twice;
        decoder_.push(frame);
      }
    }
  }

  CanDecoder decoder_;
  std::mt19937 random_;
  double faults_;
  std::int64_t periods_, period_ = 0, stalled_until_ = 0;
  std::array<CanFrame, 3> held_{};
};

}  // namespace faulty_bus
