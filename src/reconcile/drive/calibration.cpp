// Stage 2: what the model has, refitted; and what is allowed for without a name.
#include <algorithm>
#include <cmath>
#include <limits>

#include "reconcile/drive/controller_delay.hpp"
#include "reconcile/drive/workflow.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kSlowestPresliding = 1e-4;
constexpr double kPreslidingLadder = 60;  // from the shortest to the longest that is tried

}  // namespace

void DriveWorkflow::add_known_terms(bool with_coulomb) {
  problem_.known.clear();
  const Keys keys = keys_of(data_.turns());
  with_coulomb = with_coulomb || coulomb_found_;
  add_known(keys.inertia, signals_->reported_acceleration, data_.model.inertia, true);
  if (data_.model.viscous > 0)
    add_known(keys.viscous, signals_->reported_velocity, data_.model.viscous, true);
  const bool shapes = !dropped("presliding shape");
  Column sign;
  if (data_.model.coulomb > 0 || with_coulomb || shapes || signals_->presliding_speed > 0)
    sign = signals_->kept_direction_rows(model_.friction_knee);
  if (data_.model.coulomb > 0 || with_coulomb)
    add_known(keys.coulomb, sign, data_.model.coulomb, true);
  // The way friction swings over within the presliding distance: laws differ, and none is to be
  // named for it. A bristle and its damping, and elements that slip sooner and later (Al-Bender,
  // Lampaert and Swevers 2005).
  if (shapes) {
    add_known("presliding shape",
              difference(signals_->kept_bristle_rows(model_.friction_knee), sign), 0, false);
    for (const double factor : {1 / criteria_.presliding_span, criteria_.presliding_span})
      add_known("presliding shape",
                difference(signals_->kept_direction_rows(factor * model_.friction_knee), sign), 0,
                false);
    if (model_.coulomb > 0)
      add_known("presliding shape", signals_->kept_bristle_damping(model_), 0, false);
  }
  if (signals_->presliding_speed > 0)
    add_known("presliding speed",
              difference(signals_->speed_direction_rows(signals_->presliding_speed), sign), 0,
              false);
  // Every machine has a mode above the band; its foot within the band is not to be named.
  const std::size_t coupling = drive_effect_index("flexible-coupling");
  if (data_.model.effects.find("flexible-coupling") == nullptr)
    add_known(
        "stiff mode",
        signals_->response(effect_with(coupling, {4 * signals_->corner_hz, 0.05, 0.5}), model_), 0,
        false);
  if (constant_known_) add_known("constant load", Column(signals_->rows(), 1.0), 0, false);
  for (std::size_t i = 0; i < data_.model.effects.count; ++i) {
    const EffectSetting& s = given_.effects.settings[i];
    if (s.effect == drive_effect_index(kConstantLoad)) continue;
    Column column = signals_->response(s, data_.model);
    if (!column.empty()) add_known(kDriveEffects[s.effect].name, std::move(column), 1, false);
  }
  for (const Column& column : found_) add_known("found", column, 0, false);
  if (temperature_open_ && !dropped(kMotorTemperature))
    add_known(kMotorTemperature, effort_per_kelvin(), 0, false);
  if (!timing_open_) {
    Column later = signals_->effort_rows(delay_s_ + 0.5e-3);
    const Column sooner = signals_->effort_rows(delay_s_ - 0.5e-3);
    for (std::size_t i = 0; i < later.size(); ++i) later[i] = (sooner[i] - later[i]) * 1e3;
    add_known("timing", std::move(later), 0, false);
  }
}

Fit DriveWorkflow::fit_known(double least_speed) const {
  FitRows rows = fit_rows(problem_, options_.blocks);
  if (least_speed > 0) {
    std::erase_if(rows.rows, [&](std::size_t i) {
      return std::abs(signals_->velocity_rows[i]) < least_speed;
    });
    rows = in_blocks(std::move(rows.rows), rows.blocks());
  }
  return regression_of_known(problem_, rows).fit();
}

/// A known term as a fit has it; nothing where there is none of that name.
std::optional<Told> DriveWorkflow::fitted(const Fit& fit, std::string_view term) const {
  const auto found = std::ranges::find(problem_.known, term, &KnownTerm::name);
  if (found == problem_.known.end()) return {};
  const Eigen::Index at = found - problem_.known.begin();
  return Told{fit.coefficients(at), fit.standard_errors(at)};
}

/// An eccentric encoder reports accelerations that are not there: the inertia fitted without its
/// error comes out too small, by any factor, and with it the error too large. Where it carries
/// most of the residual, what the model has is fitted beside it.
Fit DriveWorkflow::fit_beside_eccentricity() const {
  Fit fit = fit_known();
  if (!found_.empty() || !(model_.unit_per_turn > 0) ||
      data_.model.effects.find(kEccentricity) != nullptr)
    return fit;
  const FitRows rows = fit_rows(problem_, options_.blocks);
  Regression r = regression_of_known(problem_, rows);
  for (const double phase : {0.0, kTwoPi / 4}) {
    const Column column =
        signals_->response(effect_with(drive_effect_index(kEccentricity), {0.05, phase}), model_);
    if (column.empty()) return fit;
    r.add(column);
  }
  Fit beside = r.fit();
  return beside.loss < criteria_.eccentricity_carries * fit.loss ? beside : fit;
}

/// A shape that is allowed for but does not pay on rows left out would only do harm there.
void DriveWorkflow::drop_needless_terms() {
  dropped_terms_.clear();
  for (const char* name : {"stiff mode", "presliding shape", kMotorTemperature}) {
    add_known_terms();
    const double with = fit_known().loss;
    dropped_terms_.emplace_back(name);
    add_known_terms();
    if (!(fit_known().loss < with)) dropped_terms_.pop_back();
  }
  add_known_terms();
  if (presliding_beyond_reason()) {
    dropped_terms_.emplace_back("presliding shape");
    add_known_terms();
  }
}

double DriveWorkflow::largest_effort() const {
  double most = 0;
  for (std::size_t i = 0; i < problem_.rows(); ++i)
    if (problem_.usable[i]) most = std::max(most, std::abs(problem_.target[i]));
  return most;
}

/// Few reversals leave the shapes of the presliding distance undetermined: what cancels in the fit
/// does not where the motion is another one. Between sliding one way and the other, friction is no
/// further off than the two are apart.
bool DriveWorkflow::presliding_beyond_reason() const {
  const Fit fit = fit_known();
  Column shapes(problem_.rows(), 0);
  const auto sliding = fitted(fit, keys_of(data_.turns()).coulomb);
  const double coulomb =
      sliding ? std::abs(sliding->value) : std::numeric_limits<double>::infinity();
  const auto follows = fitted(fit, "presliding speed");
  for (std::size_t k = 0; k < problem_.known.size(); ++k)
    if (problem_.known[k].name == "presliding shape")
      add_to(shapes, fit.coefficients(static_cast<Eigen::Index>(k)), problem_.known[k].column);
  double most = 0;
  for (std::size_t i = 0; i < shapes.size(); ++i)
    if (problem_.usable[i]) most = std::max(most, std::abs(shapes[i]));
  return most > std::min(criteria_.most_friction * largest_effort(), 2 * coulomb) ||
         (follows && std::abs(follows->value) > criteria_.most_friction * coulomb);
}

void DriveWorkflow::set_parameter(DriveModelConfig& model, const std::string& term,
                                  double value) const {
  const Keys keys = keys_of(data_.turns());
  if (term == keys.inertia) model.inertia = value;
  if (term == keys.viscous) model.viscous = std::max(0.0, value);
  if (term == keys.coulomb) model.coulomb = std::max(0.0, value);
}

/// Whether the effort acts no later than the way drives sample explains. A servo period of
/// computing passes before or behind what is reported: what of it has passed before, cannot behind.
/// Nor can the current loop. Then half a period is left, for which the effort is held.
bool DriveWorkflow::timing_is_usual() {
  const double half = data_.servo_period_s / 2;
  if (std::abs(delay_s_) - criteria_.timing_slack_s <= half) return true;
  if (delay_s_ > 0 &&
      controller_delay_of_record().least_s > criteria_.periods_without_loop * data_.servo_period_s)
    return false;
  const double slack = data_.expected_lag_s > 0 ? criteria_.timing_slack_s : criteria_.untold_lag_s;
  const double late = std::abs(delay_s_) - data_.expected_lag_s - slack;
  if (late <= half || late > data_.servo_period_s) return late <= half;
  const double answer = controller_delay_of_record().least_s;
  if (answer <= 0) return true;
  const double period = std::min(data_.servo_period_s, criteria_.slowest_servo_s);
  return late <= std::max(period / 2, period - answer);
}

const ControllerDelay& DriveWorkflow::controller_delay_of_record() {
  if (!controller_delay_)
    controller_delay_ = controller_delay(data_, *signals_, problem_, criteria_);
  return *controller_delay_;
}

/// What the file tells of the time that passes behind the reported effort, and that the effort is
/// held for. Where the report comes sooner than the current loop can have answered, the loop is
/// still to come; else what is reported has it behind it already, or may have.
double DriveWorkflow::known_lag_s() {
  if (!(data_.expected_lag_s > 0) || !(controller_delay_of_record().most_s < data_.expected_lag_s))
    return 0;
  return data_.expected_lag_s + data_.servo_period_s / 2;
}

/// Friction that was far from what the file says: of this machine?
void DriveWorkflow::remark_on_size(Report& report, const KnownTerm& term, double value) const {
  const Keys keys = keys_of(data_.turns());
  if (term.name != keys.viscous && term.name != keys.coulomb) return;
  const double ratio = value / term.nominal;
  if (!(term.nominal > 0) ||
      (ratio < criteria_.largest_model_error && ratio > 1 / criteria_.largest_model_error))
    return;
  report.remarks.push_back(term.name + ": the machine file says " + printed(term.nominal) +
                           ", this record " + printed(value) +
                           "; check that the file is of this machine, and how warm it was");
}

/// Of what a delay or a lag consists.
void DriveWorkflow::remark_on_timing(Report& report) const {
  const std::string section = "[controller." + channel_name() + "]";
  if (known_lag_s_ > 0)
    report.remarks.push_back("the lateness is what comes on top of " +
                             printed(1e3 * known_lag_s_, 3) + " ms that " + section +
                             " tells and the effort is held for");
  else
    report.remarks.push_back(
        "the lateness is all that passes from the reported effort to the motion: if that is what "
        "the current loop is told, the loop itself is part of it");
}

/// Friction that follows the speed, however slow, instead of the travel (regularised as by tanh, as
/// simulators have it): then most of it does. The shapes of the presliding distance stand in for
/// that over the reversals of the fit and are wrong at others, so this law is tried without them,
/// and goes before them where it does most of what they do.
void DriveWorkflow::fit_presliding_speed() {
  signals_->presliding_speed = 0;
  add_known_terms(true);
  const double shaped = fit_known().loss;
  const std::vector<std::string> dropped = dropped_terms_;
  dropped_terms_.emplace_back("presliding shape");
  add_known_terms(true);
  const double plain = fit_known().loss;
  double best = 0, least = criteria_.presliding_speed_pays * plain;
  const auto consider = [&](double speed) {
    if (!(speed > 0 && speed <= criteria_.slow_speed * top_speed_)) return;
    signals_->presliding_speed = speed;
    add_known_terms(true);
    const Fit fit = fit_known();
    const Told follows = fitted(fit, "presliding speed").value_or(Told{});
    const double all = fitted(fit, keys_of(data_.turns()).coulomb).value_or(Told{}).value;
    if (!(follows.value > std::max(criteria_.follows_speed * all,
                                   criteria_.sure_standard_errors * follows.error) &&
          all > 0 && fit.loss < least))
      return;
    least = fit.loss;
    best = speed;
  };
  for (double speed = criteria_.slow_speed * top_speed_; speed > kSlowestPresliding * top_speed_;
       speed /= 2)
    consider(speed);
  for (double step = 1.4; best > 0 && step > 1.04; step = std::sqrt(step)) {
    const double middle = best;
    consider(middle * step);
    consider(middle / step);
  }
  dropped_terms_ = dropped;
  signals_->presliding_speed =
      plain - least < criteria_.most_of_shapes * (plain - shaped) ? 0 : best;
}

double DriveWorkflow::longest_presliding() const {
  return 2 * std::max(data_.model.friction_knee, usual_presliding(data_.model, data_.channel));
}
double DriveWorkflow::shortest_presliding() const {
  return std::max(longest_presliding() / kPreslidingLadder, 2 * std::abs(data_.unit_per_count));
}

/// The time by which the effort is late, and whether that is to be explained.
void DriveWorkflow::fit_timing() {
  timing_open_ = false;
  // What acts at reversals and gaps looks late too: a delay must also be there at speed.
  for (const double least_speed : {0.0, criteria_.at_speed * top_speed_}) {
    if (least_speed > 0 && timing_is_usual()) break;
    for (int round = 0; round < 3; ++round) {
      problem_.target = signals_->effort_rows(delay_s_);
      add_known_terms();
      const Fit fit = fit_known(least_speed);
      const double late = fit.coefficients(fit.coefficients.size() - 1);
      delay_s_ = std::clamp(delay_s_ + late, -0.01, 0.01);
    }
  }
  lateness_s_ = delay_s_;
  timing_open_ = !timing_is_usual();
  if (timing_open_) delay_s_ = 0;
  known_lag_s_ = timing_open_ ? known_lag_s() : 0;
}

/// Stage 2: the presliding distance, the timing and what the model has.
Expected<Done> DriveWorkflow::calibrate() {
  dropped_terms_.clear();
  refit_known_effects();
  // The presliding distance first: friction laws differ in it, and nothing is to be named for that.
  // With Coulomb friction even where the model has none: if it is missing, its presliding distance
  // is known then.
  if (!presliding_found_) {
    const double given = data_.model.friction_knee;
    // Beside backlash that was found the ladder begins at the presliding distance found with it: it
    // may be among the shortest.
    const double widest = longest_beside_backlash_ > 0
                              ? std::min(longest_presliding(), longest_beside_backlash_)
                              : longest_presliding();
    const double narrowest = std::min(shortest_presliding(), widest);
    double best = given, least = std::numeric_limits<double>::infinity();
    const auto consider = [&](double presliding) {
      if (!(presliding >= narrowest && presliding <= 1.001 * widest)) return;
      model_.friction_knee = presliding;
      add_known_terms(true);
      const double square = fit_known().mean_square;
      if (square < least) {
        least = square;
        best = presliding;
      }
    };
    for (double presliding = widest; presliding >= narrowest; presliding /= 1.5)
      consider(presliding);
    for (double step = 1.22; step > 1.02; step = std::sqrt(step)) {
      const double middle = best;
      consider(middle * step);
      consider(middle / step);
    }
    model_.friction_knee = best;
    fit_presliding_speed();
  }
  timing_open_ = timing_found_;
  if (!timing_found_) fit_timing();
  problem_.target = signals_->effort_rows(delay_s_);
  refit_known_effects();
  drop_needless_terms();
  const Fit fit = fit_beside_eccentricity();
  std::size_t at = 0;
  double viscous = 0;
  for (const KnownTerm& term : problem_.known) {
    const double value = fit.coefficients(static_cast<Eigen::Index>(at++));
    if (!coulomb_found_ || term.name != keys_of(data_.turns()).coulomb)
      set_parameter(model_, term.name, value);
    if (term.name == keys_of(data_.turns()).viscous) viscous = value;
    if (term.name == "constant load") model_.constant_load = value;
  }
  const double ratio = model_.inertia / data_.model.inertia;
  if (!(ratio > 0))
    return data_error(
        channel_name() + ": the effort does not accelerate the drive (fitted " +
        keys_of(data_.turns()).inertia + " " + printed(model_.inertia) +
        "); check that the effort column is alive and has the right sign, and record harder "
        "accelerations");
  if (!(ratio < criteria_.largest_model_error && ratio > 1 / criteria_.largest_model_error))
    return data_error(channel_name() + ": the trace asks for " + keys_of(data_.turns()).inertia +
                      " = " + printed(model_.inertia) + ", the machine file says " +
                      printed(data_.model.inertia) +
                      "; check it, the lead, the encoder and the force constant, or let "
                      "'servosense identify idle' find them");
  // At one speed viscous and Coulomb friction may grow against each other without end.
  if (std::max(model_.coulomb, std::abs(viscous) * top_speed_) >
      criteria_.most_friction * largest_effort())
    return data_error(channel_name() +
                      ": the speeds of this record do not tell viscous from Coulomb friction; "
                      "record moves at several speeds in both directions");
  return Done{};
}

}  // namespace servosense::reconcile
