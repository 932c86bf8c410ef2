#include "hammer_records.hpp"

#include <utility>

#include "common_rows.hpp"
#include "servosense/io/drive_columns.hpp"

namespace servosense::cli {
namespace {

constexpr Signal kHammer{Channel::hammer, Quantity::force_N};

Expected<std::size_t> response_column(const ResponseWanted& wanted, const std::string& path,
                                      const Trace& trace) {
  std::vector<std::size_t> found;
  std::string names;
  for (std::size_t i = 0; i < trace.signals.size(); ++i) {
    const std::string name = column_name(trace.signals[i]);
    if (!wanted.is(trace.signals[i]) || (wanted.name && name != *wanted.name)) continue;
    found.push_back(i);
    names += (names.empty() ? "" : ", ") + name;
  }
  if (found.size() == 1) return found.front();
  if (found.size() > 1)
    return usage_error(path + ": there are several responses, " + names +
                       "; say which with --response");
  return data_error(path + ": there is no column " +
                    (wanted.name ? *wanted.name + " " + wanted.what : "of a response") +
                    "; record " + wanted.record + " beside hammer.force_N");
}

}  // namespace

Expected<HammerRecords> read_hammer_records(const Arguments& arguments,
                                            const ResponseWanted& wanted, Progress& progress) {
  HammerRecords all;
  for (const std::string& path : arguments.operands()) {
    auto trace = read_trace(path);
    if (!trace) return trace.error();
    const auto hammer = column_named(trace->signals, column_name(kHammer));
    if (!hammer)
      return data_error(path + ": there is no column hammer.force_N; record the hammer's force");
    auto response = response_column(wanted, path, *trace);
    if (!response) return response.error();
    const Signal signal = trace->signals[*response];
    if (!all.records.empty() && !(signal == all.response))
      return data_error(path + ": its response is " + column_name(signal) + ", that of " +
                        all.records.front().name + " is " + column_name(all.response) +
                        "; give traces of one response");
    all.response = signal;
    auto rows = common_rows(path, *trace, {&*trace, *hammer}, {&*trace, *response}, NoNumber::keep);
    if (!rows) return rows.error();
    all.records.push_back({path, rows->sample_rate_hz, rows->begin_s, std::move(rows->first),
                           std::move(rows->second)});
    progress.show(static_cast<double>(all.records.size()) /
                  static_cast<double>(arguments.operands().size()));
  }
  return all;
}

}  // namespace servosense::cli
