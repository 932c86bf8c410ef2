// EMPS benchmark records (Janot, Gautier, Brunot 2019), read without the project's own trace
// reader.
#pragma once

#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "servosense/core/drive_input.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace oracle {

constexpr double kEmpsPeriod_s = 1e-3;
constexpr double kEmpsForce_N_per_V = 35.15065188248547;

struct EmpsRow {
  double t_s = 0, position_m = 0, output_V = 0, pulse_V = 0;
};

/// Columns by their names in the first line; `pulse` may be absent.
inline std::vector<EmpsRow> read_emps(const std::string& path) {
  std::vector<EmpsRow> rows;
  std::ifstream in(path);
  std::string line, field;
  while (std::getline(in, line) && line.starts_with('#')) {
  }
  std::vector<std::string> names;
  for (std::stringstream s(line); std::getline(s, field, ',');) names.push_back(field);
  while (std::getline(in, line)) {
    EmpsRow row;
    std::size_t i = 0;
    for (std::stringstream s(line); std::getline(s, field, ',') && i < names.size(); ++i) {
      const double value = std::stod(field);
      if (names[i] == "t_s") row.t_s = value;
      if (names[i] == "qm_m") row.position_m = value;
      if (names[i] == "vir_V") row.output_V = value;
      if (names[i].starts_with("pulse")) row.pulse_V = value;
    }
    rows.push_back(row);
  }
  return rows;
}

/// Position as measured, force as the controller alone asked for it: a pulse is then a load.
inline std::vector<servosense::DriveSample<double>> emps_samples(const std::vector<EmpsRow>& rows) {
  using namespace servosense;
  DriveInputConfig c;
  c.kind = MotionKind::position;
  c.sample_period_s = kEmpsPeriod_s;
  c.effort_per_unit = kEmpsForce_N_per_V;
  DriveInput<double> input;
  input.configure(c);
  std::vector<DriveSample<double>> samples;
  samples.reserve(rows.size());
  for (const EmpsRow& row : rows) {
    RawDriveSample<double> raw;
    raw.motion = row.position_m;
    raw.effort = row.output_V - row.pulse_V;
    samples.push_back(input.process(raw));
  }
  return samples;
}

/// Observer as for collisions (Koike 2016, table 3-3), at the rate of the records.
inline servosense::DisturbanceObserverConfig emps_observer() {
  servosense::DisturbanceObserverConfig c;
  c.sample_period_s = kEmpsPeriod_s;
  c.disturbance_cutoff_rad_s = c.velocity_cutoff_rad_s = 335;
  c.drive.friction_knee = 5e-6;
  return c;
}

}  // namespace oracle
