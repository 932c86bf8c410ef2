#include <algorithm>
#include <cmath>

#include "reconcile/drive/closed_loop.hpp"
#include "reconcile/drive/free_run.hpp"
#include "reconcile/drive/workflow.hpp"

namespace servosense::reconcile {

Proof DriveWorkflow::prove_by_simulation(const DriveModelConfig& found) const {
  const auto model = [&](const DriveModelConfig& base, const std::vector<double>& coefficients) {
    FreeModel m{base, delay_s_};
    std::size_t at = 0;
    for (const KnownTerm& term : problem_.known) {
      const double value = coefficients[at++];
      set_parameter(m.drive, term.name, value);
      if (term.name == "timing") m.late_s += value;
      if (term.name == "constant load") {
        const EffectSetting* effect = base.effects.find(kConstantLoad);
        m.drive.constant_load = value - (effect != nullptr ? effect->scalar(0) : 0);
      }
    }
    m.drive.friction_knee = model_.friction_knee;
    return m;
  };
  if (decision_.steps.empty()) return {};
  const FreeModel before = model(given_, decision_.steps.front());
  FreeModel after = model(found, decision_.steps.back());
  if (const auto constant = constant_found())
    after.constant_ratio = constant_ratio(data_, *constant);

  Proof out;
  out.motion_unit = data_.turns() ? "rad" : "m";
  for (const Accepted& accepted : decision_.accepted)
    if (const std::string& name = candidates_[accepted.candidate].name;
        drive_effect_index(name) == kDriveEffectCount && name != kMotorTemperature)
      out.free_run.not_shown = out.closed_loop.not_shown = name + " comes from another drive";
  if (!out.free_run.not_shown.empty()) return out;
  const Report& r = decision_.report;
  FreeRunConditions conditions;
  conditions.from_s = r.held_from_s;
  conditions.to_s = r.held_to_s;
  conditions.least_speed = criteria_.at_speed * top_speed_;
  conditions.force_noise = r.floors.used;
  conditions.seed = options_.seed;
  // Simulations have the effect in the model.
  out.free_run = angle_corrected_ ? free_run(data_, DriveSignals(data_, signals_->corner_hz),
                                             before, after, conditions)
                                  : free_run(data_, *signals_, before, after, conditions);
  out.closed_loop =
      closed_loop(data_, before, after, signals_->corner_hz, r.held_from_s, r.held_to_s);
  return out;
}

/// Model and nuisances of the first record, on this one.
void DriveWorkflow::take_over(const DriveWorkflow& first) {
  set_up();
  model_ = first.model_;
  signals_->presliding_speed = first.signals_->presliding_speed;
  dropped_terms_ = first.dropped_terms_;
  presliding_found_ = first.presliding_found_;
  timing_open_ = first.timing_open_;
  constant_known_ = first.constant_known_;
  temperature_open_ = first.temperature_open_;
  delay_s_ = first.delay_s_;
  problem_.target = signals_->effort_rows(delay_s_);
  correct_angle_as_known();
  // Positions of both count from the same place.
  const double moved = data_.start_position - first.data_.start_position;
  for (double& x : signals_->position) x += moved;
  for (double& x : signals_->position_rows) x += moved;
  add_known_terms();
  if (first.away_) problem_.usable = away_from_reversals();
}

/// What was found, driven by the motion of another record.
std::vector<DriveWorkflow::EffectThere> DriveWorkflow::effects_there(
    const std::vector<Candidate>& candidates) const {
  std::vector<EffectThere> parts;
  for (const Accepted& accepted : decision_.accepted) {
    const Candidate& candidate = candidates_[accepted.candidate];
    EffectThere part;
    part.power_up = candidate.scope != "machine";
    for (const Candidate& c : candidates)
      if (c.name == candidate.name && c.columns && part.columns.empty())
        part.columns = c.columns(accepted.theta);
    if (part.columns.size() != accepted.coefficients.size()) part.columns.clear();
    parts.push_back(std::move(part));
  }
  return parts;
}

/// Gaps there without any effect, with the first, with the first two...
Column DriveWorkflow::gaps_there(const DriveWorkflow& w, const std::vector<EffectThere>& parts,
                                 const std::vector<std::size_t>& rows, const FitRows& anew) const {
  Column gap_at_step;
  for (std::size_t step = 0; step < decision_.steps.size(); ++step) {
    const std::vector<double>& c = decision_.steps[step];
    Column rest = w.problem_.target;
    std::size_t at = 0;
    std::vector<const Column*> open;
    for (const KnownTerm& term : w.problem_.known) {
      const bool nuisance =
          term.name == "presliding shape" || term.name == "stiff mode" || term.name == "timing";
      if (nuisance)
        open.push_back(&term.column);
      else
        add_to(rest, -c[at], term.column);
      ++at;
    }
    for (std::size_t k = 0; k < step; ++k) {
      const std::size_t own = decision_.accepted[k].coefficients.size();
      for (std::size_t j = 0; j < own && j < parts[k].columns.size(); ++j)
        if (parts[k].power_up)
          open.push_back(&parts[k].columns[j]);
        else
          add_to(rest, -c[at + j], parts[k].columns[j]);
      at += own;
    }
    if (!open.empty()) {
      Regression r(anew, rest);
      for (const Column* column : open) r.add(*column);
      const Fit fit = r.fit();
      Eigen::Index j = 0;
      for (const Column* column : open) add_to(rest, -fit.coefficients(j++), *column);
    }
    gap_at_step.push_back(rms_over(rest, rows));
  }
  return gap_at_step;
}

Expected<SecondRecord> DriveWorkflow::prove(const DriveData& second) const {
  DriveWorkflow w(second, options_, signals_->corner_hz);
  if (auto ok = w.check_motion(); !ok) return data_error("second record: " + ok.error().sentence);
  w.take_over(*this);
  // Ranges that effects refer to are those of the first record.
  DriveSituation s = w.situation();
  const DriveSituation first = situation();
  s.top_speed = first.top_speed;
  s.top_current_A = first.top_current_A;
  s.duration_s = first.duration_s;
  s.travel = first.travel;
  s.low = first.low;
  s.high = first.high;
  const std::vector<Candidate> candidates = drive_candidates(s);

  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < w.problem_.rows(); ++i)
    if (w.problem_.usable[i]) rows.push_back(i);
  const std::vector<EffectThere> parts = effects_there(candidates);
  // Nuisances are fitted again, with the effects and without. So is what a power-up changes, on a
  // part that then does not count.
  FitRows anew;
  anew.rows = rows;
  anew.first = {0, rows.size() / 2, rows.size()};
  if (std::any_of(parts.begin(), parts.end(), [](const EffectThere& p) { return p.power_up; })) {
    const std::size_t n = rows.size() / 3;
    anew.rows.assign(rows.begin(), rows.begin() + static_cast<long>(n));
    anew.first = {0, n / 2, n};
    rows.erase(rows.begin(), rows.begin() + static_cast<long>(n));
  }

  SecondRecord out;
  out.trace = second.source.empty() ? "second record" : second.source;
  out.from_s = w.problem_.time_s[rows.front()];
  out.to_s = w.problem_.time_s[rows.back()];
  out.effort_rms = rms_over(w.problem_.target, rows);
  const Column gap_at_step = gaps_there(w, parts, rows, anew);
  out.gap_before = gap_at_step.front();
  out.gap_after = gap_at_step.back();
  w.problem_.held_out = w.problem_.usable;
  out.gap_nominal = w.nominal_gap();
  for (std::size_t k = 0; k < parts.size(); ++k) {
    SecondGap gap{candidates_[decision_.accepted[k].candidate].name, gap_at_step[k],
                  gap_at_step[k + 1], false};
    // How much of it this motion calls up, at the size found on the first record.
    const Column own = weighted_sum(parts[k].columns, decision_.accepted[k].coefficients);
    gap.shown = !own.empty() &&
                rms_over(own, rows) > criteria_.least_gain_in_floors * decision_.report.floors.used;
    out.effects.push_back(std::move(gap));
  }
  return out;
}

}  // namespace servosense::reconcile
