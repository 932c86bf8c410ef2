// A machine file that is wrong by a factor of ten, in each key that a drive is compared with: it is
// refused in words, or the value is recalibrated. Never is an effect named for it. By day those
// that take no search; `--nightly` friction too.
#include <algorithm>
#include <functional>
#include <string>

#include "catalogue_cases.hpp"
#include "check.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

struct Key {
  const char* name;
  bool refused;  ///< too far off for a comparison
  std::function<void(DriveData&, double factor)> spoil;
};

void scale_motion(DriveData& d, double factor) {
  for (DriveSample<double>& s : d.samples) s.increment *= factor;
  d.unit_per_count *= factor;
}

const std::vector<Key> kKeys = {
    {"equivalent_mass_kg", true, [](DriveData& d, double f) { d.model.inertia *= f; }},
    {"force_constant_N_per_A", true,
     [](DriveData& d, double f) {
       for (DriveSample<double>& s : d.samples) s.effort *= f;
       d.effort_per_unit *= f;
     }},
    {"lead_m", true,
     [](DriveData& d, double f) {
       scale_motion(d, f);
       d.model.unit_per_turn *= f;
     }},
    {"encoder_counts_per_rev", true, [](DriveData& d, double f) { scale_motion(d, 1 / f); }},
    {"viscous_friction_N_s_per_m", false, [](DriveData& d, double f) { d.model.viscous *= f; }},
    {"coulomb_friction_N", false, [](DriveData& d, double f) { d.model.coulomb *= f; }},
};

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  for (const bool turns : {false, true}) {
    const catalogue::Machine m = turns ? catalogue::spindle(2) : catalogue::axis(2);
    const DriveData sound =
        catalogue::record(m, turns ? catalogue::spindle_motion() : catalogue::axis_motion());
    for (const Key& key : kKeys)
      for (const double factor : {10.0, 0.1}) {
        if (!key.refused && !nightly) continue;
        DriveData d = sound;
        key.spoil(d, factor);
        d.observer.drive = d.model;
        const auto outcome = reconcile_drive(d, {});
        const int before = check::failures;
        CHECK(outcome.has_value() != key.refused);
        if (outcome) {
          CHECK(outcome->report.effects.empty());
          CHECK(std::any_of(
              outcome->report.recalibrated.begin(), outcome->report.recalibrated.end(),
              [&](const Recalibrated& r) { return r.from > 5 * r.to || r.to > 5 * r.from; }));
        } else {
          // What to look at, by name.
          CHECK(outcome.error().sentence.find(turns ? "inertia_kg_m2" : "equivalent_mass_kg") !=
                std::string::npos);
        }
        if (check::failures > before)
          std::printf("  %s, %s times %g: %s\n", turns ? "spindle" : "axis", key.name, factor,
                      outcome ? outcome->report.summary.c_str() : outcome.error().sentence.c_str());
      }
  }
  return check::done();
}
