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

/// What a quantity can be to a drive.
enum class Use { none, motion, effort, stand_in };

Use use_of(Quantity quantity) {
  switch (quantity) {
    case Quantity::angle_rad:
    case Quantity::angle_counts:
    case Quantity::speed_rad_s:
    case Quantity::position_m:
    case Quantity::velocity_m_s:
      return Use::motion;
    case Quantity::current_A:
    case Quantity::torque_Nm:
    case Quantity::force_N:
      return Use::effort;
    case Quantity::power_W:
    case Quantity::load_V:
    case Quantity::load_percent:
    case Quantity::torque_percent:
    case Quantity::current_percent:
    case Quantity::command_current_A:
    case Quantity::command_torque_Nm:
    case Quantity::command_torque_percent:
      return Use::stand_in;
    default:
      return Use::none;
  }
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
  const auto number = [&](const std::string& section, const char* key) {
    return machine.number(section, key).value_or(0);
  };
  choices.machine = machine.name();
  choices.sample_rate_hz = number("machine", "sample_rate_hz");
  for (const Channel channel : kDriveChannels) {
    const std::string section(section_of(channel));
    ColumnChoice& choice = choices.drive(channel);
    choice.effort = effort(section);
    const double gear = machine.number(section, "gear_ratio").value_or(1);
    double turn = kTwoPi / gear;  // of the motor, in rad or m of the drive
    if (is_turning(channel)) {
      choice.max_speed = rad_s_from_rpm(number(section, "max_speed_rpm"));
      choice.constant_motion = rad_s_from_rpm(number(section, "constant_speed_rpm"));
    } else {
      choice.gantry = machine.flag(section, "gantry").value_or(false);
      turn = choice.lead_m = number(section, "lead_m") / gear;
      choice.max_speed = number(section, "max_velocity_m_s");
    }
    const double counts = number(section, "encoder_counts_per_rev");
    choice.unit_per_count = counts > 0 ? turn / counts : 0;
    choice.counter_bits =
        static_cast<unsigned>(machine.number(section, "counter_bits").value_or(32));
    choice.max_current_A = number("controller." + std::string(name_of(channel)), "current_limit_A");
    choice.rated_torque_Nm = number(section, "rated_torque_Nm");
    choice.rated_current_A = number(section, "rated_current_A");
    choice.rated_power_W = number(section, "rated_power_W");
    choice.load_meter_V_per_W = number(section, "load_meter_V_per_W");
    const std::string load_of = machine.text(section, "load_percent_of").value_or("");
    choice.load_of = load_of == "power"    ? LoadOf::power
                     : load_of == "torque" ? LoadOf::torque
                     : load_of == "rating" ? LoadOf::rating
                                           : LoadOf::unknown;
    if (const double rpm = number(section, "power_known_from_rpm"); rpm > 0)
      choice.power.known_from_rad_s = rad_s_from_rpm(rpm);
    choice.power.losses = {number(section, "power_loss_W"),
                           number(section, "copper_loss_W_per_Nm2")};
    choice.power.is_unsigned = machine.flag(section, "current_is_unsigned").value_or(false);
    choice.constant = {number(section, "torque_constant_per_K"),
                       machine.number(section, "torque_constant_at_C").value_or(20)};
    choice.effort_is_ratio = machine.flag(section, "current_is_ratio").value_or(false);
  }
  return choices;
}

std::optional<MotionColumn> motion_column(const std::vector<Signal>& signals, Channel channel,
                                          double lead_m) {
  struct Motion {
    Quantity quantity;
    MotionKind kind;
    double scale;  // 0: cannot be used
  };
  const bool turns = is_turning(channel);
  const double motor = turns ? 1 : lead_m > 0 ? m_per_rad(lead_m) : 0;
  const double stage = turns ? 0 : 1;
  for (const Motion& motion : {Motion{Quantity::angle_counts, MotionKind::counts, 1},
                               Motion{Quantity::angle_rad, MotionKind::position, motor},
                               Motion{Quantity::position_m, MotionKind::position, stage},
                               Motion{Quantity::velocity_m_s, MotionKind::velocity, stage},
                               Motion{Quantity::speed_rad_s, MotionKind::velocity, motor}})
    if (motion.scale > 0)
      if (const auto column = column_of(signals, channel, motion.quantity))
        return MotionColumn{*column, motion.kind, motion.scale};
  return std::nullopt;
}

namespace {

struct Effort {
  Quantity quantity;
  EffortKind kind;
  double scale;  // 0: not known
};

/// What a spindle without torque and current has.
std::optional<DriveColumns> columns_of_load(const std::vector<Signal>& signals, Channel channel,
                                            const ColumnChoice& choice, DriveColumns columns) {
  const bool of_power = choice.load_of == LoadOf::power;
  const bool of_rating = choice.load_of == LoadOf::rating && choice.rated_power_W > 0;
  const bool of_torque = choice.load_of == LoadOf::torque || of_rating;
  const double share = of_power    ? choice.rated_power_W / 100
                       : of_torque ? choice.rated_torque_Nm / 100
                                   : 0;
  const double volts = choice.load_meter_V_per_W > 0 ? 1 / choice.load_meter_V_per_W : 0;
  columns.signal.effort = EffortKind::torque_Nm;
  for (const auto& [quantity, scale] :
       {std::pair{Quantity::power_W, 1.0}, std::pair{Quantity::load_V, volts},
        std::pair{Quantity::load_percent, share}}) {
    const auto column = column_of(signals, channel, quantity);
    if (!column || !(scale > 0)) continue;
    columns.effort_column = *column;
    columns.effort_scale = scale;
    if (quantity != Quantity::load_percent || of_power)
      columns.power = choice.power;
    else if (of_rating)
      columns.rated_to_rad_s = choice.rated_power_W / choice.rated_torque_Nm;
    return columns;
  }
  return std::nullopt;
}

/// What makes a load the effort of a spindle; empty where it cannot be one.
std::string load_wants(Channel channel, const std::string& column, const ColumnChoice& choice) {
  if (!is_spindle(channel)) return {};
  if (column.ends_with(".load_V")) return "is volts of a load meter; write load_meter_V_per_W";
  if (!column.ends_with(".load_percent")) return {};
  switch (choice.load_of) {
    case LoadOf::unknown:
      return "may be of the rated power or of the rated torque; write load_percent_of = power "
             "(with "
             "rated_power_W), torque (with rated_torque_Nm) or rating (with both: of the torque "
             "rated at each speed)";
    case LoadOf::power:
      return "is a share of the rated power; write rated_power_W";
    case LoadOf::torque:
      return "is a share of the rated torque; write rated_torque_Nm";
    case LoadOf::rating:
      return "is a share of the rating; write rated_torque_Nm and rated_power_W";
  }
  return {};
}

std::optional<DriveColumns> columns_of_first(const std::vector<Signal>& signals, Channel channel,
                                             const ColumnChoice& choice) {
  const bool turns = is_turning(channel);
  const std::array<Effort, 8> efforts = {
      {{Quantity::current_A, EffortKind::current_A, 1},
       {Quantity::torque_Nm, EffortKind::torque_Nm, 1},
       {Quantity::force_N, EffortKind::force_N, turns ? 0.0 : 1.0},
       {Quantity::torque_percent, EffortKind::torque_Nm, choice.rated_torque_Nm / 100},
       {Quantity::current_percent, EffortKind::current_A, choice.rated_current_A / 100},
       {Quantity::command_current_A, EffortKind::current_A, 1},
       {Quantity::command_torque_Nm, EffortKind::torque_Nm, 1},
       {Quantity::command_torque_percent, EffortKind::torque_Nm, choice.rated_torque_Nm / 100}}};
  DriveColumns columns;
  if (const auto motion = motion_column(signals, channel, choice.lead_m)) {
    columns.motion_column = motion->column;
    columns.signal.motion = motion->kind;
    columns.motion_scale = motion->scale;
    columns.is_angle = signals[motion->column].quantity == Quantity::angle_rad;
  } else {
    if (choice.constant_motion == 0) return std::nullopt;
    columns.signal.motion = MotionKind::velocity;
    columns.constant_motion = choice.constant_motion;
  }
  if (!choice.effort.empty()) {
    const auto column = column_named(signals, choice.effort);
    if (!column) return std::nullopt;
    columns.effort_column = *column;
    // Whatever is measured stands for the torque of what turns, the force of what does not.
    columns.signal.effort = turns ? EffortKind::torque_Nm : EffortKind::force_N;
    for (const Effort& effort : efforts)
      if (signals[*column].quantity == effort.quantity && effort.scale > 0) {
        columns.signal.effort = effort.kind;
        columns.effort_scale = effort.scale;
      }
    return columns;
  }
  for (const Effort& effort : efforts) {
    if (!(effort.scale > 0)) continue;
    if (const auto column = column_of(signals, channel, effort.quantity)) {
      columns.signal.effort = effort.kind;
      columns.effort_scale = effort.scale;
      columns.effort_column = *column;
      return columns;
    }
  }
  return is_spindle(channel) ? columns_of_load(signals, channel, choice, columns) : std::nullopt;
}

}  // namespace

std::optional<DriveColumns> drive_columns(const std::vector<Signal>& signals, Channel channel,
                                          const ColumnChoice& choice) {
  auto columns = columns_of_first(signals, channel, choice);
  if (columns && columns->signal.effort == EffortKind::current_A)
    columns->temperature_column = column_of(signals, channel, Quantity::temperature_C);
  if (!columns || !choice.gantry || !choice.effort.empty()) return columns;
  columns->second_effort_column =
      column_of(signals, second_motor_of(channel), signals[columns->effort_column].quantity);
  return columns->second_effort_column ? columns : std::nullopt;
}

std::string commanded_effort(const std::vector<Signal>& signals, Channel channel,
                             const DriveColumns& columns) {
  const Signal effort = signals[columns.effort_column];
  if (effort.quantity != Quantity::command_current_A &&
      effort.quantity != Quantity::command_torque_Nm &&
      effort.quantity != Quantity::command_torque_percent)
    return {};
  return std::string(name_of(channel)) + ": " + column_name(effort) +
         " stands for its effort: what the drive was told to give, and gives a current loop later "
         "as far as it can";
}

std::string no_temperature(Channel channel, const DriveColumns& columns,
                           const ConstantOverTemperature& constant) {
  if (constant.per_K == 0 || columns.temperature_column) return {};
  const std::string key =
      std::string(name_of(channel)) + ": torque_constant_per_K of the machine file is not used: ";
  if (columns.signal.effort != EffortKind::current_A)
    return key + "the trace reports no current of this drive";
  return key + "the trace has no column " + column_name(Signal{channel, Quantity::temperature_C}) +
         "; torque per ampere is taken as stated";
}

std::vector<std::string> unused_columns(const std::vector<Signal>& signals,
                                        const std::vector<std::size_t>& used,
                                        const ColumnChoices& choices) {
  std::vector<std::string> said;
  std::string others;
  const auto is_used = [&](std::size_t i) {
    return std::find(used.begin(), used.end(), i) != used.end();
  };
  const auto drive = [&](Channel channel, const ColumnChoice& choice) {
    std::string motion, effort, stand_in;
    for (std::size_t i = 0; i < signals.size(); ++i) {
      if (signals[i].channel != channel) continue;
      if (is_used(i)) return;  // it is watched
      const Use use = use_of(signals[i].quantity);
      const std::string name = column_name(signals[i]);
      if (use == Use::motion) motion += (motion.empty() ? "" : ", ") + name;
      if (use == Use::effort) effort += (effort.empty() ? "" : ", ") + name;
      if (use == Use::stand_in && stand_in.empty()) stand_in = name;
    }
    if (motion.empty() && effort.empty() && stand_in.empty()) return;
    const std::string section = "[" + std::string(section_of(channel)) + "]";
    const std::string what = std::string(name_of(channel)) + " is not watched: ";
    const bool moves = motion_column(signals, channel, choice.lead_m).has_value();
    if (const auto first = columns_of_first(signals, channel, choice); first && choice.gantry) {
      const Signal second{second_motor_of(channel), signals[first->effort_column].quantity};
      said.push_back(what + "two motors move it, and " + column_name(second) + " is not there");
      return;
    }
    const char* rated = stand_in.ends_with("torque_percent")     ? "rated_torque_Nm"
                        : stand_in.ends_with(".current_percent") ? "rated_current_A"
                                                                 : nullptr;
    const std::string load = load_wants(channel, stand_in, choice);
    if (moves && !load.empty())
      said.push_back(what + stand_in + " " + load + " in " + section + "; or effort_column = " +
                     stand_in + " in " + section + " takes its numbers as they are");
    else if (moves && rated != nullptr)
      said.push_back(what + stand_in + " is a share of a rated value; write " + rated + " in " +
                     section);
    else if (moves && !stand_in.empty())
      said.push_back(what + "it has no current, torque or force; effort_column = " + stand_in +
                     " in " + section + " makes that column stand for it");
    else if (moves)
      said.push_back(what + "it has " + motion + " but no current, torque or force");
    else if (!motion.empty() && !is_turning(channel))
      said.push_back(what + motion + " needs lead_m in " + section + " to be travel");
    else
      said.push_back(what + "it has " + (effort.empty() ? stand_in : effort) + " but no motion");
  };
  for (const Channel channel : kDriveChannels) drive(channel, choices.drive(channel));
  for (std::size_t i = 0; i < signals.size(); ++i)
    if (!is_used(i)) others += (others.empty() ? "" : ", ") + column_name(signals[i]);
  if (!others.empty()) said.push_back("columns not used by this command: " + others);
  return said;
}

}  // namespace servosense
