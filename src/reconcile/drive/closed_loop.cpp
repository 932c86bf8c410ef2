#include "reconcile/drive/closed_loop.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <tuple>
#include <utility>

#include "reconcile/drive/signals.hpp"
#include "servosense/core/quality.hpp"
#include "servosense/core/units.hpp"
#include "servosense/sim/drive_simulator.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense::reconcile {
namespace {

struct LoopResponse {
  Column position, effort;  ///< at the instants of the record
};

/// Straight lines between the rows of the command, from a drive that stands at its first.
Expected<LoopResponse> respond(const DriveData& data, const FreeModel& model) {
  DriveSimulatorConfig c = *data.loop;
  c.drive = model.drive;
  if (c.controller.delay_s == 0 && c.controller.current_bandwidth_hz == 0) {
    // Between effort and motion lies what was measured; half a period of it is the hold.
    c.controller.delay_s = std::max(0.0, model.late_s - c.sample_period_s / 2);
    c.reported = ReportedCurrent::reference;
  }
  c.loop = DriveLoop::position;
  c.initial_position = 0;
  // Finely enough where the record has no counts: effects on the encoder show in its reading alone.
  const double unit = c.drive.unit_per_turn;
  if (!(c.encoder.counts_per_turn > 0)) c.encoder.counts_per_turn = unit > 0 ? 0x1p30 : 0;
  c.encoder.counter_bits = 64;
  c.encoder.initial_counts =
      std::llround(data.samples.front().turn_angle_rad / kTwoPi * c.encoder.counts_per_turn);
  c.current_update_hz = 0;
  c.current_noise_A = 0;
  auto simulator = DriveSimulator::create(c);
  if (!simulator) return simulator.error();
  const double per_row = data.sample_period_s / c.sample_period_s;
  const double steps = static_cast<double>(data.command.size()) * per_row;
  if (steps * simulator->substeps() > kMostSteps)
    return data_error("the model is too stiff to be simulated along this record");
  LoopResponse out;
  // Positions count from the start of the record.
  const auto told = [&](double row) {
    return between_samples(data.command, row) - data.command.front();
  };
  double row = 0;
  for (std::size_t n = 0; out.position.size() < data.command.size(); ++n) {
    const DriveSimSample s = simulator->step(told(row));
    // The servo instant nearest to each row.
    if (row + 0.5 / per_row >= static_cast<double>(out.position.size())) {
      const auto counts = static_cast<double>(s.angle_counts - c.encoder.initial_counts);
      out.position.push_back(unit > 0 ? counts * unit / c.encoder.counts_per_turn : s.position);
      out.effort.push_back(s.current_A * c.effort_per_A);
      if (!model.constant_ratio.empty())
        out.effort.back() /= model.constant_ratio[out.effort.size() - 1];
    }
    row = static_cast<double>(n + 1) / per_row;
  }
  return out;
}

/// Where the drive was, and how far behind its command.
Column command_from(const Column& error, const std::vector<std::size_t>& row_of,
                    const std::vector<DriveSample<double>>& samples) {
  Column command;
  double at = 0, behind = 0;
  for (std::size_t i = 0; i < row_of.size(); ++i) {
    at += samples[i].increment;
    if (std::isfinite(error[row_of[i]])) behind = error[row_of[i]];
    command.push_back(at + behind);
  }
  return command;
}

}  // namespace

void read_loop(const MachineFile& machine, const Trace& trace,
               const std::vector<std::size_t>& row_of, DriveData& data) {
  const std::string name(name_of(data.channel));
  const Signal told{data.channel,
                    data.turns() ? Quantity::command_angle_rad : Quantity::command_position_m};
  const Column* column = trace.find(told);
  const Column* error = column == nullptr
                            ? trace.find({data.channel, data.turns() ? Quantity::following_error_rad
                                                                     : Quantity::following_error_m})
                            : nullptr;
  const auto missing = [&] {
    data.no_loop = "the trace does not say what the drive was told; record " + name + "." +
                   std::string(name_of(told.quantity));
  };
  if (column == nullptr && error == nullptr) return missing();
  auto loop = drive_simulation(machine, data.channel);
  if (!loop) {
    data.no_loop = loop.error().sentence;
    return;
  }
  double& gain = loop->controller.position_gain_per_s;
  gain = machine.number("controller." + name, "position_gain_per_s").value_or(gain);
  if (!(gain > 0)) {
    data.no_loop = machine.name() + ": [controller." + name + "] lacks position_gain_per_s";
    return;
  }
  if (error != nullptr) {
    data.command = command_from(*error, row_of, data.samples);
    data.loop = std::move(*loop);
    return;
  }
  // The controller was told something in holes of the record too: straight lines across.
  const auto signal = std::find(trace.signals.begin(), trace.signals.end(), told);
  const auto& updated = trace.updated[static_cast<std::size_t>(signal - trace.signals.begin())];
  std::size_t known = row_of.size();  // the last one that is; none yet
  data.command.assign(row_of.size(), 0);
  for (std::size_t i = 0; i < row_of.size(); ++i) {
    const std::size_t row = row_of[i];
    const bool hole = i > 0 && row == row_of[i - 1];
    if (hole || !updated[row] || !std::isfinite((*column)[row])) continue;
    const double to = (*column)[row];
    const std::size_t first = known < i ? known : 0;
    const double from = known < i ? data.command[known] : to;
    for (std::size_t k = first; k <= i; ++k)
      data.command[k] = from + (to - from) * static_cast<double>(k - first) /
                                   static_cast<double>(std::max<std::size_t>(1, i - first));
    known = i;
  }
  if (known == row_of.size()) {
    data.command.clear();
    return missing();
  }
  std::fill(data.command.begin() + static_cast<long>(known), data.command.end(),
            data.command[known]);
  data.loop = std::move(*loop);
}

ClosedLoop closed_loop(const DriveData& data, const FreeModel& before, const FreeModel& after,
                       double corner_hz, double from_s, double to_s) {
  ClosedLoop out;
  if (!data.loop) {
    out.not_shown = data.no_loop;
    return out;
  }
  auto first = respond(data, before);
  auto second = respond(data, after);
  if (!first || !second) {
    out.not_shown = (first ? second : first).error().sentence;
    return out;
  }

  std::vector<std::size_t> rows;
  std::vector<std::size_t> first_of;  // of the stretch that a sample belongs to
  Column measured;
  const bool absolute = data.start_position != 0;
  double x = absolute ? data.start_position - data.command.front() : 0;
  for (std::size_t i = 0; i < data.samples.size(); ++i) {
    const DriveSample<double>& sample = data.samples[i];
    if (i > 0) x += sample.increment;
    measured.push_back(x);
    const bool anew = i == 0 || has(sample.quality, Quality::restarted);
    first_of.push_back(anew ? i : first_of.back());
    const double t = data.start_s + static_cast<double>(i) * data.sample_period_s;
    if (t >= from_s && t <= to_s && !has(sample.quality, kUnusable | Quality::gap))
      rows.push_back(i);
  }
  if (rows.empty()) {
    out.not_shown = "the held-out part has no sample without fault";
    return out;
  }
  // A counter does not say where it stands, nor does what was lost in a hole: such a stretch is put
  // where the simulated drive is, on the average.
  const auto placed = [&](const Column& simulated) {
    Column position = measured;
    for (std::size_t r = 0; r < rows.size();) {
      const std::size_t begin = r, stretch = first_of[rows[r]];
      double off = 0;
      for (; r < rows.size() && first_of[rows[r]] == stretch; ++r)
        off += measured[rows[r]] - simulated[rows[r]];
      if (stretch == 0 && absolute) continue;
      for (std::size_t k = begin; k < r; ++k)
        position[rows[k]] -= off / static_cast<double>(r - begin);
    }
    return position;
  };
  const auto rms = [&](const auto& value) {
    double square = 0;
    for (const std::size_t i : rows) square += value(i) * value(i);
    return std::sqrt(square / static_cast<double>(rows.size()));
  };
  const Column followed = placed(second->position);
  out.following_rms =
      rms([&](std::size_t i) { return data.command[i] - data.command.front() - followed[i]; });
  const Smoother filter(corner_hz, data.sample_period_s);
  const auto departure = [&](const LoopResponse& r) {
    const Column position = placed(r.position);
    Column effort = r.effort;
    for (std::size_t i = 0; i < effort.size(); ++i) {
      const DriveSample<double>& sample = data.samples[i];
      effort[i] = has(sample.quality, kUnusable | Quality::gap) ? 0 : effort[i] - sample.effort;
    }
    effort = filter.apply(effort, 0, 1);
    return std::pair(rms([&](std::size_t i) { return r.position[i] - position[i]; }),
                     rms([&](std::size_t i) { return effort[i]; }));
  };
  std::tie(out.position_before, out.effort_before) = departure(*first);
  std::tie(out.position_after, out.effort_after) = departure(*second);
  return out;
}

}  // namespace servosense::reconcile
