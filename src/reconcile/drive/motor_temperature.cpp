#include "reconcile/drive/motor_temperature.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "reconcile/drive/workflow.hpp"
#include "reconcile/report/machine_file.hpp"

namespace servosense::reconcile {

void read_temperature(const Trace& trace, const DriveColumns& columns,
                      const ConstantOverTemperature& stated, const std::vector<std::size_t>& row_of,
                      DriveData& data) {
  if (std::string said = no_temperature(data.channel, columns, stated); !said.empty())
    data.remarks.push_back(std::move(said));
  data.constant.at_C = stated.at_C;
  if (!columns.temperature_column) return;
  const Column& told = trace.columns[*columns.temperature_column];
  const std::vector<bool>& updated = trace.updated[*columns.temperature_column];
  MotorTemperature motor;
  data.temperature_C.reserve(row_of.size());
  std::size_t next = 0;
  for (std::size_t i = 0; i < row_of.size(); ++i) {
    for (; next <= row_of[i]; ++next)
      motor.hear(
          updated[next] && std::isfinite(told[next]) ? std::optional(told[next]) : std::nullopt,
          trace.t_s[next]);
    if (!motor.known()) data.samples[i].quality |= Quality::gap;
    data.temperature_C.push_back(motor.known() ? motor.last_C() : stated.at_C);
  }
  if (!motor.known()) data.temperature_C.clear();
  if (stated.per_K == 0) return;
  if (std::string lacks = motor.missing(data.channel, stated.at_C); !lacks.empty())
    data.remarks.push_back(std::move(lacks));
  set_constant(data, stated);
}

Column constant_ratio(const DriveData& data, const ConstantOverTemperature& constant) {
  Column ratio;
  ratio.reserve(data.temperature_C.size());
  for (const double t : data.temperature_C)
    ratio.push_back(constant.ratio(t) / data.constant.ratio(t));
  return ratio;
}

void set_constant(DriveData& data, const std::optional<ConstantOverTemperature>& constant) {
  if (!constant || data.temperature_C.empty()) return;
  const Column ratio = constant_ratio(data, *constant);
  for (std::size_t i = 0; i < ratio.size(); ++i) data.samples[i].effort *= ratio[i];
  data.constant = *constant;
}

void write_constant(MachineFile& machine, const std::string& section, const FoundEffect& effect,
                    const std::string& provenance) {
  for (std::size_t p = 0; p < effect.parameters.size(); ++p) {
    const double error =
        p < effect.standard_errors.size() ? effect.standard_errors[p].values[0] : 0;
    machine.set(section, effect.parameters[p].key, rounded(effect.parameters[p].values[0]),
                error > 0 ? error_note(error, 3) + "; " + provenance : provenance);
  }
}

Column DriveWorkflow::temperature_rows() const {
  return signals_->to_rows(signals_->to_work(data_.temperature_C));
}

/// Lowest and highest of the rows that are fitted; of the first record, once there is a second.
std::pair<double, double> DriveWorkflow::temperatures() const {
  if (data_.temperature_C.empty()) return {};
  const Column temperature = temperature_rows();
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (std::size_t i = 0; i < problem_.rows(); ++i)
    if (problem_.usable[i] && !problem_.held_out[i]) {
      low = std::min(low, temperature[i]);
      high = std::max(high, temperature[i]);
    }
  return {low, high};
}

bool DriveWorkflow::motor_warms() const {
  const auto [low, high] = temperatures();
  return high - low >= criteria_.least_warming_K;
}

/// What 1/K more of the constant than the file has takes off the effort:
///   u (1 + a dT) = M, so u = M - (a - a0) dT u / (1 + a0 dT) of an effort u by a0.
/// With u as the model fits it: its noise would explain itself (two-stage least squares). For that
/// fit the temperature is taken from its mean, or u would be explained by itself as a whole.
Column DriveWorkflow::effort_per_kelvin() const {
  Column column(problem_.rows(), 0);
  if (data_.temperature_C.empty()) return column;
  const Column temperature = temperature_rows();
  const FitRows rows = fit_rows(problem_, options_.blocks);
  double mean = 0;
  for (const std::size_t i : rows.rows)
    mean += temperature[i] / static_cast<double>(rows.rows.size());
  const auto by = [&](const Column& effort, double from_C) {
    for (std::size_t i = 0; i < column.size(); ++i)
      column[i] = -(temperature[i] - from_C) * effort[i] / data_.constant.ratio(temperature[i]);
  };
  by(problem_.target, mean);
  Regression r = regression_of_known(problem_, rows);
  r.add(column);
  std::vector<const Column*> columns;
  for (const KnownTerm& term : problem_.known) columns.push_back(&term.column);
  columns.push_back(&column);
  const Column rest = residual_of(problem_.target, columns, r.fit().coefficients);
  Column fitted = problem_.target;
  for (std::size_t i = 0; i < fitted.size(); ++i) fitted[i] -= rest[i];
  by(fitted, data_.constant.at_C);
  return column;
}

/// Of the file and refitted, or named.
std::optional<ConstantOverTemperature> DriveWorkflow::constant_found() const {
  ConstantOverTemperature constant = data_.constant;
  for (const Accepted& accepted : decision_.accepted)
    if (candidates_[accepted.candidate].name == kMotorTemperature) {
      constant.per_K = accepted.coefficients[0];
      return constant;
    }
  for (std::size_t k = 0; k < problem_.known.size() && k < decision_.known.size(); ++k)
    if (problem_.known[k].name == kMotorTemperature &&
        std::abs(decision_.known[k]) >
            criteria_.certain_standard_errors * decision_.known_errors[k]) {
      constant.per_K += decision_.known[k];
      return constant;
    }
  return {};
}

void DriveWorkflow::report_constant(Report& report) const {
  const auto constant = constant_found();
  if (!constant || data_.constant.per_K == 0) return;
  for (std::size_t k = 0; k < problem_.known.size(); ++k)
    if (problem_.known[k].name == kMotorTemperature)
      report.recalibrated.push_back(
          {kPerKelvin, data_.constant.per_K, constant->per_K, decision_.known_errors[k]});
}

}  // namespace servosense::reconcile
