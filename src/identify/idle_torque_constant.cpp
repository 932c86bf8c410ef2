#include "idle_torque_constant.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "idle_field_weakening.hpp"
#include "idle_saturation.hpp"

namespace servosense::idle_fit {
namespace {

constexpr int kRounds = 5;
constexpr double kSettled = 0.1;  // of a standard error
// The noise of an encoder in the acceleration grows with the cutoff and takes from the inertia what
// then looks like saturation; a ramp of half a second shows as much at this one.
constexpr double kRampCutoff_rad_s = 100;
// A quarter of that filter's time constant: means of so little, before and behind alike, take
// nothing of a ramp.
constexpr double kCalm_s = 0.25 / kRampCutoff_rad_s;

EffectSetting setting_of(const FoundWeakening& law) {
  EffectSetting setting{};
  setting.effect = drive_effect_index("field-weakening");
  const auto put = [&](std::size_t parameter, double value) {
    EffectSetting::Values& values = setting.parameters[parameter];
    values.value[values.count++] = value;
  };
  for (const auto& [speed, ratio] : law.table) put(2, speed), put(2, ratio.value);
  if (law.table.empty()) put(0, law.base_speed.value);
  if (law.table.empty() && law.exponent.value != 1) put(1, law.exponent.value);
  return setting;
}

EffectSetting setting_of(const FoundSaturation& saturation, double effort_per_ampere) {
  EffectSetting setting{};
  setting.effect = drive_effect_index("torque-saturation");
  setting.parameters[0].count = setting.parameters[1].count = 1;
  setting.parameters[0].value[0] = saturation.knee.value / effort_per_ampere;
  setting.parameters[1].value[0] = saturation.share_lost.value;
  return setting;
}

/// Each effort as the mean of those about it.
DriveRecord calmed(const DriveRecord& record) {
  DriveRecord calm = record;
  const std::size_t n = record.samples.size();
  const auto half = static_cast<std::size_t>(kCalm_s / record.sample_period_s / 2);
  Column sums(n + 1, 0.0);
  for (std::size_t i = 0; i < n; ++i) sums[i + 1] = sums[i] + record.samples[i].effort;
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t near = std::min({half, i, n - 1 - i});
    calm.samples[i].effort =
        (sums[i + near + 1] - sums[i - near]) / static_cast<double>(2 * near + 1);
  }
  return calm;
}

}  // namespace

TorqueConstantTaken take_torque_constant(DisturbanceObserverConfig& config,
                                         const DriveRecord& record, const IdleOptions& options,
                                         bool with_load, IdleIdentification& found) {
  std::optional<FoundWeakening> law;
  SeenSaturation seen;
  const double per_ampere = config.drive.effort_per_ampere;
  const auto put = [&](DriveEffectsConfig& effects, bool with_law, bool with_saturation) {
    if (with_law && law) effects.settings[effects.count++] = setting_of(*law);
    if (with_saturation && seen.found)
      effects.settings[effects.count++] = setting_of(*seen.found, per_ampere);
  };
  const auto seek = [&](const DriveRecord& of, bool with_law, bool with_saturation, double cutoff,
                        auto what) {
    DisturbanceObserverConfig c = config;
    c.disturbance_cutoff_rad_s = std::min(c.disturbance_cutoff_rad_s, cutoff);
    c.velocity_cutoff_rad_s = std::min(c.velocity_cutoff_rad_s, cutoff);
    put(c.drive.effects, with_law, with_saturation);
    const IdleDesign design(c, of, options);
    const Column coulomb = design.coulomb(c.drive.friction_knee);
    what(design, design.columns(coulomb, with_load));
  };
  const std::size_t room = kMaxActiveEffects - config.drive.effects.count;
  const bool weakening = options.seek_field_weakening && room > 0;
  const bool saturation = options.seek_saturation && room > (weakening ? 1 : 0);
  std::optional<DriveRecord> calm;
  if (saturation) calm = calmed(record);
  for (int round = 0; round < kRounds; ++round) {
    if (weakening)
      seek(seen.found ? *calm : record, false, true, options.highest_cutoff_rad_s,
           [&](const IdleDesign& design, const Columns& columns) {
             law = find_field_weakening(design, columns);
           });
    if (!saturation) break;
    const auto before = seen.found;
    seek(*calm, true, false, kRampCutoff_rad_s,
         [&](const IdleDesign& design, const Columns& columns) {
           seek(*calm, true, false, kRampCutoff_rad_s / 2,
                [&](const IdleDesign& slower, const Columns& of) {
                  seen = find_saturation(design, columns, slower, of,
                                         before ? std::optional(before->knee.value) : std::nullopt);
                });
         });
    if (!weakening || !seen.found) break;
    const auto still = [](const Estimate& now, const Estimate& then) {
      return std::abs(now.value - then.value) <= kSettled * now.standard_error;
    };
    if (before && still(seen.found->knee, before->knee) &&
        still(seen.found->share_lost, before->share_lost))
      break;
  }
  found.highest_effort = seen.highest;
  found.saturation_seen_to = seen.told ? seen.highest : 0;
  found.saturation_seen_error = seen.loss_error;
  if (law) {
    found.base_speed = law->base_speed;
    found.weakening_exponent = law->exponent;
    found.current_per_torque = law->table;
    found.field_weakening = setting_of(*law);
  }
  if (seen.found) {
    found.saturation_knee = seen.found->knee;
    found.saturation_share = seen.found->share_lost;
    found.torque_saturation = setting_of(*seen.found, per_ampere);
  }
  put(config.drive.effects, true, true);
  if (!seen.found) return {law.has_value(), Eigen::Vector3d::Zero(), {}};
  return {true, seen.found->errors, std::move(calm)};
}

}  // namespace servosense::idle_fit
