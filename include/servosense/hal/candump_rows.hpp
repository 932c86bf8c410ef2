// A recorded candump log as rows of signals.
#pragma once

#include <string>
#include <vector>

#include "servosense/hal/can_decoder.hpp"
#include "servosense/hal/row_source.hpp"
#include "servosense/io/candump.hpp"

namespace servosense {

class CandumpRows final : public RowSource {
 public:
  CandumpRows(CandumpReader reader, CanMap map)
      : reader_(std::move(reader)), decoder_(std::move(map)) {}

  [[nodiscard]] const std::vector<Signal>& signals() const override {
    return decoder_.map().signals;
  }
  [[nodiscard]] double period_s() const override { return seconds_from(decoder_.map().period_ns); }
  Expected<bool> next(TraceRow& row) override {
    CanFrame frame;
    while (!decoder_.pop(row)) {
      if (at_end_) return false;
      auto more = reader_.next(frame);
      if (!more) return more.error();
      if (*more) {
        decoder_.push(frame);
      } else {
        at_end_ = true;
        decoder_.finish();
      }
    }
    return true;
  }
  [[nodiscard]] std::vector<std::string> remarks() const override { return decoder_.remarks(); }
  [[nodiscard]] const CanDecoder& decoder() const { return decoder_; }

 private:
  CandumpReader reader_;
  CanDecoder decoder_;
  bool at_end_ = false;
};

}  // namespace servosense
