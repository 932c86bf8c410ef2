// One declaration of the effects (core/effect_keys.hpp), read by the model and by the machine file:
// what the one takes the other accepts, over the same range.
#include <cmath>
#include <cstdio>
#include <limits>
#include <set>
#include <string>

#include "check.hpp"
#include "servosense/core/effect_keys.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/model/cutting_effects.hpp"
#include "servosense/model/drive_effects.hpp"

using namespace servosense;

namespace {

bool is_known(std::string_view name) {
  for (const std::string_view known : kEffectNames)
    if (known == name) return true;
  return false;
}

/// Each entry by itself.
void entries() {
  std::set<std::pair<std::string, std::string>> seen;
  std::string last;
  std::set<std::string> done;
  for (const EffectKey& k : kEffectKeys) {
    const int before = check::failures;
    CHECK(is_known(k.effect));
    CHECK(seen.emplace(k.effect, k.key).second);
    CHECK(k.key[0] != '\0' && k.meaning[0] != '\0');
    CHECK((k.kind == EffectValue::word) == (k.choices[0] != '\0'));
    CHECK(k.kind == EffectValue::word ? k.low == k.high : k.low < k.high);
    std::string unit = k.unit;  // N/m is written N_per_m in a key
    for (auto at = unit.find('/'); at != std::string::npos; at = unit.find('/'))
      unit.replace(at, 1, "_per_");
    for (char& c : unit) c = c == ' ' ? '_' : c == 'H' ? 'h' : c;
    const std::string key = k.key;
    CHECK(unit.empty() || key.ends_with('_' + unit) || key == "coefficient" || key == "order" ||
          key == "slope" || key == "profile" || key == "current_per_force");
    if (k.effect != last) CHECK(done.insert(k.effect).second);  // they follow each other
    last = k.effect;
    if (check::failures > before) std::printf("  %s %s\n", k.effect, k.key);
  }
}

/// The machine file and a parameter of the model, on a channel that turns or not.
void same(const char* name, const EffectParameter& p, bool turning) {
  const std::string section =
      std::string(turning ? "effect.spindle." : "effect.x.") + std::string(name);
  const MachineKey* key = find_machine_key(section, p.key_for(turning));
  CHECK(key != nullptr);
  if (key == nullptr) return;
  constexpr double inf = std::numeric_limits<double>::infinity();
  for (const double good : {p.low, p.high}) CHECK(key->range.holds(good));
  for (const double bad : {std::nextafter(p.low, -inf), std::nextafter(p.high, inf)})
    CHECK(!key->range.holds(bad));
  CHECK(p.list == (key->kind == KeyKind::list || key->kind == KeyKind::pairs));
}

void model_and_file_agree() {
  for (const EffectInfo& info : kDriveEffects)
    for (std::size_t p = 0; p < info.parameter_count(); ++p)
      for (const bool turning : {false, true}) same(info.name, info.parameters[p], turning);
  for (const CuttingEffectInfo& info : kCuttingEffects)
    for (std::size_t p = 0; p < info.parameter_count(); ++p)
      same(info.name, info.parameters[p], false);
}

/// No key of an effect stands in the machine file's table but those declared, besides the two that
/// every effect has.
void nothing_beside() {
  std::size_t declared = 0, in_file = 0;
  for (const EffectKey& k : kEffectKeys) declared += k.turning.key[0] != '\0' ? 2 : 1;
  for (const MachineKey& k : machine_keys()) in_file += k.family.starts_with("effect.") ? 1 : 0;
  CHECK(declared == in_file);
}

}  // namespace

int main() {
  entries();
  model_and_file_agree();
  nothing_beside();
  return check::done();
}
