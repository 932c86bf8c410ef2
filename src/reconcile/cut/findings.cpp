// What the report says beside the effects: maps, recalibrated parameters, what could not be tested.
#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

#include "reconcile/cut/workflow.hpp"
#include "reconcile/numerics/maps.hpp"
#include "reconcile/select/standing.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

constexpr std::size_t kMapBins = 48;

}  // namespace

/// Whether a cut with memory and one without differ by more than coefficients make up for. Where
/// the force hardly changes over the turn they do not: a slot with four teeth.
bool CuttingWorkflow::memory_shows() const {
  for (std::size_t f = 0; f < families_.size(); ++f) {
    if (!families_[f].regeneration) continue;
    const CutFit remembers = fit({f}, base_);
    double square = 0;
    for (const CutBlock& b : average_.blocks)
      if (!b.held_out)
        square +=
            (b.count.array() * (remembers.bins[b.level] - base_.bins[b.level]).array().square())
                .sum();
    return std::sqrt(square / samples_) > least_gain();
  }
  return false;
}

/// What these cuts could not have shown.
void CuttingWorkflow::testability(Report& report) const {
  const MillingTool& tool = data_.tool;
  double samples = std::numeric_limits<double>::infinity();
  for (const CutLevel& level : average_.levels)
    if (level.samples_per_turn > 0) samples = std::min(samples, level.samples_per_turn);
  const auto cannot = [&](const CuttingEffectInfo& info, const char* because,
                          const char* would_need) {
    report.not_testable.push_back({info.name, because, would_need});
  };
  // A steady vibration repeats with the tool. Teeth that are alike then find the wave that the one
  // before left just as they would leave it, and the chip is that of a stiff tool.
  const bool alike = teeth_alike(found_.state.tool);
  const auto named = [&](std::string_view name) { return reports_effect(report, name); };
  constexpr const char* kDisplacement =
      "the displacement of the tool beside its force, or a tap test; a cut near the limit of "
      "stability";
  const bool rigid = data_.structure.x.empty() && data_.structure.y.empty();
  for (const CuttingEffectInfo& info : kCuttingEffects) {
    const std::string_view name = info.name;
    if (name == "regeneration" && rigid)
      cannot(info,
             alike ? "teeth that cut alike leave no trace of it in the force of a steady cut"
                   : "without the displacement of the tool it cannot be told from the mode that "
                     "it comes with",
             kDisplacement);
    else if (name == "regeneration" && !named(name) && without_structure())
      cannot(
          info,
          "with teeth that cut alike a tool that remembers its vibration cuts like one that does "
          "not vibrate",
          "several changes of the feed in one cut; a tap test");
    else if (name == "regeneration" && given_.cut.regeneration)
      cannot(info, "the simulator already has it: the modes of the machine file regenerate",
             "[cut] regeneration = no, to compare with a cut that does not");
    else if (name == "regeneration" && !named(name) && !memory_shows())
      cannot(info, "in a force as even as this memory is no more than other cutting coefficients",
             "fewer teeth in the cut at a time: a smaller radial immersion");
    else if (name == "process-damping" && rigid)
      cannot(info, "neither the trace nor [structure.*] tells how fast the tool moves",
             info.splitting_experiment);
    else if (name == "extra-mode" && !rigid && !given_.cut.regeneration)
      cannot(info, "the modes of the machine file are not remembered, and one that cuts would be",
             "[cut] regeneration = yes");
    else if (name == "extra-mode" && alike && samples >= 10 && !named(name))
      cannot(
          info, "teeth that cut alike leave no trace of it in the force of a steady cut",
          "several changes of the feed in one cut; the displacement of the tool beside its force, "
          "or a tap test");
    else if (tool.teeth == 1 &&
             (name == "runout" || name == "missing-tooth" || name == "pitch-error"))
      cannot(info, "the tool has one tooth", "a tool with two teeth");
    else if (samples < 10 && (name == "sensor-resonance" || name == "extra-mode"))
      cannot(info, "too few samples in a revolution", "a higher sample rate or a slower spindle");
  }
  if (!fitter_->has_offset() && !tells_offset(with_offset(base_)))
    report.not_testable.push_back(
        {"sensor-offset",
         "the force hardly changes over the turn, and an offset of the sensor is no more than "
         "other cutting coefficients",
         "another feed; a smaller radial immersion; the sensor before or after the cut"});
}

Problem CuttingWorkflow::map_problem(const CutFit& fit, Column& residual) const {
  Problem p;
  p.unit = "N";
  const auto bins = static_cast<Eigen::Index>(average_.bins);
  // Thinned out to some 48 bins a direction, so that maps compare means, not samples.
  Coordinate tooth{"tooth-angle", "rad", {}, {}, 2 * kTwoPi, kMapBins};
  Coordinate turn{"tooth", "rad", {}, {}, 2 * kTwoPi, kMapBins};
  Coordinate chip{"chip-thickness", "m", {}, {}, 0, 24};
  Coordinate feed{"feed", "m", {}, {}, 0, 12};
  Coordinate time{"time", "s", {}, {}, 0, 24};
  for (const CutBlock& b : average_.blocks) {
    const CutLevel& level = average_.levels[b.level];
    for (Eigen::Index r = 0; r < 2 * bins; ++r) {
      if (!(b.count(r) > 0)) continue;
      const double angle = level.angles.means()[static_cast<std::size_t>(r % bins)];
      const double direction = r < bins ? 0 : kTwoPi;
      p.time_s.push_back(b.time_s);
      p.target.push_back(b.mean(r));
      p.usable.push_back(true);
      p.held_out.push_back(b.held_out);
      residual.push_back(b.mean(r) - fit.bins[b.level](r));
      const double pitches = (angle + fit.state.zero_rad) * data_.tool.teeth;
      tooth.values.push_back(pitches - kTwoPi * std::floor(pitches / kTwoPi) + direction);
      turn.values.push_back(angle + direction);
      chip.values.push_back(chip_thickness_m(fit.state, level.feed_per_tooth_m, angle) *
                            (r < bins ? 1 : -1));
      feed.values.push_back(level.feed_per_tooth_m);
      time.values.push_back(b.time_s);
    }
  }
  p.coordinates = {std::move(tooth), std::move(turn), std::move(chip), std::move(feed),
                   std::move(time)};
  return p;
}

void CuttingWorkflow::maps(Report& report, const CutFit& before, const CutFit& after) const {
  Column residual;
  const Problem first = map_problem(before, residual);
  report.maps_before = maps_of(first, residual, options_);
  residual.clear();
  const Problem last = map_problem(after, residual);
  report.maps_after = maps_of(last, residual, options_);
}

void CuttingWorkflow::recalibrated(Report& report) const {
  const CutState& s = found_.state;
  const CuttingForceLaw& law = data_.tool.force;
  const double kt = s.coefficients[0], kr = s.coefficients[1];
  report.recalibrated.push_back({"tangential_coefficient_N_per_m2",
                                 law.tangential_coefficient_N_per_m2, kt,
                                 found_.coefficient_errors(0)});
  report.recalibrated.push_back(
      {"radial_ratio", law.radial_ratio, kr / kt,
       std::hypot(found_.coefficient_errors(1), kr / kt * found_.coefficient_errors(0)) /
           std::abs(kt)});
  if (given_.edges) {
    report.recalibrated.push_back({"tangential_edge_N_per_m", law.tangential_edge_N_per_m,
                                   s.coefficients[2], found_.coefficient_errors(2)});
    report.recalibrated.push_back({"radial_edge_N_per_m", law.radial_edge_N_per_m,
                                   s.coefficients[3], found_.coefficient_errors(3)});
  }
  for (std::size_t i = 0; i < found_.unknowns.size(); ++i) {
    const double v = found_.values[i], e = found_.value_errors[i];
    if (found_.unknowns[i].kind == Unknown::Kind::immersion)
      report.recalibrated.push_back({"radial_immersion_m", data_.cut.radial_immersion_m,
                                     data_.cut.radial_immersion_m * v,
                                     data_.cut.radial_immersion_m * e});
    if (found_.unknowns[i].kind == Unknown::Kind::lag) {
      const double depth_m = given_.cut.axial_depth_m;
      report.recalibrated.push_back({"axial_depth_m", data_.cut.axial_depth_m,
                                     another_depth() ? depth_m : depth_m * v, depth_m * e});
    }
  }
}

/// Left out, and no memory was found that would explain it.
bool CuttingWorkflow::structure_doubted(const Report& report) const {
  return without_structure() && !reports_effect(report, RegenerationEffect::info.name);
}

/// How the recorder filters, and what the sensor shows without a cut.
void CuttingWorkflow::recorder_found(Report& report) const {
  if (fitter_->circular_paths())
    report.remarks.emplace_back(
        "the teeth go on circles that are moved on by the feed, chip h = f sin(phi), as in a "
        "simulation; the model does so too");
  if (structure_doubted(report))
    report.remarks.emplace_back(
        "the forces are those of a tool that does not vibrate, and the modes of [structure.*] were "
        "left out: either they are not those of this tool and machine (a tap test tells), or the "
        "cut remembers them, [cut] regeneration = yes, which teeth that cut alike do not show "
        "(changes of the feed in one cut do)");
  if (another_depth())
    report.remarks.push_back("[cut] axial_depth_m = " + printed(data_.cut.axial_depth_m) +
                             " does not go with the cut: "
                             "the lag of the helix and the size of the force both ask for " +
                             printed(given_.cut.axial_depth_m) + "; check it");
  if (filter_hz_ > 0)
    report.remarks.push_back("the record looks as after a filter against aliasing, cut-off near " +
                             printed(filter_hz_, 2) + " Hz; the model is filtered alike");
  if (!fitter_->has_offset()) return;
  const auto& [x, y] = found_.state.offset_N;
  report.remarks.push_back("the sensor has an offset of " + printed(x, 3) + " N along x and " +
                           printed(y, 3) + " N along y, as far as the cut tells; taken off");
}

void augment(MachineFile& machine, const CuttingOutcome& outcome, const std::string& provenance) {
  const Report& r = outcome.report;
  for (const Recalibrated& c : r.recalibrated) {
    const bool of_cut = c.parameter == "radial_immersion_m" || c.parameter == "axial_depth_m";
    // A depth that only the lag of the helix tells is reported, not changed: force goes with it.
    if (c.parameter == "axial_depth_m" && std::abs(c.to / c.from - 1) <= r.criteria.set_up_slack)
      continue;
    machine.set(of_cut ? "cut" : "tool", c.parameter, rounded(c.to),
                error_note(c.standard_error, 4));
  }
  for (const FoundEffect& e : r.effects) {
    const CuttingEffectInfo* info = find_cutting_effect(e.name);
    if (info == nullptr) continue;
    const std::string section = "effect." + std::string(info->channel) + "." + e.name;
    set_effect(machine, section, e, provenance, r.gap_unit, 4);
  }
}

/// At the feed with the most turns among those kept for the proof; among the others where the
/// angular zero has changed in between, since the fitted angle does not hold there.
MeanTurn CuttingWorkflow::mean_turn() const {
  MeanTurn picture;
  picture.held_out = !moved_;
  std::vector<double> samples(average_.levels.size(), 0);
  for (const CutBlock& b : average_.blocks)
    if (b.held_out == picture.held_out) samples[b.level] += 0.5 * b.count.sum();
  const auto level =
      static_cast<std::size_t>(std::max_element(samples.begin(), samples.end()) - samples.begin());
  const CutLevel& shown = average_.levels[level];
  if (!(samples[level] >= shown.samples_per_turn)) return picture;
  picture.turns = static_cast<std::size_t>(std::lround(samples[level] / shown.samples_per_turn));
  picture.feed_per_tooth_m = shown.feed_per_tooth_m;
  picture.angle_rad = shown.angles.means();

  const auto bins = static_cast<Eigen::Index>(average_.bins);
  const auto [mean, count] = average_.mean_of(level, picture.held_out);
  const Eigen::VectorXd before = fitter_->forces(base_.state)[level];
  const Eigen::VectorXd after = fitter_->forces(found_.state)[level];
  for (const bool y : {false, true}) {
    MeanTurn::Component c;
    c.name = y ? "force y" : "force x";
    for (Eigen::Index k = y ? bins : 0; k < (y ? 2 * bins : bins); ++k) {
      c.measured.push_back(count(k) > 0 ? mean(k) : std::numeric_limits<double>::quiet_NaN());
      c.before.push_back(before(k));
      c.after.push_back(after(k));
    }
    picture.components.push_back(std::move(c));
  }
  return picture;
}

}  // namespace servosense::reconcile
