// A mode of the tool that only entries and changes of feed show.
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "cutting_transients.hpp"
#include "cutting_workflow.hpp"

namespace servosense::reconcile {
namespace {

/// Gain in mean squares of the noise. The best of some thousand modes, three parameters each,
/// reaches it on noise alone once in 10^4 records (chi-squared of three: 2 ln 10^7 and a little).
constexpr double kLeastGain = 40;
constexpr double kLeastGainOfSensor = 50;  // four parameters, and two starts
constexpr double kWorthALook = 12;         // of a coarse scan
/// What the mode must explain of all that does not repeat with the tool and is not noise.
constexpr double kLeastShare = 0.33;
/// Where it was not fitted: standard errors by which it is there, and how far its size may be off
/// beside two of them.
constexpr double kLeastHeldErrors = 3, kMostOff = 0.3;
/// At each change of the feed alike, beside three errors.
constexpr double kPassErrors = 3;
/// Decay within a pass, as a power of e: what rings on from one change to the next is no answer to
/// them.
constexpr double kLeastDecay = 3;

using Judged = CutTransients::Judged;

/// Both directions of a sensor as one candidate; the mode kept is that of the direction that rings
/// more.
Judged together(const Judged& x, const Judged& y) {
  Judged both = x.fitted[1] < y.fitted[1] ? x : y;
  both.fitted[1] = x.fitted[1] + y.fitted[1] - x.fitted[0];
  both.held[1] = x.held[1] + y.held[1] - x.held[0];
  const auto mean = [](double a, double ea, double b, double eb) {
    const double wa = ea > 0 ? 1 / (ea * ea) : 0, wb = eb > 0 ? 1 / (eb * eb) : 0;
    const double w = std::max(1e-300, wa + wb);
    return std::array{(wa * a + wb * b) / w, wa + wb > 0 ? 1 / std::sqrt(w) : 0};
  };
  const auto held = mean(x.held_part, x.held_part_error, y.held_part, y.held_part_error);
  both.held_part = held[0];
  both.held_part_error = held[1];
  for (std::size_t p = 0; p < both.part_of_pass.size(); ++p)
    both.part_of_pass[p] = mean(x.part_of_pass[p][0], x.part_of_pass[p][1], y.part_of_pass[p][0],
                                y.part_of_pass[p][1]);
  return both;
}

}  // namespace

void CuttingWorkflow::name_transients(Report& report) {
  const CutTransients transients(data_, average_, found_.state);
  if (!transients.usable() || report.effects.size() >= options_.most_effects) return;
  const double worth_N2 = kWorthALook * average_.noise_N * average_.noise_N;
  Judged best = transients.best_mode(worth_N2, options_.threads);
  const Judged sensor[2] = {transients.best_sensor(0, worth_N2, options_.threads),
                            transients.best_sensor(1, worth_N2, options_.threads)};
  const bool rings[2] = {sensor[0].fitted[1] < sensor[0].fitted[0],
                         sensor[1].fitted[1] < sensor[1].fitted[0]};
  const Judged of_sensor =
      rings[0] && rings[1] ? together(sensor[0], sensor[1]) : sensor[rings[0] ? 0 : 1];
  if (of_sensor.fitted[1] < best.fitted[1]) best = of_sensor;
  // Vibration that goes on for long is in the scatter between revolutions, too.
  const double noise =
      std::min(average_.noise_N * average_.noise_N, best.fitted[1] / transients.freedom(false));
  const double gain = (best.fitted[0] - best.fitted[1]) / noise;
  const double excess = best.fitted[0] / noise - transients.freedom(false);
  const double error = best.held_part_error * std::sqrt(noise);
  const StructuralMode& mode = best.mode.mode;
  if (!(gain > (best.mode.of_sensor ? kLeastGainOfSensor : kLeastGain)) ||
      gain < kLeastShare * excess || !(best.held_part > kLeastHeldErrors * error) ||
      !(std::abs(best.held_part - 1) < kMostOff + 2 * error) || !(best.held[1] < best.held[0]) ||
      mode.damping_ratio > kMostDamping ||
      mode.damping_ratio * mode.natural_frequency_rad_s() * transients.shortest_s() < kLeastDecay)
    return;
  for (const auto& [part, its_error] : best.part_of_pass)
    if (its_error > 0 && std::abs(part - 1) > kMostOff + kPassErrors * its_error * std::sqrt(noise))
      return;
  const CuttingEffectInfo& info =
      best.mode.of_sensor ? SensorResonanceEffect::info : ExtraModeEffect::info;
  FoundEffect e;
  e.name = info.name;
  e.scope = info.scope;
  e.where = info.where;
  e.share_of_residual = std::clamp(gain / std::max(gain, excess), 0.0, 1.0);
  e.confidence = 0.99;  // it was there again, of the same size, where it was not fitted
  const auto add = [&](const char* key, double value, double log_error) {
    e.parameters.push_back({key, {value}});
    e.standard_errors.push_back({key, {value * log_error * std::sqrt(noise)}});
  };
  if (best.mode.of_sensor) {
    constexpr const char* kKeys[2][2] = {{"natural_frequency_hz", "damping_ratio"},
                                         {"natural_frequency_y_hz", "damping_ratio_y"}};
    for (std::size_t axis = 0; axis < 2; ++axis) {
      // A direction that shows nothing is taken to be like the other.
      const Judged& its = sensor[rings[axis] ? axis : 1 - axis];
      add(kKeys[axis][0], its.mode.mode.natural_frequency_hz, its.errors[0]);
      add(kKeys[axis][1], its.mode.mode.damping_ratio, its.errors[1]);
    }
  } else {
    add(info.parameters[0].key, mode.natural_frequency_hz, best.errors[0]);
    add(info.parameters[1].key, mode.damping_ratio, best.errors[1]);
    add(info.parameters[2].key, mode.modal_mass_kg, best.errors[2]);
  }
  e.gap_before = std::sqrt(best.held[0] / transients.freedom(true));
  e.gap_after = std::sqrt(best.held[1] / transients.freedom(true));
  if (report.effects.empty()) {
    report.gap_before = e.gap_before;
    report.gap_after = e.gap_after;
  }
  report.remarks.emplace_back(
      std::string("a mode of the ") + (best.mode.of_sensor ? "sensor" : "tool") + " along " +
      (best.mode.axis == 0 ? "x" : "y") +
      " shows after changes of the feed; its gaps are of all samples, less what repeats with the "
      "tool");
  report.effects.push_back(std::move(e));
}

}  // namespace servosense::reconcile
