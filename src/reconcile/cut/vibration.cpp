// What only entries and changes of feed show: a mode of the tool or the sensor, and memory.
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <string>
#include <utility>

#include "reconcile/cut/transients.hpp"
#include "reconcile/cut/workflow.hpp"
#include "reconcile/select/confidence.hpp"
#include "servosense/sim/run_parallel.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kWorthALook = 12;  // of a coarse scan

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

/// Whether it is there where it was not fitted: in the part kept for the proof, or, where the feed
/// hardly changes in that, at changes which the fit hardly heeds beside a stronger one.
bool shows_elsewhere(const Judged& its, double noise_N, const Criteria& criteria) {
  if (its.held_part > criteria.sure_standard_errors * its.held_part_error * noise_N) return true;
  double all = 0, weight = 0, sum = 0;
  for (const auto& [part, error] : its.part_of_pass)
    if (error > 0) all += 1 / (error * error);
  for (const auto& [part, error] : its.part_of_pass) {
    if (!(error > 0) || 1 / (error * error) > criteria.hardly_heeded * all) continue;
    weight += 1 / (error * error);
    sum += part / (error * error);
  }
  if (!(weight > 0)) return false;
  const double mean = sum / weight, error = noise_N / std::sqrt(weight);
  return mean > criteria.sure_standard_errors * error &&
         std::abs(mean - 1) < criteria.vibration_size_off + 2 * error;
}

}  // namespace

void CuttingWorkflow::name_transients(Report& report) {
  const auto modes = [](const Structure& s) { return s.x.size() + s.y.size(); };
  if (modes(found_.state.structure) > modes(data_.structure)) return;  // found in the steady cut
  if (modes(data_.structure) > 0 && found_.state.cut.regeneration) return;  // or in the model
  const CutTransients transients(data_, average_, found_.state, criteria_);
  if (!transients.usable() || report.effects.size() >= options_.most_effects) return;
  if (name_transient(report, transients)) return;
  name_chatter(report, transients);
}

/// What was found, of a tool that vibrates as the file says, and remembers it.
CutState CuttingWorkflow::with_memory() const {
  CutFitter remembering = *fitter_;
  const CutFit base = remembering.calibrate_with(data_.structure, true, base_);
  const std::vector<std::size_t>& set = found_.families;
  return set.empty() ? base.state : remembering.fit(chosen(set), set, base).state;
}

/// The cut that remembers against the one that does not, each with its own coefficients, and
/// against a tool that does not vibrate at all: after a change of the feed they differ even where
/// the force hardly changes over the turn.
CutTransients::Judged CuttingWorkflow::memory_in(const CutTransients& transients) const {
  const CutTransients remembering(data_, average_, with_memory(), criteria_);
  std::vector<CutTransients::Start> starts = {
      {true, false}, {true, true}, {false, false}, {false, true}};
  std::vector<Judged> each(starts.size());
  run_parallel(
      starts.size(),
      [&](std::size_t i) {
        const Eigen::VectorXd forced = transients.simulated(data_.structure, starts[i], false);
        const Eigen::VectorXd memory = remembering.simulated(data_.structure, starts[i], true);
        each[i] = transients.judged_beside(forced, memory);
        Judged beside_none = transients.judged_beside(Eigen::VectorXd::Zero(memory.size()), memory);
        if (beside_none.fitted[0] < each[i].fitted[0]) each[i] = std::move(beside_none);
        each[i].start = starts[i];
      },
      options_.threads);
  return *std::min_element(each.begin(), each.end(), [](const Judged& l, const Judged& r) {
    return std::min(l.fitted[0], l.fitted[1]) < std::min(r.fitted[0], r.fitted[1]);
  });
}

bool CuttingWorkflow::name_transient(Report& report, const CutTransients& transients) {
  const bool rigid = data_.structure.x.empty() && data_.structure.y.empty();
  const double worth_N2 = kWorthALook * average_.noise_N * average_.noise_N;
  Judged best = rigid ? transients.best_mode(worth_N2, options_.threads) : memory_in(transients);
  Judged sensor[2];
  for (std::size_t axis = 0; axis < 2 && rigid; ++axis)
    sensor[axis] = transients.best_sensor(axis, worth_N2, options_.threads);
  const bool rings[2] = {sensor[0].fitted[1] < sensor[0].fitted[0],
                         sensor[1].fitted[1] < sensor[1].fitted[0]};
  const Judged of_sensor =
      rings[0] && rings[1] ? together(sensor[0], sensor[1]) : sensor[rings[0] ? 0 : 1];
  if (rigid && of_sensor.fitted[1] < best.fitted[1]) best = of_sensor;
  // Vibration that goes on for long is in the scatter between revolutions, too.
  const double noise =
      std::min(average_.noise_N * average_.noise_N, best.fitted[1] / transients.freedom(false));
  const double gain = (best.fitted[0] - best.fitted[1]) / noise;
  const double excess = best.fitted[0] / noise - transients.freedom(false);
  const double error = best.held_part_error * std::sqrt(noise);
  const StructuralMode& mode = best.mode.mode;
  if (!(gain > (best.mode.of_sensor ? criteria_.sensor_scan_gain : criteria_.scan_gain)) ||
      gain < criteria_.vibration_explains * excess ||
      !shows_elsewhere(best, std::sqrt(noise), criteria_) ||
      !(std::abs(best.held_part - 1) < criteria_.vibration_size_off + 2 * error) ||
      !(best.held[1] < best.held[0]) ||
      (rigid && (mode.damping_ratio > criteria_.most_damping ||
                 mode.damping_ratio * mode.natural_frequency_rad_s() * transients.shortest_s() <
                     criteria_.decay_within_pass)))
    return false;
  if (!alike_in_passes(best, std::sqrt(noise))) return false;
  if (is_modulation(transients, 1 - best.fitted[1] / best.fitted[0])) return false;
  const CuttingEffectInfo& info = !rigid                ? RegenerationEffect::info
                                  : best.mode.of_sensor ? SensorResonanceEffect::info
                                                        : ExtraModeEffect::info;
  FoundEffect e = found_effect(info);
  e.share_of_residual = std::clamp(gain / std::max(gain, excess), 0.0, 1.0);
  // In squares of the noise, as the scan is judged.
  e.confidence = confidence_of({.margin = std::sqrt(gain)}, criteria_);
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
  } else if (rigid) {
    add_mode_parameters(e, best, std::sqrt(noise));
  }
  const std::string what = rigid ? std::string("a mode of the ") +
                                       (best.mode.of_sensor ? "sensor" : "tool") + " along " +
                                       (best.mode.axis == 0 ? "x" : "y")
                                 : "memory";
  report.remarks.push_back(
      what +
      " shows after changes of the feed; its gaps are of all samples, less what repeats with the "
      "tool");
  add_vibration(report, std::move(e), best.held, transients);
  return true;
}

/// Of the same size in every pass, as far as these tell.
bool CuttingWorkflow::alike_in_passes(const Judged& its, double noise_N) const {
  return std::ranges::all_of(its.part_of_pass, [&](const std::array<double, 2>& pass) {
    const auto [part, error] = pass;
    return !(error > 0) ||
           !(std::abs(part - 1) >
             criteria_.vibration_size_off + criteria_.sure_standard_errors * error * noise_N);
  });
}

void CuttingWorkflow::add_mode_parameters(FoundEffect& effect, const Judged& its, double noise_N) {
  const StructuralMode& mode = its.mode.mode;
  const double values[] = {mode.natural_frequency_hz, mode.damping_ratio, mode.modal_mass_kg};
  for (std::size_t k = 0; k < std::size(values); ++k) {
    const char* key = ExtraModeEffect::info.parameters[k].key;
    effect.parameters.push_back({key, {values[k]}});
    effect.standard_errors.push_back({key, {values[k] * its.errors[k] * noise_N}});
  }
}

/// `held`: sums of squares without it and with it, of the samples kept for the proof.
void CuttingWorkflow::add_vibration(Report& report, FoundEffect effect, std::array<double, 2> held,
                                    const CutTransients& transients) {
  effect.gap_before = std::sqrt(held[0] / transients.freedom(true));
  effect.gap_after = std::sqrt(held[1] / transients.freedom(true));
  if (report.effects.empty()) {
    report.gap_before = effect.gap_before;
    report.gap_after = effect.gap_after;
  }
  report.effects.push_back(std::move(effect));
}

}  // namespace servosense::reconcile
