// Overrides from alarms through the C interface: translation, nothing else.
#include "servosense/capi/override.h"

#include <new>
#include <type_traits>

#include "servosense/monitors/override_control.hpp"

using namespace servosense;

namespace {

using Control = OverrideControl<float>;
constexpr std::uint64_t kMade = 0x53564f5645520001;

static_assert(sizeof(Control) <= sizeof(servosense_override::inside));
static_assert(alignof(Control) <= alignof(servosense_override));
static_assert(std::is_trivially_copyable_v<Control> && std::is_trivially_destructible_v<Control>);
static_assert(static_cast<int>(OverridePhase::yielded) == SERVOSENSE_YIELDED);

Control& control_in(servosense_override& overrides) noexcept {
  return *std::launder(reinterpret_cast<Control*>(overrides.inside));  // NOLINT: made there
}

bool is_made(const servosense_override* overrides) noexcept {
  return overrides != nullptr && overrides->made == kMade;
}

/// Calls visit(field of C, field of the block) for each.
template <typename C, typename B, typename Visit>
void fields(C& c, B& b, Visit visit) {
  visit(c.sample_period_s, b.sample_period_s);
  visit(c.least_speed, b.least_speed);
  visit(c.greatest_speed, b.greatest_speed);
  visit(c.least_feed, b.least_feed);
  visit(c.greatest_feed, b.greatest_feed);
  visit(c.speed_rate_per_s, b.speed_rate_per_s);
  visit(c.feed_rate_per_s, b.feed_rate_per_s);
  visit(c.variation_amplitude, b.variation_amplitude);
  visit(c.variation_hz, b.variation_hz);
  visit(c.patience_s, b.patience_s);
  visit(c.return_s, b.return_s);
  visit(c.load_release, b.load_release);
}

}  // namespace

extern "C" {

void servosense_override_default_config(servosense_override_config* config) {
  if (config == nullptr) return;
  const OverrideConfig defaults;
  fields(*config, defaults, [](double& c, const double& b) { c = b; });
  config->feed_per_minute = defaults.feed_per_minute ? 1 : 0;
}

const char* servosense_override_init(servosense_override* overrides,
                                     const servosense_override_config* config,
                                     const char** parameter) {
  const char* nowhere = "";
  const char** const field = parameter != nullptr ? parameter : &nowhere;
  *field = "";
  if (overrides == nullptr || config == nullptr) return "storage and configuration must be given";
  overrides->made = 0;
  OverrideConfig known;
  fields(*config, known, [](const double& c, double& b) { b = c; });
  known.feed_per_minute = config->feed_per_minute != 0;
  if (const Status status = Control::validate(known); !status.ok()) {
    *field = status.parameter();
    return status.reason();
  }
  auto* const made = new (overrides->inside) Control;
  made->configure(known);
  overrides->made = kMade;
  return nullptr;
}

void servosense_override_reset(servosense_override* overrides) {
  if (is_made(overrides)) control_in(*overrides).reset();
}

servosense_override_command servosense_override_process(servosense_override* overrides,
                                                        const servosense_override_input* input) {
  if (!is_made(overrides) || input == nullptr) return {1, 1, 1, SERVOSENSE_PROGRAMMED, 0, 0};
  OverrideInput<float> in;
  in.chatter = input->chatter != 0;
  in.collision = input->collision != 0;
  in.in_cut = input->in_cut != 0;
  in.load = input->load;
  in.advised = {input->advised[0], input->advised[1]};
  in.advice_pending = input->advice_pending != 0;
  in.resume = input->resume != 0;
  in.taken_over = input->taken_over != 0;
  const Control::State& s = control_in(*overrides).process(in);
  return {s.speed_ratio,       s.feed_ratio,        s.hold ? 1 : 0, static_cast<int>(s.phase),
          s.exhausted ? 1 : 0, s.overloaded ? 1 : 0};
}

const char* servosense_override_phase_name(int phase) {
  return phase < SERVOSENSE_PROGRAMMED || phase > SERVOSENSE_YIELDED
             ? ""
             : name_of(static_cast<OverridePhase>(phase));
}

}  // extern "C"
