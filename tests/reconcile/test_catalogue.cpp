// Every effect of the registry, hidden in a simulated axis and in a simulated spindle: is it found,
// by its name, with its parameters; and is nothing found where nothing is hidden?
//
// Strength: what of the effect's force inertia and friction of the model cannot imitate, rms over
// the rows of the comparison, over the rms of the noise there. Every effect is brought to strength
// 6 by the noise that is put on the effort. By day each effect in one of the drives, along one lap;
// `--nightly` in both, along two.
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "catalogue_cases.hpp"
#include "check.hpp"
#include "reconcile/drive/comparison_band.hpp"
#include "reconcile/drive/signals.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kStrength = 6;
constexpr unsigned kSeed = 1;

std::string named(const Report& r) {
  std::string text;
  for (const FoundEffect& e : r.effects) {
    text += (text.empty() ? "" : " + ") + e.name;
    for (const std::string& other : e.class_members) text += "/" + other;
  }
  return text.empty() ? reconcile::name_of(r.verdict) : text;
}

double rms(const Column& x, const std::vector<bool>& usable) {
  double square = 0, n = 0;
  for (std::size_t i = 0; i < x.size(); ++i)
    if (usable[i]) square += x[i] * x[i], ++n;
  return std::sqrt(square / n);
}

/// What least squares on these terms leaves of a column.
Column without(Column x, std::vector<Column> terms, const std::vector<bool>& usable) {
  const auto dot = [&](const Column& a, const Column& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
      if (usable[i]) sum += a[i] * b[i];
    return sum;
  };
  const auto take = [&](Column& from, const Column& what) {
    const double c = dot(from, what) / dot(what, what);
    for (std::size_t i = 0; i < from.size(); ++i) from[i] -= c * what[i];
  };
  for (std::size_t k = 0; k < terms.size(); ++k) {
    for (std::size_t j = 0; j < k; ++j) take(terms[k], terms[j]);
    take(x, terms[k]);
  }
  return x;
}

/// White noise on a signal of a record, of this rms after the Gaussian of the comparison.
template <typename Add>
void put_noise(DriveData& data, double corner_hz, double after, Add add) {
  // The integral of 2^-u^2 over positive u is 1.0645.
  const double passes = std::sqrt(2 * data.sample_period_s * 1.0645 * corner_hz);
  std::mt19937_64 random(kSeed);
  std::normal_distribution<double> noise(0, after / passes);
  for (std::size_t i = 0; i < data.samples.size(); ++i) add(i, noise(random));
}

/// Noise on the effort, so that the effect has the strength asked for.
void bring_to_strength(DriveData& data, const EffectSetting& effect) {
  const DriveSignals signals(data, comparison_corner(data));
  const Column column = signals.response(effect, data.model);
  CHECK(!column.empty());
  if (column.empty()) return;
  std::vector<Column> model = {signals.acceleration_rows};
  if (data.model.viscous > 0) model.push_back(signals.velocity_rows);
  if (data.model.coulomb > 0)
    model.push_back(signals.to_rows(signals.direction(data.model.friction_knee)));
  const double beyond = rms(without(column, model, signals.usable), signals.usable);
  put_noise(data, signals.corner_hz, beyond / kStrength,
            [&](std::size_t i, double noise) { data.samples[i].effort += noise; });
}

/// A scale on the stage behind a screw with this lead error, by its formula. Neither motor nor
/// forces see it.
void put_scale(DriveData& data, const EffectSetting& error) {
  double position = 0, square = 0;
  for (const DriveSample<double>& s : data.samples) {
    position += data.load_position.empty() ? 0 : s.increment;
    const double e =
        error.scalar(2) * position +
        error.scalar(0) * std::sin(error.scalar(1) * s.turn_angle_rad + error.scalar(3));
    data.load_position.push_back(position + e);
    square += e * e;
  }
  const double size = std::sqrt(square / static_cast<double>(data.samples.size()));
  put_noise(data, comparison_corner(data), size / kStrength,
            [&](std::size_t i, double noise) { data.load_position[i] += noise; });
}

/// One effect, by its name or in a class of at most three.
const FoundEffect* found(const char* name, const Report& r) {
  if (r.effects.size() != 1) return nullptr;
  const FoundEffect& e = r.effects[0];
  const auto& others = e.class_members;
  const bool right =
      others.size() <= 2 &&
      (e.name == name || std::find(others.begin(), others.end(), name) != others.end());
  return right ? &e : nullptr;
}

/// Of the size that was hidden? Of ripple the amplitude, of a profile the last knot, else the first
/// parameter.
void check_size(const EffectSetting& effect, const FoundEffect& e) {
  const std::string name = kDriveEffects[effect.effect].name;
  if (e.name != name) return;  // of its class
  // Its first parameter is where it begins, not how large it is.
  const bool knee = name == "torque-saturation" || name == "field-weakening";
  double truth = effect.scalar(0), value = e.parameters[0].values[0];
  if (name == "torque-ripple") truth = effect.scalar(1), value = e.parameters[1].values[0];
  if (name == "position-dependent-friction") {
    // Knots lie where the search puts them; the mean is the model's Coulomb friction.
    const auto& knots = e.parameters[0].values;
    const auto& hidden = effect.parameters[0].value;
    truth = (hidden[3] - hidden[1]) / (hidden[2] - hidden[0]);
    value = (knots.back() - knots[1]) / (knots[knots.size() - 2] - knots[0]);
  }
  // At this strength the noise is worth some per cent of what is linear. What has a memory, and
  // timing, is also seen through terms that are refitted beside it.
  const bool coarse = name == "presliding-hysteresis" || name == "backlash" ||
                      name == "flexible-coupling" || name == "current-loop-lag" ||
                      name == "transport-delay" || name == "thermal-friction-drift" ||
                      name == "thermal-viscous-drift" || knee;
  CHECK_NEAR(value / truth, 1, coarse ? 0.3 : 0.08);
}

struct Drive {
  bool turns = false;
  bool long_record = false;
  [[nodiscard]] catalogue::Machine machine() const {
    return turns ? catalogue::spindle(kSeed) : catalogue::axis(kSeed);
  }
  [[nodiscard]] Trajectory motion() const {
    const int laps = long_record ? 2 : 1;
    return turns ? catalogue::spindle_motion(laps) : catalogue::axis_motion(laps);
  }
  [[nodiscard]] const char* name() const { return turns ? "spindle" : "axis"; }

  /// The answer on a record; nothing hidden without an effect.
  void check(const DriveData& data, const EffectSetting* effect) const {
    Options options;
    if (!long_record) options.null_records = 4;
    auto outcome = reconcile_drive(data, options);
    CHECK(outcome.has_value());
    if (!outcome) {
      std::printf("  %s: %s\n", name(), outcome.error().sentence.c_str());
      return;
    }
    const Report& r = outcome->report;
    const char* what = effect == nullptr ? "nothing" : kDriveEffects[effect->effect].name;
    std::printf("  %-8s %-28s %-50s gap %8.4g -> %8.4g, floor %8.4g (%s)\n", name(), what,
                named(r).c_str(), r.gap_before, r.gap_after, r.floors.used,
                reconcile::name_of(r.verdict));
    if (effect == nullptr) {
      CHECK(r.effects.empty());
      return;
    }
    const FoundEffect* e = found(what, r);
    CHECK(e != nullptr);
    if (e == nullptr) return;
    CHECK(e->confidence >= 0.5 && e->confidence <= 0.99);
    CHECK(e->gap_after < 0.7 * e->gap_before);
    check_size(*effect, *e);
  }

  void nothing_hidden() const { check(catalogue::record(machine(), motion()), nullptr); }

  void hidden(const catalogue::Case& c) const {
    catalogue::Machine m = machine();
    const EffectSetting effect = catalogue::setting(c.effect, turns ? c.spindle : c.axis);
    if (std::string(c.effect) == "lead-error") {
      DriveData data = catalogue::record(m, motion());
      put_scale(data, effect);
      check(data, &effect);
      return;
    }
    m.truth.current_noise_A = 0;
    catalogue::hide(m, effect);
    DriveData data = catalogue::record(m, motion());
    bring_to_strength(data, effect);
    check(data, &effect);
  }
};

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  for (const bool turns : {false, true}) {
    const Drive drive{turns, nightly};
    drive.nothing_hidden();
    for (std::size_t i = 0; i < kDriveEffectCount; ++i) {
      const catalogue::Case* c = catalogue::find(kDriveEffects[i].name);
      CHECK(c != nullptr);
      if (c == nullptr) {
        std::printf("  %s: say in catalogue_cases.hpp how to hide it\n", kDriveEffects[i].name);
        continue;
      }
      CHECK(c->axis.empty() == (c->no_axis != nullptr));
      CHECK(c->spindle.empty() == (c->no_spindle != nullptr));
      if (std::string(c->effect) == "torque-saturation") continue;  // said to be not testable
      const bool today = c->spindle.empty() || c->axis.empty() || turns == (i % 2 == 1);
      const bool has_it = !(turns ? c->spindle : c->axis).empty();
      if ((nightly || today) && has_it) drive.hidden(*c);
    }
  }
  return check::done();
}
