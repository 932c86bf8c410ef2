#include "servosense/io/paired_columns.hpp"

#include <algorithm>

namespace servosense {

std::vector<std::size_t> PairedColumns::columns() const {
  std::vector<std::size_t> all;
  for (const auto& column : {load, second_motion, second_effort, following})
    if (column) all.push_back(*column);
  if (command) all.push_back(command->column);
  return all;
}

std::optional<PairedColumns> paired_columns(const std::vector<Signal>& signals, Channel channel,
                                            const ColumnChoice& choice) {
  const auto drive = drive_columns(signals, channel, choice);
  // What stands for an effort, or a speed, is held against nothing.
  if (!drive || !choice.effort.empty() || drive->constant_motion != 0 ||
      drive->signal.motion == MotionKind::velocity)
    return std::nullopt;
  const auto at = [&](Channel of, Quantity quantity) -> std::optional<std::size_t> {
    const auto found = std::find(signals.begin(), signals.end(), Signal{of, quantity});
    if (found == signals.end()) return std::nullopt;
    return static_cast<std::size_t>(found - signals.begin());
  };
  const bool turns = is_turning(channel);
  PairedColumns p;
  p.channel = channel;
  p.drive = *drive;
  p.second_effort = drive->second_effort_column;
  const Quantity motion = signals[drive->motion_column].quantity;
  const Quantity load = turns ? Quantity::angle_rad : Quantity::position_m;
  if (motion != load) p.load = at(channel, load);
  if (choice.gantry) p.second_motion = at(second_motor_of(channel), motion);
  if (!is_spindle(channel)) {
    p.following = at(channel, turns ? Quantity::following_error_rad : Quantity::following_error_m);
    p.following_is_error = p.following.has_value();
    if (!p.following)
      p.following = at(channel, turns ? Quantity::command_angle_rad : Quantity::command_position_m);
  }
  using Told = std::pair<Quantity, PairedColumns::Scaled>;
  for (const auto& [quantity, scaled] :
       {Told{Quantity::command_current_A, {0, EffortKind::current_A, 1}},
        Told{Quantity::command_torque_Nm, {0, EffortKind::torque_Nm, 1}},
        Told{Quantity::command_torque_percent,
             {0, EffortKind::torque_Nm, choice.rated_torque_Nm / 100}}}) {
    const auto column = at(channel, quantity);
    // Two motors are told one thing each.
    if (p.command || !column || !(scaled.scale > 0) || *column == drive->effort_column ||
        choice.gantry)
      continue;
    p.command = scaled;
    p.command->column = *column;
  }
  if (p.columns().empty()) return std::nullopt;
  return p;
}

}  // namespace servosense
