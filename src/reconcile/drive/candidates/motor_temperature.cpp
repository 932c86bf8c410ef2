#include "reconcile/drive/motor_temperature.hpp"

#include "reconcile/drive/candidates/kinds.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {

Candidate motor_temperature_candidate(const DriveSituation& s) {
  Candidate c;
  c.name = kMotorTemperature;
  c.where = "motor-temperature";
  c.splitting_motion = "hard accelerations cold, and again when the motor is 20 K warmer or more";
  if (s.data->temperature_C.empty()) {
    c.not_testable = "the trace has no temperature of the motor";
    c.would_need = std::string(name_of(s.data->channel)) + ".temperature_C, from cold to warm";
    return c;
  }
  if (s.per_kelvin.empty()) {
    c.not_testable = "the motor is between " + printed(s.lowest_C, 3) + " and " +
                     printed(s.highest_C, 3) + " degC, too much alike";
    c.would_need = c.splitting_motion;
    return c;
  }
  c.columns = [column = s.per_kelvin](std::span<const double>) {
    return std::vector<Column>{column};
  };
  c.meaning = [at_C = s.data->constant.at_C, most = s.criteria->most_loss_per_K](
                  std::span<const double>, std::span<const double> coefficients) {
    Meaning m;
    m.parameters = {{kPerKelvinKey, {coefficients[0]}}, {"torque_constant_at_C", {at_C}}};
    if (!(coefficients[0] < 0 && coefficients[0] > -most))
      m.violation = std::string(kPerKelvinKey) + " would be " + printed(coefficients[0], 3);
    return m;
  };
  return c;
}

}  // namespace servosense::reconcile
