#include "reconcile/drive/workflow.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "reconcile/drive/comparison_band.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

constexpr std::size_t kLeastRowsForClasses = 200;
constexpr double kLeastShareOfMotion = 0.5;  // of what the held-out share of it would be

/// Rows after which the motion repeats, from the velocity; 0 when it does not.
std::size_t find_laps(const Column& velocity, std::size_t end, double row_period_s) {
  // Thinned out to some 40 Hz: laps last seconds.
  const auto stride = std::max<std::size_t>(1, static_cast<std::size_t>(0.025 / row_period_s));
  Column v;
  for (std::size_t i = 0; i < end; i += stride) v.push_back(velocity[i]);
  const std::size_t n = v.size();
  const auto mismatch = [](const Column& x, std::size_t lag, std::size_t to) {
    double difference = 0, power = 0;
    for (std::size_t i = 0; i + lag < to; ++i) {
      difference += (x[i] - x[i + lag]) * (x[i] - x[i + lag]);
      power += x[i] * x[i] + x[i + lag] * x[i + lag];
    }
    return power > 0 ? difference / power : 1.0;
  };
  const auto shortest =
      static_cast<std::size_t>(1.0 / (static_cast<double>(stride) * row_period_s));
  std::size_t best = 0;
  double least = 0.02;  // of the power: the same program, not a similar one
  for (std::size_t lag = shortest; lag + std::max(shortest, n / 6) < n; ++lag) {
    const double m = mismatch(v, lag, n);
    if (m < 0.8 * least) {
      least = m;
      best = lag;
    }
  }
  if (best == 0) return 0;
  std::size_t lap = best * stride;
  least = std::numeric_limits<double>::infinity();
  const std::size_t from = lap > stride ? lap - stride : 1;
  for (std::size_t lag = from; lag <= best * stride + stride; ++lag) {
    const double m = mismatch(velocity, lag, end);
    if (m < least) {
      least = m;
      lap = lag;
    }
  }
  return lap;
}

/// Where the part that proves begins: the last share of the time, or of the motion where a drive
/// has come to rest by then.
std::size_t held_out_from(const std::vector<bool>& usable, double share) {
  const auto split = static_cast<std::size_t>((1 - share) * static_cast<double>(usable.size()));
  const auto moving = [&](std::size_t from) {
    return static_cast<double>(
        std::count(usable.begin() + static_cast<long>(from), usable.end(), true));
  };
  const double all = moving(0);
  if (moving(split) >= kLeastShareOfMotion * share * all) return split;
  std::size_t from = usable.size();
  for (double held = 0; from > 0 && held < share * all; --from) held += usable[from - 1] ? 1 : 0;
  return from;
}

}  // namespace

Expected<Done> DriveWorkflow::check_motion() {
  const auto [low, high] =
      std::minmax_element(signals_->position.begin(), signals_->position.end());
  const double travel = *high - *low;
  const char* unit = data_.turns() ? " rad" : " m";
  if (!(travel > criteria_.least_travel * model_.friction_knee))
    return data_error(channel_name() + ": the drive does not move (" + printed(travel) + unit +
                      " in all); record it moving without cutting, at several speeds in both "
                      "directions");
  std::size_t moving = 0, forward = 0;
  for (std::size_t i = 0; i < signals_->usable.size(); ++i) {
    if (!signals_->usable[i]) continue;
    ++moving;
    if (signals_->velocity_rows[i] > 0) ++forward;
    top_speed_ = std::max(top_speed_, std::abs(signals_->velocity_rows[i]));
  }
  const double motion_s = static_cast<double>(moving) * signals_->row_period_s();
  if (motion_s < criteria_.least_motion_s)
    return data_error(
        channel_name() + ": only " + printed(motion_s) +
        " s of usable motion: the rest stands, creeps, or lies beside samples that are "
        "missing or cut off; record at least 10 s at several speeds in both "
        "directions");
  const double share = static_cast<double>(forward) / static_cast<double>(moving);
  if (!(share > criteria_.least_each_way && share < 1 - criteria_.least_each_way))
    return data_error(channel_name() +
                      ": the record moves one way only, so friction, loads and most other "
                      "effects look alike; record moves in both directions");
  return Done{};
}

void DriveWorkflow::set_up() {
  problem_.unit = data_.turns() ? "Nm" : "N";
  problem_.row_period_s = signals_->row_period_s();
  problem_.noise_bandwidth_hz = signals_->corner_hz;
  problem_.encoder_floor = encoder_floor(data_, signals_->corner_hz, criteria_);
  problem_.usable = signals_->usable;
  problem_.usable.resize(signals_->rows(), false);
  const std::size_t n = signals_->rows();
  problem_.held_out.assign(n, false);
  const std::size_t split = held_out_from(problem_.usable, options_.held_out_share);
  for (std::size_t i = 0; i < n; ++i) {
    problem_.time_s.push_back(data_.start_s + static_cast<double>(i) * problem_.row_period_s);
    problem_.held_out[i] = i >= split;
  }
  problem_.target = signals_->effort_rows(0);
  problem_.lap_rows = find_laps(signals_->velocity_rows, split, problem_.row_period_s);
  const DriveEffectsConfig& effects = data_.model.effects;
  constant_known_ = data_.model.constant_load != 0 || effects.find(kConstantLoad) != nullptr;
  temperature_open_ = data_.constant.per_K != 0 && motor_warms();
}

double DriveWorkflow::nominal_gap() const {
  const Keys keys = keys_of(data_.turns());
  Column r = signals_->effort_rows(0);
  double load = data_.model.constant_load;
  if (const EffectSetting* s = data_.model.effects.find(kConstantLoad)) load += s->scalar(0);
  for (const KnownTerm& term : problem_.known) {
    if (term.name == keys.coulomb)
      add_to(r, -term.nominal, signals_->direction_rows(data_.model.friction_knee));
    else
      add_to(r, -term.nominal, term.column);
  }
  for (double& v : r) v -= load;
  return rms_over(r, fit_rows(problem_, 1, true).rows);
}

DriveSituation DriveWorkflow::situation() const {
  DriveSituation s;
  s.data = &data_;
  s.signals = signals_;
  s.criteria = &criteria_;
  s.model = model_;
  s.acting = with_found();
  s.top_speed = top_speed_;
  if (data_.model.effort_per_ampere > 0)
    for (const double u : signals_->effort_rows(0))
      s.top_current_A = std::max(s.top_current_A, std::abs(u) / data_.model.effort_per_ampere);
  s.duration_s = problem_.time_s.back() - problem_.time_s.front();
  const auto [low, high] =
      std::minmax_element(signals_->position.begin(), signals_->position.end());
  s.travel = *high - *low;
  s.low = std::numeric_limits<double>::infinity();
  s.high = -s.low;
  for (std::size_t i = 0; i < problem_.rows(); ++i)
    if (problem_.usable[i] && !problem_.held_out[i]) {
      s.low = std::min(s.low, signals_->position_rows[i]);
      s.high = std::max(s.high, signals_->position_rows[i]);
    }
  s.constant_known = constant_known_;
  s.timing_open = timing_open_;
  s.read_late = lateness_s_ < 0;
  s.known_lag_s = known_lag_s_;
  s.backlash = backlash_;
  s.presliding_alone = std::max(presliding_alone_, model_.friction_knee);
  s.limit_cycle = limit_cycle_;
  std::tie(s.lowest_C, s.highest_C) = temperatures();
  if (s.top_current_A > 0 && motor_warms()) s.per_kelvin = effort_per_kelvin();
  return s;
}

/// A constant load that the model has is refitted like inertia and friction.
void DriveWorkflow::recalibrate_load(DriveOutcome& outcome, double value, double error) const {
  DriveEffectsConfig& effects = outcome.model.effects;
  for (std::size_t i = 0; i < effects.count; ++i) {
    EffectSetting& setting = effects.settings[i];
    if (setting.effect != drive_effect_index(kConstantLoad)) continue;
    const double from = setting.scalar(0), to = value - data_.model.constant_load;
    if (from != 0) outcome.sizes.push_back({kConstantLoad, to / from, std::abs(error / from)});
    setting.parameters[0].value[0] = to;
    outcome.report.recalibrated.push_back({load_key(data_.turns()), from, to, error});
  }
}

/// Of the file's eccentric encoder, where it is not that of the file.
void DriveWorkflow::report_phase(Report& report) const {
  const EffectSetting* from = data_.model.effects.find(kEccentricity);
  const EffectSetting* to = given_.effects.find(kEccentricity);
  if (from != nullptr && from->scalar(1) != to->scalar(1))
    report.recalibrated.push_back(
        {kEccentricityPhase, from->scalar(1), to->scalar(1), phase_error_});
}

const Accepted* DriveWorkflow::eccentricity() const {
  for (const Accepted& accepted : decision_.accepted)
    if (candidates_[accepted.candidate].name == kEccentricity) return &accepted;
  return nullptr;
}

bool DriveWorkflow::correct_angle_by(const EffectSetting& error) {
  return signals_->correct_angle(error.scalar(0) * model_.unit_per_turn / kTwoPi, error.scalar(1),
                                 model_.unit_per_turn);
}

/// The first pass takes the error of an eccentric encoder at the angle measured: what that leaves
/// is of the second order, by the amplitude in radians, but twice a turn, where it accelerates four
/// times as much. With the error known the true angle is, too.
void DriveWorkflow::correct_angle() {
  constexpr int kRounds = 3;  // each leaves the amplitude's share of what the last one left
  const Accepted* found = eccentricity();
  if (found == nullptr) return;
  Meaning meaning = found->meaning;
  for (int round = 0; round < kRounds; ++round) {
    if (!correct_angle_by(meaning)) return;
    angle_corrected_ = true;
    add_known_terms();
    offer();
    const FitRows rows = fit_rows(problem_, options_.blocks);
    Regression r = regression_of_known(problem_, rows);
    std::size_t from = 0;
    for (const Accepted& accepted : decision_.accepted) {
      if (&accepted == found) from = static_cast<std::size_t>(r.columns());
      for (const Column& column : candidates_[accepted.candidate].columns(accepted.theta))
        r.add(column);
    }
    const Fit fit = r.fit();
    // The size of the error is that of its force over the inertia, which was fitted without it.
    Eigen::Index at = 0;
    for (const KnownTerm& term : problem_.known)
      set_parameter(model_, term.name, fit.coefficients(at++));
    std::vector<double> own;
    for (std::size_t k = 0; k < found->coefficients.size(); ++k)
      own.push_back(fit.coefficients(static_cast<Eigen::Index>(from + k)));
    meaning = candidates_[found->candidate].meaning(found->theta, own);
  }
  add_coordinates();
}

void DriveWorkflow::offer() {
  candidates_ = drive_candidates(situation());
  for (Candidate& c : candidates_)
    if (std::ranges::find(refuted_, c.name) != refuted_.end())
      c.refuted = "does not hold on the second record";
}

void DriveWorkflow::decide_by(const Options& options) {
  offer();
  decision_ = decide(problem_, candidates_, options);
}

/// What the model had, as fitted.
void DriveWorkflow::report_parameters(DriveOutcome& outcome) const {
  report_phase(outcome.report);
  report_known_effects(outcome.report);
  report_constant(outcome.report);
  std::size_t at = 0;
  for (const KnownTerm& term : problem_.known) {
    const double error = decision_.known_errors[at];
    const double value = decision_.known[at++];
    if (drive_effect_index(term.name) != kDriveEffectCount)
      outcome.sizes.push_back({term.name, value, error});
    if (term.name == "constant load") recalibrate_load(outcome, value, error);
    set_parameter(outcome.model, term.name, value);
    remark_on_size(outcome.report, term, value);
    if (term.name == keys_of(data_.turns()).coulomb)
      outcome.model.friction_knee = model_.friction_knee;
  }
}

/// What was missing, as it goes into the model.
void DriveWorkflow::report_accepted(DriveOutcome& outcome) const {
  for (const Accepted& accepted : decision_.accepted) {
    const std::string& name = candidates_[accepted.candidate].name;
    if (drive_effect_index(name) == kDriveEffectCount) continue;
    if (name == "transport-delay" && lateness_s_ < 0) {
      outcome.report.remarks.emplace_back(
          "the effort is read that much behind the motion and the model cannot look ahead: it does "
          "without the delay; record both at the same instant");
      continue;
    }
    if (name == "transport-delay" || name == "current-loop-lag") remark_on_timing(outcome.report);
    outcome.added.push_back(setting_of(name, accepted.meaning, data_.turns()));
    add_effect(outcome.model.effects, outcome.added.back());
  }
}

Expected<DriveOutcome> DriveWorkflow::run(const std::vector<SecondGap>& refuted) {
  for (const SecondGap& gap : refuted) refuted_.push_back(gap.name);
  if (auto ok = check_motion(); !ok) return ok.error();
  set_up();
  correct_angle_as_known();
  if (auto ok = calibrate(); !ok) return ok.error();
  add_coordinates();
  Options first = options_;
  first.before_recalibration = true;
  decide_by(first);
  refit_presliding_beside_backlash(first);
  if (!decision_.accepted.empty()) {
    DriveWorkflow again = trial();
    if (auto ok = again.repeat_with_accepted(); !ok) return ok.error();
    if (!(again.decision_.loss > criteria_.much_worse * decision_.loss)) adopt(std::move(again));
  }
  if (decision_.accepted.empty()) decide_away_from_reversals();

  DriveOutcome outcome;
  outcome.report = decision_.report;
  outcome.report.channel = channel_name();
  outcome.report.criteria = criteria_;
  outcome.report.gap_nominal = nominal_gap();
  outcome.report.timing_s = lateness_s_;
  outcome.report.bad_signals = data_.bad_signals;
  outcome.report.remarks = data_.remarks;
  if (has_limit_cycle()) outcome.report.remarks.push_back(advice_on(limit_cycle_, data_.turns()));
  if (away_)
    outcome.report.remarks.emplace_back(
        "compared away from reversals only: just after them friction does what no known effect "
        "explains");
  outcome.model = given_;
  report_parameters(outcome);
  report_accepted(outcome);
  outcome.constant = constant_found();
  // A scale shows the error itself, not its acceleration: there the last of it counts.
  if (const Accepted* found = angle_corrected_ ? eccentricity() : nullptr)
    correct_angle_by(found->meaning);
  add_from_scale(outcome);
  outcome.report.proof = prove_by_simulation(outcome.model);
  if (std::ranges::find(refuted_, "flexible-coupling") == refuted_.end())
    look_in_wider_bands(outcome);
  outcome.report.summary = summary_of(outcome.report, channel_name());
  return outcome;
}

Report DriveWorkflow::refused(const Error& why) {
  Report r;
  r.channel = channel_name();
  r.criteria = criteria_;
  r.verdict = Verdict::unexplained;
  r.summary = r.residual_detail = why.sentence;
  r.residual_white = false;
  for (std::size_t i = 0; i < kDriveEffectCount; ++i)
    r.not_testable.push_back(
        {kDriveEffects[i].name, why.sentence, kDriveEffectTraits[i].splitting_motion});
  const auto usable =
      static_cast<std::size_t>(std::count(signals_->usable.begin(), signals_->usable.end(), true));
  if (usable < kLeastRowsForClasses) return r;
  (void)check_motion();  // for the top speed
  problem_ = {};
  set_up();
  problem_.held_out.assign(problem_.rows(), false);
  problem_.known.clear();
  add_known(keys_of(data_.turns()).inertia, signals_->acceleration_rows, data_.model.inertia, true);
  std::vector<Candidate> candidates = drive_candidates(situation());
  // What the model has already is no better known here than what it lacks.
  const auto also = [&](const char* name, const Column& column) {
    if (std::any_of(candidates.begin(), candidates.end(),
                    [&](const Candidate& c) { return c.name == name; }))
      return;
    Candidate c;
    c.name = name;
    c.splitting_motion = kDriveEffectTraits[drive_effect_index(name)].splitting_motion;
    c.columns = [column](std::span<const double>) { return std::vector<Column>{column}; };
    candidates.push_back(std::move(c));
  };
  also("viscous-friction", signals_->velocity_rows);
  also("coulomb-friction", signals_->direction_rows(model_.friction_knee));
  r.classes = classes_of(problem_, candidates, options_);
  return r;
}

Report refusal(const DriveData& data, const Error& why, const Options& options) {
  return DriveWorkflow(data, options, comparison_corner(data, options.criteria)).refused(why);
}

Expected<DriveOutcome> reconcile_drive(const DriveData& data, const Options& options,
                                       const DriveData* second) {
  for (const DriveData* record : {&data, second})
    if (record != nullptr && record->samples.size() < 100)
      return data_error(std::string(servosense::name_of(data.channel)) + ": only " +
                        std::to_string(record->samples.size()) +
                        " samples; record at least 10 s of motion without cutting");
  double corner = comparison_corner(data, options.criteria);
  if (second != nullptr) corner = std::min(corner, comparison_corner(*second, options.criteria));
  std::vector<SecondGap> refuted;
  for (;;) {
    auto [workflow, outcome] = run_in_band(data, options, corner, refuted);
    if (!outcome || second == nullptr) return outcome;
    auto proof = workflow->prove(*second);
    if (!proof) return proof.error();
    const std::size_t before = refuted.size();
    for (std::size_t k = 0; k < proof->effects.size(); ++k) {
      const SecondGap& there = proof->effects[k];
      const FoundEffect& here = outcome->report.effects[k];
      const auto closed = [](double from, double to) { return 1 - to * to / (from * from); };
      // It must pay there by a fair part of what it paid here.
      if (there.shown &&
          !(closed(there.gap_before, there.gap_after) >
            options.criteria.least_held_out_share * closed(here.gap_before, here.gap_after)))
        refuted.push_back(there);
    }
    if (auto mode = workflow->mode_on(*second, *proof))
      (mode->gap_after < mode->gap_before ? proof->effects : refuted).push_back(std::move(*mode));
    if (refuted.size() > before) continue;
    proof->refuted = refuted;
    outcome->report.second = std::move(*proof);
    outcome->report.summary =
        summary_of(outcome->report, std::string(servosense::name_of(data.channel)));
    return outcome;
  }
}

void augment(MachineFile& machine, const DriveOutcome& outcome, const std::string& provenance) {
  const Report& r = outcome.report;
  const Channel channel = channel_from(r.channel).value_or(Channel::x);
  const bool turns = is_turning(channel);
  const Keys keys = keys_of(turns);
  const std::string section(section_of(channel));
  for (const Recalibrated& c : r.recalibrated) {
    if (c.parameter == keys.inertia || c.parameter == keys.viscous || c.parameter == keys.coulomb)
      machine.set(section, c.parameter, rounded(std::max(0.0, c.to)),
                  error_note(c.standard_error, 3));
  }
  for (const Recalibrated& c : r.recalibrated)
    if (c.parameter == load_key(turns))
      machine.set("effect." + r.channel + "." + kConstantLoad, turns ? "torque_Nm" : "force_N",
                  rounded(c.to), error_note(c.standard_error, 3));
  if (machine.number(section, keys.coulomb).value_or(0) > 0)
    machine.set(section, turns ? "friction_knee_rad" : "friction_knee_m",
                rounded(outcome.model.friction_knee));
  for (const Recalibrated& c : r.recalibrated)
    if (c.parameter == kPerKelvin)
      machine.set(section, kPerKelvinKey, rounded(c.to), error_note(c.standard_error, 3));
    else if (const std::size_t blank = c.parameter.find(' '); blank != std::string::npos)
      machine.set("effect." + r.channel + "." + c.parameter.substr(0, blank),
                  c.parameter.substr(blank + 1), rounded(c.to), error_note(c.standard_error, 3));
  for (const FoundEffect& e : r.effects) {
    if (e.name == kLeadError) continue;  // not of the motor's encoder, on which the model rests
    if (e.name == kMotorTemperature)
      write_constant(machine, section, e, provenance);
    else
      set_effect(machine, "effect." + r.channel + "." + e.name, e, provenance, r.gap_unit, 3);
  }
}

}  // namespace servosense::reconcile
