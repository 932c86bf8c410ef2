#include "beside_power.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/io/sample_period.hpp"

namespace servosense::cli {
namespace {

constexpr std::size_t kRowsForPeriod = 64;  // stamps rounded to half a period tell it within 2 %

}  // namespace

std::optional<DriveColumns> columns_beside(const std::vector<Signal>& signals, std::size_t current,
                                           Channel channel, const ColumnChoice& choice) {
  std::vector<Signal> others = signals;
  others[current] = {channel, Quantity::temperature_C};
  auto columns = drive_columns(others, channel, choice);
  if (!columns) return {};
  using enum Quantity;
  const Quantity quantity = signals[columns->effort_column].quantity;
  if (quantity != power_W && quantity != load_V && quantity != load_percent) return {};
  return columns;
}

BesidePower::BesidePower(const DriveColumns& columns, const ColumnChoice& choice, double period_s)
    : columns_(columns),
      unit_per_count_(choice.unit_per_count),
      period_s_(period_s),
      travel_(columns.is_angle                              ? servosense::Reading::angle
              : columns.signal.motion == MotionKind::counts ? servosense::Reading::counts
                                                            : servosense::Reading::plain,
              choice.counter_bits) {}

std::optional<BesidePower::Reading> BesidePower::hear(const TraceRow& row) {
  using enum TraceField::State;
  const double t_s = seconds_from(row.t_ns);
  if (!(period_s_ > 0)) {
    if (times_s_.empty()) first_s_ = t_s;
    times_s_.push_back(t_s - first_s_);
    if (times_s_.size() < kRowsForPeriod) return {};
    period_s_ = sample_period(times_s_);
    if (!(period_s_ > 0)) return {};
  }
  std::optional<double> moved;
  if (columns_.constant_motion == 0) {
    const TraceField& motion = row.fields[columns_.motion_column];
    if (motion.state == value)
      moved =
          travel_.add(motion) *
          (columns_.signal.motion == MotionKind::counts ? unit_per_count_ : columns_.motion_scale);
  }
  Reading reading;
  reading.speed_rad_s = load_.speed_rad_s(columns_, period_s_, t_s, moved);
  const TraceField& effort = row.fields[columns_.effort_column];
  if (effort.state != value) return {};
  reading.power_W = columns_.effort_scale * effort.value;
  reading.torque_Nm = LoadTorque::torque_Nm(columns_, reading.power_W, reading.speed_rad_s);
  reading.known =
      !columns_.power || std::abs(reading.speed_rad_s) >= columns_.power->known_from_rad_s;
  return reading;
}

double BesidePower::noise_Nm(double noise, double torque_Nm, double speed_rad_s) const {
  if (!columns_.power) return std::abs(faded_torque(noise, speed_rad_s, columns_.rated_to_rad_s));
  const double motoring = speed_rad_s < 0 ? -torque_Nm : torque_Nm;
  const double by_torque =
      std::abs(speed_rad_s) + 2 * columns_.power->losses.copper_W_per_Nm2 * motoring;
  return noise / std::max(by_torque, columns_.power->known_from_rad_s);
}

}  // namespace servosense::cli
