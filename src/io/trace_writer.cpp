#include <algorithm>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <limits>
#include <ostream>
#include <system_error>

#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"
#include "trace_time.hpp"

namespace servosense {
namespace {

using detail::append_time;
using detail::kTimeColumn;

std::string reason_of_failure() {
  return errno != 0 ? std::generic_category().message(errno) : "unknown reason";
}

}  // namespace

struct TraceWriter::Content {
  std::unique_ptr<std::ofstream> file;  // null when the stream is the caller's
  std::ostream* stream = nullptr;       // null before opening and after closing
  std::string name;
  std::vector<Signal> signals;
  std::vector<TraceField> row;  // memory of the convenience overload
  std::string buffer;
  std::optional<Nanoseconds> last_t_ns;
  std::optional<Error> failure;

  ~Content() { static_cast<void>(close()); }

  [[nodiscard]] Error refused(const std::string& what) const {
    return usage_error(name + ": " + what);
  }
  Expected<Done> accept(std::string file_name, std::vector<Signal> columns,
                        const TraceMetadata& metadata);
  Expected<Done> outcome();
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

Expected<Done> TraceWriter::Content::outcome() {
  if (!failure && stream != nullptr && !*stream)
    failure = device_error(name + ": writing failed (" + reason_of_failure() +
                           "), so the file is incomplete; make room or write elsewhere");
  if (failure) return *failure;
  return Done{};
}

Expected<Done> TraceWriter::Content::flush() {
  errno = 0;
  stream->write(buffer.data(), static_cast<std::streamsize>(buffer.size()));
  buffer.clear();
  return outcome();
}

Expected<Done> TraceWriter::Content::close() {
  if (stream != nullptr && flush()) {
    errno = 0;
    stream->flush();
    if (file) file->close();
    static_cast<void>(outcome());
  }
  stream = nullptr;
  return outcome();
}

TraceWriter::TraceWriter(std::unique_ptr<Content> content) : content_(std::move(content)) {}
TraceWriter::TraceWriter(TraceWriter&&) noexcept = default;
TraceWriter& TraceWriter::operator=(TraceWriter&&) noexcept = default;
TraceWriter::~TraceWriter() = default;

Expected<TraceWriter> TraceWriter::create(const std::string& path, std::vector<Signal> signals,
                                          const TraceMetadata& metadata) {
  auto content = std::make_unique<Content>();
  const Expected<Done> accepted = content->accept(path, std::move(signals), metadata);
  if (!accepted) return accepted.error();
  errno = 0;
  content->file = std::make_unique<std::ofstream>(path, std::ios::binary);
  if (!*content->file)
    return device_error(content->name + ": cannot be created (" + reason_of_failure() +
                        "); check the path and the right to write there");
  content->stream = content->file.get();
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
  if (c.stream == nullptr) return c.refused("the trace is closed; write before close()");
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

}  // namespace servosense
