#include "servosense/identify/idle.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <utility>

#include "idle_design.hpp"
#include "idle_regression.hpp"
#include "idle_torque_constant.hpp"
#include "servosense/dsp/first_order.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

using idle_fit::Column;
using idle_fit::Columns;
using idle_fit::condition;
using idle_fit::floor_of;
using idle_fit::IdleDesign;
using idle_fit::regress;
using idle_fit::Regression;

constexpr double kLeastTravel = 20;  // in knees: less shows no friction
// A record whose reversals all rest in between does not show the knee: the one tried first stays.
constexpr double kBetterKnee = 0.995;
constexpr double kWorstCondition = 1e3;  // of the normalised regressors
constexpr double kWorstSpeeds = 15;      // of speed and its sign: two speeds within a factor of 1.3
// Residual over the change of the effort (rms both): beyond it the motion explains less than three
// quarters of the power, and what it does not explain decides what the fit says.
constexpr double kWorstResidual = 0.5;
// Width of a band of speeds, and what its torque constant must be known to: 5 % is within the error
// of any such constant.
constexpr double kBand = 1.05;
constexpr double kKnownWithin = 0.05;
constexpr double kPoorInertia = 0.1;  // share of it: convention; worse is sought at lower cutoffs
constexpr double kLeastCutoff_rad_s = 30;  // a move of 0.1 s is still seen
constexpr double kLeastEvidence = 2;       // standard errors from nothing to an inertia

bool is_elastic(const EffectSetting& setting) {
  return setting.effect == drive_effect_index("backlash") ||
         setting.effect == drive_effect_index("flexible-coupling");
}

/// `base` at a cutoff fit for the fit, without what is to be identified.
DisturbanceObserverConfig bare(const DisturbanceObserverConfig& base, double cutoff) {
  DisturbanceObserverConfig c = base;
  c.disturbance_cutoff_rad_s = std::min(c.disturbance_cutoff_rad_s, cutoff);
  c.velocity_cutoff_rad_s = std::min(c.velocity_cutoff_rad_s, cutoff);
  c.drive.inertia = c.drive.viscous = c.drive.coulomb = c.drive.constant_load = 0;
  // Play and springs share out the very inertia that is looked for: the fit takes the drive as
  // rigid.
  DriveEffectsConfig& effects = c.drive.effects;
  const auto end = effects.settings.begin() + static_cast<std::ptrdiff_t>(effects.count);
  const auto kept = std::remove_if(effects.settings.begin(), end, is_elastic);
  effects.count = static_cast<std::size_t>(kept - effects.settings.begin());
  return c;
}

using Observer = DisturbanceObserver<double>;

/// The steps that an effort comes in, and its rms change.
struct Steps {
  double step = 0, change = 0;
};
Steps steps_of(const DriveRecord& record) {
  std::vector<double> sorted;
  sorted.reserve(record.samples.size());
  for (const DriveSample<double>& s : record.samples) sorted.push_back(s.effort);
  std::sort(sorted.begin(), sorted.end());
  constexpr double kSame = 1e-9;  // of the range: one value, rounded twice
  const double range = sorted.back() - sorted.front();
  Steps found{range, 0};
  double mean = 0, square = 0;
  const auto n = static_cast<double>(sorted.size());
  for (const double e : sorted) mean += e / n;
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    square += (sorted[i] - mean) * (sorted[i] - mean) / n;
    const double step = i > 0 ? sorted[i] - sorted[i - 1] : 0;
    if (step > kSame * range) found.step = std::min(found.step, step);
  }
  found.change = std::sqrt(square);
  return found;
}

/// Between the ends of the motion [m or rad].
double travel_of(const DriveRecord& record) {
  double at = 0;
  double least = 0;
  double most = 0;
  for (const DriveSample<double>& sample : record.samples) {
    at += sample.increment;
    least = std::min(least, at);
    most = std::max(most, at);
  }
  return most - least;
}

/// A fit with one knee of the friction.
struct IdleFit {
  Column coulomb;
  double knee = 0;
  Regression regression;

  [[nodiscard]] Columns columns(const IdleDesign& design, bool with_load) const {
    return design.columns(coulomb, with_load);
  }
};

/// Adds to the standard errors what the model may lack, seen by how far the parameters move when
/// speeds are left out (friction that is no straight line), when the effort may act late (current
/// loop, held sample) and when the filters are half as fast (noise of the encoder, springs). A
/// drive that is as the model says moves none of them.
void add_model_error(IdleFit& fit, const IdleDesign& design,
                     const DisturbanceObserverConfig& config, const DriveRecord& record,
                     bool with_load, const IdleOptions& options) {
  Regression& r = fit.regression;
  const Columns columns = fit.columns(design, with_load);
  Eigen::VectorXd squares = moved_by_speeds(r, columns, design.output, design.speed);

  const Column delay = design.delay(r.parameters(0), r.parameters(1));
  Columns with_delay = columns;
  with_delay.push_back(&delay);
  const Eigen::VectorXd late = regress(with_delay, design.output, design.lag()).parameters;
  squares += (late.head(r.parameters.size()) - r.parameters).cwiseAbs2();

  DisturbanceObserverConfig slow = config;
  slow.disturbance_cutoff_rad_s /= 2;
  slow.velocity_cutoff_rad_s /= 2;
  const IdleDesign slower(slow, record, options);
  if (slower.motion_s() > 0.5 * design.motion_s()) {
    const IdleFit again{.coulomb = slower.coulomb(fit.knee), .knee = fit.knee, .regression = {}};
    squares += moved_by(r, regress(again.columns(slower, with_load), slower.output, slower.lag()));
  }
  r.standard_errors = (r.standard_errors.array().square() + squares.array()).sqrt().matrix();
}

/// The highest speed up to which the torque of inertia shows the torque constant: in a band of
/// speeds the error of the inertia is that of the whole record, as much larger as less is
/// accelerated there.
double shown_to(const IdleDesign& design, const Estimate& inertia) {
  std::vector<std::pair<double, double>> rows;  // speed, square of the acceleration; fastest first
  double whole = 0;
  for (std::size_t i = 0; i < design.viscous.size(); ++i) {
    rows.emplace_back(std::abs(design.viscous[i]), design.inertia[i] * design.inertia[i]);
    whole += rows.back().second;
  }
  std::sort(rows.begin(), rows.end(), std::greater<>());
  const double error = inertia.standard_error / (kKnownWithin * inertia.value);
  const double needed = error * error * whole;
  double band = 0;
  std::size_t end = 0;
  for (const auto& [speed, square] : rows) {
    while (end < rows.size() && rows[end].first > speed / kBand) band += rows[end++].second;
    if (band > needed) return speed;
    band -= square;
  }
  return 0;
}

}  // namespace

DriveModelConfig identified_drive(const DriveModelConfig& base, const IdleIdentification& found) {
  DriveModelConfig c = base;
  c.inertia = found.inertia.value;
  c.viscous = found.viscous.value;
  c.coulomb = found.coulomb.value;
  c.constant_load = found.constant_load.value;
  c.friction_knee = found.friction_knee;
  for (const auto& effect : {found.field_weakening, found.torque_saturation})
    if (effect && c.effects.find(kDriveEffects[effect->effect].name) == nullptr &&
        c.effects.count < kMaxActiveEffects)
      c.effects.settings[c.effects.count++] = *effect;
  return c;
}

bool drive_stands(const DisturbanceObserverConfig& observer, const DriveRecord& record) {
  return !(travel_of(record) > kLeastTravel * observer.drive.friction_knee);
}

namespace {

/// A fit at one cutoff; `why` tells a refusal, `drowned` whether noise may be its reason.
Expected<IdleIdentification> identify_at(double cutoff_rad_s, const DisturbanceObserverConfig& base,
                                         const DriveRecord& record, const IdleOptions& options,
                                         IdleRefusal& why, bool& drowned) {
  const auto refuse = [&](IdleRefusal refusal, std::string sentence) {
    why = refusal;
    return data_error(std::move(sentence));
  };
  why = IdleRefusal::none;
  drowned = false;
  const std::string who = std::string(name_of(record.channel));
  DisturbanceObserverConfig config = bare(base, cutoff_rad_s);
  config.sample_period_s = record.sample_period_s;
  // Its own cutoffs too: the floor is stated for them, and they may be too high for the record.
  DisturbanceObserverConfig own = config;
  own.disturbance_cutoff_rad_s = base.disturbance_cutoff_rad_s;
  own.velocity_cutoff_rad_s = base.velocity_cutoff_rad_s;
  for (const auto& c : {config, own})
    if (const Status status = Observer::validate(c); !status.ok())
      return data_error(who + ": " + status.parameter() + " " + status.reason());
  if (record.samples.empty())
    return refuse(IdleRefusal::effort, who + ": the record holds no sample");
  const double first = record.samples.front().effort;
  if (std::all_of(record.samples.begin(), record.samples.end(),
                  [&](const DriveSample<double>& s) { return s.effort == first; }))
    return refuse(IdleRefusal::effort,
                  who + ": the effort never changes (" + printed(first) +
                      " throughout); check that its column is filled and is this drive's");
  const double travel = travel_of(record);
  if (drive_stands(config, record))
    return refuse(IdleRefusal::stands, who + ": the drive does not move (" + printed(travel) +
                                           (is_turning(record.channel) ? " rad" : " m") +
                                           " in all); record idle motion at several speeds, or run "
                                           "'servosense identify presliding' on a drive that is "
                                           "pushed without breaking away");

  auto made = std::make_unique<IdleDesign>(config, record, options);
  IdleIdentification found;
  found.fit_cutoff_rad_s = config.disturbance_cutoff_rad_s;
  found.motion_s = made->motion_s();
  if (found.motion_s < options.shortest_motion_s)
    return refuse(IdleRefusal::motion,
                  who + ": the drive moves for only " + printed(found.motion_s) +
                      " s of the record; record at least " + printed(options.shortest_motion_s) +
                      " s of idle motion at several speeds");

  const double share = made->forward_share();
  const bool both_ways = share > 0.05 && share < 0.95;
  const bool spindle = is_spindle(record.channel);
  if (!both_ways && !spindle)
    return refuse(
        IdleRefusal::motion,
        who +
            ": the record moves one way only, so Coulomb friction and a constant load cannot "
            "be told apart; record moves in both directions");
  found.constant_load_fitted = both_ways;
  if (!both_ways)
    found.remarks.push_back(
        who + " turns one way only: a constant load would be counted as Coulomb friction");

  if (config.drive.effects.count < base.drive.effects.count)
    found.remarks.push_back(who +
                            " is fitted as if rigid: play and springs of the machine file "
                            "share out the inertia found here");

  idle_fit::TorqueConstantTaken constant;
  std::vector<double> knees = options.knees;
  if (knees.empty()) knees = {config.drive.friction_knee};
  {
    const IdleFit trial{
        .coulomb = made->coulomb(knees.front()), .knee = knees.front(), .regression = {}};
    const Columns columns = trial.columns(*made, both_ways);
    const double worst = condition(columns);
    if (!(condition({&made->viscous, &trial.coulomb}) < kWorstSpeeds))
      return refuse(IdleRefusal::motion,
                    who +
                        ": the record moves at one speed only, so viscous and Coulomb friction "
                        "cannot be told apart; record at least two speeds that differ by a "
                        "factor of three");
    if (!(worst < kWorstCondition))
      return refuse(IdleRefusal::motion,
                    who + ": the motion does not show inertia and friction apart (condition " +
                        printed(worst) +
                        "); record moves that accelerate hard and run at several speeds");
    constant = idle_fit::take_torque_constant(config, record, options, both_ways, found);
  }
  const DriveRecord& fitted_record = constant.calm ? *constant.calm : record;
  if (constant.falls) made = std::make_unique<IdleDesign>(config, fitted_record, options);
  const IdleDesign& design = *made;
  IdleFit best;
  bool have = false;
  for (const double candidate : knees) {
    IdleFit fit{.coulomb = design.coulomb(candidate), .knee = candidate, .regression = {}};
    fit.regression = regress(fit.columns(design, both_ways), design.output, design.lag());
    if (!have || fit.regression.residual_rms < kBetterKnee * best.regression.residual_rms) {
      best = std::move(fit);
      have = true;
    }
  }
  add_model_error(best, design, config, fitted_record, both_ways, options);
  for (Eigen::Index i = 0; i < 3; ++i) {
    double& error = best.regression.standard_errors(i);
    error = std::hypot(error, constant.errors(i));
  }
  found.friction_knee = best.knee;
  const Regression& regression = best.regression;
  auto estimate = [&](Eigen::Index i) {
    return Estimate{regression.parameters(i), regression.standard_errors(i)};
  };
  found.inertia = estimate(0);
  found.viscous = estimate(1);
  found.coulomb = estimate(2);
  if (both_ways) found.constant_load = estimate(3);
  Eigen::Index next = both_ways ? 4 : 3;
  if (options.losses) {
    found.constant_loss = estimate(next++);
    found.copper_loss = estimate(next++);
  }
  found.residual_rms = regression.residual_rms;
  found.residual_share = regression.residual_rms / regression.output_spread;
  for (const double speed : design.speed)
    found.highest_speed = std::max(found.highest_speed, std::abs(speed));
  found.constant_known_to = shown_to(design, found.inertia);
  drowned = !(found.residual_share < kWorstResidual) ||
            found.inertia.value < kLeastEvidence * found.inertia.standard_error;
  if (!(found.residual_share < kWorstResidual))
    return refuse(IdleRefusal::effort,
                  who + ": the motion explains too little of the effort (" +
                      printed(100 * found.residual_share, 3) +
                      " % of its change is left, at most " + printed(100 * kWorstResidual) +
                      " % may be); check that the effort column is this drive's and "
                      "has a sign, and that nothing was cut");
  if (!(found.inertia.value > 0))
    return refuse(IdleRefusal::effort,
                  who + ": the fitted inertia is " + printed(found.inertia.value) +
                      ", which is impossible; check the sign and scale of the effort column");
  if (found.inertia.value < kLeastEvidence * found.inertia.standard_error)
    return refuse(IdleRefusal::motion,
                  who + ": the record does not show the inertia (" + printed(found.inertia.value) +
                      " +- " + printed(found.inertia.standard_error) +
                      "); record hard accelerations and decelerations through the same speeds, in "
                      "both directions where the drive can");
  // What rounding takes is noise only where the effort runs through many steps.
  if (const Steps coarse = steps_of(record); coarse.step > coarse.change)
    return refuse(IdleRefusal::effort, who + ": the effort comes in steps of " +
                                           printed(coarse.step) + " and changes by " +
                                           printed(coarse.change) +
                                           " rms: too coarse; record it with more digits");
  // Errors carry what the model does not explain: an effort that is cut off or comes in few steps
  // shows here.
  const double friction_error = found.viscous.standard_error * found.highest_speed;
  if (friction_error > regression.output_spread)
    return refuse(
        IdleRefusal::effort,
        who + ": the record does not show the friction: its error at the highest speed, " +
            printed(friction_error) + ", is more than the effort changes, " +
            printed(regression.output_spread) +
            " rms; check that the effort is not cut off and does not come in a few steps, "
            "or record more speeds");
  const auto shown = [](const Estimate& e) {
    return std::abs(e.value) >= kLeastEvidence * e.standard_error;
  };
  if (!shown(found.viscous) && !shown(found.coulomb)) {
    const RunningEffort both = running_effort(record);
    found.remarks.push_back(who +
                            ": the record does not tell viscous and Coulomb friction apart; "
                            "together they are " +
                            printed(both.effort) + " at " + printed(both.speed) +
                            (is_turning(record.channel) ? " rad/s" : " m/s"));
  }
  // Negative friction within its error is none; beyond it, it is a Stribeck curve seen from above.
  // The rest is fitted without it (Lawson and Hanson 1974), else it would carry what this one took.
  Columns columns = best.columns(design, both_ways);
  std::vector<Estimate*> fitted = {&found.inertia, &found.viscous, &found.coulomb};
  if (both_ways) fitted.push_back(&found.constant_load);
  if (options.losses)
    for (Estimate* loss : {&found.constant_loss, &found.copper_loss}) fitted.push_back(loss);
  const auto fit_without = [&](Estimate& e) {
    e.value = 0;
    const auto at = std::find(fitted.begin(), fitted.end(), &e) - fitted.begin();
    columns.erase(columns.begin() + at);
    fitted.erase(fitted.begin() + at);
    const Regression rest = regress(columns, design.output, design.lag());
    for (std::size_t i = 0; i < fitted.size(); ++i)
      fitted[i]->value = rest.parameters(static_cast<Eigen::Index>(i));
  };
  const auto keep_physical = [&](Estimate& e, const char* what) {
    if (e.value >= 0) return;
    found.remarks.push_back(who + ": " + what + " friction came out negative (" + printed(e.value) +
                            " +- " + printed(e.standard_error) + ") and is set to zero" +
                            (shown(e) ? ": friction falls with speed here" : ""));
    fit_without(e);
  };
  // Nor is a loss: what is off already may be too much, where nothing is the fit has the rest.
  if (options.losses)
    for (const auto& [e, taken] : {std::pair{&found.constant_loss, options.losses->constant_W},
                                   std::pair{&found.copper_loss, options.losses->copper_W_per_Nm2}})
      if (e->value < 0 && taken == 0) fit_without(*e);
  keep_physical(found.viscous, "viscous");
  keep_physical(found.coulomb, "Coulomb");

  DisturbanceObserverConfig final_config = base;
  final_config.sample_period_s = record.sample_period_s;
  final_config.drive = identified_drive(base.drive, found);
  if (const Status status = Observer::validate(final_config); !status.ok())
    return refuse(IdleRefusal::effort, who + ": " + status.parameter() + " " + status.reason());
  found.floor = floor_of(final_config, record, options.false_alarm_rate_per_hour);
  return found;
}

double relative_error(const Estimate& e) { return e.standard_error / e.value; }

}  // namespace

// The noise of an encoder in the acceleration grows with the square of the cutoff, what the moves
// hold does not: where it drowns the inertia, the fit is made at a lower one.
Expected<IdleIdentification> identify_idle(const DisturbanceObserverConfig& base,
                                           const DriveRecord& record, const IdleOptions& options,
                                           IdleRefusal* why) {
  IdleRefusal refusal = IdleRefusal::none;
  bool drowned = false;
  auto best = identify_at(options.highest_cutoff_rad_s, base, record, options, refusal, drowned);
  if (why != nullptr) *why = refusal;
  const double first = std::min(
      {options.highest_cutoff_rad_s, base.disturbance_cutoff_rad_s, base.velocity_cutoff_rad_s});
  const auto is_poor = [&] {
    return best ? relative_error(best->inertia) > kPoorInertia : drowned;
  };
  if (!is_poor()) return best;
  for (double cutoff = first / 2; cutoff >= kLeastCutoff_rad_s; cutoff /= 2) {
    IdleRefusal now = IdleRefusal::none;
    bool still = false;
    auto lower = identify_at(cutoff, base, record, options, now, still);
    if (!lower || (best && !(relative_error(lower->inertia) < relative_error(best->inertia))))
      continue;
    best = std::move(lower);
    if (why != nullptr) *why = IdleRefusal::none;
  }
  return best;
}

}  // namespace servosense
