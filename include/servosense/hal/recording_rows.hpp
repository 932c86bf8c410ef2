// Writes every row that passes to a trace file. Replayed, the file gives the same samples, and so
// the same events, as the run it was recorded from.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "servosense/hal/wrapped_rows.hpp"

namespace servosense {

class RecordingRows final : public WrappedRows {
 public:
  /// The writer's close() says what could not be written: no disk ends the run.
  RecordingRows(std::unique_ptr<RowSource> rows, std::shared_ptr<TraceWriter> writer)
      : WrappedRows(std::move(rows)), writer_(std::move(writer)) {}

  Expected<bool> next(TraceRow& row) override {
    auto more = rows_->next(row);
    if (more && *more && !row.fields.empty())
      static_cast<void>(writer_->write(row.t_ns, row.fields));
    return more;
  }

 private:
  std::shared_ptr<TraceWriter> writer_;
};

}  // namespace servosense
