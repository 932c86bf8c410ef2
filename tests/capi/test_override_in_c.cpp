// Overrides through the C interface: bit for bit those of the block on random streams; what is
// refused, and what holds the feed.
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <string>

#include "check.hpp"
#include "servosense/capi/override.h"
#include "servosense/monitors/override_control.hpp"

namespace {

using namespace servosense;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

bool same(float a, float b) { return std::memcmp(&a, &b, sizeof a) == 0; }

void same_as_the_block() {
  int commands = 0, holds = 0;
  for (std::uint32_t seed = 0; seed < 40; ++seed) {
    std::mt19937 random(seed);
    const auto chance = [&](double p) {
      return std::uniform_real_distribution<double>(0, 1)(random) < p;
    };
    servosense_override_config config;
    servosense_override_default_config(&config);
    OverrideConfig block;
    config.sample_period_s = block.sample_period_s = 1e-3;
    config.least_speed = block.least_speed = 0.7;
    config.greatest_speed = block.greatest_speed = 1.3;
    config.least_feed = block.least_feed = 0.5;
    config.greatest_feed = block.greatest_feed = 1.2;
    config.patience_s = block.patience_s = 0.1;
    config.return_s = block.return_s = 0.05;
    config.feed_per_minute = seed % 2;
    block.feed_per_minute = seed % 2 == 1;
    if (seed % 3 == 0) {
      config.variation_amplitude = block.variation_amplitude = 0.07;
      config.variation_hz = block.variation_hz = 1.1;
    }
    servosense_override made;
    CHECK(servosense_override_init(&made, &config, nullptr) == nullptr);
    CHECK(OverrideControl<float>::validate(block).ok());
    OverrideControl<float> control;
    control.configure(block);
    servosense_override_input in{};
    in.in_cut = 1, in.load = kNan, in.advised[0] = in.advised[1] = kNan;
    for (int i = 0; i < 4000; ++i) {
      if (chance(0.005)) in.chatter = !in.chatter;
      if (chance(0.002)) in.in_cut = !in.in_cut;
      in.collision = chance(0.0005);
      in.resume = chance(0.003);
      in.taken_over = chance(0.0003);
      if (chance(0.01)) in.load = chance(0.3) ? kNan : static_cast<float>(0.7 + chance(0.4));
      if (chance(0.01))
        in.advised[0] = chance(0.3) ? kNan : 0.65F + 0.1F * static_cast<float>(i % 8);
      if (chance(0.01)) in.advised[1] = chance(0.5) ? kNan : 0.9F;
      in.advice_pending = chance(0.1);
      OverrideInput<float> same_in;
      same_in.chatter = in.chatter != 0, same_in.collision = in.collision != 0;
      same_in.in_cut = in.in_cut != 0, same_in.load = in.load;
      same_in.advised = {in.advised[0], in.advised[1]};
      same_in.advice_pending = in.advice_pending != 0;
      same_in.resume = in.resume != 0, same_in.taken_over = in.taken_over != 0;
      const auto& s = control.process(same_in);
      const servosense_override_command c = servosense_override_process(&made, &in);
      CHECK(same(c.speed_ratio, s.speed_ratio) && same(c.feed_ratio, s.feed_ratio));
      CHECK(c.hold == s.hold && c.phase == static_cast<int>(s.phase));
      CHECK(c.exhausted == s.exhausted && c.overloaded == s.overloaded);
      commands += c.speed_ratio != 1 || c.feed_ratio != 1;
      holds += c.hold;
    }
    servosense_override_reset(&made);
    in = {};
    in.load = kNan;
    const servosense_override_command fresh = servosense_override_process(&made, &in);
    CHECK(fresh.speed_ratio == 1 && fresh.feed_ratio == 1 && fresh.hold == 0);
  }
  // The streams reach what they compare.
  CHECK(commands > 10000 && holds > 1000);
}

void refusals() {
  servosense_override made{};
  servosense_override_config config;
  servosense_override_default_config(&config);
  const char* field = nullptr;
  CHECK(servosense_override_init(nullptr, &config, &field) != nullptr);
  CHECK(servosense_override_init(&made, nullptr, &field) != nullptr);
  config.least_speed = 1.5;
  CHECK(servosense_override_init(&made, &config, &field) != nullptr);
  CHECK_TEXT(std::string(field), "least_speed");
  // What was not made holds, and so does one that was refused.
  const servosense_override_input in{};
  CHECK(servosense_override_process(&made, &in).hold == 1);
  CHECK(servosense_override_process(nullptr, &in).hold == 1);
  config.least_speed = 0.8;
  CHECK(servosense_override_init(&made, &config, &field) != nullptr);  // thicker chips
  CHECK_TEXT(std::string(field), "least_feed");
  config.least_feed = 0.8;
  CHECK(servosense_override_init(&made, &config, &field) == nullptr);
  CHECK_TEXT(std::string(field), "");
  CHECK(servosense_override_process(&made, nullptr).hold == 1);
  CHECK(servosense_override_process(&made, &in).hold == 0);
  CHECK_TEXT(std::string(servosense_override_phase_name(SERVOSENSE_REDUCED)), "reduced");
  CHECK_TEXT(std::string(servosense_override_phase_name(5)), "");
  CHECK_TEXT(std::string(servosense_override_phase_name(-1)), "");
}

}  // namespace

int main() {
  same_as_the_block();
  refusals();
  return check::done();
}
