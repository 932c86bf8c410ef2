// Samples of a source, with a sign where a drive reports its effort as an absolute value.
//
// [spindle] or [axis.x] current_is_unsigned = yes says that it does; the sign comes from the motion
// (identify/effort_sign.hpp). Where nothing is said, a current that never turns negative though the
// drive must have braked or turned round is told of.
#pragma once

#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "servosense/hal/sample_source.hpp"
#include "servosense/identify/effort_sign.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense::cli {

class SignedSamples {
 public:
  /// `source` must outlive the use of this.
  SignedSamples(SampleSource& source, const MachineFile& machine, const StackPlan& plan);

  /// As the source's, two reaches of EffortSign later where a sign is sought.
  Expected<bool> next(MachineServoSample& sample);
  [[nodiscard]] bool recorded() const { return recorded_; }
  /// What was found out, after the last sample.
  [[nodiscard]] std::vector<std::string> remarks() const;

 private:
  struct Drive {
    Channel channel = Channel::spindle;
    bool resolved = false;  // else it is watched only
    DriveInput<double> input;
    EffortSign sign;
    double effort_per_unit = 1;
    double negative_s = 0;  // for which a signed effort would have been negative
    double greatest = 0;    // effort so far
    std::deque<double> magnitudes;
    // Of a power, whose losses are known with its sign.
    std::optional<PowerReading> power;
    DriveSpeed speed;
    std::deque<double> speeds;
  };
  struct Waiting {
    MachineServoSample sample;
    bool recorded = true;
  };
  void hear(const MachineServoSample& sample);
  void answer(Drive& drive);
  [[nodiscard]] bool resolves() const;

  SampleSource* source_;
  double period_s_;
  std::vector<Drive> drives_;
  std::deque<Waiting> waiting_;
  std::vector<std::size_t> answered_;  // samples of waiting_ that have their sign, by drive
  bool ended_ = false;
  bool recorded_ = true;
};

}  // namespace servosense::cli
