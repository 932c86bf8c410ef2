// Pairs of signals: the filter against its closed forms, terms against their polynomials, readings
// that wrap, and when a watch speaks.
#include <cmath>
#include <limits>
#include <vector>

#include "check.hpp"
#include "servosense/monitors/paired_signals.hpp"

namespace {

using namespace servosense;

constexpr double kW = PairReader::kCutoff_rad_s;

/// Two equal poles at w: of a sine of frequency f, gain 1 / (1 + (f/w)^2), phase -2 atan(f/w). The
/// bilinear form is that at 2 / T tan(f T / 2) instead of f.
void filter_of_a_sine() {
  constexpr double kPeriod = 5e-4, kFrequency = 60;
  const double half_step = kW * kPeriod / 2;
  const double ratio = std::tan(kFrequency * kPeriod / 2) / half_step;
  const double gain = 1 / (1 + ratio * ratio), phase = -2 * std::atan(ratio);
  FilteredSignal f;
  f.reset(0);
  double worst = 0, worst_rate = 0, worst_curvature = 0;
  for (int n = 0; n < 8000; ++n) {
    const double t = n * kPeriod;
    f.process(std::sin(kFrequency * t), half_step, kW);
    if (t < 1) continue;
    const double w = kW * ratio;  // what the filter takes the frequency for
    worst = std::max(worst, std::abs(f.low() - gain * std::sin(kFrequency * t + phase)));
    worst_rate =
        std::max(worst_rate, std::abs(f.rate() - w * gain * std::cos(kFrequency * t + phase)));
    worst_curvature = std::max(
        worst_curvature, std::abs(f.curvature() + w * w * gain * std::sin(kFrequency * t + phase)));
  }
  CHECK(worst < 1e-12);
  CHECK(worst_rate < 1e-10);
  CHECK(worst_curvature < 1e-7);
}

void terms() {
  PairTerms t{1, 2, 3, 4, 5, 6, 7};
  PairSample s;
  s.position = 0.1;
  s.velocity = 0.2;
  s.acceleration = 0.3;
  s.direction = -1;
  s.effort = 10;
  s.command_rate = 0.5;
  CHECK_NEAR(t.at(s), 1 + 0.2 + 0.6 + 1.2 - 5 + 60 + 3.5, 1e-12);
  t.low = -1;
  t.high = 1;
  t.curve = {1, 10, 100, 1000};
  // Legendre's P2 to P5 at 1/2: -1/8, -7/16, -37/128, 23/256.
  const auto p = t.polynomials(0.5);
  CHECK_NEAR(p[0], -1.0 / 8, 1e-15);
  CHECK_NEAR(p[1], -7.0 / 16, 1e-15);
  CHECK_NEAR(p[2], -37.0 / 128, 1e-15);
  CHECK_NEAR(p[3], 23.0 / 256, 1e-15);
  CHECK(t.polynomials(3) == t.polynomials(1));
  const auto again = PairTerms::from(t.list());
  CHECK(again && again->list() == t.list() && t.list().size() == 13);
  CHECK(PairTerms::from(std::vector<double>(7)) && !PairTerms::from(std::vector<double>(8)));
}

/// Motor in counts of 16 bit that wrap, scale in m; both move evenly.
void readings_that_wrap() {
  PairedColumns columns;
  columns.drive.signal = {MotionKind::counts, EffortKind::force_N};
  columns.drive.motion_column = 0;
  columns.drive.effort_column = 1;
  columns.load = 2;
  PairScaling scaling;
  scaling.unit_per_count = 1e-6;
  scaling.counter_bits = 16;
  PairReader reader(columns, scaling);
  double worst = 0;
  for (int n = 0; n < 2000; ++n) {
    TraceRow row;
    row.t_ns = n * 1'000'000LL;
    const long long counts = 250LL * n;  // 0.25 m/s
    row.fields.assign(3, TraceField());
    row.fields[0] = TraceField::of_counts(static_cast<std::int16_t>(counts));
    row.fields[1] = TraceField::of(5);
    row.fields[2] = TraceField::of(0.7 + 250e-6 * n);
    const bool heard = reader.hear(row);
    CHECK(heard == (n > 0));
    if (!heard || !reader.sample().settled) continue;
    worst = std::max(worst, std::abs(reader.sample().difference[0] - 0.7));
    worst = std::max(worst, std::abs(reader.sample().velocity - 0.25));
    CHECK(std::isnan(reader.sample().difference[1]));
  }
  CHECK(reader.sample().settled);
  CHECK_NEAR(worst, 0, 1e-9);
  // A row that is no good starts the filters anew.
  TraceRow bad;
  bad.t_ns = 2'000'000'000;
  bad.fields.assign(3, TraceField());
  bad.fields[2] = TraceField::invalid();
  CHECK(!reader.hear(bad) && !reader.sample().settled);
}

PairSample sample_at(double t_s, PairKind kind, double difference) {
  PairSample s;
  s.t_s = t_s;
  s.settled = true;
  s.difference.fill(std::numeric_limits<double>::quiet_NaN());
  s.difference[static_cast<std::size_t>(kind)] = difference;
  return s;
}

void when_it_speaks() {
  using Change = PairWatch::Change;
  PairWatchConfig config;
  config.kind = PairKind::load;
  config.band = 1e-4;
  PairWatch watch(config);
  double spoke = 0, again = 0;
  int times = 0;
  for (int n = 0; n < 40000; ++n) {
    const double t = n * 1e-3;
    // Any zero; 90 um wide for 10 s, then a slip, and another at 30 s.
    const double at = 0.3 + 45e-6 * std::sin(t) + (t > 10 ? 2e-4 : 0) + (t > 30 ? 2e-4 : 0);
    const Change change = watch.process(sample_at(t, PairKind::load, at), false);
    if (change != Change::beyond) continue;
    (times++ == 0 ? spoke : again) = t;
    CHECK(watch.value() > 1.5e-4);
  }
  CHECK(times == 2);
  CHECK_NEAR(spoke, 10 + PairWatch::kHold_s, 3e-3);
  CHECK_NEAR(again, 30 + PairWatch::kHold_s, 3e-3);
  CHECK_NEAR(watch.watched_s(), 40, 0.01);

  // A brief one says nothing, and a hole is no slip.
  PairWatch brief(config);
  for (int n = 0; n < 3000; ++n) {
    PairSample s = sample_at(n * 1e-3, PairKind::load, n >= 1000 && n < 1040 ? 2e-4 : 0);
    if (n >= 2000) s.difference[0] = 5;
    if (n >= 1900 && n < 2000) s.settled = false;
    CHECK(brief.process(s, false) == Change::none);
  }

  // A cut beside one guide is allowed what it takes; in the air nothing is.
  config = {};
  config.kind = PairKind::skew_effort;
  config.band = 100;
  for (const bool air : {false, true}) {
    PairWatch efforts(config);
    int alarms = 0;
    for (int n = 0; n < 1000; ++n) {
      PairSample s = sample_at(n * 1e-3, PairKind::skew_effort, n > 500 ? 400 : 0);
      s.effort = n > 500 ? 400 : 0;
      alarms += efforts.process(s, air) == Change::beyond;
    }
    CHECK(alarms == (air ? 1 : 0));
  }
}

}  // namespace

int main() {
  filter_of_a_sine();
  terms();
  readings_that_wrap();
  when_it_speaks();
  return check::done();
}
