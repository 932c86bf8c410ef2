#include "servosense/identify/idle_temperature.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "idle_design.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

using idle_fit::Column;
using idle_fit::Columns;
using idle_fit::IdleDesign;
using idle_fit::regress;
using idle_fit::Regression;

constexpr double kEvidence = 3;          // standard errors from none
constexpr double kMagnets_per_K = 1e-3;  // NdFeB, makers' data sheets: this must be told from none
constexpr double kLeastRange_K = 5;      // sensors show whole degrees, and are beside the magnets
constexpr double kLeastShare = 0.05;     // of the acceleration (square) at each end of the range
constexpr int kRounds = 4;
constexpr int kAgain = 2;  // fits with what was found: field weakening and saturation move with it
constexpr double kCutoff_rad_s = 100;  // as where saturation is sought: ramps show as much

/// Temperatures between which all but a share of the acceleration lies, at either end.
std::pair<double, double> range_of(const Column& temperature, const Column& acceleration) {
  std::vector<std::pair<double, double>> rows;
  double whole = 0;
  for (std::size_t i = 0; i < temperature.size(); ++i) {
    rows.emplace_back(temperature[i], acceleration[i] * acceleration[i]);
    whole += rows.back().second;
  }
  std::sort(rows.begin(), rows.end());
  const auto within = [&](auto from, auto to) {
    double sum = 0;
    for (; from != to; ++from) {
      sum += from->second;
      if (sum > kLeastShare * whole) return from->first;
    }
    return 0.0;
  };
  return {within(rows.begin(), rows.end()), within(rows.rbegin(), rows.rend())};
}

Column times(const Column& a, const Column& b) {
  Column product = a;
  for (std::size_t i = 0; i < a.size(); ++i) product[i] *= b[i];
  return product;
}

/// The change of the constant per kelvin, at one cutoff.
class TemperatureFit {
 public:
  TemperatureFit(const IdleDesign& design, const Column& coulomb, bool with_load,
                 const Column& warmer_K)
      : design_(design), columns_(design.columns(coulomb, with_load)), warmer_K_(warmer_K) {
    const Regression plain = regress(columns_, design.output, 0);
    for (std::size_t j = 1; j < columns_.size(); ++j)
      warm_.push_back(times(*columns_[j], warmer_K));
    late_ = design.delay(plain.parameters(0), plain.parameters(1));
  }
  [[nodiscard]] Estimate per_K() const {
    Columns all = columns_;
    for (const Column& column : warm_) all.push_back(&column);
    all.push_back(&late_);
    const auto n = static_cast<Eigen::Index>(all.size());
    Column change(design_.output.size(), 0.0);
    all.push_back(&change);
    Estimate a;
    Regression r = regress({all.begin(), all.end() - 1}, design_.output, 0);
    for (int round = 0; round < kRounds; ++round) {
      // Gauss and Newton: by what the change of `a` moves M / (1 + a dT).
      for (std::size_t i = 0; i < change.size(); ++i) {
        const double ratio = 1 + a.value * warmer_K_[i];
        double said = 0;  // M, by the motion
        for (Eigen::Index j = 0; j + 1 < n; ++j)
          said += r.parameters(j) * (*all[static_cast<std::size_t>(j)])[i];
        change[i] = -said / ratio * warmer_K_[i] / ratio;
      }
      std::vector<Column> scaled;
      Columns of;
      for (std::size_t j = 0; j + 1 < all.size(); ++j) {
        scaled.push_back(*all[j]);
        for (std::size_t i = 0; i < change.size(); ++i)
          scaled.back()[i] /= 1 + a.value * warmer_K_[i];
      }
      for (const Column& column : scaled) of.push_back(&column);
      of.push_back(&change);
      r = regress(of, design_.output, round + 1 == kRounds ? design_.lag() : 0);
      a.value += r.parameters(n);
      a.standard_error = r.standard_errors(n);
    }
    return a;
  }

 private:
  const IdleDesign& design_;
  Columns columns_;
  std::vector<Column> warm_;
  Column late_;
  const Column& warmer_K_;
};

}  // namespace

SeenConstantOverTemperature find_constant_over_temperature(const DisturbanceObserverConfig& drive,
                                                           const DriveRecord& record,
                                                           const IdleIdentification& found,
                                                           double at_C,
                                                           const IdleOptions& options) {
  SeenConstantOverTemperature seen;
  const std::string who(name_of(record.channel));
  DriveRecord known = record;
  for (std::size_t i = 0; i < known.samples.size(); ++i)
    if (!std::isfinite(known.temperature_C[i])) {
      known.temperature_C[i] = at_C;
      known.samples[i].quality |= Quality::gap;
    }
  DisturbanceObserverConfig config = drive;
  config.sample_period_s = record.sample_period_s;
  config.drive.inertia = config.drive.viscous = config.drive.coulomb = 0;
  config.drive.constant_load = 0;
  const auto at_cutoff = [&](double cutoff, bool look) {
    DisturbanceObserverConfig c = config;
    c.disturbance_cutoff_rad_s = std::min(c.disturbance_cutoff_rad_s, cutoff);
    c.velocity_cutoff_rad_s = std::min(c.velocity_cutoff_rad_s, cutoff);
    const IdleDesign design(c, known, options);
    Column warmer_K = design.mean_of(known.temperature_C);
    if (look) std::tie(seen.lowest_C, seen.highest_C) = range_of(warmer_K, design.inertia);
    for (double& t : warmer_K) t -= at_C;
    if (!(seen.highest_C - seen.lowest_C > kLeastRange_K)) return Estimate{};
    const Column coulomb = design.coulomb(found.friction_knee);
    return TemperatureFit(design, coulomb, found.constant_load_fitted, warmer_K).per_K();
  };
  Estimate a = at_cutoff(kCutoff_rad_s, true);
  const double range_K = seen.highest_C - seen.lowest_C;
  const std::string between = who + ": the motor accelerates between " + printed(seen.lowest_C, 3) +
                              " and " + printed(seen.highest_C, 3) + " degC, ";
  if (!(range_K > kLeastRange_K)) {
    seen.refusal = between +
                   "too much alike to tell how torque per ampere goes with temperature; record "
                   "run-ups cold, and again when it is 20 K warmer or more";
    return seen;
  }
  // What half the cutoff makes of it (Hausman 1978).
  const Estimate slower = at_cutoff(kCutoff_rad_s / 2, false);
  const double moved = slower.value - a.value;
  const double noise =
      slower.standard_error * slower.standard_error - a.standard_error * a.standard_error;
  a.standard_error =
      std::hypot(a.standard_error, std::sqrt(std::max(0.0, moved * moved - std::max(0.0, noise))));
  if (std::abs(a.value) > kEvidence * a.standard_error) {
    seen.per_K = a;
    return seen;
  }
  if (kEvidence * a.standard_error < kMagnets_per_K) return seen;
  const double needed_K = range_K * kEvidence * a.standard_error / kMagnets_per_K;
  seen.refusal = between + "and its torque per ampere changes by " + printed(a.value, 3) + " +- " +
                 printed(a.standard_error, 3) +
                 " 1/K, which is not told from none; record harder or more run-ups, or some " +
                 printed(needed_K, 3) + " K apart";
  return seen;
}

Expected<IdleIdentification> identify_idle_over_temperature(
    const DisturbanceObserverConfig& base, DriveRecord& record, ConstantOverTemperature& constant,
    SeenConstantOverTemperature& seen, const IdleOptions& options, IdleRefusal* why) {
  const DriveRecord told = record;
  for (int round = 0;; ++round) {
    record.samples = told.samples;
    scale_by_temperature(record, constant);
    auto idle = identify_idle(base, record, options, why);
    if (!idle || round == kAgain) return idle;
    DisturbanceObserverConfig drive = base;
    drive.drive = identified_drive(base.drive, *idle);
    seen = find_constant_over_temperature(drive, told, *idle, constant.at_C, options);
    if (!seen.per_K) return idle;
    constant.per_K = seen.per_K->value;
  }
}

void scale_by_temperature(DriveRecord& record, const ConstantOverTemperature& constant) {
  for (std::size_t i = 0; i < record.temperature_C.size(); ++i)
    if (std::isfinite(record.temperature_C[i]))
      record.samples[i].effort *= constant.ratio(record.temperature_C[i]);
}

}  // namespace servosense
