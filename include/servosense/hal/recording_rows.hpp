// Writes every row that passes to a trace file. Replayed, the file gives the same samples, and so
// the same events, as the run it was recorded from.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "servosense/hal/row_source.hpp"

namespace servosense {

class RecordingRows final : public RowSource {
 public:
  RecordingRows(std::unique_ptr<RowSource> rows, TraceWriter writer)
      : rows_(std::move(rows)), writer_(std::move(writer)) {}

  [[nodiscard]] const std::vector<Signal>& signals() const override { return rows_->signals(); }
  [[nodiscard]] double period_s() const override { return rows_->period_s(); }
  [[nodiscard]] std::optional<std::string> meta(std::string_view key) const override {
    return rows_->meta(key);
  }
  [[nodiscard]] double progress() const override { return rows_->progress(); }
  [[nodiscard]] std::vector<std::string> remarks() const override { return rows_->remarks(); }

  /// At the end the file is closed; device error if not everything could be written.
  Expected<bool> next(TraceRow& row) override {
    auto more = rows_->next(row);
    if (!more) return more.error();
    if (!*more) {
      if (auto done = writer_.close(); !done) return done.error();
      return false;
    }
    if (!row.fields.empty())
      if (auto done = writer_.write(row.t_ns, row.fields); !done) return done.error();
    return true;
  }

 private:
  std::unique_ptr<RowSource> rows_;
  TraceWriter writer_;
};

}  // namespace servosense
