#include "spindle_angle.hpp"

#include "servosense/io/drive_columns.hpp"
#include "servosense/io/travel.hpp"
#include "servosense/observer/machine_config.hpp"

namespace servosense::cli {
namespace {

/// Values known at rows, by straight lines between them; at the ends the nearest line goes on.
std::vector<double> at_every_row(const std::vector<double>& times,
                                 const std::vector<double>& known_s,
                                 const std::vector<double>& known) {
  std::vector<double> values;
  std::size_t i = 0;
  for (const double t : times) {
    while (i + 2 < known.size() && known_s[i + 1] <= t) ++i;
    const double slope = (known[i + 1] - known[i]) / (known_s[i + 1] - known_s[i]);
    values.push_back(known[i] + slope * (t - known_s[i]));
  }
  return values;
}

}  // namespace

Expected<SpindleAngle> spindle_angle(const std::vector<Signal>& signals,
                                     const std::vector<TraceRow>& rows, const MachineFile& machine,
                                     const std::string& path) {
  const Channel spindle = tool_spindle(machine);
  const ColumnChoice choice = column_choices(machine).drive(spindle);
  std::vector<double> times;
  for (const TraceRow& row : rows) times.push_back(seconds_from(row.t_ns - rows.front().t_ns));
  SpindleAngle out;
  const auto motion = motion_column(signals, spindle);
  if (!motion) {
    const auto rpm = machine.number("cut", "spindle_speed_rpm");
    if (!rpm)
      return data_error(path + ": no column tells the motion of the spindle; record " +
                        std::string(name_of(spindle)) +
                        ".angle_rad, or give [cut] spindle_speed_rpm");
    for (const double t : times) out.angle_rad.push_back(rad_s_from_rpm(*rpm) * t);
    out.remark = path + ": the speed of the spindle is that of [cut]; " +
                 "half a per cent off spoils what is near a mode, so record its angle";
    return out;
  }
  double scale = motion->scale;
  if (motion->kind == MotionKind::counts) {
    if (!(choice.unit_per_count > 0)) {
      auto counts = machine.required_number(name_of(spindle), "encoder_counts_per_rev");
      if (!counts) return counts.error();
    }
    scale = choice.unit_per_count;
  }
  const bool speed = motion->kind == MotionKind::velocity;
  Travel travel(motion->kind == MotionKind::counts ? Reading::counts
                : speed                            ? Reading::plain
                                                   : Reading::angle,
                choice.counter_bits);
  std::vector<double> known_s, known;
  double before = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const TraceField& field = rows[i].fields[motion->column];
    if (field.state != TraceField::State::value) continue;
    double value = scale * travel.add(field);
    if (speed) {  // the mean of two readings over the time between them
      const double reading = value;
      value =
          known.empty() ? 0 : known.back() + (before + reading) / 2 * (times[i] - known_s.back());
      before = reading;
    }
    known_s.push_back(times[i]);
    known.push_back(value);
  }
  if (known.size() < 2)
    return data_error(path + ": " + column_name(signals[motion->column]) +
                      " has fewer than two values; record the motion of the spindle");
  out.angle_rad = at_every_row(times, known_s, known);
  return out;
}

}  // namespace servosense::cli
