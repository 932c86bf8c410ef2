// The set of effects: names, refusals, sums and the cost of nothing. What each effect does is
// tested in test_effects_*.cpp.
#include <fstream>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <type_traits>

#include "check.hpp"
#include "servosense/model/drive_effects.hpp"

namespace {

using namespace servosense;

EffectSetting setting(const char* name, std::initializer_list<double> values) {
  EffectSetting s;
  s.effect = drive_effect_index(name);
  std::size_t i = 0;
  for (const double value : values) {
    s.parameters[i].count = 1;
    s.parameters[i++].value[0] = value;
  }
  return s;
}

void names() {
  std::set<std::string> names;
  for (std::size_t i = 0; i < kDriveEffectCount; ++i) {
    CHECK(names.insert(kDriveEffects[i].name).second);
    CHECK(drive_effect_index(kDriveEffects[i].name) == i);
    CHECK(kDriveEffects[i].parameter_count() >= 1);
    for (std::size_t p = 0; p < kDriveEffects[i].parameter_count(); ++p)
      CHECK(kDriveEffects[i].parameters[p].low < kDriveEffects[i].parameters[p].high);
  }
  CHECK(drive_effect_index("no-such-effect") == kDriveEffectCount);
  CHECK(drive_effect_index("") == kDriveEffectCount);
  static_assert(std::is_trivially_copyable_v<DriveEffects<float>>);
}

/// The unit that a key ends with, or none for what has none.
bool has_unit(const std::string& key) {
  for (const char* unit : {"_N", "_Nm", "_s", "_hz", "_rad", "_m", "_m2", "_per_m", "_per_rad",
                           "_per_s", "_per_m2", "_per_rad2", "_rad_s", "_A"})
    if (key.ends_with(unit)) return true;
  for (const char* plain : {"coefficient", "damping_ratio", "mass_share", "inertia_share",
                            "friction_share", "share_lost", "order", "slope", "profile", "exponent",
                            "current_per_force", "current_per_torque"})
    if (key == plain) return true;
  return false;
}

/// Every entry says all that a search and a report need, and docs/effects.md says the same.
void entries() {
  std::ifstream file("docs/effects.md");
  std::map<std::string, std::string> rows;  // of the page's catalogue
  for (std::string line; std::getline(file, line);)
    if (line.starts_with("| `")) rows.emplace(line.substr(3, line.find('`', 3) - 3), line);
  const std::set<std::string> scopes = {"machine", "power-up", "tool", "record"};
  for (std::size_t i = 0; i < kDriveEffectCount; ++i) {
    const EffectInfo& info = kDriveEffects[i];
    const EffectTraits& traits = kDriveEffectTraits[i];
    const int before = check::failures;
    for (const char* text : {traits.equation, traits.where, traits.signature,
                             traits.splitting_motion, traits.confused_with[0]})
      CHECK(text != nullptr && text[0] != '\0');
    CHECK(scopes.count(traits.scope) == 1);
    for (const char* other : traits.confused_with) {
      if (other == nullptr) continue;
      CHECK(std::string(other) != info.name);
      CHECK(drive_effect_index(other) < kDriveEffectCount ||
            std::string(other) == "time-locked-vibration");
    }
    const std::string& row = rows[info.name];
    for (std::size_t p = 0; p < info.parameter_count(); ++p) {
      for (const bool turning : {false, true}) CHECK(has_unit(info.parameters[p].key_for(turning)));
      CHECK(row.find('`' + std::string(info.parameters[p].key_for(false)) + '`') !=
            std::string::npos);
    }
    for (std::size_t p = 0; p < kMaxEffectParameters; ++p) {
      const EffectSearch& search = traits.search[p];
      CHECK(p < info.parameter_count() || search.role == EffectRole::none);
      if (search.role == EffectRole::searched) CHECK(search.low > 0 && search.low < search.high);
    }
    if (check::failures > before) std::cout << "  " << info.name << '\n';
  }
}

// Values at and just beyond the physical range of every parameter of every effect.
void ranges() {
  const double inf = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < kDriveEffectCount; ++i)
    for (std::size_t p = 0; p < kDriveEffects[i].parameter_count(); ++p) {
      const EffectParameter& parameter = kDriveEffects[i].parameters[p];
      for (const double bad :
           {std::nextafter(parameter.low, -inf), std::nextafter(parameter.high, inf),
            std::numeric_limits<double>::quiet_NaN()}) {
        DriveEffectsConfig c;
        c.count = 1;
        c.settings[0].effect = i;
        for (std::size_t q = 0; q < kDriveEffects[i].parameter_count(); ++q) {
          c.settings[0].parameters[q].count = 1;
          c.settings[0].parameters[q].value[0] = kDriveEffects[i].parameters[q].high;
        }
        c.settings[0].parameters[p].value[0] = bad;
        CHECK(!DriveEffects<double>::validate(c).ok());
      }
    }
}

void refusals() {
  auto refused = [](const DriveEffectsConfig& c) { return !DriveEffects<float>::validate(c).ok(); };
  DriveEffectsConfig c;
  CHECK(!refused(c));
  c.count = 1;
  c.settings[0] = setting("constant-load", {5});
  CHECK(!refused(c));
  CHECK(c.find("constant-load") == &c.settings[0]);
  CHECK(c.find("quadratic-drag") == nullptr);
  c.settings[0].parameters[0].count = 2;  // one number, not a list
  CHECK(refused(c));
  c.settings[0].parameters[0].count = 0;
  CHECK(refused(c));
  c.settings[0] = setting("constant-load", {5});
  c.settings[0].effect = kDriveEffectCount;
  CHECK(refused(c));
  c.settings[0] = c.settings[1] = setting("constant-load", {5});
  c.count = 2;
  CHECK(refused(c));  // the same one twice
  c.count = kMaxActiveEffects + 1;
  CHECK(refused(c));
  c.count = 0;
  c.sample_period_s = 0;
  CHECK(refused(c));
}

// Forces add, in any order; those that are off take no part.
void sums() {
  DriveEffectsConfig c;
  c.count = 3;
  c.settings[0] = setting("quadratic-drag", {30});
  c.settings[1] = setting("constant-load", {5});
  c.settings[2] = setting("viscous-friction", {7});
  CHECK(DriveEffects<double>::validate(c).ok());
  MotionState<double> m;
  m.velocity = -0.5;
  m.direction = -1;
  DriveEffects<double> effects;
  CHECK(!effects.any());
  CHECK(effects.force(m) == 0.0);
  effects.configure(c);
  CHECK(effects.any());
  CHECK_NEAR(effects.force(m), -30 * 0.25 + 5, 1e-14);
  CHECK(effects.viscous() == 7.0);  // joins the model's own
  CHECK(effects.acting_effort(3.5, {}) == 3.5);
  CHECK(effects.position_error(m) == 0.0);
  std::swap(c.settings[0], c.settings[2]);
  effects.configure(c);
  CHECK_NEAR(effects.force(m), -30 * 0.25 + 5, 1e-14);
  c.count = 0;
  effects.configure(c);
  CHECK(!effects.any() && effects.force(m) == 0.0);
}

}  // namespace

int main() {
  names();
  entries();
  ranges();
  refusals();
  sums();
  return check::done();
}
