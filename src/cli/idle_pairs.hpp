// What `servosense identify idle` learns of signals that come in pairs: kept while the rows pass,
// written to the machine file, printed.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "pair_rows.hpp"
#include "servosense/identify/learn_pairs.hpp"
#include "servosense/io/json.hpp"

namespace servosense::cli {

class PairRecorder {
 public:
  std::unique_ptr<RowSource> tap(std::unique_ptr<RowSource> rows, const MachineFile& machine);
  [[nodiscard]] std::vector<std::size_t> columns() const { return columns_of(readers_); }
  /// nullptr where no signal of the drive comes in a pair.
  [[nodiscard]] const PairRecord* of(Channel channel) const;

 private:
  std::vector<PairReader> readers_;
  std::vector<PairRecord> records_;
};

/// Backlash as an effect of the drive's model; nothing where none was found, or where the machine
/// file has one of another source.
[[nodiscard]] std::optional<EffectSetting> backlash_found(const MachineFile& machine,
                                                          Channel channel,
                                                          const LearnedPairs& pairs);

/// [monitor.signal.x], and the effects backlash and flexible-coupling. `monitors_read_less` with
/// backlash in their model; `inertia` of the drive [kg or kg m2].
void write_pairs(MachineFile& machine, Channel channel, const LearnedPairs& pairs,
                 bool monitors_read_less, double inertia, double sample_rate_hz,
                 std::vector<std::string>& remarks);

void print_pairs(Channel channel, const LearnedPairs& pairs);
/// Members of the drive's object.
void write_pairs_json(JsonWriter& json, Channel channel, const LearnedPairs& pairs);

}  // namespace servosense::cli
