// Records made by formulas: what is refused and with which words, and what must not change the
// answer (number of threads, direction of the axis, units of force).
#include <algorithm>
#include <cmath>
#include <random>
#include <sstream>
#include <string>

#include "check.hpp"
#include "servosense/reconcile/drive.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

struct Shape {
  double seconds = 30;
  double amplitude = 0.05;  // m
  double drift = 0;         // m/s: large enough, it never turns back
  double sign = 1;          // of the axis
  double scale = 1;         // of forces and masses
  double coulomb_N = 25;
};

/// 100 kg, 300 N s/m, some Coulomb friction along three sines; the model lacks the friction.
DriveData record(const Shape& s, double believed_kg = 108) {
  constexpr double kPeriod = 1e-3;
  DriveData d;
  d.sample_period_s = d.servo_period_s = kPeriod;
  d.model.inertia = believed_kg * s.scale;
  d.model.viscous = 320 * s.scale;
  d.model.unit_per_turn = 0.01;
  d.model.friction_knee = 5e-6;
  d.observer.drive = d.model;
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise;
  double last = 0;
  const double frequency[] = {0.23, 0.61, 1.7};
  const double share[] = {1, 0.5, 0.12};
  for (int i = 0; i < static_cast<int>(s.seconds / kPeriod); ++i) {
    const double t = i * kPeriod;
    double x = s.drift * t, v = s.drift, a = 0;
    for (int k = 0; k < 3; ++k) {
      const double w = 6.283185307179586 * frequency[k], size = s.amplitude * share[k];
      x += size * std::sin(w * t);
      v += size * w * std::cos(w * t);
      a -= size * w * w * std::sin(w * t);
    }
    const double friction = v > 0 ? s.coulomb_N : v < 0 ? -s.coulomb_N : 0;
    DriveSample<double> sample;
    sample.increment = s.sign * (i == 0 ? 0 : x - last);
    sample.position = s.sign * x;
    sample.effort = s.sign * s.scale * (100 * a + 300 * v + friction + noise(random));
    d.samples.push_back(sample);
    last = x;
  }
  return d;
}

std::string refusal(const DriveData& d) {
  auto outcome = reconcile_drive(d, {});
  return outcome ? "answered" : outcome.error().sentence;
}

bool contains(const std::string& text, const char* what) {
  return text.find(what) != std::string::npos;
}

void refusals() {
  Shape still;
  still.amplitude = 1e-6;
  CHECK(contains(refusal(record(still)), "does not move"));
  Shape one_way;
  one_way.drift = 1;
  CHECK(contains(refusal(record(one_way)), "one way only"));
  Shape brief;
  brief.seconds = 1.5;
  CHECK(contains(refusal(record(brief)), "usable motion"));
  CHECK(contains(refusal(record({}, 1000)), "equivalent_mass_kg"));
  CHECK(contains(refusal(record({}, 10)), "equivalent_mass_kg"));
  DriveData empty = record({});
  empty.samples.clear();
  CHECK(contains(refusal(empty), "0 samples"));
}

/// One way only: what looks alike is said, with the motion that would split it, and no name.
void refused_in_words() {
  Shape one_way;
  one_way.drift = 1;
  const DriveData d = record(one_way);
  auto outcome = reconcile_drive(d, {});
  CHECK(!outcome);
  if (outcome) return;
  const Report r = refusal(d, outcome.error(), {});
  CHECK(r.effects.empty() && !r.not_testable.empty());
  bool alike = false;
  for (const Alike& a : r.classes) {
    CHECK(a.names.size() >= 2 && !a.split_by.empty());
    const auto has = [&](const char* name) {
      return std::find(a.names.begin(), a.names.end(), name) != a.names.end();
    };
    alike = alike || (has("coulomb-friction") && has("constant-load"));
  }
  CHECK(alike);
}

/// The same drive again: found and held. Without the friction on the second record: not named.
void second_record() {
  const DriveData first = record({});
  Shape elsewhere;
  elsewhere.amplitude = 0.03;
  const DriveData again = record(elsewhere);
  auto held = reconcile_drive(first, {}, &again);
  CHECK(held.has_value());
  if (held) {
    const Report& r = held->report;
    CHECK(r.effects.size() == 1 && r.second.effects.size() == 1 && r.second.refuted.empty());
    // Friction of 25 N was missing; noise of 1 N through the Gaussian is 0.39 N.
    CHECK(r.second.gap_before > 5 && r.second.gap_after < 0.05 * r.second.gap_before);
  }
  elsewhere.coulomb_N = 0;
  const DriveData other = record(elsewhere);
  auto refuted = reconcile_drive(first, {}, &other);
  CHECK(refuted.has_value());
  if (refuted) {
    CHECK(refuted->report.effects.empty());
    CHECK(refuted->report.second.refuted.size() == 1 &&
          refuted->report.second.refuted[0].name == "coulomb-friction");
  }
}

/// A constant load that the model has wrongly is recalibrated in the model and in its file.
void known_load() {
  DriveData d = record({});
  for (auto& sample : d.samples) sample.effort += 4;
  EffectSetting load;
  load.effect = drive_effect_index("constant-load");
  load.parameters[0] = {{10.0}, 1};
  d.model.effects.settings[0] = load;
  d.model.effects.count = 1;
  d.channel = Channel::x;
  auto outcome = reconcile_drive(d, {});
  CHECK(outcome.has_value());
  if (!outcome) return;
  const EffectSetting* found = outcome->model.effects.find("constant-load");
  CHECK(found != nullptr);
  if (found != nullptr) CHECK_NEAR(found->scalar(0), 4, 0.2);
  auto machine = MachineFile::parse(
      "[axis.x]\nequivalent_mass_kg = 108\n[effect.x.constant-load]\nforce_N = 10\n", "m.ini");
  CHECK(machine.has_value());
  if (!machine) return;
  augment(*machine, *outcome, "test");
  CHECK_NEAR(machine->number("effect.x.constant-load", "force_N").value_or(0), 4, 0.2);
  CHECK(outcome->report.effects.size() == 1 &&
        outcome->report.effects[0].name == "coulomb-friction");
}

std::string json(const DriveData& d, unsigned threads) {
  Options options;
  options.threads = threads;
  auto outcome = reconcile_drive(d, options);
  CHECK(outcome.has_value());
  if (!outcome) return {};
  std::ostringstream out;
  write_json(outcome->report, out);
  return out.str();
}

double friction_found(const DriveData& d) {
  auto outcome = reconcile_drive(d, {});
  CHECK(outcome.has_value());
  if (!outcome) return 0;
  const Report& r = outcome->report;
  CHECK(r.effects.size() == 1 && r.effects[0].name == "coulomb-friction");
  if (r.effects.size() != 1) return 0;
  // Held-out rms: noise of 1 N through a Gaussian of 70 Hz at 1 kHz is 0.39 N.
  CHECK(r.gap_after < 0.1 * r.gap_before);
  return r.effects[0].parameters[0].values[0];
}

void same_answer() {
  const DriveData plain = record({});
  check::equal_text(json(plain, 1), json(plain, 3), __FILE__, __LINE__);
  CHECK_NEAR(friction_found(plain), 25, 0.5);
  Shape reversed;
  reversed.sign = -1;
  CHECK_NEAR(friction_found(record(reversed)), 25, 0.5);
  Shape heavy;
  heavy.scale = 1000;
  CHECK_NEAR(friction_found(record(heavy)), 25e3, 500);
}

}  // namespace

int main() {
  refusals();
  refused_in_words();
  second_record();
  known_load();
  same_answer();
  return check::done();
}
