// What a chatter alarm means for the machinist: the frequency at which the structure swings, and
// spindle speeds to try where the machine file knows enough to tell them.
//
// The frequency comes from the 16 revolutions that follow the alarm (0.25 s at least), when chatter
// is there to be measured: at the alarm itself entry and growth still cover it. Speeds come from
// the structure, tool and cut of the file alone, by semi-discretisation at the file's depth. From
// the frequency of one cut they cannot be told: of pockets at f / k fewer than half are stable
// (docs/chatter.md).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servosense/identify/chatter_frequency.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense::cli {

struct ChatterAdviceResult {
  std::size_t event = 0;  ///< place of the alarm among the run's events
  ChatterLine line;
  std::vector<double> speeds_rpm;  ///< stable by the file's structure, rising
  double speed_step_rpm = 0;       ///< to which they are known
  std::string reason;              ///< clause to follow the alarm's
};

/// Stable by structure, tool and cut of the file.
struct AdvisedSpeeds {
  std::vector<double> rpm;  ///< rising, one on either side at most
  double step_rpm = 0;      ///< to which they are known
  std::string clause;       ///< what to say of them, or why there are none
};

/// What was heard after the alarm.
struct ChatterStretch {
  std::size_t event = 0;
  double line_hz = 0, line_error_hz = 0;  ///< of the line that has raised the alarm; 0: the power
  std::vector<double> torque_Nm, angle_rad;
  std::vector<char> renewed;
};

class ChatterAdvice {
 public:
  ChatterAdvice(const MachineFile& machine, const StackPlan& plan);
  /// The alarm that was kept as event number `event`; ignored while another is looked into.
  void alarm(std::size_t event, const StateChange<double>& change);
  /// Every sample after, of the stack that hears the spindle. A stretch when enough has come.
  [[nodiscard]] std::optional<ChatterStretch> add(const HostStack& stack);
  /// At the end of the run: what has come.
  [[nodiscard]] std::optional<ChatterStretch> finish();
  /// Takes tens of milliseconds and more: not between two samples of a live run. May run beside
  /// the other functions.
  [[nodiscard]] ChatterAdviceResult look_into(const ChatterStretch& stretch) const;
  /// The middle of the nearest pockets on either side of `present_rpm`, from `slowest_rpm` to
  /// `fastest_rpm`. Takes as long.
  [[nodiscard]] AdvisedSpeeds advised_speeds(double present_rpm, double slowest_rpm,
                                             double fastest_rpm) const;

 private:
  const MachineFile& machine_;
  ChatterLineConfig config_;
  std::optional<ChatterStretch> stretch_;
  double turned_rad_ = 0;
  bool faint_ = false;  // what is heard now is known as a line alone
};

}  // namespace servosense::cli
