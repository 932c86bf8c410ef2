// Any bytes as a trace file: an error of one line or rows, which then survive writing and reading.
#include <cstdint>
#include <cstdlib>
#include <sstream>

#include "servosense/io/trace.hpp"

using namespace servosense;

namespace {

void require(bool ok) {
  if (!ok) std::abort();
}

Expected<TraceReader> reader_of(std::string text) {
  return TraceReader::from_stream(std::make_unique<std::istringstream>(std::move(text)), "fuzz");
}

bool same(const TraceField& a, const TraceField& b) {
  return a.state == b.state && a.counts == b.counts &&
         (a.state == TraceField::State::invalid || a.value == b.value);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Expected<TraceReader> reader = reader_of(std::string(reinterpret_cast<const char*>(data), size));
  if (!reader) {
    require(reader.error().sentence.find('\n') == std::string::npos);
    return 0;
  }
  std::ostringstream written;
  Expected<TraceWriter> writer = TraceWriter::to_stream(written, "copy", reader->signals());
  require(writer.has_value());
  std::vector<TraceRow> rows;
  for (TraceRow row;;) {
    const Expected<bool> more = reader->next(row);
    if (!more) require(more.error().sentence.find('\n') == std::string::npos);
    if (!more || !*more) break;
    require(writer->write(row.t_ns, row.fields).has_value());
    rows.push_back(row);
  }
  require(writer->close().has_value());

  Expected<TraceReader> again = reader_of(written.str());
  require(again.has_value() && again->signals() == reader->signals());
  TraceRow copy;
  for (const TraceRow& row : rows) {
    const Expected<bool> more = again->next(copy);
    require(more && *more && copy.t_ns == row.t_ns);
    for (std::size_t i = 0; i < row.fields.size(); ++i)
      require(same(copy.fields[i], row.fields[i]));
  }
  const Expected<bool> more = again->next(copy);
  require(more && !*more);
  return 0;
}
