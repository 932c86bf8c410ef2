// Override control: step by step, and on random streams of events: never outside the limits, never
// faster than the rates, back to 1 when all is over.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <type_traits>

#include "check.hpp"
#include "servosense/monitors/override_control.hpp"

using namespace servosense;

namespace {

constexpr double kPeriod_s = 1e-3;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

OverrideConfig usual() {
  OverrideConfig c;
  c.sample_period_s = kPeriod_s;
  c.least_speed = 0.7;
  c.greatest_speed = 1.2;
  c.least_feed = 0.5;
  c.greatest_feed = 1.1;
  c.speed_rate_per_s = 0.8;
  c.feed_rate_per_s = 1;
  c.variation_amplitude = 0.1;
  c.variation_hz = 1.25;
  c.patience_s = 0.3;
  c.return_s = 0.5;
  return c;
}

template <typename Real = double>
OverrideControl<Real> control(const OverrideConfig& c = usual()) {
  CHECK(OverrideControl<Real>::validate(c).ok());
  OverrideControl<Real> block;
  block.configure(c);
  return block;
}

template <typename Real>
const auto& run(OverrideControl<Real>& block, const OverrideInput<Real>& in, double seconds) {
  const auto n = static_cast<int>(std::lround(seconds / kPeriod_s));
  for (int i = 0; i < n; ++i) block.process(in);
  return block.state();
}

void refusals() {
  CHECK(OverrideControl<float>::validate({}).ok());
  const auto refused = [](const char* parameter, auto change) {
    OverrideConfig c = usual();
    change(c);
    const Status s = OverrideControl<double>::validate(c);
    check::that(!s.ok() && std::string(s.parameter()) == parameter, parameter, __FILE__, __LINE__);
  };
  for (const double bad : {0.0, -1.0, 1.1, kNan}) {
    refused("least_speed", [&](OverrideConfig& c) { c.least_speed = bad; });
    refused("least_feed", [&](OverrideConfig& c) { c.least_feed = bad; });
  }
  for (const double bad : {0.9, 5.0, kNan}) {
    refused("greatest_speed", [&](OverrideConfig& c) { c.greatest_speed = bad; });
    refused("greatest_feed", [&](OverrideConfig& c) { c.greatest_feed = bad; });
  }
  for (const double bad : {0.0, -1.0, kInf, kNan}) {
    refused("sample_period_s", [&](OverrideConfig& c) { c.sample_period_s = bad; });
    refused("speed_rate_per_s", [&](OverrideConfig& c) { c.speed_rate_per_s = bad; });
    refused("feed_rate_per_s", [&](OverrideConfig& c) { c.feed_rate_per_s = bad; });
  }
  refused("least_feed", [](OverrideConfig& c) { c.least_feed = 0.8; });  // thicker chips at 0.7
  refused("feed_rate_per_s", [](OverrideConfig& c) { c.feed_rate_per_s = 0.5; });
  refused("variation_amplitude", [](OverrideConfig& c) { c.variation_amplitude = 0.26; });
  refused("variation_hz", [](OverrideConfig& c) { c.variation_hz = 1.3; });  // 0.82 a second
  refused("patience_s", [](OverrideConfig& c) { c.patience_s = -1; });
  refused("return_s", [](OverrideConfig& c) { c.return_s = kInf; });
  refused("load_cutoff_rad_s", [](OverrideConfig& c) { c.load_cutoff_rad_s = 0; });
  refused("load_release", [](OverrideConfig& c) { c.load_release = 1; });
  OverrideConfig per_turn = usual();
  per_turn.least_feed = 0.8;
  per_turn.feed_per_minute = false;
  CHECK(OverrideControl<double>::validate(per_turn).ok());
}

void nothing_is_allowed_unless_set() {
  auto block = control(OverrideConfig{});
  OverrideInput<double> in;
  in.chatter = true;
  in.load = 3;
  in.advised = {0.9, 1.1};
  for (int i = 0; i < 20000; ++i) {
    const auto& s = block.process(in);
    CHECK(s.speed_ratio == 1 && s.feed_ratio == 1);
  }
  CHECK(block.state().hold && block.state().exhausted);  // and says so
}

void to_an_advised_speed_and_back() {
  auto block = control();
  OverrideInput<double> in;
  run(block, in, 1);
  CHECK(block.state().phase == OverridePhase::programmed && block.state().speed_ratio == 1);
  in.chatter = true;
  in.advised = {kNan, 0.8};
  run(block, in, 0.1);
  CHECK(block.state().phase == OverridePhase::advised);
  CHECK_NEAR(block.state().speed_ratio, 1 - 0.8 * 0.1, 1e-9);
  CHECK_NEAR(block.state().feed_ratio, block.state().speed_ratio, 1e-9);  // chips stay as they are
  run(block, in, 0.2);
  in.chatter = false;  // it has helped, and is kept as long as the cut goes on
  run(block, in, 100);
  CHECK(block.state().speed_ratio == 0.8 && block.state().feed_ratio == 0.8);
  in.in_cut = false;
  run(block, in, 0.49);
  CHECK(block.state().phase == OverridePhase::advised);
  run(block, in, 0.02 + 0.2 / 0.8 + 2 * kPeriod_s);
  CHECK(block.state().speed_ratio == 1 && block.state().feed_ratio == 1 && !block.state().hold);

  // A faster spindle lets the feed grow as far as the user does.
  in = {};
  in.chatter = true;
  in.advised = {1.2, kNan};
  run(block, in, 0.5);
  CHECK(block.state().speed_ratio == 1.2 && block.state().feed_ratio == 1.1);
}

// The advised speeds one after the other, variation, least feed, hold: and it is said.
void every_step_in_turn() {
  auto block = control();
  OverrideInput<double> in;
  in.chatter = true;
  in.advised = {0.9, 1.1};
  run(block, in, 0.1 / 0.8 + 0.29);
  CHECK(block.state().target == 0.9 && block.state().phase == OverridePhase::advised);
  run(block, in, 0.02);
  CHECK(block.state().target == 1.1);
  run(block, in, 0.2 / 0.8 + 0.31);
  CHECK(block.state().phase == OverridePhase::varying && !block.state().exhausted);
  run(block, in, 0.77);  // a period of the variation
  CHECK(block.state().phase == OverridePhase::varying);
  run(block, in, 0.02);
  CHECK(block.state().phase == OverridePhase::reduced && block.state().exhausted);
  CHECK(!block.state().hold);
  run(block, in, 0.31);
  CHECK(block.state().hold);
  // An alarm that goes on is no reason to hold at once again; that nothing helps is.
  in.resume = true;
  block.process(in);
  CHECK(!block.state().hold);
  in.resume = false;
  run(block, in, 0.29);
  CHECK(!block.state().hold);
  run(block, in, 0.02);
  CHECK(block.state().hold);
}

// A short alarm with nothing to try costs some feed for a while; a second one is no false alarm.
void a_second_alarm() {
  OverrideConfig c = usual();
  c.variation_amplitude = 0;
  auto block = control(c);
  OverrideInput<double> in;
  in.chatter = true;
  run(block, in, 0.2);
  in.chatter = false;
  run(block, in, 0.21);  // the feed comes back as fast as it went
  CHECK(block.state().phase == OverridePhase::programmed && !block.state().hold);
  CHECK(block.state().feed_ratio == 1 && block.state().exhausted);
  in.chatter = true;
  CHECK(block.process(in).hold);
  // In the next cut it is the first again.
  in.chatter = in.in_cut = false;
  in.resume = true;
  run(block, in, 1);
  in.in_cut = in.chatter = true;
  CHECK(!block.process(in).hold);
}

void variation() {
  auto block = control();
  OverrideInput<double> in;
  in.chatter = true;
  // Outside the limits, and no numbers: not advice.
  in.advised = {0.6, kInf};
  block.process(in);
  CHECK(block.state().phase == OverridePhase::varying);
  in.chatter = false;
  for (int i = 2; i < 100000; ++i) {
    const double expected = 1 + 0.1 * std::sin(kTwoPi * 1.25 * kPeriod_s * i);
    CHECK_NEAR(block.process(in).speed_ratio, expected, 1e-9);
  }
  // Advice that comes late is taken.
  in.chatter = true;
  in.advised = {0.8, kNan};
  run(block, in, 0.5);
  CHECK(block.state().phase == OverridePhase::advised && block.state().speed_ratio == 0.8);
  // While it is looked for nothing else is tried, but not for ever.
  auto waiting = control();
  in.advised = {kNan, kNan};
  in.advice_pending = true;
  run(waiting, in, 0.29);
  CHECK(waiting.state().phase == OverridePhase::programmed && waiting.state().speed_ratio == 1);
  run(waiting, in, 0.02);
  CHECK(waiting.state().phase == OverridePhase::varying);
  in.advice_pending = false;
  // No room above: it swings about what the limits leave.
  OverrideConfig below = usual();
  below.greatest_speed = 1;
  auto lower = control(below);
  in.advised = {kNan, kNan};
  double least = 2, greatest = 0;
  lower.process(in);
  in.chatter = false;
  run(lower, in, 1);
  for (int i = 0; i < 1600; ++i) {
    const double v = lower.process(in).speed_ratio;
    least = std::min(least, v);
    greatest = std::max(greatest, v);
  }
  CHECK_NEAR(least, 0.8, 1e-5);
  CHECK_NEAR(greatest, 1.0, 1e-5);
}

// What the torque asks for is in proportion to the feed: the feed settles where the load is let be.
void overload() {
  auto block = control();
  OverrideInput<double> in;
  double torque = 1, least_feed = 1;
  const auto cut = [&](double per_feed, double seconds) {
    for (int i = 0; i < static_cast<int>(seconds / kPeriod_s); ++i) {
      torque += 0.04 * (per_feed * block.state().feed_ratio - torque);  // seen with 25 ms of delay
      in.load = torque;
      block.process(in);
      least_feed = std::min(least_feed, block.state().feed_ratio);
    }
  };
  cut(0.95, 2);
  CHECK(block.state().feed_ratio == 1);  // below 1 nothing is done
  cut(1.4, 3);
  CHECK_BETWEEN(torque, 0.9, 1.0);
  CHECK(least_feed > 0.64);  // 1 / 1.4 less what comes down within the delay
  const double settled = block.state().feed_ratio;
  cut(1.4, 20);
  CHECK(block.state().feed_ratio == settled);  // it does not hunt
  cut(1.0, 3);
  CHECK(block.state().feed_ratio > 0.9 && !block.state().hold);
  cut(0.5, 3);
  CHECK(block.state().feed_ratio == 1 && !block.state().overloaded);
  cut(3, 0.5 / 1 + 0.2);  // more than the least feed helps against
  CHECK(!block.state().hold);
  cut(3, 0.4);
  CHECK(block.state().hold);
  in.load = kNan;  // not known any more: nothing stays
  in.resume = true;
  run(block, in, 2);
  CHECK(block.state().feed_ratio == 1 && !block.state().hold);
}

// A link that takes a new feed every 0.2 s, and 0.1 s for it: what is on its way is not asked for
// again, so the feed neither falls too far nor comes back too far.
void overload_behind_a_slow_link() {
  auto block = control();
  OverrideInput<double> in;
  double torque = 1, least_feed = 1, highest = 0, on_its_way = 1;
  in.feed_in_effect = 1;
  const auto cut = [&](double per_feed, double seconds, double settles_s) {
    least_feed = 1;
    highest = 0;
    for (int i = 0; i < static_cast<int>(seconds / kPeriod_s); ++i) {
      if (i % 200 == 0) on_its_way = block.state().feed_ratio;
      if (i % 200 == 100) in.feed_in_effect = on_its_way;
      torque += 0.025 * (per_feed * in.feed_in_effect - torque);
      in.load = torque;
      block.process(in);
      least_feed = std::min(least_feed, block.state().feed_ratio);
      if (i * kPeriod_s > settles_s) highest = std::max(highest, torque);
    }
  };
  cut(0.8, 2, 0);
  cut(1.4, 20, 1);
  CHECK_BETWEEN(least_feed, 0.94 * 0.95 / 1.4, 0.95 / 1.4 + 0.01);
  CHECK(highest < 1);
  cut(1.1, 20, 0);  // the feed comes back, as far as it may
  CHECK_BETWEEN(block.state().feed_ratio, 0.9 / 1.1 - 0.01, 0.96 / 1.1);
  CHECK(highest < 1 && !block.state().hold);
  cut(0.5, 4, 0);
  CHECK(block.state().feed_ratio == 1 && !block.state().overloaded);
}

void hold_comes_first() {
  auto block = control();
  OverrideInput<double> in;
  in.chatter = true;
  in.advised = {0.8, kNan};
  run(block, in, 0.1);
  in.collision = in.resume = in.taken_over = true;
  CHECK(block.process(in).hold);
  in.taken_over = false;
  run(block, in, 5);
  CHECK(block.state().hold);  // a resume of before is none
  in.resume = false;
  block.process(in);
  in.resume = true;
  CHECK(!block.process(in).hold);  // the operator's word; the collision still stands
  run(block, in, 5);
  CHECK(!block.state().hold);
  in.collision = in.resume = false;
  block.process(in);
  in.collision = true;
  CHECK(block.process(in).hold);
}

void the_operator_wins() {
  auto block = control();
  OverrideInput<double> in;
  in.chatter = true;
  in.load = 2;
  in.advised = {0.8, kNan};
  run(block, in, 0.2);
  in.taken_over = true;
  block.process(in);
  in.taken_over = false;
  for (int i = 0; i < 10000; ++i) {
    const auto& s = block.process(in);
    CHECK(s.phase == OverridePhase::yielded && s.speed_ratio == 1 && s.feed_ratio == 1 && !s.hold);
  }
  in.in_cut = false;
  run(block, in, 10);
  CHECK(block.state().phase == OverridePhase::yielded);  // the alarm goes on
  in.chatter = false;
  in.load = 0.1;
  run(block, in, 0.6);
  CHECK(block.state().phase == OverridePhase::programmed);
  in.chatter = in.in_cut = true;
  block.process(in);
  CHECK(block.state().phase == OverridePhase::advised);
}

// Any stream of events and advice.
template <typename Real>
void random_streams(double rounding) {
  double widest = 0;
  for (unsigned seed = 1; seed <= 150; ++seed) {
    std::mt19937 random(seed);
    const auto share = [&] { return static_cast<double>(random()) / 4294967296.0; };
    OverrideConfig c = usual();
    c.least_speed = 0.5 + 0.5 * share();
    c.greatest_speed = 1 + 0.5 * share();
    c.least_feed = c.least_speed * (0.3 + 0.7 * share());
    c.greatest_feed = 1 + 0.3 * share();
    c.speed_rate_per_s = 0.05 + 2 * share();
    c.feed_rate_per_s = c.speed_rate_per_s * (1 + share());
    c.variation_hz = 0.1 + 2 * share();
    c.variation_amplitude = share() < 0.3
                                ? 0
                                : 0.999 * std::min((c.greatest_speed - c.least_speed) / 2,
                                                   c.speed_rate_per_s / kTwoPi / c.variation_hz);
    c.feed_per_minute = share() < 0.7;
    auto block = control<Real>(c);
    OverrideInput<Real> in;
    Real speed = 1, feed = 1;
    std::uint32_t wrong = 0;
    const double speed_step = c.speed_rate_per_s * kPeriod_s + rounding;
    const double feed_step = c.feed_rate_per_s * kPeriod_s + rounding;
    const double change = std::pow(10, -1 - 2.5 * share());
    const auto value = [&](double low, double high) {
      const double kind = share();
      if (kind < 0.2) return std::numeric_limits<Real>::quiet_NaN();
      if (kind < 0.25) return std::numeric_limits<Real>::infinity();
      if (kind < 0.3) return -std::numeric_limits<Real>::max();
      return static_cast<Real>(low + (high - low) * share());
    };
    for (int i = 0; i < 20000; ++i) {
      if (share() < change) in.chatter = !in.chatter;
      if (share() < change) in.collision = !in.collision;
      if (share() < change) in.in_cut = !in.in_cut;
      if (share() < change) in.resume = !in.resume;
      if (share() < change) in.load = value(0, 2);
      if (share() < change) in.feed_in_effect = value(0, 1.2);
      if (share() < change) in.advised = {value(0.3, 1.7), value(0.3, 1.7)};
      if (share() < change) in.advice_pending = !in.advice_pending;
      in.taken_over = share() < 0.02 * change;
      const bool collides = in.collision && !block.state().collision;
      const auto& s = block.process(in);
      // The operator's setting is a new 1: there nothing is moved, but what it is measured by.
      const bool jumps = in.taken_over;
      wrong += !(s.speed_ratio >= static_cast<Real>(c.least_speed) &&
                 s.speed_ratio <= static_cast<Real>(c.greatest_speed) &&
                 s.feed_ratio >= static_cast<Real>(c.least_feed) &&
                 s.feed_ratio <= static_cast<Real>(c.greatest_feed));
      wrong += !jumps && !(std::abs(static_cast<double>(s.speed_ratio - speed)) <= speed_step);
      wrong += !jumps && !(std::abs(static_cast<double>(s.feed_ratio - feed)) <= feed_step);
      wrong += collides && !s.hold;
      wrong += s.phase == OverridePhase::yielded && !(s.speed_ratio == 1 && s.feed_ratio == 1);
      widest = std::max(widest, std::abs(static_cast<double>(s.speed_ratio) - 1));
      speed = s.speed_ratio;
      feed = s.feed_ratio;
    }
    // When all is over everything comes back, in the times that were set.
    in = {};
    in.in_cut = false;
    in.load = value(0, 0.5);
    block.process(in);
    in.resume = true;
    run(block, in, 2 * c.return_s + 0.5 / c.speed_rate_per_s + 1 / c.feed_rate_per_s + 0.1);
    const auto& s = block.state();
    wrong += !(s.speed_ratio == 1 && s.feed_ratio == 1 && !s.hold && !s.exhausted &&
               s.phase == OverridePhase::programmed);
    check::that(wrong == 0, ("seed " + std::to_string(seed)).c_str(), __FILE__, __LINE__);
  }
  CHECK(widest > 0.3);  // the streams do move it
}

}  // namespace

int main() {
  static_assert(std::is_trivially_copyable_v<OverrideControl<float>::State>);
  refusals();
  nothing_is_allowed_unless_set();
  to_an_advised_speed_and_back();
  every_step_in_turn();
  a_second_alarm();
  variation();
  overload();
  overload_behind_a_slow_link();
  hold_comes_first();
  the_operator_wins();
  random_streams<double>(1e-15);
  random_streams<float>(1.2e-7);  // half a unit of the last place of a ratio, and of the step
  return check::done();
}
