// Every effect of the catalogue says what it means for the machine and what to do.
#include <string>

#include "check.hpp"
#include "reconcile/report/maintenance_advice.hpp"
#include "servosense/model/cutting_effects.hpp"
#include "servosense/model/drive_effects.hpp"
#include "servosense/reconcile/report.hpp"

using namespace servosense;

namespace {

void has_words(const char* effect) {
  const reconcile::MaintenanceAdvice words = reconcile::maintenance_advice(effect);
  check::that(words.meaning.size() > 10 && words.remedy.size() > 10,
              (std::string("words for ") + effect).c_str(), __FILE__, __LINE__);
}

}  // namespace

int main() {
  for (std::size_t i = 0; i < kDriveEffectCount; ++i) has_words(kDriveEffects[i].name);
  for (const CuttingEffectInfo& info : kCuttingEffects) has_words(info.name);
  CHECK(reconcile::maintenance_advice("no-such-effect").meaning.empty());
  reconcile::Report report;
  CHECK(reconcile::maintenance_advice_of(report).empty());
  report.effects.resize(2);
  report.effects[0].name = "stribeck-friction";
  report.effects[1].name = "backlash";
  const std::string text = reconcile::maintenance_advice_of(report);
  CHECK(text.starts_with("stribeck-friction: the drive needs more force to start"));
  CHECK(text.find("\nbacklash: the drive loses motion") != std::string::npos);
  return check::done();
}
