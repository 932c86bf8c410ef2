#include <algorithm>
#include <cmath>
#include <limits>
#include <ostream>
#include <utility>

#include "servosense/io/output_file.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"
#include "trace_time.hpp"

namespace servosense {
namespace {

using detail::append_time;
using detail::kTimeColumn;

}  // namespace

struct TraceWriter::Content {
  std::optional<OutputFile> file;  // or the caller's
  std::ostream* stream = nullptr;
  bool closed = false;
  bool growing = false;  // goes on after a failure
  std::string name;
  std::vector<Signal> signals;
  std::vector<TraceField> row;  // memory of the convenience overload
  std::string buffer;
  std::uint64_t rows = 0;  // of the buffer
  std::uint64_t lost_rows = 0;
  std::optional<Nanoseconds> last_t_ns;
  std::optional<Error> failure;  // the first

  // What was not closed has failed on the way: a whole file is not there then.
  ~Content() {
    if (stream != nullptr || (file && growing)) static_cast<void>(close());
  }
  [[nodiscard]] Error refused(const std::string& what) const {
    return usage_error(name + ": " + what);
  }
  Expected<Done> accept(std::string file_name, std::vector<Signal> columns,
                        const TraceMetadata& metadata);
  Expected<Done> flush();
  Expected<Done> close();
};

Expected<Done> TraceWriter::Content::accept(std::string file_name, std::vector<Signal> columns,
                                            const TraceMetadata& metadata) {
  name = printable(file_name, 400);
  for (const auto& [key, value] : metadata) {
    const bool one_line =
        (key + value).find_first_of(std::string_view("\r\n\0", 3)) == std::string::npos;
    if (!one_line || key.empty() || key.find(':') != std::string::npos || trim(key) != key ||
        trim(value) != value)
      return refused(
          "metadata " + in_quotes(key) +
          " does not fit a line '# key: value'; take out line ends, outer blanks and the "
          "colon in the key");
    buffer += "# " + key + ": " + value + "\n";
  }
  buffer += kTimeColumn;
  for (const Signal signal : columns) {
    if (std::find(signals.begin(), signals.end(), signal) != signals.end())
      return refused("column " + column_name(signal) + " is given twice; give it once");
    signals.push_back(signal);
    buffer += "," + column_name(signal);
  }
  buffer += '\n';
  return Done{};
}

Expected<Done> TraceWriter::Content::flush() {
  Expected<Done> done = Done{};
  if (failure && !growing) return *failure;
  if (file) {
    done = file->write(buffer);
  } else {
    stream->write(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    if (!*stream) done = device_error(name + ": writing failed, so it is incomplete");
  }
  if (!done) {
    lost_rows += rows;
    if (!failure) failure = done.error();
  }
  buffer.clear();
  rows = 0;
  return done;
}

Expected<Done> TraceWriter::Content::close() {
  if (!std::exchange(closed, true)) {
    static_cast<void>(flush());
    if (stream != nullptr) stream->flush();
    if (stream != nullptr && !*stream && !failure)
      failure = device_error(name + ": writing failed, so it is incomplete");
    if (file && (!failure || growing))
      if (auto done = file->commit(); !done && !failure) failure = done.error();
    file.reset();
  }
  if (!failure) return Done{};
  if (lost_rows == 0) return *failure;
  return device_error(failure->sentence + "; " + std::to_string(lost_rows) +
                      (growing ? " row(s) are missing in it" : " row(s) were not written"));
}

TraceWriter::TraceWriter(std::unique_ptr<Content> content) : content_(std::move(content)) {}
TraceWriter::TraceWriter(TraceWriter&&) noexcept = default;
TraceWriter& TraceWriter::operator=(TraceWriter&&) noexcept = default;
TraceWriter::~TraceWriter() = default;

Expected<TraceWriter> TraceWriter::create(const std::string& path, std::vector<Signal> signals,
                                          const TraceMetadata& metadata, OutputFile::Kind kind) {
  auto content = std::make_unique<Content>();
  const Expected<Done> accepted = content->accept(path, std::move(signals), metadata);
  if (!accepted) return accepted.error();
  auto file = OutputFile::open(path, kind);
  if (!file) return file.error();
  content->file = std::move(*file);
  content->growing = kind == OutputFile::Kind::growing;
  if (content->growing)
    if (auto done = content->flush(); !done) return done.error();
  return TraceWriter(std::move(content));
}

Expected<TraceWriter> TraceWriter::to_stream(std::ostream& stream, std::string name,
                                             std::vector<Signal> signals,
                                             const TraceMetadata& metadata) {
  auto content = std::make_unique<Content>();
  const Expected<Done> accepted = content->accept(std::move(name), std::move(signals), metadata);
  if (!accepted) return accepted.error();
  content->stream = &stream;
  return TraceWriter(std::move(content));
}

Expected<Done> TraceWriter::write(Nanoseconds t_ns, std::span<const TraceField> fields) {
  Content& c = *content_;
  if (c.closed) return c.refused("the trace is closed; write before close()");
  if (fields.size() != c.signals.size())
    return c.refused("expected " + std::to_string(c.signals.size()) + " fields, got " +
                     std::to_string(fields.size()) + "; give one per column");
  if (c.last_t_ns && t_ns <= *c.last_t_ns)
    return c.refused("time " + std::to_string(t_ns) + " ns is not later than " +
                     std::to_string(*c.last_t_ns) + " ns; write rows in the order of time");
  if (t_ns == std::numeric_limits<Nanoseconds>::min())
    return c.refused("the time is beyond 292 years; count from a nearer origin");
  c.last_t_ns = t_ns;
  append_time(c.buffer, t_ns);
  for (std::size_t i = 0; i < fields.size(); ++i) {
    c.buffer += ',';
    if (fields[i].state == TraceField::State::empty) continue;
    if (fields[i].state == TraceField::State::invalid)
      c.buffer += "nan";
    else if (is_counts(c.signals[i]))
      append_integer(c.buffer, fields[i].counts);
    else if (std::isfinite(fields[i].value))
      append_number(c.buffer, fields[i].value);
    else
      c.buffer += "nan";
  }
  c.buffer += '\n';
  ++c.rows;
  constexpr std::size_t kBlock = std::size_t{1} << 16U;
  if (c.buffer.size() >= kBlock) return c.flush();
  return Done{};
}

Expected<Done> TraceWriter::write(Nanoseconds t_ns, std::span<const double> values) {
  Content& c = *content_;
  c.row.clear();
  for (std::size_t i = 0; i < values.size(); ++i) {
    TraceField field = TraceField::of(values[i]);
    if (i < c.signals.size() && is_counts(c.signals[i]) &&
        field.state == TraceField::State::value) {
      if (values[i] != std::floor(values[i]) || std::abs(values[i]) >= 0x1p63)
        return c.refused("column " + column_name(c.signals[i]) + ": expected whole counts, got " +
                         number_text(values[i]) + "; round to counts first");
      field.counts = static_cast<std::int64_t>(values[i]);
    }
    c.row.push_back(field);
  }
  return write(t_ns, std::span<const TraceField>(c.row));
}

Expected<Done> TraceWriter::close() { return content_->close(); }

const std::optional<Error>& TraceWriter::failure() const { return content_->failure; }

}  // namespace servosense
