// What the residual of a drive is looked at against: is it a function of one of these?
#include <cmath>
#include <utility>

#include "reconcile/drive/workflow.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {

void DriveWorkflow::add_coordinates() {
  problem_.coordinates.clear();
  const Column& direction = signals_->kept_direction_rows(model_.friction_knee);
  const auto add = [&](const char* name, const char* unit, Column values, Column factor = {},
                       double period = 0) {
    problem_.coordinates.push_back({name, unit, std::move(values), std::move(factor), period, 24});
  };
  const char* length = data_.turns() ? "rad" : "m";
  add("velocity", data_.turns() ? "rad/s" : "m/s", signals_->velocity_rows);
  add("position", length, signals_->position_rows);
  add("position-and-direction", length, signals_->position_rows, direction);
  add("time", "s", problem_.time_s);
  add("time-and-direction", "s", problem_.time_s, direction);
  add("acceleration", data_.turns() ? "rad/s2" : "m/s2", signals_->acceleration_rows);
  if (model_.unit_per_turn > 0) {
    Column angle = signals_->position_rows;
    for (double& x : angle) x *= kTwoPi / model_.unit_per_turn;
    add("motor-angle", "rad", std::move(angle), {}, kTwoPi);
  }
  Column since(signals_->rows(), 0);
  double turned = 0;
  int sign = 0;
  for (std::size_t i = 0; i < since.size(); ++i) {
    const double v = signals_->velocity_rows[i];
    const double x = signals_->position_rows[i];
    const int now = v > 0 ? 1 : v < 0 ? -1 : sign;
    if (now != sign) turned = x;
    sign = now;
    since[i] = std::abs(x - turned);
  }
  add("travel-since-reversal", length, since, direction);
  if (motor_warms()) add("motor-temperature", "degC", temperature_rows(), problem_.target);
  Column transmitted = problem_.target;
  for (double& force : transmitted) force = std::abs(force);
  add("transmitted-force", problem_.unit.c_str(), std::move(transmitted), direction);
}

}  // namespace servosense::reconcile
