// The monitor `reference`: compares the rows of a recorded source with a sound reference while they
// pass (identify/reference.hpp).
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "servosense/core/monitor_state.hpp"
#include "servosense/hal/row_source.hpp"
#include "servosense/identify/reference.hpp"
#include "servosense/io/event.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense::cli {

/// A window of the record and what became of it.
struct ReferenceVerdict {
  double from_s = 0, to_s = 0;
  std::optional<double> distance;  ///< nothing: not compared
};

class ReferenceWatch {
 public:
  /// Reads the reference that the machine file names. Data or device error when it is none.
  static Expected<std::unique_ptr<ReferenceWatch>> open(const MachineFile& machine);

  /// Rows that pass through are heard.
  std::unique_ptr<RowSource> tap(std::unique_ptr<RowSource> rows);

  /// What it watches, or why it does not; remarks go to the plan. To be called when the rate of the
  /// source is known.
  void plan(double sample_period_s, bool live, StackPlan& plan);

  /// Changes of state that the rows until now have brought, told at `t_s`.
  struct Change {
    StateChange<double> change;
    Event event;
  };
  [[nodiscard]] std::vector<Change> changes(double t_s);
  /// The same at the end of the record.
  [[nodiscard]] std::vector<Change> finish(double t_s);

  /// What it would have found, and how many windows were left out for which reason.
  void tell(StackPlan& plan) const;

  [[nodiscard]] bool runs() const { return runs_; }
  [[nodiscard]] double threshold() const { return distance_ ? distance_->threshold() : 0; }
  [[nodiscard]] const std::vector<ReferenceVerdict>& verdicts() const { return verdicts_; }

 private:
  class Tap;
  explicit ReferenceWatch(const MachineFile& machine) : machine_(machine) {}
  void begin(const std::vector<Signal>& signals);
  void hear(const TraceRow& row);
  void judge(const std::vector<ReferenceWindow>& windows);
  [[nodiscard]] std::string why_not(double sample_period_s, bool live);
  [[nodiscard]] std::string reason(std::size_t window) const;

  MachineFile machine_;
  std::string path_;
  std::optional<Reference> reference_;
  std::optional<ReferenceDistance> distance_;
  std::optional<ReferenceCutter> cutter_;
  std::vector<ReferenceFeature> features_;
  std::vector<Signal> columns_;
  std::string begin_failed_;
  bool runs_ = false;
  ThreeInARow three_;
  std::vector<std::size_t> waiting_;  ///< windows for a third
  std::size_t settled_ = 0;           ///< windows that are known for good
  std::size_t told_ = 0;
  std::vector<ReferenceVerdict> verdicts_;
  std::vector<std::optional<Compared>> compared_;
  MonitorState state_ = MonitorState::idle;
  std::array<std::size_t, 8> left_out_{};
};

}  // namespace servosense::cli
