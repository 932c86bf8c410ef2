// Rows that pass through: what looks at them, paces or records them derives from this.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "servosense/hal/row_source.hpp"

namespace servosense {

/// Leaves the properties of the rows as they are; next() is of those who derive.
class WrappedRows : public RowSource {
 public:
  explicit WrappedRows(std::unique_ptr<RowSource> rows) : rows_(std::move(rows)) {}
  [[nodiscard]] const std::vector<Signal>& signals() const override { return rows_->signals(); }
  [[nodiscard]] double period_s() const override { return rows_->period_s(); }
  [[nodiscard]] std::optional<std::string> meta(std::string_view key) const override {
    return rows_->meta(key);
  }
  [[nodiscard]] double progress() const override { return rows_->progress(); }
  [[nodiscard]] std::vector<std::string> remarks() const override { return rows_->remarks(); }

 protected:
  std::unique_ptr<RowSource> rows_;
};

}  // namespace servosense
