#include "servosense/io/drive_columns.hpp"

#include <algorithm>
#include <utility>

#include "servosense/core/units.hpp"

namespace servosense {
namespace {

std::optional<std::size_t> column_of(const std::vector<Signal>& signals, Channel channel,
                                     Quantity quantity) {
  const auto at = std::find(signals.begin(), signals.end(), Signal{channel, quantity});
  if (at == signals.end()) return std::nullopt;
  return static_cast<std::size_t>(at - signals.begin());
}

}  // namespace

std::optional<std::size_t> column_named(const std::vector<Signal>& signals,
                                        const std::string& name) {
  for (std::size_t i = 0; i < signals.size(); ++i)
    if (column_name(signals[i]) == name) return i;
  return std::nullopt;
}

ColumnChoices column_choices(const MachineFile& machine) {
  ColumnChoices choices;
  const auto effort = [&](const std::string& section) {
    return machine.text(section, "effort_column").value_or("");
  };
  choices.spindle.effort = effort("spindle");
  choices.spindle.constant_motion =
      rad_s_from_rpm(machine.number("spindle", "constant_speed_rpm").value_or(0));
  for (std::size_t i = 0; i < kAxes; ++i)
    choices.axis[i].effort = effort("axis." + std::string(name_of(axis_channel(i))));
  return choices;
}

std::optional<MotionColumn> motion_column(const std::vector<Signal>& signals, Channel channel) {
  const bool turns = channel == Channel::spindle;
  const std::array<std::pair<Quantity, MotionKind>, 3> motions = {
      {{Quantity::angle_counts, MotionKind::counts},
       {turns ? Quantity::angle_rad : Quantity::position_m, MotionKind::position},
       {turns ? Quantity::speed_rad_s : Quantity::velocity_m_s, MotionKind::velocity}}};
  for (const auto& [quantity, kind] : motions)
    if (const auto column = column_of(signals, channel, quantity))
      return MotionColumn{*column, kind};
  return std::nullopt;
}

std::optional<DriveColumns> drive_columns(const std::vector<Signal>& signals, Channel channel,
                                          const ColumnChoice& choice) {
  const bool turns = channel == Channel::spindle;
  const std::array<std::pair<Quantity, EffortKind>, 3> efforts = {
      {{Quantity::current_A, EffortKind::current_A},
       {Quantity::torque_Nm, EffortKind::torque_Nm},
       {Quantity::force_N, EffortKind::force_N}}};
  DriveColumns columns;
  if (const auto motion = motion_column(signals, channel)) {
    columns.motion_column = motion->column;
    columns.signal.motion = motion->kind;
  } else {
    if (choice.constant_motion == 0) return std::nullopt;
    columns.signal.motion = MotionKind::velocity;
    columns.constant_motion = choice.constant_motion;
  }
  if (!choice.effort.empty()) {
    const auto column = column_named(signals, choice.effort);
    if (!column) return std::nullopt;
    columns.effort_column = *column;
    // Whatever is measured stands for the torque of a spindle, the force of an axis.
    columns.signal.effort = turns ? EffortKind::torque_Nm : EffortKind::force_N;
    for (const auto& [quantity, kind] : efforts)
      if (signals[*column].quantity == quantity && !(turns && kind == EffortKind::force_N))
        columns.signal.effort = kind;
    return columns;
  }
  for (const auto& [quantity, effort] : efforts) {
    if (turns && effort == EffortKind::force_N) continue;
    if (const auto column = column_of(signals, channel, quantity)) {
      columns.signal.effort = effort;
      columns.effort_column = *column;
      return columns;
    }
  }
  return std::nullopt;
}

}  // namespace servosense
