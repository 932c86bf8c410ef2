// Rows of a source that pass by the pairs of signals of every drive.
#pragma once

#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "servosense/hal/wrapped_rows.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/monitors/pair_config.hpp"

namespace servosense::cli {

/// The drives of a trace whose signals come in pairs. One that the machine file cannot scale is
/// left out: whoever plans its monitors says so.
inline std::vector<PairReader> pair_readers(const MachineFile& machine,
                                            const std::vector<Signal>& signals) {
  std::vector<PairReader> readers;
  const ColumnChoices choices = column_choices(machine);
  for (const Channel channel : kDriveChannels) {
    const auto columns = paired_columns(signals, channel, choices.drive(channel));
    if (!columns) continue;
    if (const auto scaling = pair_scaling(machine, *columns))
      readers.emplace_back(*columns, *scaling);
  }
  return readers;
}

/// All columns of them.
inline std::vector<std::size_t> columns_of(const std::vector<PairReader>& readers) {
  std::vector<std::size_t> all;
  for (const PairReader& reader : readers)
    for (const std::size_t column : reader.columns().columns()) all.push_back(column);
  return all;
}

class PairRows final : public WrappedRows {
 public:
  /// `heard` is told the index of a reader that has a new sample; both outlive the rows.
  PairRows(std::unique_ptr<RowSource> rows, std::vector<PairReader>& readers,
           std::function<void(std::size_t)> heard)
      : WrappedRows(std::move(rows)), readers_(readers), heard_(std::move(heard)) {}
  Expected<bool> next(TraceRow& row) override {
    auto more = rows_->next(row);
    if (!more || !*more) return more;
    for (std::size_t i = 0; i < readers_.size(); ++i)
      if (readers_[i].hear(row)) heard_(i);
    return more;
  }

 private:
  std::vector<PairReader>& readers_;
  std::function<void(std::size_t)> heard_;
};

}  // namespace servosense::cli
