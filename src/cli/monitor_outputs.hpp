// The files that `servosense monitor` writes while it watches. No disk ends a run: what cannot be
// written is said once when it happens, and at the end with what is missing.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "known_torque.hpp"
#include "servosense/io/event.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/output_file.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/monitors/machine_stack.hpp"
#include "servosense/observer/estimate_band.hpp"

namespace servosense::cli {

/// Where events go: a file, standard output ("-"), or nowhere.
class EventSink {
 public:
  Expected<Done> open(const std::optional<std::string>& path, bool live);
  /// In a live run somebody waits for it. An event that finds no room waits for the next ones.
  void write(const Event& event);
  /// What was commanded to a CNC, with the ratios to what is programmed.
  void write_command(double t_s, const char* phase, double speed_ratio, double feed_ratio,
                     bool hold, const std::string& reason);
  /// Device error when events are missing, and how many.
  Expected<Done> close();
  [[nodiscard]] const std::optional<Error>& failure() const { return failure_; }

 private:
  void write_line(const std::string& line);
  void flush();

  std::optional<OutputFile> file_;
  bool live_ = false;
  std::string waiting_;  // whole lines
  std::uint64_t lines_ = 0, lost_ = 0;
  std::optional<Error> failure_;  // the first
};

/// The estimates of every drive, then the bands about them, with the times of the source.
class EstimateSink {
 public:
  Expected<Done> open(const std::optional<std::string>& path, const MachineFile& machine,
                      const StackPlan& plan, const std::string& trace, bool live);
  /// Without the torque of a spindle where that is not known.
  void write(Nanoseconds t_ns, const MachineStack& stack, const KnownTorque& torque);
  /// Device error when rows are missing, and how many.
  Expected<Done> close() { return writer_ ? writer_->close() : Expected<Done>(Done{}); }
  [[nodiscard]] const TraceWriter* writer() const { return writer_.get(); }

 private:
  std::unique_ptr<TraceWriter> writer_;
  struct Drive {
    Channel channel = Channel::x;
    EstimateBand<double> band;
    double position = 0;  // at the sample before
  };
  std::vector<Drive> drives_;  // that are estimated, in the order of the columns
  std::vector<double> values_;
};

/// Says of each output that fails that it does, once, and that the run goes on.
class OutputWatch {
 public:
  void add(const std::optional<Error>& failure) { outputs_.push_back({&failure, false}); }
  void look();

 private:
  struct Output {
    const std::optional<Error>* failure;
    bool said;
  };
  std::vector<Output> outputs_;
};

}  // namespace servosense::cli
