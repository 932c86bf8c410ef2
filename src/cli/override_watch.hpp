// `servosense monitor --cnc` with [override] in the machine file: from alarms and load to spindle
// speed, feed and feed hold (monitors/override_control.hpp), and the log of what was commanded.
#pragma once

#include <array>
#include <future>
#include <optional>
#include <string>

#include "chatter_advice.hpp"
#include "monitor_outputs.hpp"
#include "servosense/monitors/machine_stack.hpp"
#include "servosense/monitors/override_control.hpp"
#include "stop_sink.hpp"

namespace servosense::cli {

class OverrideWatch {
 public:
  /// `advice` and `machine` must outlive it. `file`: where commands are written as JSON Lines.
  static Expected<std::optional<OverrideWatch>> open(const MachineFile& machine,
                                                     const StackPlan& plan,
                                                     const ChatterAdvice& advice,
                                                     const std::optional<std::string>& file,
                                                     bool live);
  void change(const StateChange<double>& change);
  /// After the changes of a sample: what is to be commanded now, to `stop`.
  void sample(double t_s, const MachineStack& stack, StopSink& stop, bool quiet);
  /// Device error when commands are missing in the file.
  Expected<Done> close() { return file_.close(); }
  /// One sentence on what it did.
  [[nodiscard]] std::string summary() const;

 private:
  OverrideWatch(const OverrideConfig& config, const StackPlan& plan, const ChatterAdvice& advice,
                bool live);
  void take_advice(double speed_rad_s);
  void tell(double t_s, bool quiet);
  [[nodiscard]] std::string reason() const;

  OverrideControl<double> control_;
  OverrideConfig config_;
  OverrideInput<double> in_;
  const ChatterAdvice* advice_;
  Channel spindle_;
  double sample_period_s_ = 0, torque_limit_Nm_ = 0;
  bool live_ = false, asked_ = false, band_ = false;
  std::array<bool, kAxes> collides_{};
  double programmed_rpm_ = 0;
  std::future<AdvisedSpeeds> speeds_;
  std::string clause_;  // about the speeds
  EventSink file_;
  // Told last.
  OverridePhase phase_ = OverridePhase::programmed;
  bool hold_ = false, overloaded_ = false;
  double speed_ = 1, feed_ = 1;
  std::uint64_t commands_ = 0, holds_ = 0, steps_ = 0;
  double least_speed_ = 1, greatest_speed_ = 1, least_feed_ = 1;
};

}  // namespace servosense::cli
