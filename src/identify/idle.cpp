#include "servosense/identify/idle.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "servosense/dsp/first_order.hpp"

namespace servosense {
namespace {

constexpr double kHacLag_s = 0.1;
constexpr double kStandstill_s =
    0.05;  // slower than the least speed for longer than this: standing
constexpr double kLeastSpeedShare = 0.01;  // of the highest speed
constexpr double kLeastTravel = 20;        // in knees: less shows no friction
// A record whose reversals all rest in between does not show the knee: the one tried first stays.
constexpr double kBetterKnee = 0.995;
constexpr double kWorstCondition = 1e3;  // of the normalised regressors
constexpr double kWorstSpeeds = 15;      // of speed and its sign: two speeds within a factor of 1.3
constexpr double kDetectionQuantile = 2.326;  // standard normal, 99 %

std::string printed(double value, const char* format = "%.4g") {
  char text[32];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

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

/// Response of an observer to the record, with the motor's effort left out if `motion_only`.
std::vector<double> response(const DisturbanceObserverConfig& config, const DriveRecord& record,
                             bool motion_only) {
  Observer observer;
  observer.configure(config);
  std::vector<double> out;
  out.reserve(record.samples.size());
  for (DriveSample<double> sample : record.samples) {
    if (motion_only) sample.effort = 0;
    out.push_back(observer.process(sample));
  }
  return out;
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

struct Regression {
  Eigen::VectorXd parameters;
  Eigen::VectorXd standard_errors;
  double residual_rms = 0;
  double output_rms = 0;
};

/// Ordinary least squares. The errors allow for correlated residuals (Bartlett weights
/// up to `lag` rows) and are the larger of two: by Newey and West (1987), which lets the residual
/// vary with the motion but hangs on the few accelerations of a record and then states too little,
/// and from the residual's autocovariance over the whole record.
Regression regress(const std::vector<const std::vector<double>*>& columns,
                   const std::vector<double>& output, std::size_t lag) {
  const auto n = static_cast<Eigen::Index>(output.size());
  const auto k = static_cast<Eigen::Index>(columns.size());
  Eigen::MatrixXd x(n, k);
  for (Eigen::Index j = 0; j < k; ++j)
    x.col(j) = Eigen::Map<const Eigen::VectorXd>(columns[static_cast<std::size_t>(j)]->data(), n);
  const Eigen::Map<const Eigen::VectorXd> y(output.data(), n);
  Regression r;
  const Eigen::MatrixXd inverse = (x.transpose() * x).ldlt().solve(Eigen::MatrixXd::Identity(k, k));
  r.parameters = x.colPivHouseholderQr().solve(y);
  const Eigen::VectorXd e = y - x * r.parameters;
  const Eigen::MatrixXd score = x.array().colwise() * e.array();
  Eigen::MatrixXd local = score.transpose() * score;
  Eigen::MatrixXd pooled = e.squaredNorm() / static_cast<double>(n) * (x.transpose() * x);
  const auto longest = std::min<Eigen::Index>(static_cast<Eigen::Index>(lag), n - 1);
  for (Eigen::Index l = 1; l <= longest; ++l) {
    const double weight = 1 - static_cast<double>(l) / static_cast<double>(longest + 1);
    const Eigen::MatrixXd scores = score.bottomRows(n - l).transpose() * score.topRows(n - l);
    local += weight * (scores + scores.transpose());
    const double covariance = e.tail(n - l).dot(e.head(n - l)) / static_cast<double>(n);
    const Eigen::MatrixXd motions = x.bottomRows(n - l).transpose() * x.topRows(n - l);
    pooled += weight * covariance * (motions + motions.transpose());
  }
  const double freedom =
      static_cast<double>(n) / static_cast<double>(std::max<Eigen::Index>(n - k, 1));
  const auto variances = [&](const Eigen::MatrixXd& middle) -> Eigen::VectorXd {
    return freedom * (inverse * middle * inverse).diagonal();
  };
  r.standard_errors = variances(local).cwiseMax(variances(pooled)).cwiseMax(0).cwiseSqrt();
  r.residual_rms = std::sqrt(e.squaredNorm() / static_cast<double>(n));
  r.output_rms = std::sqrt(y.squaredNorm() / static_cast<double>(n));
  return r;
}

/// Condition number of the regressors after scaling each to unit length.
double condition(const std::vector<const std::vector<double>*>& columns) {
  const auto k = static_cast<Eigen::Index>(columns.size());
  const auto column = [&](Eigen::Index j) {
    const std::vector<double>& c = *columns[static_cast<std::size_t>(j)];
    return Eigen::Map<const Eigen::VectorXd>(c.data(), static_cast<Eigen::Index>(c.size()));
  };
  Eigen::MatrixXd gram(k, k);
  for (Eigen::Index i = 0; i < k; ++i)
    for (Eigen::Index j = 0; j < k; ++j) gram(i, j) = column(i).dot(column(j));
  const Eigen::VectorXd scale = gram.diagonal().cwiseSqrt();
  for (Eigen::Index i = 0; i < k; ++i)
    for (Eigen::Index j = 0; j < k; ++j) gram(i, j) /= std::max(scale(i) * scale(j), 1e-300);
  const Eigen::VectorXd eigen = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(gram).eigenvalues();
  return std::sqrt(eigen.maxCoeff() / std::max(eigen.minCoeff(), 1e-300));
}

DetectabilityFloor floor_of(const DisturbanceObserverConfig& observer, const DriveRecord& record,
                            double false_alarm_rate_per_hour) {
  const std::vector<double> estimate = response(observer, record, false);
  const std::vector<bool> moving = samples_in_motion(observer, record);
  DetectabilityFloor floor;
  floor.false_alarm_rate_per_hour = false_alarm_rate_per_hour;
  double sum = 0;
  std::size_t n = 0;
  for (std::size_t i = 0; i < estimate.size(); ++i)
    if (moving[i]) {
      sum += estimate[i];
      ++n;
    }
  if (n == 0) return floor;
  const double mean = sum / static_cast<double>(n);
  double square = 0;
  std::size_t crossings = 0;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    if (!moving[i]) continue;
    const double d = estimate[i] - mean;
    square += d * d;
    floor.noise_peak = std::max(floor.noise_peak, std::abs(d));
    if (i > 0 && moving[i - 1] && (estimate[i - 1] - mean) * d < 0) ++crossings;
  }
  floor.noise_rms = std::sqrt(square / static_cast<double>(n));
  const double seconds = static_cast<double>(n) * record.sample_period_s;
  floor.crossing_rate_hz = static_cast<double>(std::max<std::size_t>(crossings, 1)) / seconds;
  // Rice (1944): a Gaussian signal leaves the band mean +- h at the rate of its mean crossings
  // times exp(-h^2 / 2 sigma^2). Friction leaves peaks that no Gaussian has: what the idle run
  // itself reached is the least threshold.
  const double allowed_hz = false_alarm_rate_per_hour / 3600;
  const double rice = std::sqrt(2 * std::max(0.0, std::log(floor.crossing_rate_hz / allowed_hz)));
  floor.threshold = std::max(floor.noise_rms * rice, floor.noise_peak);
  floor.smallest_step = floor.threshold + kDetectionQuantile * floor.noise_rms;
  return floor;
}

}  // namespace

std::vector<bool> samples_in_motion(const DisturbanceObserverConfig& observer,
                                    const DriveRecord& record) {
  PseudoDerivative<double> velocity;
  velocity.configure(
      {observer.velocity_cutoff_rad_s, record.sample_period_s, observer.discretisation});
  std::vector<double> speed;
  speed.reserve(record.samples.size());
  double highest = 0;
  for (const DriveSample<double>& sample : record.samples) {
    speed.push_back(std::abs(velocity.process(sample.increment)));
    highest = std::max(highest, speed.back());
  }
  const double least = kLeastSpeedShare * highest;
  const auto standstill = static_cast<std::size_t>(kStandstill_s / record.sample_period_s) + 1;
  const auto settle = static_cast<std::size_t>(
      10 * (1 / observer.disturbance_cutoff_rad_s + 1 / observer.velocity_cutoff_rad_s) /
      record.sample_period_s);
  std::vector<bool> moving(speed.size(), false);
  std::size_t slow = standstill;  // samples in a row below the least speed
  std::size_t since = 0;          // samples since motion began or a fault ended
  for (std::size_t i = 0; i < speed.size(); ++i) {
    slow = speed[i] > least ? 0 : slow + 1;
    const bool faulty =
        has(record.samples[i].quality, kUnusable | Quality::gap | Quality::restarted);
    since = slow >= standstill || faulty ? 0 : since + 1;
    moving[i] = since > settle && slow == 0;
  }
  return moving;
}

DriveModelConfig identified_drive(const DriveModelConfig& base, const IdleIdentification& found) {
  DriveModelConfig c = base;
  c.inertia = found.inertia.value;
  c.viscous = found.viscous.value;
  c.coulomb = found.coulomb.value;
  c.constant_load = found.constant_load.value;
  c.friction_knee = found.friction_knee;
  return c;
}

Expected<IdleIdentification> identify_idle(const DisturbanceObserverConfig& base,
                                           const DriveRecord& record, const IdleOptions& options) {
  const std::string who = std::string(name_of(record.channel));
  DisturbanceObserverConfig config = bare(base, options.highest_cutoff_rad_s);
  config.sample_period_s = record.sample_period_s;
  // Its own cutoffs too: the floor is stated for them, and they may be too high for the record.
  DisturbanceObserverConfig own = config;
  own.disturbance_cutoff_rad_s = base.disturbance_cutoff_rad_s;
  own.velocity_cutoff_rad_s = base.velocity_cutoff_rad_s;
  for (const auto& c : {config, own})
    if (const Status status = Observer::validate(c); !status.ok())
      return data_error(who + ": " + status.parameter() + " " + status.reason());
  if (record.samples.empty()) return data_error(who + ": the record holds no sample");
  const double travel = travel_of(record);
  if (!(travel > kLeastTravel * config.drive.friction_knee))
    return data_error(who + ": the drive does not move (" + printed(travel) +
                      (record.channel == Channel::spindle ? " rad" : " m") +
                      " in all); record idle motion at several speeds");

  const std::vector<bool> moving = samples_in_motion(config, record);
  std::vector<std::size_t> rows;
  // Samples closer than the filters' memory tell nothing new: take means over blocks of them. To
  // pick one of each block instead would turn the encoder's pattern at some speeds into an offset.
  const auto block = std::max<std::size_t>(
      1,
      static_cast<std::size_t>(0.25 / (config.disturbance_cutoff_rad_s * record.sample_period_s)));
  for (std::size_t i = 0; i + block <= moving.size(); i += block) {
    const auto from = moving.begin() + static_cast<std::ptrdiff_t>(i);
    if (!std::all_of(from, from + static_cast<std::ptrdiff_t>(block), [](bool b) { return b; }))
      continue;
    rows.push_back(i);
  }
  const auto in_motion = [&](const std::vector<double>& all) {
    std::vector<double> means;
    means.reserve(rows.size());
    for (const std::size_t i : rows) {
      double sum = 0;
      for (std::size_t j = i; j < i + block; ++j) sum += all[j];
      means.push_back(sum / static_cast<double>(block));
    }
    return means;
  };
  IdleIdentification found;
  found.fit_cutoff_rad_s = config.disturbance_cutoff_rad_s;
  found.motion_s = static_cast<double>(rows.size() * block) * record.sample_period_s;
  if (found.motion_s < options.shortest_motion_s)
    return data_error(who + ": the drive moves for only " + printed(found.motion_s) +
                      " s of the record; record at least " + printed(options.shortest_motion_s) +
                      " s of idle motion at several speeds");

  // One observer a parameter: with the effort left out, each reads minus its own term.
  auto unit_response = [&](double DriveModelConfig::*parameter, double knee) {
    DisturbanceObserverConfig c = config;
    c.drive.effects.count = 0;
    c.drive.*parameter = 1;
    c.drive.friction_knee = knee;
    std::vector<double> y = in_motion(response(c, record, true));
    for (double& value : y) value = -value;
    return y;
  };
  const double knee = config.drive.friction_knee;
  const std::vector<double> output = in_motion(response(config, record, false));
  const std::vector<double> inertia = unit_response(&DriveModelConfig::inertia, knee);
  const std::vector<double> viscous = unit_response(&DriveModelConfig::viscous, knee);
  const std::vector<double> load = unit_response(&DriveModelConfig::constant_load, knee);

  const auto forward = static_cast<double>(
      std::count_if(viscous.begin(), viscous.end(), [](double speed) { return speed > 0; }));
  const double share = forward / static_cast<double>(rows.size());
  const bool both_ways = share > 0.05 && share < 0.95;
  const bool spindle = record.channel == Channel::spindle;
  if (!both_ways && !spindle)
    return data_error(
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

  const auto lag =
      static_cast<std::size_t>(kHacLag_s / (static_cast<double>(block) * record.sample_period_s));
  std::vector<double> knees = options.knees;
  if (knees.empty()) knees = {knee};
  Regression best;
  bool have = false;
  for (const double candidate : knees) {
    const std::vector<double> coulomb = unit_response(&DriveModelConfig::coulomb, candidate);
    std::vector<const std::vector<double>*> columns = {&inertia, &viscous, &coulomb};
    if (both_ways) columns.push_back(&load);
    if (!have) {
      const double worst = condition(columns);
      if (!(condition({&viscous, &coulomb}) < kWorstSpeeds))
        return data_error(who +
                          ": the record moves at one speed only, so viscous and Coulomb friction "
                          "cannot be told apart; record at least two speeds that differ by a "
                          "factor of three");
      if (!(worst < kWorstCondition))
        return data_error(
            who + ": the motion does not show inertia and friction apart (condition " +
            printed(worst) + "); record moves that accelerate hard and run at several speeds");
    }
    Regression r = regress(columns, output, lag);
    if (!have || r.residual_rms < kBetterKnee * best.residual_rms) {
      best = std::move(r);
      found.friction_knee = candidate;
      have = true;
    }
  }
  auto estimate = [&](Eigen::Index i) {
    return Estimate{best.parameters(i), best.standard_errors(i)};
  };
  found.inertia = estimate(0);
  found.viscous = estimate(1);
  found.coulomb = estimate(2);
  if (both_ways) found.constant_load = estimate(3);
  found.residual_rms = best.residual_rms;
  found.residual_share = best.residual_rms / best.output_rms;
  for (const double speed : viscous)
    found.highest_speed = std::max(found.highest_speed, std::abs(speed));
  if (!(found.inertia.value > 0))
    return data_error(who + ": the fitted inertia is " + printed(found.inertia.value) +
                      ", which is impossible; check the sign and scale of the effort column");
  // Negative friction within its error is none; beyond it, it is a Stribeck curve seen from above.
  auto keep_physical = [&](Estimate& e, const char* what) {
    if (e.value >= 0) return;
    found.remarks.push_back(who + ": " + what + " friction came out negative (" + printed(e.value) +
                            " +- " + printed(e.standard_error) +
                            ") and is set to zero: friction falls with speed here");
    e.value = 0;
  };
  keep_physical(found.viscous, "viscous");
  keep_physical(found.coulomb, "Coulomb");

  DisturbanceObserverConfig final_config = base;
  final_config.sample_period_s = record.sample_period_s;
  final_config.drive = identified_drive(base.drive, found);
  if (const Status status = Observer::validate(final_config); !status.ok())
    return data_error(who + ": " + status.parameter() + " " + status.reason());
  found.floor = floor_of(final_config, record, options.false_alarm_rate_per_hour);
  return found;
}

}  // namespace servosense
