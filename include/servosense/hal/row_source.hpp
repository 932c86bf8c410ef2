// Rows of measured signals in the form of a trace, wherever they come from.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/trace.hpp"

namespace servosense {

class RowSource {
 public:
  RowSource() = default;
  RowSource(const RowSource&) = delete;
  RowSource& operator=(const RowSource&) = delete;
  virtual ~RowSource() = default;

  [[nodiscard]] virtual const std::vector<Signal>& signals() const = 0;
  /// Time from row to row [s]; 0: to be found from the rows.
  [[nodiscard]] virtual double period_s() const { return 0; }
  /// Next row, later than the one before; false at the end. A row without fields, from a bus, says
  /// that nothing has come until its time.
  virtual Expected<bool> next(TraceRow& row) = 0;
  [[nodiscard]] virtual std::optional<std::string> meta(std::string_view key) const;
  /// Share already read, 0..1; 0 while unknown.
  [[nodiscard]] virtual double progress() const { return 0; }
  /// What a reader must know of what went wrong on the way; empty if nothing did.
  [[nodiscard]] virtual std::vector<std::string> remarks() const { return {}; }
};

inline std::optional<std::string> RowSource::meta(std::string_view /*key*/) const {
  return std::nullopt;
}

}  // namespace servosense
