// The sensors that hear chatter beside the drives, through a run of `servosense monitor`, and what
// an idling run tells of them.
#pragma once

#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "servosense/hal/row_source.hpp"
#include "servosense/identify/sensor_idle.hpp"
#include "servosense/io/event.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/idle_statistics.hpp"
#include "servosense/monitors/machine_stack.hpp"
#include "servosense/monitors/vibration_plan.hpp"

namespace servosense::cli {

class SensorWatches {
 public:
  explicit SensorWatches(const MachineFile& machine) : machine_(machine) {}

  /// Rows that pass through are heard.
  std::unique_ptr<RowSource> tap(std::unique_ptr<RowSource> rows);
  [[nodiscard]] std::vector<std::size_t> columns() const;
  /// What runs goes to the plan, behind all others.
  Expected<Done> plan(double sample_period_s, StackPlan& plan);

  struct Change {
    StateChange<double> change;
    Event event;
  };
  /// After the stack has heard the sample of this time; not `recorded`: it fills a hole.
  [[nodiscard]] std::vector<Change> sample(Nanoseconds t_ns, bool recorded,
                                           const MachineStack& stack);
  /// What there was too little of, once the record is over.
  void tell(StackPlan& plan) const;

 private:
  struct Reading {
    Nanoseconds t_ns = 0;
    TraceField field;
  };
  struct Sensor {
    Channel channel = Channel::accelerometer;
    std::size_t column = 0;
    std::deque<Reading> waiting;
    std::unique_ptr<HostSensorChatter> ear;  // where it runs
    double per_unit = 1, last = 0;
    std::size_t samples = 0, missing = 0;
  };

  MachineFile machine_;
  std::vector<Signal> signals_;
  std::vector<Sensor> sensors_;
};

/// What an idling run told of a sensor.
struct SensorFound {
  Channel channel = Channel::accelerometer;
  SensorIdle idle;
  IdleStatistics power;  ///< beyond the revolution, in the square of its unit
};
/// Reads the trace once more. A sensor that nothing can be learned of is a remark.
Expected<std::vector<SensorFound>> learn_sensors(const MachineFile& machine, const StackPlan& plan,
                                                 const std::string& trace, double sample_period_s,
                                                 std::vector<std::string>& remarks);
/// [monitor.chatter.accelerometer]
void write_sensor(MachineFile& machine, const SensorFound& found, double sample_period_s,
                  double false_alarms_per_hour, std::vector<std::string>& remarks);
void print_sensor(const SensorFound& found);
/// Member `sensors`.
void write_sensors_json(JsonWriter& json, const std::vector<SensorFound>& found);

}  // namespace servosense::cli
