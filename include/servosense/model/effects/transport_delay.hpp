// The effort acts later than it is reported, by a constant time.
//   u(t) = u_reported(t - tau)
// Discretisation: whole samples from a ring buffer, the rest by linear interpolation (amplitude
// within 0.5 % below a thirtieth of the sample rate).
// Range: 254 samples in float, 4094 in double.
// Bad at: motion that is late against the current, which would need a look ahead.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/status.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class TransportDelay {
 public:
  static constexpr EffectInfo info = effect_info("transport-delay");
  static constexpr EffectTraits traits = {
      .equation = "u(t) = u_reported(t - tau)",
      .where = "force-rate",
      .signature = "the effort acts a constant time late",
      .confused_with = {"current-loop-lag"},
      .splitting_motion =
          "fast changes of force: the phase of a delay is linear in frequency, a lag rolls off",
      .sized = true,
      .search = {{{EffectRole::searched, 0.0002, 0.008, EffectRange::absolute, 14}}}};

  /// The simulator, in double, takes many steps per servo period.
  static constexpr std::size_t kCapacity = sizeof(Real) == 4 ? 256 : 4096;

  struct State {
    std::array<Real, kCapacity> efforts{};
    std::uint16_t newest = 0;
    std::uint16_t known = 0;  // how many are older than the newest
  };

  static Status validate(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    return setting.scalar(0) / drive.sample_period_s <= kCapacity - 2
               ? Status{}
               : Status::invalid("delay_s", "must be at most 254 sample periods (4094 in double)");
  }
  void configure(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    const double samples = setting.scalar(0) / drive.sample_period_s;
    whole_ = static_cast<std::uint16_t>(samples);
    part_ = static_cast<Real>(samples - static_cast<double>(whole_));
  }
  /// As if the next effort had been there for ever.
  void reset() noexcept { state_.known = 0; }
  void start(const MotionState<Real>& /*m*/) noexcept { reset(); }
  Real acting_effort(Real reported, const MotionState<Real>& /*m*/) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    s.newest = static_cast<std::uint16_t>((s.newest + 1U) % kCapacity);
    s.efforts[s.newest] = reported;
    const unsigned back = whole_ < s.known ? whole_ : s.known;
    const unsigned further = back < s.known ? back + 1 : back;
    if (s.known < kCapacity - 1) ++s.known;
    const Real late = s.efforts[(s.newest - back) % kCapacity];
    const Real later = s.efforts[(s.newest - further) % kCapacity];
    return late + part_ * (later - late);
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  std::uint16_t whole_ = 0;
  Real part_ = 0;
};

}  // namespace servosense
