#include "reconcile/drive/candidates/candidates.hpp"

#include <algorithm>
#include <memory>
#include <utility>

#include "reconcile/drive/candidates/kinds.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"

namespace servosense::reconcile {
namespace {

/// The grid is walked again after each addition: its columns are kept.
Candidate remembering(Candidate c) {
  constexpr std::size_t kMost = 250;             // points
  constexpr std::size_t kMostValues = 16000000;  // of a long record: 128 MB
  struct Known {
    std::vector<double> theta;
    std::vector<Column> columns;
  };
  const auto known = std::make_shared<std::vector<Known>>();
  const auto columns = c.columns;
  c.columns = [known, columns](std::span<const double> theta) {
    for (const Known& k : *known)
      if (std::equal(theta.begin(), theta.end(), k.theta.begin(), k.theta.end())) return k.columns;
    std::vector<Column> made = columns(theta);
    const std::size_t values = made.empty() ? 0 : made.size() * made.front().size();
    if (known->size() < kMost && known->size() * values < kMostValues)
      known->push_back({{theta.begin(), theta.end()}, made});
    return made;
  };
  return c;
}

/// Of a delay or a lag, what is beyond the `told` seconds that the file knows of.
Meaning beyond_told(Meaning m, double told) {
  for (NamedValue& v : m.parameters) {
    if (v.key == "delay_s") v.values[0] -= told;
    if (v.key == "bandwidth_hz") v.values[0] = 1 / (1 / v.values[0] - kTwoPi * told);
    if (!v.values.empty() && !(v.values[0] > 0)) m.violation = "the file tells all of it";
  }
  return m;
}

}  // namespace

std::vector<Candidate> drive_candidates(const DriveSituation& s) {
  std::vector<Candidate> all;
  const DriveEffectsConfig& present = s.data->model.effects;
  const double passed_again = s.signals->share_passed_again();
  for (std::size_t effect = 0; effect < kDriveEffectCount; ++effect) {
    const std::string name = kDriveEffects[effect].name;
    if (present.find(name) != nullptr) continue;
    if (name == "viscous-friction" && s.data->model.viscous > 0) continue;
    if (name == "coulomb-friction" && s.data->model.coulomb > 0) continue;
    if (name == "constant-load" && s.constant_known) continue;
    if (kDriveEffectTraits[effect].of_current && !(s.top_current_A > 0)) continue;
    // Beyond its base speed a spindle is run, not a feed axis.
    if (name == "field-weakening" && !is_spindle(s.data->channel)) continue;
    const bool timing = name == "transport-delay" || name == "current-loop-lag";
    if (timing && !s.timing_open) continue;
    if (name == "current-loop-lag" && s.read_late) continue;  // it acts behind its reference
    Candidate c;
    if (name == "flexible-coupling")
      c = coupling_candidate(effect, s);
    else if (name == "presliding-hysteresis")
      c = presliding_candidate(effect, s);
    else if (name == "backlash")
      c = backlash_candidate(effect, s);
    else if (name == "position-dependent-friction")
      c = profile_candidate(effect, s);
    else if (name == "torque-ripple")
      c = ripple_candidate(effect, s);
    else
      c = effect_candidate(effect, s);
    // Of blind drives it took any error of the effort at its peaks for saturation.
    if (name == "torque-saturation") {
      c.not_testable = "an effort that errs at its peaks looks like it, whatever the reason";
      c.would_need = "the torque measured, beside the current";
    }
    if (name == "constant-load") c.equals = {"asymmetric-friction"};
    if (name == "transport-delay" && s.read_late)
      c.columns = [signals = s.signals](std::span<const double> theta) {
        Column sooner = signals->effort_rows(-theta[0]);
        const Column read = signals->effort_rows(0);
        for (std::size_t i = 0; i < sooner.size(); ++i) sooner[i] = read[i] - sooner[i];
        return std::vector<Column>{std::move(sooner)};
      };
    else if (name == "transport-delay")
      c.equals = {"current-loop-lag"};
    if (name == "current-loop-lag") c.equals = {"transport-delay"};
    if (timing && !s.read_late && s.known_lag_s > 0)
      c.meaning = [whole = c.meaning, told = s.known_lag_s](std::span<const double> theta,
                                                            std::span<const double> coefficients) {
        return beyond_told(whole(theta, coefficients), told);
      };
    if (name == "encoder-eccentricity") {
      if (!(s.model.unit_per_turn > 0)) {
        c.not_testable = "the length of a turn is not known";
        c.would_need = "lead_m in the machine file";
      } else if (!s.data->turns()) {
        c.equals = {"lead-error"};
      }
    }
    if (name == "lead-error") {
      if (!s.data->load_position.empty()) continue;  // views/scale.hpp
      c.not_testable = "the trace has no scale on the stage";
      c.would_need = "the position of a scale, beside the counts of the motor";
    }
    if (passed_again < s.criteria->passed_again &&
        (name == "position-dependent-friction" || name == "spring-load")) {
      c.not_testable = "hardly any place is passed twice, so position cannot be told from time";
      c.would_need = "the same stroke several times, both ways";
    }
    c.memory = name == "presliding-hysteresis" || name == "backlash" || name == "flexible-coupling";
    if (c.memory && s.signals->corner_hz < s.criteria->memory_corner_hz) {
      c.not_testable = "sampling and resolution leave a band of " +
                       printed(s.signals->corner_hz, 2) +
                       " Hz, too slow for what happens at reversals";
      c.would_need = "a higher sample rate or a finer position";
    }
    c.timing = timing;
    c.refuted = unnameable_under(s.limit_cycle, name);
    all.push_back(std::move(c));
  }
  for (const DriveData::Other& other : s.data->others)
    all.push_back(cross_talk_candidate(other, s));
  all.push_back(line_candidate(s));
  if (s.top_current_A > 0 && s.data->constant.per_K == 0)
    all.push_back(motor_temperature_candidate(s));
  for (Candidate& c : drive_rivals(s)) all.push_back(std::move(c));
  for (Candidate& c : all) c = remembering(std::move(c));
  if (s.data->others.empty() && !s.data->turns()) {
    Candidate c;
    c.name = "cross-talk";
    c.not_testable = "the trace shows no other axis";
    c.would_need = "position and current of the other axes, recorded together with this one";
    all.push_back(std::move(c));
  }
  return all;
}

EffectSetting effect_with(std::size_t effect, std::initializer_list<double> values) {
  EffectSetting s;
  s.effect = effect;
  std::size_t p = 0;
  for (const double value : values) s.parameters[p++] = {{value}, 1};
  return s;
}

void add_effect(DriveEffectsConfig& effects, const EffectSetting& setting) {
  if (effects.count < kMaxActiveEffects) effects.settings[effects.count++] = setting;
}

EffectSetting setting_of(const std::string& name, const Meaning& meaning, bool turns) {
  EffectSetting s;
  s.effect = drive_effect_index(name);
  if (s.effect == kDriveEffectCount) return s;
  const EffectInfo& info = kDriveEffects[s.effect];
  for (std::size_t p = 0; p < info.parameter_count(); ++p)
    for (const NamedValue& v : meaning.parameters)
      if (v.key == info.parameters[p].key_for(turns)) {
        s.parameters[p].count = std::min(v.values.size(), kMaxEffectValues);
        std::copy_n(v.values.begin(), s.parameters[p].count, s.parameters[p].value.begin());
      }
  return s;
}

}  // namespace servosense::reconcile