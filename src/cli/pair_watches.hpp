// The watch of all signals that come in pairs, through a run of `servosense monitor`.
#pragma once

#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "pair_rows.hpp"
#include "servosense/hal/row_source.hpp"
#include "servosense/io/event.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/machine_stack.hpp"
#include "servosense/monitors/pair_config.hpp"

namespace servosense::cli {

class PairWatches {
 public:
  explicit PairWatches(const MachineFile& machine) : machine_(machine) {}

  /// Rows that pass through are heard. Data error for keys that cannot be.
  Expected<std::unique_ptr<RowSource>> tap(std::unique_ptr<RowSource> rows);
  [[nodiscard]] std::vector<std::size_t> columns() const { return columns_of(readers_); }

  /// Where the tool cuts, as the stack knows it of its last sample.
  void hear(const MachineStack& stack, const StackPlan& plan);
  /// What the rows until `t_s` have brought.
  [[nodiscard]] std::vector<Event> events(double t_s);

  struct Pair {
    Channel channel = Channel::x;
    PlannedPair plan;
    PairWatch watch;
    std::size_t reader = 0;
    MonitorId raised = MonitorId::signal;
  };
  [[nodiscard]] const std::vector<Pair>& pairs() const { return pairs_; }

 private:
  void heard(std::size_t reader);

  MachineFile machine_;
  std::vector<PairReader> readers_;
  std::vector<Pair> pairs_;
  std::deque<Event> waiting_;
  bool seen_cut_ = false;  // there is a spindle that tells a cut from air
  bool air_ = false;
  std::vector<double> fastest_feed_;  // of each reader: faster is a rapid; 0: not known
};

}  // namespace servosense::cli
