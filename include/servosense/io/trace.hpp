// Trace files: recorded signals as comma separated text, read and written row by row in constant
// memory, or read whole for offline analysis. The format: docs/files.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/output_file.hpp"

namespace servosense {

using TraceMetadata = std::vector<std::pair<std::string, std::string>>;

/// "spindle.current_A"
[[nodiscard]] std::string column_name(Signal signal);
/// True for columns of encoder counts, which are whole numbers and kept exactly.
[[nodiscard]] constexpr bool is_counts(Signal signal) noexcept {
  return signal.quantity == Quantity::angle_counts;
}

/// One field of a row.
struct TraceField {
  enum class State : std::uint8_t {
    value,
    empty,   ///< no new value arrived at this instant
    invalid  ///< `nan`: a value arrived and is no good
  };
  State state = State::empty;
  double value = 0;         ///< NaN when invalid
  std::int64_t counts = 0;  ///< exact reading of a counts column; `value` is its double

  [[nodiscard]] static TraceField of(double value);  ///< not finite: invalid
  [[nodiscard]] static TraceField of_counts(std::int64_t counts);
  [[nodiscard]] static TraceField none() { return {}; }
  [[nodiscard]] static TraceField invalid();
};

struct TraceRow {
  Nanoseconds t_ns = 0;
  std::vector<TraceField> fields;  ///< one per signal, in their order
  std::size_t line = 0;            ///< line of the file, from 1
};

/// Reads a trace row by row. Memory does not grow with the file.
///
/// Every malformed line is a data error naming file, line, column and what was expected; nothing is
/// skipped. Blank lines are allowed before the header and at the end only. After an error the
/// reader repeats it.
class TraceReader {
 public:
  /// Opens the file and reads its header. Device error if it cannot be read.
  static Expected<TraceReader> open(const std::string& path);
  /// `name` stands for the file in error sentences.
  static Expected<TraceReader> from_stream(std::unique_ptr<std::istream> stream, std::string name);

  TraceReader(TraceReader&&) noexcept;
  TraceReader& operator=(TraceReader&&) noexcept;
  ~TraceReader();

  /// `# key: value` lines above the header, in their order.
  [[nodiscard]] const TraceMetadata& metadata() const;
  [[nodiscard]] std::optional<std::string> meta(std::string_view key) const;
  /// Columns in their order, time excluded.
  [[nodiscard]] const std::vector<Signal>& signals() const;
  [[nodiscard]] std::optional<std::size_t> column(Signal signal) const;

  /// Reads the next row into `row`, whose memory is used again; false at the end.
  Expected<bool> next(TraceRow& row);
  /// Share of the file's bytes already read, 0..1; 0 while unknown (pipes).
  [[nodiscard]] double progress() const;

 private:
  struct Content;
  explicit TraceReader(std::unique_ptr<Content> content);
  std::unique_ptr<Content> content_;
};

/// Writes a trace row by row. Numbers are spelled in the shortest way that reads back as the same
/// double, times with up to nine decimals. Call close(): only then is the file there, and only it
/// can report that the disk is full.
class TraceWriter {
 public:
  /// Creates or overwrites the file, with its header. Usage error for a column given twice or
  /// metadata that does not fit on a line, device error if the file cannot be written. A growing
  /// one, of a live run, is there at once; rows that find no room are missing in it and counted.
  static Expected<TraceWriter> create(const std::string& path, std::vector<Signal> signals,
                                      const TraceMetadata& metadata = {},
                                      OutputFile::Kind kind = OutputFile::Kind::whole);
  /// Writes to `stream`, which must outlive the writer.
  static Expected<TraceWriter> to_stream(std::ostream& stream, std::string name,
                                         std::vector<Signal> signals,
                                         const TraceMetadata& metadata = {});

  TraceWriter(TraceWriter&&) noexcept;
  TraceWriter& operator=(TraceWriter&&) noexcept;
  ~TraceWriter();

  /// Appends a row: one field per signal, later than the row before it. Usage error otherwise.
  Expected<Done> write(Nanoseconds t_ns, std::span<const TraceField> fields);
  /// The same from plain numbers; those that are not finite are written as `nan`. Usage error for a
  /// fraction in a counts column.
  Expected<Done> write(Nanoseconds t_ns, std::span<const double> values);
  /// Writes what is left; device error if anything was not written, and how many rows. Harmless
  /// when repeated.
  Expected<Done> close();
  /// The first failure; nothing while there is none.
  [[nodiscard]] const std::optional<Error>& failure() const;

 private:
  struct Content;
  explicit TraceWriter(std::unique_ptr<Content> content);
  std::unique_ptr<Content> content_;
};

/// A trace held in memory: one vector per signal, all as long as `t_s`.
struct Trace {
  TraceMetadata metadata;
  std::vector<Signal> signals;
  std::vector<double> t_s;
  /// Value in force at each instant: an empty field holds the last one (NaN before the first), an
  /// invalid one is NaN.
  std::vector<std::vector<double>> columns;
  /// True where a field was given, so that signals of several rates keep their own instants.
  std::vector<std::vector<bool>> updated;
  /// Exact readings of the counts columns, held likewise (0 before the first and where invalid);
  /// empty vectors for the others.
  std::vector<std::vector<std::int64_t>> counts;

  [[nodiscard]] std::size_t size() const { return t_s.size(); }
  /// Values of `signal`, or nullptr if the trace has no such column.
  [[nodiscard]] const std::vector<double>* find(Signal signal) const;
  [[nodiscard]] std::optional<std::string> meta(std::string_view key) const;
  /// 1 / (median time step) [Hz]; NaN with fewer than two rows.
  [[nodiscard]] double sample_rate_hz() const;
};

/// Reads a whole trace.
Expected<Trace> read_trace(const std::string& path);
/// Drains a reader that has not been read from yet.
Expected<Trace> read_trace(TraceReader& reader);

}  // namespace servosense
