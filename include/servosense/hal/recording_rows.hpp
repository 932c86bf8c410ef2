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
  /// The writer's close() says what could not be written: no disk ends the run.
  RecordingRows(std::unique_ptr<RowSource> rows, std::shared_ptr<TraceWriter> writer)
      : rows_(std::move(rows)), writer_(std::move(writer)) {}

  [[nodiscard]] const std::vector<Signal>& signals() const override { return rows_->signals(); }
  [[nodiscard]] double period_s() const override { return rows_->period_s(); }
  [[nodiscard]] std::optional<std::string> meta(std::string_view key) const override {
    return rows_->meta(key);
  }
  [[nodiscard]] double progress() const override { return rows_->progress(); }
  [[nodiscard]] std::vector<std::string> remarks() const override { return rows_->remarks(); }

  Expected<bool> next(TraceRow& row) override {
    auto more = rows_->next(row);
    if (more && *more && !row.fields.empty())
      static_cast<void>(writer_->write(row.t_ns, row.fields));
    return more;
  }

 private:
  std::unique_ptr<RowSource> rows_;
  std::shared_ptr<TraceWriter> writer_;
};

}  // namespace servosense
