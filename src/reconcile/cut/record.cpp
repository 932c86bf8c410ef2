// From machine file and trace to forces over the angle of the spindle.
#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>

#include "reconcile/signal_check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"
#include "servosense/reconcile/cutting.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense::reconcile {
namespace {

const Column* find(const Trace& trace, Channel channel, Quantity quantity) {
  return trace.find({channel, quantity});
}

struct Forces {
  const Column *x = nullptr, *y = nullptr;
  const char* channel = "dyno";
};

Forces forces_of(const Trace& trace) {
  using enum Quantity;
  for (const Channel channel : {Channel::dyno, Channel::tool}) {
    const Column* x = find(trace, channel, force_x_N);
    const Column* y = find(trace, channel, force_y_N);
    if (x != nullptr && y != nullptr) return {x, y, channel == Channel::dyno ? "dyno" : "tool"};
  }
  return {find(trace, Channel::x, force_N), find(trace, Channel::y, force_N), "machine"};
}

/// Angles counted on: a step back by more than half a turn is the wrap of the encoder.
Column unwrapped(const Column& angle) {
  Column out = angle;
  double turns = 0, last = std::nan("");
  for (double& a : out) {
    if (!std::isfinite(a)) continue;
    if (std::isfinite(last) && a - last < -kPi) turns += std::round((last - a) / kTwoPi);
    last = a;
    a += kTwoPi * turns;
  }
  return out;
}

std::optional<Column> angle_of(const Trace& trace, const MachineFile& machine) {
  using enum Quantity;
  if (const Column* angle = find(trace, Channel::spindle, angle_rad)) return unwrapped(*angle);
  if (const Column* counts = find(trace, Channel::spindle, angle_counts)) {
    const auto per_turn = machine.number("spindle", "encoder_counts_per_rev");
    if (!per_turn) return std::nullopt;
    Column angle = *counts;
    for (double& a : angle) a *= kTwoPi / *per_turn;
    return unwrapped(angle);
  }
  if (const Column* speed = find(trace, Channel::spindle, speed_rad_s)) {
    Column angle(speed->size(), 0);
    for (std::size_t i = 1; i < angle.size(); ++i) {
      const double mean = 0.5 * ((*speed)[i] + (*speed)[i - 1]);
      angle[i] =
          angle[i - 1] + (std::isfinite(mean) ? mean * (trace.t_s[i] - trace.t_s[i - 1]) : 0);
    }
    return angle;
  }
  return std::nullopt;
}

/// What the sensor or the encoder cannot have measured.
Expected<Done> leave_out_bad_cuts(CuttingData& data, const Criteria& criteria) {
  const auto leave = [&](const std::string& column, const char* fault, const char* check,
                         const std::vector<std::size_t>& samples) -> Expected<Done> {
    auto found = leave_out(column, fault, check, data.time_s, samples, criteria);
    if (!found) return found.error();
    for (const std::size_t i : samples) data.valid[i] = false;
    data.bad_signals.insert(data.bad_signals.end(), found->begin(), found->end());
    return Done{};
  };
  if (auto done = leave("spindle angle", kStray, "the encoder, its cable and the order of the rows",
                        stray_samples(data.angle_rad, size_of_motion(data.angle_rad), criteria));
      !done)
    return done;
  const bool drives = data.channel == "machine";
  for (const auto& [force, column] :
       {std::pair{&data.force_x_N, drives ? "x.force_N" : data.channel + ".force_x_N"},
        std::pair{&data.force_y_N, drives ? "y.force_N" : data.channel + ".force_y_N"}}) {
    if (auto done = leave(column, kStray, "the cable, its shield and the order of the rows",
                          stray_forces(*force, data.angle_rad, criteria));
        !done)
      return done;
    if (auto done = leave(column, "are cut off at the end of the range, or keep one value",
                          "the range of the amplifier and the sensor's cable",
                          cut_off_samples(*force, data.angle_rad));
        !done)
      return done;
  }
  return Done{};
}

bool runs_backwards(const Column& angle) {
  std::size_t back = 0, on = 0;
  for (std::size_t i = 1; i < angle.size(); ++i) {
    if (angle[i] < angle[i - 1]) ++back;
    if (angle[i] > angle[i - 1]) ++on;
  }
  return back > 4 * on;
}

}  // namespace

bool has_cutting_forces(const Trace& trace) {
  const Forces forces = forces_of(trace);
  if (forces.x == nullptr || forces.y == nullptr) return false;
  // Forces of a sensor can only be those of a cut; those of drives only where the spindle is.
  using enum Quantity;
  return std::string_view(forces.channel) != "machine" ||
         find(trace, Channel::spindle, angle_rad) != nullptr ||
         find(trace, Channel::spindle, angle_counts) != nullptr;
}

bool has_one_cutting_force(const Trace& trace) {
  using enum Quantity;
  for (const Channel sensor : {Channel::dyno, Channel::tool})
    for (const Quantity force : {force_x_N, force_y_N})
      if (find(trace, sensor, force) != nullptr) return !has_cutting_forces(trace);
  return false;
}

Expected<CuttingData> read_cutting(const MachineFile& machine, const Trace& trace,
                                   const Criteria& criteria) {
  const Forces forces = forces_of(trace);
  if (has_one_cutting_force(trace))
    return data_error(
        "the trace has one component of the cutting force; record both, dyno.force_x_N along the "
        "feed and dyno.force_y_N across it");
  if (forces.x == nullptr || forces.y == nullptr)
    return data_error(
        "the trace has no cutting forces; record dyno.force_x_N and dyno.force_y_N (or "
        "tool.force_*, "
        "or x.force_N and y.force_N)");
  CuttingData data;
  data.channel = forces.channel;
  for (const char* section : {"tool", "cut"})
    if (!machine.has_section(section))
      return data_error(machine.name() + ": no [" + section +
                        "]; a cut is compared with the milling model, which needs [tool] "
                        "(diameter_m, teeth, tangential_coefficient_N_per_m2) and [cut] (depth, "
                        "immersion, direction)");
  auto tool = milling_tool(machine);
  if (!tool) return tool.error();
  data.tool = std::move(*tool);
  if (data.tool.teeth < 1 || !(data.tool.diameter_m > 0))
    return data_error(machine.name() + ": [tool] needs teeth and diameter_m");
  // The feed may come from the trace; the rest of [cut] is needed.
  const Column* feed = find(trace, Channel::tool, Quantity::feed_per_tooth_m);
  MachineFile copy = machine;
  if (feed != nullptr && !machine.has("cut", "feed_per_tooth_m"))
    copy.set("cut", "feed_per_tooth_m", 1e-4);
  if (!machine.has("cut", "spindle_speed_rpm")) copy.set("cut", "spindle_speed_rpm", 1000.0);
  auto cut = milling_cut(copy);
  if (!cut) return cut.error();
  data.cut = *cut;
  if (data.cut.radial_immersion_m > data.tool.diameter_m)
    return data_error(machine.where("cut") + ": radial_immersion_m is " +
                      printed(data.cut.radial_immersion_m) + ", the diameter of the tool " +
                      printed(data.tool.diameter_m) +
                      "; no tool cuts wider than it is, check both");
  auto structure = structure_modes(machine);
  if (!structure) return structure.error();
  data.structure = std::move(*structure);

  auto angle = angle_of(trace, machine);
  if (!angle)
    return data_error(
        "the trace does not tell the angle of the spindle; record spindle.angle_rad, or "
        "spindle.angle_counts with [spindle] encoder_counts_per_rev, or spindle.speed_rad_s");
  if (runs_backwards(*angle))
    return data_error(
        "the angle of the spindle counts down while it cuts; the model turns with a rising one: "
        "change the sign of the spindle's column");
  data.time_s = trace.t_s;
  data.angle_rad = std::move(*angle);
  data.force_x_N = *forces.x;
  data.force_y_N = *forces.y;
  const std::size_t n = data.time_s.size();
  data.feed_per_tooth_m = feed != nullptr ? *feed : Column(n, data.cut.feed_per_tooth_m);
  if (feed == nullptr)
    data.remarks.emplace_back("the feed per tooth is that of [cut]: no tool.feed_per_tooth_m");
  data.valid.assign(n, false);
  std::size_t valid = 0;
  for (std::size_t i = 0; i < n; ++i) {
    data.valid[i] = std::isfinite(data.angle_rad[i]) && std::isfinite(data.force_x_N[i]) &&
                    std::isfinite(data.force_y_N[i]) && data.feed_per_tooth_m[i] > 0;
    if (data.valid[i]) ++valid;
  }
  if (auto done = leave_out_bad_cuts(data, criteria); !done) return done.error();
  if (valid < n)
    data.remarks.push_back(std::to_string(n - valid) +
                           " samples are not used: they have no value, or were left out");
  if (valid < 200)
    return data_error("only " + std::to_string(valid) +
                      " usable samples; record at least 60 revolutions in steady cutting");
  return data;
}

}  // namespace servosense::reconcile
