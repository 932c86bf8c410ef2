#include "reconcile/cut/workflow.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

/// Highest order of the rotation that means over angles follow, in numbers of them.
constexpr double kMostOrder = 0.3;

}  // namespace

double CuttingWorkflow::floor_N() const {
  return std::max(criteria_.cut_floor_in_noise * average_.noise_N,
                  criteria_.cut_floor_in_effort * average_.effort_N);
}

double CuttingWorkflow::least_gain() const {
  // Where teeth enter at once, the angles at which samples fall tell more than noise does.
  return fitter_->steep() ? floor_N() : chance_gain();
}

double CuttingWorkflow::chance_gain() const {
  return std::max(std::sqrt(criteria_.scan_gain / samples_) * average_.noise_N,
                  criteria_.least_cut_gain_in_effort * average_.effort_N);
}

double CuttingWorkflow::explained(const CutFit& before, const CutFit& after) const {
  // Chance in the sum of squares of as many means.
  const double chance = criteria_.class_standard_errors * std::sqrt(2 * cells_) * average_.noise_N *
                        average_.noise_N / samples_;
  const double gain = beyond_noise(before) - beyond_noise(after);
  if (!(gain > 0)) return 0;
  return gain / (gain + std::max(0.0, beyond_noise(after) - chance));
}

bool CuttingWorkflow::cuts() const {
  return std::abs(base_.state.coefficients[0]) >
         criteria_.beyond_doubt_standard_errors * base_.coefficient_errors(0);
}

/// Between two points of a curve a step is a ramp, and a sample that falls there is off by half of
/// the force.
Column CuttingWorkflow::predicted_at_samples(const CutState& state, bool y) const {
  const Eigen::Map<const Eigen::Vector4d> c(state.coefficients.data());
  Column out(data_.time_s.size(), 0);
  for (std::size_t l = 0; l < average_.levels.size(); ++l) {
    std::vector<std::size_t> at;
    std::vector<double> angles;
    for (std::size_t i = 0; i < out.size(); ++i) {
      if (average_.level_of[i] != l) continue;
      at.push_back(i);
      angles.push_back(data_.angle_rad[i]);
    }
    const Eigen::VectorXd force = force_columns(state, average_.levels[l].feed_per_tooth_m,
                                                average_.levels[l].speed_rad_s, angles) *
                                  c.head(state.columns());
    for (std::size_t k = 0; k < at.size(); ++k)
      out[at[k]] =
          force(static_cast<Eigen::Index>((y ? at.size() : 0) + k)) + state.offset_N[y ? 1 : 0];
  }
  return out;
}

Column CuttingWorkflow::predicted(const CutState& state, bool y) const {
  if (fitter_->steep() && !rings(state)) return predicted_at_samples(state, y);
  // From a fine curve of each level: samples are many.
  constexpr std::size_t kPoints = 1440;
  std::vector<double> angles;
  for (std::size_t i = 0; i < kPoints; ++i)
    angles.push_back(kTwoPi * static_cast<double>(i) / kPoints);
  const Eigen::Map<const Eigen::Vector4d> c(state.coefficients.data());
  std::vector<Eigen::VectorXd> curves;
  for (const CutLevel& level : average_.levels)
    curves.push_back(force_columns(state, level.feed_per_tooth_m, level.speed_rad_s, angles) *
                     c.head(state.columns()));
  Column out(data_.time_s.size(), 0);
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (average_.level_of[i] == CutAverage::kNone) continue;
    const Eigen::VectorXd& curve = curves[average_.level_of[i]];
    double g = data_.angle_rad[i] / kTwoPi;
    g = (g - std::floor(g)) * kPoints;
    const auto k = std::min(static_cast<std::size_t>(g), kPoints - 1);
    const double part = g - static_cast<double>(k);
    const auto at = [&](std::size_t j) {
      return curve(static_cast<Eigen::Index>((y ? kPoints : 0) + j % kPoints)) +
             state.offset_N[y ? 1 : 0];
    };
    out[i] = at(k) + part * (at(k + 1) - at(k));
  }
  return out;
}

void CuttingWorkflow::measure_again(const CutFit& fit) {
  average_again(
      average_, data_,
      {predicted(fit.state, false), predicted(fit.state, true), fitter_->forces(fit.state)},
      criteria_);
  fitter_->refresh();
  cells_ = samples_ = 0;
  for (const CutBlock& b : average_.blocks) {
    if (b.held_out) continue;
    cells_ += static_cast<double>((b.count.array() > 0).count());
    samples_ += b.count.sum();
  }
}

/// The model without effects, with samples averaged about it.
void CuttingWorkflow::calibrate_again(int rounds) {
  for (int round = 0; round < rounds; ++round) {
    measure_again(base_);
    base_ = fitter_->calibrate(base_);
  }
}

std::optional<Error> CuttingWorkflow::calibrate() {
  auto averaged = average(data_, options_);
  if (!averaged) return averaged.error();
  average_ = std::move(*averaged);
  given_.tool = data_.tool;
  given_.cut = data_.cut;
  given_.structure = data_.structure;
  given_.edges =
      data_.tool.force.tangential_edge_N_per_m != 0 || data_.tool.force.radial_edge_N_per_m != 0;
  const double nominal_kt = data_.tool.force.tangential_coefficient_N_per_m2;
  given_.coefficients = {nominal_kt, nominal_kt * data_.tool.force.radial_ratio,
                         data_.tool.force.tangential_edge_N_per_m,
                         data_.tool.force.radial_edge_N_per_m};
  const bool on_tool = data_.channel == "tool";
  const double feed = data_.cut.feed_per_tooth_m;
  // Again with samples averaged about the first model, so that bins do not smear them.
  fitter_.emplace(average_, given_, feed, criteria_);
  base_ = fitter_->calibrate(on_tool);
  calibrate_again(3);
  // Before any effect is asked: what circles leave looks like one.
  if (other_paths_fit(base_)) calibrate_again(2);
  if (const double scale = depth_off(); scale != 1) {
    given_.cut.axial_depth_m *= scale;
    base_ = fitter_->calibrate_deeper(scale, base_);
    calibrate_again(2);
  }
  if (auto wrong = of_another_file()) return wrong;
  if (auto wrong = of_exchanged_axes()) return wrong;
  if (!cuts())
    return data_error(
        "the forces do not go with the teeth: nothing is cut, or spindle.angle_rad or "
        "[tool] teeth is that of another spindle or tool");
  const double ratio = base_.state.coefficients[0] / nominal_kt;
  if (!(ratio < criteria_.largest_model_error && ratio > 1 / criteria_.largest_model_error))
    return data_error(
        "the trace asks for tangential_coefficient_N_per_m2 = " +
        printed(base_.state.coefficients[0]) + ", the machine file says " + printed(nominal_kt) +
        "; check it, the feed, the depth, the diameter, the direction of the cut, and the axes and "
        "the calibration of the sensor");
  return std::nullopt;
}

/// What the axial depth would have to be, as a share of the file's: 1 unless the helix alone fits
/// clearly better with another lag, and the force is off by the same. One wrong number explains
/// both; a helix changes the lag alone.
double CuttingWorkflow::depth_off() const {
  const std::vector<Family> families = fitter_->families(base_);
  const auto helix = std::ranges::find(families, &HelixLagEffect::info, &Family::info);
  const double given = std::tan(rad_from_deg(given_.tool.helix_deg));
  if (helix == families.end() || !(std::abs(given) > 0)) return 1;
  const CutFit free = fitter_->fit({&*helix}, {0}, base_);
  if (!clearly_better(free, base_) || explained(base_, free) < criteria_.carries_gap) return 1;
  const double lag = std::tan(rad_from_deg(free.state.tool.helix_deg)) / given;
  const double force = free.state.coefficients[0] / given_.coefficients[0];
  const double most = criteria_.largest_model_error;
  if (!(lag > 1 / most && lag < most) || !(force > 0)) return 1;
  return std::abs(std::log(force / lag)) < criteria_.off_alike * std::abs(std::log(force)) ? lag
                                                                                           : 1;
}

/// Takes off the mean over each of `parts` angles, for each level, fitted or held out.
void CuttingWorkflow::take_off_means(Column& force_N, std::size_t parts) const {
  struct Mean {
    double value = 0, count = 0;
  };
  std::vector<Mean> means(2 * average_.levels.size() * parts);
  const auto mean_at = [&](std::size_t i) -> Mean& {
    const CutBlock& b = average_.blocks[average_.block_of[i]];
    const double turn = data_.angle_rad[i] / kTwoPi;
    const auto k = static_cast<std::size_t>((turn - std::floor(turn)) * static_cast<double>(parts));
    return means[(2 * b.level + (b.held_out ? 1 : 0)) * parts + std::min(k, parts - 1)];
  };
  for (std::size_t i = 0; i < force_N.size(); ++i) {
    if (average_.block_of[i] == CutAverage::kNone) continue;
    Mean& m = mean_at(i);
    ++m.count;
    m.value += (force_N[i] - m.value) / m.count;
  }
  for (std::size_t i = 0; i < force_N.size(); ++i)
    if (average_.block_of[i] != CutAverage::kNone) force_N[i] -= mean_at(i).value;
}

/// A mode of the file chatters from its natural frequency up to where the real part of its
/// receptance is -1/(2 K), K = Kt depth (Altintas 2012, eq. 3.10): w^2/wn^2 - 1 <= 2 K/k.
bool CuttingWorkflow::may_chatter(double frequency_hz) const {
  const double cut_N_per_m = std::abs(base_.state.coefficients[0]) * data_.cut.axial_depth_m;
  for (const auto* axis : {&data_.structure.x, &data_.structure.y})
    for (const StructuralMode& mode : *axis) {
      const double high = std::sqrt(1 + 2 * cut_N_per_m / mode.stiffness_N_per_m());
      const double ratio = frequency_hz / mode.natural_frequency_hz;
      if (ratio > 1 - mode.damping_ratio && ratio < high) return true;
    }
  return false;
}

/// What a model leaves at each sample, less what turns with the tool.
LineSearch CuttingWorkflow::left_over(const CutFit& fit) const {
  LineSearch s{data_.time_s,
               data_.feed_per_tooth_m,
               predicted(fit.state, false),
               predicted(fit.state, true),
               {},
               {},
               {},
               {}};
  const std::size_t n = data_.time_s.size();
  s.fitted.assign(n, false);
  s.held_out = s.fitted;
  for (std::size_t i = 0; i < n; ++i) {
    if (average_.block_of[i] == CutAverage::kNone) continue;
    (average_.blocks[average_.block_of[i]].held_out ? s.held_out : s.fitted)[i] = true;
    s.x_N[i] = data_.force_x_N[i] - s.x_N[i];
    s.y_N[i] = data_.force_y_N[i] - s.y_N[i];
  }
  s.finer_x_N = s.x_N;
  s.finer_y_N = s.y_N;
  double coarse = static_cast<double>(average_.bins);
  for (const CutLevel& level : average_.levels)
    if (level.samples_per_turn > 0) coarse = std::min(coarse, 0.7 * level.samples_per_turn);
  take_off_means(s.x_N, static_cast<std::size_t>(std::max(2.0, coarse)));
  take_off_means(s.y_N, static_cast<std::size_t>(std::max(2.0, coarse)));
  take_off_means(s.finer_x_N, average_.bins);
  take_off_means(s.finer_y_N, average_.bins);
  s.turn_hz = average_.levels[average_.blocks.front().level].speed_rad_s / kTwoPi;
  s.most_hz = kMostOrder * static_cast<double>(average_.bins) * s.turn_hz;
  s.least_N = floor_N();
  return s;
}

/// What is fixed in time makes the average noisier and explains nothing of the cut: off with it.
void CuttingWorkflow::remove_lines() {
  lines_ = find_lines(left_over(base_), criteria_);
  std::erase_if(lines_, [&](const TimeLockedLine& line) { return may_chatter(line.frequency_hz); });
  if (lines_.empty()) return;
  for (const TimeLockedLine& line : lines_)
    line.subtract_from(data_.time_s, data_.force_x_N, data_.force_y_N);
  calibrate_again(2);
}

void CuttingWorkflow::pictures(Report& report) const {
  report.time_s = data_.time_s;
  report.simulated_before = predicted(base_.state, false);
  report.simulated_after = predicted(found_.state, false);
  // Lines were taken off the measurement; in the picture they belong to the model.
  Column lines(data_.time_s.size(), 0), of_y = lines;
  for (const TimeLockedLine& line : lines_) line.subtract_from(data_.time_s, lines, of_y);
  report.measured = data_.force_x_N;
  report.compared.assign(data_.time_s.size(), false);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    report.measured[i] -= lines[i];
    report.simulated_after[i] -= lines[i];
    report.compared[i] = average_.block_of[i] != CutAverage::kNone;
  }
  report.mean_turn = mean_turn();
}

Expected<CuttingOutcome> CuttingWorkflow::run() {
  if (auto failed = calibrate()) return *failed;
  remove_lines();
  families_ = fitter_->families(base_);
  CuttingOutcome outcome;
  Report& report = outcome.report;
  report.channel = data_.channel;
  report.criteria = criteria_;
  report.gap_unit = "N";
  report.bad_signals = data_.bad_signals;
  report.remarks = data_.remarks;
  for (const auto& [column, sign] :
       {std::pair{".force_x_N", base_.state.sign_x}, std::pair{".force_y_N", base_.state.sign_y}})
    if (sign != (data_.channel == "tool" ? 1 : -1))
      report.remarks.push_back(data_.channel + column + " has the sign of the force on the " +
                               (data_.channel == "tool" ? "work" : "tool") +
                               " and is taken so; check the axes of the sensor");
  search();
  look_without_structure();
  name_effects(report);
  unsteady_N_ = unsteady_N(left_over(found_));
  prove(report);
  modulation_ = find_modulation(tooth_gains(found_), data_.tool.teeth,
                                std::sqrt(2.0) * floor_N() / average_.effort_N, criteria_);
  const std::size_t of_steady_cut = report.effects.size();
  name_transients(report);
  // What vibrates for itself modulates the cut, and has its name.
  if (report.effects.size() == of_steady_cut) tell_what_is_unsteady(report);
  judge(report);
  recalibrated(report);
  recorder_found(report);
  testability(report);
  maps(report, base_, found_);
  for (FoundEffect& e : report.effects)
    for (const ResidualMap& map : report.maps_before)
      if (map.variable == e.where) e.share_of_residual = map.share;
  pictures(report);
  report_lines(report);
  report.summary = summary_of(report, "cut");
  if (unsteady_) report.summary += "; " + why_nothing_;
  if (structure_doubted(report))
    report.summary += "; the modes of [structure.*] do not show, and were left out (see remarks)";
  return outcome;
}

Expected<CuttingOutcome> reconcile_cutting(const CuttingData& data, const Options& options) {
  return CuttingWorkflow(data, options).run();
}

}  // namespace servosense::reconcile
