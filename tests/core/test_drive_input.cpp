// Drive input against integer arithmetic on the true position.
#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include "check.hpp"
#include "servosense/core/drive_input.hpp"

namespace {

using namespace servosense;
constexpr double kPeriod_s = 125e-6;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

DriveInputConfig counts_config(unsigned bits, double counts_per_turn, double unit_per_turn) {
  DriveInputConfig c;
  c.sample_period_s = kPeriod_s;
  c.counter_bits = bits;
  c.unit_per_turn = unit_per_turn;
  c.unit_per_count = unit_per_turn / counts_per_turn;
  return c;
}

// What a counter of this width reads at a true count, as an unsigned or a signed number.
std::int64_t reading(std::int64_t truth, unsigned bits, bool as_signed) {
  const std::uint64_t mask = bits == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << bits) - 1;
  const std::uint64_t low = static_cast<std::uint64_t>(truth) & mask;
  if (bits == 64) return static_cast<std::int64_t>(low);
  const std::uint64_t half = std::uint64_t{1} << (bits - 1);
  return as_signed && low >= half
             ? static_cast<std::int64_t>(low) - static_cast<std::int64_t>(mask) - 1
             : static_cast<std::int64_t>(low);
}

// Increments, position and turn angle stay exact through a wrap, from any start, either way.
template <typename Real>
void wraps() {
  const unsigned seed = 21;
  for (const unsigned bits : {8U, 16U, 20U, 24U, 32U, 40U, 64U})
    for (const bool as_signed : {false, true})
      for (const int way : {1, -1}) {
        std::mt19937 random(seed);
        const double unit = std::ldexp(1.0, -10);  // exact in float
        DriveInput<Real> in;
        const DriveInputConfig c = counts_config(bits, 1000, 1000 * unit);
        CHECK(DriveInput<Real>::validate(c).ok());
        in.configure(c);
        // Begins a few steps before the counter's end, of either kind, and passes it.
        const std::uint64_t end = std::uint64_t{1} << (bits - (as_signed || bits == 64 ? 1 : 0));
        auto truth = static_cast<std::uint64_t>(way > 0 ? end - 1000 : end + 1000);
        const std::uint64_t start = truth;
        const unsigned reach = bits == 8 ? 128 : 700;  // less than half the counter's range
        const std::int64_t first =
            reading(static_cast<std::int64_t>(start), bits, as_signed) % 1000;
        bool increments = true, positions = true, turns = true;
        std::int64_t travelled = 0;
        for (int n = 0; n < 4000; ++n) {
          const std::int64_t step = n == 0 ? 0 : way * static_cast<std::int64_t>(random() % reach);
          truth += static_cast<std::uint64_t>(step);
          travelled += step;
          RawDriveSample<Real> raw;
          raw.counts = reading(static_cast<std::int64_t>(truth), bits, as_signed);
          const DriveSample<Real> out = in.process(raw);
          increments =
              increments && out.increment == static_cast<Real>(static_cast<double>(step) * unit);
          positions =
              positions && out.position == static_cast<Real>(static_cast<double>(travelled) * unit);
          const std::int64_t in_turn = ((first + travelled) % 1000 + 1000) % 1000;
          turns = turns && std::abs(static_cast<double>(out.turn_angle_rad) -
                                    static_cast<double>(in_turn) * kTwoPi / 1000) < 1e-6;
        }
        const std::string what = std::to_string(bits) + " bits, signed " +
                                 std::to_string(as_signed) + ", way " + std::to_string(way) +
                                 ", seed " + std::to_string(seed);
        check::that(increments, ("increments, " + what).c_str(), __FILE__, __LINE__);
        check::that(positions, ("positions, " + what).c_str(), __FILE__, __LINE__);
        check::that(turns, ("turn angle, " + what).c_str(), __FILE__, __LINE__);
      }
}

// 12000 rpm on 2^20 counts: a signed 32-bit counter ends after 10.24 s. 60 s of it, every increment
// and every angle exact.
template <typename Real>
void long_runs() {
  constexpr std::int64_t kTurn = 1 << 20;
  DriveInput<Real> in;
  in.configure(counts_config(32, kTurn, kTwoPi));
  // 200 turns a second: 26214.4 counts a sample, here as 2 in 5 samples longer.
  auto at = [](std::int64_t n) { return n * 131072 / 5; };
  bool exact = true;
  std::int64_t wraps = 0, last = 0;
  for (std::int64_t n = 0; n <= 480'000; ++n) {
    RawDriveSample<Real> raw;
    raw.counts = reading(at(n), 32, true);
    wraps += raw.counts < last;
    last = raw.counts;
    const DriveSample<Real> out = in.process(raw);
    const std::int64_t step = n == 0 ? 0 : at(n) - at(n - 1);
    exact = exact && out.increment == static_cast<Real>(step) * static_cast<Real>(kTwoPi / kTurn);
    const double angle = static_cast<double>(at(n) % kTurn) * kTwoPi / kTurn;
    exact = exact && std::abs(static_cast<double>(out.turn_angle_rad) - angle) <
                         7.5e-7;  // two roundings of 2 pi in float
  }
  CHECK(exact);
  CHECK(wraps == 3);  // at 10.24 s, then every 20.48 s
}

// Twenty-four hours in big steps: the turn angle and the unwrapped count stay exact.
template <typename Real>
void a_day() {
  constexpr std::int64_t kTurn = 131072;
  DriveInput<Real> in;
  in.configure(counts_config(32, kTurn, kTwoPi));
  constexpr std::int64_t kStep = 1'000'000'007;  // per sample; any step below 2^31 will do
  constexpr int kSamples = 20'000;               // 2e13 counts: 24 h at 106 000 rpm
  bool exact = true;
  for (std::int64_t n = 0; n < kSamples; ++n) {
    RawDriveSample<Real> raw;
    raw.counts = reading(n * kStep, 32, true);
    const DriveSample<Real> out = in.process(raw);
    const double angle = static_cast<double>(n * kStep % kTurn) * kTwoPi / kTurn;
    exact = exact && std::abs(static_cast<double>(out.turn_angle_rad) - angle) <
                         7.5e-7;  // two roundings of 2 pi in float
    if constexpr (std::is_same_v<Real, double>)
      exact = exact && std::abs(out.position - static_cast<double>(n * kStep) * kTwoPi / kTurn) <=
                           1e-15 * out.position;
  }
  CHECK(exact);
  CHECK(in.state().total_counts == (kSamples - 1) * kStep);
}

// In double the position goes on beyond 32 bits of counts, at everyday speed too.
void beyond_32_bits() {
  DriveInput<double> in;
  const double unit = std::ldexp(1.0, -20);
  in.configure(counts_config(32, 1 << 20, 1));
  bool exact = true;
  for (std::int64_t n = 0; n < 20'000; ++n) {
    RawDriveSample<double> raw;
    raw.counts = reading(n * 300'000, 32, true);
    exact = exact && in.process(raw).position == static_cast<double>(n * 300'000) * unit;
  }
  CHECK(exact);
}

// ---- faults ----------------------------------------------------------------------------------

enum class Fault { nan_effort, nan_motion, missing, held, jump };

struct Run {
  std::vector<DriveSample<double>> out;
  std::vector<double> truth;
};

// Constant acceleration, so that bridging at the last pace is not exact; `length` faulty samples
// from sample 100 on.
template <typename Real>
Run run(MotionKind kind, Fault fault, int length) {
  DriveInput<Real> in;
  DriveInputConfig c = counts_config(32, 1 << 20, 0.016);
  c.kind = kind;
  c.max_speed = 2;
  in.configure(c);
  Run r;
  for (int n = 0; n < 400; ++n) {
    const double t = n * kPeriod_s;
    const double x = 0.3 * t + 5 * t * t;
    RawDriveSample<Real> raw;
    raw.counts = static_cast<std::int64_t>(std::floor(x / c.unit_per_count));
    raw.motion = kind == MotionKind::velocity ? 0.3 + 10 * t : x;
    raw.effort = Real(100);
    if (n >= 100 && n < 100 + length) {
      switch (fault) {
        case Fault::nan_effort:
          raw.effort = std::numeric_limits<Real>::quiet_NaN();
          break;
        case Fault::nan_motion:
          raw.motion = kNan;
          raw.motion_quality = Quality::invalid;
          raw.counts = 12345678;
          break;
        case Fault::missing:
          raw.motion_quality = raw.effort_quality = Quality::missing;
          raw.counts = 0;
          raw.motion = 0;
          break;
        case Fault::held:
          raw.motion_quality = Quality::held;
          break;
        case Fault::jump:
          raw.counts += 1'000'000;
          raw.motion += 15;
          break;
      }
    }
    const DriveSample<Real> o = in.process(raw);
    r.out.push_back({static_cast<double>(o.increment), static_cast<double>(o.position),
                     static_cast<double>(o.turn_angle_rad), static_cast<double>(o.effort),
                     o.quality});
    r.truth.push_back(
        kind == MotionKind::counts ? std::floor(x / c.unit_per_count) * c.unit_per_count : x);
  }
  return r;
}

template <typename Real>
void faults() {
  constexpr int kHold = 8;
  for (const MotionKind kind : {MotionKind::counts, MotionKind::position, MotionKind::velocity})
    for (const Fault fault :
         {Fault::nan_effort, Fault::nan_motion, Fault::missing, Fault::held, Fault::jump})
      for (const int length : {1, 3, kHold, kHold + 1, 60}) {
        if (fault == Fault::jump && length > kHold + 1) continue;  // that is persistent_jump()
        const Run r = run<Real>(kind, fault, length);
        const int before = check::failures;
        const bool effort_only = fault == Fault::nan_effort;
        const bool too_long = length > kHold;
        double sum = 0;
        for (int n = 0; n < 400; ++n) {
          const DriveSample<double>& o = r.out[static_cast<std::size_t>(n)];
          CHECK(std::isfinite(o.increment) && std::isfinite(o.position) &&
                std::isfinite(o.turn_angle_rad));
          CHECK(o.turn_angle_rad >= 0 && o.turn_angle_rad < 6.2832);
          CHECK(o.effort == 100);  // the last good effort stands in
          sum += o.increment;
          const bool faulty = n >= 100 && n < 100 + length;
          if (fault == Fault::held)
            CHECK(!faulty || has(o.quality, Quality::held));
          else
            CHECK(faulty == has(o.quality, kUnusable));  // flagged at once, and only then
          if (fault == Fault::jump && faulty) CHECK(has(o.quality, Quality::jump));
          CHECK(has(o.quality, Quality::gap) == (faulty && n >= 100 + kHold));
          CHECK(has(o.quality, Quality::restarted) == (n == 0 || (too_long && n == 100 + length)));
          // Exact again with the first good sample: position, and what the increments add up to
          // unless the gap was too long to make up.
          const double tolerance = std::is_same_v<Real, float> ? 2e-7 : 1e-12;
          const bool position_known = kind != MotionKind::velocity;
          const double true_move = r.truth[static_cast<std::size_t>(n)] - r.truth[0];
          if (!faulty && position_known) CHECK_NEAR(o.position, true_move, tolerance);
          if (!faulty && position_known && !(too_long && !effort_only && n >= 100))
            CHECK_NEAR(sum, true_move, tolerance);
          // While bridged it is off by less than the acceleration does in that time.
          const double bridge_s = (n - 99) * kPeriod_s;
          if (faulty && position_known && n < 100 + kHold && !effort_only)
            CHECK_NEAR(
                o.position, true_move,
                0.5 * 10 * bridge_s * (bridge_s + kPeriod_s) + (n - 99) * 1.6e-8 + tolerance);
          // A speed cannot tell what was travelled unseen; a bridge errs no more than above.
          if (kind == MotionKind::velocity && !too_long)
            CHECK_NEAR(o.position, true_move,
                       0.5 * 10 * 9 * 10 * kPeriod_s * kPeriod_s + tolerance);
        }
        if (check::failures > before)
          std::printf("    kind %d, fault %d, length %d\n", static_cast<int>(kind),
                      static_cast<int>(fault), length);
      }
}

// A jump that stays is a new place of the axis (the drive was referenced anew): flagged until no
// bridge would hold any longer, then followed.
void persistent_jump() {
  DriveInputConfig c = counts_config(32, 1 << 20, 0.016);
  c.max_speed = 2;
  DriveInput<double> in;
  in.configure(c);
  for (int n = 0; n < 200; ++n) {
    RawDriveSample<double> raw;
    raw.counts = 1000 * n + (n >= 100 ? 5'000'000 : 0);
    const DriveSample<double> o = in.process(raw);
    CHECK(has(o.quality, Quality::jump) == (n >= 100 && n < 109));
    CHECK(has(o.quality, Quality::restarted) == (n == 0 || n == 109));
    if (n < 100 || n >= 109)
      CHECK_NEAR(o.position, static_cast<double>(raw.counts) * c.unit_per_count, 1e-12);
    CHECK(std::abs(o.increment) <= 1000.001 * c.unit_per_count);  // no block sees the step
  }
}

// Right at the limits, either way: 500 counts a sample pass and 501 are a jump; steps of about one
// turn and of several leave the angle right.
template <typename Real>
void limits() {
  DriveInputConfig c = counts_config(32, 1000, 1000 * std::ldexp(1.0, -10));
  c.sample_period_s = std::ldexp(1.0, -13);
  c.max_speed = 500.5 * 8;  // 500.5 counts a sample, exactly
  for (const int step : {500, -500, 501, -501, 1000, -1000}) {
    DriveInput<Real> in;
    in.configure(c);
    RawDriveSample<Real> raw;
    for (int n = 0; n < 3; ++n) CHECK(!has(in.process(raw).quality, Quality::jump));
    raw.counts = step;
    CHECK(has(in.process(raw).quality, Quality::jump) == (std::abs(step) > 500));
  }
  c.max_speed = 0;
  DriveInput<Real> in;
  in.configure(c);
  std::int64_t truth = 0;
  for (int n = 0; n < 300; ++n)
    for (const int step : {0, 1, -1, 999, -999, 1000, -1000, 1001, -1001, 2999, -2999, 3017}) {
      truth += step;
      RawDriveSample<Real> raw;
      raw.counts = truth;
      const DriveSample<Real> o = in.process(raw);
      CHECK_NEAR(static_cast<double>(o.turn_angle_rad),
                 static_cast<double>(truth % 1000) * kTwoPi / 1000, 7.5e-7);
      CHECK(static_cast<double>(o.increment) == std::ldexp(static_cast<double>(step), -10));
    }
}

// Motion that arrives slower than the servo rate: one reading in `every`. The increments must
// follow the mean speed. (Bridging with the last make-up step multiplies its error by 1 - every.)
template <typename Real>
void slower_motion() {
  for (const MotionKind kind : {MotionKind::counts, MotionKind::position})
    for (const int every : {2, 4, 8}) {
      DriveInput<Real> in;
      DriveInputConfig c = counts_config(32, 1 << 20, 0.016);
      c.kind = kind;
      in.configure(c);
      double worst = 0;
      for (int n = 0; n < 8000; ++n) {
        const double t = n * kPeriod_s;
        const double x = 0.05 * std::sin(kTwoPi * t);
        const double v = 0.05 * kTwoPi * std::cos(kTwoPi * t);
        RawDriveSample<Real> raw;
        raw.counts = static_cast<std::int64_t>(std::floor(x / c.unit_per_count));
        raw.motion = x;
        if (n % every != 0) raw.motion_quality = Quality::held;
        const DriveSample<Real> o = in.process(raw);
        if (n > 2 * every)
          worst = std::max(worst, std::abs(static_cast<double>(o.increment) - v * kPeriod_s));
      }
      // A make-up step carries two intervals' change of speed over up to `every` samples, and in
      // counts twice the quantisation. Acceleration is 0.05 (2 pi)^2 = 1.97 m/s2 at most.
      const double bound = 1.97 * kPeriod_s * kPeriod_s * every * every * 1.5 +
                           (kind == MotionKind::counts ? 2 * c.unit_per_count : 0) + 1e-8;
      CHECK_BETWEEN(worst, 0.0, bound);
    }
}

// A number no drive can mean is a jump and leaves no trace, wherever it comes: first, in between,
// or for so long that a jump would be followed.
template <typename Real>
void absurd_numbers() {
  for (const MotionKind kind : {MotionKind::position, MotionKind::velocity})
    for (const double absurd : {1e300, -1e300, 1e30})
      for (const int at : {0, 20})
        for (const int length : {1, 30}) {
          DriveInputConfig c;
          c.kind = kind;
          DriveInput<Real> in;
          in.configure(c);
          bool finite = true, flagged = true;
          for (int n = 0; n < 100; ++n) {
            const bool bad = n >= at && n < at + length;
            RawDriveSample<Real> raw;
            raw.motion = bad ? absurd : kind == MotionKind::position ? 0.001 * n : 8.0;
            const DriveSample<Real> o = in.process(raw);
            finite = finite && is_finite(o.increment) && is_finite(o.position) &&
                     is_finite(o.turn_angle_rad) && o.turn_angle_rad >= 0 &&
                     o.turn_angle_rad < Real(6.2832);
            flagged = flagged && has(o.quality, Quality::jump) == bad;
          }
          const std::string what = (absurd > 0 ? "1e" : "-1e") +
                                   std::to_string(std::lround(std::log10(std::abs(absurd)))) +
                                   " at " + std::to_string(at) + " for " + std::to_string(length);
          check::that(finite, ("finite, " + what).c_str(), __FILE__, __LINE__);
          check::that(flagged, ("flagged, " + what).c_str(), __FILE__, __LINE__);
          CHECK_NEAR(static_cast<double>(in.state().increment), 0.001, 1e-9);
        }
}

void effort_from_the_start() {
  DriveInput<double> in;
  in.configure(counts_config(32, 1000, 1));
  RawDriveSample<double> raw;
  raw.effort_quality = Quality::held;  // the slow channel has not spoken yet
  CHECK(has(in.process(raw).quality, Quality::settling));
  raw.effort_quality = Quality::good;
  raw.effort = 7;
  CHECK(has(in.process(raw).quality, Quality::restarted));
  raw.effort_quality = Quality::held;
  raw.effort = kNan;  // not looked at while held... and if it is, never passed on
  CHECK(in.process(raw).effort == 7);
}

// Changes of speed that no drive makes: a wild reading, a stuck encoder. A hard, noisy motion near
// the limit is none.
template <typename Real>
void impossible_acceleration() {
  for (const MotionKind kind : {MotionKind::counts, MotionKind::position, MotionKind::velocity}) {
    const std::string where = "kind " + std::to_string(static_cast<int>(kind));
    const double unit = std::ldexp(1.0, -17);
    DriveInputConfig c = counts_config(16, 4096, 4096 * unit);
    c.kind = kind;
    c.max_acceleration = 20 * unit / (kPeriod_s * kPeriod_s);  // 20 counts a sample more
    CHECK(DriveInput<Real>::validate(c).ok());
    DriveInput<Real> in;
    in.configure(c);
    std::mt19937 random(7);
    double position = 30000, velocity = 0;  // counts, counts per sample
    auto feed = [&](double at, double pace) {
      RawDriveSample<Real> raw;
      raw.counts = reading(std::llround(at), 16, false);
      raw.motion = kind == MotionKind::position ? at * unit : pace * unit / kPeriod_s;
      raw.effort = 1;
      return in.process(raw);
    };
    auto move = [&](double acceleration) {
      velocity += acceleration;
      position += velocity;
      return feed(position, velocity);
    };
    unsigned flagged = 0;
    for (int n = 0; n < 20000; ++n) {
      double a = static_cast<double>(random() % 39) - 19;
      if (std::abs(velocity + a) > 1200) a = -a;
      flagged += has(move(a).quality, Quality::jump);
    }
    check::that(flagged == 0, (where + ": a drive at its limit is no jump").c_str(), __FILE__,
                __LINE__);

    // One wild reading: flagged, bridged, and the way is the same afterwards.
    in.reset();
    velocity = 300;
    for (int n = 0; n < 10; ++n) (void)move(0);
    position += velocity;
    const DriveSample<Real> wild = feed(position + 900, velocity + 900);
    check::that(has(wild.quality, Quality::jump), (where + ": a wild reading is a jump").c_str(),
                __FILE__, __LINE__);
    CHECK_NEAR(static_cast<double>(wild.increment), 300 * unit, 1e-6 * 300 * unit);
    const DriveSample<Real> good = move(0);
    check::that(!has(good.quality, Quality::jump | Quality::invalid),
                (where + ": the next good one is none").c_str(), __FILE__, __LINE__);
    CHECK_NEAR(static_cast<double>(good.increment), 300 * unit, 1e-4 * 300 * unit);

    // Stuck at speed: flagged at once. A speed is believed after max_hold_samples, a position
    // never: it is stuck until it moves.
    const bool speeds = kind == MotionKind::velocity;
    unsigned bad = 0, stuck = 0, until_restart = 0;
    for (unsigned n = 1; n <= 20; ++n) {
      const DriveSample<Real> held = feed(position, 0);
      if (n == 1)
        check::that(has(held.quality, Quality::jump), (where + ": stuck at speed").c_str(),
                    __FILE__, __LINE__);
      bad += has(held.quality, Quality::jump);
      stuck += has(held.quality, Quality::stuck);
      if (has(held.quality, Quality::restarted)) until_restart = n;
    }
    CHECK(speeds ? bad == c.max_hold_samples + 1 && until_restart == c.max_hold_samples + 2
                 : bad == 1 && stuck == 19 && until_restart == 0);
    // A stop within the limit is legal, and so is standing.
    flagged = 0;
    for (int n = 0; n < 40; ++n)
      flagged += has(move(n == 0 ? 15 - velocity : 0).quality, Quality::jump);
    for (int n = 0; n < 40; ++n) flagged += has(feed(position, 0).quality, Quality::jump);
    CHECK(flagged == 0);
  }
}

// A limit of acceleration is one however small its number is: at 0.5 m/s2 a step of position is a
// jump.
void slow_machines() {
  DriveInputConfig c;
  c.kind = MotionKind::position;
  c.sample_period_s = 1e-3;
  c.unit_per_turn = 0.01;
  c.max_acceleration = 0.5;
  CHECK(DriveInput<double>::validate(c).ok());
  DriveInput<double> in;
  in.configure(c);
  unsigned flagged = 0;
  for (int n = 0; n <= 100; ++n) {
    RawDriveSample<double> raw;
    raw.motion = 1e-4 * n + (n == 100 ? 1e-3 : 0);
    const bool jump = has(in.process(raw).quality, Quality::jump);
    flagged += jump;
    if (n == 100) CHECK(jump);
  }
  CHECK(flagged == 1);
}

void refusals() {
  auto refused = [](DriveInputConfig c, const char* parameter) {
    const Status s = DriveInput<float>::validate(c);
    CHECK(!s.ok());
    CHECK_TEXT(s.parameter(), parameter);
  };
  const DriveInputConfig good = counts_config(32, 1000, 1);
  CHECK(DriveInput<float>::validate(good).ok());
  auto with = [&](auto change) {
    DriveInputConfig c = good;
    change(c);
    return c;
  };
  refused(with([](auto& c) { c.sample_period_s = 0; }), "sample_period_s");
  refused(with([](auto& c) { c.unit_per_count = 0; }), "unit_per_count");
  refused(with([](auto& c) { c.unit_per_count = kNan; }), "unit_per_count");
  refused(with([](auto& c) { c.counter_bits = 0; }), "counter_bits");
  refused(with([](auto& c) { c.counter_bits = 65; }), "counter_bits");
  refused(with([](auto& c) { c.unit_per_turn = 0.0001; }), "unit_per_turn");
  refused(with([](auto& c) { c.unit_per_turn = 2e9 * c.unit_per_count; }), "unit_per_turn");
  refused(with([](auto& c) { c.unit_per_turn = kNan; }), "unit_per_turn");
  refused(with([](auto& c) {
            c.kind = MotionKind::position;
            c.unit_per_turn = std::numeric_limits<double>::infinity();
          }),
          "unit_per_turn");
  refused(with([](auto& c) { c.effort_per_unit = 0; }), "effort_per_unit");
  refused(with([](auto& c) { c.max_speed = -1; }), "max_speed");
  refused(with([](auto& c) { c.max_speed = kNan; }), "max_speed");
  refused(with([](auto& c) { c.max_acceleration = -1; }), "max_acceleration");
  refused(with([](auto& c) { c.max_effort = kNan; }), "max_effort");
  refused(with([](auto& c) { c.group = 0; }), "group");
  refused(with([](auto& c) { c.effort_per_unit = std::numeric_limits<double>::infinity(); }),
          "effort_per_unit");
  refused(with([](auto& c) { c.effort_update_s = -1e-3; }), "effort_update_s");
  refused(with([](auto& c) { c.effort_update_s = 1e6 * c.sample_period_s; }), "effort_update_s");
  CHECK(DriveInput<float>::validate(with([](auto& c) { c.unit_per_count = -0.001; })).ok());
}

// An encoder that counts backwards: angle and increments change sign, nothing else.
void negative_unit() {
  DriveInputConfig c = counts_config(16, 1000, kTwoPi);
  c.unit_per_count = -c.unit_per_count;
  DriveInput<double> in;
  in.configure(c);
  for (int n = 0; n < 3000; ++n) {
    RawDriveSample<double> raw;
    raw.counts = (3 * n) & 0xFFFF;
    const DriveSample<double> o = in.process(raw);
    CHECK_NEAR(o.increment, n == 0 ? 0.0 : -3 * kTwoPi / 1000, 1e-15);
    CHECK_NEAR(std::remainder(o.turn_angle_rad + 3 * n * kTwoPi / 1000, kTwoPi), 0.0, 1e-9);
    CHECK(o.turn_angle_rad >= 0 && o.turn_angle_rad < kTwoPi + 1e-12);
  }
}

}  // namespace

int main() {
  wraps<float>();
  wraps<double>();
  long_runs<float>();
  long_runs<double>();
  beyond_32_bits();
  a_day<float>();
  a_day<double>();
  faults<float>();
  faults<double>();
  persistent_jump();
  limits<float>();
  limits<double>();
  slower_motion<float>();
  slower_motion<double>();
  absurd_numbers<float>();
  absurd_numbers<double>();
  effort_from_the_start();
  impossible_acceleration<double>();
  impossible_acceleration<float>();
  slow_machines();
  refusals();
  negative_unit();
  return check::done();
}
