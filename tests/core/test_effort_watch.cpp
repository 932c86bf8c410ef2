// What a drive input makes of efforts and encoders that go wrong, behind a drive that moves by a
// closed form: every fault is flagged within the samples that docs/drive-input.md states, and a
// sound drive is never accused. Oracle: the motion and the effort as they were made.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <random>
#include <string>

#include "check.hpp"
#include "servosense/core/drive_input.hpp"

namespace {

using namespace servosense;

constexpr double kPeriod_s = 125e-6;
constexpr double kCount_m = 0.016 / (1 << 20);
constexpr double kMass_kg = 227;
constexpr Quality kFault = kUnusable | Quality::gap;

/// An axis that moves as told and needs the force for it, 200 N of friction and noise.
template <typename Real>
class Axis {
 public:
  int update = 4;        // samples for one of the effort
  bool repeats = false;  // the last effort stands between
  double noise_N = 30;
  double load_N = 200;
  std::function<double(double)> place_m = [](double t) { return 0.3 * t; };
  std::function<double(double)> acceleration_m_s2 = [](double) { return 0.0; };

  explicit Axis(unsigned seed) : random_(seed) {}
  void start() {
    DriveInputConfig c;
    c.sample_period_s = kPeriod_s;
    c.unit_per_count = kCount_m;
    c.unit_per_turn = 0.016;
    c.max_acceleration = 800;
    c.max_effort = 2e5;
    c.watch_effort = true;
    CHECK(DriveInput<Real>::validate(c).ok());
    in_.configure(c);
  }
  RawDriveSample<Real> next() {
    const double t = static_cast<double>(n_) * kPeriod_s;
    RawDriveSample<Real> raw;
    raw.counts = static_cast<std::int64_t>(std::floor(place_m(t) / kCount_m));
    if (n_ % update == 0)
      effort_ = load_N + kMass_kg * acceleration_m_s2(t) + noise_N * noise_(random_);
    else if (!repeats)
      raw.effort_quality = Quality::held;
    raw.effort = static_cast<Real>(effort_);
    ++n_;
    return raw;
  }
  DriveSample<Real> hear(const RawDriveSample<Real>& raw) { return last = in_.process(raw); }
  /// Samples that were flagged.
  int run(double seconds) {
    int flagged = 0;
    for (int i = 0; i < seconds / kPeriod_s; ++i) flagged += has(hear(next()).quality, kFault);
    return flagged;
  }
  [[nodiscard]] double now_s() const { return static_cast<double>(n_) * kPeriod_s; }
  DriveSample<Real> last;

 private:
  DriveInput<Real> in_;
  std::mt19937 random_;
  std::normal_distribution<double> noise_{0, 1};
  std::int64_t n_ = 0;
  double effort_ = 0;
};

template <typename Real>
Axis<Real> warm(unsigned seed, int update, bool repeats) {
  Axis<Real> axis(seed);
  axis.update = update;
  axis.repeats = repeats;
  axis.start();
  axis.run(1);
  CHECK(axis.run(0.2) == 0);
  return axis;
}

/// Samples until one is flagged with `wanted`, while `spoil` has its way; -1: never.
template <typename Real, typename Spoil>
int named_after(Axis<Real>& axis, int samples, Quality wanted, Spoil spoil) {
  int named = -1;
  for (int i = 0; i < samples; ++i) {
    auto raw = axis.next();
    spoil(raw, i);
    if (has(axis.hear(raw).quality, wanted) && named < 0) named = i + 1;
  }
  return named;
}

// Ramps to and fro, with and without noise, standing between them: nothing is ever flagged.
template <typename Real>
void sound_drives() {
  for (unsigned seed = 1; seed <= 4; ++seed)
    for (const int update : {1, 4, 16})
      for (const double noise : {0.0, 30.0}) {
        Axis<Real> axis(seed);
        axis.update = update;
        axis.repeats = seed % 2 == 0;
        axis.noise_N = noise;
        const double w = 4 * kPi;  // half a second to and fro, then half a second of rest
        axis.place_m = [=](double t) {
          const double s = std::fmod(t, 1);
          return s < 0.5 ? 0.02 * (1 - std::cos(w * s)) : 0.0;
        };
        axis.acceleration_m_s2 = [=](double t) {
          const double s = std::fmod(t, 1);
          return s < 0.5 ? 0.02 * w * w * std::cos(w * s) : 0.0;
        };
        axis.start();
        axis.run(0.01);
        const int flagged = axis.run(6);
        if (flagged != 0)
          check::fail(__FILE__, __LINE__) << flagged << " samples flagged, update " << update
                                          << ", noise " << noise << ", seed " << seed << '\n';
        ++check::checks;
      }
  // An ideal effort may repeat for ever while the drive moves, any may while it stands.
  Axis<Real> ideal(1);
  ideal.noise_N = 0;
  ideal.update = 1;
  ideal.start();
  ideal.run(0.01);
  CHECK(ideal.run(20) == 0);
  auto axis = warm<Real>(2, 1, true);
  const double stop_s = axis.now_s();
  axis.place_m = [=](double t) {
    const double s = t - stop_s;
    return 0.3 * stop_s + (s < 0.1 ? 0.3 * s - 1.5 * s * s : 0.015);
  };
  CHECK(axis.run(0.1) == 0);
  auto raw = axis.next();
  int flagged = 0;
  for (int i = 0; i < 80000; ++i) flagged += has(axis.hear(raw).quality, kFault);
  CHECK(flagged == 0);
}

template <typename Real>
void silence() {
  for (const int update : {1, 4}) {
    for (const bool repeats : {false, true}) {
      auto axis = warm<Real>(11, update, repeats);
      const auto last = static_cast<Real>(axis.last.effort);
      const auto silent = [&](RawDriveSample<Real>& raw, int) {
        raw.effort = last;
        raw.effort_quality = repeats ? Quality::good : Quality::held;
      };
      // Four updates, eight where the last value is repeated, eight samples at least.
      const int named = named_after(axis, 4000, Quality::stale, silent);
      const int latest = std::max(8, (repeats ? 8 : 4) * update) + 1;
      if (!(named > 0 && named <= latest))
        check::fail(__FILE__, __LINE__)
            << "silence of updates every " << update << " samples flagged after " << named << '\n';
      ++check::checks;
      CHECK(has(axis.last.quality, Quality::gap));
      // And over with the first values, as a new start.
      const int over = named_after(axis, 200, Quality::restarted, [](auto&, int) {});
      CHECK(over > 0 && over <= 9 * update);
      CHECK(axis.run(1) == 0);
    }
    // Nine of ten updates lost: none is believed.
    auto axis = warm<Real>(12, update, false);
    std::mt19937 random(5);
    int believed = 0, samples = 0;
    named_after(axis, 16000, Quality::stale, [&](RawDriveSample<Real>& raw, int i) {
      if (i > 400) ++samples, believed += !has(axis.last.quality, Quality::gap);
      if (random() % 10 != 0) raw.effort_quality = Quality::held;
    });
    CHECK(believed < samples / 100);
  }
  Axis<Real> never(13);
  never.start();
  const int named = named_after(never, 1000, Quality::stale, [](RawDriveSample<Real>& raw, int) {
    raw.effort = 0;
    raw.effort_quality = Quality::held;
  });
  CHECK(named > 0 && named <= 321);  // four of 100 Hz
}

template <typename Real>
void steps_of_effort() {
  for (const int update : {1, 4})
    for (const double by : {1500.0, -9000.0, 30000.0}) {
      const std::string what = std::to_string(by) + " N, update " + std::to_string(update);
      auto axis = warm<Real>(21, update, true);
      // One update: until the next it is doubtful, then it was a spike.
      int told = 0;
      const int spike = named_after(axis, 40 * update, Quality::jump, [&](auto& raw, int i) {
        if (i < update) raw.effort += static_cast<Real>(by);
        if (i > 0 && i <= update) told += has(axis.last.quality, Quality::doubtful);
      });
      if (!(spike == update + 1 && told == update))
        check::fail(__FILE__, __LINE__)
            << "spike of " << what << " flagged after " << spike << ", doubtful " << told << '\n';
      ++check::checks;
      CHECK(std::abs(static_cast<double>(axis.last.effort) - 200) < 200);
      CHECK(axis.run(0.5) == 0);
      // A step that stays is believed with the next value: a contact makes it, too.
      told = 0;
      const int step = named_after(axis, 40 * update, kFault, [&](auto& raw, int i) {
        raw.effort += static_cast<Real>(by);
        if (i > 0) told += has(axis.last.quality, Quality::doubtful);
      });
      CHECK(step < 0 && told <= update);
      CHECK(std::abs(static_cast<double>(axis.last.effort) - 200 - by) < 200);
      axis.run(1);
    }
  // Zero that repeats is nothing that a drive gave.
  for (const int update : {1, 4}) {
    auto axis = warm<Real>(24, update, true);
    axis.load_N = 2000;
    axis.run(1);
    int believed = 0;
    const int named = named_after(axis, 400, Quality::stale, [&](auto& raw, int i) {
      if (i > 0) believed += !has(axis.last.quality, Quality::doubtful | Quality::gap);
      raw.effort = 0;
    });
    CHECK(named > 0 && named <= 8 * update + 8);
    CHECK(believed == 0);
    CHECK(named_after(axis, 80, Quality::restarted, [](auto&, int) {}) > 0);
    CHECK(axis.run(1) == 0);
  }
  // A step that it answers is taken.
  for (const double a : {-8.0, 8.0}) {
    auto axis = warm<Real>(22, 4, true);
    const double from = axis.now_s();
    axis.place_m = [=](double t) { return 0.3 * t + 0.5 * a * (t - from) * (t - from); };
    axis.acceleration_m_s2 = [=](double) { return a; };
    CHECK(axis.run(0.02) == 0);
    CHECK(std::abs(static_cast<double>(axis.last.effort) - 200 - kMass_kg * a) < 200);
  }
  auto axis = warm<Real>(23, 1, true);
  CHECK(named_after(axis, 1, Quality::invalid, [](auto& raw, int) { raw.effort = Real(1e15); }) ==
        1);
  CHECK(std::abs(static_cast<double>(axis.last.effort)) < 500);
}

template <typename Real>
void encoders() {
  for (const std::int64_t by : {10, -20, 50, 1000}) {
    auto axis = warm<Real>(31, 1, true);
    const Real before = axis.last.position;
    const int named = named_after(axis, 20, Quality::jump, [&](auto& raw, int i) {
      if (i == 0) raw.counts += by;
    });
    CHECK(named > 0 && named <= 2);
    // No step of it was believed, no way was lost.
    CHECK_NEAR(static_cast<double>(axis.last.position - before), 20 * 0.3 * kPeriod_s,
               static_cast<double>(std::numeric_limits<Real>::epsilon()) + 2 * kCount_m);
    CHECK(axis.run(0.2) == 0);
  }
  for (const double speed : {0.005, 0.02, 0.0217, 0.1, 0.41, 0.83}) {
    Axis<Real> axis(32);
    axis.place_m = [=](double t) { return speed * t; };
    axis.start();
    axis.run(1);
    std::int64_t stuck = 0;
    const int named =
        named_after(axis, 4000, Quality::stuck | Quality::jump, [&](auto& raw, int i) {
          if (i == 0) stuck = raw.counts;
          raw.counts = stuck;
        });
    // Its first reading is a true one.
    if (!(named > 0 && named <= 3))
      check::fail(__FILE__, __LINE__) << "stuck at " << speed << " after " << named << '\n';
    ++check::checks;
    CHECK(has(axis.last.quality, Quality::gap) && has(axis.last.quality, Quality::stuck));
    CHECK(has(axis.hear(axis.next()).quality, Quality::restarted));
    CHECK(axis.run(0.5) == 0);
  }
  // A contact is no fault of the encoder, however stiff: the mass swings back from it.
  for (const double stiffness : {4e5, 1e7, 1e8, 1e9}) {
    auto axis = warm<Real>(33, 1, true);
    const double from = axis.now_s(), w = std::sqrt(stiffness / kMass_kg);
    axis.place_m = [=](double t) {
      const double s = t - from;
      const double swing = s < kPi / w ? std::sin(w * s) / w : kPi / w - s;
      return 0.3 * (from + swing);
    };
    CHECK(axis.run(2 * kPi / w) == 0);
  }
}

// Values every 4 samples, a gap, then every 12: too slow for what was known, so they are stale
// until 64 in a row have come at that pace, which is then what is known. One that comes late in
// between begins the count anew.
void another_pace() {
  for (const int late : {0, 40}) {
    EffortWatch<double> watch;
    watch.configure({true, kPeriod_s, 0, 8});
    std::mt19937 random(5);
    std::normal_distribution<double> noise(0, 1);
    double last = 0;
    EffortFinding found = EffortFinding::sound;
    auto period = [&](int samples) {  // nothing, then a value
      for (int n = 1; n <= samples; ++n) {
        const bool fresh = n == samples;
        const double effort = fresh ? noise(random) : last;
        found = watch.hear(effort, last, fresh, false, 100);
        last = effort;
      }
      return found;
    };
    for (int n = 0; n < 200; ++n) period(4);
    CHECK(found == EffortFinding::sound);
    CHECK(period(100) == EffortFinding::stale);
    int heard = 0;
    while (heard < 300 && period(heard == late && late > 0 ? 15 + 12 : 12) == EffortFinding::stale)
      ++heard;
    CHECK_BETWEEN(heard, late + 64, late + 68);
    for (int n = 0; n < 100; ++n) CHECK(period(12) != EffortFinding::stale);
  }
}

}  // namespace

int main() {
  sound_drives<float>();
  sound_drives<double>();
  silence<float>();
  silence<double>();
  steps_of_effort<float>();
  steps_of_effort<double>();
  encoders<float>();
  encoders<double>();
  another_pace();
  return check::done();
}
