#include "monitor_source.hpp"

#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>

#include "servosense/hal/can_socket_rows.hpp"
#include "servosense/hal/candump_rows.hpp"
#include "servosense/hal/modbus_rows.hpp"
#include "servosense/hal/recording_rows.hpp"
#include "servosense/hal/wrapped_rows.hpp"

namespace servosense::cli {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

/// Gives a recording's rows at its own pace, or so many times as fast.
class PacedRows final : public WrappedRows {
 public:
  PacedRows(std::unique_ptr<RowSource> rows, double factor, const std::atomic<bool>& stop)
      : WrappedRows(std::move(rows)), factor_(factor), stop_(stop) {}
  Expected<bool> next(TraceRow& row) override {
    auto more = rows_->next(row);
    if (!more || !*more) return more;
    if (!started_) {
      started_ = true;
      first_ns_ = row.t_ns;
      begin_ = Clock::now();
    }
    const double due_s = seconds_from(saturated_difference(row.t_ns, first_ns_)) / factor_;
    const auto left_s = [&] { return due_s - seconds_since(begin_); };
    // In pieces: a pace may ask for more seconds than a clock can count.
    for (double left = left_s(); left > 0 && !stop_; left = left_s())
      std::this_thread::sleep_for(std::chrono::duration<double>(std::min(left, 0.1)));
    return !stop_;
  }

 private:
  double factor_;
  const std::atomic<bool>& stop_;
  bool started_ = false;
  Nanoseconds first_ns_ = 0;
  Clock::time_point begin_;
};

struct OpenRows {
  std::unique_ptr<RowSource> rows;
  std::string name;
  bool live = false;
};

constexpr const char* kSources[] = {"--trace", "--candump", "--can", "--modbus"};

Expected<OpenRows> open_rows(const Arguments& arguments, const std::atomic<bool>& stop) {
  OpenRows open;
  for (const char* option : kSources)
    if (const auto value = arguments.value(option)) open.name = *value;
  if (const auto path = arguments.value("--candump")) {
    auto map = CanMap::read(arguments.at("--map"));
    if (!map) return map.error();
    auto reader = CandumpReader::open(*path);
    if (!reader) return reader.error();
    open.rows = std::make_unique<CandumpRows>(std::move(*reader), std::move(*map));
  } else if (const auto interface = arguments.value("--can")) {
    auto map = CanMap::read(arguments.at("--map"));
    if (!map) return map.error();
    auto socket = CanSocket::open(*interface, CanSocketRows::wanted(*map));
    if (!socket) return socket.error();
    open.rows = std::make_unique<CanSocketRows>(std::move(*socket), std::move(*map), stop);
    open.live = true;
  } else if (const auto url = arguments.value("--modbus")) {
    auto map = ModbusMap::read(arguments.at("--map"));
    if (!map) return map.error();
    auto rows = ModbusRows::open(*url, std::move(*map), stop);
    if (!rows) return rows.error();
    open.rows = std::move(*rows);
    open.live = true;
  } else {
    auto reader = TraceReader::open(open.name);
    if (!reader) return reader.error();
    open.rows = trace_rows(std::move(*reader));
  }
  return open;
}

}  // namespace

std::vector<Option> source_options() {
  return {
      {"--trace", "FILE", "recorded trace", false, FileUse::input},
      {"--candump", "FILE", "log of 'candump -L'", false, FileUse::input},
      {"--can", "INTERFACE", "CAN interface, such as can0", false},
      {"--modbus", "URL", "tcp://HOST:502/UNIT or rtu:DEVICE?baud=115200&parity=N&unit=1", false},
      {"--map", "FILE", "where the signals are on the bus", false, FileUse::input},
      {"--duration", "S", "end a live run after so many seconds", false},
      {"--pace", "X", "replay X times as fast as recorded; without it as fast as can be", false},
      {"--record", "FILE", "write what was received as a trace", false, FileUse::output}};
}

Expected<Done> check_source(const Arguments& arguments) {
  int sources = 0;
  for (const char* option : kSources) sources += arguments.has(option) ? 1 : 0;
  if (sources != 1)
    return usage_error(
        "say where the samples come from with one of --trace FILE, --candump FILE, --can INTERFACE "
        "and --modbus URL");
  const bool live = arguments.has("--can") || arguments.has("--modbus");
  if (!arguments.has("--trace") && !arguments.has("--map"))
    return usage_error(
        "a bus needs a map of its signals; add --map FILE (docs/can.md, docs/modbus.md)");
  if (arguments.has("--trace") && arguments.has("--map"))
    return usage_error("--map belongs to a bus; a trace names its signals itself");
  if (live && arguments.has("--pace"))
    return usage_error("--pace belongs to a replay; a live source has its own pace");
  for (const char* option : {"--duration", "--realtime"})
    if (!live && arguments.has(option))
      return usage_error(std::string(option) + " belongs to a live source");
  return Done{};
}

Expected<MonitorSource> open_source(const Arguments& arguments, const MachineFile& machine,
                                    const std::atomic<bool>& stop, ReferenceWatch& watch,
                                    PairWatches& pairs, SensorWatches& sensors) {
  const auto pace = arguments.within("--pace", 1e-3, 1e6);
  if (!pace) return pace.error();
  auto open = open_rows(arguments, stop);
  if (!open) return open.error();
  if (*pace) open->rows = std::make_unique<PacedRows>(std::move(open->rows), **pace, stop);
  std::shared_ptr<TraceWriter> record;
  if (const auto path = arguments.value("--record")) {
    auto writer =
        TraceWriter::create(*path, open->rows->signals(), {{"recorded_from", open->name}},
                            open->live ? OutputFile::Kind::growing : OutputFile::Kind::whole);
    if (!writer) return writer.error();
    record = std::make_shared<TraceWriter>(std::move(*writer));
    open->rows = std::make_unique<RecordingRows>(std::move(open->rows), record);
  }
  if (!open->live) open->rows = watch.tap(std::move(open->rows));
  auto efforts = std::make_shared<EffortPairs>(machine, open->rows->signals(), true);
  auto paired = pairs.tap(EffortPairs::tap(std::move(open->rows), efforts));
  if (!paired) return paired.error();
  auto samples = SampleSource::open(sensors.tap(std::move(*paired)), open->name,
                                    SampleSource::kMaxFill, column_choices(machine));
  if (!samples) return samples.error();
  return MonitorSource{std::move(*samples), open->name, open->live, std::move(record),
                       std::move(efforts)};
}

}  // namespace servosense::cli
